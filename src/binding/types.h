/* The bound types: each in a C file of its own, gathered by module.c. Built once per arithmetic of the core. */
#ifndef FORESWITCH_BINDING_TYPES_H
#define FORESWITCH_BINDING_TYPES_H

#include "arrays.h"

#include "baselines.h"
#include "foreswitch.h"
#include "loop.h"
#include "rig.h"

#ifdef FSW_SINGLE
#define MODULE "_core_float32"
#define REAL 'f'
#else
#define MODULE "_core_float64"
#define REAL 'd'
#endif

/* A linear plant over one period. */
typedef struct {
    PyObject_HEAD views views;
    fsw_plant plant;
    uint32_t longest; /* delay */
} Plant;

/* Every law object starts like this. */
typedef struct {
    PyObject_HEAD views views;
    fsw_law *law;
    uint32_t measured, reference_width, disturbances, inputs, outputs, order;
    int from_outputs; /* what is measured is y, else x */
} Law;

/* The core with a design. */
typedef struct {
    Law base;
    fsw_predictive core;
    fsw_horizon horizon; /* where the design has one */
    views horizon_views;
    fsw_real *decision_costs;
    unsigned char status; /* of the latest step */
    /* Commands are handed out as rows of a block: numpy makes a view in half the time of an array. */
    PyObject *new_block, *block;
    views block_views;
    double *rows;
    Py_ssize_t next, count;
} Predictive;

/* The core's state without the unused end of its line. */
Py_ssize_t state_size(const Predictive *self);

/* What people use today. */
typedef struct {
    Law base;
    fsw_baseline core;
    PyObject *plant;
} Baseline;

/* What stands between the plant and the law. */
typedef struct {
    PyObject_HEAD views views;
    fsw_sensor sensor;
    uint32_t seen; /* states or outputs */
} Sensor;

/* A truth stepped by Python: advance(k, x, levels, w, next) and output(x, y) on memory views. */
typedef struct {
    fsw_truth truth;
    uint32_t segments;
    PyObject *advance, *output;
} Called;

/* A plant behind real actuators, linear or stepped by Python. */
typedef struct {
    PyObject_HEAD views views;
    fsw_rig rig;
    fsw_linear linear;
    Called called;
    fsw_stuck *stuck;
} Rig;

extern PyType_Spec plant_spec, predictive_spec, baseline_spec, sensor_spec, rig_spec;
extern PyTypeObject *plant_type, *predictive_type, *baseline_type, *sensor_type, *rig_type; /* set once, at import */
extern PyMethodDef loop_functions[];

#endif
