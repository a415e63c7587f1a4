#include <stdio.h>
#include <stdlib.h>

#include "port.h"

void port_read(void *to, unsigned size)
{
    if (fread(to, 1, size, stdin) != size) exit(3);
}

void port_write(const void *from, unsigned size)
{
    if (fwrite(from, 1, size, stdout) != size) exit(4);
}
