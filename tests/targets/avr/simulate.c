/* simulate MCU PROGRAM [ENTRY]: run a program of port.c; input and output are this one's. With the address of a
 * function, its calls are listed on stderr: cycles from its first instruction through its return, and bytes of stack,
 * its return address included. */
#include <libelf.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { GPIOR0 = 0x3e, GPIOR1 = 0x4a, READ = 1, WRITE = 2, EXIT = 3 }; /* data memory, as in port.c */
enum { LIMIT = 2000000000 };                                          /* instructions; a program that hangs ends */

static FILE *output;     /* stdout; simavr itself prints there what it loads */
static unsigned request; /* the last four bytes written to GPIOR1: address, then size */

static void collect(avr_t *avr, avr_io_addr_t address, uint8_t value, void *unused)
{
    (void)avr, (void)address, (void)unused;
    request = request >> 8 | (unsigned)value << 24;
}

static void serve(avr_t *avr, avr_io_addr_t address, uint8_t value, void *unused)
{
    (void)address, (void)unused;
    const unsigned at = request & 0xffff, size = request >> 16;
    if (at + size > avr->ramend + 1u) exit(101);
    if (value == READ && fread(avr->data + at, 1, size, stdin) != size) exit(3);
    if (value == WRITE && fwrite(avr->data + at, 1, size, output) != size) exit(4);
    if (value == EXIT) exit((int)at);
}

static unsigned stack(const avr_t *avr) { return avr->data[R_SPL] | (unsigned)avr->data[R_SPH] << 8; }

/* Whether an instruction leaves a whole stack pointer that may be lower: push, call, rcall, icall, out SPL. SPH is
 * written first, and until SPL follows the pointer means nothing. */
static int lowers(unsigned code)
{
    return (code & 0xfe0f) == 0x920f || (code & 0xfe0e) == 0x940e || (code & 0xf000) == 0xd000 || code == 0x9509 ||
           (code & 0xfe0f) == 0xbe0d;
}

int main(int count, char **words)
{
    elf_firmware_t firmware;
    output = fdopen(dup(1), "wb");
    if (!output || !freopen("/dev/null", "w", stdout)) return 106;
    memset(&firmware, 0, sizeof firmware);
    if (count < 3 || elf_read_firmware(words[2], &firmware) != 0) return 102;
    avr_t *avr = avr_make_mcu_by_name(words[1]);
    if (!avr || avr_init(avr) != 0) return 103;
    firmware.frequency = 16000000;
    avr_load_firmware(avr, &firmware);
    avr_register_io_write(avr, GPIOR0, serve, NULL);
    avr_register_io_write(avr, GPIOR1, collect, NULL);

    const avr_flashaddr_t entry = count > 3 ? (avr_flashaddr_t)strtoul(words[3], NULL, 0) : UINT32_MAX;
    avr_flashaddr_t after = UINT32_MAX;
    avr_cycle_count_t since = 0;
    unsigned top = 0, lowest = 0;
    for (long i = 0; i < LIMIT; i++) {
        const unsigned at = stack(avr), code = avr->flash[avr->pc] | (unsigned)avr->flash[avr->pc + 1] << 8;
        if (avr->pc == entry && after == UINT32_MAX) { /* the return address, in words, is on top of the stack */
            after = 2u * ((unsigned)avr->data[at + 1] << 8 | avr->data[at + 2]);
            since = avr->cycle;
            top = at;
            lowest = at;
        } else if (avr->pc == after && at > top) {
            fprintf(stderr, "%lu %u\n", (unsigned long)(avr->cycle - since), top + 2 - lowest);
            after = UINT32_MAX;
        }
        const int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return 104;
        if (lowers(code) && stack(avr) < lowest) lowest = stack(avr);
    }
    return 105;
}
