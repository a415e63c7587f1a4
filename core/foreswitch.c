/* In the order data meets it: checks, delay line, observation, prediction, choice, step. */
#include "foreswitch.h"

/* ---- Checks ---- */

static int indices_valid(const fsw_design *d, const uint8_t *command, uint32_t commands)
{
    for (uint32_t i = 0; i < commands; i++)
        for (uint16_t j = 0; j < d->inputs; j++)
            if (command[i * d->inputs + j] >= d->level_count[j]) return 0;
    return 1;
}

static fsw_validity check(const fsw_design *d)
{
    if (d->states > FSW_MAX_STATES || d->inputs > FSW_MAX_INPUTS || d->outputs > FSW_MAX_OUTPUTS ||
        d->disturbances > FSW_MAX_DISTURBANCES || (uint32_t)d->rows * d->inputs > FSW_MAX_LINE)
        return FSW_TOO_LARGE;
    if (d->states == 0 || d->inputs == 0 || d->outputs == 0 || d->order == 0 || d->candidates == 0)
        return FSW_INCONSISTENT;
    uint32_t level = 0;
    for (uint16_t j = 0; j < d->inputs; j++) {
        if (d->level_count[j] == 0 || d->holds[j] == 0 || d->pending[j] >= d->rows) return FSW_INCONSISTENT;
        for (uint8_t i = 0; i < d->level_count[j]; i++)
            if (d->dwell[level++] == 0) return FSW_INCONSISTENT;
    }
    if (!indices_valid(d, d->safe, 1) || !indices_valid(d, d->candidate, d->candidates)) return FSW_INCONSISTENT;
    return FSW_VALID;
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
    return FSW_VALID;
}

/* ---- Delay line: the commands issued 1 .. rows periods ago, a ring of rows ---- */

fsw_validity fsw_preload(const fsw_design *d, fsw_state *s, const uint8_t *line, const uint32_t *wait)
{
    if (!indices_valid(d, line, d->rows)) return FSW_INCONSISTENT;
    for (uint32_t i = 0; i < (uint32_t)d->rows * d->inputs; i++) s->line[i] = line[i];
    for (uint16_t j = 0; j < d->inputs; j++) s->wait[j] = wait[j];
    s->head = 0;
    return FSW_VALID;
}

const uint8_t *fsw_issued(const fsw_design *d, const fsw_state *s, uint16_t age)
{
    const uint32_t row = (uint32_t)s->head + (s->head < age ? d->rows : 0u) - age;
    return s->line + row * d->inputs;
}

static void push(const fsw_design *d, fsw_state *s, const uint8_t *command)
{
    const uint8_t *present = fsw_issued(d, s, 1);
    uint8_t *row = s->line + (uint32_t)s->head * d->inputs;
    const uint32_t *dwell = d->dwell;
    for (uint16_t j = 0; j < d->inputs; j++) {
        if (command[j] != present[j])
            s->wait[j] = dwell[command[j]] - 1;
        else if (s->wait[j] > 0)
            s->wait[j]--;
        dwell += d->level_count[j];
        row[j] = command[j];
    }
    s->head = (uint16_t)(s->head + 1 == d->rows ? 0 : s->head + 1);
}

/* ---- Observation: what is used in place of what was measured ---- */

/* Copy, small values to zero; 0 if any is NaN, infinite or huge. */
static int take(fsw_real *to, const fsw_real *from, uint16_t count)
{
    int good = 1;
    for (uint16_t i = 0; i < count; i++) {
        const fsw_real v = from[i], size = v < 0 ? -v : v;
        good &= size <= FSW_HUGE;
        to[i] = size < FSW_TINY ? 0 : v;
    }
    return good;
}

/* The model's state one period after s->x. */
static void coast(const fsw_design *d, const fsw_state *s, fsw_real *x)
{
    const uint16_t n = d->states;
    for (uint16_t i = 0; i < n; i++) {
        fsw_real sum = d->model_c[i];
        for (uint16_t l = 0; l < n; l++) sum += d->model_x[i * n + l] * s->x[l];
        for (uint16_t l = 0; l < d->disturbances; l++) sum += d->model_w[i * d->disturbances + l] * s->w[l];
        x[i] = sum;
    }
    const fsw_real *levels = d->levels;
    for (uint16_t j = 0; j < d->inputs; j++) {
        const uint16_t age = d->pending[j];
        const fsw_real older = levels[fsw_issued(d, s, (uint16_t)(age + 1))[j]];
        const fsw_real newer = age > 0 ? levels[fsw_issued(d, s, age)[j]] : 0;
        for (uint16_t i = 0; i < n; i++) x[i] += d->model_old[j * n + i] * older + d->model_new[j * n + i] * newer;
        levels += d->level_count[j];
    }
}

/* Fill x and w with what the prediction shall start from. */
static fsw_status observe(const fsw_design *d, const fsw_state *s, const fsw_real *measured,
                          const fsw_real *disturbance, fsw_real *x, fsw_real *w)
{
    fsw_status status = FSW_OK;
    if (d->disturbances > 0 && !take(w, disturbance, d->disturbances)) {
        status = FSW_COASTING;
        for (uint16_t i = 0; i < d->disturbances; i++) w[i] = s->w[i];
    }
    if (!take(x, measured, d->states)) {
        status = FSW_COASTING;
        coast(d, s, x);
        if (!s->primed || !take(x, x, d->states)) {
            status = FSW_HELD;
            for (uint16_t i = 0; i < d->states; i++) x[i] = s->x[i];
        }
    }
    return status;
}

static int finite(const fsw_real *values, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        const fsw_real v = values[i];
        if (!((v < 0 ? -v : v) <= FSW_HUGE)) return 0;
    }
    return 1;
}

/* ---- Prediction: the free part of the sliding variable, and the tail ---- */

static void predict(const fsw_design *d, const fsw_state *s, const fsw_real *x, const fsw_real *reference,
                    const fsw_real *w, fsw_real *free, fsw_real *tail)
{
    const uint16_t n = d->states, q = d->outputs, p = d->disturbances, order = d->order;
    const fsw_real *levels = d->levels;
    for (uint16_t j = 0; j < d->inputs; j++) {
        fsw_real rest = 0;
        if (d->rest_reference) {
            rest = d->rest_offset[j];
            for (uint16_t o = 0; o < q; o++) rest += d->rest_reference[j * q + o] * reference[o * order];
            for (uint16_t i = 0; i < p; i++) rest += d->rest_disturbance[j * p + i] * w[i];
            const fsw_real low = levels[0], high = levels[d->level_count[j] - 1];
            rest = rest < low ? low : rest > high ? high : rest;
        }
        tail[j] = rest;
        levels += d->level_count[j];
    }
    for (uint16_t o = 0; o < q; o++) {
        fsw_real sum = d->offset[o];
        for (uint16_t i = 0; i < n; i++) sum += d->state_row[o * n + i] * x[i];
        for (uint16_t i = 0; i < p; i++) sum += d->disturbance_row[o * p + i] * w[i];
        for (uint16_t i = 0; i < order; i++) sum -= d->reference_row[o * order + i] * reference[o * order + i];
        for (uint16_t j = 0; j < d->inputs; j++) sum += d->total_row[o * d->inputs + j] * tail[j];
        free[o] = sum;
    }
    const fsw_real *table = d->pending_table;
    for (uint16_t j = 0; j < d->inputs; j++) {
        const uint32_t stride = (uint32_t)d->level_count[j] * q;
        uint16_t row = s->head;
        for (uint16_t age = 1; age <= d->pending[j]; age++) {
            row = (uint16_t)(row == 0 ? d->rows - 1 : row - 1);
            const fsw_real *effect = table + (uint32_t)s->line[(uint32_t)row * d->inputs + j] * q;
            for (uint16_t o = 0; o < q; o++) free[o] += effect[o];
            table += stride;
        }
    }
}

/* ---- Choice ---- */

static fsw_real infinity(void)
{
    const fsw_real huge = FSW_HUGE;
    return huge * huge;
}

/* The candidate's cost, infinite where it would break a running dwell. */
static fsw_real evaluate(const fsw_design *d, const fsw_state *s, const uint8_t *command, const uint8_t *present,
                         const fsw_real *free, const fsw_real *tail)
{
    const uint16_t q = d->outputs;
    fsw_real slide[FSW_MAX_OUTPUTS], cost = 0;
    for (uint16_t o = 0; o < q; o++) slide[o] = free[o];
    const fsw_real *levels = d->levels, *row = d->hold_row;
    const uint32_t *dwell = d->dwell;
    for (uint16_t j = 0; j < d->inputs; j++) {
        const uint8_t level = command[j];
        uint32_t hold = dwell[level];
        if (level == present[j])
            hold = s->wait[j] > 1 ? s->wait[j] : 1;
        else if (s->wait[j] > 0)
            return infinity();
        else
            cost += d->switch_cost[j];
        const uint32_t last = (hold < d->holds[j] ? hold : d->holds[j]) - 1u;
        const fsw_real shift = levels[level] - tail[j];
        for (uint16_t o = 0; o < q; o++) slide[o] += row[last * q + o] * shift;
        levels += d->level_count[j];
        dwell += d->level_count[j];
        row += (uint32_t)d->holds[j] * q;
    }
    for (uint16_t o = 0; o < q; o++) cost += d->half_weight[o] * slide[o] * slide[o];
    return cost;
}

static int same(const uint8_t *a, const uint8_t *b, uint16_t count)
{
    for (uint16_t j = 0; j < count; j++)
        if (a[j] != b[j]) return 0;
    return 1;
}

/* Smallest cost; equal costs: the present command, then the lower index. NaN never wins. */
static void choose(const fsw_design *d, const fsw_state *s, const fsw_real *free, const fsw_real *tail,
                   fsw_decision *best, fsw_real *costs)
{
    const uint8_t *present = fsw_issued(d, s, 1);
    for (uint16_t i = 0; i < d->candidates; i++) {
        const uint8_t *command = d->candidate + (uint32_t)i * d->inputs;
        const fsw_real cost = evaluate(d, s, command, present, free, tail);
        if (costs) costs[i] = cost;
        if (cost < best->cost || (cost == best->cost && same(command, present, d->inputs))) {
            best->cost = cost;
            best->candidate = i;
        }
    }
    best->nodes = d->candidates;
}

/* From an observation (x, w) to a decision. */
static fsw_decision decide(const fsw_design *d, const fsw_state *s, fsw_status observed, const fsw_real *x,
                           const fsw_real *reference, const fsw_real *w, fsw_real *costs)
{
    fsw_decision decision = {FSW_OK, 0, 0, 0};
    decision.status = finite(reference, (uint32_t)d->outputs * d->order) ? observed : FSW_HELD;
    decision.candidate = d->candidates;
    if (decision.status != FSW_OK && d->bad_limit > 0 && (uint32_t)s->bad + 1 >= d->bad_limit)
        decision.status = FSW_SAFE;
    if (decision.status == FSW_HELD || decision.status == FSW_SAFE) {
        for (uint16_t i = 0; costs && i < d->candidates; i++) costs[i] = infinity();
        return decision;
    }
    fsw_real free[FSW_MAX_OUTPUTS], tail[FSW_MAX_INPUTS];
    predict(d, s, x, reference, w, free, tail);
    decision.cost = infinity();
    choose(d, s, free, tail, &decision, costs);
    return decision;
}

fsw_decision fsw_decide(const fsw_design *d, const fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                        const fsw_real *disturbance, fsw_real *costs)
{
    fsw_real x[FSW_MAX_STATES], w[FSW_MAX_DISTURBANCES];
    const fsw_status observed = observe(d, s, measured, disturbance, x, w);
    return decide(d, s, observed, x, reference, w, costs);
}

/* ---- Step ---- */

fsw_decision fsw_step(const fsw_design *d, fsw_state *s, const fsw_real *measured, const fsw_real *reference,
                      const fsw_real *disturbance, fsw_real *u)
{
    fsw_real x[FSW_MAX_STATES], w[FSW_MAX_DISTURBANCES];
    const fsw_status observed = observe(d, s, measured, disturbance, x, w);
    const fsw_decision decision = decide(d, s, observed, x, reference, w, 0);

    for (uint16_t i = 0; i < d->states; i++) s->x[i] = x[i];
    for (uint16_t i = 0; i < d->disturbances; i++) s->w[i] = w[i];
    if (observed != FSW_HELD) s->primed = 1;
    if (decision.status == FSW_OK)
        s->bad = 0;
    else if (s->bad < UINT16_MAX)
        s->bad++;

    const uint8_t *command = fsw_issued(d, s, 1);
    if (decision.status == FSW_SAFE)
        command = d->safe;
    else if (decision.candidate < d->candidates)
        command = d->candidate + (uint32_t)decision.candidate * d->inputs;
    push(d, s, command);

    command = fsw_issued(d, s, 1);
    const fsw_real *levels = d->levels;
    for (uint16_t j = 0; j < d->inputs; j++) {
        u[j] = levels[command[j]];
        levels += d->level_count[j];
    }
    return decision;
}
