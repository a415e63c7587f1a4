/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* In the order data meets it: checks, delay line, observation, options, prediction, choice, plan, step, other periods.
 */
#include "foreswitch.h"

/* What a design says: constants where the limits are its own (FSW_FIXED), so that a compiler drops what it does not
 * use; otherwise read from it. */
#ifdef FSW_FIXED
#define SAID(constant, value) ((void)sizeof(value), (natural)(constant))
#else
#define SAID(constant, value) ((natural)(value))
#endif
#define STATES(d) SAID(FSW_MAX_STATES, (d)->states)
#define INPUTS(d) SAID(FSW_MAX_INPUTS, (d)->inputs)
#define OUTPUTS(d) SAID(FSW_MAX_OUTPUTS, (d)->outputs)
#define DISTURBANCES(d) SAID(FSW_DISTURBANCES, (d)->disturbances)
#define LOADS(d) SAID(FSW_LOADS, (d)->loads)
#define MEASURED(d) SAID(FSW_ESTIMATOR ? FSW_MAX_OUTPUTS : FSW_MAX_STATES, (d)->measured)
#define ORDER(d) SAID(FSW_ORDER, (d)->order)
#define ROWS(d) SAID(FSW_MAX_LINE / FSW_MAX_INPUTS, (d)->rows)
#define CANDIDATES(d) SAID(FSW_CANDIDATES, (d)->candidates)
#define ESTIMATES(d) SAID(FSW_ESTIMATOR, (d)->gain != 0)
#define RESTS(d) SAID(FSW_REST, (d)->rest_reference != 0)
#define SPLITS(d) SAID(FSW_SPLIT, 1)        /* model_new may not be zero */
#define OFFSETS(d) SAID(FSW_OFFSET, 1)      /* offset may not be zero */
#define COSTS(d) SAID(FSW_SWITCH_COST, 1)   /* a switch may cost something */
#define HELD_ONCE(d) SAID(FSW_HELD_ONCE, 0) /* every input has one holding time only */
#if FSW_MAX_MOVES > 0
#define PLANS(d) SAID(1, (d)->horizon != 0)
#else
#define PLANS(d) ((natural)0)
#endif

/* An exported design is the only one, and in view here: its numbers go into the code, a fifth of the work falls away.
 * Only fsw_init, which refuses any other, looks at what it is given. */
#ifdef FSW_DESIGN
#define FSW_DATA
#include "foreswitch_design.h"
#define KNOWN(design) ((void)(design), &FSW_DESIGN)
#if defined(__GNUC__) && !defined(__clang__) && FSW_MAX_INPUTS == 1 && FSW_MAX_OUTPUTS == 1
#pragma GCC optimize("peel-loops") /* they are short, and of known length */
#endif
#else
#define KNOWN(design) (design)
#endif

/* The numbers of inputs m and outputs q are handed down, as constants where there is one of each: this common case
 * gets its own copy of the step, without the loops over them and with half the instructions. Where size counts, or
 * where the limits allow nothing else, there is one copy. */
#if FSW_MAX_INPUTS == 1 && FSW_MAX_OUTPUTS == 1
#define SINGLE(design) 1
#elif defined(FSW_FIXED) || defined(__OPTIMIZE_SIZE__)
#define SINGLE(design) 0
#else
#define SINGLE(design) ((design)->inputs == 1 && (design)->outputs == 1)
#endif

#ifdef FSW_FIXED
#define FOLDS
#endif
#include "arithmetic.h"

/* product without the entries that are known to be zero. */
INLINE fsw_real sparse(fsw_real sum, const fsw_real *a, const fsw_real *b, natural count)
{
    for (natural i = 0; i < count; i++)
#ifdef FSW_DESIGN
        if (a[i] < 0 || a[i] > 0)
#endif
            sum += a[i] * b[i];
    return sum;
}

/* factor times a level; where the design is in view, one of as many constants as there are levels. */
INLINE fsw_real times_level(const fsw_real *levels, natural count, natural level, fsw_real factor)
{
#ifdef FSW_DESIGN
    for (natural l = 0; l + 1u < count; l++)
        if (level == l) return factor * levels[l];
    return factor * levels[count - 1u];
#else
    (void)count;
    return factor * levels[level];
#endif
}

/* |value| as a whole number, compared without a floating point unit: it ascends with |value|, infinity and then NaN
 * are beyond all others. */
#ifdef FSW_SINGLE
typedef uint32_t magnitude;
#define BEYOND ((magnitude)0x7f800000) /* infinity */
#else
typedef uint64_t magnitude;
#define BEYOND ((magnitude)0x7ff << 52)
#endif
typedef union {
    magnitude bits;
    fsw_real value;
} parts;

INLINE magnitude size_of(fsw_real value)
{
    parts all;
    all.value = value;
    return all.bits & ((magnitude)-1 >> 1);
}

/* No value NaN, infinite or huge. */
INLINE int usable(const fsw_real *values, natural count)
{
    for (natural i = 0; i < count; i++)
        if (size_of(values[i]) > size_of(FSW_HUGE)) return 0;
    return 1;
}

/* ---- Checks ---- */

static int indices_valid(const fsw_design *d, const uint8_t *command, uint32_t commands)
{
    const natural m = INPUTS(d);
    for (uint32_t i = 0; i < commands; i++)
        for (natural j = 0; j < m; j++)
            if (*command++ >= d->level_count[j]) return 0;
    return 1;
}

static int tables_missing(const fsw_design *d)
{
    if (!d->level_count || !d->levels || !d->candidate || !d->safe || !d->pending || !d->dwell || !d->switch_cost ||
        !d->model_x || !d->model_old || !d->model_new || !d->model_w || !d->model_c)
        return 1;
    if (RESTS(d) && (!d->rest_reference || !d->rest_disturbance || !d->rest_offset)) return 1;
    if (ESTIMATES(d) && (!d->gain || !d->output_row || !d->output_offset || !d->start_row || !d->start_offset))
        return 1;
    return !PLANS(d) && (!d->state_row || !d->disturbance_row || !d->offset || !d->reference_row || !d->half_weight ||
                         !d->pending_table || !d->holds || !d->hold_row || !d->total_row);
}

#if FSW_MAX_MOVES > 0
static int horizon_tables_missing(const fsw_horizon *h)
{
    return !h->start_row || !h->start_disturbance || !h->start_offset || !h->pending_table || !h->drift ||
           !h->drift_disturbance || !h->row_disturbance || !h->row_offset || !h->reference_row ||
           !h->terminal_reference || !h->terminal_disturbance || !h->terminal_offset || !h->F || !h->G || !h->S ||
           !h->root_weight || !h->T || !h->move_weight || !h->lift || !h->lift_centre || !h->last_value || !h->hull ||
           !h->value || !h->effect || !h->gain || !h->gain_previous || !h->pull || !h->place || !h->from_place ||
           !h->metric || !h->from_metric || !h->level;
}

static fsw_validity check_horizon(const fsw_design *d)
{
    const fsw_horizon *h = d->horizon;
    if (h->steps > FSW_MAX_STEPS || h->moves > FSW_MAX_MOVES || h->states > FSW_HORIZON_STATES ||
        h->candidates > FSW_HORIZON_CANDIDATES || h->terminal > h->states)
        return FSW_TOO_LARGE;
    if (h->inputs != d->inputs || h->outputs != d->outputs || h->candidates != d->candidates || h->order != d->order ||
        h->disturbances != d->disturbances || h->states == 0 || h->moves == 0 || h->moves > h->steps ||
        h->lead >= h->steps || h->tail > FSW_TAIL_HOLD || (h->tail == FSW_TAIL_REST && !RESTS(d)) ||
        horizon_tables_missing(h))
        return FSW_INCONSISTENT;
#ifdef FSW_FIXED
    if (h->states != FSW_HORIZON_STATES || h->candidates != FSW_HORIZON_CANDIDATES || h->moves != FSW_MAX_MOVES ||
        h->steps != FSW_MAX_STEPS)
        return FSW_INCONSISTENT;
#endif
    for (uint32_t i = 0; i < (uint32_t)d->candidates * d->inputs; i++)
        if (h->level[i] != d->candidate[i] || (h->dwell && h->dwell[i] == 0)) return FSW_INCONSISTENT;
    for (uint32_t i = 0; i < (uint32_t)h->lead * d->outputs; i++)
        if (h->root_weight[i] > 0) return FSW_INCONSISTENT; /* there is no reference for it */
    return FSW_VALID;
}
#endif

static fsw_validity check(const fsw_design *d)
{
    if (d->states > FSW_MAX_STATES || d->inputs > FSW_MAX_INPUTS || d->outputs > FSW_MAX_OUTPUTS ||
        d->disturbances > FSW_MAX_DISTURBANCES || (uint32_t)d->rows * d->inputs > FSW_MAX_LINE ||
        (d->gain && d->measured > FSW_MAX_OUTPUTS))
        return FSW_TOO_LARGE;
#ifdef FSW_FIXED
    if (d->states != STATES(d) || d->inputs != INPUTS(d) || d->outputs != OUTPUTS(d) ||
        d->disturbances != DISTURBANCES(d) || d->loads != LOADS(d) || d->measured != MEASURED(d) ||
        d->order != ORDER(d) || d->rows != ROWS(d) || d->candidates != CANDIDATES(d) ||
        (d->gain != 0) != ESTIMATES(d) || (d->rest_reference != 0) != RESTS(d) || (d->horizon != 0) != PLANS(d))
        return FSW_INCONSISTENT;
#endif
    if (d->horizon && FSW_MAX_MOVES == 0) return FSW_TOO_LARGE;
    if (d->states == 0 || d->inputs == 0 || d->outputs == 0 || d->order == 0 || d->candidates == 0 || tables_missing(d))
        return FSW_INCONSISTENT;
    if (ESTIMATES(d) ? d->measured == 0 || d->loads > d->disturbances || d->gate_limit > UINT8_MAX
                     : d->measured != d->states || d->loads > 0)
        return FSW_INCONSISTENT;
    const uint32_t *dwell = d->dwell;
    const fsw_real *level = d->levels;
    for (natural j = 0; j < d->inputs; j++) {
        const natural count = d->level_count[j];
        if (count == 0 || d->pending[j] >= d->rows || !usable(level, count) || !(d->switch_cost[j] >= 0))
            return FSW_INCONSISTENT;
        if (!PLANS(d) &&
            (d->holds[j] == 0 || (HELD_ONCE(d) && d->holds[j] > 1) || (!COSTS(d) && d->switch_cost[j] > 0)))
            return FSW_INCONSISTENT;
        for (natural i = 0; i < count; i++)
            if (dwell[i] == 0 || (i > 0 && !(level[i - 1] < level[i]))) return FSW_INCONSISTENT;
        dwell += count;
        level += count;
    }
    for (natural i = 0; !SPLITS(d) && i < (natural)d->inputs * d->states; i++)
        if (size_of(d->model_new[i]) > 0) return FSW_INCONSISTENT;
    for (natural o = 0; !PLANS(d) && o < d->outputs; o++)
        if (!(d->half_weight[o] >= 0) || (!OFFSETS(d) && size_of(d->offset[o]) > 0)) return FSW_INCONSISTENT;
    if (!indices_valid(d, d->safe, 1) || !indices_valid(d, d->candidate, d->candidates)) return FSW_INCONSISTENT;
#if FSW_MAX_MOVES > 0
    return PLANS(d) ? check_horizon(d) : FSW_VALID;
#else
    return FSW_VALID;
#endif
}

fsw_validity fsw_init(const fsw_design *design, fsw_state *s)
{
    const fsw_design *d = KNOWN(design);
    const fsw_validity validity = d == design ? check(d) : FSW_INCONSISTENT;
    if (validity != FSW_VALID) return validity;
    for (natural i = 0; i < FSW_MAX_STATES; i++) s->x[i] = 0;
    for (natural i = 0; i < FSW_MAX_DISTURBANCES; i++) s->w[i] = 0;
    for (natural j = 0; j < FSW_MAX_INPUTS; j++) s->wait[j] = 0;
    for (natural i = 0; i < d->rows; i++)
        for (natural j = 0; j < d->inputs; j++) s->line[i * d->inputs + j] = d->safe[j];
    s->bad_total = 0;
    s->head = 0;
    s->bad = 0;
    s->primed = 0;
    s->outliers = 0;
#if FSW_MAX_MOVES > 0
    s->planned = 0;
    for (natural i = 0; i < FSW_MAX_MOVES; i++) s->plan[i] = 0;
#endif
    return FSW_VALID;
}

/* ---- Reference ---- */

INLINE natural reference_size(const fsw_design *d, natural q)
{
#if FSW_MAX_MOVES > 0
    if (PLANS(d)) return q * ORDER(d) * (natural)(d->horizon->steps - d->horizon->lead);
#endif
    return q * ORDER(d);
}

uint32_t fsw_reference_size(const fsw_design *design)
{
    const fsw_design *d = KNOWN(design);
    return (uint32_t)reference_size(d, OUTPUTS(d));
}

/* ---- Delay line: the commands issued 1 .. rows periods ago, a ring of rows ---- */

fsw_validity fsw_preload(const fsw_design *design, fsw_state *s, const uint8_t *line, const uint32_t *wait)
{
    const fsw_design *d = KNOWN(design);
    if (!indices_valid(d, line, d->rows)) return FSW_INCONSISTENT;
    for (uint32_t i = 0; i < (uint32_t)d->rows * d->inputs; i++) s->line[i] = line[i];
    for (natural j = 0; j < d->inputs; j++) s->wait[j] = wait[j];
    s->head = 0;
#if FSW_MAX_MOVES > 0
    s->planned = 0;
#endif
    return FSW_VALID;
}

uint32_t fsw_dwell_left(const fsw_design *design, uint16_t input, uint8_t level, uint32_t elapsed)
{
    const fsw_design *d = KNOWN(design);
    const uint32_t *dwell = d->dwell;
    for (natural j = 0; j < input; j++) dwell += d->level_count[j];
    return dwell[level] > elapsed ? dwell[level] - elapsed : 0;
}

INLINE const uint8_t *issued(const fsw_design *d, const fsw_state *s, natural m, natural age)
{
    return s->line + (s->head + (s->head < age ? ROWS(d) : 0) - age) * m;
}

const uint8_t *fsw_issued(const fsw_design *design, const fsw_state *s, uint16_t age)
{
    const fsw_design *d = KNOWN(design);
    return issued(d, s, INPUTS(d), age);
}

/* ---- Observation: what is used in place of what was measured ---- */

/* Copy, small values to zero. */
INLINE void take(fsw_real *to, const fsw_real *from, natural count)
{
    for (natural i = 0; i < count; i++) to[i] = size_of(from[i]) < size_of(FSW_TINY) ? 0 : from[i];
}

/* The model's state one period after s->x. */
static void coast(const fsw_design *d, const fsw_state *s, fsw_real *x)
{
    const natural n = STATES(d), m = INPUTS(d), p = DISTURBANCES(d);
    for (natural i = 0; i < n; i++) {
        const fsw_real sum = sparse(d->model_c[i], d->model_x + i * n, s->x, n);
        x[i] = product(sum, d->model_w + i * p, s->w, p);
    }
    const fsw_real *levels = d->levels;
    for (natural j = 0; j < m; j++) {
        const natural age = d->pending[j], count = d->level_count[j];
        const natural older = issued(d, s, m, age + 1u)[j];
        const natural newer = SPLITS(d) && age > 0 ? issued(d, s, m, age)[j] : 0;
        for (natural i = 0; i < n; i++) {
            const fsw_real effect = times_level(levels, count, older, d->model_old[j * n + i]);
            x[i] += SPLITS(d) ? effect + (age > 0 ? times_level(levels, count, newer, d->model_new[j * n + i]) : 0)
                              : effect;
        }
        levels += d->level_count[j];
    }
}

/* Use `state`, and what is usable of the rest; `width` values of the reference, 0 where nothing is to be decided. */
static fsw_status settle(const fsw_design *d, const fsw_state *s, fsw_status status, const fsw_real *state,
                         const fsw_real *reference, natural width, const fsw_real *disturbance, fsw_real *x,
                         fsw_real *w)
{
    const natural n = STATES(d), p = DISTURBANCES(d) - LOADS(d);
    const int told = usable(disturbance, p);
    take(x, state, n);
    take(w, told ? disturbance : s->w, p);
    if (status == FSW_OK && !told) status = FSW_COASTING;
    if (!usable(reference, width)) status = FSW_HELD;
    if (status != FSW_OK && d->bad_limit > 0 && (uint32_t)s->bad + 1 >= d->bad_limit) status = FSW_SAFE;
    return status;
}

/* As observe, where something is not usable. */
static fsw_status replace(const fsw_design *d, const fsw_state *s, const fsw_real *state, const fsw_real *reference,
                          natural width, const fsw_real *disturbance, fsw_real *x, fsw_real *w)
{
    fsw_status status = FSW_COASTING;
    fsw_real next[FSW_MAX_STATES];
    if (!usable(state, STATES(d))) {
        coast(d, s, next);
        state = next;
        if (!s->primed || !usable(next, STATES(d))) {
            state = s->x;
            status = FSW_HELD;
        }
    }
    return settle(d, s, status, state, reference, width, disturbance, x, w);
}

/* Move the expected [x; load] by what it misses of a usable y; 0 if y is an outlier or leads beyond all numbers. */
static int correct(const fsw_design *d, const fsw_real *y, const fsw_real *expected, fsw_real *corrected,
                   uint8_t *outliers)
{
    const natural n = STATES(d), z = MEASURED(d), size = n + LOADS(d);
    fsw_real missed[FSW_MAX_OUTPUTS], distance = 0;
    missed[0] = 0; /* z is at least 1, which a compiler cannot know */
    for (natural o = 0; o < z; o++) missed[o] = y[o] - product(d->output_offset[o], d->output_row + o * n, expected, n);
    if (d->gate) {
        for (natural o = 0; o < z; o++) distance += missed[o] * product(0, d->gate + o * z, missed, z);
        if (distance <= 1) { /* not so if it is NaN */
            *outliers = 0;
        } else if (*outliers < d->gate_limit) {
            ++*outliers;
            return 0;
        }
    }
    for (natural i = 0; i < size; i++) corrected[i] = product(expected[i], d->gain + i * z, missed, z);
    return usable(corrected, size);
}

/* As observe, from outputs. An expectation beyond all numbers is as good as none: the next y starts anew. */
static fsw_status estimate(const fsw_design *d, const fsw_state *s, const fsw_real *y, const fsw_real *reference,
                           natural width, const fsw_real *disturbance, fsw_real *x, fsw_real *w, uint8_t *outliers)
{
    const natural n = STATES(d), z = MEASURED(d), loads = LOADS(d), p = DISTURBANCES(d) - loads;
    fsw_real expected[FSW_MAX_STATES + FSW_MAX_DISTURBANCES], corrected[FSW_MAX_STATES + FSW_MAX_DISTURBANCES];
    const fsw_real *best = expected;
    fsw_status status = FSW_COASTING;
    coast(d, s, expected);
    take(expected + n, s->w + p, loads);
    int known = s->primed && usable(expected, n);
    if (usable(y, z)) {
        if (!known) {
            for (natural i = 0; i < n; i++) expected[i] = product(d->start_offset[i], d->start_row + i * z, y, z);
            for (natural i = 0; i < loads; i++) expected[n + i] = 0;
            known = usable(expected, n);
            status = FSW_OK;
        } else if (correct(d, y, expected, corrected, outliers)) {
            best = corrected;
            status = FSW_OK;
        }
    }
    if (!known) {
        take(expected, s->x, n);
        status = FSW_HELD;
    }
    take(w + p, best + n, loads);
    return settle(d, s, status, best, reference, width, disturbance, x, w);
}

/* Fill x and w, which may be s->x and s->w, with what the prediction shall start from. */
INLINE fsw_status observe(const fsw_design *d, const fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                          natural width, const fsw_real *disturbance, fsw_real *x, fsw_real *w, uint8_t *outliers)
{
    const natural n = STATES(d), p = DISTURBANCES(d);
    if (ESTIMATES(d)) return estimate(d, s, measured, reference, width, disturbance, x, w, outliers);
    if (!usable(measured, n) || !usable(disturbance, p) || !usable(reference, width))
        return replace(d, s, measured, reference, width, disturbance, x, w);
    take(x, measured, n);
    take(w, disturbance, p);
    return FSW_OK;
}

/* The same into the state, and count the bad samples. */
INLINE fsw_status observe_and_count(const fsw_design *d, fsw_state *s, const fsw_real *measured,
                                    const fsw_real *reference, natural width, const fsw_real *disturbance)
{
    const fsw_status status = observe(d, s, measured, reference, width, disturbance, s->x, s->w, &s->outliers);
    if (status == FSW_OK)
        s->bad = 0;
    else {
        if (s->bad < UINT16_MAX) s->bad++;
        if (s->bad_total < UINT32_MAX) s->bad_total++;
    }
    if (status == FSW_OK || usable(measured, MEASURED(d))) s->primed = 1;
    return status;
}

fsw_validity fsw_start(const fsw_design *design, fsw_state *s, const fsw_real *x, const fsw_real *w)
{
    const fsw_design *d = KNOWN(design);
    if (!usable(x, STATES(d)) || !usable(w, DISTURBANCES(d))) return FSW_INCONSISTENT;
    take(s->x, x, STATES(d));
    take(s->w, w, DISTURBANCES(d));
    s->primed = 1;
    s->outliers = 0;
    return FSW_VALID;
}

/* ---- Options: what an input may do in this period, and what is assumed after it ---- */

typedef struct {
    const fsw_real *levels;
    const fsw_real *hold_row;
    const uint32_t *dwell;
    fsw_real tail, switch_cost;
    uint32_t keep, most; /* periods: the rest of the present run, and the longest that is told apart */
    uint8_t present, locked;
} option;

/* The level of input j that holds the output at the reference, [outputs][order]. */
INLINE fsw_real rest(const fsw_design *d, natural q, natural j, const fsw_real *reference, const fsw_real *w)
{
    const natural p = DISTURBANCES(d), order = ORDER(d);
    fsw_real level = d->rest_offset[j];
    for (natural o = 0; o < q; o++) level += d->rest_reference[j * q + o] * reference[o * order];
    return product(level, d->rest_disturbance + j * p, w, p);
}

/* The same within what the levels, ascending, can do. */
INLINE fsw_real clipped_rest(const fsw_design *d, natural q, natural j, const fsw_real *reference, const fsw_real *w,
                             const fsw_real *levels)
{
    const fsw_real level = rest(d, q, j, reference, w), low = levels[0], high = levels[d->level_count[j] - 1];
    return level < low ? low : level > high ? high : level;
}

INLINE void list_options(const fsw_design *d, const fsw_state *s, natural m, natural q, const fsw_real *reference,
                         const fsw_real *w, const uint8_t *present, option *options)
{
    const fsw_real *levels = d->levels, *hold_row = d->hold_row;
    const uint32_t *dwell = d->dwell;
    for (natural j = 0; j < m; j++) {
        const uint32_t wait = s->wait[j];
        option *now = options + j;
        now->levels = levels;
        now->hold_row = hold_row;
        now->dwell = dwell;
        now->tail = RESTS(d) ? clipped_rest(d, q, j, reference, w, levels) : 0;
        now->switch_cost = d->switch_cost[j];
        now->keep = wait > 1 ? wait : 1;
        now->most = d->holds[j];
        now->present = present[j];
        now->locked = wait > 0;
        levels += d->level_count[j];
        dwell += d->level_count[j];
        hold_row += d->holds[j] * q;
    }
}

/* ---- Prediction: the free part of the sliding variable ---- */

/* Add the effect on one output of all commands under way; `effect` points at its first entry in the pending table. */
INLINE fsw_real pending(const fsw_design *d, const fsw_state *s, natural m, natural q, const fsw_real *effect,
                        fsw_real sum)
{
    const natural ring = ROWS(d) * m;
    for (natural j = 0; j < m; j++) {
        const natural stride = d->level_count[j] * q;
        natural at = s->head * m + j;
        for (natural age = d->pending[j]; age > 0; age--) {
            at = (at < m ? at + ring : at) - m;
            sum += effect[s->line[at] * q];
            effect += stride;
        }
    }
    return sum;
}

INLINE void predict(const fsw_design *d, const fsw_state *s, natural m, natural q, const fsw_real *x,
                    const fsw_real *reference, const fsw_real *w, const option *options, fsw_real *free)
{
    const natural n = STATES(d), p = DISTURBANCES(d), order = ORDER(d);
    for (natural o = 0; o < q; o++) {
        const fsw_real *row = d->state_row + o * n;
        fsw_real sum = OFFSETS(d) ? d->offset[o] + row[0] * x[0] : row[0] * x[0];
        sum = product(sum, row + 1, x + 1, n - 1);
        sum = product(sum, d->disturbance_row + o * p, w, p);
        for (natural i = 0; i < order; i++) sum -= d->reference_row[o * order + i] * reference[o * order + i];
        for (natural j = 0; j < m && RESTS(d); j++) sum += d->total_row[o * m + j] * options[j].tail;
        free[o] = pending(d, s, m, q, d->pending_table + o, sum);
    }
}

/* ---- Choice ---- */

INLINE fsw_real infinity(void)
{
    const parts all = {BEYOND};
    return all.value;
}

/* A smaller sliding variable counts as zero: its square would be denormal, and slow. */
#ifdef FSW_SINGLE
#define ON_SURFACE 1e-17f
#else
#define ON_SURFACE 1e-140
#endif

/* The candidate's cost, infinite where it would break a running dwell; `nearest`: its sliding variable in place of it.
 */
INLINE fsw_real evaluate(const fsw_design *d, natural m, natural q, const option *options, const uint8_t *command,
                         const fsw_real *free, int nearest)
{
    fsw_real slide[FSW_MAX_OUTPUTS], cost = 0;
    for (natural j = 0; j < m; j++) {
        const option *now = options + j;
        const uint8_t level = command[j];
        uint32_t hold = now->keep;
        if (level != now->present) {
            if (now->locked) return infinity();
            if (COSTS(d)) cost += now->switch_cost;
            hold = now->dwell[level];
        }
        const fsw_real *effect = now->hold_row + (HELD_ONCE(d) ? 0 : (hold < now->most ? hold : now->most) - 1) * q;
        const fsw_real shift = RESTS(d) ? now->levels[level] - now->tail : now->levels[level];
        for (natural o = 0; o < q; o++) slide[o] = (j == 0 ? free[o] : slide[o]) + effect[o] * shift;
    }
    if (nearest) return size_of(slide[0]) < size_of(ON_SURFACE) ? 0 : slide[0];
    for (natural o = 0; o < q; o++) {
        if (size_of(slide[o]) < size_of(ON_SURFACE)) continue;
        const fsw_real share = d->half_weight[o] * slide[o] * slide[o];
        cost = o > 0 || COSTS(d) ? cost + share : share;
    }
    return cost;
}

INLINE int same(const uint8_t *a, const uint8_t *b, natural count)
{
    for (natural j = 0; j < count; j++)
        if (a[j] != b[j]) return 0;
    return 1;
}

/* Smallest cost; equal costs: the present command, then the lower index. NaN never wins. */
INLINE fsw_decision choose(const fsw_design *d, const fsw_state *s, natural m, natural q, const fsw_real *x,
                           const fsw_real *reference, const fsw_real *w, const uint8_t *present, fsw_real *costs)
{
    option options[FSW_MAX_INPUTS];
    fsw_real free[FSW_MAX_OUTPUTS], least = infinity();
    list_options(d, s, m, q, reference, w, present, options);
    predict(d, s, m, q, x, reference, w, options, free);
    const natural candidates = CANDIDATES(d);
    const uint8_t *command = d->candidate;
    natural best = candidates;
    /* of one input and output, switching for nothing, the nearest is the cheapest: only its square is wanted */
    const int nearest = m == 1 && q == 1 && !(COSTS(d) && d->switch_cost[0] > 0);
    for (natural i = 0; i < candidates; i++, command += m) {
        const fsw_real cost = evaluate(d, m, q, options, command, free, nearest);
        if (costs) costs[i] = nearest && size_of(cost) < BEYOND ? d->half_weight[0] * cost * cost : cost;
        if (size_of(cost) < size_of(least) || (size_of(cost) == size_of(least) && same(command, present, m))) {
            least = cost;
            best = i;
        }
    }
    if (nearest && best < candidates) {
        least *= d->half_weight[0] * least;
        if (!(size_of(least) < BEYOND)) {
            best = candidates;
            least = infinity();
        }
    }
    /* where every cost overflows there is nothing to choose by */
    const fsw_decision decision = {size_of(least) < BEYOND ? FSW_OK : FSW_HELD, (uint16_t)best, (uint32_t)candidates,
                                   least, 0};
    return decision;
}

/* ---- Plan: a long horizon in place of prediction and choice ---- */

#if FSW_MAX_MOVES > 0
/* The candidate to search from: the command in force or, if somebody else has issued what is no candidate, the likest
 * that agrees wherever a dwell is running; `candidates` if there is none. */
static natural likest(const fsw_design *d, const fsw_state *s, const uint8_t *command)
{
    const natural m = INPUTS(d), candidates = CANDIDATES(d);
    const uint8_t *other = d->candidate;
    natural best = candidates, most = 0;
    for (natural c = 0; c < candidates && most <= m; c++) {
        natural agree = 1;
        for (natural j = 0; j < m && agree > 0; j++, other++)
            agree = *other == command[j] ? agree + 1 : s->wait[j] > 0 ? 0 : agree;
        if (agree > most) {
            most = agree;
            best = c;
        }
        other = d->candidate + (c + 1u) * m;
    }
    return best;
}

/* The horizon's state at the end of its first step, moves left out. */
INLINE void arrive(const fsw_design *d, const fsw_state *s, natural n, natural m, const fsw_real *x, const fsw_real *w,
                   fsw_real *z)
{
    const fsw_horizon *h = d->horizon;
    const natural states = STATES(d), p = DISTURBANCES(d), ring = ROWS(d) * m;
    for (natural i = 0; i < n; i++) {
        z[i] = product(h->start_offset[i], h->start_row + i * states, x, states);
        z[i] = product(z[i], h->start_disturbance + i * p, w, p);
    }
    const fsw_real *effect = h->pending_table;
    for (natural j = 0; j < m; j++) {
        natural at = s->head * m + j;
        for (natural age = d->pending[j]; age > 0; age--, effect += d->level_count[j] * n) {
            at = (at < m ? at + ring : at) - m;
            for (natural i = 0; i < n; i++) z[i] += effect[s->line[at] * n + i];
        }
    }
}

/* The best first move, its whole sequence left in scratch.best. costs [candidates], if given, receives the cost of the
 * best sequence that begins with each candidate. */
static fsw_decision plan(const fsw_design *d, fsw_state *s, const fsw_real *x, const fsw_real *reference,
                         const fsw_real *w, const uint8_t *present, fsw_real *costs)
{
    const fsw_horizon *h = d->horizon;
    const natural n = SAID(FSW_HORIZON_STATES, h->states), m = INPUTS(d), q = OUTPUTS(d), C = CANDIDATES(d);
    const natural moves = SAID(FSW_MAX_MOVES, h->moves);
    fsw_decision decision = {FSW_HELD, (uint16_t)C, 0, 0, 0};
    fsw_real z[FSW_HORIZON_STATES], tail[FSW_MAX_INPUTS];
    if (SINGLE(d) && n == 2)
        arrive(d, s, 2, 1, x, w, z);
    else
        arrive(d, s, n, m, x, w, z);
    const fsw_real *levels = d->levels, *final = reference + (h->steps - h->lead - 1u) * q * ORDER(d);
    for (natural j = 0; j < m; j++, levels += d->level_count[j - 1])
        tail[j] = RESTS(d) && h->tail == FSW_TAIL_REST ? clipped_rest(d, q, j, final, w, levels) : 0;
    const natural from = likest(d, s, present);
    for (natural c = 0; costs && c < C; c++) costs[c] = infinity();
    if (from == C || !usable(z, n)) return decision;

    fsw_horizon_prepare(h, &s->scratch, z, reference, w, tail);
    if (costs) {
        for (natural c = 0; c < C; c++) {
            const fsw_horizon_answer answer =
                fsw_horizon_search(h, &s->scratch, (uint8_t)from, s->wait, 0, (uint8_t)c, h->node_budget);
            if (answer.found) costs[c] = fsw_horizon_cost(h, &s->scratch, (uint8_t)from, s->scratch.best);
        }
        fsw_horizon_prepare(h, &s->scratch, z, reference, w, tail);
    }
    uint8_t warm[FSW_MAX_MOVES];
    for (natural k = 0; k < moves; k++) warm[k] = s->plan[k + 1u < moves ? k + 1u : k];
    const fsw_horizon_answer answer =
        fsw_horizon_search(h, &s->scratch, (uint8_t)from, s->wait, s->planned ? warm : 0, (uint8_t)C, h->node_budget);
    decision.nodes = answer.nodes;
    if (!answer.found) return decision;
    decision.cost = fsw_horizon_cost(h, &s->scratch, (uint8_t)from, s->scratch.best);
    decision.gap = answer.gap;
    decision.status = size_of(decision.cost) < BEYOND ? FSW_OK : FSW_HELD;
    if (decision.status == FSW_OK) decision.candidate = s->scratch.best[0];
    return decision;
}
#endif

INLINE fsw_decision decide(const fsw_design *d, fsw_state *s, natural m, natural q, const fsw_real *x,
                           const fsw_real *reference, const fsw_real *w, const uint8_t *present, fsw_real *costs)
{
#if FSW_MAX_MOVES > 0
    if (PLANS(d)) return plan(d, s, x, reference, w, present, costs);
#endif
    return choose(d, s, m, q, x, reference, w, present, costs);
}

fsw_decision fsw_decide(const fsw_design *design, fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                        const fsw_real *disturbance, fsw_real *costs)
{
    const fsw_design *d = KNOWN(design);
    const natural m = INPUTS(d), q = OUTPUTS(d), candidates = CANDIDATES(d);
    fsw_real x[FSW_MAX_STATES], w[FSW_MAX_DISTURBANCES];
    uint8_t outliers = s->outliers;
    w[0] = 0; /* there may be no disturbance, but its address is handed on */
    const fsw_status status = observe(d, s, measured, reference, reference_size(d, q), disturbance, x, w, &outliers);
    fsw_decision decision = {status, (uint16_t)candidates, 0, 0, 0};
    if (status == FSW_OK || status == FSW_COASTING) {
        const uint8_t *present = issued(d, s, m, 1);
        decision = SINGLE(d) ? decide(d, s, 1, 1, x, reference, w, present, costs)
                             : decide(d, s, m, q, x, reference, w, present, costs);
        if (decision.status == FSW_OK) decision.status = status;
    } else
        for (natural i = 0; costs && i < candidates; i++) costs[i] = infinity();
    return decision;
}

/* ---- Step ---- */

/* Put the command into the delay line, start or run down each dwell, and look up the levels. */
INLINE void issue(const fsw_design *d, fsw_state *s, natural m, const uint8_t *command, const uint8_t *present,
                  fsw_real *u)
{
    const fsw_real *levels = d->levels;
    const uint32_t *dwell = d->dwell;
    uint8_t *row = s->line + s->head * m;
    s->head = (uint16_t)(s->head + 1u == ROWS(d) ? 0 : s->head + 1u);
    for (natural j = 0; j < m; j++) {
        const uint8_t level = command[j];
        if (level != present[j])
            s->wait[j] = dwell[level] - 1;
        else if (s->wait[j] > 0)
            s->wait[j]--;
        row[j] = level;
        u[j] = levels[level];
        levels += d->level_count[j];
        dwell += d->level_count[j];
    }
}

INLINE fsw_decision step(const fsw_design *d, fsw_state *s, natural m, natural q, const fsw_real *measured,
                         const fsw_real *reference, const fsw_real *disturbance, fsw_real *u)
{
    const natural candidates = CANDIDATES(d);
    const fsw_status status = observe_and_count(d, s, measured, reference, reference_size(d, q), disturbance);
    fsw_decision decision = {status, (uint16_t)candidates, 0, 0, 0};
    const uint8_t *present = issued(d, s, m, 1), *command = present;
    if (status == FSW_OK || status == FSW_COASTING) {
        decision = decide(d, s, m, q, s->x, reference, s->w, present, 0);
#if FSW_MAX_MOVES > 0
        if (PLANS(d)) {
            s->planned = decision.status == FSW_OK;
            for (natural k = 0; s->planned && k < d->horizon->moves; k++) s->plan[k] = s->scratch.best[k];
        }
#endif
        if (decision.status == FSW_OK) decision.status = status;
        if (decision.candidate < candidates) command = d->candidate + decision.candidate * m;
    } else if (status == FSW_SAFE)
        command = d->safe;
    issue(d, s, m, command, present, u);
    return decision;
}

fsw_decision fsw_step(const fsw_design *design, fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                      const fsw_real *disturbance, fsw_real *u)
{
    const fsw_design *d = KNOWN(design);
    return SINGLE(d) ? step(d, s, 1, 1, measured, reference, disturbance, u)
                     : step(d, s, INPUTS(d), OUTPUTS(d), measured, reference, disturbance, u);
}

/* ---- Other periods ---- */

/* A period with a command that nobody here chose. */
static void follow(const fsw_design *d, fsw_state *s, const fsw_real *measured, const fsw_real *disturbance,
                   const uint8_t *command, fsw_real *u)
{
    const natural m = INPUTS(d), n = STATES(d);
    if (measured) {
        (void)observe_and_count(d, s, measured, 0, 0, disturbance);
    } else if (s->primed) {
        fsw_real next[FSW_MAX_STATES];
        coast(d, s, next);
        if (usable(next, n)) take(s->x, next, n);
    }
    issue(d, s, m, command, issued(d, s, m, 1), u);
#if FSW_MAX_MOVES > 0
    s->planned = 0;
#endif
}

fsw_validity fsw_track(const fsw_design *design, fsw_state *s, const fsw_real *measured, const fsw_real *disturbance,
                       const uint8_t *command)
{
    const fsw_design *d = KNOWN(design);
    fsw_real u[FSW_MAX_INPUTS];
    if (!indices_valid(d, command, 1)) return FSW_INCONSISTENT;
    follow(d, s, measured, disturbance, command, u);
    return FSW_VALID;
}

void fsw_missed(const fsw_design *design, fsw_state *s, uint16_t periods)
{
    const fsw_design *d = KNOWN(design);
    fsw_real u[FSW_MAX_INPUTS];
    for (; periods > 0; periods--) follow(d, s, 0, 0, issued(d, s, INPUTS(d), 1), u);
}

void fsw_safe(const fsw_design *design, fsw_state *s, const fsw_real *measured, const fsw_real *disturbance,
              fsw_real *u)
{
    const fsw_design *d = KNOWN(design);
    follow(d, s, measured, disturbance, d->safe, u);
}
