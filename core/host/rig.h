/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* Actuators, sensors and faults of a simulated rig, and a linear plant stepped exactly behind them. Host only. */
#ifndef FORESWITCH_RIG_H
#define FORESWITCH_RIG_H

#include <stdint.h>

/* ---- Actuators ----
 * An edge commanded at t_k reaches the plant `rise` or `fall` seconds later (dead time and travel together), so at one
 * of few instants within a period. These instants cut every period into the same segments, over each of which all
 * inputs are constant. */

typedef struct {
    uint64_t tick; /* period * segments + segment */
    double level;
} fsw_edge;

/* Constant timing, then what the actuators are doing. */
typedef struct {
    uint32_t inputs, segments;
    uint32_t capacity;           /* edges under way per input: the longer of rise and fall in periods, + 2 */
    const uint32_t *rise, *fall; /* [inputs] segments from the start of the commanding period to the effect */
    double *command;             /* [inputs] last one given */
    double *level;               /* [inputs] in force */
    uint32_t *count;             /* [inputs] edges under way */
    fsw_edge *edges;             /* [inputs][capacity] in order of time */
} fsw_actuators;

/* Take the commands u [inputs] of period k and tell the levels in force in each of its segments,
 * levels [segments][inputs]. Periods must follow one another. An edge that would arrive no later than the one before it
 * swallows that one: a pulse shorter than the difference of rise and fall never comes. */
void fsw_actuators_period(fsw_actuators *actuators, uint64_t k, const double *u, double *levels);

/* An actuator that stays at one level from period `from` up to, not including, period `to`. */
typedef struct {
    uint64_t from, to;
    double level;
    uint32_t input;
} fsw_stuck;

/* ---- Plant ---- */

/* A plant over one period, between the cuts. */
typedef struct fsw_truth {
    /* x one period later under levels [segments][inputs] and w (may be null); 0: the run must stop. */
    int (*advance)(struct fsw_truth *truth, uint64_t k, const double *x, const double *levels, const double *w,
                   double *next);
    int (*output)(struct fsw_truth *truth, uint64_t k, const double *x, double *y); /* y [outputs] at t_k; 0 as above */
    uint32_t states, inputs, outputs, disturbances;
} fsw_truth;

typedef struct {
    fsw_truth truth;
    uint32_t segments, pieces;
    uint64_t length;           /* periods a piece lasts; parameters that drift change from piece to piece */
    const double *transition;  /* [pieces][segments][states][states] */
    const double *input;       /* [pieces][segments][inputs][states] */
    const double *disturbance; /* [pieces][segments][states][disturbances] */
    const double *drift;       /* [pieces][segments][states]: operating point */
    const double *output;      /* [pieces][outputs][states] */
    const double *output_zero; /* [pieces][outputs] */
} fsw_linear;

int fsw_linear_advance(fsw_truth *truth, uint64_t k, const double *x, const double *levels, const double *w,
                       double *next);
int fsw_linear_output(fsw_truth *truth, uint64_t k, const double *x, double *y);

/* ---- Sensors ---- */

/* What stands between the plant's state, or its output, and the law. Null pointers and zeros: nothing. */
typedef struct {
    uint64_t seed;
    uint32_t measured;
    const double *matrix;        /* [measured][seen]; null: what is seen as it is */
    const double *deviation;     /* [measured] standard deviation of the noise */
    const double *quantum;       /* [measured] step, 0: none */
    const double *low, *high;    /* [measured] range */
    double missing;              /* share of samples lost */
    double late;                 /* longest time under way, periods */
    const uint64_t (*outage)[2]; /* [outages] first period and end */
    uint32_t outages;
} fsw_sensor;

/* What the law is given at period k, of what was there to be seen so far, rows [k + 1][width] of states or outputs: the
 * newest sample that came in during the last period, or NaN. */
void fsw_sensor_read(const fsw_sensor *sensor, uint64_t k, const double *seen, uint32_t width, double *measured);

#endif
