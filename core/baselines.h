/* What people use today, for comparison on the host: a relay with hysteresis, and PI(D) with pulse-width
 * modulation, the latter also behind a Smith predictor. One input, one output. Not part of the firmware. */
#ifndef FORESWITCH_BASELINES_H
#define FORESWITCH_BASELINES_H

#include "loop.h"

typedef enum { FSW_RELAY = 0, FSW_PWM = 1, FSW_SMITH_PWM = 2 } fsw_baseline_kind;

typedef struct {
    fsw_law law;
    fsw_baseline_kind kind;
    uint32_t order;         /* derivatives in the reference */
    const double *rate;     /* [states]: y' as a row, zero where y' depends on u */
    const fsw_plant *plant; /* the model: output row for all kinds, one period for the Smith predictor */
    const double *levels;   /* ascending */
    const uint32_t *dwell;  /* per level, periods */
    uint32_t level_count, safe;
    double period; /* s */

    double hysteresis, deadband, lead; /* relay: unit of y, unit of y, s */
    double kp, ki, kd, kf, bias;       /* PWM: u per y, per y s, per y/s, per yd' ; u at zero error */
    uint32_t carrier;                  /* PWM: periods per pulse */

    /* memory */
    uint32_t present, wait, phase, on, low;
    double integral;
    uint8_t started;
    double *model;   /* Smith: [states] without dead time, then [states] with it */
    double *history; /* Smith: [delay + 1] commands, oldest first */
} fsw_baseline;

void fsw_baseline_reset(fsw_baseline *self);
fsw_decision fsw_baseline_step(fsw_law *law, const double *measured, const double *reference, const double *w,
                               double *u);

#endif
