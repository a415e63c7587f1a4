/* The core against golden vectors, and at its edges: `test_core FILE.json ...` prints what failed and a count. */
#include "json.h"

#include "foreswitch.h"

/* ---- Counting ---- */

static unsigned passed, failed;
static const char *subject = "";

#define CHECK(condition, ...)                                                                                          \
    do {                                                                                                               \
        if (condition)                                                                                                 \
            passed++;                                                                                                  \
        else {                                                                                                         \
            failed++;                                                                                                  \
            printf("%s:%d: %s: %s: ", __FILE__, __LINE__, subject, #condition);                                        \
            printf(__VA_ARGS__);                                                                                       \
            printf("\n");                                                                                              \
        }                                                                                                              \
    } while (0)

/* ---- Designs from files ---- */

#define NUMBERS(type)                                                                                                  \
    static const type *list_##type(const json *object, const char *key)                                                \
    {                                                                                                                  \
        const json *node = json_get(object, key);                                                                      \
        if (node->kind == JSON_NULL) return NULL;                                                                      \
        const size_t count = json_numbers(node, NULL);                                                                 \
        double *wide = calloc(count + 1, sizeof *wide);                                                                \
        type *list = calloc(count + 1, sizeof *list);                                                                  \
        json_numbers(node, wide);                                                                                      \
        for (size_t i = 0; i < count; i++) list[i] = (type)wide[i];                                                    \
        free(wide);                                                                                                    \
        return list;                                                                                                   \
    }
NUMBERS(uint8_t)
NUMBERS(uint16_t)
NUMBERS(uint32_t)
NUMBERS(fsw_real)

static uint16_t size(const json *object, const char *key) { return (uint16_t)json_get(object, key)->number; }

#if FSW_MAX_MOVES > 0
static const fsw_horizon *horizon_from(const json *file, const fsw_design *d)
{
    const json *j = json_find(file, "horizon");
    if (!j) return NULL;
    const fsw_horizon read = {
        .steps = size(j, "steps"),
        .moves = size(j, "moves"),
        .states = size(j, "states"),
        .inputs = d->inputs,
        .outputs = d->outputs,
        .candidates = d->candidates,
        .disturbances = d->disturbances,
        .order = size(j, "order"),
        .lead = size(j, "lead"),
        .terminal = size(j, "terminal"),
        .tail = (uint8_t)size(j, "tail"),
        .exclusive = (uint8_t)size(j, "exclusive"),
        .dominance = (uint8_t)size(j, "dominance"),
        .patience = (uint32_t)json_get(j, "patience")->number,
        .node_budget = (uint32_t)json_get(j, "node_budget")->number,
        .far = (fsw_real)json_get(j, "far")->number,
        .start_row = list_fsw_real(j, "start_row"),
        .start_disturbance = list_fsw_real(j, "start_disturbance"),
        .start_offset = list_fsw_real(j, "start_offset"),
        .pending_table = list_fsw_real(j, "pending_table"),
        .drift = list_fsw_real(j, "drift"),
        .drift_disturbance = list_fsw_real(j, "drift_disturbance"),
        .row_disturbance = list_fsw_real(j, "row_disturbance"),
        .row_offset = list_fsw_real(j, "row_offset"),
        .reference_row = list_fsw_real(j, "reference_row"),
        .terminal_reference = list_fsw_real(j, "terminal_reference"),
        .terminal_disturbance = list_fsw_real(j, "terminal_disturbance"),
        .terminal_offset = list_fsw_real(j, "terminal_offset"),
        .F = list_fsw_real(j, "F"),
        .G = list_fsw_real(j, "G"),
        .S = list_fsw_real(j, "S"),
        .root_weight = list_fsw_real(j, "root_weight"),
        .T = list_fsw_real(j, "T"),
        .move_weight = list_fsw_real(j, "move_weight"),
        .lift = list_fsw_real(j, "lift"),
        .lift_centre = list_fsw_real(j, "lift_centre"),
        .last_value = list_fsw_real(j, "last_value"),
        .hull = list_fsw_real(j, "hull"),
        .value = list_fsw_real(j, "value"),
        .effect = list_fsw_real(j, "effect"),
        .gain = list_fsw_real(j, "gain"),
        .gain_previous = list_fsw_real(j, "gain_previous"),
        .pull = list_fsw_real(j, "pull"),
        .place = list_fsw_real(j, "place"),
        .from_place = list_fsw_real(j, "from_place"),
        .metric = list_fsw_real(j, "metric"),
        .from_metric = list_fsw_real(j, "from_metric"),
        .switch_cost = list_fsw_real(j, "switch_cost"),
        .level = list_uint8_t(j, "level"),
        .dwell = list_uint16_t(j, "dwell"),
    };
    fsw_horizon *kept = malloc(sizeof *kept);
    *kept = read;
    return kept;
}
#else
static const struct fsw_horizon *horizon_from(const json *file, const fsw_design *d)
{
    (void)d;
    return (const struct fsw_horizon *)json_find(file, "horizon"); /* whatever it is, it must not be read */
}
#endif

static fsw_design design_from(const json *file)
{
    const json *j = json_get(file, "design");
    fsw_design design = {
        .states = size(j, "states"),
        .inputs = size(j, "inputs"),
        .outputs = size(j, "outputs"),
        .disturbances = size(j, "disturbances"),
        .order = size(j, "order"),
        .rows = size(j, "rows"),
        .candidates = size(j, "candidates"),
        .bad_limit = size(j, "bad_limit"),
        .measured = size(j, "measured"),
        .loads = size(j, "loads"),
        .gate_limit = size(j, "gate_limit"),
        .level_count = list_uint8_t(j, "level_count"),
        .levels = list_fsw_real(j, "levels"),
        .candidate = list_uint8_t(j, "candidate"),
        .safe = list_uint8_t(j, "safe"),
        .state_row = list_fsw_real(j, "state_row"),
        .disturbance_row = list_fsw_real(j, "disturbance_row"),
        .offset = list_fsw_real(j, "offset"),
        .reference_row = list_fsw_real(j, "reference_row"),
        .half_weight = list_fsw_real(j, "half_weight"),
        .pending = list_uint16_t(j, "pending"),
        .pending_table = list_fsw_real(j, "pending_table"),
        .holds = list_uint16_t(j, "holds"),
        .hold_row = list_fsw_real(j, "hold_row"),
        .total_row = list_fsw_real(j, "total_row"),
        .rest_reference = list_fsw_real(j, "rest_reference"),
        .rest_disturbance = list_fsw_real(j, "rest_disturbance"),
        .rest_offset = list_fsw_real(j, "rest_offset"),
        .dwell = list_uint32_t(j, "dwell"),
        .switch_cost = list_fsw_real(j, "switch_cost"),
        .model_x = list_fsw_real(j, "model_x"),
        .model_old = list_fsw_real(j, "model_old"),
        .model_new = list_fsw_real(j, "model_new"),
        .model_w = list_fsw_real(j, "model_w"),
        .model_c = list_fsw_real(j, "model_c"),
        .gain = list_fsw_real(j, "gain"),
        .output_row = list_fsw_real(j, "output_row"),
        .output_offset = list_fsw_real(j, "output_offset"),
        .start_row = list_fsw_real(j, "start_row"),
        .start_offset = list_fsw_real(j, "start_offset"),
        .gate = list_fsw_real(j, "gate"),
    };
    design.horizon = horizon_from(file, &design);
    return design;
}

static void start(const json *file, const fsw_design *design, fsw_state *state)
{
    CHECK(fsw_init(design, state) == FSW_VALID, "init");
    CHECK(fsw_preload(design, state, list_uint8_t(file, "line"), list_uint32_t(file, "wait")) == FSW_VALID, "preload");
}

/* The bytes in use: the delay line is longer than most designs need, and its rest is never written. */
static int same_state(const fsw_design *d, const fsw_state *a, const fsw_state *b)
{
    const size_t used = (size_t)((const char *)a->line - (const char *)a) + (size_t)d->rows * d->inputs;
    return memcmp(a, b, used) == 0;
}

/* ---- Golden vectors ---- */

static fsw_status status_named(const char *name)
{
    static const char *const names[] = {"OK", "COASTING", "HELD", "SAFE"};
    for (int i = 0; i < 4; i++)
        if (strcmp(name, names[i]) == 0) return (fsw_status)i;
    json_fail("unknown status", name);
    return FSW_OK;
}

static void check_costs(const json *expected, const fsw_real *costs, unsigned step)
{
    if (expected->kind == JSON_NULL) return;
    double largest = 0;
    for (const json *c = expected->first; c; c = c->next)
        if (isfinite(c->number) && c->number > largest) largest = c->number;
    const double tolerance = largest * (sizeof(fsw_real) == sizeof(double) ? 1e-9 : 1e-3);
    size_t i = 0;
    for (const json *c = expected->first; c; c = c->next, i++) {
        const double cost = (double)costs[i];
        CHECK(isfinite(c->number) ? fabs(cost - c->number) <= tolerance : cost == c->number,
              "step %u, candidate %u: %g, not %g", step, (unsigned)i, cost, c->number);
    }
}

/* The estimate [x; load], where the file has one. */
static void check_estimate(const json *expected, const fsw_design *d, const fsw_state *state, unsigned step)
{
    if (!expected || expected->kind == JSON_NULL) return;
    const double tolerance = sizeof(fsw_real) == sizeof(double) ? 1e-9 : 1e-3;
    uint16_t i = 0;
    for (const json *e = expected->first; e; e = e->next, i++) {
        const uint16_t load = (uint16_t)(d->disturbances - d->loads + i - d->states);
        const double value = (double)(i < d->states ? state->x[i] : state->w[load]);
        CHECK(fabs(value - e->number) <= tolerance * (1 + fabs(e->number)), "step %u, entry %u: %g, not %g", step,
              (unsigned)i, value, e->number);
    }
    CHECK(i == d->states + d->loads, "step %u: %u entries", step, (unsigned)i);
}

static void golden(const json *file)
{
    static fsw_state state, before;
    const fsw_design d = design_from(file);
    fsw_real *costs = calloc(d.candidates, sizeof *costs), *u = calloc(d.inputs, sizeof *u);
    unsigned step = 0;
    start(file, &d, &state);
    for (const json *s = json_get(file, "steps")->first; s; s = s->next, step++) {
        const fsw_real *x = list_fsw_real(s, "x"), *reference = list_fsw_real(s, "reference"),
                       *w = list_fsw_real(s, "w");
        const fsw_real *expected = list_fsw_real(s, "u");
        const fsw_status status = status_named(json_get(s, "status")->text);

        before = state;
        const fsw_decision planned = fsw_decide(&d, &state, x, reference, w, costs);
        CHECK(same_state(&d, &state, &before), "step %u: decide changed the state", step);
        check_costs(json_get(s, "costs"), costs, step);

        const fsw_decision taken = fsw_step(&d, &state, x, reference, w, u);
        CHECK(taken.status == status, "step %u: status %d, not %d", step, (int)taken.status, (int)status);
        CHECK(planned.status == taken.status && planned.candidate == taken.candidate && planned.nodes == taken.nodes &&
                  !(planned.cost < taken.cost) && !(planned.cost > taken.cost),
              "step %u: decide foretold otherwise", step);
        check_estimate(json_find(s, "estimate"), &d, &state, step);
        for (uint16_t j = 0; j < d.inputs; j++) {
            CHECK(!(u[j] < expected[j]) && !(u[j] > expected[j]), "step %u, input %u: %g, not %g", step, (unsigned)j,
                  (double)u[j], (double)expected[j]);
        }
    }
    CHECK(step >= 3, "only %u steps", step);
}

/* ---- Periods in which fsw_step does not choose: on every design ---- */

#define IS(u, level) (!((u) < (level)) && !((u) > (level)))

/* What a plan leaves behind is no part of what tracking keeps true. */
static void forget_plan(fsw_state *state)
{
#if FSW_MAX_MOVES > 0
    state->planned = 0;
    memset(state->plan, 0, sizeof state->plan);
#else
    (void)state;
#endif
}

/* Whoever is told each command that was issued, and what was measured, ends where the one who chose them is. */
static void tracking(const json *file, const fsw_design *d)
{
    static fsw_state chooser, follower, before;
    fsw_real *u = calloc(d->inputs, sizeof *u);
    uint8_t *wrong = calloc(d->inputs, 1);
    unsigned step = 0;
    start(file, d, &chooser);
    follower = chooser;
    wrong[d->inputs - 1] = d->level_count[d->inputs - 1];
    for (const json *s = json_get(file, "steps")->first; s; s = s->next, step++) {
        const fsw_real *x = list_fsw_real(s, "x"), *w = list_fsw_real(s, "w");
        (void)fsw_step(d, &chooser, x, list_fsw_real(s, "reference"), w, u);
        before = follower;
        CHECK(fsw_track(d, &follower, x, w, wrong) == FSW_INCONSISTENT && same_state(d, &follower, &before),
              "step %u: a level that is none", step);
        CHECK(fsw_track(d, &follower, x, w, fsw_issued(d, &chooser, 1)) == FSW_VALID, "step %u", step);
        before = chooser;
        forget_plan(&before);
        forget_plan(&follower);
        CHECK(same_state(d, &follower, &before), "step %u: another state", step);
    }
    CHECK(chooser.bad_total >= chooser.bad, "%u in all", (unsigned)chooser.bad_total);
}

/* Missed calls are the command in force, tracked without a measurement; nothing counts as bad. */
static void missing(const json *file, const fsw_design *d)
{
    static fsw_state state, other;
    const json *steps = json_get(file, "steps")->first;
    fsw_real *u = calloc(d->inputs, sizeof *u);
    uint8_t *present = calloc(d->inputs, 1);
    start(file, d, &state);
    for (const json *s = steps; s; s = s->next)
        (void)fsw_step(d, &state, list_fsw_real(s, "x"), list_fsw_real(s, "reference"), list_fsw_real(s, "w"), u);
    const uint16_t periods[] = {0, 1, 2, 7, 300};
    for (int i = 0; i < 5; i++) {
        other = state;
        for (uint16_t k = 0; k < periods[i]; k++) {
            memcpy(present, fsw_issued(d, &other, 1), d->inputs);
            CHECK(fsw_track(d, &other, NULL, NULL, present) == FSW_VALID, "period %u", (unsigned)k);
        }
        const uint32_t bad = state.bad_total;
        fsw_missed(d, &state, periods[i]);
        forget_plan(&other);
        forget_plan(&state);
        CHECK(same_state(d, &state, &other) && state.bad_total == bad, "%u periods", (unsigned)periods[i]);
        for (uint16_t j = 0; j < d->inputs; j++)
            CHECK(periods[i] < 300 || state.wait[j] == 0, "input %u waits", (unsigned)j);
    }
    fsw_missed(d, &state, UINT16_MAX);
    CHECK(state.head < d->rows, "head %u", (unsigned)state.head);
}

/* The safe level breaks a dwell at once, starts its own, and is remembered like any command. */
static void fault(const json *file, const fsw_design *d)
{
    static fsw_state state;
    const json *s = json_get(file, "steps")->first;
    fsw_real *u = calloc(d->inputs, sizeof *u);
    uint8_t *line = calloc((size_t)d->rows * d->inputs, 1);
    uint32_t *wait = calloc(d->inputs, sizeof *wait);
    for (uint16_t j = 0; j < d->inputs; j++) {
        wait[j] = UINT32_MAX;                                             /* as if it were never free again */
        line[(d->rows - 1) * d->inputs + j] = (uint8_t)(d->safe[j] == 0); /* not the safe level */
    }
    CHECK(fsw_init(d, &state) == FSW_VALID && fsw_preload(d, &state, line, wait) == FSW_VALID, "preload");
    const fsw_real *x = list_fsw_real(s, "x"), *w = list_fsw_real(s, "w"), *reference = list_fsw_real(s, "reference");
    for (int i = 0; i < 3; i++) {
        (void)fsw_step(d, &state, x, reference, w, u);
        for (uint16_t j = 0; j < d->inputs; j++)
            CHECK(fsw_issued(d, &state, 1)[j] == (d->safe[j] == 0) && state.wait[j] == UINT32_MAX - 1 - (uint32_t)i,
                  "step %d: a dwell of 2^32 - 1 periods", i);
    }
    fsw_safe(d, &state, x, w, u);
    const fsw_real *levels = d->levels;
    const uint32_t *dwell = d->dwell;
    for (uint16_t j = 0; j < d->inputs; j++) {
        CHECK(IS(u[j], levels[d->safe[j]]) && fsw_issued(d, &state, 1)[j] == d->safe[j], "input %u", (unsigned)j);
        CHECK(state.wait[j] == dwell[d->safe[j]] - 1, "input %u waits %u", (unsigned)j, (unsigned)state.wait[j]);
        CHECK(d->rows < 2 || fsw_issued(d, &state, 2)[j] == (d->safe[j] == 0), "the command before");
        for (uint8_t i = 0; i < d->level_count[j]; i++) {
            CHECK(fsw_dwell_left(d, j, i, 0) == dwell[i], "level %u", (unsigned)i);
            CHECK(fsw_dwell_left(d, j, i, dwell[i] - 1) == 1, "level %u", (unsigned)i);
            CHECK(fsw_dwell_left(d, j, i, UINT32_MAX) == 0, "level %u", (unsigned)i);
        }
        levels += d->level_count[j];
        dwell += d->level_count[j];
    }
    fsw_safe(d, &state, NULL, NULL, u);
    const uint32_t least = d->dwell[d->safe[0]];
    CHECK(state.wait[0] == (least > 2 ? least - 2 : 0), "running down");
}

/* Switched on in the middle of a dwell: free exactly when it has run out. */
static void waking(const json *file, const fsw_design *d)
{
    static fsw_state state;
    fsw_real *u = calloc(d->inputs, sizeof *u);
    uint8_t *line = calloc((size_t)d->rows * d->inputs, 1);
    uint32_t *wait = calloc(d->inputs, sizeof *wait);
    wait[0] = 5;
    CHECK(fsw_init(d, &state) == FSW_VALID && fsw_preload(d, &state, line, wait) == FSW_VALID, "preload");
    unsigned step = 0;
    for (const json *s = json_get(file, "steps")->first; s && step < 5; s = s->next, step++) {
        (void)fsw_step(d, &state, list_fsw_real(s, "x"), list_fsw_real(s, "reference"), list_fsw_real(s, "w"), u);
        CHECK(fsw_issued(d, &state, 1)[0] == 0 && state.wait[0] == 4 - step, "step %u", step);
    }
}

/* Counters stay at their ends. */
static void saturation(const json *file, const fsw_design *d)
{
    static fsw_state state;
    const json *s = json_get(file, "steps")->first;
    fsw_real *u = calloc(d->inputs, sizeof *u), *bad = calloc(d->measured, sizeof *bad);
    for (uint16_t i = 0; i < d->measured; i++) bad[i] = (fsw_real)NAN;
    start(file, d, &state);
    state.bad = UINT16_MAX - 2;
    state.bad_total = UINT32_MAX - 2;
    for (int i = 0; i < 5; i++) {
        const fsw_status status =
            fsw_step(d, &state, bad, list_fsw_real(s, "reference"), list_fsw_real(s, "w"), u).status;
        CHECK(status == (d->bad_limit > 0 ? FSW_SAFE : FSW_HELD), "step %d: status %d", i, (int)status);
    }
    CHECK(state.bad == UINT16_MAX && state.bad_total == UINT32_MAX, "%u and %u", (unsigned)state.bad,
          (unsigned)state.bad_total);
}

static int is_candidate(const fsw_design *d, const uint8_t *command)
{
    for (uint16_t c = 0; c < d->candidates; c++)
        if (memcmp(command, d->candidate + c * d->inputs, d->inputs) == 0) return 1;
    return 0;
}

/* An operator may do what the controller must not; from there it finds back to its own. */
static void forbidden_by_hand(const json *file, const fsw_design *d)
{
    static fsw_state state;
    const json *s = json_get(file, "steps")->first;
    fsw_real *u = calloc(d->inputs, sizeof *u);
    uint8_t *command = calloc(d->inputs, 1);
    const fsw_real *x = list_fsw_real(s, "x"), *w = list_fsw_real(s, "w");
    start(file, d, &state);
    while (is_candidate(d, command)) {
        uint16_t j = 0;
        while (j < d->inputs && ++command[j] == d->level_count[j]) command[j++] = 0;
        if (j == d->inputs) return; /* all are allowed */
    }
    CHECK(fsw_track(d, &state, x, w, command) == FSW_VALID, "forbidden, but done");
    int steps = 0;
    do {
        const fsw_decision decision = fsw_step(d, &state, x, list_fsw_real(s, "reference"), w, u);
        CHECK(decision.status == (decision.candidate < d->candidates ? FSW_OK : FSW_HELD), "step %d", steps);
    } while (++steps < 10 && !is_candidate(d, fsw_issued(d, &state, 1)));
    CHECK(steps < 10, "still forbidden");
}

static void other_periods(const json *file, const fsw_design *d)
{
    tracking(file, d);
    missing(file, d);
    fault(file, d);
    waking(file, d);
    saturation(file, d);
    forbidden_by_hand(file, d);
}

/* ---- Edges, on the paper's controller: two states, one input, no disturbance ---- */

static fsw_status step_status(const fsw_design *d, fsw_state *state, fsw_real x0, fsw_real x1, fsw_real *u)
{
    const fsw_real x[] = {x0, x1}, reference[] = {1000, 0};
    return fsw_step(d, state, x, reference, NULL, u).status;
}

static void bad_values(const fsw_design *d, fsw_state *state)
{
    const fsw_real big = sizeof(fsw_real) == sizeof(double) ? (fsw_real)1e308 : (fsw_real)3e38;
    const fsw_real bad[] = {(fsw_real)NAN, (fsw_real)INFINITY, -(fsw_real)INFINITY, big, -big};
    fsw_real u;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    for (int i = 0; i < 5; i++) {
        CHECK(step_status(d, state, bad[i], 0, &u) == FSW_HELD, "before any good one, value %d", i);
        CHECK(IS(u, d->levels[d->safe[0]]), "value %d: %g", i, (double)u);
    }
    CHECK(step_status(d, state, 10, 20, &u) == FSW_OK && IS(u, 1), "the first good one: %g", (double)u);
    for (int i = 0; i < 5; i++)
        for (int entry = 0; entry < 2; entry++) {
            CHECK(step_status(d, state, entry ? 10 : bad[i], entry ? bad[i] : 20, &u) == FSW_COASTING, "value %d", i);
            CHECK(IS(u, 1), "value %d: %g", i, (double)u);
            CHECK(isfinite((double)state->x[0]) && isfinite((double)state->x[1]), "value %d in the state", i);
        }
    CHECK(step_status(d, state, 10, 20, &u) == FSW_OK && state->bad == 0, "bad %u", (unsigned)state->bad);

    const fsw_real x[] = {10, 20};
    for (int i = 0; i < 5; i++) {
        const fsw_real reference[] = {bad[i], 0};
        const fsw_decision decision = fsw_step(d, state, x, reference, NULL, &u);
        CHECK(decision.status == FSW_HELD && decision.candidate == d->candidates && decision.nodes == 0, "reference %d",
              i);
        CHECK(IS(u, 1), "reference %d: the present command is %g", i, (double)u);
    }
    CHECK(step_status(d, state, 10, 20, &u) == FSW_OK, "after bad references");
}

static void denormal_values(const fsw_design *d, fsw_state *state)
{
    const fsw_real tiny = sizeof(fsw_real) == sizeof(double) ? (fsw_real)1e-310 : (fsw_real)1e-40;
    fsw_real u;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    CHECK(step_status(d, state, tiny, -tiny, &u) == FSW_OK, "a measurement");
    CHECK(IS(state->x[0], 0) && IS(state->x[1], 0), "%g %g", (double)state->x[0], (double)state->x[1]);
    for (int i = 0; i < 20000; i++) (void)step_status(d, state, (fsw_real)NAN, 0, &u); /* x[1] decays */
    CHECK(IS(state->x[1], 0) || fabs((double)state->x[1]) > (double)FSW_TINY, "%g", (double)state->x[1]);
}

static void restart(const fsw_design *d, fsw_state *state)
{
    static fsw_state other;
    fsw_real u, v;
    uint8_t line[64];
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    for (int i = 0; i < 17; i++) (void)step_status(d, state, (fsw_real)(960 + 3 * i), 500, &u);

    other = *state; /* plain data */
    for (int i = 0; i < 17; i++) {
        (void)step_status(d, state, (fsw_real)(950 + 5 * i), 500, &u);
        (void)step_status(d, &other, (fsw_real)(950 + 5 * i), 500, &v);
        CHECK(IS(u, v), "step %d of a copied state: %g, not %g", i, (double)v, (double)u);
    }

    for (uint16_t i = 0; i < d->rows; i++) line[i] = *fsw_issued(d, state, (uint16_t)(d->rows - i));
    CHECK(fsw_init(d, &other) == FSW_VALID && fsw_preload(d, &other, line, state->wait) == FSW_VALID, "preload");
    for (uint16_t i = 0; i < d->rows; i++)
        CHECK(*fsw_issued(d, &other, (uint16_t)(d->rows - i)) == line[i], "row %u", (unsigned)i);
    for (int i = 0; i < 17; i++) {
        (void)step_status(d, state, (fsw_real)(950 + 5 * i), 500, &u);
        (void)step_status(d, &other, (fsw_real)(950 + 5 * i), 500, &v);
        CHECK(IS(u, v), "step %d after a restart: %g, not %g", i, (double)v, (double)u);
    }

    const fsw_state before = *state;
    line[d->rows - 1] = d->level_count[0];
    CHECK(fsw_preload(d, state, line, state->wait) == FSW_INCONSISTENT, "an index out of range");
    CHECK(same_state(d, state, &before), "a refused preload changed the state");
}

static void counting_bad_samples(const fsw_design *paper, fsw_state *state)
{
    const uint16_t limits[] = {0, 1, 3, UINT16_MAX};
    for (int i = 0; i < 4; i++) {
        fsw_design d = *paper;
        fsw_real u = 0;
        d.bad_limit = limits[i];
        CHECK(fsw_init(&d, state) == FSW_VALID, "init");
        CHECK(step_status(&d, state, 0, 0, &u) == FSW_OK && IS(u, 1), "on: %g", (double)u);
        uint32_t wrong = 0;
        for (uint32_t bad = 1; bad <= 70000; bad++) {
            const fsw_status expected = d.bad_limit > 0 && bad >= d.bad_limit ? FSW_SAFE : FSW_COASTING;
            const fsw_status status = step_status(&d, state, (fsw_real)NAN, 0, &u);
            wrong += status != expected || (status == FSW_SAFE && !IS(u, 0));
        }
        CHECK(wrong == 0, "limit %u: %u of 70000 samples", (unsigned)d.bad_limit, (unsigned)wrong);
        CHECK(state->bad == UINT16_MAX, "limit %u: counted %u", (unsigned)d.bad_limit, (unsigned)state->bad);
        CHECK(step_status(&d, state, 0, 0, &u) == FSW_OK && state->bad == 0 && IS(u, 1), "recovery: %g", (double)u);
    }
}

/* A model that explodes cannot stand in for a measurement: the command is held. */
static void coasting_beyond_all_numbers(const fsw_design *paper, fsw_state *state)
{
    const fsw_real explosion[] = {(fsw_real)1e20, 0, 0, (fsw_real)1e20};
    fsw_design d = *paper;
    fsw_real u;
    d.model_x = explosion;
    CHECK(fsw_init(&d, state) == FSW_VALID, "init");
    CHECK(step_status(&d, state, 1, 1, &u) == FSW_OK && IS(u, 1), "on: %g", (double)u);
    fsw_status status = FSW_COASTING;
    for (int i = 0; i < 40; i++) {
        status = step_status(&d, state, (fsw_real)NAN, 0, &u);
        CHECK(IS(u, 0) || IS(u, 1), "step %d: %g", i, (double)u);
        CHECK(isfinite((double)state->x[0]), "step %d", i);
    }
    CHECK(status == FSW_HELD, "status %d", (int)status);
    CHECK(step_status(&d, state, 1, 1, &u) == FSW_OK, "recovery");
}

/* Costs beyond all numbers: the command stays an allowed one. */
static void overflowing_costs(const fsw_design *d, fsw_state *state)
{
    const fsw_real large = sizeof(fsw_real) == sizeof(double) ? (fsw_real)1e280 : (fsw_real)1e28;
    fsw_real u;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    CHECK(step_status(d, state, 0, 0, &u) == FSW_OK && IS(u, 1), "on: %g", (double)u);
    for (int i = 0; i < 3; i++) {
        CHECK(step_status(d, state, large, -large, &u) == FSW_HELD, "step %d", i);
        CHECK(IS(u, 1), "step %d: the present command is %g", i, (double)u);
    }
    CHECK(step_status(d, state, 2000, 0, &u) == FSW_OK && IS(u, 0), "afterwards: %g", (double)u);
}

static void refused_designs(const fsw_design *good, fsw_state *state)
{
    static const uint8_t beyond[] = {2, 2, 2, 2, 2, 2, 2, 2}, none[] = {0};
    static const uint16_t late[] = {6}, zero[] = {0};
    static const uint32_t never[] = {0, 1};
    static const fsw_real falling[] = {0, -1}, equal[] = {1, 1}, endless[] = {0, (fsw_real)INFINITY},
                          unknown[] = {(fsw_real)NAN, 1};
    fsw_design d = *good;
#define REFUSED(field, value, why)                                                                                     \
    do {                                                                                                               \
        d = *good;                                                                                                     \
        d.field = value;                                                                                               \
        CHECK(fsw_init(&d, state) == why, #field " = " #value);                                                        \
    } while (0)
    REFUSED(states, FSW_MAX_STATES + 1, FSW_TOO_LARGE);
    REFUSED(inputs, FSW_MAX_INPUTS + 1, FSW_TOO_LARGE);
    REFUSED(outputs, FSW_MAX_OUTPUTS + 1, FSW_TOO_LARGE);
    REFUSED(disturbances, FSW_MAX_DISTURBANCES + 1, FSW_TOO_LARGE);
    REFUSED(states, 0, FSW_INCONSISTENT);
    REFUSED(inputs, 0, FSW_INCONSISTENT);
    REFUSED(outputs, 0, FSW_INCONSISTENT);
    REFUSED(order, 0, FSW_INCONSISTENT);
    REFUSED(candidates, 0, FSW_INCONSISTENT);
    REFUSED(rows, 0, FSW_INCONSISTENT);
    REFUSED(rows, 5, FSW_INCONSISTENT);
    REFUSED(level_count, none, FSW_INCONSISTENT);
    REFUSED(safe, beyond, FSW_INCONSISTENT);
    REFUSED(candidate, beyond, FSW_INCONSISTENT);
    REFUSED(pending, late, FSW_INCONSISTENT);
    REFUSED(holds, zero, FSW_INCONSISTENT);
    REFUSED(dwell, never, FSW_INCONSISTENT);
    REFUSED(measured, 1, FSW_INCONSISTENT);
    REFUSED(loads, 1, FSW_INCONSISTENT);
    REFUSED(levels, falling, FSW_INCONSISTENT);
    REFUSED(levels, equal, FSW_INCONSISTENT);
    REFUSED(levels, endless, FSW_INCONSISTENT);
    REFUSED(levels, unknown, FSW_INCONSISTENT);
    REFUSED(half_weight, falling + 1, FSW_INCONSISTENT); /* negative */
    REFUSED(half_weight, unknown, FSW_INCONSISTENT);
    REFUSED(switch_cost, falling + 1, FSW_INCONSISTENT);
    REFUSED(level_count, NULL, FSW_INCONSISTENT);
    REFUSED(levels, NULL, FSW_INCONSISTENT);
    REFUSED(candidate, NULL, FSW_INCONSISTENT);
    REFUSED(safe, NULL, FSW_INCONSISTENT);
    REFUSED(state_row, NULL, FSW_INCONSISTENT);
    REFUSED(disturbance_row, NULL, FSW_INCONSISTENT);
    REFUSED(offset, NULL, FSW_INCONSISTENT);
    REFUSED(reference_row, NULL, FSW_INCONSISTENT);
    REFUSED(half_weight, NULL, FSW_INCONSISTENT);
    REFUSED(pending, NULL, FSW_INCONSISTENT);
    REFUSED(pending_table, NULL, FSW_INCONSISTENT);
    REFUSED(holds, NULL, FSW_INCONSISTENT);
    REFUSED(hold_row, NULL, FSW_INCONSISTENT);
    REFUSED(total_row, NULL, FSW_INCONSISTENT);
    REFUSED(rest_disturbance, NULL, FSW_INCONSISTENT);
    REFUSED(rest_offset, NULL, FSW_INCONSISTENT);
    REFUSED(dwell, NULL, FSW_INCONSISTENT);
    REFUSED(switch_cost, NULL, FSW_INCONSISTENT);
    REFUSED(model_x, NULL, FSW_INCONSISTENT);
    REFUSED(model_old, NULL, FSW_INCONSISTENT);
    REFUSED(model_new, NULL, FSW_INCONSISTENT);
    REFUSED(model_w, NULL, FSW_INCONSISTENT);
    REFUSED(model_c, NULL, FSW_INCONSISTENT);
    CHECK(fsw_init(good, state) == FSW_VALID, "the good one");
}

/* A delay line longer than its state: only where the limit is small enough for a design to exceed it. */
static void refused_line(const fsw_design *good, fsw_state *state)
{
    fsw_design d = *good;
    d.rows = UINT16_MAX;
    d.inputs = 2;
    CHECK((uint32_t)d.rows * d.inputs <= FSW_MAX_LINE || fsw_init(&d, state) == FSW_TOO_LARGE, "rows");
}

/* ---- Estimation: an output is measured ---- */

static void refused_estimators(const fsw_design *good, fsw_state *state)
{
    fsw_design d = *good;
    REFUSED(measured, 0, FSW_INCONSISTENT);
    REFUSED(measured, FSW_MAX_OUTPUTS + 1, FSW_TOO_LARGE);
    REFUSED(loads, (uint16_t)(good->disturbances + 1), FSW_INCONSISTENT);
    REFUSED(gate_limit, 256, FSW_INCONSISTENT);
    REFUSED(output_row, NULL, FSW_INCONSISTENT);
    REFUSED(output_offset, NULL, FSW_INCONSISTENT);
    REFUSED(start_row, NULL, FSW_INCONSISTENT);
    REFUSED(start_offset, NULL, FSW_INCONSISTENT);
    CHECK(fsw_init(good, state) == FSW_VALID, "the good one");
}

static fsw_status step_output(const fsw_design *d, fsw_state *state, fsw_real y, fsw_real *u)
{
    const fsw_real reference[] = {1000, 0};
    return fsw_step(d, state, &y, reference, NULL, u).status;
}

/* One output, one load: a jump is refused as often as the gate says, in between a sample is missing. */
static void outliers(const fsw_design *d, fsw_state *state)
{
    static fsw_state ahead;
    fsw_real u;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    CHECK(step_output(d, state, 100, &u) == FSW_OK && state->primed, "the first");
    for (uint16_t i = 0; i < d->gate_limit; i++) {
        CHECK(step_output(d, state, 900, &u) == FSW_COASTING && state->outliers == i + 1, "outlier %u", (unsigned)i);
        CHECK(step_output(d, state, (fsw_real)NAN, &u) == FSW_COASTING && state->outliers == i + 1,
              "NaN counts as none");
    }
    CHECK(step_output(d, state, 900, &u) == FSW_OK && state->outliers == d->gate_limit, "one too many");
    CHECK(state->x[0] > 150, "%g", (double)state->x[0]);
    ahead = *state;
    CHECK(step_output(d, &ahead, (fsw_real)NAN, &u) == FSW_COASTING, "a look ahead");
    CHECK(step_output(d, state, ahead.x[0], &u) == FSW_OK && state->outliers == 0, "inside again");
}

/* Usable, but what follows from it is not: as if nothing had been measured. */
static void corrections_beyond_all_numbers(const fsw_design *gated, fsw_state *state)
{
    fsw_design d = *gated;
    fsw_real u;
    d.gate = NULL;
    CHECK(fsw_init(&d, state) == FSW_VALID, "init");
    CHECK(step_output(&d, state, 100, &u) == FSW_OK, "the first");
    CHECK(step_output(&d, state, FSW_HUGE, &u) == FSW_COASTING, "huge");
    CHECK(fabs((double)state->x[0] - 100) < 1 && fabs((double)state->x[1]) < 1, "%g %g", (double)state->x[0],
          (double)state->x[1]);
    CHECK(step_output(&d, state, 100, &u) == FSW_OK && fabs((double)state->x[0] - 100) < 1, "recovery");
}

static void known_start(const fsw_design *d, fsw_state *state)
{
    static fsw_state other;
    const fsw_real x[] = {500, 100}, bad[] = {500, (fsw_real)INFINITY}, load[] = {(fsw_real)-0.1};
    fsw_real u, v;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    const fsw_state before = *state;
    CHECK(fsw_start(d, state, bad, load) == FSW_INCONSISTENT && same_state(d, state, &before), "an infinite state");
    CHECK(fsw_start(d, state, x, bad + 1) == FSW_INCONSISTENT && same_state(d, state, &before), "an infinite load");
    CHECK(fsw_start(d, state, x, load) == FSW_VALID, "a known state");
    CHECK(step_output(d, state, (fsw_real)NAN, &u) == FSW_COASTING, "open loop from there");
    CHECK(fsw_init(d, &other) == FSW_VALID && fsw_start(d, &other, x, load) == FSW_VALID, "again");
    CHECK(step_output(d, &other, (fsw_real)NAN, &v) == FSW_COASTING && same_state(d, state, &other), "twice the same");
    CHECK(IS(state->w[0], load[0]), "load %g", (double)state->w[0]);
}

/* ---- Long horizon: two states, one input, two levels, the state is measured ---- */

#if FSW_MAX_MOVES > 0
#define REFUSED_HORIZON(field, value, why)                                                                             \
    do {                                                                                                               \
        h = *good->horizon;                                                                                            \
        h.field = value;                                                                                               \
        CHECK(fsw_init(&d, state) == why, #field " = " #value);                                                        \
    } while (0)

static void refused_horizons(const fsw_design *good, fsw_state *state)
{
    static const uint8_t other[] = {1, 0};
    static const uint16_t never[] = {1, 0};
    static const fsw_real weights[] = {1, 1, 1, 1};
    fsw_design d = *good;
    fsw_horizon h;
    d.horizon = &h;
    REFUSED_HORIZON(steps, FSW_MAX_STEPS + 1, FSW_TOO_LARGE);
    REFUSED_HORIZON(moves, FSW_MAX_MOVES + 1, FSW_TOO_LARGE);
    REFUSED_HORIZON(states, FSW_HORIZON_STATES + 1, FSW_TOO_LARGE);
    REFUSED_HORIZON(candidates, FSW_HORIZON_CANDIDATES + 1, FSW_TOO_LARGE);
    REFUSED_HORIZON(terminal, FSW_HORIZON_STATES + 1, FSW_TOO_LARGE);
    REFUSED_HORIZON(steps, (uint16_t)(good->horizon->moves - 1), FSW_INCONSISTENT);
    REFUSED_HORIZON(moves, 0, FSW_INCONSISTENT);
    REFUSED_HORIZON(states, 0, FSW_INCONSISTENT);
    REFUSED_HORIZON(candidates, 1, FSW_INCONSISTENT);
    REFUSED_HORIZON(inputs, 2, FSW_INCONSISTENT);
    REFUSED_HORIZON(outputs, 2, FSW_INCONSISTENT);
    REFUSED_HORIZON(disturbances, 1, FSW_INCONSISTENT);
    REFUSED_HORIZON(order, 2, FSW_INCONSISTENT);
    REFUSED_HORIZON(lead, good->horizon->steps, FSW_INCONSISTENT);
    REFUSED_HORIZON(tail, 3, FSW_INCONSISTENT);
    REFUSED_HORIZON(tail, FSW_TAIL_REST, FSW_INCONSISTENT); /* there is no rest_reference */
    REFUSED_HORIZON(level, other, FSW_INCONSISTENT);
    REFUSED_HORIZON(level, NULL, FSW_INCONSISTENT);
    REFUSED_HORIZON(start_row, NULL, FSW_INCONSISTENT);
    REFUSED_HORIZON(metric, NULL, FSW_INCONSISTENT);
    REFUSED_HORIZON(terminal_reference, NULL, FSW_INCONSISTENT);
    REFUSED_HORIZON(pending_table, NULL, FSW_INCONSISTENT);
    REFUSED_HORIZON(dwell, never, FSW_INCONSISTENT);
    h = *good->horizon;
    h.lead = 1;
    h.root_weight = weights;
    CHECK(fsw_init(&d, state) == FSW_INCONSISTENT, "a weight where there is no reference");
    CHECK(fsw_init(good, state) == FSW_VALID, "the good one");
}

enum { AHEAD = 10 };

static fsw_decision step_ahead(const fsw_design *d, fsw_state *state, fsw_real x0, fsw_real x1, fsw_real wanted,
                               fsw_real *u)
{
    const fsw_real x[] = {x0, x1};
    fsw_real reference[AHEAD];
    for (int i = 0; i < AHEAD; i++) reference[i] = wanted;
    return fsw_step(d, state, x, reference, NULL, u);
}

/* Every budget: a command, a cost that does not rise, a bound that holds. */
static void budgets(const fsw_design *good, fsw_state *state)
{
    const fsw_real rounding = (fsw_real)(sizeof(fsw_real) == sizeof(double) ? 1e-9 : 1e-3);
    fsw_design d = *good;
    fsw_horizon h = *good->horizon;
    fsw_real u, before = (fsw_real)1e30;
    d.horizon = &h;
    CHECK(fsw_init(&d, state) == FSW_VALID, "init");
    const fsw_decision best = step_ahead(good, state, 40, 3000, 120, &u);
    CHECK(best.status == FSW_OK && !(best.gap > 0), "gap %g", (double)best.gap);
    unsigned cut = 0;
    for (uint32_t budget = 0; budget <= best.nodes + 1; budget++) {
        h.node_budget = budget;
        CHECK(fsw_init(&d, state) == FSW_VALID, "init");
        const fsw_decision decision = step_ahead(&d, state, 40, 3000, 120, &u);
        const fsw_real slack = rounding * best.cost;
        CHECK(decision.status == FSW_OK && decision.candidate < d.candidates, "budget %u", (unsigned)budget);
        CHECK(decision.cost <= before + slack, "budget %u: %g", (unsigned)budget, (double)decision.cost);
        CHECK(decision.gap >= 0 && decision.cost - decision.gap <= best.cost + slack, "budget %u", (unsigned)budget);
        CHECK(decision.cost >= best.cost - slack, "budget %u: better than the best", (unsigned)budget);
        before = decision.cost;
        cut += decision.gap > 0;
    }
    CHECK(cut > 5 && before <= best.cost * (1 + rounding), "%u cut", cut);
}

static void overflowing_plans(const fsw_design *d, fsw_state *state)
{
    const fsw_real large = sizeof(fsw_real) == sizeof(double) ? (fsw_real)1e280 : (fsw_real)1e28;
    const fsw_real x[] = {large, 0};
    fsw_real u, costs[2] = {-1, -1}, reference[AHEAD] = {0};
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    CHECK(step_ahead(d, state, 0, 0, 1000, &u).status == FSW_OK && IS(u, 1) && state->planned, "on: %g", (double)u);
    for (int i = 0; i < 3; i++) {
        const fsw_decision decision = fsw_decide(d, state, x, reference, NULL, costs);
        CHECK(decision.status == FSW_HELD && decision.candidate == d->candidates, "step %d", i);
        CHECK(isinf((double)costs[0]) && isinf((double)costs[1]), "step %d: %g, %g", i, (double)costs[0],
              (double)costs[1]);
        CHECK(step_ahead(d, state, large, -large, 0, &u).status == FSW_HELD && IS(u, 1) && !state->planned, "step %d",
              i);
    }
    CHECK(step_ahead(d, state, 2000, 0, 0, &u).status == FSW_OK && IS(u, 0), "afterwards: %g", (double)u);
}

static unsigned denormals(const fsw_real *values, size_t bytes)
{
    unsigned count = 0;
    for (size_t i = 0; i < bytes / sizeof *values; i++) count += fpclassify(values[i]) == FP_SUBNORMAL;
    return count;
}

/* Far below everything, and with a mode that reaches the denormal numbers within the horizon, the scratch holds none.
 */
static void decayed_plans(const fsw_design *good, fsw_state *state)
{
    const fsw_real tiny = sizeof(fsw_real) == sizeof(double) ? (fsw_real)1e-285 : (fsw_real)1e-28;
    fsw_design d = *good;
    fsw_horizon h = *good->horizon;
    const fsw_real F[] = {1, h.F[1], 0, (fsw_real)(sizeof(fsw_real) == sizeof(double) ? 1e-3 : 1e-2)};
    fsw_real u;
    d.horizon = &h;
    h.F = F;
    CHECK(fsw_init(&d, state) == FSW_VALID, "init");
    for (int i = 0; i < 1000; i++) {
        CHECK(step_ahead(&d, state, i % 2 ? tiny : 0, tiny * 1000, 0, &u).status == FSW_OK && IS(u, 0), "step %d", i);
        const fsw_horizon_scratch *s = &state->scratch;
        const unsigned count = denormals((const fsw_real *)s->target, sizeof s->target) +
                               denormals((const fsw_real *)s->error, sizeof s->error) +
                               denormals((const fsw_real *)s->u.tree.x, sizeof s->u.tree.x) +
                               denormals(s->last, sizeof s->last) + denormals(s->end, sizeof s->end);
        CHECK(count == 0, "step %d: %u denormals", i, count);
    }
}

/* A dwell that only the start knows of, and new commands under way, which no plan fits. */
static void preloaded_plans(const fsw_design *d, fsw_state *state)
{
    const uint8_t line[16] = {0};
    const uint32_t wait[] = {3};
    fsw_real u;
    CHECK(fsw_init(d, state) == FSW_VALID, "init");
    CHECK(step_ahead(d, state, 0, 0, 1000, &u).status == FSW_OK && IS(u, 1), "on");
    CHECK(state->planned && fsw_preload(d, state, line, wait) == FSW_VALID && !state->planned, "preload");
    for (int i = 0; i < 4; i++) {
        CHECK(step_ahead(d, state, 0, 0, 1000, &u).status == FSW_OK && IS(u, i == 3), "step %d: %g", i, (double)u);
    }
}
#endif

static void long_horizon(const json *file, const fsw_design *d, fsw_state *state)
{
#if FSW_MAX_MOVES > 0
    (void)file;
    if (d->gain || d->states != 2 || d->inputs != 1 || d->candidates != 2 || d->horizon->steps != AHEAD) return;
    refused_horizons(d, state);
    budgets(d, state);
    overflowing_plans(d, state);
    decayed_plans(d, state);
    preloaded_plans(d, state);
#else
    CHECK(fsw_init(d, state) == FSW_TOO_LARGE, "a core without a horizon");
    fsw_design endpoint = *d;
    endpoint.horizon = NULL;
    CHECK(fsw_init(&endpoint, state) != FSW_TOO_LARGE, "%s", json_get(file, "about")->text);
#endif
}

int main(int count, char **arguments)
{
    static fsw_state state;
    for (int i = 1; i < count; i++) {
        const json *file = json_file(arguments[i]);
        subject = arguments[i];
        const fsw_design d = design_from(file);
        if (d.horizon) long_horizon(file, &d, &state);
        if (d.horizon && FSW_MAX_MOVES == 0) continue;
        golden(file);
        other_periods(file, &d);
        if (d.horizon) continue;
        if (d.gain) refused_estimators(&d, &state);
        if (d.gain && d.states == 2 && d.loads == 1 && d.measured == 1) {
            outliers(&d, &state);
            corrections_beyond_all_numbers(&d, &state);
            known_start(&d, &state);
        }
        if (d.gain || d.states != 2 || d.inputs != 1 || d.disturbances != 0 || d.rows != 6) continue;
        bad_values(&d, &state);
        denormal_values(&d, &state);
        restart(&d, &state);
        counting_bad_samples(&d, &state);
        coasting_beyond_all_numbers(&d, &state);
        overflowing_costs(&d, &state);
        refused_designs(&d, &state);
        refused_line(&d, &state);
    }
    printf("%u passed, %u failed\n", passed, failed);
    return failed > 0 || passed == 0;
}
