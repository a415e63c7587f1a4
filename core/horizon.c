/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* In the order data meets it: affine parts, prices, dominance, children, search. */
#include "foreswitch.h"

#if FSW_MAX_MOVES > 0

#if FSW_HORIZON_CANDIDATES > 255 || FSW_RECORDS > 127
#error "at most 255 FSW_HORIZON_CANDIDATES and 127 FSW_RECORDS: they are counted in bytes"
#endif

/* Sizes: constants where the limits are the design's own (FSW_FIXED, an exported design); otherwise read from it, with
 * copies of the hot functions for the commonest sizes, twice as fast. */
#ifdef FSW_FIXED
#define STATES(h) FSW_HORIZON_STATES
#define INPUTS(h) FSW_MAX_INPUTS
#define OUTPUTS(h) FSW_MAX_OUTPUTS
#define CANDIDATES(h) FSW_HORIZON_CANDIDATES
#define MOVES(h) FSW_MAX_MOVES
#define STEPS(h) FSW_MAX_STEPS
#define COPIES 0
#if defined(__GNUC__) && !defined(__clang__) && FSW_MAX_INPUTS == 1 && FSW_HORIZON_STATES <= 3
#pragma GCC optimize("peel-loops") /* they are short, and of known length */
#endif
#else
#define STATES(h) (h)->states
#define INPUTS(h) (h)->inputs
#define OUTPUTS(h) (h)->outputs
#define CANDIDATES(h) (h)->candidates
#define MOVES(h) (h)->moves
#define STEPS(h) (h)->steps
#if defined(__OPTIMIZE_SIZE__)
#define COPIES 0
#else
#define COPIES 1
#endif
#endif

#include "arithmetic.h"

/* ---- Tuning: what is the same for every design; patience, far and dominance come with its tables ---- */

#define HUGE_COST ((fsw_real)FSW_HUGE) /* of no incumbent: any cost is below it, or as good as infinite */
#define FLOOR ((fsw_real)1e-25)        /* keeps a decaying state out of the denormal numbers, which are slow */
#define REPLAYED 3 /* moves from which on an earlier plan is tried: of fewer, the first descent is as good */
#define MARGIN(low, high) ((high) - (low)) /* that the minimiser must leave the hull by: nearer, prices help little */
#define PASSES 12                    /* of the active-set method, which may cycle: whatever it ends with is valid */
#define ZERO_PIVOT ((fsw_real)1e-12) /* share of the largest pivot: below, an input has no effect of its own */

/* y = F' p */
INLINE void transposed(const fsw_real *F, const fsw_real *p, fsw_real *y, natural n)
{
    for (natural i = 0; i < n; i++) y[i] = 0;
    for (natural j = 0; j < n; j++)
        for (natural i = 0; i < n; i++) y[i] += F[j * n + i] * p[j];
}

/* ---- Affine parts ---- */

/* Along a zero pivot J is linear, and only bounded below if its slope there is zero: let the price take all of it.
 * The rows of L are those of L^-T over their squared length. */
INLINE void balance(const fsw_real *pull, const fsw_real *t, const fsw_real *g, fsw_real *slope, natural m)
{
    for (natural j = 0; j < m; j++) slope[j] += g[j];
    for (natural a = 0; a < m; a++) {
        const fsw_real square = product(0, pull + a * m, pull + a * m, m);
        for (natural j = 0; square > 0 && j < m; j++) slope[j] += pull[a * m + j] * t[a] / square;
    }
}

/* t[k], from the last move to the first; slope [moves][inputs], if given, is half the price paid per unit of u. */
INLINE void pull_back(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural q,
                      fsw_real (*slope)[FSW_MAX_INPUTS])
{
    fsw_real p[FSW_SPAN], y[FSW_HORIZON_STATES], g[FSW_MAX_INPUTS];
    for (natural i = 0; i < n + m; i++) p[i] = s->last[i];
    for (natural k = MOVES(h); k-- > 0;) {
        const fsw_real *gain = h->gain + k * m * n, *gain_previous = h->gain_previous + k * m * m;
        fsw_real *t = s->target[k];
        for (natural o = 0; o < q; o++) {
            const fsw_real e = s->error[k][o] * h->root_weight[k * q + o];
            for (natural i = 0; i < n; i++) p[i] += h->S[o * n + i] * e;
        }
        for (natural j = 0; j < m; j++) {
            g[j] = p[n + j] + h->lift_centre[k * m + j] - (slope ? slope[k][j] : 0);
            for (natural i = 0; i < n; i++) g[j] += h->G[i * m + j] * p[i];
        }
        for (natural a = 0; a < m; a++) t[a] = -product(0, h->pull + (k * m + a) * m, g, m);
        if (slope) balance(h->pull + k * m * m, t, g, slope[k], m);
        transposed(h->F, p, y, n);
        for (natural i = 0; i < n; i++) {
            p[i] = y[i];
            for (natural a = 0; a < m; a++) p[i] -= gain[a * n + i] * t[a];
        }
        for (natural j = 0; j < m; j++) {
            p[n + j] = 0;
            for (natural a = 0; a < m; a++) p[n + j] -= gain_previous[a * m + j] * t[a];
        }
    }
}

INLINE void prepare(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural q, const fsw_real *z,
                    const fsw_real *reference, const fsw_real *w, const fsw_real *rest)
{
    const natural N = STEPS(h), d = h->disturbances;
    fsw_real *x = s->end, *p = s->last, y[FSW_HORIZON_STATES], drift[FSW_HORIZON_STATES], known[FSW_MAX_OUTPUTS];
    y[0] = 0; /* gcc cannot see that it is always set */
    for (natural i = 0; i < n; i++) {
        x[i] = z[i];
        drift[i] = product(h->drift[i] + FLOOR, h->drift_disturbance + i * d, w, d);
    }
    for (natural o = 0; o < q; o++) known[o] = product(h->row_offset[o], h->row_disturbance + o * d, w, d);
    for (natural k = 0; k < N; k++) { /* free response */
        for (natural i = 0; k > 0 && i < n; i++) {
            y[i] = product(drift[i], h->F + i * n, x, n);
            if (h->tail == FSW_TAIL_REST && k >= MOVES(h)) y[i] = product(y[i], h->G + i * m, rest, m);
        }
        for (natural i = 0; k > 0 && i < n; i++) x[i] = y[i];
        for (natural o = 0; o < q; o++) {
            const fsw_real weight = h->root_weight[k * q + o];
            s->error[k][o] = 0;
            if (!(weight > 0)) continue;
            const fsw_real *target = reference + ((k - h->lead) * q + o) * h->order;
            fsw_real e = product(known[o], h->S + o * n, x, n);
            for (natural i = 0; i < h->order; i++) e -= h->reference_row[o * h->order + i] * target[i];
            s->error[k][o] = weight * e;
        }
    }
    const fsw_real *final = reference + (N - h->lead - 1u) * q * h->order;
    for (natural t = 0; t < h->terminal; t++) {
        s->aim[t] = product(h->terminal_offset[t], h->terminal_disturbance + t * d, w, d);
        for (natural o = 0; o < q; o++) s->aim[t] += h->terminal_reference[t * q + o] * final[o * h->order];
    }
    s->priced = 0;
    if (MOVES(h) == 1) return; /* its candidates are simply tried */
    for (natural i = 0; i < n + m; i++) p[i] = 0;
    for (natural t = 0; t < h->terminal; t++) {
        const fsw_real e = product(-s->aim[t], h->T + t * n, x, n);
        for (natural i = 0; i < n; i++) p[i] += h->T[t * n + i] * e;
    }
    for (natural k = N; k-- > MOVES(h);) { /* tail */
        for (natural o = 0; o < q; o++) {
            const fsw_real e = s->error[k][o] * h->root_weight[k * q + o];
            for (natural i = 0; i < n; i++) p[i] += h->S[o * n + i] * e;
        }
        for (natural j = 0; h->tail == FSW_TAIL_HOLD && j < m; j++)
            for (natural i = 0; i < n; i++) p[n + j] += h->G[i * m + j] * p[i];
        transposed(h->F, p, y, n);
        for (natural i = 0; i < n; i++) p[i] = y[i];
    }
    pull_back(h, s, n, m, q, 0);
}

void fsw_horizon_prepare(const fsw_horizon *h, fsw_horizon_scratch *s, const fsw_real *z, const fsw_real *reference,
                         const fsw_real *w, const fsw_real *rest)
{
#if COPIES
    if (h->states == 2 && h->inputs == 1 && h->outputs == 1) {
        prepare(h, s, 2, 1, 1, z, reference, w, rest);
        return;
    }
#endif
    prepare(h, s, STATES(h), INPUTS(h), OUTPUTS(h), z, reference, w, rest);
}

/* ---- Prices: multipliers of the real-valued minimisation over the levels' hull ---- */

/* Whether the unbounded minimiser leaves the hull by more than MARGIN. O(moves (states + inputs)^2). */
static int leaves_hull(const fsw_horizon *h, const fsw_horizon_scratch *s, natural present)
{
    const natural n = STATES(h), m = INPUTS(h);
    fsw_real x[FSW_HORIZON_STATES], y[FSW_HORIZON_STATES], w[FSW_MAX_INPUTS], u[FSW_MAX_INPUTS];
    for (natural i = 0; i < n; i++) x[i] = 0;
    for (natural j = 0; j < m; j++) u[j] = h->value[present * m + j];
    for (natural k = 0; k < MOVES(h); k++) {
        for (natural a = 0; a < m; a++)
            w[a] = product(product(s->target[k][a], h->gain + (k * m + a) * n, x, n),
                           h->gain_previous + (k * m + a) * m, u, m);
        for (natural j = 0; j < m; j++) {
            u[j] = 0;
            for (natural a = 0; a < m; a++) u[j] += h->pull[(k * m + a) * m + j] * w[a];
            const fsw_real margin = MARGIN(h->hull[2 * j], h->hull[2 * j + 1]);
            if (u[j] < h->hull[2 * j] - margin || u[j] > h->hull[2 * j + 1] + margin) return 1;
        }
        for (natural i = 0; i < n; i++) y[i] = product(product(0, h->F + i * n, x, n), h->G + i * m, u, m);
        for (natural i = 0; i < n; i++) x[i] = y[i];
    }
    return 0;
}

/* One pass goes back over the periods with two quadratic forms: y'W y + 2 p'y + const, the best cost from here on in
 * y = (x, previous), and y'A y + 2 b'y + const, the same in (x, previous, u) before u is chosen, lower triangle. */

/* W, p: add |S x + e|^2 at the end of period k. O(outputs states^2). */
INLINE void add_error(const fsw_horizon *h, const fsw_horizon_scratch *s, natural n, natural v, natural q, natural k,
                      fsw_real *W, fsw_real *p)
{
    for (natural o = 0; o < q; o++) {
        const fsw_real root = h->root_weight[k * q + o], *S = h->S + o * n;
        for (natural i = 0; i < n; i++) {
            for (natural j = 0; j < n; j++) W[i * v + j] += root * S[i] * root * S[j];
            p[i] += root * S[i] * s->error[k][o];
        }
    }
}

/* A, b from W, p: back over period k, x' = F x + G u, and the moves' own cost added; A = [F 0 G; 0 0 1]' X with
 * X = W [F 0 G; 0 0 1], whose column `previous` is 0 and left out. Returns the larger of `scale` and the pivots.
 * O((states + inputs)^2 states). */
INLINE fsw_real go_back(const fsw_horizon *h, natural n, natural m, natural k, const fsw_real *W, const fsw_real *p,
                        fsw_real *A, fsw_real *b, fsw_real scale)
{
    const natural v = n + m, all = v + m;
    fsw_real X[FSW_SPAN * FSW_SPAN];
    for (natural i = 0; i < v; i++) {
        for (natural j = 0; j < n; j++) {
            X[i * v + j] = 0;
            for (natural l = 0; l < n; l++) X[i * v + j] += W[i * v + l] * h->F[l * n + j];
        }
        for (natural j = 0; j < m; j++) {
            X[i * v + n + j] = W[i * v + n + j];
            for (natural l = 0; l < n; l++) X[i * v + n + j] += W[i * v + l] * h->G[l * m + j];
        }
    }
    for (natural i = 0; i < all; i++)
        for (natural j = 0; j <= i; j++) A[i * all + j] = 0;
    transposed(h->F, p, b, n);
    for (natural i = 0; i < n; i++)
        for (natural j = 0; j <= i; j++)
            for (natural l = 0; l < n; l++) A[i * all + j] += h->F[l * n + i] * X[l * v + j];
    for (natural i = 0; i < m; i++) {
        const natural r = v + i;
        b[n + i] = 0;
        b[r] = p[n + i] + h->lift_centre[k * m + i];
        for (natural l = 0; l < n; l++) b[r] += h->G[l * m + i] * p[l];
        for (natural j = 0; j < n; j++) {
            A[r * all + j] = X[(n + i) * v + j];
            for (natural l = 0; l < n; l++) A[r * all + j] += h->G[l * m + i] * X[l * v + j];
        }
        for (natural j = 0; j <= i; j++) {
            A[r * all + v + j] = X[(n + i) * v + n + j];
            for (natural l = 0; l < n; l++) A[r * all + v + j] += h->G[l * m + i] * X[l * v + n + j];
        }
        A[r * all + r] += h->move_weight[i] - h->lift[k * m + i];
        A[(n + i) * all + n + i] = h->move_weight[i];
        A[r * all + n + i] = -h->move_weight[i];
        if (A[r * all + r] > scale) scale = A[r * all + r];
    }
    return scale;
}

/* W, p from A, b: put in each input of period k, the last first: its end of the hull where it is pinned, else its
 * minimiser. Keeps each input's row for the way forward. O(inputs (states + inputs)^2). */
INLINE void eliminate(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural k, fsw_real scale,
                      fsw_real *A, fsw_real *b, fsw_real *W, fsw_real *p)
{
    const natural v = n + m, all = v + m;
    for (natural j = m; j-- > 0;) {
        const natural r = v + j;
        const fsw_real *row = A + r * all;
        for (natural i = 0; i <= r; i++) s->u.hull.row[k][j][i] = row[i];
        s->u.hull.slope[k][j] = b[r];
        if (s->u.hull.pinned[k][j]) {
            const fsw_real u = h->hull[2 * j + (s->u.hull.pinned[k][j] > 0)];
            for (natural i = 0; i < r; i++) b[i] += row[i] * u;
        } else if (row[r] > ZERO_PIVOT * scale) {
            for (natural i = 0; i < r; i++) {
                const fsw_real g = row[i] / row[r];
                b[i] -= g * b[r];
                for (natural l = 0; l <= i; l++) A[i * all + l] -= g * row[l];
            }
        }
    }
    for (natural i = 0; i < v; i++) {
        p[i] = b[i];
        for (natural j = 0; j <= i; j++) W[i * v + j] = W[j * v + i] = A[i * all + j];
    }
}

/* Input j of period k, into y[r], from y [r] = (x, previous, the inputs before it): a pinned one is freed where J falls
 * inwards, a free one is pinned where its minimiser lies outside the hull. Leaves half the slope of J where it stays
 * pinned, else 0. Returns whether it changed sides. */
INLINE int choose_side(const fsw_horizon *h, fsw_horizon_scratch *s, natural k, natural j, natural r, fsw_real scale,
                       fsw_real *y)
{
    const fsw_real *row = s->u.hull.row[k][j], a = h->hull[2 * j], c = h->hull[2 * j + 1];
    const int8_t was = s->u.hull.pinned[k][j];
    const fsw_real slope = product(s->u.hull.slope[k][j], row, y, r);
    int8_t now = was;
    if (was) {
        y[r] = was < 0 ? a : c;
        s->u.hull.slope[k][j] = slope + row[r] * y[r];
        if ((was < 0) != (s->u.hull.slope[k][j] > 0)) {
            now = 0;
            s->u.hull.slope[k][j] = 0;
        }
    } else {
        y[r] = row[r] > ZERO_PIVOT * scale ? -slope / row[r] : (a + c) / 2;
        s->u.hull.slope[k][j] = 0;
        if (y[r] < a) now = -1;
        if (y[r] > c) now = 1;
        if (now) y[r] = now < 0 ? a : c; /* go on from there: the next inputs see what really will happen */
    }
    s->u.hull.pinned[k][j] = now;
    return now != was;
}

/* Along the minimiser from x[0] = 0, each input's side; the number of those that changed. O(moves (states +
 * inputs)^2). */
INLINE natural go_forward(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural present,
                          fsw_real scale)
{
    const natural v = n + m;
    fsw_real y[FSW_SPAN + FSW_MAX_INPUTS], next[FSW_HORIZON_STATES]; /* y: x, previous, u */
    natural changes = 0;
    for (natural i = 0; i < n; i++) y[i] = 0;
    for (natural j = 0; j < m; j++) y[n + j] = h->value[present * m + j];
    for (natural k = 0; k < MOVES(h); k++) {
        for (natural j = 0; j < m; j++) changes += (natural)choose_side(h, s, k, j, v + j, scale, y);
        for (natural i = 0; i < n; i++) next[i] = product(product(0, h->F + i * n, y, n), h->G + i * m, y + v, m);
        for (natural i = 0; i < n; i++) y[i] = next[i];
        for (natural j = 0; j < m; j++) y[n + j] = y[v + j];
    }
    return changes;
}

/* One pass of the primal-dual active-set method: minimise with the pinned inputs at their end of the hull, then pin
 * what leaves the hull and free what is pulled inwards. Before: scratch.u.hull.pinned [moves][inputs] in -1, 0, 1.
 * After: the same anew, and half the slope of J at the pinned inputs. Returns the number of inputs that changed sides.
 * O(moves (states + inputs)^3). */
static natural pin(const fsw_horizon *h, fsw_horizon_scratch *s, natural present)
{
    const natural n = STATES(h), m = INPUTS(h), v = n + m;
    fsw_real W[FSW_SPAN * FSW_SPAN], p[FSW_SPAN], scale = 0; /* scale: the largest pivot so far */
    fsw_real A[(FSW_SPAN + FSW_MAX_INPUTS) * (FSW_SPAN + FSW_MAX_INPUTS)], b[FSW_SPAN + FSW_MAX_INPUTS];
    for (natural i = 0; i < v * v; i++) W[i] = h->last_value[i]; /* after the last move nothing is left to choose */
    for (natural i = 0; i < v; i++) p[i] = s->last[i];
    for (natural k = MOVES(h); k-- > 0;) {
        add_error(h, s, n, v, OUTPUTS(h), k, W, p);
        scale = go_back(h, n, m, k, W, p, A, b, scale);
        eliminate(h, s, n, m, k, scale, A, b, W, p);
    }
    return go_forward(h, s, n, m, present, scale);
}

/* Find the prices and the affine parts that go with them. Any slopes give a valid bound, converged ones the best. */
static void set_prices(const fsw_horizon *h, fsw_horizon_scratch *s, natural present)
{
    const natural m = INPUTS(h);
    natural passes = PASSES;
    for (natural k = 0; k < MOVES(h); k++)
        for (natural j = 0; j < m; j++) s->u.hull.pinned[k][j] = 0;
    while (pin(h, s, present) > 0 && --passes > 0) {
    }
    pull_back(h, s, STATES(h), m, OUTPUTS(h), s->u.hull.slope);
    s->priced = 1;
    for (natural k = 0; k < MOVES(h); k++)
        for (natural c = 0; c < h->candidates; c++) {
            s->penalty[k][c] = 0;
            for (natural j = 0; j < m; j++) {
                const fsw_real slope = s->u.hull.slope[k][j];
                s->penalty[k][c] += 2 * slope * (h->value[c * m + j] - h->hull[2 * j + (slope < 0)]);
            }
        }
}

static void withdraw_prices(const fsw_horizon *h, fsw_horizon_scratch *s)
{
    pull_back(h, s, STATES(h), INPUTS(h), OUTPUTS(h), 0);
    s->priced = 0;
}

/* ---- Dominance ---- */

#if FSW_RECORDS > 0
/* Whether a node visited before at this depth makes the node x[k], reached by `from`, superfluous; else remember it. */
INLINE int dominated(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural k,
                     natural from, int timed, fsw_real bound, fsw_real cutoff)
{
    const natural span = n + m, visits = s->u.tree.visits[k], kept = visits < FSW_RECORDS ? visits : FSW_RECORDS;
    const fsw_real room = cutoff - bound;
    fsw_real at[FSW_SPAN];
    for (natural a = 0; a < span; a++)
        at[a] = product(h->from_metric[(k * C + from) * span + a], h->metric + (k * span + a) * n, s->u.tree.x[k], n);
    for (natural i = 0; i < kept; i++) {
        const fsw_real first = at[0] - s->u.tree.record[k][i].at[0];
        const fsw_real better = bound - s->u.tree.record[k][i].bound;
        fsw_real slack = better - first * first; /* g_A - g_B - D^2, must not be negative */
        if (slack < 0) continue;                 /* the metric's rows are sorted: nearly all stop here */
        for (natural a = 1; a < span; a++) {
            const fsw_real e = at[a] - s->u.tree.record[k][i].at[a];
            slack -= e * e;
        }
        if (slack < 0 || ((h->exclusive || timed) && s->u.tree.record[k][i].from != from)) continue;
        if (slack / room * slack < 4 * (better - slack)) continue; /* sqrt g_A - sqrt g_B >= D, without roots */
        natural j = 0;
        while (j < m && (!timed || s->u.tree.record[k][i].wait[j] <= s->u.tree.wait[k][j])) j++;
        if (j == m) return 1;
    }
    const natural slot = visits % FSW_RECORDS;
    s->u.tree.visits[k] = (uint8_t)(visits + 1 == 2 * FSW_RECORDS ? FSW_RECORDS : visits + 1);
    for (natural a = 0; a < span; a++) s->u.tree.record[k][slot].at[a] = at[a];
    s->u.tree.record[k][slot].bound = bound;
    s->u.tree.record[k][slot].from = (uint8_t)from;
    for (natural j = 0; timed && j < m; j++) s->u.tree.record[k][slot].wait[j] = s->u.tree.wait[k][j];
    return 0;
}
#endif

/* ---- Children ---- */

INLINE int allowed(const fsw_horizon *h, const fsw_horizon_scratch *s, natural m, natural k, natural from, natural c)
{
    for (natural j = 0; j < m; j++)
        if (s->u.tree.wait[k][j] > 0 && h->level[c * m + j] != h->level[from * m + j]) return 0;
    return 1;
}

/* List the children of the node at depth k that can still beat the incumbent, best first; of the last of
 * several moves only the best. */
INLINE void expand(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural k,
                   natural from, int timed, fsw_real base, fsw_real cutoff)
{
    const fsw_real *place = h->place + k * C * m, *penalty = s->priced ? s->penalty[k] : 0;
    fsw_real w[FSW_MAX_INPUTS], *bound = s->u.tree.bound[k];
    uint8_t *child = s->u.tree.child[k];
    natural count = 0;
    for (natural a = 0; a < m; a++)
        w[a] = product(s->target[k][a] + h->from_place[(k * C + from) * m + a], h->gain + (k * m + a) * n,
                       s->u.tree.x[k], n);
    for (natural c = 0; c < C; c++, place += m) {
        fsw_real b = base;
        if (penalty) b += penalty[c];
        for (natural a = 0; a < m; a++) {
            const fsw_real e = place[a] - w[a];
            b += e * e;
        }
        if (h->switch_cost) b += h->switch_cost[from * C + c];
        if (!(b < cutoff) || (timed && !allowed(h, s, m, k, from, c))) continue;
        natural i = count++;
        for (; i > 0 && bound[i - 1] > b; i--) {
            bound[i] = bound[i - 1];
            child[i] = child[i - 1];
        }
        bound[i] = b;
        child[i] = (uint8_t)c;
    }
    s->u.tree.count[k] = (uint8_t)(count > 1 && k > 0 && k + 1u == MOVES(h) ? 1 : count);
    s->u.tree.next[k] = 0;
}

/* ---- Cost ---- */

INLINE fsw_real cost_of(const fsw_horizon *h, const fsw_horizon_scratch *s, natural n, natural m, natural q, natural C,
                        uint8_t present, const uint8_t *sequence)
{
    const natural hold = h->tail == FSW_TAIL_HOLD;
    fsw_real x[FSW_HORIZON_STATES], y[FSW_HORIZON_STATES], cost = 0;
    natural from = present;
    for (natural i = 0; i < n; i++) x[i] = 0;
    for (natural k = 0; k < STEPS(h); k++) {
        const natural c = sequence[k < MOVES(h) ? k : MOVES(h) - 1u];
        for (natural i = 0; i < n; i++)
            y[i] = product(k < MOVES(h) || hold ? h->effect[c * n + i] : 0, h->F + i * n, x, n);
        for (natural i = 0; i < n; i++) x[i] = y[i];
        for (natural o = 0; o < q; o++) {
            const fsw_real e = s->error[k][o] + h->root_weight[k * q + o] * product(0, h->S + o * n, x, n);
            cost += e * e;
        }
        if (k >= MOVES(h)) continue;
        for (natural j = 0; j < m; j++) {
            const fsw_real move = h->value[c * m + j] - h->value[from * m + j];
            cost += h->move_weight[j] * move * move;
        }
        if (h->switch_cost) cost += h->switch_cost[from * C + c];
        from = c;
    }
    for (natural t = 0; t < h->terminal; t++) {
        const fsw_real e = product(product(-s->aim[t], h->T + t * n, s->end, n), h->T + t * n, x, n);
        cost += e * e;
    }
    return cost;
}

fsw_real fsw_horizon_cost(const fsw_horizon *h, const fsw_horizon_scratch *s, uint8_t present, const uint8_t *sequence)
{
#if COPIES
    if (h->states == 2 && h->inputs == 1 && h->outputs == 1)
        return cost_of(h, s, 2, 1, 1, h->candidates, present, sequence);
#endif
    return cost_of(h, s, STATES(h), INPUTS(h), OUTPUTS(h), CANDIDATES(h), present, sequence);
}

/* ---- Search: branch and bound, depth first, the best child first ----
 *
 * A node at depth k, 0 <= k < moves, has k moves fixed, scratch.u.tree.path[0 .. k - 1]. Its children are listed when
 * it is processed, so that the arrays [moves] of the tree hold all open nodes of the path at hand: no other is stored.
 */

/* Where the search stands. Costs and bounds are above V_0, which changes with the prices. */
typedef struct {
    fsw_real excess;        /* of the incumbent, scratch.best */
    uint32_t nodes;         /* so far */
    int found;              /* there is an incumbent */
    fsw_real bound;         /* of the node at hand, */
    natural k, c;           /* its depth and last move; of the root the candidate in force */
    uint32_t pause, budget; /* nodes at which prices are tried or, once they are, the search ends */
    int timed;              /* a dwell is running, or may come to */
    int priced;             /* prices have been tried */
    int dived; /* the first descent has ended: without it, a plan would only ever be followed, never revised */
} position;

/* The root, at hand. */
INLINE void to_root(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural present,
                    const uint32_t *wait, position *at)
{
    at->bound = 0;
    at->k = 0;
    at->c = present;
    for (natural i = 0; i < n; i++) s->u.tree.x[0][i] = 0;
    for (natural j = 0; j < m; j++) s->u.tree.wait[0][j] = (uint16_t)(wait[j] < UINT16_MAX ? wait[j] : UINT16_MAX);
#if FSW_RECORDS > 0
    for (natural k = 0; h->dominance && k < MOVES(h); k++) s->u.tree.visits[k] = 0;
#else
    (void)h;
#endif
}

/* State and waits at depth k + 1, by candidate c after candidate `from`. */
INLINE void descend(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural k, natural from,
                    natural c, int timed)
{
    for (natural i = 0; i < n; i++)
        s->u.tree.x[k + 1][i] = product(h->effect[c * n + i], h->F + i * n, s->u.tree.x[k], n);
    for (natural j = 0; timed && j < m; j++) {
        const uint16_t left = s->u.tree.wait[k][j], stay = h->dwell ? h->dwell[c * m + j] : 1;
        s->u.tree.wait[k + 1][j] =
            (uint16_t)(h->level[c * m + j] != h->level[from * m + j] ? stay - 1 : left - (left > 0));
    }
}

/* Cost above V_0 of a whole sequence, from the root at hand, which stays there; HUGE_COST if it breaks a dwell or there
 * is none. */
INLINE fsw_real follow(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural present,
                       int timed, const uint8_t *sequence)
{
    fsw_real cost = 0;
    natural from = present;
    for (natural k = 0; k < MOVES(h); k++) {
        const natural c = sequence[k];
        if (c >= C || (timed && !allowed(h, s, m, k, from, c))) return HUGE_COST;
        if (s->priced) cost += s->penalty[k][c];
        if (h->switch_cost) cost += h->switch_cost[from * C + c];
        for (natural a = 0; a < m; a++) {
            const natural row = (k * C + c) * m + a;
            const fsw_real e = product(s->target[k][a] + h->from_place[(k * C + from) * m + a],
                                       h->gain + (k * m + a) * n, s->u.tree.x[k], n) -
                               h->place[row];
            cost += e * e;
        }
        if (k + 1u < MOVES(h)) descend(h, s, n, m, k, from, c, timed);
        from = c;
    }
    return cost;
}

/* Least bound of all open nodes down to depth k, at most the incumbent's cost. */
static fsw_real least_open(const fsw_horizon_scratch *s, natural k, fsw_real least)
{
    for (natural i = 0; i <= k; i++) {
        const natural next = s->u.tree.next[i];
        if (next < s->u.tree.count[i] && s->u.tree.bound[i][next] < least) least = s->u.tree.bound[i][next];
    }
    return least;
}

/* Of the root's children only one. */
static void keep_only(fsw_horizon_scratch *s, natural first)
{
    natural at = 0;
    while (at < s->u.tree.count[0] && s->u.tree.child[0][at] != first) at++;
    s->u.tree.next[0] = (uint8_t)at;
    if (at < s->u.tree.count[0]) s->u.tree.count[0] = (uint8_t)(at + 1u);
}

/* Process the node at hand: bound its children, list those that can still beat the incumbent, of the root's only
 * `first` if that is a candidate. O(candidates (inputs + candidates) + inputs states). */
INLINE void process(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural first,
                    position *at)
{
    expand(h, s, n, m, C, at->k, at->c, at->timed, at->bound, at->excess);
    at->nodes += (uint32_t)C;
    if (first < C && at->k == 0) keep_only(s, first);
}

/* Whether a child of the node at hand can still beat the incumbent: the best of those left, as they are sorted. */
INLINE int is_open(const fsw_horizon_scratch *s, const position *at)
{
    const natural open = s->u.tree.next[at->k];
    return open != s->u.tree.count[at->k] && s->u.tree.bound[at->k][open] < at->excess;
}

/* Branch: take the best child left, the path and its bound with it. Returns the move before it. */
INLINE natural branch(fsw_horizon_scratch *s, natural present, position *at)
{
    const natural k = at->k, open = s->u.tree.next[k];
    const natural from = k > 0 ? s->u.tree.path[k - 1] : present;
    at->c = s->u.tree.child[k][open];
    at->bound = s->u.tree.bound[k][open];
    s->u.tree.next[k]++;
    s->u.tree.path[k] = (uint8_t)at->c;
    return from;
}

/* Spawn: make the child that was taken the node at hand, if it is not dominated. There is nothing to compare with at
 * depth 1, whose nodes differ in their only move, and nothing to save at the last. Returns whether it is there.
 * O(states^2), compared: O((states + inputs) (states + FSW_RECORDS)). */
INLINE int spawn(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural from,
                 position *at)
{
    descend(h, s, n, m, at->k, from, at->c, at->timed);
    at->k++;
#if FSW_RECORDS > 0
    if (h->dominance && at->k > 1 && at->k < MOVES(h) - 1u &&
        dominated(h, s, n, m, C, at->k, at->c, at->timed, at->bound, at->excess)) {
        at->k--;
        return 0;
    }
#else
    (void)C;
#endif
    return 1;
}

/* Far above V_0 prices are worth trying at once. */
INLINE void hurry(const fsw_horizon *h, position *at)
{
    if (!at->priced && at->excess > h->far) at->pause = at->nodes < at->budget ? at->nodes : at->budget;
}

/* A leaf was taken: the path is the new incumbent. */
INLINE void keep(const fsw_horizon *h, fsw_horizon_scratch *s, position *at)
{
    for (natural i = 0; i < MOVES(h); i++) s->best[i] = s->u.tree.path[i];
    at->excess = at->bound;
    at->found = 1;
    at->dived = 1;
    hurry(h, at);
}

/* No child is left: one move up. Returns whether there is one. */
INLINE int backtrack(const fsw_horizon *h, position *at)
{
    if (!at->dived) hurry(h, at);
    at->dived = 1; /* a plan from before may be the best there is, so that no leaf would ever tell how far it is */
    /* the first descent only fails where costs overflow: without an incumbent, the rest might never end */
    return at->found && at->k-- > 0;
}

/* Raise all bounds by prices, once. Returns whether the search begins anew: the root is at hand, the incumbent stays.
 */
INLINE int reprice(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C, natural present,
                   const uint32_t *wait, position *at)
{
    at->pause = at->budget;
    at->priced = 1;
    if (!leaves_hull(h, s, present)) return 0;
    const fsw_real plain = at->excess;
    set_prices(h, s, present); /* in the tree's memory */
    to_root(h, s, n, m, present, wait, at);
    at->excess = follow(h, s, n, m, C, present, at->timed, s->best);
    at->nodes += MOVES(h);
    if (!(at->excess <= plain)) { /* worse than without them, or NaN: they did not converge */
        withdraw_prices(h, s);
        at->excess = plain;
    }
    return 1;
}

INLINE fsw_horizon_answer answered(const position *at, fsw_real gap, int optimal)
{
    const fsw_horizon_answer answer = {at->excess, gap, at->nodes, (uint8_t)at->found, (uint8_t)optimal};
    return answer;
}

/* The best sequence, into scratch.best. n, m, C: states, inputs, candidates, perhaps as constants. Before:
 * fsw_horizon_prepare, moves >= 2, present < C, candidates in `warm` checked here. After: found, unless no candidate
 * respects the waits or all costs overflow; optimal, unless the budget ran out. Each node costs what process and spawn
 * do; there are at most sum C^k, and on the way to the first leaf moves * C. */
INLINE fsw_horizon_answer search(const fsw_horizon *h, fsw_horizon_scratch *s, natural n, natural m, natural C,
                                 uint8_t present, const uint32_t *wait, const uint8_t *warm, natural first,
                                 uint32_t budget)
{
    position at = {HUGE_COST, 0, 0, 0, 0, 0, h->patience < budget ? h->patience : budget, budget, 0, 0, 0};
    at.timed = h->dwell != 0; /* without any, a dwell may still have been given to start with */
    for (natural j = 0; j < m; j++) at.timed |= wait[j] > 0;
    to_root(h, s, n, m, present, wait, &at);
    if (warm && MOVES(h) >= REPLAYED) {
        at.excess = follow(h, s, n, m, C, present, at.timed, warm);
        at.nodes = MOVES(h);
        at.found = at.excess < HUGE_COST;
        for (natural i = 0; at.found && i < MOVES(h); i++) s->best[i] = warm[i];
    }
    for (int fresh = 1;;) { /* the node at hand is not yet processed */
        if (fresh) process(h, s, n, m, C, first, &at);
        fresh = 0;
        if (!is_open(s, &at)) {
            if (backtrack(h, &at)) continue;
            return answered(&at, 0, at.found);
        }
        if (at.found && at.dived && at.nodes >= at.pause) {
            if (at.nodes >= budget) break;
            fresh = reprice(h, s, n, m, C, present, wait, &at);
            continue;
        }
        const natural from = branch(s, present, &at);
        if (at.k + 1u == MOVES(h))
            keep(h, s, &at);
        else
            fresh = spawn(h, s, n, m, C, from, &at);
    }
    const fsw_real gap = at.excess - least_open(s, at.k, at.excess);
    return answered(&at, gap, !(gap > 0));
}

/* One move: every candidate that may be commanded. */
static fsw_horizon_answer try_each(const fsw_horizon *h, fsw_horizon_scratch *s, uint8_t present, const uint32_t *wait,
                                   natural first)
{
    const natural m = INPUTS(h), C = CANDIDATES(h);
    fsw_horizon_answer answer = {HUGE_COST, 0, 0, 0, 0};
    for (natural c = 0; c < C; c++) {
        const uint8_t one = (uint8_t)c;
        int barred = first < C && c != first;
        for (natural j = 0; j < m; j++) barred |= wait[j] > 0 && h->level[c * m + j] != h->level[present * m + j];
        if (barred) continue;
        answer.nodes++;
        const fsw_real cost = fsw_horizon_cost(h, s, present, &one);
        if (answer.found && !(cost < answer.excess || (cost == answer.excess && c == present))) continue;
        answer.excess = cost;
        answer.found = answer.optimal = 1;
        s->best[0] = one;
    }
    return answer;
}

fsw_horizon_answer fsw_horizon_search(const fsw_horizon *h, fsw_horizon_scratch *s, uint8_t present,
                                      const uint32_t *wait, const uint8_t *warm, uint8_t first, uint32_t node_budget)
{
    if (MOVES(h) == 1) return try_each(h, s, present, wait, first);
#if COPIES
    if (h->states == 2 && h->inputs == 1) {
        if (h->candidates == 2) return search(h, s, 2, 1, 2, present, wait, warm, first, node_budget);
        if (h->candidates == 3) return search(h, s, 2, 1, 3, present, wait, warm, first, node_budget);
    }
#endif
    return search(h, s, STATES(h), INPUTS(h), CANDIDATES(h), present, wait, warm, first, node_budget);
}

#else
typedef int fsw_no_horizon; /* a translation unit must declare something */
#endif
