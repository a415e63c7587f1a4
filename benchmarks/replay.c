/* Decisions of the core on recorded measurements, one by one and timed; designs.h is written by problems.py. */
#define _POSIX_C_SOURCE 199309L
#include <time.h>

#include "designs.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Warm: each step begins with the plan of the one before. Cold: each is the first after a start. A decision and its
 * step do the same, but for what the step remembers. seconds [steps] keeps the shorter of its own and the new time,
 * over `loops` decisions. Returns the steps whose answer is not proven. */
long replay(int which, long steps, int cold, long loops, const double *x, const double *reference, const double *w,
            double *seconds, uint32_t *nodes, double *cost, uint8_t *plan)
{
    static fsw_state s;
    const fsw_design *d = designs[which];
    double u[FSW_MAX_INPUTS];
    long unproven = 0;
    if (fsw_init(d, &s) != FSW_VALID) return -1;
    for (long k = 0; k < steps; k++) {
        if (cold) fsw_init(d, &s);
        const double start = now();
        for (long i = 0; i < loops; i++) fsw_decide(d, &s, x, reference, w, 0);
        const double taken = (now() - start) / (double)loops;
        const fsw_decision decision = fsw_step(d, &s, x, reference, w, u);
        if (taken < seconds[k]) seconds[k] = taken;
        nodes[k] = decision.nodes;
        cost[k] = decision.cost;
        unproven += decision.status != FSW_OK || decision.gap > 0;
        for (int i = 0; i < d->horizon->moves; i++) *plan++ = s.plan[i];
        x += d->measured;
        reference += fsw_reference_size(d);
        w += d->disturbances;
    }
    return unproven;
}
