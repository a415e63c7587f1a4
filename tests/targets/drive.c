/* A controller steered by a stream of operations; each answers with what it commanded and a checksum of the state.
 * drive.py writes the stream and knows the answers. */
#include "foreswitch_design.h"
#include "port.h"

enum { END, STEP, DECIDE_AND_STEP, PRELOAD, START, INIT, TRACK, MISSED, SAFE };

/* ---- Checksum: CRC-32 as zlib has it, of values and not of padding ---- */

static uint32_t sum;

static void add(const void *from, unsigned size)
{
    static const uint32_t table[] = {0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4,
                                     0x4db26158, 0x5005713c, 0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c,
                                     0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    const uint8_t *byte = from;
    for (sum = ~sum; size > 0; size--, byte++) {
        sum = sum >> 4 ^ table[(sum ^ *byte) & 15];
        sum = sum >> 4 ^ table[(sum ^ *byte >> 4) & 15];
    }
    sum = ~sum;
}

static void add_state(const fsw_design *d, const fsw_state *s)
{
    add(s->x, (unsigned)(d->states * sizeof *s->x));
    add(s->w, (unsigned)(d->disturbances * sizeof *s->w));
    add(s->wait, (unsigned)(d->inputs * sizeof *s->wait));
    add(&s->bad_total, sizeof s->bad_total);
    add(&s->head, sizeof s->head);
    add(&s->bad, sizeof s->bad);
    add(&s->primed, sizeof s->primed);
    add(&s->outliers, sizeof s->outliers);
#if FSW_MAX_MOVES > 0
    add(&s->planned, sizeof s->planned);
    if (d->horizon) add(s->plan, d->horizon->moves);
#endif
    add(s->line, (unsigned)(d->rows * d->inputs));
}

/* ---- Operations ---- */

static fsw_state state;
static fsw_real x[FSW_MAX_STATES + FSW_MAX_OUTPUTS], w[FSW_MAX_DISTURBANCES], u[FSW_MAX_INPUTS];
static fsw_real reference[DRIVE_REFERENCE], costs[DRIVE_CANDIDATES];

static void read_reals(fsw_real *to, unsigned count) { port_read(to, (unsigned)(count * sizeof *to)); }

static void write_reals(const fsw_real *from, unsigned count) { port_write(from, (unsigned)(count * sizeof *from)); }

/* Alone in its function, so that a counter knows where it comes from. */
__attribute__((noinline)) static fsw_decision one_step(const fsw_design *d)
{
    const fsw_decision decision = fsw_step(d, &state, x, reference, w, u);
    __asm__ volatile("" ::: "memory"); /* no tail call */
    return decision;
}

static void step(const fsw_design *d, int look)
{
    read_reals(x, d->measured);
    read_reals(reference, (unsigned)fsw_reference_size(d));
    read_reals(w, (unsigned)(d->disturbances - d->loads));
    if (look) {
        const fsw_decision decision = fsw_decide(d, &state, x, reference, w, costs);
        write_reals(costs, d->candidates);
        write_reals(&decision.cost, 1);
        write_reals(&decision.gap, 1);
    }
    const fsw_decision decision = one_step(d);
    const uint8_t status = (uint8_t)decision.status;
    port_write(&status, 1);
    port_write(&decision.candidate, sizeof decision.candidate);
    port_write(&decision.nodes, sizeof decision.nodes);
    write_reals(&decision.cost, 1);
    write_reals(&decision.gap, 1);
    write_reals(u, d->inputs);
}

static uint8_t preload(const fsw_design *d)
{
    uint8_t line[FSW_MAX_LINE];
    uint32_t wait[FSW_MAX_INPUTS];
    port_read(line, (unsigned)(d->rows * d->inputs));
    port_read(wait, (unsigned)(d->inputs * sizeof *wait));
    return (uint8_t)fsw_preload(d, &state, line, wait);
}

static uint8_t start(const fsw_design *d)
{
    read_reals(x, d->states);
    read_reals(w, d->disturbances);
    return (uint8_t)fsw_start(d, &state, x, w);
}

/* What a period without a choice measures; null: nothing. */
static const fsw_real *measured(const fsw_design *d)
{
    uint8_t given;
    port_read(&given, 1);
    if (!given) return 0;
    read_reals(x, d->measured);
    read_reals(w, (unsigned)(d->disturbances - d->loads));
    return x;
}

static uint8_t track(const fsw_design *d)
{
    uint8_t command[FSW_MAX_INPUTS];
    const fsw_real *now = measured(d);
    port_read(command, d->inputs);
    return (uint8_t)fsw_track(d, &state, now, w, command);
}

static void missed(const fsw_design *d)
{
    uint16_t periods;
    port_read(&periods, sizeof periods);
    fsw_missed(d, &state, periods);
}

static void safe(const fsw_design *d)
{
    fsw_safe(d, &state, measured(d), w, u);
    write_reals(u, d->inputs);
}

int main(void)
{
    const fsw_design *d = &controller;
    for (;;) {
        uint8_t operation, validity = 0;
        port_read(&operation, 1);
        switch (operation) {
        case END:
            return 0;
        case STEP:
            step(d, 0);
            break;
        case DECIDE_AND_STEP:
            step(d, 1);
            break;
        case PRELOAD:
            validity = preload(d);
            break;
        case START:
            validity = start(d);
            break;
        case INIT:
            validity = (uint8_t)fsw_init(d, &state);
            break;
        case TRACK:
            validity = track(d);
            break;
        case MISSED:
            missed(d);
            break;
        case SAFE:
            safe(d);
            break;
        default:
            return 1;
        }
        if (operation > DECIDE_AND_STEP) port_write(&validity, 1);
        add_state(d, &state);
        port_write(&sum, sizeof sum);
    }
}
