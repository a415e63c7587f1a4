/* Start-up and semihosting of a Cortex-M. Files "input" and "output" are the host's, in its working directory. */
#include "port.h"

#include <stdint.h>
#include <string.h>

extern uint32_t stack_top, data_from, data_begin, data_end, bss_begin, bss_end; /* the linker script's */

int main(void);
void reset(void);
static void fault(void);

typedef void handler(void);

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler *exceptions[15];
} vectors = {&stack_top, {reset, fault, fault, fault, fault, fault}};

/* ---- Semihosting: "Semihosting for AArch32 and AArch64", Arm IHI 0071 ---- */

enum { OPEN = 0x01, WRITE = 0x05, READ = 0x06, EXIT = 0x20 };
enum { READ_BINARY = 1, WRITE_BINARY = 5 }; /* modes of fopen: "rb" and "wb" */

static uint32_t host(uint32_t operation, const void *arguments)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void leave(uint32_t code)
{
    const uint32_t arguments[] = {0x20026, code}; /* ADP_Stopped_ApplicationExit */
    for (;;) host(EXIT, arguments);
}

static void fault(void) { leave(100); }

static uint32_t opened(const char *name, uint32_t mode)
{
    const uint32_t arguments[] = {(uint32_t)name, mode, (uint32_t)strlen(name)};
    return host(OPEN, arguments);
}

static uint32_t input, output;

void port_read(void *to, unsigned size)
{
    const uint32_t arguments[] = {input, (uint32_t)to, size};
    if (size > 0 && host(READ, arguments) != 0) leave(3);
}

void port_write(const void *from, unsigned size)
{
    const uint32_t arguments[] = {output, (uint32_t)from, size};
    if (size > 0 && host(WRITE, arguments) != 0) leave(4);
}

/* ---- Start ---- */

void reset(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to the FPU */
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
    for (uint32_t *to = &data_begin, *from = &data_from; to < &data_end;) *to++ = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    input = opened("input", READ_BINARY);
    output = opened("output", WRITE_BINARY);
    leave((uint32_t)main());
}

/* ---- What newlib's stdio asks for ---- */

int _write(int file, const char *from, int size);
int _read(int file, char *to, int size);
int _close(int file);
int _fstat(int file, void *status);
int _isatty(int file);
int _lseek(int file, int offset, int whence);
void *_sbrk(int size);
void _exit(int code);
int _kill(int process, int signal);
int _getpid(void);

int _write(int file, const char *from, int size)
{
    (void)file;
    port_write(from, (unsigned)size);
    return size;
}

#ifndef PORT_HEAP
#define PORT_HEAP 1024 /* a stream's buffer */
#endif

void *_sbrk(int size)
{
    static uint64_t heap[PORT_HEAP / 8];
    static int used;
    if (used + size > (int)sizeof heap) return (void *)-1;
    used += size;
    return (char *)heap + used - size;
}

void _exit(int code)
{
    leave((uint32_t)code);
    for (;;) continue;
}

int _read(int file, char *to, int size) { return (void)file, (void)to, (void)size, -1; }
int _close(int file) { return (void)file, -1; }
int _fstat(int file, void *status) { return (void)file, (void)status, -1; }
int _isatty(int file) { return (void)file, 1; }
int _lseek(int file, int offset, int whence) { return (void)file, (void)offset, (void)whence, -1; }
int _kill(int process, int signal) { return (void)process, (void)signal, -1; }
int _getpid(void) { return 1; }
