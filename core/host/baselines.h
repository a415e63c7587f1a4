/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* What people use today, for comparison on the host: a relay with hysteresis, and PI(D) with pulse-width
 * modulation, the latter also behind a Smith predictor. Not part of the firmware. */
#ifndef FORESWITCH_BASELINES_H
#define FORESWITCH_BASELINES_H

#include "loop.h"

typedef enum { FSW_RELAY = 0, FSW_PWM = 1, FSW_SMITH_PWM = 2 } fsw_baseline_kind;

/* What each input has of its own. */
typedef struct {
    const double *levels;  /* ascending */
    const uint32_t *dwell; /* per level, periods */
    uint32_t level_count, safe;
    /* memory */
    uint32_t present, wait, phase, on, low;
    double integral;
} fsw_channel;

typedef struct {
    fsw_law law;
    fsw_baseline_kind kind;
    uint32_t order;           /* derivatives in the reference */
    const fsw_plant *plant;   /* the model: outputs for all kinds, one period for the Smith predictor */
    const double *rate;       /* [outputs][states]: y' as rows, zero where y' depends on u */
    const double *mix;        /* [inputs][outputs]: each input acts on its own combination of the errors */
    const uint8_t *forbidden; /* [forbidden_count][inputs] level indices: there the present command is kept */
    uint32_t forbidden_count;
    double period; /* s */

    double hysteresis, deadband, lead; /* relay: unit of y, unit of y, s */
    double kp, ki, kd, kf, bias;       /* PWM: u per y, per y s, per y/s, per yd' ; u at zero error */
    uint32_t carrier;                  /* PWM: periods per pulse */

    fsw_channel *channels; /* [inputs] */
    uint32_t *wanted;      /* [inputs] scratch */
    uint8_t started;
    uint32_t depth;  /* rows of history, the longest dead time in periods + 1 */
    double *model;   /* Smith: [states] without dead time, then [states] with it */
    double *history; /* Smith: [depth][inputs] commands, oldest first */
} fsw_baseline;

void fsw_baseline_reset(fsw_baseline *self);
fsw_decision fsw_baseline_step(fsw_law *law, const double *measured, const double *reference, const double *w,
                               double *u);

#endif
