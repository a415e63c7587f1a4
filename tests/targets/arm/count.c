/* A QEMU plugin: executed instructions of each call of a function with all it calls, then per address.
 *
 * -plugin count.so,entry=A,from=B,to=C,out=FILE: a call begins at A and ends at the first instruction of its caller,
 * B <= address < C. An instruction that its IT block skips counts, as it takes a cycle. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Of QEMU's plugin interface, version 1; its header is not part of Debian's package. */
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef void (*on_translation)(uint64_t id, struct qemu_plugin_tb *block);
typedef void (*on_execution)(unsigned cpu, void *data);
typedef void (*on_end)(uint64_t id, void *data);
void qemu_plugin_register_vcpu_tb_trans_cb(uint64_t id, on_translation function);
void qemu_plugin_register_atexit_cb(uint64_t id, on_end function, void *data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *instruction);
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *, on_execution, int registers, void *data);
void qemu_plugin_register_vcpu_insn_exec_inline(struct qemu_plugin_insn *, int operation, void *, uint64_t value);
enum { NO_REGISTERS = 0, ADD_U64 = 0 };
__attribute__((visibility("default"))) int qemu_plugin_version = 1;

enum { FLASH = 1 << 20 };
static uint64_t total, since, hits[FLASH / 2], entry, from, to;
static int inside;
static FILE *out;

static void enter(unsigned cpu, void *data)
{
    (void)cpu, (void)data;
    inside = 1;
    since = total;
}

static void leave(unsigned cpu, void *data)
{
    (void)cpu, (void)data;
    if (inside) fprintf(out, "%llu\n", (unsigned long long)(total - since));
    inside = 0;
}

static void translated(uint64_t id, struct qemu_plugin_tb *block)
{
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(block); i++) {
        struct qemu_plugin_insn *one = qemu_plugin_tb_get_insn(block, i);
        const uint64_t at = qemu_plugin_insn_vaddr(one);
        if (at == entry) qemu_plugin_register_vcpu_insn_exec_cb(one, enter, NO_REGISTERS, NULL);
        if (from <= at && at < to) qemu_plugin_register_vcpu_insn_exec_cb(one, leave, NO_REGISTERS, NULL);
        qemu_plugin_register_vcpu_insn_exec_inline(one, ADD_U64, &total, 1);
        if (at < FLASH) qemu_plugin_register_vcpu_insn_exec_inline(one, ADD_U64, hits + at / 2, 1);
    }
}

static void finish(uint64_t id, void *data)
{
    (void)id, (void)data;
    for (unsigned i = 0; i < FLASH / 2; i++)
        if (hits[i]) fprintf(out, "%u %llu\n", 2 * i, (unsigned long long)hits[i]);
    fclose(out);
}

int qemu_plugin_install(uint64_t id, const void *info, int count, char **arguments)
{
    (void)info;
    for (int i = 0; i < count; i++) {
        const char *value = strchr(arguments[i], '=') + 1;
        if (strncmp(arguments[i], "entry", 5) == 0) entry = strtoull(value, NULL, 0);
        if (strncmp(arguments[i], "from", 4) == 0) from = strtoull(value, NULL, 0);
        if (strncmp(arguments[i], "to", 2) == 0) to = strtoull(value, NULL, 0);
        if (strncmp(arguments[i], "out", 3) == 0) out = fopen(value, "w");
    }
    if (!out) return 1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
