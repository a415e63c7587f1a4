/* @title@. Made by foreswitch @version@; do not edit.
 *
 * foreswitch.h takes its limits from here, foreswitch.c the tables. A program says
 *
 *     #include "foreswitch_design.h"
 *     fsw_init(&@name@, &state);
 */
#if defined(FSW_LIMITS)

#define FSW_LIMITS_TAKEN
@limits@

#else

#ifndef FORESWITCH_DESIGN_H
#define FORESWITCH_DESIGN_H

#include "foreswitch.h"

#ifndef FSW_LIMITS_TAKEN
#error "foreswitch.h did not look for its limits: compile with -DFSW_EXPORTED"
#endif

#ifdef __cplusplus
extern "C"
#else
extern
#endif
const fsw_design @name@;

#endif

#ifdef FSW_DATA

#if defined(__cplusplus) && __cplusplus < 202002L && defined(__GNUC__)
#pragma GCC system_header /* compilers take designated initialisers, complete and in order, but would warn */
#endif

@tables@
#endif

#ifdef FSW_STEPS

/* A closed loop of this controller with its own model: what it was told, and what it did. In flash on an AVR, whose
 * constants otherwise take RAM. */
#ifdef __AVR__
#include <avr/pgmspace.h>
#define FSW_ROM PROGMEM
#define FSW_READ(row, i) memcpy_P(&(row), &fsw_rows[i], sizeof(row))
#else
#define FSW_ROM
#define FSW_READ(row, i) ((row) = fsw_rows[i])
#endif

enum { FSW_ROWS = @rows@ };

typedef struct {
    fsw_real x[@measured@], reference[@reference@], w[@disturbances@];
    uint8_t command[@inputs@], status; /* level indices, fsw_status */
    fsw_real cost;
} fsw_row;

static const fsw_row fsw_rows[FSW_ROWS] FSW_ROM = {
@steps@
};

/* The state after the last row. */
static const fsw_real fsw_last_x[FSW_MAX_STATES] = @last_x@;
static const fsw_real fsw_last_w[FSW_MAX_DISTURBANCES] = @last_w@;

#endif
#endif
