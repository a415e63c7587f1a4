/* The same decision by trying all sequences, depth first, state and cost carried along: what one would write first.
 * Tail, terminal cost, dwell, switch cost, window and disturbances are left out. Sizes are read from the design, or
 * macros where they are known. */
#define _POSIX_C_SOURCE 199309L
#include <time.h>

#include "designs.h"

#ifdef SIZES_KNOWN
enum { n = 2, m = 1, q = 1 };
#define SIZES
#else
#define SIZES const int n = h->states, m = h->inputs, q = h->outputs;
#endif

enum { LONGEST = 8 };
static uint8_t best[LONGEST];

/* line [pending + 1]: the candidates issued, newest first. */
static double enumerate(const fsw_design *d, const double *measured, const uint8_t *line, const double *reference)
{
    const fsw_horizon *h = d->horizon;
    SIZES
    const int moves = h->moves, candidates = h->candidates, pending = d->pending[0];
    double x[LONGEST + 1][FSW_HORIZON_STATES], cost[LONGEST + 1], free[FSW_HORIZON_STATES], least = 1e300;
    int c[LONGEST], k = 0;
    for (int i = 0; i < n; i++) {
        free[i] = 0;
        for (int l = 0; l < n; l++) free[i] += h->start_row[i * n + l] * measured[l];
    }
    for (int a = 0; a < pending; a++)
        for (int i = 0; i < n; i++) free[i] += h->pending_table[(a * candidates + line[a]) * n + i];
    cost[0] = 0;
    c[0] = 0;
    for (;;) {
        if (c[k] == candidates) {
            if (--k < 0) return least;
            c[k]++;
            continue;
        }
        const int now = c[k], before = k > 0 ? c[k - 1] : line[0];
        double J = cost[k], *next = x[k + 1];
        for (int i = 0; i < n; i++) {
            next[i] = h->effect[now * n + i];
            if (k == 0)
                next[i] += free[i];
            else
                for (int l = 0; l < n; l++) next[i] += h->F[i * n + l] * x[k][l];
        }
        for (int o = 0; o < q; o++) {
            double e = -reference[k * q + o];
            for (int i = 0; i < n; i++) e += h->S[o * n + i] * next[i];
            J += e * e;
        }
        for (int j = 0; j < m; j++) {
            const double change = h->value[now * m + j] - h->value[before * m + j];
            J += h->move_weight[j] * change * change;
        }
        if (k + 1 < moves) {
            cost[++k] = J;
            c[k] = 0;
            continue;
        }
        if (J < least) {
            least = J;
            for (int i = 0; i < moves; i++) best[i] = (uint8_t)c[i];
        }
        c[k]++;
    }
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* As replay.c does it. line [steps][pending + 1]. */
void enumerate_all(int which, long steps, long loops, const double *x, const double *reference, const uint8_t *line,
                   double *seconds, double *cost)
{
    const fsw_design *d = designs[which];
    for (long k = 0; k < steps; k++) {
        const double start = now();
        for (long i = 0; i < loops; i++) {
            cost[k] = enumerate(d, x, line, reference);
            __asm__ volatile("" ::: "memory");
        }
        const double taken = (now() - start) / (double)loops;
        if (taken < seconds[k]) seconds[k] = taken;
        x += d->measured;
        reference += fsw_reference_size(d);
        line += d->pending[0];
    }
}
