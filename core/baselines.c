#include "baselines.h"

void fsw_baseline_reset(fsw_baseline *self)
{
    self->present = self->safe;
    self->wait = self->phase = self->on = self->low = 0;
    self->integral = 0;
    self->started = 0;
}

static double row(const double *a, const double *x, uint32_t count)
{
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) sum += a[i] * x[i];
    return sum;
}

/* Lowest and highest level, and the safe one between them where a dead band is wanted. */
static uint32_t relay(const fsw_baseline *self, double error)
{
    const uint32_t top = self->level_count - 1, safe = self->safe;
    if (self->deadband > 0 && safe > 0 && safe < top) {
        const double up = self->deadband + (self->present == top ? -self->hysteresis : self->hysteresis);
        const double down = self->deadband + (self->present == 0 ? -self->hysteresis : self->hysteresis);
        return error > up ? top : error < -down ? 0 : safe;
    }
    if (error > self->hysteresis) return top;
    if (error < -self->hysteresis) return 0;
    return self->present == top ? top : 0;
}

/* Duty between the two levels that bracket the wanted input, set once per carrier period. */
static uint32_t pulse_width(fsw_baseline *self, double error, double error_rate, double reference_rate)
{
    if (self->phase == 0) {
        const double *levels = self->levels;
        const double lowest = levels[0], highest = levels[self->level_count - 1];
        const double integral = self->integral + self->ki * error * self->period * self->carrier;
        const double rest = self->bias + self->kp * error + self->kd * error_rate + self->kf * reference_rate;
        double wanted = rest + integral;
        /* anti-windup: integrate only where that does not drive further into the limit */
        if ((wanted <= highest || integral < self->integral) && (wanted >= lowest || integral > self->integral))
            self->integral = integral;
        wanted = rest + self->integral;
        wanted = wanted < lowest ? lowest : wanted > highest ? highest : wanted;
        uint32_t low = 0;
        while (low + 2 < self->level_count && levels[low + 1] <= wanted) low++;
        const double duty = (wanted - levels[low]) / (levels[low + 1] - levels[low]);
        uint32_t on = (uint32_t)(duty * self->carrier + 0.5);
        /* a pulse, or a pause, shorter than the dwell becomes the nearer of none and the shortest allowed */
        const uint32_t shortest = self->dwell[low + 1], pause = self->dwell[low];
        if (on > 0 && on < shortest) on = 2 * on < shortest ? 0 : shortest;
        if (on < self->carrier && self->carrier - on < pause)
            on = 2 * (self->carrier - on) < pause || pause > self->carrier ? self->carrier : self->carrier - pause;
        self->low = low;
        self->on = on;
    }
    const uint32_t level = self->low + (self->phase < self->on ? 1 : 0);
    self->phase = self->phase + 1 < self->carrier ? self->phase + 1 : 0;
    return level;
}

/* Model with and without dead time, both started from the first measurement. */
static void smith_start(fsw_baseline *self, const double *x)
{
    const uint32_t n = self->plant->states;
    for (uint32_t i = 0; i < n; i++) self->model[i] = self->model[n + i] = x[i];
    for (uint32_t i = 0; i <= self->plant->delay[0]; i++) self->history[i] = self->levels[self->safe];
}

static void smith_advance(fsw_baseline *self, double u, const double *w)
{
    const fsw_plant *p = self->plant;
    const uint32_t n = p->states, delay = p->delay[0];
    double *free = self->model, *delayed = self->model + n, next[FSW_MAX_STATES];
    for (uint32_t i = 0; i < delay; i++) self->history[i] = self->history[i + 1];
    self->history[delay] = u;
    fsw_plant_advance(p, delayed, self->history + delay, 0, w, next);
    for (uint32_t i = 0; i < n; i++) delayed[i] = next[i];
    for (uint32_t i = 0; i < n; i++) {
        next[i] = p->drift[i] + row(p->transition + i * n, free, n) + p->input_load[i] * u;
        if (w) next[i] += row(p->disturbance + i * p->disturbances, w, p->disturbances);
    }
    for (uint32_t i = 0; i < n; i++) free[i] = next[i];
}

fsw_decision fsw_baseline_step(fsw_law *law, const double *x, const double *reference, const double *w, double *u)
{
    fsw_baseline *self = (fsw_baseline *)law;
    const fsw_plant *p = self->plant;
    const uint32_t n = p->states;
    if (!self->started) {
        self->started = 1;
        if (self->kind == FSW_SMITH_PWM) smith_start(self, x);
    }
    double y = p->output_zero[0] + row(p->output, x, n), rate = row(self->rate, x, n);
    if (self->kind == FSW_SMITH_PWM) {
        for (uint32_t i = 0; i < n; i++) {
            const double ahead = self->model[i] - self->model[n + i];
            y += p->output[i] * ahead;
            rate += self->rate[i] * ahead;
        }
    }
    const double reference_rate = self->order > 1 ? reference[1] : 0;
    const double error = reference[0] - y, error_rate = reference_rate - rate;
    uint32_t wanted = self->present;
    const int good = error - error == 0 && error_rate - error_rate == 0; /* neither NaN nor infinite */
    if (good)
        wanted = self->kind == FSW_RELAY ? relay(self, error + self->lead * error_rate)
                                         : pulse_width(self, error, error_rate, reference_rate);
    if (wanted != self->present && self->wait == 0) {
        self->present = wanted;
        self->wait = self->dwell[wanted] - 1;
    } else if (self->wait > 0)
        self->wait--;
    u[0] = self->levels[self->present];
    if (self->kind == FSW_SMITH_PWM) smith_advance(self, u[0], w);
    const fsw_decision decision = {good ? FSW_OK : FSW_HELD, (uint16_t)self->present, 1, 0};
    return decision;
}
