/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
#include "baselines.h"

void fsw_baseline_reset(fsw_baseline *self)
{
    for (uint32_t j = 0; j < self->plant->inputs; j++) {
        fsw_channel *c = self->channels + j;
        c->present = c->safe;
        c->wait = c->phase = c->on = c->low = 0;
        c->integral = 0;
    }
    self->started = 0;
}

static double row(const double *a, const double *x, uint32_t count)
{
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) sum += a[i] * x[i];
    return sum;
}

static int all_finite(const double *values, uint32_t count)
{
    int good = 1;
    for (uint32_t i = 0; i < count; i++) good &= values[i] - values[i] == 0;
    return good;
}

/* Lowest and highest level, and the safe one between them where a dead band is wanted. */
static uint32_t relay(const fsw_baseline *self, const fsw_channel *c, double error)
{
    const uint32_t top = c->level_count - 1;
    if (self->deadband > 0 && c->safe > 0 && c->safe < top) {
        const double up = self->deadband + (c->present == top ? -self->hysteresis : self->hysteresis);
        const double down = self->deadband + (c->present == 0 ? -self->hysteresis : self->hysteresis);
        return error > up ? top : error < -down ? 0 : c->safe;
    }
    if (error > self->hysteresis) return top;
    if (error < -self->hysteresis) return 0;
    return c->present == top ? top : 0;
}

/* Duty between the two levels that bracket the wanted input, set once per carrier period. */
static uint32_t pulse_width(const fsw_baseline *self, fsw_channel *c, double error, double error_rate,
                            double reference_rate)
{
    if (c->phase == 0) {
        const double *levels = c->levels;
        const double lowest = levels[0], highest = levels[c->level_count - 1];
        const double integral = c->integral + self->ki * error * self->period * self->carrier;
        const double rest = self->bias + self->kp * error + self->kd * error_rate + self->kf * reference_rate;
        double wanted = rest + integral;
        /* anti-windup: integrate only where that does not drive further into the limit */
        if ((wanted <= highest || integral < c->integral) && (wanted >= lowest || integral > c->integral))
            c->integral = integral;
        wanted = rest + c->integral;
        wanted = wanted < lowest ? lowest : wanted > highest ? highest : wanted;
        uint32_t low = 0;
        while (low + 2 < c->level_count && levels[low + 1] <= wanted) low++;
        const double duty = (wanted - levels[low]) / (levels[low + 1] - levels[low]);
        uint32_t on = (uint32_t)(duty * self->carrier + 0.5);
        /* a pulse, or a pause, shorter than the dwell becomes the nearer of none and the shortest allowed */
        const uint32_t shortest = c->dwell[low + 1], pause = c->dwell[low];
        if (on > 0 && on < shortest) on = 2 * on < shortest ? 0 : shortest;
        if (on < self->carrier && self->carrier - on < pause)
            on = 2 * (self->carrier - on) < pause || pause > self->carrier ? self->carrier : self->carrier - pause;
        c->low = low;
        c->on = on;
    }
    const uint32_t level = c->low + (c->phase < c->on ? 1 : 0);
    c->phase = c->phase + 1 < self->carrier ? c->phase + 1 : 0;
    return level;
}

/* Model with and without dead time, both started from the first measurement. */
static void smith_start(fsw_baseline *self, const double *x)
{
    const uint32_t n = self->plant->states, m = self->plant->inputs;
    for (uint32_t i = 0; i < n; i++) self->model[i] = self->model[n + i] = x[i];
    for (uint32_t i = 0; i < self->depth * m; i++) {
        const fsw_channel *c = self->channels + i % m;
        self->history[i] = c->levels[c->safe];
    }
}

static void smith_advance(fsw_baseline *self, const double *u, const double *w)
{
    const fsw_plant *p = self->plant;
    const uint32_t n = p->states, m = p->inputs, last = (self->depth - 1) * m;
    double *free = self->model, *delayed = self->model + n, next[FSW_MAX_STATES];
    for (uint32_t i = 0; i < last; i++) self->history[i] = self->history[i + m];
    for (uint32_t j = 0; j < m; j++) self->history[last + j] = u[j];
    fsw_plant_advance(p, delayed, self->history + last, 0, w, next);
    for (uint32_t i = 0; i < n; i++) delayed[i] = next[i];
    for (uint32_t i = 0; i < n; i++) {
        next[i] = p->drift[i] + row(p->transition + i * n, free, n);
        for (uint32_t j = 0; j < m; j++) next[i] += p->input_load[j * n + i] * u[j];
        if (w) next[i] += row(p->disturbance + i * p->disturbances, w, p->disturbances);
    }
    for (uint32_t i = 0; i < n; i++) free[i] = next[i];
}

/* The errors of all outputs and their rates, ahead of the dead time for the Smith predictor; 0: not finite. */
static int errors(const fsw_baseline *self, const double *x, const double *reference, double *error, double *rate,
                  double *reference_rate)
{
    const fsw_plant *p = self->plant;
    const uint32_t n = p->states;
    int good = 1;
    for (uint32_t o = 0; o < p->outputs; o++) {
        double y = p->output_zero[o] + row(p->output + o * n, x, n), slope = row(self->rate + o * n, x, n);
        for (uint32_t i = 0; self->kind == FSW_SMITH_PWM && i < n; i++) {
            const double ahead = self->model[i] - self->model[n + i];
            y += p->output[o * n + i] * ahead;
            slope += self->rate[o * n + i] * ahead;
        }
        reference_rate[o] = self->order > 1 ? reference[o * self->order + 1] : 0;
        error[o] = reference[o * self->order] - y;
        rate[o] = reference_rate[o] - slope;
        good &= error[o] - error[o] == 0 && rate[o] - rate[o] == 0;
    }
    return good;
}

static int allowed(const fsw_baseline *self)
{
    const uint32_t m = self->plant->inputs;
    for (uint32_t i = 0; i < self->forbidden_count; i++) {
        uint32_t j = 0;
        while (j < m && self->wanted[j] == self->forbidden[i * m + j]) j++;
        if (j == m) return 0;
    }
    return 1;
}

fsw_decision fsw_baseline_step(fsw_law *law, const double *x, const double *reference, const double *w, double *u)
{
    fsw_baseline *self = (fsw_baseline *)law;
    const uint32_t m = self->plant->inputs, q = self->plant->outputs;
    double error[FSW_MAX_OUTPUTS], rate[FSW_MAX_OUTPUTS], reference_rate[FSW_MAX_OUTPUTS];
    if (!self->started &&
        row(x, x, self->plant->states) <= FSW_HUGE) { /* NaN fails too: the models wait for a good start */
        self->started = 1;
        if (self->kind == FSW_SMITH_PWM) smith_start(self, x);
    }
    const int good = errors(self, x, reference, error, rate, reference_rate);
    for (uint32_t j = 0; j < m; j++) {
        fsw_channel *c = self->channels + j;
        const double *mix = self->mix + j * q, e = row(mix, error, q), slope = row(mix, rate, q);
        uint32_t wanted = c->present;
        if (good)
            wanted = self->kind == FSW_RELAY ? relay(self, c, e + self->lead * slope)
                                             : pulse_width(self, c, e, slope, row(mix, reference_rate, q));
        self->wanted[j] = c->wait == 0 ? wanted : c->present;
    }
    const int go = allowed(self);
    for (uint32_t j = 0; j < m; j++) {
        fsw_channel *c = self->channels + j;
        if (go && self->wanted[j] != c->present) {
            c->present = self->wanted[j];
            c->wait = c->dwell[c->present] - 1;
        } else if (c->wait > 0)
            c->wait--;
        u[j] = c->levels[c->present];
    }
    /* a bad w would stay in the models for good: rather none, for one period */
    if (self->kind == FSW_SMITH_PWM) smith_advance(self, u, w && all_finite(w, self->plant->disturbances) ? w : 0);
    const fsw_decision decision = {good ? FSW_OK : FSW_HELD, 0, 1, 0};
    return decision;
}
