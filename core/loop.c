#include "loop.h"

/* A decaying state is flushed here, or its denormals would slow every product with it. */
#define STATE_FLOOR 1e-200

#ifdef __GNUC__
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

static inline double product(double sum, const double *a, const double *b, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) sum += a[i] * b[i];
    return sum;
}

/* The numbers of inputs m and outputs q are handed down: one of each gets its own copy, without the loops over them. */
INLINE void advance(const fsw_plant *p, uint32_t m, const double *x, const double *u, const double *load,
                    const double *w, double *next)
{
    const uint32_t n = p->states;
    const double *row = p->transition;
    for (uint32_t i = 0; i < n; i++, row += n) {
        double sum = product(p->drift[i], row, x, n);
        if (w) sum = product(sum, p->disturbance + i * p->disturbances, w, p->disturbances);
        for (uint32_t j = 0; j < m; j++) {
            const double *command = u + j - (uint64_t)p->delay[j] * m;
            sum += p->input_old[j * n + i] * command[0];
            if (p->delay[j] > 0) sum += p->input_new[j * n + i] * command[m];
            if (load) sum += p->input_load[j * n + i] * load[j];
        }
        next[i] = sum < STATE_FLOOR && sum > -STATE_FLOOR ? 0 : sum;
    }
}

INLINE void output(const fsw_plant *p, uint32_t q, const double *x, double *y)
{
    for (uint32_t o = 0; o < q; o++) y[o] = product(p->output_zero[o], p->output + o * p->states, x, p->states);
}

void fsw_plant_advance(const fsw_plant *p, const double *x, const double *u, const double *load, const double *w,
                       double *next)
{
    advance(p, p->inputs, x, u, load, w, next);
}

void fsw_plant_output(const fsw_plant *p, const double *x, double *y) { output(p, p->outputs, x, y); }

fsw_decision fsw_predictive_step(fsw_law *law, const double *measured, const double *reference, const double *w,
                                 double *u)
{
    fsw_predictive *self = (fsw_predictive *)law;
    const fsw_design *d = &self->design;
#ifdef FSW_SINGLE
    const uint32_t width = (uint32_t)d->outputs * d->order;
    float *x = self->buffer, *r = x + d->states, *v = r + width, *out = v + d->disturbances;
    for (uint32_t i = 0; i < d->states; i++) x[i] = (float)measured[i];
    for (uint32_t i = 0; i < width; i++) r[i] = (float)reference[i];
    for (uint32_t i = 0; i < d->disturbances; i++) v[i] = (float)w[i];
    const fsw_decision decision = fsw_step(d, &self->state, x, r, v, out);
    const uint8_t *command = fsw_issued(d, &self->state, 1);
    const double *levels = self->levels;
    for (uint32_t j = 0; j < d->inputs; j++) {
        u[j] = levels[command[j]];
        levels += d->level_count[j];
    }
    return decision;
#else
    return fsw_step(d, &self->state, measured, reference, w, u);
#endif
}

INLINE void run(fsw_law *law, const fsw_plant *p, uint32_t m, uint32_t q, const fsw_record *record, uint64_t first,
                uint64_t last)
{
    const fsw_record r = *record; /* ours alone: nothing written through its pointers can change it */
    const uint32_t n = p->states, d = p->disturbances;
    double *x = r.x + first * n, *u = r.u + first * m;
    const double *reference = r.reference + first * r.reference_width;
    for (uint64_t k = first; k < last; k++) {
        const double *measured = x, *w = r.w ? r.w + k * d : 0;
        if (r.sensor || r.noise) {
            for (uint32_t i = 0; i < r.measured; i++) {
                r.scratch[i] = r.sensor ? product(0, r.sensor + i * n, x, n) : x[i];
                if (r.noise) r.scratch[i] += r.noise[k * r.measured + i];
            }
            measured = r.scratch;
        }
        const fsw_decision decision = law->step(law, measured, reference, w, u);
        r.cost[k] = decision.cost;
        r.nodes[k] = decision.nodes;
        r.status[k] = (uint8_t)decision.status;
        advance(p, m, x, u, r.load ? r.load + k * m : 0, w, x + n);
        x += n;
        u += m;
        reference += r.reference_width;
        output(p, q, x, r.y + (k + 1) * q);
    }
}

void fsw_run(fsw_law *law, const fsw_plant *p, const fsw_record *record, uint64_t first, uint64_t last)
{
    if (p->inputs == 1 && p->outputs == 1)
        run(law, p, 1, 1, record, first, last);
    else
        run(law, p, p->inputs, p->outputs, record, first, last);
}
