/* Any bytes as a design and as what happens to it: either fsw_init refuses, or everything after runs clean and commands
 * stay levels that respect dwell. Arrays are exactly as long as the sizes say, so that a sanitizer sees the first entry
 * too many. With libFuzzer, or with -DREPLAY a main that replays known inputs; fuzz.py drives both. Host only. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "foreswitch.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t count);

#define MUST(condition)                                                                                                \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                            \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

/* ---- Bytes; after the last come zeros ---- */

static const uint8_t *at, *end;

static unsigned byte(void) { return at < end ? *at++ : 0; }
static unsigned word(void)
{
    const unsigned high = byte();
    return high << 8 | byte();
}
static uint32_t wide(void)
{
    const uint32_t high = word();
    return high << 16 | word();
}

/* Mostly within what a limit allows, sometimes just beyond, rarely anything. */
static uint16_t size(unsigned least, unsigned limit)
{
    const unsigned b = byte();
    return (uint16_t)(b == 255 ? word() : b == 254 ? limit + 1 : b == 253 ? 0 : least + b % (limit - least + 1));
}

static fsw_real value(void)
{
    static const double special[] = {0,     -0.0,   1,      -1,    1e-3,   0.5,    2,     1e3,
                                     1e-40, 1e-310, 1e29,   -1e29, 1e31,   3e38,   1e200, 1e300,
                                     1e289, -1e290, 1.0001, 1e-20, -1e-20, 1e-145, 1e15,  -1e15};
    union {
        uint32_t narrow;
        uint64_t wide;
        fsw_real value;
    } raw;
    const unsigned b = byte();
    if (b < 160) return (fsw_real)((int)b - 80) / 16;
    if (b < 240) {
        const double v = special[b % (sizeof special / sizeof *special)];
        return sizeof(fsw_real) == sizeof(float) && (v > 3e38 || v < -3e38) ? (fsw_real)3e38 : (fsw_real)v;
    }
    raw.wide = 0;
    if (sizeof(fsw_real) == sizeof(float))
        raw.narrow = wide();
    else
        raw.wide = (uint64_t)wide() << 32 | wide();
    return raw.value;
}

/* ---- Arrays that live until the next design ---- */

enum { MOST = 96, LARGEST = 1 << 20 };
static void *held[MOST];
static unsigned holding;
static size_t total;

/* Null now and then where a table may not be missing. */
static void *room(size_t count, size_t width)
{
    total += count * width;
    MUST(holding < MOST);
    return total > LARGEST ? NULL : (held[holding++] = malloc(count * width + (count * width == 0)));
}

static void let_go(void)
{
    while (holding > 0) free(held[--holding]);
    total = 0;
}

static const fsw_real *reals(size_t count)
{
    fsw_real *list = room(count, sizeof *list);
    for (size_t i = 0; list && i < count; i++) list[i] = value();
    return list;
}

/* Ascending, where `honest`. */
static const fsw_real *ascending(size_t count, int honest)
{
    fsw_real *list = room(count, sizeof *list);
    for (size_t i = 0; list && i < count; i++) list[i] = honest ? (fsw_real)i - 1 : value();
    return list;
}

static const fsw_real *positive(size_t count, int honest)
{
    fsw_real *list = room(count, sizeof *list);
    for (size_t i = 0; list && i < count; i++) {
        list[i] = value();
        if (honest && !(list[i] >= 0)) list[i] = 1;
    }
    return list;
}

/* Level indices of so many commands. */
static const uint8_t *commands(size_t count, size_t inputs, const uint8_t *level_count, int honest)
{
    uint8_t *list = room(count * inputs, 1);
    for (size_t i = 0; list && i < count; i++)
        for (size_t j = 0; j < inputs; j++) {
            const unsigned b = byte();
            list[i * inputs + j] = (uint8_t)(honest && level_count[j] > 0 ? b % level_count[j] : b);
        }
    return list;
}

static const uint16_t *words(size_t count, unsigned least, unsigned span, int honest)
{
    uint16_t *list = room(count, sizeof *list);
    for (size_t i = 0; list && i < count; i++)
        list[i] = (uint16_t)(honest && span > 0 ? least + byte() % span : size(0, 8));
    return list;
}

/* ---- Design ---- */

#if FSW_MAX_MOVES > 0
static fsw_horizon horizon;

static void make_horizon(const fsw_design *d, int honest, size_t pending)
{
    fsw_horizon *h = &horizon;
    memset(h, 0, sizeof *h);
    h->steps = size(1, FSW_MAX_STEPS);
    h->moves = size(1, honest && h->steps < FSW_MAX_MOVES && h->steps > 0 ? h->steps : FSW_MAX_MOVES);
    h->states = size(1, FSW_HORIZON_STATES);
    h->inputs = honest ? d->inputs : size(0, FSW_MAX_INPUTS);
    h->outputs = honest ? d->outputs : size(0, FSW_MAX_OUTPUTS);
    h->candidates = honest ? d->candidates : size(0, FSW_HORIZON_CANDIDATES);
    h->disturbances = honest ? d->disturbances : size(0, FSW_MAX_DISTURBANCES);
    h->order = honest ? d->order : size(0, 3);
    h->lead = honest ? 0 : size(0, 2);
    h->terminal = (uint16_t)(byte() % 3);
    h->tail = (uint8_t)(honest ? (d->rest_reference ? byte() % 3 : 2 * (byte() % 2)) : byte());
    h->exclusive = (uint8_t)(byte() & 1);
    h->dominance = (uint8_t)(byte() & 1);
    h->patience = byte() < 128 ? byte() : wide();
    h->node_budget = word(); /* more would only take time */
    const size_t n = h->states, m = h->inputs, q = h->outputs, p = h->disturbances, C = h->candidates, K = h->moves,
                 N = h->steps, T = h->terminal;
    h->start_row = reals(n * d->states);
    h->start_disturbance = reals(n * p);
    h->start_offset = reals(n);
    h->pending_table = reals(pending * n);
    h->drift = reals(n);
    h->drift_disturbance = reals(n * p);
    h->row_disturbance = reals(q * p);
    h->row_offset = reals(q);
    h->reference_row = reals(q * h->order);
    h->terminal_reference = reals(T * q);
    h->terminal_disturbance = reals(T * p);
    h->terminal_offset = reals(T);
    h->far = value();
    h->F = reals(n * n);
    h->G = reals(n * m);
    h->S = reals(q * n);
    h->root_weight = reals(N * q);
    h->T = reals(T * n);
    h->move_weight = reals(m);
    h->lift = reals(K * m);
    h->lift_centre = reals(K * m);
    h->last_value = reals((n + m) * (n + m));
    h->hull = reals(2 * m);
    h->value = reals(C * m);
    h->effect = reals(C * n);
    h->gain = reals(K * m * n);
    h->gain_previous = reals(K * m * m);
    h->pull = reals(K * m * m);
    h->place = reals(K * C * m);
    h->from_place = reals(K * C * m);
    h->metric = reals(K * (n + m) * n);
    h->from_metric = reals(K * C * (n + m));
    h->switch_cost = byte() & 1 ? reals(C * C) : NULL;
    h->level = honest ? d->candidate : commands(C, m, d->level_count, 0);
    h->dwell = byte() & 1 ? words(C * m, 1, 4, honest) : NULL;
}
#endif

static fsw_design design;
static unsigned contradiction; /* 0: none */

static void make_design(void)
{
    fsw_design *d = &design;
    const unsigned manner = byte();
    contradiction = byte();
    const int honest = (manner & 3) != 0;
    memset(d, 0, sizeof *d);
    d->states = size(1, FSW_MAX_STATES);
    d->inputs = size(1, FSW_MAX_INPUTS);
    d->outputs = size(1, FSW_MAX_OUTPUTS);
    d->disturbances = size(0, FSW_MAX_DISTURBANCES);
    d->order = size(1, 3);
    d->rows = size(1, 6);
    d->candidates = size(1, 6);
    d->bad_limit = size(0, 3);
    const int estimates = manner & 4, rests = manner & 8;
    d->measured = estimates ? size(1, FSW_MAX_OUTPUTS) : honest ? d->states : size(0, 3);
    d->loads = estimates && d->disturbances > 0 ? size(0, d->disturbances) : honest ? 0 : size(0, 1);
    d->gate_limit = size(0, 4);
    const size_t n = d->states, m = d->inputs, q = d->outputs, p = d->disturbances, z = d->measured;
    /* an array that nobody may read, because a size is refused, need not be there */
    if (n > 64 || m > 16 || q > 16 || p > 16 || z > 64 || d->order > 64 || d->rows > 64 || d->candidates > 64 ||
        d->loads > 16)
        return;
    uint8_t *level_count = room(m, 1);
    size_t levels = 0, pending = 0, holds = 0;
    for (size_t j = 0; j < m; j++) {
        level_count[j] = (uint8_t)(honest ? 1 + byte() % 4 : byte() % 5);
        levels += level_count[j];
    }
    d->level_count = level_count;
    d->pending = words(m, 0, d->rows, honest);
    d->holds = words(m, 1, 3, honest);
    for (size_t j = 0; j < m; j++) {
        if (d->pending[j] > 64 || d->holds[j] > 64) return;
        pending += (size_t)d->pending[j] * level_count[j];
        holds += d->holds[j];
    }
    d->levels = ascending(levels, honest);
    d->candidate = commands(d->candidates, m, level_count, honest);
    d->safe = commands(1, m, level_count, honest);
    d->state_row = reals(q * n);
    d->disturbance_row = reals(q * p);
    d->offset = reals(q);
    d->reference_row = reals(q * d->order);
    d->half_weight = positive(q, honest);
    d->pending_table = reals(pending * q);
    d->hold_row = reals(holds * q);
    d->total_row = reals(q * m);
    if (rests) {
        d->rest_reference = reals(m * q);
        d->rest_disturbance = reals(m * p);
        d->rest_offset = reals(m);
    }
    uint32_t *dwell = room(levels, sizeof *dwell);
    for (size_t i = 0; dwell && i < levels; i++) {
        const unsigned b = byte();
        dwell[i] = b > 250 ? wide() : honest ? 1 + b % 4 : b;
    }
    d->dwell = dwell;
    d->switch_cost = positive(m, honest);
    d->model_x = reals(n * n);
    d->model_old = reals(m * n);
    d->model_new = reals(m * n);
    d->model_w = reals(n * p);
    d->model_c = reals(n);
    if (estimates) {
        d->gain = reals((n + d->loads) * z);
        d->output_row = reals(z * n);
        d->output_offset = reals(z);
        d->start_row = reals(n * z);
        d->start_offset = reals(n);
        d->gate = byte() & 1 ? reals(z * z) : NULL;
    }
#if FSW_MAX_MOVES > 0
    if (manner & 16) {
        make_horizon(d, honest, pending);
        d->horizon = &horizon;
    }
#endif
    if (manner & 32) { /* one table is missing */
        const fsw_real **table[] = {&d->levels, &d->model_x, &d->model_w, &d->switch_cost, &d->offset, &d->hold_row};
        *table[byte() % 6] = NULL;
    }
}

/* One contradiction in a design, which fsw_init must then refuse; 0 if there is nothing to spoil. */
static int spoil(fsw_design *d)
{
    static uint8_t high[] = {255, 255, 255, 255, 255, 255, 255, 255};
    static uint16_t none[8], late[8];
    static uint32_t never[1024];
    static fsw_real equal[1024];
    late[0] = d->rows;
#if FSW_MAX_MOVES > 0
    fsw_horizon *h = d->horizon ? &horizon : NULL;
#endif
    switch (contradiction) {
    case 20:
        d->pending = late;
        return 1;
    case 1:
        d->safe = high;
        return 1;
    case 2:
        d->dwell = never;
        return 1;
    case 3:
        d->level_count = (const uint8_t *)none;
        return 1;
    case 4:
        d->loads = (uint16_t)(d->disturbances + 1);
        return 1;
    case 5:
        d->measured = d->gain ? 0 : (uint16_t)(d->states + 1);
        return 1;
    case 6:
        d->gate_limit = 256;
        return d->gain != NULL;
    case 7:
        d->levels = equal;
        return d->level_count && d->inputs > 0 && d->level_count[0] > 1;
    case 8:
        d->holds = none;
        return !d->horizon;
    case 9:
        d->rows = (uint16_t)(FSW_MAX_LINE + 1);
        return d->inputs > 0;
    case 10:
        d->candidates = 0;
        return 1;
    case 11:
        d->gain = d->gain ? NULL : equal;
        return d->gain ? !d->output_row : d->measured != d->states || d->loads > 0;
#if FSW_MAX_MOVES > 0
    case 12:
        return h && (h->order++, 1);
    case 13:
        return h && (h->lead = h->steps, 1);
    case 14:
        return h && (h->moves = (uint16_t)(h->steps + 1), 1);
    case 15:
        return h && (h->terminal = (uint16_t)(h->states + 1), 1);
    case 16:
        return h && (h->tail = 3, 1);
    case 17:
        return h && (h->candidates++, 1);
    case 18:
        return h && (h->disturbances++, 1);
    case 19:
        return h && (h->level = high, 1);
#endif
    default:
        return 0;
    }
}

/* ---- What happens ---- */

static fsw_state state;

static void told(fsw_real *to, size_t count)
{
    const fsw_real all = value();
    const int each = byte() & 1;
    for (size_t i = 0; i < count; i++) to[i] = each ? value() : all;
}

static void check_line(void)
{
    const fsw_design *d = &design;
    MUST(state.head < d->rows);
    for (uint16_t age = 1; age <= d->rows; age++)
        for (uint16_t j = 0; j < d->inputs; j++) MUST(fsw_issued(d, &state, age)[j] < d->level_count[j]);
}

static void step(const fsw_real *x, const fsw_real *reference, const fsw_real *w, fsw_real *costs)
{
    const fsw_design *d = &design;
    fsw_real u[FSW_MAX_INPUTS];
    uint8_t before[FSW_MAX_INPUTS];
    uint32_t wait[FSW_MAX_INPUTS];
    memcpy(before, fsw_issued(d, &state, 1), d->inputs);
    memcpy(wait, state.wait, sizeof wait);
    const fsw_decision planned = fsw_decide(d, &state, x, reference, w, costs);
    const fsw_decision taken = fsw_step(d, &state, x, reference, w, u);
    MUST(planned.status == taken.status && planned.candidate == taken.candidate);
    MUST(taken.candidate <= d->candidates);
    const uint8_t *issued = fsw_issued(d, &state, 1);
    const fsw_real *levels = d->levels;
    for (uint16_t j = 0; j < d->inputs; j++) {
        MUST(memcmp(&u[j], &levels[issued[j]], sizeof u[j]) == 0);
        MUST(wait[j] == 0 || issued[j] == before[j] || taken.status == FSW_SAFE);
        MUST(issued[j] == before[j] || taken.status == FSW_SAFE || taken.candidate < d->candidates);
        levels += d->level_count[j];
    }
}

static void happen(void)
{
    const fsw_design *d = &design;
    const uint32_t width = fsw_reference_size(d);
    fsw_real *x = room(d->measured, sizeof *x), *reference = room(width, sizeof *x);
    fsw_real *w = room((size_t)(d->disturbances - d->loads), sizeof *w), *all = room(d->disturbances, sizeof *w);
    fsw_real *costs = room(d->candidates, sizeof *costs), *known = room(d->states, sizeof *known), u[FSW_MAX_INPUTS];
    uint8_t *line = room((size_t)d->rows * d->inputs, 1);
    uint32_t wait[FSW_MAX_INPUTS];
    if (!x || !reference || !w || !all || !costs || !known || !line) return;
    for (unsigned i = 0; i < 40 && at < end; i++) {
        const unsigned what = byte();
        told(x, d->measured);
        told(w, (size_t)(d->disturbances - d->loads));
        switch (what % 16) {
        case 0:
            for (size_t k = 0; k < (size_t)d->rows * d->inputs; k++) line[k] = (uint8_t)(byte() % 6);
            for (uint16_t j = 0; j < d->inputs; j++) wait[j] = byte() < 200 ? byte() % 4 : wide();
            (void)fsw_preload(d, &state, line, wait);
            break;
        case 1:
            told(known, d->states);
            told(all, d->disturbances);
            (void)fsw_start(d, &state, known, all);
            break;
        case 2:
        case 3:
            for (uint16_t j = 0; j < d->inputs; j++) line[j] = (uint8_t)(byte() % 6);
            (void)fsw_track(d, &state, what & 16 ? x : NULL, w, line);
            break;
        case 4:
            fsw_missed(d, &state, (uint16_t)(byte() < 250 ? byte() : word() % 5000));
            break;
        case 5:
            fsw_safe(d, &state, what & 16 ? x : NULL, w, u);
            MUST(memcmp(fsw_issued(d, &state, 1), d->safe, d->inputs) == 0);
            break;
        case 6: /* counters just before their ends */
            state.bad = (uint16_t)(UINT16_MAX - byte() % 3);
            state.bad_total = UINT32_MAX - byte() % 3;
            for (uint16_t j = 0; j < d->inputs; j++) state.wait[j] = UINT32_MAX - byte() % 3;
            break;
        case 7:
            MUST(fsw_init(d, &state) == FSW_VALID);
            break;
        default:
            told(reference, width);
            step(x, reference, w, costs);
        }
        check_line();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t count)
{
    at = bytes;
    end = bytes + count;
    make_design();
    const int whole = total <= LARGEST && design.level_count && design.levels;
    const int spoilt = whole && spoil(&design);
    if (total <= LARGEST && fsw_init(&design, &state) == FSW_VALID) {
        MUST(!spoilt);
        happen();
    }
    let_go();
    return 0;
}

#ifdef REPLAY
/* Inputs as lines of hexadecimal digits, from stdin. */
int main(void)
{
    static uint8_t bytes[1 << 16];
    size_t length = 0;
    unsigned replayed = 0, digits = 0, value_read = 0;
    for (int c = getchar(); c != EOF; c = getchar()) {
        if (c == '\n') {
            (void)LLVMFuzzerTestOneInput(bytes, length);
            replayed++;
            length = digits = value_read = 0;
            continue;
        }
        value_read = value_read * 16 + (unsigned)(c <= '9' ? c - '0' : c - 'a' + 10);
        if (++digits % 2 == 0 && length < sizeof bytes) {
            bytes[length++] = (uint8_t)value_read;
            value_read = 0;
        }
    }
    printf("%u replayed\n", replayed);
    return replayed == 0;
}
#endif
