/* The paper's closed loop as one would write it for this one plant: constants folded, no sizes, no options. They are
 * the design's own (-D), and the sums run in the core's order, so that the records must agree to the last bit. */
#include <math.h>
#include <stdint.h>

/* GUESS: the command by a branch. Without noise a processor predicts it and computes several periods at once, instead
 * of waiting for each command before the next: the least that any loop can take. */
#ifdef GUESS
#define LEVEL(fire) ((fire) ? 1.0 : 0.0)
#else
#define LEVEL(fire) (fire)
#endif

/* Row 0 of x is given, and before row 0 of u stand the five commands under way. */
void hot_gas(long steps, const double *reference, double *x, double *y, double *u, double *cost, uint8_t *status)
{
    double p = x[0], rate = x[1];
    for (long k = 0; k < steps; k++) {
        const double *r = reference + 2 * k;
        const double off = p + F * rate - r[0] - R * r[1] + W1 * u[k - 1] + W2 * u[k - 2] + W3 * u[k - 3] +
                           W4 * u[k - 4] + W5 * u[k - 5];
        const double on = off + H, cost_off = 0.5 * off * off, cost_on = 0.5 * on * on;
        const int fire = cost_on < cost_off;
        u[k] = LEVEL(fire);
        cost[k] = fire ? cost_on : cost_off;
        status[k] = isfinite(p) && isfinite(rate) ? 0 : 2;
        p = p + A * rate + B1 * u[k - 5];
        rate = C * rate + B2 * u[k - 5];
        x[2 * k + 2] = p;
        x[2 * k + 3] = rate;
        y[k + 1] = p;
    }
}
