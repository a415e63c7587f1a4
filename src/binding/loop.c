/* Whole runs: one with its record, many with their figures of merit. */
#include "types.h"

#include <string.h>

/* What a run needs besides its arrays: a law, a body (Plant or Rig), a sensor or none. */
typedef struct {
    const Law *law;
    const fsw_plant *plant; /* or */
    fsw_rig *rig;
    Sensor *sensor;
    Py_ssize_t n, m, q, p, seen;
} parts;

static int gather(parts *c, PyObject *law, PyObject *body, PyObject *sensor, Py_ssize_t history)
{
    if (Py_TYPE(law) != predictive_type && Py_TYPE(law) != baseline_type)
        return PyErr_SetString(PyExc_TypeError, "law must be a Predictive or a Baseline"), 0;
    c->law = (Law *)law;
    c->plant = NULL, c->rig = NULL, c->sensor = NULL;
    Py_ssize_t longest = 0;
    if (Py_TYPE(body) == plant_type) {
        c->plant = &((Plant *)body)->plant;
        longest = ((Plant *)body)->longest;
        c->n = c->plant->states, c->m = c->plant->inputs, c->q = c->plant->outputs, c->p = c->plant->disturbances;
    } else if (Py_TYPE(body) == rig_type) {
        c->rig = &((Rig *)body)->rig;
        const fsw_truth *t = c->rig->truth;
        c->n = t->states, c->m = t->inputs, c->q = t->outputs, c->p = t->disturbances;
    } else
        return PyErr_SetString(PyExc_TypeError, "body must be a Plant or a Rig"), 0;
    if (sensor != Py_None) {
        if (Py_TYPE(sensor) != sensor_type)
            return PyErr_SetString(PyExc_TypeError, "sensor must be a Sensor or None"), 0;
        c->sensor = (Sensor *)sensor;
    }
    const Law *l = c->law;
    c->seen = l->from_outputs ? c->q : c->n;
    if (history < longest || history < 1 || c->m != l->inputs || c->q != l->outputs ||
        (l->disturbances > 0 && c->p != l->disturbances) ||
        (c->sensor ? c->sensor->seen != c->seen || c->sensor->sensor.measured != l->measured : l->measured != c->seen))
        return PyErr_SetString(PyExc_ValueError, "the run's sizes contradict each other"), 0;
    return 1;
}

/* One run's rows first..last, its record filled; 0: an exception is set. Call without the GIL. */
static int loop(const parts *c, const fsw_record *r, Py_ssize_t history, Py_ssize_t first, Py_ssize_t last)
{
    if (c->plant) {
        if (first == 0) fsw_plant_output(c->plant, r->x, r->y);
        fsw_run(c->law->law, c->plant, r, (uint64_t)first, (uint64_t)last);
        return 1;
    }
    if (first == 0) {
        fsw_rig_start(c->rig, r->u, (uint64_t)history);
        if (!c->rig->truth->output(c->rig->truth, 0, r->x, r->y)) return 0;
    }
    return fsw_rig_run(c->law->law, c->rig, r, (uint64_t)history, (uint64_t)first, (uint64_t)last);
}

/* Where the law looks, once x and y are in the record. */
static void look(const parts *c, fsw_record *r)
{
    r->seen = c->law->from_outputs ? r->y : r->x;
    r->seen_width = (uint32_t)c->seen;
}

/* run(law, body, sensor, seed, steps, history, tables, first, last): fill rows first..last of the arrays in place, by
 * the names of fsw_record; estimate: its trace, or None */
static PyObject *run(PyObject *module, PyObject *args)
{
    (void)module;
    PyObject *law, *body, *sensor, *tables;
    unsigned long long seed;
    Py_ssize_t steps, history, first, last;
    if (!PyArg_ParseTuple(args, "OOOKnnOnn", &law, &body, &sensor, &seed, &steps, &history, &tables, &first, &last))
        return NULL;
    parts c;
    if (!gather(&c, law, body, sensor, history)) return NULL;
    if (first < 0 || first > last || last > steps)
        return PyErr_SetString(PyExc_ValueError, "the rows are out of range"), NULL;
    fsw_record r = {.reference_width = c.law->reference_width};
    views v = {.count = 0};
    fsw_predictive *predictive = Py_TYPE(law) == predictive_type ? &((Predictive *)law)->core : NULL;
    const Py_ssize_t wide = predictive ? predictive->design.states + predictive->design.loads : 0;
    double *trace;
    const slot slots[] = {
        {"reference", 'd', steps * c.law->reference_width, 0, 0, &r.reference},
        {"w", 'd', steps * c.p, 0, c.p == 0, &r.w},
        {"load", 'd', steps * c.m, 0, 1, &r.load},
        {"x", 'd', (steps + 1) * c.n, 1, 0, &r.x},
        {"y", 'd', (steps + 1) * c.q, 1, 0, &r.y},
        {"u", 'd', (history + steps) * c.m, 1, 0, &r.u},
        {"cost", 'd', steps, 1, 0, &r.cost},
        {"nodes", 'I', steps, 1, 0, &r.nodes},
        {"status", 'B', steps, 1, 0, &r.status},
        {"estimate", 'd', steps * wide, 1, 1, &trace},
    };
    fsw_sensor reading;
    int ok = attach_tables(&v, tables, slots, COUNT(slots));
    if (ok && !(r.scratch = PyMem_Malloc(sizeof(double) * ((size_t)c.law->measured + 1)))) ok = (PyErr_NoMemory(), 0);
    if (ok) {
        r.u += history * c.m;
        if (c.p == 0) r.w = NULL;
        if (c.sensor) {
            reading = c.sensor->sensor;
            reading.seed = seed;
            r.sensor = &reading;
        }
        if (c.rig) c.rig->seed = seed;
        if (predictive && trace) predictive->trace = trace + first * wide;
        look(&c, &r);
        Py_BEGIN_ALLOW_THREADS;
        ok = loop(&c, &r, history, first, last);
        Py_END_ALLOW_THREADS;
        if (predictive) predictive->trace = NULL;
        PyMem_Free(r.scratch);
    }
    release(&v);
    return ok ? Py_NewRef(Py_None) : NULL;
}

/* batch(law, body, sensor, steps, history, tables): many runs of one loop, figures of merit only. By name: reference,
 * w, load, past [history][m], wanted [steps+1][q], safe [m], seeds [R], x0 [R][n], and out: rms [R][q], largest [R][q],
 * switches [R][m], on [R][m]. The law's state at entry is every run's first. */
static PyObject *batch(PyObject *module, PyObject *args)
{
    (void)module;
    PyObject *law, *body, *sensor, *tables;
    Py_ssize_t steps, history;
    if (!PyArg_ParseTuple(args, "OOOnnO", &law, &body, &sensor, &steps, &history, &tables)) return NULL;
    parts c;
    if (!gather(&c, law, body, sensor, history)) return NULL;
    if (c.rig && c.rig->truth != &((Rig *)body)->linear.truth)
        return PyErr_SetString(PyExc_ValueError, "only linear plants run in batches"), NULL;
    const Py_ssize_t runs = length_of(tables, "seeds");
    if (runs < 0) return NULL;
    fsw_record r = {.reference_width = c.law->reference_width};
    const double *past, *wanted, *safe, *x0;
    const uint64_t *seeds;
    double *rms, *largest, *switches, *on;
    views v = {.count = 0};
    const slot slots[] = {
        {"reference", 'd', steps * c.law->reference_width, 0, 0, &r.reference},
        {"w", 'd', steps * c.p, 0, c.p == 0, &r.w},
        {"load", 'd', steps * c.m, 0, 1, &r.load},
        {"past", 'd', history * c.m, 0, 0, &past},
        {"wanted", 'd', (steps + 1) * c.q, 0, 0, &wanted},
        {"safe", 'd', c.m, 0, 0, &safe},
        {"seeds", 'Q', runs, 0, 0, &seeds},
        {"x0", 'd', runs * c.n, 0, 0, &x0},
        {"rms", 'd', runs * c.q, 1, 0, &rms},
        {"largest", 'd', runs * c.q, 1, 0, &largest},
        {"switches", 'd', runs * c.m, 1, 0, &switches},
        {"on", 'd', runs * c.m, 1, 0, &on},
    };
    if (!attach_tables(&v, tables, slots, COUNT(slots))) return release(&v), NULL;
    if (c.p == 0) r.w = NULL;
    Predictive *predictive = Py_TYPE(law) == predictive_type ? (Predictive *)law : NULL;
    const size_t state = predictive ? (size_t)state_size(predictive) : 0;
    const size_t rows = (size_t)steps + 1;
    char *start = PyMem_Malloc(state + 1);
    double *x = PyMem_Calloc(rows * (size_t)c.n, sizeof *x), *y = PyMem_Calloc(rows * (size_t)c.q, sizeof *y);
    double *u = PyMem_Calloc(((size_t)history + rows) * (size_t)c.m, sizeof *u),
           *cost = PyMem_Calloc(rows, sizeof *cost);
    uint32_t *nodes = PyMem_Calloc(rows, sizeof *nodes);
    uint8_t *status = PyMem_Calloc(rows, sizeof *status);
    r.scratch = PyMem_Calloc((size_t)c.law->measured + 1, sizeof *r.scratch);
    const int ok = start && x && y && u && cost && nodes && status && r.scratch;
    if (ok) {
        if (predictive) memcpy(start, &predictive->core.state, state);
        r.x = x, r.y = y, r.u = u + history * c.m, r.cost = cost, r.nodes = nodes, r.status = status;
        look(&c, &r);
        fsw_sensor reading;
        if (c.sensor) {
            reading = c.sensor->sensor;
            r.sensor = &reading;
        }
        Py_BEGIN_ALLOW_THREADS;
        for (Py_ssize_t i = 0; i < runs; i++) {
            if (predictive)
                memcpy(&predictive->core.state, start, state);
            else
                fsw_baseline_reset(&((Baseline *)law)->core);
            memcpy(u, past, (size_t)(history * c.m) * sizeof *u);
            memcpy(x, x0 + i * c.n, (size_t)c.n * sizeof *x);
            if (c.sensor) reading.seed = seeds[i];
            if (c.rig) c.rig->seed = seeds[i];
            loop(&c, &r, history, 0, steps);
            fsw_metrics(rows, (uint32_t)c.q, (uint32_t)c.m, y, wanted, r.u, safe, rms + i * c.q, largest + i * c.q,
                        switches + i * c.m, on + i * c.m);
        }
        Py_END_ALLOW_THREADS;
    }
    PyMem_Free(start);
    PyMem_Free(x);
    PyMem_Free(y);
    PyMem_Free(u);
    PyMem_Free(cost);
    PyMem_Free(nodes);
    PyMem_Free(status);
    PyMem_Free(r.scratch);
    release(&v);
    return ok ? Py_NewRef(Py_None) : PyErr_NoMemory();
}

/* metrics(instants, q, m, tables): y, r, u, safe, and out rms, largest, switches, on */
static PyObject *metrics(PyObject *module, PyObject *args)
{
    (void)module;
    Py_ssize_t rows, q, m;
    PyObject *tables;
    if (!PyArg_ParseTuple(args, "nnnO", &rows, &q, &m, &tables)) return NULL;
    if (rows < 1) return PyErr_SetString(PyExc_ValueError, "a run has no rows; give at least one instant"), NULL;
    const double *y, *r, *u, *safe;
    double *rms, *largest, *switches, *on;
    views v = {.count = 0};
    const slot slots[] = {
        {"y", 'd', rows * q, 0, 0, &y},        {"r", 'd', rows * q, 0, 0, &r}, {"u", 'd', (rows - 1) * m, 0, 0, &u},
        {"safe", 'd', m, 0, 0, &safe},         {"rms", 'd', q, 1, 0, &rms},    {"largest", 'd', q, 1, 0, &largest},
        {"switches", 'd', m, 1, 0, &switches}, {"on", 'd', m, 1, 0, &on},
    };
    const int ok = attach_tables(&v, tables, slots, COUNT(slots));
    if (ok) fsw_metrics((uint64_t)rows, (uint32_t)q, (uint32_t)m, y, r, u, safe, rms, largest, switches, on);
    release(&v);
    return ok ? Py_NewRef(Py_None) : NULL;
}

PyMethodDef loop_functions[] = {
    {"run", run, METH_VARARGS, NULL},
    {"batch", batch, METH_VARARGS, NULL},
    {"metrics", metrics, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};
