/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
#include "response.h"

/* Decaying modes would reach denormal numbers within a long record and slow it tenfold. */
#define TINY 1e-290

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

enum { SIDE = FSW_RESPONSE_MAX_STATES + 1, TERMS = 12 };

/* product = left right, square matrices */
INLINE void multiply(size_t side, const double *left, const double *right, double *product)
{
    for (size_t i = 0; i < side; i++) {
        double row[SIDE] = {0};
        for (size_t k = 0; k < side; k++) {
            const double factor = left[i * side + k];
            for (size_t j = 0; j < side; j++) row[j] += factor * right[k * side + j];
        }
        for (size_t j = 0; j < side; j++) product[i * side + j] = row[j];
    }
}

/* e^M, M [side][side]. The series of degree 12 at norm 1/2 is cut at 2e-14. */
INLINE void exponential(size_t side, const double *M, double *result)
{
    double norm = 0, scaled[SIDE * SIDE], other[SIDE * SIDE];
    int squarings = 0;
    for (size_t i = 0; i < side; i++) {
        double sum = 0;
        for (size_t j = 0; j < side; j++) sum += M[i * side + j] < 0 ? -M[i * side + j] : M[i * side + j];
        norm = sum > norm ? sum : norm;
    }
    double factor = 1;
    for (; norm * factor > 0.5 && squarings < 1000; squarings++) factor *= 0.5;
    for (size_t i = 0; i < side * side; i++) scaled[i] = M[i] * factor;
    /* Horner: I + M (I + M/2 (I + M/3 ( ... ))) */
    for (size_t i = 0; i < side * side; i++) result[i] = i % (side + 1) == 0;
    for (int k = TERMS; k > 0; k--) {
        multiply(side, scaled, result, other);
        for (size_t i = 0; i < side * side; i++) result[i] = other[i] / k + (i % (side + 1) == 0);
    }
    for (; squarings > 0; squarings--) {
        multiply(side, result, result, other);
        for (size_t i = 0; i < side * side; i++) result[i] = other[i];
    }
}

/* e^(block h), block [n + 1][n + 1] being A beside b over a row of zeros: phi beside gamma over 0 ... 0 1. */
INLINE void transition(size_t n, const double *A, const double *b, double h, double *result)
{
    double block[SIDE * SIDE];
    const size_t side = n + 1;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) block[i * side + j] = A[i * n + j] * h;
        block[i * side + n] = b[i] * h;
        block[n * side + i] = 0;
    }
    block[side * side - 1] = 0;
    exponential(side, block, result);
}

INLINE void store(size_t n, const double *block, double *phi, double *gamma)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) *phi++ = block[i * (n + 1) + j];
        *gamma++ = block[i * (n + 1) + n];
    }
}

INLINE void discretise(size_t n, const double *A, const double *b, size_t count, const double *h, double *phi,
                       double *gamma)
{
    double block[SIDE * SIDE];
    for (size_t e = 0; e < count; e++) {
        transition(n, A, b, h[e], block);
        store(n, block, phi + e * n * n, gamma + e * n);
    }
}

INLINE void discretise_evenly(size_t n, const double *A, const double *b, size_t count, double first, double step,
                              double *phi, double *gamma)
{
    double block[SIDE * SIDE], once[SIDE * SIDE], next[SIDE * SIDE];
    transition(n, A, b, first, block);
    transition(n, A, b, step, once);
    for (size_t e = 0; e < count; e++) {
        store(n, block, phi + e * n * n, gamma + e * n);
        multiply(n + 1, once, block, next);
        for (size_t i = 0; i < (n + 1) * (n + 1); i++) block[i] = next[i];
    }
}

void fsw_discretise(size_t states, const double *A, const double *b, size_t count, const double *h, double *phi,
                    double *gamma)
{
    switch (states) {
    case 1:
        discretise(1, A, b, count, h, phi, gamma);
        break;
    case 2:
        discretise(2, A, b, count, h, phi, gamma);
        break;
    case 3:
        discretise(3, A, b, count, h, phi, gamma);
        break;
    case 4:
        discretise(4, A, b, count, h, phi, gamma);
        break;
    default:
        discretise(states, A, b, count, h, phi, gamma);
    }
}

void fsw_discretise_evenly(size_t states, const double *A, const double *b, size_t count, double first, double step,
                           double *phi, double *gamma)
{
    switch (states) {
    case 1:
        discretise_evenly(1, A, b, count, first, step, phi, gamma);
        break;
    case 2:
        discretise_evenly(2, A, b, count, first, step, phi, gamma);
        break;
    case 3:
        discretise_evenly(3, A, b, count, first, step, phi, gamma);
        break;
    case 4:
        discretise_evenly(4, A, b, count, first, step, phi, gamma);
        break;
    default:
        discretise_evenly(states, A, b, count, first, step, phi, gamma);
    }
}

/* sum[i] = M v + entry u */
INLINE void apply(size_t n, const double *M, const double *entry, const double *v, double u, double *sum)
{
    for (size_t k = 0; k < n; k++, M += n) {
        double total = entry[k] * u;
        for (size_t l = 0; l < n; l++) total += M[l] * v[l];
        sum[k] = total;
    }
}

/* One interval; `next` may not be `x`. Six terms at a norm of 0.05 leave 1e-13. */
INLINE void advance(const fsw_response *s, size_t n, size_t i, const double *x, double u, double *next)
{
    const size_t table = s->which[i];
    apply(n, s->phi + table * n * n, s->gamma + table * n, x, u, next);
    if (!s->over || s->over[i] == 0) return;
    double slope[FSW_RESPONSE_MAX_STATES], term[FSW_RESPONSE_MAX_STATES];
    static const double none[FSW_RESPONSE_MAX_STATES];
    apply(n, s->A, s->b, next, u, slope);
    for (size_t k = 0; k < n; k++) next[k] += slope[k] *= s->over[i];
    for (int degree = 2; degree <= 6; degree++) {
        apply(n, s->A, none, slope, 0, term);
        for (size_t k = 0; k < n; k++) next[k] += slope[k] = term[k] * s->over[i] / degree;
    }
}

INLINE void respond(const fsw_response *s, size_t n, size_t count, const double *u, double *x)
{
    for (size_t i = 0; i < count; i++, x += n) {
        double next[FSW_RESPONSE_MAX_STATES];
        advance(s, n, i, x, u[i], next);
        for (size_t k = 0; k < n; k++) x[n + k] = next[k] < TINY && next[k] > -TINY ? 0 : next[k];
    }
}

INLINE void carry(const fsw_response *s, size_t n, size_t count, const int64_t *at, const double *u, const double *x,
                  double *late, double *slope)
{
    for (size_t i = 0; i < count; i++, late += n, slope += n) {
        if (at[i] < 0) {
            for (size_t k = 0; k < n; k++) late[k] = slope[k] = 0;
            continue;
        }
        double next[FSW_RESPONSE_MAX_STATES];
        advance(s, n, i, x + (size_t)at[i] * n, u[at[i]], next);
        apply(n, s->A, s->b, next, u[at[i]], slope);
        for (size_t k = 0; k < n; k++) late[k] = next[k];
    }
}

/* The usual orders get copies of their own, whose loops the compiler unrolls. */
void fsw_respond(const fsw_response *s, size_t count, const double *u, double *x)
{
    switch (s->states) {
    case 1:
        respond(s, 1, count, u, x);
        break;
    case 2:
        respond(s, 2, count, u, x);
        break;
    case 3:
        respond(s, 3, count, u, x);
        break;
    case 4:
        respond(s, 4, count, u, x);
        break;
    default:
        respond(s, s->states, count, u, x);
    }
}

void fsw_carry(const fsw_response *s, size_t count, const int64_t *at, const double *u, const double *x, double *late,
               double *slope)
{
    switch (s->states) {
    case 1:
        carry(s, 1, count, at, u, x, late, slope);
        break;
    case 2:
        carry(s, 2, count, at, u, x, late, slope);
        break;
    case 3:
        carry(s, 3, count, at, u, x, late, slope);
        break;
    case 4:
        carry(s, 4, count, at, u, x, late, slope);
        break;
    default:
        carry(s, s->states, count, at, u, x, late, slope);
    }
}
