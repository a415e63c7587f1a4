#include "loop.h"

/* A decaying state is flushed here, or its denormals would slow every product with it. */
#define STATE_FLOOR 1e-200

static double dot(const double *a, const double *b, uint32_t count)
{
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) sum += a[i] * b[i];
    return sum;
}

void fsw_plant_advance(const fsw_plant *p, const double *x, const double *u, const double *load, const double *w,
                       double *next)
{
    const uint32_t n = p->states, m = p->inputs;
    for (uint32_t i = 0; i < n; i++) {
        double sum = p->drift[i] + dot(p->transition + i * n, x, n);
        if (w) sum += dot(p->disturbance + i * p->disturbances, w, p->disturbances);
        next[i] = sum;
    }
    for (uint32_t j = 0; j < m; j++) {
        const double *command = u + j - (uint64_t)p->delay[j] * m;
        const double older = command[0];
        for (uint32_t i = 0; i < n; i++) next[i] += p->input_old[j * n + i] * older;
        if (p->delay[j] > 0) {
            const double newer = command[m];
            for (uint32_t i = 0; i < n; i++) next[i] += p->input_new[j * n + i] * newer;
        }
        if (load)
            for (uint32_t i = 0; i < n; i++) next[i] += p->input_load[j * n + i] * load[j];
    }
    for (uint32_t i = 0; i < n; i++)
        if (next[i] < STATE_FLOOR && next[i] > -STATE_FLOOR) next[i] = 0;
}

void fsw_plant_output(const fsw_plant *p, const double *x, double *y)
{
    for (uint32_t o = 0; o < p->outputs; o++) y[o] = p->output_zero[o] + dot(p->output + o * p->states, x, p->states);
}

fsw_verdict fsw_predictive_step(fsw_law *law, const double *measured, const double *reference, const double *w,
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
#else
    const fsw_decision decision = fsw_step(d, &self->state, measured, reference, w, u);
#endif
    const fsw_verdict verdict = {decision.cost, decision.nodes, (uint8_t)decision.status};
    return verdict;
}

void fsw_run(fsw_law *law, const fsw_plant *p, const fsw_record *r, uint64_t first, uint64_t last)
{
    const uint32_t n = p->states, m = p->inputs;
    for (uint64_t k = first; k < last; k++) {
        const double *x = r->x + k * n, *w = r->w ? r->w + k * p->disturbances : 0, *measured = x;
        double *u = r->u + k * m;
        if (r->sensor || r->noise) {
            for (uint32_t i = 0; i < r->measured; i++) {
                r->scratch[i] = r->sensor ? dot(r->sensor + i * n, x, n) : x[i];
                if (r->noise) r->scratch[i] += r->noise[k * r->measured + i];
            }
            measured = r->scratch;
        }
        const fsw_verdict verdict = law->step(law, measured, r->reference + k * r->reference_width, w, u);
        r->cost[k] = verdict.cost;
        r->nodes[k] = verdict.nodes;
        r->status[k] = verdict.status;
        double *next = r->x + (k + 1) * n;
        fsw_plant_advance(p, x, u, r->load ? r->load + k * m : 0, w, next);
        fsw_plant_output(p, next, r->y + (k + 1) * p->outputs);
    }
}
