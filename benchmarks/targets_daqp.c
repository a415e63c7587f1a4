/* DAQP on a target: the hot-gas horizon as a mixed-integer quadratic program, one solve per linear term read.
 * problem.h has N, H, and how u^2 = u shifts its diagonal; it is written by targets_counts.py. */
#include <stdint.h>

#include "api.h"
#include "port.h"
#include "utils.h"

#include "problem.h"

static c_float f[N], lower[N], upper[N], x[N];
static int sense[N];
static DAQPProblem problem;
static DAQPWorkspace work;
static DAQPResult result = {.x = x};

/* What a period takes once all that does not change is set up. */
__attribute__((noinline)) static void solve(void)
{
#ifndef WITHOUT
    if (daqp_update_ldp(DAQP_UPDATE_v | DAQP_UPDATE_d, &work, &problem) < 0) result.exitflag = -100;
    daqp_solve(&result, &work);
#endif
}

void *_sbrk(int size);

int main(void)
{
    const char *heap = _sbrk(0);
    uint32_t steps;
    port_read(&steps, sizeof steps);
    for (int i = 0; i < N; i++) {
        upper[i] = 1;
        sense[i] = DAQP_BINARY;
    }
    port_read(f, sizeof f);
    problem = (DAQPProblem){.n = N, .m = N, .ms = N, .H = H, .f = f, .bupper = upper, .blower = lower, .sense = sense};
#ifndef WITHOUT /* to see how large the rest is */
    if (setup_daqp(&problem, &work, NULL) < 0) return 1;
#endif
    const uint32_t taken = (uint32_t)((const char *)_sbrk(0) - heap);
    port_write(&taken, sizeof taken);
    while (steps-- > 0) {
        port_read(f, sizeof f);
        solve();
        const int32_t told[] = {result.exitflag, result.nodes};
        port_write(told, sizeof told);
        port_write(x, sizeof x);
    }
    return 0;
}
