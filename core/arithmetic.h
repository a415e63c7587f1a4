/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* What the core's sources compute with besides the types of foreswitch.h. Private to them: these names bear no prefix.
 */
#ifndef FORESWITCH_ARITHMETIC_H
#define FORESWITCH_ARITHMETIC_H

#include "foreswitch.h"

/* Where a design's sizes are fixed, compile as for the simulation even where nobody can pass a flag: products and sums
 * not fused, or last bits would differ, and loops of a few numbers not turned into calls of memcpy and memset. */
#if defined(FSW_FIXED) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off", "no-tree-loop-distribute-patterns")
#endif

/* Functions get copies with constant sizes, which pay only where they are really made. Where size counts there is one
 * copy, unless a source says FOLDS: its constants fold so far that no call would be shorter. */
#if defined(__GNUC__) && (defined(FOLDS) || !defined(__OPTIMIZE_SIZE__))
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

/* Counts and subscripts in the machine's own width: 16 bits on an AVR, a register elsewhere. */
typedef uint_fast16_t natural;

/* sum + a'b over [count], in this order: every build gives the same bits. */
INLINE fsw_real product(fsw_real sum, const fsw_real *a, const fsw_real *b, natural count)
{
    for (natural i = 0; i < count; i++) sum += a[i] * b[i];
    return sum;
}

#endif
