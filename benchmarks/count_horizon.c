/* A long horizon's recorded steps, for an instruction counter to watch. design.h and steps.h are written by counts.py. */
#include "foreswitch.h"

#include "design.h"
#include "steps.h"

int main(void)
{
    static fsw_state s;
    fsw_real u[FSW_MAX_INPUTS];
    if (fsw_init(&design, &s) != FSW_VALID) return 1;
    for (int k = 0; k < STEPS; k++) {
        const fsw_decision decision = fsw_step(&design, &s, x + k * design.measured, reference + k * WIDTH, 0, u);
        if (decision.status != FSW_OK || decision.gap > 0) return 1;
    }
    return 0;
}
