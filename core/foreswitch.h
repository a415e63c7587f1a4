/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* foreswitch: predictive control of actuators that can only switch and act after a dead time.
 *
 * Everything a controller needs at run time, in freestanding C99: no heap, no stdio, no mutable
 * file-scope data. A design (constant, computed beforehand) and a state (owned by the caller) go
 * into fsw_step once per switching period; a level index per input comes out.
 *
 *     fsw_state state;
 *     if (fsw_init(&design, &state) != FSW_VALID) { ... }      once
 *     fsw_step(&design, &state, x, reference, w, u);           every switching period
 *
 * Units are SI. Time does not appear: the design has folded the switching period, the input delay
 * and the horizon into rows, so that the predicted sliding variable of output o is
 *
 *     s_o = f_o x + sum_i W_oi u[k-i] + g_o w + offset_o - s_d,o + sum_j H_oj tail_j    free part
 *           + sum_j h_oj (u_j - tail_j)                                                candidate
 *
 * with tail_j the input assumed after the candidate has been held. A step costs
 * O(outputs * (states + pending) + candidates * outputs * inputs), whatever the horizon.
 *
 * An exported design is one header, foreswitch_design.h; each reader asks for its section:
 *
 *     +-----------------------------+
 *     | limits: sizes, what is used |   FSW_LIMITS   this header, which cuts fsw_state to size
 *     +-----------------------------+
 *     | declaration                 |                a program
 *     +-----------------------------+
 *     | tables and structures       |   FSW_DATA     foreswitch.c
 *     +-----------------------------+
 *     | example steps               |   FSW_STEPS    selftest.c, example.c
 *     +-----------------------------+
 *
 *     constant, in flash                                                yours, in RAM
 *     +------------+      +----------------------------------+          +-------------------------+
 *     | fsw_design |   +->| levels, rows, dwell, model, ...  |          | fsw_state               |
 *     |   sizes    |   |  +----------------------------------+          |   x, w, wait, counters  |
 *     |   tables --+---+                                                |   plan     of a horizon |
 *     |   horizon -+-+    +-------------+    +---------------+          |   line     commands     |
 *     +------------+ +--->| fsw_horizon |  +>| F, G, S, ...  |          |   scratch  of a horizon |
 *      null: endpoint     |   tables ---+--+ +---------------+          +-------------------------+
 *                         +-------------+
 */
#ifndef FORESWITCH_H
#define FORESWITCH_H

#define FSW_VERSION_MAJOR 0
#define FSW_VERSION_MINOR 1

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Limits: an exported design sets them to its own sizes in a header beside this one; the state shrinks with them,
 * and what it does not use is left out. A compiler without __has_include is told by -DFSW_EXPORTED. ---- */

#ifdef __has_include
#if __has_include("foreswitch_design.h") && !defined(FSW_EXPORTED)
#define FSW_EXPORTED
#endif
#endif
#ifdef FSW_EXPORTED
#define FSW_LIMITS
#include "foreswitch_design.h"
#undef FSW_LIMITS
#endif

#ifndef FSW_MAX_STATES
#define FSW_MAX_STATES 64
#endif
#ifndef FSW_MAX_INPUTS
#define FSW_MAX_INPUTS 8
#endif
#ifndef FSW_MAX_OUTPUTS
#define FSW_MAX_OUTPUTS 16
#endif
#ifndef FSW_MAX_DISTURBANCES
#define FSW_MAX_DISTURBANCES 16 /* at least 1 */
#endif
#ifndef FSW_MAX_LINE
#define FSW_MAX_LINE 65536 /* inputs * (longest dead time in periods + 1), bytes */
#endif
#ifndef FSW_MAX_MOVES
#define FSW_MAX_MOVES 0 /* of a long horizon, see horizon.h; 0: none, and none of its memory */
#endif

/* FSW_FIXED promises that every design has exactly these sizes, and besides
 *     FSW_DISTURBANCES, FSW_LOADS, FSW_ORDER, FSW_CANDIDATES    those of fsw_design
 *     FSW_ESTIMATOR, FSW_REST     0 or 1: there is a gain, a rest_reference
 *     FSW_SWITCH_COST, FSW_OFFSET, FSW_SPLIT
 *                                 0: switch_cost, offset, model_new are all zero, 1: they may not be
 *     FSW_HELD_ONCE               1: every input has one holding time, 0: there may be more
 * so that the compiler sees constants. fsw_init refuses a design that breaks the promise. */

/* ---- Types ---- */

#ifdef FSW_SINGLE
typedef float fsw_real;
#define FSW_TINY 1e-30f /* below: zero, so that a decayed state cannot slow the arithmetic */
#define FSW_HUGE 1e30f  /* above: not a measurement */
#else
#if defined(__SIZEOF_DOUBLE__) && __SIZEOF_DOUBLE__ < 8
#error "double has 32 bits here, as on an AVR: define FSW_SINGLE, export with float32"
#endif
typedef double fsw_real;
#define FSW_TINY 1e-290
#define FSW_HUGE 1e290
#endif

/* Whether a design can be run, or what a call was given be used; and what to do if not. */
typedef enum {
    FSW_VALID = 0, /* Go on. */
    /* A size exceeds the limits above: raise that limit for all files that include this header, or give the design a
     * longer period, fewer states, commands or moves. */
    FSW_TOO_LARGE = 1,
    /* Sizes or indices contradict each other, a table is missing, or a number is out of its range: take the design, and
     * the header beside the core, from one export as it is; of another call, correct what it was given. */
    FSW_INCONSISTENT = 2
} fsw_validity;

/* What a command is based on. */
typedef enum {
    FSW_OK = 0,       /* the measurement */
    FSW_COASTING = 1, /* the model's prediction, in place of a bad measurement or an outlier */
    FSW_HELD = 2, /* no usable measurement yet, a bad reference, or all costs overflow: the present command is kept */
    FSW_SAFE = 3  /* bad_limit bad samples in a row: the safe level, whatever the dwell */
} fsw_status;

#if FSW_MAX_MOVES > 0
#include "horizon.h"
#endif

/* One controller, constant. Arrays are row-major, their shape in brackets; none is null, also if it is empty, unless
 * said below. An input's levels are ascending and referred to by index; a *command* is one index per input. */
typedef struct {
    uint16_t states, inputs, outputs;
    uint16_t disturbances; /* measured ones, then `loads`, which are estimated */
    uint16_t order;        /* derivatives in a reference, the value included; >= 1 */
    uint16_t rows;         /* delay line: longest dead time in periods, rounded up, + 1 */
    uint16_t candidates;   /* allowed commands; >= 1 */
    uint16_t bad_limit;    /* consecutive bad samples that force the safe level; 0: never */
    uint16_t measured;     /* values in a measurement: the states, or with a gain what output_row makes of them */
    uint16_t loads;        /* constant inputs nobody measures, last among the disturbances; 0 without a gain */
    uint16_t gate_limit;   /* outliers in a row left unused, <= 255; then all samples count until one is inside */

    const uint8_t *level_count; /* [inputs], each >= 1 */
    const fsw_real *levels;     /* [sum of level_count] */
    const uint8_t *candidate;   /* [candidates][inputs] */
    const uint8_t *safe;        /* [inputs] */

    const fsw_real *state_row;       /* f [outputs][states] */
    const fsw_real *disturbance_row; /* g [outputs][disturbances] */
    const fsw_real *offset;          /* [outputs] */
    const fsw_real *reference_row;   /* [outputs][order] */
    const fsw_real *half_weight;     /* [outputs], cost = sum half_weight s^2 + switch costs */

    const uint16_t *pending;       /* [inputs] commands under way, dead time in periods rounded up */
    const fsw_real *pending_table; /* per input [pending][level_count][outputs]: W times the level, newest first */

    const uint16_t *holds;    /* [inputs] distinct holding times, in periods, within the horizon; >= 1 */
    const fsw_real *hold_row; /* per input [holds][outputs]: h for a candidate held 1, 2, ... periods */

    const fsw_real *total_row;        /* H [outputs][inputs]: a level held to the evaluation instant */
    const fsw_real *rest_reference;   /* [inputs][outputs]; null: the tail is zero */
    const fsw_real *rest_disturbance; /* [inputs][disturbances] */
    const fsw_real *rest_offset;      /* [inputs] */

    const uint32_t *dwell;       /* per input [level_count]: shortest run at that level, periods; >= 1 */
    const fsw_real *switch_cost; /* [inputs] */

    /* One period of the model, to coast through bad measurements and to estimate:
     * x' = model_x x + sum_j (model_old_j u[pending_j + 1 ago] + model_new_j u[pending_j ago]) + model_w w + model_c */
    const fsw_real *model_x;   /* [states][states] */
    const fsw_real *model_old; /* [inputs][states] */
    const fsw_real *model_new; /* [inputs][states], zero where pending is 0 */
    const fsw_real *model_w;   /* [states][disturbances] */
    const fsw_real *model_c;   /* [states] */

    /* Estimation from outputs: with e = y - (output_row x' + output_offset), [x; load] = [x'; load] + gain e. */
    const fsw_real *gain;          /* [states + loads][measured]; null: the state itself is measured */
    const fsw_real *output_row;    /* [measured][states] */
    const fsw_real *output_offset; /* [measured] */
    const fsw_real *start_row;     /* [states][measured]: the state that the first measurement is taken for, */
    const fsw_real *start_offset;  /* [states] */
    const fsw_real *gate;          /* [measured][measured]: an outlier has e' gate e > 1; null: there are none */

    /* A long horizon in place of the rows above, from state_row to total_row, which are then not read. */
    const struct fsw_horizon *horizon; /* null: the endpoint objective */
} fsw_design;

/* All that changes. Plain data: may be copied, stored and restored. */
typedef struct {
    fsw_real x[FSW_MAX_STATES];       /* the state last used: measured, estimated or predicted */
    fsw_real w[FSW_MAX_DISTURBANCES]; /* the disturbances last used, measured and estimated */
    uint32_t wait[FSW_MAX_INPUTS];    /* periods each input must still keep its present level */
    uint32_t bad_total;               /* bad samples since fsw_init, saturating */
    uint16_t head;                    /* row of the delay line that the next command takes */
    uint16_t bad;                     /* consecutive bad samples, saturating */
    uint8_t primed;                   /* x holds something */
    uint8_t outliers;                 /* in a row, not used */
#if FSW_MAX_MOVES > 0
    uint8_t planned;             /* `plan` holds something */
    uint8_t plan[FSW_MAX_MOVES]; /* the latest best sequence, candidates */
#endif
    uint8_t line[FSW_MAX_LINE]; /* [rows][inputs] commands issued, level indices */
#if FSW_MAX_MOVES > 0
    fsw_horizon_scratch scratch; /* of no meaning between calls */
#endif
} fsw_state;

typedef struct {
    fsw_status status;
    uint16_t candidate; /* index of the chosen command, or `candidates` when it is the held or safe one */
    uint32_t nodes;     /* candidates, or partial sequences, evaluated */
    fsw_real cost;      /* predicted cost of the choice; 0 when nothing was evaluated */
    fsw_real gap;       /* what a better sequence could save at most; 0: the choice is proven best */
} fsw_decision;

/* ---- Functions. Costs are worst cases in multiply-adds. ---- */

/* Check a design and start its state: safe levels under way, no dwell running, nothing measured.
 * Every size and index in the design is checked, and that levels are finite and ascend; array lengths cannot be.
 * A state belongs to the design it was started with. Cost O(candidates * inputs). */
fsw_validity fsw_init(const fsw_design *design, fsw_state *state);

/* Start from known commands: line [rows][inputs] level indices, oldest first, the last one present;
 * wait [inputs] periods that each input must still keep its level (0: free). Keeps what was measured.
 * Returns FSW_INCONSISTENT, and changes nothing, if an index is out of range. */
fsw_validity fsw_preload(const fsw_design *design, fsw_state *state, const uint8_t *line, const uint32_t *wait);

/* Periods that an input must still keep a level which it took `elapsed` periods ago, for `wait`. Where nobody knows how
 * long ago, 0 is the careful answer. */
uint32_t fsw_dwell_left(const fsw_design *design, uint16_t input, uint8_t level, uint32_t elapsed);

/* Start from a known state x [states] under w [disturbances], estimated loads included, as fsw_state holds them after a
 * step: the next step carries them over one period. Commands and dwell stay.
 * Returns FSW_INCONSISTENT, and changes nothing, if a value is not finite. */
fsw_validity fsw_start(const fsw_design *design, fsw_state *state, const fsw_real *x, const fsw_real *w);

/* Values in a reference: instants * outputs * order. */
uint32_t fsw_reference_size(const fsw_design *design);

/* The command issued `age` periods ago, 1 <= age <= rows (1: in force): [inputs] level indices, valid until the
 * state changes. */
const uint8_t *fsw_issued(const fsw_design *design, const fsw_state *state, uint16_t age);

/* Choose without committing: what fsw_step would do; of the state only the scratch is written.
 * x [measured], reference [outputs][order], for a horizon [steps - lead][outputs][order], w [disturbances - loads]
 * (null if there are none) in the design's units; costs [candidates] receives every candidate's cost, infinity where
 * dwell forbids it; may be null. */
fsw_decision fsw_decide(const fsw_design *design, fsw_state *state, const fsw_real *x, const fsw_real *reference,
                        const fsw_real *w, fsw_real *costs);

/* One switching period: choose, remember, and write the levels to u [inputs]. The command is always
 * an allowed one that respects dwell (but FSW_SAFE), also with bad measurements.
 * Cost: outputs * (states + disturbances + order + sum pending + candidates * inputs) + inputs * outputs;
 * a bad measurement adds states * (states + 2 inputs + disturbances), an estimate in each period besides
 * measured * (2 states + loads + measured). */
fsw_decision fsw_step(const fsw_design *design, fsw_state *state, const fsw_real *x, const fsw_real *reference,
                      const fsw_real *w, fsw_real *u);

/* ---- Periods in which fsw_step does not choose. Delay line, dwell and estimate stay true, so that the next fsw_step
 * takes over without a bump. They cost what a bad measurement costs. ---- */

/* Somebody else chose, say an operator: command [inputs], the level indices really issued in this period, allowed or
 * not. x and w as in fsw_step; x null: nothing was measured, and then w is not read.
 * Returns FSW_INCONSISTENT, and changes nothing, if an index is out of range. */
fsw_validity fsw_track(const fsw_design *design, fsw_state *state, const fsw_real *x, const fsw_real *w,
                       const uint8_t *command);

/* So many calls did not come, and the command in force simply went on. Call before the next fsw_step; `periods` times
 * the cost. After a longer silence start anew: fsw_init, fsw_preload. */
void fsw_missed(const fsw_design *design, fsw_state *state, uint16_t periods);

/* A fault: the safe levels at once, whatever the dwell, written to u [inputs]. In place of fsw_step, in each period for
 * as long as it lasts. x and w as in fsw_track. */
void fsw_safe(const fsw_design *design, fsw_state *state, const fsw_real *x, const fsw_real *w, fsw_real *u);

#ifdef __cplusplus
}
#endif
#endif
