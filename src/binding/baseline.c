#include "types.h"

static void baseline_dealloc(PyObject *object)
{
    Baseline *self = (Baseline *)object;
    release(&self->base.views);
    PyMem_Free(self->core.model);
    PyMem_Free(self->core.history);
    PyMem_Free(self->core.channels);
    PyMem_Free(self->core.wanted);
    Py_XDECREF(self->plant);
    dispose(object);
}

/* The levels and dwell of each input as the law's own channels; `safe` tells the level index of each. */
static int attach_channels(views *v, PyObject *tables, fsw_baseline *c, uint32_t m)
{
    const uint8_t *counts, *safe;
    const double *levels;
    const uint32_t *dwell;
    const slot first[] = {{"level_count", 'B', m, 0, 0, &counts}, {"safe", 'B', m, 0, 0, &safe}};
    if (!attach_tables(v, tables, first, COUNT(first))) return 0;
    Py_ssize_t total = 0;
    for (uint32_t j = 0; j < m; j++) total += counts[j];
    const slot slots[] = {{"levels", 'd', total, 0, 0, &levels}, {"dwell", 'I', total, 0, 0, &dwell}};
    if (!attach_tables(v, tables, slots, COUNT(slots))) return 0;
    for (uint32_t j = 0; j < m; j++) {
        fsw_channel *channel = c->channels + j;
        if (safe[j] >= counts[j] || counts[j] < 2)
            return PyErr_SetString(PyExc_ValueError, "a safe level is out of range"), 0;
        channel->levels = levels, channel->dwell = dwell;
        channel->level_count = counts[j], channel->safe = safe[j];
        levels += counts[j], dwell += counts[j];
    }
    return 1;
}

/* Baseline(plant, tables): a Plant, and by the names of fsw_baseline kind, order, gains and arrays */
static PyObject *baseline_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *plant, *tables;
    if (!PyArg_ParseTuple(args, "O!O", plant_type, &plant, &tables)) return NULL;
    const fsw_plant *model = &((Plant *)plant)->plant;
    const uint32_t n = model->states, m = model->inputs, q = model->outputs;
    Baseline *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_baseline *c = &self->core;
    uint8_t kind;
    const scalar scalars[] = {{"kind", 'B', &kind},
                              {"order", 'I', &c->order},
                              {"carrier", 'I', &c->carrier},
                              {"period", 'd', &c->period},
                              {"hysteresis", 'd', &c->hysteresis},
                              {"deadband", 'd', &c->deadband},
                              {"lead", 'd', &c->lead},
                              {"kp", 'd', &c->kp},
                              {"ki", 'd', &c->ki},
                              {"kd", 'd', &c->kd},
                              {"kf", 'd', &c->kf},
                              {"bias", 'd', &c->bias}};
    const Py_ssize_t forbidden = length_of(tables, "forbidden");
    if (forbidden < 0 || !read_scalars(tables, scalars, COUNT(scalars))) return Py_DECREF(self), NULL;
    if (n > FSW_MAX_STATES || q > FSW_MAX_OUTPUTS || c->order < 1 || c->carrier < 1 || kind > FSW_SMITH_PWM) {
        PyErr_SetString(PyExc_ValueError, "the baseline's sizes contradict each other");
        return Py_DECREF(self), NULL;
    }
    self->plant = Py_NewRef(plant);
    c->plant = model;
    c->channels = PyMem_Calloc(m, sizeof *c->channels);
    c->wanted = PyMem_Calloc(m, sizeof *c->wanted);
    c->model = PyMem_Calloc(2 * (size_t)n, sizeof *c->model);
    c->depth = ((Plant *)plant)->longest + 1;
    c->history = PyMem_Calloc((size_t)c->depth * m, sizeof *c->history);
    if (!c->channels || !c->wanted || !c->model || !c->history) return Py_DECREF(self), PyErr_NoMemory();
    views *v = &self->base.views;
    const slot slots[] = {{"rate", 'd', (Py_ssize_t)q * n, 0, 0, &c->rate},
                          {"mix", 'd', (Py_ssize_t)m * q, 0, 0, &c->mix},
                          {"forbidden", 'B', forbidden * m, 0, 0, &c->forbidden}};
    if (!attach_tables(v, tables, slots, COUNT(slots)) || !attach_channels(v, tables, c, m))
        return Py_DECREF(self), NULL;
    c->forbidden_count = (uint32_t)forbidden;
    c->kind = (fsw_baseline_kind)kind;
    c->law.step = fsw_baseline_step;
    fsw_baseline_reset(c);
    Law *base = &self->base;
    base->law = &c->law;
    base->measured = n, base->order = c->order, base->reference_width = q * c->order;
    base->disturbances = model->disturbances, base->inputs = m, base->outputs = q;
    return (PyObject *)self;
}

static PyObject *baseline_reset(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    fsw_baseline_reset(&((Baseline *)object)->core);
    Py_RETURN_NONE;
}

/* step(x, reference, w, u) on contiguous doubles of the full sizes; w may be None */
static PyObject *baseline_step(PyObject *object, PyObject *args)
{
    Law *base = (Law *)object;
    PyObject *x_object, *r_object, *w_object, *u_object;
    if (!PyArg_ParseTuple(args, "OOOO", &x_object, &r_object, &w_object, &u_object)) return NULL;
    views v = {.count = 0};
    const double *x, *r, *w;
    double *u;
    const slot slots[] = {{"x", 'd', base->measured, 0, 0, &x},
                          {"reference", 'd', base->reference_width, 0, 0, &r},
                          {"w", 'd', base->disturbances, 0, 1, &w},
                          {"u", 'd', base->inputs, 1, 0, &u}};
    const int ok = attach_arguments(&v, args, slots, COUNT(slots));
    if (ok) base->law->step(base->law, x, r, w, u);
    release(&v);
    if (!ok) return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef baseline_methods[] = {
    {"step", baseline_step, METH_VARARGS, NULL},
    {"reset", baseline_reset, METH_NOARGS, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot baseline_slots[] = {
    {Py_tp_new, baseline_new}, {Py_tp_dealloc, baseline_dealloc}, {Py_tp_methods, baseline_methods}, {0, NULL}};
PyType_Spec baseline_spec = {"foreswitch._binding." MODULE ".Baseline", sizeof(Baseline), 0, Py_TPFLAGS_DEFAULT,
                             baseline_slots};
