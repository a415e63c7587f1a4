/* The paper's closed loop alone, for an instruction counter to watch. design.h is written by counts.py. */
#include "loop.h"

#include "design.h"

enum { STEPS = 1000, HISTORY = 6 };

int main(void)
{
    static fsw_predictive law = {.law = {fsw_predictive_step}, .levels = exact_levels};
    static fsw_real buffer[STATES + OUTPUTS * ORDER + INPUTS];
    static double reference[STEPS * OUTPUTS * ORDER], x[(STEPS + 1) * STATES], y[(STEPS + 1) * OUTPUTS];
    static double u[HISTORY + STEPS], cost[STEPS];
    static uint32_t nodes[STEPS];
    static uint8_t status[STEPS];
    law.design = design;
    law.buffer = buffer;
    for (int k = 0; k < STEPS; k++) { /* 4 kPa in each period: the valve is on for a quarter of the time */
        reference[k * ORDER] = 4.0 * k;
        reference[k * ORDER + 1] = 4000.0;
    }
    const fsw_record record = {.reference_width = OUTPUTS * ORDER,
                               .reference = reference,
                               .x = x,
                               .y = y,
                               .seen = x,
                               .seen_width = STATES,
                               .u = u + HISTORY,
                               .cost = cost,
                               .nodes = nodes,
                               .status = status};
    if (fsw_init(&law.design, &law.state) != FSW_VALID) return 1;
    fsw_run(&law.law, &plant, &record, 0, STEPS);
    return y[STEPS] < 3000.0; /* it follows */
}
