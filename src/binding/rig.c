#include "types.h"

static PyObject *view_of(const double *data, size_t count, int flags)
{
    static double nothing[1];
    return PyMemoryView_FromMemory((char *)(data ? data : nothing), (Py_ssize_t)(count * sizeof *data), flags);
}

static int called_advance(fsw_truth *truth, uint64_t k, const double *x, const double *levels, const double *w,
                          double *next)
{
    Called *self = (Called *)truth;
    const PyGILState_STATE gil = PyGILState_Ensure();
    PyObject *a = view_of(x, truth->states, PyBUF_READ);
    PyObject *b = view_of(levels, (size_t)self->segments * truth->inputs, PyBUF_READ);
    PyObject *c = view_of(w, w ? truth->disturbances : 0, PyBUF_READ);
    PyObject *d = view_of(next, truth->states, PyBUF_WRITE);
    PyObject *result = NULL;
    if (a && b && c && d) result = PyObject_CallFunction(self->advance, "KOOOO", (unsigned long long)k, a, b, c, d);
    Py_XDECREF(a);
    Py_XDECREF(b);
    Py_XDECREF(c);
    Py_XDECREF(d);
    const int ok = result != NULL;
    Py_XDECREF(result);
    PyGILState_Release(gil);
    return ok;
}

static int called_output(fsw_truth *truth, uint64_t k, const double *x, double *y)
{
    (void)k;
    Called *self = (Called *)truth;
    const PyGILState_STATE gil = PyGILState_Ensure();
    PyObject *a = view_of(x, truth->states, PyBUF_READ), *b = view_of(y, truth->outputs, PyBUF_WRITE), *result = NULL;
    if (a && b) result = PyObject_CallFunction(self->output, "OO", a, b);
    Py_XDECREF(a);
    Py_XDECREF(b);
    const int ok = result != NULL;
    Py_XDECREF(result);
    PyGILState_Release(gil);
    return ok;
}

static void rig_dealloc(PyObject *object)
{
    Rig *self = (Rig *)object;
    release(&self->views);
    Py_XDECREF(self->called.advance);
    Py_XDECREF(self->called.output);
    PyMem_Free(self->stuck);
    PyMem_Free(self->rig.actuators.command);
    PyMem_Free(self->rig.actuators.count);
    PyMem_Free(self->rig.actuators.edges);
    PyMem_Free(self->rig.levels);
    dispose(object);
}

static int rig_faults(Rig *self, PyObject *faults, uint32_t inputs)
{
    const Py_ssize_t count = PyTuple_Check(faults) ? PyTuple_Size(faults) : -1;
    if (count < 0) return PyErr_SetString(PyExc_TypeError, "faults must be a tuple"), 0;
    self->stuck = PyMem_Calloc((size_t)count + 1, sizeof *self->stuck);
    if (!self->stuck) return PyErr_NoMemory(), 0;
    for (Py_ssize_t i = 0; i < count; i++) {
        unsigned long long from, to;
        if (!PyArg_ParseTuple(PyTuple_GetItem(faults, i), "IdKK", &self->stuck[i].input, &self->stuck[i].level, &from,
                              &to))
            return 0;
        self->stuck[i].from = from, self->stuck[i].to = to;
        if (self->stuck[i].input >= inputs) return PyErr_SetString(PyExc_ValueError, "no such input"), 0;
    }
    self->rig.stuck = self->stuck;
    self->rig.faults = (uint32_t)count;
    return 1;
}

/* Memory of the actuators, once their timing is there. */
static int rig_actuators(fsw_rig *rig, uint32_t m, uint32_t segments)
{
    fsw_actuators *a = &rig->actuators;
    a->inputs = m, a->segments = segments;
    for (uint32_t j = 0; j < m; j++) {
        const uint32_t longest = a->rise[j] > a->fall[j] ? a->rise[j] : a->fall[j];
        if (longest / segments + 2 > a->capacity) a->capacity = longest / segments + 2;
    }
    a->command = PyMem_Calloc(2 * (size_t)m, sizeof *a->command);
    a->level = a->command + m;
    a->count = PyMem_Calloc(m, sizeof *a->count);
    a->edges = PyMem_Calloc((size_t)m * a->capacity, sizeof *a->edges);
    rig->levels = PyMem_Calloc((size_t)segments * m, sizeof *rig->levels);
    return a->command && a->count && a->edges && rig->levels ? 1 : (PyErr_NoMemory(), 0);
}

/* Rig(tables, faults, called): by the names of fsw_actuators and fsw_linear; faults are (input, level, from, to) in
 * periods; called is None for a linear plant, or (advance, output), and then the plant's own tables are not read */
static PyObject *rig_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *tables, *faults, *called;
    if (!PyArg_ParseTuple(args, "OOO", &tables, &faults, &called)) return NULL;
    Rig *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_rig *rig = &self->rig;
    fsw_truth sizes = {.states = 0};
    uint32_t segments, pieces;
    uint64_t length;
    const scalar scalars[] = {{"states", 'I', &sizes.states},   {"inputs", 'I', &sizes.inputs},
                              {"outputs", 'I', &sizes.outputs}, {"disturbances", 'I', &sizes.disturbances},
                              {"segments", 'I', &segments},     {"pieces", 'I', &pieces},
                              {"length", 'Q', &length}};
    if (!read_scalars(tables, scalars, COUNT(scalars))) return Py_DECREF(self), NULL;
    if (sizes.states > FSW_MAX_STATES || sizes.inputs == 0 || segments == 0 || pieces == 0 || length == 0) {
        PyErr_SetString(PyExc_ValueError, "the rig's sizes are out of range");
        return Py_DECREF(self), NULL;
    }
    const Py_ssize_t N = sizes.states, M = sizes.inputs, Q = sizes.outputs, P = sizes.disturbances, S = segments,
                     R = pieces;
    fsw_actuators *a = &rig->actuators;
    const slot times[] = {
        {"rise", 'I', M, 0, 0, &a->rise}, {"fall", 'I', M, 0, 0, &a->fall}, {"process", 'd', N, 0, 1, &rig->process}};
    if (!attach_tables(&self->views, tables, times, COUNT(times)) || !rig_faults(self, faults, sizes.inputs) ||
        !rig_actuators(rig, sizes.inputs, segments))
        return Py_DECREF(self), NULL;
    if (called != Py_None) {
        Called *c = &self->called;
        PyObject *advance, *output;
        if (!PyArg_ParseTuple(called, "OO", &advance, &output)) return Py_DECREF(self), NULL;
        c->truth = sizes;
        c->truth.advance = called_advance, c->truth.output = called_output;
        c->segments = segments;
        c->advance = Py_NewRef(advance), c->output = Py_NewRef(output);
        rig->truth = &c->truth;
        return (PyObject *)self;
    }
    fsw_linear *l = &self->linear;
    l->truth = sizes;
    l->truth.advance = fsw_linear_advance, l->truth.output = fsw_linear_output;
    l->segments = segments, l->pieces = pieces, l->length = length;
    const slot slots[] = {
        {"transition", 'd', R * S * N * N, 0, 0, &l->transition},
        {"input", 'd', R * S * M * N, 0, 0, &l->input},
        {"disturbance", 'd', R * S * N * P, 0, 0, &l->disturbance},
        {"drift", 'd', R * S * N, 0, 0, &l->drift},
        {"output", 'd', R * Q * N, 0, 0, &l->output},
        {"output_zero", 'd', R * Q, 0, 0, &l->output_zero},
    };
    if (!attach_tables(&self->views, tables, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    rig->truth = &l->truth;
    return (PyObject *)self;
}

static PyType_Slot rig_slots[] = {{Py_tp_new, rig_new}, {Py_tp_dealloc, rig_dealloc}, {0, NULL}};
PyType_Spec rig_spec = {"foreswitch._binding." MODULE ".Rig", sizeof(Rig), 0, Py_TPFLAGS_DEFAULT, rig_slots};
