/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
#include "loop.h"

#include <math.h>

#include "noise.h"

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

/* Write the estimate just used. */
static void note(fsw_predictive *self)
{
    const fsw_design *d = &self->design;
    const fsw_state *s = &self->state;
    const fsw_real *load = s->w + (d->disturbances - d->loads);
    for (uint32_t i = 0; i < d->states; i++) *self->trace++ = s->primed ? (double)s->x[i] : NAN;
    for (uint32_t i = 0; i < d->loads; i++) *self->trace++ = s->primed ? (double)load[i] : NAN;
}

fsw_decision fsw_predictive_step(fsw_law *law, const double *measured, const double *reference, const double *w,
                                 double *u)
{
    fsw_predictive *self = (fsw_predictive *)law;
    const fsw_design *d = &self->design;
#ifdef FSW_SINGLE
    const uint32_t width = fsw_reference_size(d);
    float *x = self->buffer, *r = x + d->measured, *v = r + width, *out = v + d->disturbances;
    for (uint32_t i = 0; i < d->measured; i++) x[i] = (float)measured[i];
    for (uint32_t i = 0; i < width; i++) r[i] = (float)reference[i];
    for (uint32_t i = 0; i + d->loads < d->disturbances; i++) v[i] = (float)w[i];
    const fsw_decision decision = fsw_step(d, &self->state, x, r, v, out);
    const uint8_t *command = fsw_issued(d, &self->state, 1);
    const double *levels = self->levels;
    for (uint32_t j = 0; j < d->inputs; j++) {
        u[j] = levels[command[j]];
        levels += d->level_count[j];
    }
#else
    const fsw_decision decision = fsw_step(d, &self->state, measured, reference, w, u);
#endif
    if (self->trace) note(self);
    return decision;
}

INLINE void run(fsw_law *law, const fsw_plant *p, uint32_t m, uint32_t q, const fsw_record *record, uint64_t first,
                uint64_t last)
{
    const fsw_record r = *record; /* ours alone: nothing written through its pointers can change it */
    const uint32_t n = p->states, d = p->disturbances, z = r.seen_width;
    double *x = r.x + first * n, *u = r.u + first * m;
    const double *seen = r.seen + first * z;
    const double *reference = r.reference + first * r.reference_width;
    for (uint64_t k = first; k < last; k++) {
        const double *measured = seen, *w = r.w ? r.w + k * d : 0;
        if (r.sensor) {
            fsw_sensor_read(r.sensor, k, r.seen, z, r.scratch);
            measured = r.scratch;
        }
        const fsw_decision decision = law->step(law, measured, reference, w, u);
        r.cost[k] = decision.cost;
        r.nodes[k] = decision.nodes;
        r.status[k] = (uint8_t)decision.status;
        advance(p, m, x, u, r.load ? r.load + k * m : 0, w, x + n);
        x += n;
        u += m;
        seen += z;
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

/* ---- With real actuators ---- */

void fsw_rig_start(fsw_rig *rig, const double *u, uint64_t history)
{
    fsw_actuators *a = &rig->actuators;
    u -= history * a->inputs;
    for (uint32_t j = 0; j < a->inputs; j++) {
        a->command[j] = a->level[j] = u[j];
        a->count[j] = 0;
    }
    for (uint64_t k = 0; k < history; k++) fsw_actuators_period(a, k, u + k * a->inputs, rig->levels);
}

int fsw_rig_run(fsw_law *law, fsw_rig *rig, const fsw_record *r, uint64_t history, uint64_t first, uint64_t last)
{
    fsw_truth *truth = rig->truth;
    const uint32_t n = truth->states, m = truth->inputs, q = truth->outputs;
    for (uint64_t k = first; k < last; k++) {
        const double *x = r->x + k * n, *measured = r->seen + k * r->seen_width;
        const double *w = r->w ? r->w + k * truth->disturbances : 0;
        double *u = r->u + k * m, *next = r->x + (k + 1) * n;
        if (r->sensor) {
            fsw_sensor_read(r->sensor, k, r->seen, r->seen_width, r->scratch);
            measured = r->scratch;
        }
        const fsw_decision decision = law->step(law, measured, r->reference + k * r->reference_width, w, u);
        r->cost[k] = decision.cost;
        r->nodes[k] = decision.nodes;
        r->status[k] = (uint8_t)decision.status;

        fsw_actuators_period(&rig->actuators, history + k, u, rig->levels);
        for (uint32_t i = 0; i < rig->faults; i++)
            if (k >= rig->stuck[i].from && k < rig->stuck[i].to)
                for (uint32_t s = 0; s < rig->actuators.segments; s++)
                    rig->levels[s * m + rig->stuck[i].input] = rig->stuck[i].level;
        for (uint32_t i = 0; r->load && i < rig->actuators.segments * m; i++) rig->levels[i] += r->load[k * m + i % m];

        if (!truth->advance(truth, k, x, rig->levels, w, next)) return 0;
        for (uint32_t i = 0; i < n; i++) {
            if (rig->process) next[i] += rig->process[i] * fsw_normal(rig->seed, FSW_PROCESS_NOISE, k * n + i);
            if (next[i] < STATE_FLOOR && next[i] > -STATE_FLOOR) next[i] = 0;
        }
        if (!truth->output(truth, k + 1, next, r->y + (k + 1) * q)) return 0;
    }
    return 1;
}

/* ---- Figures of merit ---- */

void fsw_metrics(uint64_t instants, uint32_t outputs, uint32_t inputs, const double *y, const double *r,
                 const double *u, const double *safe, double *rms, double *largest, double *switches, double *on)
{
    for (uint32_t o = 0; o < outputs; o++) {
        double sum = 0, most = 0;
        for (uint64_t k = 0; k < instants; k++) {
            const double error = y[k * outputs + o] - r[k * outputs + o], size = error < 0 ? -error : error;
            sum += error * error;
            most = size > most ? size : most;
        }
        rms[o] = sqrt(sum / (double)instants);
        largest[o] = most;
    }
    for (uint32_t j = 0; j < inputs; j++) {
        switches[j] = on[j] = 0;
        for (uint64_t k = 0; k + 1 < instants; k++) {
            const double *level = u + k * inputs + j;
            on[j] += *level != safe[j];
            switches[j] += k > 0 && *level != *(level - inputs);
        }
    }
}
