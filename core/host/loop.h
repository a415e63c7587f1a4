/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* Closed loop on the host: a plant stepped exactly from one switching instant to the next, under
 * the core or under one of the laws people use today. Not part of the firmware. */
#ifndef FORESWITCH_LOOP_H
#define FORESWITCH_LOOP_H

#include "foreswitch.h"
#include "rig.h"

/* A linear plant over one period. During period k input j applies u[k - delay_j] first and, where the dead
 * time is not a whole number of periods, u[k - delay_j + 1] for the rest. Loads act undelayed. */
typedef struct {
    uint32_t states, inputs, outputs, disturbances;
    const double *transition;  /* [states][states] */
    const double *input_old;   /* [inputs][states] */
    const double *input_new;   /* [inputs][states], zero where delay is 0 */
    const double *input_load;  /* [inputs][states] */
    const double *disturbance; /* [states][disturbances] */
    const double *drift;       /* [states]: operating point */
    const uint32_t *delay;     /* [inputs] dead time in periods, rounded up */
    const double *output;      /* [outputs][states] */
    const double *output_zero; /* [outputs] */
} fsw_plant;

/* x one period later, from x, the commands (row k at `u`, older rows before it), load and w (null: none). */
void fsw_plant_advance(const fsw_plant *plant, const double *x, const double *u, const double *load, const double *w,
                       double *next);
void fsw_plant_output(const fsw_plant *plant, const double *x, double *y);

/* Any law: what is measured, reference [outputs][order] and w in, levels u [inputs] out. */
typedef struct fsw_law {
    fsw_decision (*step)(struct fsw_law *law, const double *measured, const double *reference, const double *w,
                         double *u);
} fsw_law;

/* The core as a law. `buffer` holds measured + reference size + disturbances + inputs values, used when
 * fsw_real is not double; `levels` are the exact ones. Each step writes a row [states + loads] at `trace`, the estimate
 * it is based on or NaN while there is none, and moves it on; null: nowhere. */
typedef struct {
    fsw_law law;
    fsw_design design;
    const double *levels;
    fsw_real *buffer;
    double *trace;
    fsw_state state;
} fsw_predictive;

fsw_decision fsw_predictive_step(fsw_law *law, const double *measured, const double *reference, const double *w,
                                 double *u);

/* A run's arrays, row k belonging to t_k. x and y have one row more than the others; u has
 * `history` rows before row 0, at least the plant's longest delay. Null: absent. */
typedef struct {
    uint32_t reference_width; /* values that the law is told each period */
    const fsw_sensor *sensor; /* null: the law is given what is measured as it is */
    const double *reference;  /* [steps][reference_width] */
    const double *w;          /* [steps][disturbances] */
    const double *load;       /* [steps][inputs] */
    double *x, *y, *u;        /* u at row 0, history before it */
    const double *seen;       /* x or y: what is measured */
    uint32_t seen_width;
    double *cost;
    uint32_t *nodes;
    uint8_t *status;
    double *scratch; /* [measured] */
} fsw_record;

/* Periods first <= k < last; row `first` of what is measured, and of x, must be filled. */
void fsw_run(fsw_law *law, const fsw_plant *plant, const fsw_record *record, uint64_t first, uint64_t last);

/* The same with real actuators before the plant. */
typedef struct {
    fsw_truth *truth;
    fsw_actuators actuators;
    const fsw_stuck *stuck; /* [faults] */
    uint32_t faults;
    uint64_t seed;
    const double *process; /* [states] standard deviation gathered in one period; null: none */
    double *levels;        /* [segments][inputs] scratch */
} fsw_rig;

/* Put the actuators where the `history` rows of commands before u have brought them. */
void fsw_rig_start(fsw_rig *rig, const double *u, uint64_t history);

/* As fsw_run, once started; `history` as there. 0: the truth stopped the run. */
int fsw_rig_run(fsw_law *law, fsw_rig *rig, const fsw_record *record, uint64_t history, uint64_t first, uint64_t last);

/* Figures of merit of a run: per output rms and largest |y - r| over `instants` rows (largest is set from 0, rms too);
 * per input changes of level and periods away from `safe`. */
void fsw_metrics(uint64_t instants, uint32_t outputs, uint32_t inputs, const double *y, const double *r,
                 const double *u, const double *safe, double *rms, double *largest, double *switches, double *on);

#endif
