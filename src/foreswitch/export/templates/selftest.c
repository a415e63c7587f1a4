/* foreswitch @version@, SPDX-License-Identifier: BSD-3-Clause */
/* Replays the recorded steps and prints "N passed, M failed"; returns 0 if none failed. `make selftest` runs it here; on a
 * target, link it in place of your main and give it a putchar. Commands, statuses and the bits of costs and state must be
 * those that were simulated: compile the core with -ffp-contract=off where a processor can fuse a product and a sum. */
#ifndef ARDUINO

#include <stdio.h>

#define FSW_STEPS
#include "foreswitch_design.h"

static fsw_state state;
static unsigned passed, failed;

static void text(const char *words)
{
    while (*words) (void)putchar(*words++);
}

static void number(unsigned long value)
{
    if (value > 9) number(value / 10);
    (void)putchar((int)('0' + value % 10));
}

static void check(int good, const char *what, unsigned step)
{
    if (good) {
        passed++;
        return;
    }
    failed++;
    text("step ");
    number(step);
    text(": ");
    text(what);
    text("\n");
}

/* Equal numbers; a NaN equals nothing. */
static int same(const fsw_real *a, const fsw_real *b, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        if (a[i] < b[i] || a[i] > b[i] || !(a[i] <= b[i])) return 0;
    return 1;
}

static void replay(void)
{
    fsw_row row;
    fsw_real u[FSW_MAX_INPUTS];
    for (unsigned k = 0; k < FSW_ROWS; k++) {
        FSW_READ(row, k);
        const fsw_decision decision = fsw_step(&@name@, &state, row.x, row.reference, row.w, u);
        const uint8_t *issued = fsw_issued(&@name@, &state, 1);
        const fsw_real *levels = @name@.levels;
        int as_simulated = 1;
        for (unsigned j = 0; j < FSW_MAX_INPUTS; j++) {
            as_simulated &= issued[j] == row.command[j] && same(&u[j], &levels[row.command[j]], 1);
            levels += @name@.level_count[j];
        }
        check(as_simulated, "another command than simulated", k);
        check(decision.status == (fsw_status)row.status, "another status than simulated", k);
        check(same(&decision.cost, &row.cost, 1), "another cost than simulated, are products and sums fused?", k);
    }
    check(same(state.x, fsw_last_x, FSW_MAX_STATES) && same(state.w, fsw_last_w, FSW_MAX_DISTURBANCES),
          "another state than simulated, are products and sums fused?", FSW_ROWS);
}

/* Whatever is measured, the command is a level. */
static void bad_measurements(void)
{
    static volatile fsw_real zero; /* volatile: computed, not refused by the compiler */
    const fsw_real one = 1, bad[] = {zero / zero, one / zero, -one / zero};
    fsw_row row;
    fsw_real u[FSW_MAX_INPUTS];
    for (unsigned k = 0; k < 3; k++) {
        FSW_READ(row, 1);
        row.x[0] = bad[k];
        check(fsw_step(&@name@, &state, row.x, row.reference, row.w, u).status != FSW_OK, "a bad sample used", k);
        check(same(u, u, FSW_MAX_INPUTS), "no level commanded", k);
    }
}

int main(void)
{
    fsw_real u[FSW_MAX_INPUTS];
    const fsw_design other = @name@; /* this core is made for one design */
    check(fsw_init(&other, &state) != FSW_VALID, "another design taken", 0);
    check(fsw_init(&@name@, &state) == FSW_VALID, "the design refused", 0);
    replay();
    bad_measurements();
    fsw_safe(&@name@, &state, 0, 0, u);
    for (unsigned j = 0; j < FSW_MAX_INPUTS; j++)
        check(fsw_issued(&@name@, &state, 1)[j] == @name@.safe[j], "not the safe level", j);
    number(passed);
    text(" passed, ");
    number(failed);
    text(" failed\n");
    return failed > 0;
}

#else
typedef int fsw_no_selftest; /* a translation unit must declare something */
#endif
