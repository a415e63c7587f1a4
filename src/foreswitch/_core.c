/* Python binding of core/: arrays in, status out, no arithmetic. Built once per arithmetic
 * (_core_float64, _core_float32) on the stable ABI; arrays cross by the buffer protocol. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>
#include <stddef.h>
#include <string.h>

#include "baselines.h"
#include "foreswitch.h"
#include "loop.h"

#ifdef FSW_SINGLE
#define MODULE "_core_float32"
#define INIT PyInit__core_float32
#define REAL 'f'
#else
#define MODULE "_core_float64"
#define INIT PyInit__core_float64
#define REAL 'd'
#endif

/* ---- Arrays ---- */

enum { MAX_VIEWS = 32 };

/* Buffers that an object keeps alive, because its C struct points into them. */
typedef struct {
    Py_buffer view[MAX_VIEWS];
    int count;
} views;

static void release(views *v)
{
    while (v->count > 0) PyBuffer_Release(&v->view[--v->count]);
}

static Py_ssize_t width(char type) { return type == 'B' ? 1 : type == 'H' ? 2 : type == 'I' || type == 'f' ? 4 : 8; }

/* A contiguous array of `count` items of struct-module `type`; None gives null where that is allowed. */
static int attach(views *v, PyObject *object, const char *name, char type, Py_ssize_t count, int writable, int optional,
                  void *pointer)
{
    *(void **)pointer = NULL;
    if (optional && object == Py_None) return 1;
    if (v->count == MAX_VIEWS) return PyErr_SetString(PyExc_SystemError, "too many arrays"), 0;
    Py_buffer *view = &v->view[v->count];
    if (PyObject_GetBuffer(object, view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (writable ? PyBUF_WRITABLE : 0)) < 0)
        return 0;
    v->count++;
    if (view->format == NULL || view->format[0] != type || view->format[1] != 0 || view->len != count * width(type)) {
        PyErr_Format(PyExc_ValueError, "%s holds %zd bytes of type '%s'; %zd items of type '%c' are needed", name,
                     view->len, view->format ? view->format : "B", count, type);
        return 0;
    }
    *(void **)pointer = view->buf;
    return 1;
}

typedef struct {
    const char *name;
    char type;
    Py_ssize_t count;
    int writable, optional;
    void *pointer;
} slot;

/* Attach the tuple's items to the slots in order. */
static int attach_all(views *v, PyObject *arrays, const slot *slots, Py_ssize_t count)
{
    if (!PyTuple_Check(arrays) || PyTuple_Size(arrays) != count)
        return PyErr_Format(PyExc_ValueError, "%zd arrays are needed", count), 0;
    for (Py_ssize_t i = 0; i < count; i++)
        if (!attach(v, PyTuple_GetItem(arrays, i), slots[i].name, slots[i].type, slots[i].count, slots[i].writable,
                    slots[i].optional, slots[i].pointer))
            return 0;
    return 1;
}

#define COUNT(array) ((Py_ssize_t)(sizeof(array) / sizeof(array)[0]))

static void dispose(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    freefunc free_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    free_object(self);
    Py_DECREF(type);
}

/* ---- Plant ---- */

typedef struct {
    PyObject_HEAD views views;
    fsw_plant plant;
    uint32_t longest; /* delay */
} Plant;

static PyTypeObject *plant_type;

static void plant_dealloc(PyObject *object)
{
    release(&((Plant *)object)->views);
    dispose(object);
}

static PyObject *plant_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    unsigned int n, m, q, p;
    PyObject *arrays;
    if (!PyArg_ParseTuple(args, "(IIII)O", &n, &m, &q, &p, &arrays)) return NULL;
    Plant *self = (void *)PyType_GenericAlloc(type, 0) /* zeroed */;
    if (!self) return NULL;
    fsw_plant *c = &self->plant;
    c->states = n, c->inputs = m, c->outputs = q, c->disturbances = p;
    const Py_ssize_t N = n, M = m, Q = q, P = p;
    const slot slots[] = {
        {"transition", 'd', N * N, 0, 0, &c->transition},
        {"input_old", 'd', M * N, 0, 0, &c->input_old},
        {"input_new", 'd', M * N, 0, 0, &c->input_new},
        {"input_load", 'd', M * N, 0, 0, &c->input_load},
        {"disturbance", 'd', N * P, 0, 0, &c->disturbance},
        {"drift", 'd', N, 0, 0, &c->drift},
        {"delay", 'I', M, 0, 0, &c->delay},
        {"output", 'd', Q * N, 0, 0, &c->output},
        {"output_zero", 'd', Q, 0, 0, &c->output_zero},
    };
    if (!attach_all(&self->views, arrays, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    for (unsigned int j = 0; j < m; j++)
        if (c->delay[j] > self->longest) self->longest = c->delay[j];
    return (PyObject *)self;
}

/* ---- Laws: the core and the baselines ---- */

/* Every law object starts like this. */
typedef struct {
    PyObject_HEAD views views;
    fsw_law *law;
    uint32_t measured, reference_width, disturbances, inputs, outputs, order;
} Law;

typedef struct {
    Law base;
    fsw_predictive core;
    fsw_real *decision_costs;
    unsigned char status; /* of the latest step */
    /* Commands are handed out as rows of a block: numpy makes a view in half the time of an array. */
    PyObject *new_block, *block;
    views block_views;
    double *rows;
    Py_ssize_t next, count;
} Predictive;

typedef struct {
    Law base;
    fsw_baseline core;
    PyObject *plant;
} Baseline;

static PyTypeObject *predictive_type, *baseline_type;

static void predictive_dealloc(PyObject *object)
{
    Predictive *self = (Predictive *)object;
    release(&self->base.views);
    PyMem_Free(self->core.buffer);
    PyMem_Free(self->decision_costs);
    release(&self->block_views);
    Py_XDECREF(self->block);
    Py_XDECREF(self->new_block);
    dispose(object);
}

static PyObject *predictive_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    unsigned short n, m, q, p, order, rows, candidates, bad_limit;
    PyObject *arrays, *new_block;
    if (!PyArg_ParseTuple(args, "(HHHHHHHH)OO", &n, &m, &q, &p, &order, &rows, &candidates, &bad_limit, &arrays,
                          &new_block))
        return NULL;
    Predictive *self = (void *)PyType_GenericAlloc(type, 0) /* zeroed */;
    if (!self) return NULL;
    views *v = &self->base.views;
    fsw_predictive *core = &self->core;
    fsw_design *d = &core->design;
    const fsw_design sizes = {.states = n,
                              .inputs = m,
                              .outputs = q,
                              .disturbances = p,
                              .order = order,
                              .rows = rows,
                              .candidates = candidates,
                              .bad_limit = bad_limit};
    *d = sizes;
    const Py_ssize_t N = n, M = m, Q = q, P = p;
    /* these three give the sizes of the others */
    const slot first[] = {{"level_count", 'B', M, 0, 0, &d->level_count},
                          {"pending", 'H', M, 0, 0, &d->pending},
                          {"holds", 'H', M, 0, 0, &d->holds}};
    PyObject *head = PyTuple_Check(arrays) ? PyTuple_GetSlice(arrays, 0, COUNT(first)) : NULL;
    PyObject *tail = head ? PyTuple_GetSlice(arrays, COUNT(first), PyTuple_Size(arrays)) : NULL;
    int ok = tail && attach_all(v, head, first, COUNT(first));
    if (ok) {
        Py_ssize_t levels = 0, pending = 0, holds = 0;
        for (Py_ssize_t j = 0; j < M; j++) {
            levels += d->level_count[j];
            pending += (Py_ssize_t)d->pending[j] * d->level_count[j] * Q;
            holds += d->holds[j] * Q;
        }
        const slot slots[] = {
            {"exact levels", 'd', levels, 0, 0, &core->levels},
            {"levels", REAL, levels, 0, 0, &d->levels},
            {"candidate", 'B', candidates * M, 0, 0, &d->candidate},
            {"safe", 'B', M, 0, 0, &d->safe},
            {"state_row", REAL, Q * N, 0, 0, &d->state_row},
            {"disturbance_row", REAL, Q * P, 0, 0, &d->disturbance_row},
            {"offset", REAL, Q, 0, 0, &d->offset},
            {"reference_row", REAL, Q * order, 0, 0, &d->reference_row},
            {"half_weight", REAL, Q, 0, 0, &d->half_weight},
            {"pending_table", REAL, pending, 0, 0, &d->pending_table},
            {"hold_row", REAL, holds, 0, 0, &d->hold_row},
            {"total_row", REAL, Q * M, 0, 0, &d->total_row},
            {"rest_reference", REAL, M * Q, 0, 1, &d->rest_reference},
            {"rest_disturbance", REAL, M * P, 0, 1, &d->rest_disturbance},
            {"rest_offset", REAL, M, 0, 1, &d->rest_offset},
            {"dwell", 'I', levels, 0, 0, &d->dwell},
            {"switch_cost", REAL, M, 0, 0, &d->switch_cost},
            {"model_x", REAL, N * N, 0, 0, &d->model_x},
            {"model_old", REAL, M * N, 0, 0, &d->model_old},
            {"model_new", REAL, M * N, 0, 0, &d->model_new},
            {"model_w", REAL, N * P, 0, 0, &d->model_w},
            {"model_c", REAL, N, 0, 0, &d->model_c},
        };
        ok = attach_all(v, tail, slots, COUNT(slots));
    } else if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "arrays must be a tuple");
    Py_XDECREF(head);
    Py_XDECREF(tail);
    if (!ok) return Py_DECREF(self), NULL;
    self->new_block = Py_NewRef(new_block);

    const fsw_validity validity = fsw_init(d, &core->state);
    if (validity != FSW_VALID) {
        PyErr_SetString(PyExc_ValueError, validity == FSW_TOO_LARGE ? "the design is larger than the core's limits"
                                                                    : "the design contradicts itself");
        return Py_DECREF(self), NULL;
    }
    const size_t width = (size_t)q * order;
    core->buffer = PyMem_Malloc(sizeof(fsw_real) * ((size_t)n + width + p + m));
    self->decision_costs = PyMem_Malloc(sizeof(fsw_real) * candidates);
    if (!core->buffer || !self->decision_costs) return Py_DECREF(self), PyErr_NoMemory();
    core->law.step = fsw_predictive_step;
    Law *base = &self->base;
    base->law = &core->law;
    base->measured = n, base->reference_width = (uint32_t)width, base->disturbances = p;
    base->inputs = m, base->outputs = q, base->order = order;
    return (PyObject *)self;
}

static int is_finite(double v) { return v - v == 0; }

/* Doubles into `to`; -1: not of that form, or not finite where that is asked for (no error set), else how many, at most
 * `most`. What is finite in double and not in fsw_real passes: the core judges it. */
static Py_ssize_t read_array(PyObject *object, fsw_real *to, Py_ssize_t most, int dimensions, int finite)
{
    Py_buffer view;
    if (!PyObject_CheckBuffer(object)) return -1;
    if (PyObject_GetBuffer(object, &view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS) < 0) return PyErr_Clear(), -1;
    Py_ssize_t count = -1;
    if (view.format && view.format[0] == 'd' && view.format[1] == 0 && view.ndim == dimensions &&
        view.len <= 8 * most) {
        count = view.len / 8;
        const double *from = view.buf;
        for (Py_ssize_t i = 0; i < view.len / 8; i++) {
            if (finite && !is_finite(from[i])) count = -1;
            to[i] = (fsw_real)from[i];
        }
    }
    PyBuffer_Release(&view);
    return count;
}

/* x (n,), reference (scalar; (order,) for one output; canonical) and w (p,) or None into the buffer; 0 if any is of
 * another form or the reference is not finite: the caller's Python then words the complaint or converts. */
static int read_arguments(Predictive *self, PyObject *x, PyObject *reference, PyObject *w)
{
    const Law *base = &self->base;
    fsw_real *to = self->core.buffer, *r = to + base->measured, *v = r + base->reference_width;
    if (read_array(x, to, base->measured, 1, 0) != (Py_ssize_t)base->measured) return 0;
    Py_ssize_t given = 0;
    if (PyFloat_Check(reference)) {
        const double value = PyFloat_AsDouble(reference);
        if (!is_finite(value)) return 0;
        for (uint32_t i = 0; i < base->reference_width; i++) r[i] = i % base->order == 0 ? (fsw_real)value : 0;
        given = base->reference_width;
    } else {
        if (base->outputs == 1) given = read_array(reference, r, base->reference_width, 1, 1);
        if (given <= 0 && (given = read_array(reference, r, base->reference_width, 3, 1)) != base->reference_width)
            return 0;
        for (Py_ssize_t i = given; i < base->reference_width; i++) r[i] = 0;
    }
    if (w == Py_None)
        for (uint32_t i = 0; i < base->disturbances; i++) v[i] = 0;
    else if (read_array(w, v, base->disturbances, 1, 0) != (Py_ssize_t)base->disturbances)
        return 0;
    return 1;
}

/* A new array (inputs,) and where its values lie. */
static PyObject *new_command(Predictive *self, double **u)
{
    const Py_ssize_t m = self->base.inputs;
    if (self->next == self->count) {
        release(&self->block_views);
        Py_CLEAR(self->block);
        self->next = self->count = 0;
        if (!(self->block = PyObject_CallNoArgs(self->new_block))) return NULL;
        const Py_ssize_t count = PySequence_Size(self->block);
        if (count < 1 || !attach(&self->block_views, self->block, "block", 'd', count * m, 1, 0, &self->rows))
            return NULL;
        self->count = count;
    }
    *u = self->rows + self->next * m;
    return PySequence_GetItem(self->block, self->next++);
}

/* step(x, reference, w) -> the command, a new array; or None if an argument is not in the plain form */
static PyObject *predictive_step(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    Predictive *self = (Predictive *)object;
    if (count != 3) return PyErr_SetString(PyExc_TypeError, "step takes x, reference, w"), NULL;
    if (!read_arguments(self, args[0], args[1], args[2])) Py_RETURN_NONE;
    double *u;
    PyObject *command_array = new_command(self, &u);
    if (!command_array) return NULL;
    fsw_predictive *core = &self->core;
    fsw_real *x = core->buffer, *r = x + self->base.measured, *w = r + self->base.reference_width;
    self->status = (unsigned char)fsw_step(&core->design, &core->state, x, r, w, w + self->base.disturbances).status;
    const uint8_t *command = fsw_issued(&core->design, &core->state, 1);
    const double *levels = core->levels;
    for (uint32_t j = 0; j < self->base.inputs; j++) {
        u[j] = levels[command[j]];
        levels += core->design.level_count[j];
    }
    return command_array;
}

/* decide(x, reference, w, costs) -> (candidate, cost, nodes, status), or None as above */
static PyObject *predictive_decide(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    Predictive *self = (Predictive *)object;
    if (count != 4) return PyErr_SetString(PyExc_TypeError, "decide takes x, reference, w, costs"), NULL;
    if (!read_arguments(self, args[0], args[1], args[2])) Py_RETURN_NONE;
    views v = {.count = 0};
    double *costs;
    const fsw_design *d = &self->core.design;
    if (!attach(&v, args[3], "costs", 'd', d->candidates, 1, 0, &costs)) return release(&v), NULL;
    const fsw_real *x = self->core.buffer, *r = x + self->base.measured, *w = r + self->base.reference_width;
    const fsw_decision decision = fsw_decide(d, &self->core.state, x, r, w, self->decision_costs);
    for (uint16_t i = 0; i < d->candidates; i++) costs[i] = (double)self->decision_costs[i];
    release(&v);
    return Py_BuildValue("idii", (int)decision.candidate, (double)decision.cost, (int)decision.nodes,
                         (int)decision.status);
}

/* preload(line, wait): commands under way and running dwell */
static PyObject *predictive_preload(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    PyObject *line_object, *wait_object;
    if (!PyArg_ParseTuple(args, "OO", &line_object, &wait_object)) return NULL;
    views v = {.count = 0};
    const fsw_design *d = &self->core.design;
    const uint8_t *line;
    const uint32_t *wait;
    if (!attach(&v, line_object, "line", 'B', (Py_ssize_t)d->rows * d->inputs, 0, 0, &line) ||
        !attach(&v, wait_object, "wait", 'I', d->inputs, 0, 0, &wait))
        return release(&v), NULL;
    const fsw_validity validity = (fsw_init(d, &self->core.state), fsw_preload(d, &self->core.state, line, wait));
    self->status = FSW_OK;
    release(&v);
    if (validity != FSW_VALID) return PyErr_SetString(PyExc_ValueError, "a level index is out of range"), NULL;
    Py_RETURN_NONE;
}

/* line() -> bytes: level indices of the commands issued, oldest first, the present one last */
static PyObject *predictive_line(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    Predictive *self = (Predictive *)object;
    const fsw_design *d = &self->core.design;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, (Py_ssize_t)d->rows * d->inputs);
    if (!bytes) return NULL;
    char *to = PyBytes_AsString(bytes);
    for (uint16_t age = d->rows; age > 0; age--, to += d->inputs)
        memcpy(to, fsw_issued(d, &self->core.state, age), d->inputs);
    return bytes;
}

/* The core's state without the unused end of its line. */
static Py_ssize_t state_size(const Predictive *self)
{
    return (Py_ssize_t)(offsetof(fsw_state, line) + (size_t)self->core.design.rows * self->core.design.inputs);
}

/* save() -> bytes: the status, then the state */
static PyObject *predictive_save(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    Predictive *self = (Predictive *)object;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, 1 + state_size(self));
    if (!bytes) return NULL;
    char *to = PyBytes_AsString(bytes);
    to[0] = (char)self->status;
    memcpy(to + 1, &self->core.state, (size_t)state_size(self));
    return bytes;
}

static PyObject *predictive_restore(PyObject *object, PyObject *bytes)
{
    Predictive *self = (Predictive *)object;
    char *from;
    Py_ssize_t size;
    if (PyBytes_AsStringAndSize(bytes, &from, &size) < 0) return NULL;
    if (size != 1 + state_size(self))
        return PyErr_SetString(PyExc_ValueError, "the saved state is of another design"), NULL;
    self->status = (unsigned char)from[0];
    memcpy(&self->core.state, from + 1, (size_t)state_size(self));
    Py_RETURN_NONE;
}

static void baseline_dealloc(PyObject *object)
{
    Baseline *self = (Baseline *)object;
    release(&self->base.views);
    PyMem_Free(self->core.model);
    PyMem_Free(self->core.history);
    Py_XDECREF(self->plant);
    dispose(object);
}

static PyObject *baseline_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *plant, *rate, *levels, *dwell;
    int kind;
    unsigned int order, safe, carrier;
    double period, hysteresis, deadband, lead, kp, ki, kd, kf, bias;
    if (!PyArg_ParseTuple(args, "iO!OOOIId(ddd)(dddddI)", &kind, plant_type, &plant, &rate, &levels, &dwell, &order,
                          &safe, &period, &hysteresis, &deadband, &lead, &kp, &ki, &kd, &kf, &bias, &carrier))
        return NULL;
    Baseline *self = (void *)PyType_GenericAlloc(type, 0) /* zeroed */;
    if (!self) return NULL;
    fsw_baseline *c = &self->core;
    Py_INCREF(plant);
    self->plant = plant;
    c->plant = &((Plant *)plant)->plant;
    const uint32_t n = c->plant->states;
    const Py_ssize_t count = PyObject_Size(levels);
    views *v = &self->base.views;
    if (count < 0 || !attach(v, rate, "rate", 'd', n, 0, 0, &c->rate) ||
        !attach(v, levels, "levels", 'd', count, 0, 0, &c->levels) ||
        !attach(v, dwell, "dwell", 'I', count, 0, 0, &c->dwell))
        return Py_DECREF(self), NULL;
    if (c->plant->inputs != 1 || c->plant->outputs != 1 || n > FSW_MAX_STATES || count < 2 || safe >= (size_t)count ||
        order < 1 || carrier < 1) {
        PyErr_SetString(PyExc_ValueError,
                        "a baseline takes one input, one output, two levels or more and a carrier >= 1");
        return Py_DECREF(self), NULL;
    }
    c->kind = (fsw_baseline_kind)kind;
    c->order = order, c->level_count = (uint32_t)count, c->safe = safe, c->period = period;
    c->hysteresis = hysteresis, c->deadband = deadband, c->lead = lead;
    c->kp = kp, c->ki = ki, c->kd = kd, c->kf = kf, c->bias = bias, c->carrier = carrier;
    c->model = PyMem_Calloc(2 * (size_t)n, sizeof(double));
    c->history = PyMem_Calloc((size_t)c->plant->delay[0] + 1, sizeof(double));
    if (!c->model || !c->history) return Py_DECREF(self), PyErr_NoMemory();
    c->law.step = fsw_baseline_step;
    fsw_baseline_reset(c);
    Law *base = &self->base;
    base->law = &c->law;
    base->measured = n, base->reference_width = order, base->order = order;
    base->disturbances = c->plant->disturbances, base->inputs = base->outputs = 1;
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
    const int ok = attach_all(&v, args, slots, COUNT(slots));
    if (ok) base->law->step(base->law, x, r, w, u);
    release(&v);
    if (!ok) return NULL;
    Py_RETURN_NONE;
}

/* ---- Closed loop ---- */

/* run(law, plant, steps, history, arrays, first, last): fill rows first..last of the arrays in place */
static PyObject *run(PyObject *module, PyObject *args)
{
    (void)module;
    PyObject *law_object, *plant_object, *arrays;
    Py_ssize_t steps, history, first, last;
    if (!PyArg_ParseTuple(args, "OO!nnOnn", &law_object, plant_type, &plant_object, &steps, &history, &arrays, &first,
                          &last))
        return NULL;
    if (Py_TYPE(law_object) != predictive_type && Py_TYPE(law_object) != baseline_type)
        return PyErr_SetString(PyExc_TypeError, "law must be a Predictive or a Baseline"), NULL;
    const Law *law = (Law *)law_object;
    const fsw_plant *p = &((Plant *)plant_object)->plant;
    if (first < 0 || first > last || last > steps || history < (Py_ssize_t)((Plant *)plant_object)->longest ||
        p->inputs != law->inputs || p->outputs != law->outputs ||
        (law->disturbances > 0 && p->disturbances != law->disturbances))
        return PyErr_SetString(PyExc_ValueError, "the run's sizes contradict each other"), NULL;
    const Py_ssize_t n = p->states, m = p->inputs, q = p->outputs, d = p->disturbances, z = law->measured;
    fsw_record r = {.measured = law->measured, .reference_width = law->reference_width};
    views v = {.count = 0};
    const slot slots[] = {
        {"sensor", 'd', z * n, 0, 1, &r.sensor},
        {"noise", 'd', steps * z, 0, 1, &r.noise},
        {"reference", 'd', steps * law->reference_width, 0, 0, &r.reference},
        {"w", 'd', steps * d, 0, d == 0, &r.w},
        {"load", 'd', steps * m, 0, 1, &r.load},
        {"x", 'd', (steps + 1) * n, 1, 0, &r.x},
        {"y", 'd', (steps + 1) * q, 1, 0, &r.y},
        {"u", 'd', (history + steps) * m, 1, 0, &r.u},
        {"cost", 'd', steps, 1, 0, &r.cost},
        {"nodes", 'I', steps, 1, 0, &r.nodes},
        {"status", 'B', steps, 1, 0, &r.status},
    };
    PyObject *result = NULL;
    if (!attach_all(&v, arrays, slots, COUNT(slots))) goto done;
    if (!r.sensor && z != n) {
        PyErr_SetString(PyExc_ValueError, "a sensor matrix is needed where the law's state is not the plant's");
        goto done;
    }
    r.u += history * m;
    r.scratch = PyMem_Malloc(sizeof(double) * (size_t)(z > 0 ? z : 1));
    if (!r.scratch) {
        PyErr_NoMemory();
        goto done;
    }
    Py_BEGIN_ALLOW_THREADS;
    fsw_run(law->law, p, &r, (uint64_t)first, (uint64_t)last);
    Py_END_ALLOW_THREADS;
    PyMem_Free(r.scratch);
    result = Py_NewRef(Py_None);
done:
    release(&v);
    return result;
}

/* ---- Module ---- */

#define FAST(function) ((PyCFunction)(void (*)(void))(function))

static PyMethodDef predictive_methods[] = {
    {"step", FAST(predictive_step), METH_FASTCALL, NULL},
    {"decide", FAST(predictive_decide), METH_FASTCALL, NULL},
    {"preload", predictive_preload, METH_VARARGS, NULL},
    {"line", predictive_line, METH_NOARGS, NULL},
    {"save", predictive_save, METH_NOARGS, NULL},
    {"restore", predictive_restore, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};
static PyMemberDef predictive_members[] = {
    {"status", T_UBYTE, offsetof(Predictive, status), READONLY, NULL},
    {NULL, 0, 0, 0, NULL},
};
static PyMethodDef baseline_methods[] = {
    {"step", baseline_step, METH_VARARGS, NULL},
    {"reset", baseline_reset, METH_NOARGS, NULL},
    {NULL, NULL, 0, NULL},
};
static PyMethodDef functions[] = {{"run", run, METH_VARARGS, NULL}, {NULL, NULL, 0, NULL}};

static PyType_Slot plant_slots[] = {{Py_tp_new, plant_new}, {Py_tp_dealloc, plant_dealloc}, {0, NULL}};
static PyType_Slot predictive_slots[] = {{Py_tp_new, predictive_new},
                                         {Py_tp_dealloc, predictive_dealloc},
                                         {Py_tp_methods, predictive_methods},
                                         {Py_tp_members, predictive_members},
                                         {0, NULL}};
static PyType_Slot baseline_slots[] = {
    {Py_tp_new, baseline_new}, {Py_tp_dealloc, baseline_dealloc}, {Py_tp_methods, baseline_methods}, {0, NULL}};
static PyType_Spec plant_spec = {"foreswitch." MODULE ".Plant", sizeof(Plant), 0, Py_TPFLAGS_DEFAULT, plant_slots};
static PyType_Spec predictive_spec = {"foreswitch." MODULE ".Predictive", sizeof(Predictive), 0, Py_TPFLAGS_DEFAULT,
                                      predictive_slots};
static PyType_Spec baseline_spec = {"foreswitch." MODULE ".Baseline", sizeof(Baseline), 0, Py_TPFLAGS_DEFAULT,
                                    baseline_slots};

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec, const char *name)
{
    PyObject *type = PyType_FromSpec(spec);
    if (type && PyModule_AddObjectRef(module, name, type) < 0) Py_CLEAR(type);
    return (PyTypeObject *)type;
}

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, MODULE, NULL, -1, functions, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC INIT(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (!module) return NULL;
    plant_type = add_type(module, &plant_spec, "Plant");
    predictive_type = add_type(module, &predictive_spec, "Predictive");
    baseline_type = add_type(module, &baseline_spec, "Baseline");
    const int limits[] = {FSW_MAX_STATES, FSW_MAX_INPUTS, FSW_MAX_OUTPUTS, FSW_MAX_DISTURBANCES, FSW_MAX_LINE};
    const char *names[] = {"MAX_STATES", "MAX_INPUTS", "MAX_OUTPUTS", "MAX_DISTURBANCES", "MAX_LINE"};
    for (int i = 0; i < 5; i++)
        if (PyModule_AddIntConstant(module, names[i], limits[i]) < 0) return Py_DECREF(module), NULL;
    if (!plant_type || !predictive_type || !baseline_type) return Py_DECREF(module), NULL;
    return module;
}
