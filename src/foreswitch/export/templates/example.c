/* foreswitch @version@, SPDX-License-Identifier: BSD-3-Clause */
/* fsw_step on recorded measurements, a few hundred times: a main for whoever counts instructions, cycles or bytes, on any
 * target. In firmware, the row comes from a sensor and the reference, and u goes to the actuators. */
#ifndef ARDUINO /* which compiles every file of a library; its own example is in examples/ */

#define FSW_STEPS
#include "foreswitch_design.h"

enum { CALLS = 512 };

static fsw_state state;
volatile fsw_real output[FSW_MAX_INPUTS]; /* stands for the actuators */

int main(void)
{
    fsw_row row;
    fsw_real u[FSW_MAX_INPUTS];
    if (fsw_init(&@name@, &state) != FSW_VALID) return 1;
    for (uint16_t i = 0; i < CALLS; i++) {
        FSW_READ(row, i % FSW_ROWS);
        (void)fsw_step(&@name@, &state, row.x, row.reference, row.w, u);
        for (uint8_t j = 0; j < FSW_MAX_INPUTS; j++) output[j] = u[j];
    }
    return 0;
}

#else
typedef int fsw_no_example; /* a translation unit must declare something */
#endif
