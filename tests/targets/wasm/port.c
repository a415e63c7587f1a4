/* The host provides port_read and port_write. What a compiler may call, C99 wants to be there. */
#include <stdio.h>

#include "port.h"

typedef __SIZE_TYPE__ size;

int main(void);

__attribute__((export_name("run"))) int run(void) { return main(); }

/* volatile, or the loops are found to be what they define */
void *memcpy(void *to, const void *from, size count)
{
    volatile unsigned char *a = to;
    const unsigned char *b = from;
    while (count-- > 0) *a++ = *b++;
    return to;
}

void *memmove(void *to, const void *from, size count)
{
    volatile unsigned char *a = to;
    const unsigned char *b = from;
    if (a < b) return memcpy(to, from, count);
    while (count-- > 0) a[count] = b[count];
    return to;
}

void *memset(void *to, int value, size count)
{
    volatile unsigned char *a = to;
    while (count-- > 0) *a++ = (unsigned char)value;
    return to;
}

int putchar(int c)
{
    const char one = (char)c;
    port_write(&one, 1);
    return c;
}
