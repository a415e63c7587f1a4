/* core/host/response.c against closed forms, over every copy that the number of states selects. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "response.h"

enum { COUNT = 40 };

static int failed;

static void expect(double value, double wanted, double scale, const char *what, size_t states)
{
    if (fabs(value - wanted) <= 1e-12 * scale) return;
    printf("%s with %zu states: %.17g, not %.17g\n", what, states, value, wanted);
    failed++;
}

/* exp(rate t) and the response of x' = rate x + u to a unit input from 0 */
static double growth(double rate, double t) { return exp(rate * t); }
static double forced(double rate, double t) { return rate == 0 ? t : expm1(rate * t) / rate; }

/* Parallel lags, whose states do not touch each other. Memory is exactly as large as declared. */
static void lags(size_t n, int scattered)
{
    double *A = calloc(n * n, sizeof *A), *b = malloc(n * sizeof *b), *over = malloc(COUNT * sizeof *over);
    double *phi = malloc(2 * n * n * sizeof *phi), *gamma = malloc(2 * n * sizeof *gamma),
           *x = calloc((COUNT + 1) * n, sizeof *x);
    double *late = malloc(COUNT * n * sizeof *late), *slope = malloc(COUNT * n * sizeof *slope);
    uint32_t *which = malloc(COUNT * sizeof *which);
    int64_t *at = malloc(COUNT * sizeof *at);
    double u[COUNT], t[COUNT + 1] = {0};
    const double h[2] = {0.3, 0.45};
    for (size_t i = 0; i < n; i++) A[i * n + i] = -0.1 * (double)i, b[i] = 1;
    for (size_t i = 0; i < COUNT; i++) {
        which[i] = i % 3 == 0;
        over[i] = scattered ? (i % 2 ? 0.02 : -0.02) : 0;
        t[i + 1] = t[i] + h[which[i]] + over[i];
        u[i] = 1;
        at[i] = (int64_t)i - 3;
    }
    fsw_discretise(n, A, b, 2, h, phi, gamma);
    const fsw_response system = {n, A, b, phi, gamma, which, scattered ? over : NULL};
    for (size_t i = 0; i < n; i++) x[i] = 2;
    fsw_respond(&system, COUNT, u, x);
    fsw_carry(&system, COUNT, at, u, x, late, slope);
    for (size_t k = 0; k <= COUNT; k++)
        for (size_t i = 0; i < n; i++) {
            const double rate = A[i * n + i];
            expect(x[k * n + i], 2 * growth(rate, t[k]) + forced(rate, t[k]), 20, "state", n);
            if (k == COUNT) continue;
            const double gone = at[k] < 0 ? 0 : t[at[k]] + h[which[k]] + over[k];
            const double wanted = at[k] < 0 ? 0 : 2 * growth(rate, gone) + forced(rate, gone);
            expect(late[k * n + i], wanted, 20, "late state", n);
            expect(slope[k * n + i], at[k] < 0 ? 0 : rate * wanted + 1, 20, "slope", n);
        }
    free(A), free(b), free(over), free(phi), free(gamma), free(x), free(late), free(slope), free(which), free(at);
}

/* A motion that dies out must not leave denormal numbers, and a stiff one must arrive. */
static void extremes(void)
{
    const double A[1] = {-1}, b[1] = {1}, h[3] = {0, 100, 1e9};
    double phi[3], gamma[3];
    fsw_discretise(1, A, b, 3, h, phi, gamma);
    expect(phi[0], 1, 1, "e^0", 1), expect(gamma[0], 0, 1, "integral over 0", 1);
    expect(phi[2], 0, 1, "e^-1e9", 1), expect(gamma[2], 1, 1, "final value", 1);
    const uint32_t which[9] = {1, 1, 1, 1, 1, 1, 1, 1, 1};
    const double u[9] = {0};
    double x[10] = {1};
    const fsw_response system = {1, A, b, phi, gamma, which, NULL};
    fsw_respond(&system, 9, u, x);
    expect(x[6] / exp(-600), 1, 10, "e^-600", 1);
    if (x[9] != 0) puts("a denormal number is left"), failed++;
}

int main(void)
{
    for (size_t n = 1; n <= FSW_RESPONSE_MAX_STATES; n++) lags(n, 0), lags(n, 1);
    extremes();
    return failed != 0;
}
