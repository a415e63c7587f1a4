/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* The response of a linear system x' = A x + b u at the samples of a record whose input changes only there.
 *
 * Distinct sampling intervals have tables of their own, phi = e^(A h) and gamma = int_0^h e^(A v) dv b. Where intervals
 * scatter they share tables and a short Taylor series carries each the rest of its way, `over` seconds.
 * Host only: identification evaluates it a few hundred times per fit, so it sets how long a fit takes.
 */
#ifndef FORESWITCH_RESPONSE_H
#define FORESWITCH_RESPONSE_H

#include <stddef.h>
#include <stdint.h>

enum { FSW_RESPONSE_MAX_STATES = 15 };

/* phi [count][states][states] = e^(A h), gamma [count][states] = int_0^h e^(A v) dv b for each h [count] in seconds.
 * Scaling and squaring of a Taylor series: relative error about 1e-14 times the number of squarings. States as below;
 * cannot fail. Cost: count * (12 + squarings) * (states + 1)^3. */
void fsw_discretise(size_t states, const double *A, const double *b, size_t count, const double *h, double *phi,
                    double *gamma);

/* The same for the evenly spaced first + i step, i < count, at one product of matrices each; relative error about
 * 1e-16 times count more. */
void fsw_discretise_evenly(size_t states, const double *A, const double *b, size_t count, double first, double step,
                           double *phi, double *gamma);

/* A system with its tables, and what is asked of it. states <= FSW_RESPONSE_MAX_STATES. */
typedef struct {
    size_t states;
    const double *A;       /* [states][states] */
    const double *b;       /* [states] */
    const double *phi;     /* [tables][states][states] */
    const double *gamma;   /* [tables][states] */
    const uint32_t *which; /* [count] table of each interval */
    const double *over; /* [count] seconds beyond the table's interval; small against the fastest motion; may be null */
} fsw_response;

/* x [count + 1][states], whose first row is the start: the others are filled, u [count] held over each interval.
 * Cannot fail. Cost: count * states^2, seven times that with `over`. */
void fsw_respond(const fsw_response *system, size_t count, const double *u, double *x);

/* late and slope [count][states]: the state an interval after sample at[i] of x, u (zero where at[i] < 0), and its time
 * derivative. Cannot fail. Cost as above, twice without `over`. */
void fsw_carry(const fsw_response *system, size_t count, const int64_t *at, const double *u, const double *x,
               double *late, double *slope);

#endif
