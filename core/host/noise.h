/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* Random numbers that depend only on (seed, stream, index): the same for any order, chunk or thread. Host only. */
#ifndef FORESWITCH_NOISE_H
#define FORESWITCH_NOISE_H

#include <stdint.h>

/* What a number is for; each use has its own stream. */
typedef enum { FSW_SENSOR_NOISE = 1, FSW_PROCESS_NOISE = 2, FSW_SAMPLE_LOST = 3, FSW_SAMPLE_LATE = 4 } fsw_stream;

/* Uniform in [0, 1), on 53 bits. */
double fsw_uniform(uint64_t seed, fsw_stream stream, uint64_t index);

/* Standard normal, by Box and Muller from the uniforms 2 index and 2 index + 1. */
double fsw_normal(uint64_t seed, fsw_stream stream, uint64_t index);

#endif
