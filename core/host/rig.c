/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
#include "rig.h"

#include <math.h>

#include "foreswitch.h"
#include "noise.h"

/* ---- Actuators ---- */

static void give(fsw_actuators *a, uint32_t j, uint64_t k, double level)
{
    if (level == a->command[j]) return;
    const uint64_t tick = k * a->segments + (level > a->command[j] ? a->rise[j] : a->fall[j]);
    fsw_edge *edges = a->edges + (uint64_t)j * a->capacity;
    while (a->count[j] > 0 && edges[a->count[j] - 1].tick >= tick) a->count[j]--;
    a->command[j] = level;
    if (level == (a->count[j] > 0 ? edges[a->count[j] - 1].level : a->level[j])) return;
    edges[a->count[j]].tick = tick;
    edges[a->count[j]].level = level;
    a->count[j]++;
}

/* The level in force from `tick` on. */
static double arrive(fsw_actuators *a, uint32_t j, uint64_t tick)
{
    fsw_edge *edges = a->edges + (uint64_t)j * a->capacity;
    uint32_t due = 0;
    while (due < a->count[j] && edges[due].tick <= tick) a->level[j] = edges[due++].level;
    if (due > 0) {
        a->count[j] -= due;
        for (uint32_t i = 0; i < a->count[j]; i++) edges[i] = edges[i + due];
    }
    return a->level[j];
}

void fsw_actuators_period(fsw_actuators *a, uint64_t k, const double *u, double *levels)
{
    for (uint32_t j = 0; j < a->inputs; j++) give(a, j, k, u[j]);
    for (uint32_t s = 0; s < a->segments; s++)
        for (uint32_t j = 0; j < a->inputs; j++) levels[s * a->inputs + j] = arrive(a, j, k * a->segments + s);
}

/* ---- Plant ---- */

static uint64_t piece(const fsw_linear *self, uint64_t k)
{
    const uint64_t at = k / self->length;
    return at < self->pieces ? at : self->pieces - 1;
}

int fsw_linear_advance(fsw_truth *truth, uint64_t k, const double *x, const double *levels, const double *w,
                       double *next)
{
    const fsw_linear *self = (const fsw_linear *)truth;
    const uint32_t n = truth->states, m = truth->inputs, p = truth->disturbances;
    double from[FSW_MAX_STATES];
    for (uint32_t i = 0; i < n; i++) next[i] = x[i];
    for (uint32_t s = 0; s < self->segments; s++) {
        const uint64_t at = piece(self, k) * self->segments + s;
        const double *transition = self->transition + at * n * n, *input = self->input + at * m * n;
        const double *disturbance = self->disturbance + at * n * p, *drift = self->drift + at * n;
        for (uint32_t i = 0; i < n; i++) from[i] = next[i];
        for (uint32_t i = 0; i < n; i++) {
            double sum = drift[i];
            for (uint32_t l = 0; l < n; l++) sum += transition[i * n + l] * from[l];
            for (uint32_t l = 0; w && l < p; l++) sum += disturbance[i * p + l] * w[l];
            for (uint32_t j = 0; j < m; j++) sum += input[j * n + i] * levels[s * m + j];
            next[i] = sum;
        }
    }
    return 1;
}

int fsw_linear_output(fsw_truth *truth, uint64_t k, const double *x, double *y)
{
    const fsw_linear *self = (const fsw_linear *)truth;
    const uint32_t n = truth->states, q = truth->outputs;
    const double *row = self->output + piece(self, k) * q * n, *zero = self->output_zero + piece(self, k) * q;
    for (uint32_t o = 0; o < q; o++, row += n) {
        y[o] = zero[o];
        for (uint32_t i = 0; i < n; i++) y[o] += row[i] * x[i];
    }
    return 1;
}

/* ---- Sensors ---- */

static int lost(const fsw_sensor *s, uint64_t sample)
{
    for (uint32_t i = 0; i < s->outages; i++)
        if (sample >= s->outage[i][0] && sample < s->outage[i][1]) return 1;
    return s->missing > 0 && fsw_uniform(s->seed, FSW_SAMPLE_LOST, sample) < s->missing;
}

/* The first period whose decision a sample is in time for. */
static uint64_t arrival(const fsw_sensor *s, uint64_t sample)
{
    return sample + (uint64_t)ceil(s->late * fsw_uniform(s->seed, FSW_SAMPLE_LATE, sample));
}

void fsw_sensor_read(const fsw_sensor *s, uint64_t k, const double *seen, uint32_t width, double *measured)
{
    const uint64_t reach = (uint64_t)ceil(s->late);
    uint64_t age = 0;
    while (age <= reach && age <= k && (lost(s, k - age) || arrival(s, k - age) != k)) age++;
    const int none = age > reach || age > k;
    const uint64_t sample = none ? k : k - age;
    const double *from = seen + sample * width;
    for (uint32_t i = 0; i < s->measured; i++) {
        double value = s->matrix ? 0 : from[i];
        for (uint32_t l = 0; s->matrix && l < width; l++) value += s->matrix[i * width + l] * from[l];
        if (s->deviation) value += s->deviation[i] * fsw_normal(s->seed, FSW_SENSOR_NOISE, sample * s->measured + i);
        if (s->quantum && s->quantum[i] > 0) value = s->quantum[i] * floor(value / s->quantum[i] + 0.5);
        if (s->low && value < s->low[i]) value = s->low[i];
        if (s->high && value > s->high[i]) value = s->high[i];
        measured[i] = none ? NAN : value;
    }
}
