/* In the order data meets it: checks, delay line, observation, options, prediction, choice, plan, step. */
#include "foreswitch.h"

/* Counts and subscripts in the machine's own width: 16 bits on an AVR, a register elsewhere. */
typedef uint_fast16_t natural;

/* The numbers of inputs m and outputs q are handed down, as constants where there is one of each: this common case
 * gets its own copy of the step, without the loops over them and with half the instructions. Where size counts, or
 * where the limits allow nothing else, there is one copy. */
#if FSW_MAX_INPUTS == 1 && FSW_MAX_OUTPUTS == 1
#define SINGLE(design) 1
#elif defined(__OPTIMIZE_SIZE__)
#define SINGLE(design) 0
#else
#define SINGLE(design) ((design)->inputs == 1 && (design)->outputs == 1)
#endif

#if defined(__GNUC__) && !defined(__OPTIMIZE_SIZE__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

INLINE fsw_real product(fsw_real sum, const fsw_real *a, const fsw_real *b, natural count)
{
    for (natural i = 0; i < count; i++) sum += a[i] * b[i];
    return sum;
}

/* ---- Checks ---- */

static int indices_valid(const fsw_design *d, const uint8_t *command, uint32_t commands)
{
    for (uint32_t i = 0; i < commands; i++)
        for (uint16_t j = 0; j < d->inputs; j++)
            if (command[i * d->inputs + j] >= d->level_count[j]) return 0;
    return 1;
}

#if FSW_MAX_MOVES > 0
static fsw_validity check_horizon(const fsw_design *d)
{
    const fsw_horizon *h = d->horizon;
    if (h->steps > FSW_MAX_STEPS || h->moves > FSW_MAX_MOVES || h->states > FSW_HORIZON_STATES ||
        h->candidates > FSW_HORIZON_CANDIDATES || h->terminal > h->states)
        return FSW_TOO_LARGE;
    if (h->inputs != d->inputs || h->outputs != d->outputs || h->candidates != d->candidates || h->order != d->order ||
        h->disturbances != d->disturbances || h->states == 0 || h->moves == 0 || h->moves > h->steps ||
        h->lead >= h->steps || h->tail > FSW_TAIL_HOLD || (h->tail == FSW_TAIL_REST && !d->rest_reference))
        return FSW_INCONSISTENT;
#ifdef FSW_FIXED
    if (h->states != FSW_HORIZON_STATES || h->candidates != FSW_HORIZON_CANDIDATES || d->inputs != FSW_MAX_INPUTS ||
        d->outputs != FSW_MAX_OUTPUTS)
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
    if (d->states == 0 || d->inputs == 0 || d->outputs == 0 || d->order == 0 || d->candidates == 0)
        return FSW_INCONSISTENT;
    if (d->gain ? d->measured == 0 || d->loads > d->disturbances || d->gate_limit > UINT8_MAX
                : d->measured != d->states || d->loads > 0)
        return FSW_INCONSISTENT;
    uint32_t level = 0;
    for (uint16_t j = 0; j < d->inputs; j++) {
        if (d->level_count[j] == 0 || d->pending[j] >= d->rows || (!d->horizon && d->holds[j] == 0))
            return FSW_INCONSISTENT;
        for (uint8_t i = 0; i < d->level_count[j]; i++)
            if (d->dwell[level++] == 0) return FSW_INCONSISTENT;
    }
    if (!indices_valid(d, d->safe, 1) || !indices_valid(d, d->candidate, d->candidates)) return FSW_INCONSISTENT;
#if FSW_MAX_MOVES > 0
    if (d->horizon) return check_horizon(d);
    return FSW_VALID;
#else
    return d->horizon ? FSW_TOO_LARGE : FSW_VALID;
#endif
}

fsw_validity fsw_init(const fsw_design *d, fsw_state *s)
{
    const fsw_validity validity = check(d);
    if (validity != FSW_VALID) return validity;
    for (uint16_t i = 0; i < FSW_MAX_STATES; i++) s->x[i] = 0;
    for (uint16_t i = 0; i < FSW_MAX_DISTURBANCES; i++) s->w[i] = 0;
    for (uint16_t j = 0; j < FSW_MAX_INPUTS; j++) s->wait[j] = 0;
    for (uint16_t i = 0; i < d->rows; i++)
        for (uint16_t j = 0; j < d->inputs; j++) s->line[i * d->inputs + j] = d->safe[j];
    s->head = 0;
    s->bad = 0;
    s->primed = 0;
    s->outliers = 0;
#if FSW_MAX_MOVES > 0
    s->planned = 0;
    for (uint16_t i = 0; i < FSW_MAX_MOVES; i++) s->plan[i] = 0;
#endif
    return FSW_VALID;
}

/* ---- Reference ---- */

INLINE natural reference_size(const fsw_design *d, natural q)
{
#if FSW_MAX_MOVES > 0
    if (d->horizon) return q * d->order * (natural)(d->horizon->steps - d->horizon->lead);
#endif
    return q * d->order;
}

uint32_t fsw_reference_size(const fsw_design *d) { return (uint32_t)reference_size(d, d->outputs); }

/* ---- Delay line: the commands issued 1 .. rows periods ago, a ring of rows ---- */

fsw_validity fsw_preload(const fsw_design *d, fsw_state *s, const uint8_t *line, const uint32_t *wait)
{
    if (!indices_valid(d, line, d->rows)) return FSW_INCONSISTENT;
    for (uint32_t i = 0; i < (uint32_t)d->rows * d->inputs; i++) s->line[i] = line[i];
    for (uint16_t j = 0; j < d->inputs; j++) s->wait[j] = wait[j];
    s->head = 0;
#if FSW_MAX_MOVES > 0
    s->planned = 0;
#endif
    return FSW_VALID;
}

const uint8_t *fsw_issued(const fsw_design *d, const fsw_state *s, uint16_t age)
{
    const uint32_t row = (uint32_t)s->head + (s->head < age ? d->rows : 0u) - age;
    return s->line + row * d->inputs;
}

/* ---- Observation: what is used in place of what was measured ---- */

/* No value NaN, infinite or huge. */
INLINE int usable(const fsw_real *values, natural count)
{
    for (natural i = 0; i < count; i++)
        if (!(values[i] <= FSW_HUGE && values[i] >= -FSW_HUGE)) return 0;
    return 1;
}

/* Copy, small values to zero. */
INLINE void take(fsw_real *to, const fsw_real *from, natural count)
{
    for (natural i = 0; i < count; i++) to[i] = from[i] < FSW_TINY && from[i] > -FSW_TINY ? 0 : from[i];
}

/* The model's state one period after s->x. */
static void coast(const fsw_design *d, const fsw_state *s, fsw_real *x)
{
    const natural n = d->states, p = d->disturbances;
    for (natural i = 0; i < n; i++) {
        const fsw_real sum = product(d->model_c[i], d->model_x + i * n, s->x, n);
        x[i] = product(sum, d->model_w + i * p, s->w, p);
    }
    const fsw_real *levels = d->levels;
    for (natural j = 0; j < d->inputs; j++) {
        const uint16_t age = d->pending[j];
        const fsw_real older = levels[fsw_issued(d, s, (uint16_t)(age + 1))[j]];
        const fsw_real newer = age > 0 ? levels[fsw_issued(d, s, age)[j]] : 0;
        for (natural i = 0; i < n; i++) x[i] += d->model_old[j * n + i] * older + d->model_new[j * n + i] * newer;
        levels += d->level_count[j];
    }
}

/* Use `state`, and what is usable of the rest. */
static fsw_status settle(const fsw_design *d, const fsw_state *s, fsw_status status, const fsw_real *state,
                         const fsw_real *reference, const fsw_real *disturbance, fsw_real *x, fsw_real *w)
{
    const natural p = (natural)(d->disturbances - d->loads);
    const int told = usable(disturbance, p);
    take(x, state, d->states);
    take(w, told ? disturbance : s->w, p);
    if (status == FSW_OK && !told) status = FSW_COASTING;
    if (!usable(reference, reference_size(d, d->outputs))) status = FSW_HELD;
    if (status != FSW_OK && d->bad_limit > 0 && (uint32_t)s->bad + 1 >= d->bad_limit) status = FSW_SAFE;
    return status;
}

/* As observe, where something is not usable. */
static fsw_status replace(const fsw_design *d, const fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                          const fsw_real *disturbance, fsw_real *x, fsw_real *w)
{
    fsw_status status = FSW_COASTING;
    fsw_real next[FSW_MAX_STATES];
    if (!usable(measured, d->states)) {
        coast(d, s, next);
        measured = next;
        if (!s->primed || !usable(next, d->states)) {
            measured = s->x;
            status = FSW_HELD;
        }
    }
    return settle(d, s, status, measured, reference, disturbance, x, w);
}

/* Move the expected [x; load] by what it misses of a usable y; 0 if y is an outlier or leads beyond all numbers. */
static int correct(const fsw_design *d, const fsw_real *y, const fsw_real *expected, fsw_real *corrected,
                   uint8_t *outliers)
{
    const natural n = d->states, z = d->measured, size = n + d->loads;
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
                           const fsw_real *disturbance, fsw_real *x, fsw_real *w, uint8_t *outliers)
{
    const natural n = d->states, z = d->measured, loads = d->loads, p = d->disturbances - loads;
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
    return settle(d, s, status, best, reference, disturbance, x, w);
}

/* Fill x and w, which may be s->x and s->w, with what the prediction shall start from. */
INLINE fsw_status observe(const fsw_design *d, const fsw_state *s, natural q, const fsw_real *measured,
                          const fsw_real *reference, const fsw_real *disturbance, fsw_real *x, fsw_real *w,
                          uint8_t *outliers)
{
    const natural n = d->states, p = d->disturbances;
    if (d->gain) return estimate(d, s, measured, reference, disturbance, x, w, outliers);
    if (!usable(measured, n) || !usable(disturbance, p) || !usable(reference, reference_size(d, q)))
        return replace(d, s, measured, reference, disturbance, x, w);
    take(x, measured, n);
    take(w, disturbance, p);
    return FSW_OK;
}

fsw_validity fsw_start(const fsw_design *d, fsw_state *s, const fsw_real *x, const fsw_real *w)
{
    if (!usable(x, d->states) || !usable(w, d->disturbances)) return FSW_INCONSISTENT;
    take(s->x, x, d->states);
    take(s->w, w, d->disturbances);
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
    const natural p = d->disturbances;
    fsw_real level = d->rest_offset[j];
    for (natural o = 0; o < q; o++) level += d->rest_reference[j * q + o] * reference[o * d->order];
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
        now->tail = d->rest_reference ? clipped_rest(d, q, j, reference, w, levels) : 0;
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
    const natural ring = d->rows * m;
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
    const natural n = d->states, p = d->disturbances, order = d->order;
    for (natural o = 0; o < q; o++) {
        fsw_real sum = product(d->offset[o], d->state_row + o * n, x, n);
        sum = product(sum, d->disturbance_row + o * p, w, p);
        for (natural i = 0; i < order; i++) sum -= d->reference_row[o * order + i] * reference[o * order + i];
        for (natural j = 0; j < m; j++) sum += d->total_row[o * m + j] * options[j].tail;
        free[o] = pending(d, s, m, q, d->pending_table + o, sum);
    }
}

/* ---- Choice ---- */

static fsw_real infinity(void)
{
    const fsw_real huge = FSW_HUGE;
    return huge * huge;
}

/* A smaller sliding variable counts as zero: its square would be denormal, and slow. */
#ifdef FSW_SINGLE
#define ON_SURFACE 1e-17f
#else
#define ON_SURFACE 1e-140
#endif

/* The candidate's cost, infinite where it would break a running dwell. */
INLINE fsw_real evaluate(const fsw_design *d, natural m, natural q, const option *options, const uint8_t *command,
                         const fsw_real *free)
{
    fsw_real slide[FSW_MAX_OUTPUTS], cost = 0;
    for (natural j = 0; j < m; j++) {
        const option *now = options + j;
        const uint8_t level = command[j];
        uint32_t hold = now->keep;
        if (level != now->present) {
            if (now->locked) return infinity();
            cost += now->switch_cost;
            hold = now->dwell[level];
        }
        const fsw_real *effect = now->hold_row + ((hold < now->most ? hold : now->most) - 1) * q;
        const fsw_real shift = now->levels[level] - now->tail;
        for (natural o = 0; o < q; o++) slide[o] = (j == 0 ? free[o] : slide[o]) + effect[o] * shift;
    }
    for (natural o = 0; o < q; o++)
        if (!(slide[o] < ON_SURFACE && slide[o] > -ON_SURFACE)) cost += d->half_weight[o] * slide[o] * slide[o];
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
    const natural candidates = d->candidates;
    const uint8_t *command = d->candidate;
    natural best = candidates;
    for (natural i = 0; i < candidates; i++, command += m) {
        const fsw_real cost = evaluate(d, m, q, options, command, free);
        if (costs) costs[i] = cost;
        if (cost < least || (cost == least && same(command, present, m))) {
            least = cost;
            best = i;
        }
    }
    /* where every cost overflows there is nothing to choose by */
    const fsw_decision decision = {least - least == 0 ? FSW_OK : FSW_HELD, (uint16_t)best, (uint32_t)candidates, least,
                                   0};
    return decision;
}

/* ---- Plan: a long horizon in place of prediction and choice ---- */

#if FSW_MAX_MOVES > 0
/* The candidate that a command is, or `candidates` if it is none. */
static natural find(const fsw_design *d, const uint8_t *command)
{
    natural c = 0;
    while (c < d->candidates && !same(command, d->candidate + c * d->inputs, d->inputs)) c++;
    return c;
}

/* The horizon's state at the end of its first step, moves left out. */
INLINE void arrive(const fsw_design *d, const fsw_state *s, natural n, natural m, const fsw_real *x, const fsw_real *w,
                   fsw_real *z)
{
    const fsw_horizon *h = d->horizon;
    const natural p = d->disturbances;
    for (natural i = 0; i < n; i++) {
        z[i] = product(h->start_offset[i], h->start_row + i * d->states, x, d->states);
        z[i] = product(z[i], h->start_disturbance + i * p, w, p);
    }
    const fsw_real *effect = h->pending_table;
    for (natural j = 0; j < m; j++) {
        natural at = s->head * m + j;
        for (natural age = d->pending[j]; age > 0; age--, effect += d->level_count[j] * n) {
            at = (at < m ? at + d->rows * m : at) - m;
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
    const natural n = h->states, m = d->inputs, q = d->outputs, C = d->candidates;
    fsw_decision decision = {FSW_HELD, (uint16_t)C, 0, 0, 0};
    fsw_real z[FSW_HORIZON_STATES], tail[FSW_MAX_INPUTS];
    if (SINGLE(d) && n == 2)
        arrive(d, s, 2, 1, x, w, z);
    else
        arrive(d, s, n, m, x, w, z);
    const fsw_real *levels = d->levels, *final = reference + (h->steps - h->lead - 1u) * q * d->order;
    for (natural j = 0; j < m; j++, levels += d->level_count[j - 1])
        tail[j] = h->tail == FSW_TAIL_REST ? clipped_rest(d, q, j, final, w, levels) : 0;
    const natural from = find(d, present);
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
    for (natural k = 0; k < h->moves; k++) warm[k] = s->plan[k + 1u < h->moves ? k + 1u : k];
    const fsw_horizon_answer answer =
        fsw_horizon_search(h, &s->scratch, (uint8_t)from, s->wait, s->planned ? warm : 0, (uint8_t)C, h->node_budget);
    decision.nodes = answer.nodes;
    if (!answer.found) return decision;
    decision.cost = fsw_horizon_cost(h, &s->scratch, (uint8_t)from, s->scratch.best);
    decision.gap = answer.gap;
    decision.status = decision.cost - decision.cost == 0 ? FSW_OK : FSW_HELD;
    if (decision.status == FSW_OK) decision.candidate = s->scratch.best[0];
    return decision;
}
#endif

fsw_decision fsw_decide(const fsw_design *d, fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                        const fsw_real *disturbance, fsw_real *costs)
{
    fsw_real x[FSW_MAX_STATES], w[FSW_MAX_DISTURBANCES];
    fsw_decision decision = {FSW_OK, d->candidates, 0, 0, 0};
    uint8_t outliers = s->outliers;
    const fsw_status status = observe(d, s, d->outputs, measured, reference, disturbance, x, w, &outliers);
    const uint8_t *present = fsw_issued(d, s, 1);
    if (status == FSW_OK || status == FSW_COASTING) {
#if FSW_MAX_MOVES > 0
        if (d->horizon)
            decision = plan(d, s, x, reference, w, present, costs);
        else
#endif
            decision = SINGLE(d) ? choose(d, s, 1, 1, x, reference, w, present, costs)
                                 : choose(d, s, d->inputs, d->outputs, x, reference, w, present, costs);
        if (decision.status == FSW_OK) decision.status = status;
    } else {
        for (natural i = 0; costs && i < d->candidates; i++) costs[i] = infinity();
        decision.status = status;
    }
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
    s->head = (uint16_t)(s->head + 1 == d->rows ? 0 : s->head + 1);
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
    const fsw_status status = observe(d, s, q, measured, reference, disturbance, s->x, s->w, &s->outliers);
    if (status == FSW_OK)
        s->bad = 0;
    else if (s->bad < UINT16_MAX)
        s->bad++;
    if (status == FSW_OK || usable(measured, d->measured)) s->primed = 1;

    fsw_decision decision = {status, d->candidates, 0, 0, 0};
    const uint8_t *present = s->line + ((s->head > 0 ? s->head : d->rows) - 1u) * m, *command = present;
    if (status == FSW_OK || status == FSW_COASTING) {
#if FSW_MAX_MOVES > 0
        if (d->horizon) {
            decision = plan(d, s, s->x, reference, s->w, present, 0);
            s->planned = decision.status == FSW_OK;
            for (natural k = 0; s->planned && k < d->horizon->moves; k++) s->plan[k] = s->scratch.best[k];
        } else
#endif
            decision = choose(d, s, m, q, s->x, reference, s->w, present, 0);
        if (decision.status == FSW_OK) decision.status = status;
        if (decision.candidate < d->candidates) command = d->candidate + decision.candidate * m;
    } else if (status == FSW_SAFE)
        command = d->safe;
    issue(d, s, m, command, present, u);
    return decision;
}

fsw_decision fsw_step(const fsw_design *d, fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                      const fsw_real *disturbance, fsw_real *u)
{
    return SINGLE(d) ? step(d, s, 1, 1, measured, reference, disturbance, u)
                     : step(d, s, d->inputs, d->outputs, measured, reference, disturbance, u);
}
