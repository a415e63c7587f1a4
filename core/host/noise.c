/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
#include "noise.h"

#include <math.h>

/* The output function of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): a bijection that passes BigCrush on a
 * counter. */
static uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static const uint64_t GOLDEN = 0x9e3779b97f4a7c15u; /* 2^64 / golden ratio, odd */

double fsw_uniform(uint64_t seed, fsw_stream stream, uint64_t index)
{
    /* seed and stream are mixed before the counter runs, so that neighbouring seeds share no numbers */
    const uint64_t origin = mix(mix(seed + GOLDEN) + (uint64_t)stream * GOLDEN);
    return (double)(mix(origin + (index + 1) * GOLDEN) >> 11) * 0x1p-53;
}

double fsw_normal(uint64_t seed, fsw_stream stream, uint64_t index)
{
    const double radius = fsw_uniform(seed, stream, 2 * index), angle = fsw_uniform(seed, stream, 2 * index + 1);
    return sqrt(-2.0 * log1p(-radius)) * cos(6.283185307179586 * angle);
}
