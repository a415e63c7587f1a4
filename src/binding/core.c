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
#include "rig.h"

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

enum { MAX_VIEWS = 40 };

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
    const char given = view->format && view->format[0] == 'L' && view->itemsize == 8 ? 'Q'
                       : view->format                                                ? view->format[0]
                                                                                     : 0;
    if (given != type || view->format[1] != 0 || view->len != count * width(type)) {
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
    int from_outputs; /* what is measured is y, else x */
} Law;

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

typedef struct {
    Law base;
    fsw_baseline core;
    PyObject *plant;
} Baseline;

static PyTypeObject *predictive_type, *baseline_type;

static void predictive_dealloc(PyObject *object)
{
    Predictive *self = (Predictive *)object;
    release(&self->horizon_views);
    release(&self->base.views);
    PyMem_Free(self->core.buffer);
    PyMem_Free(self->decision_costs);
    release(&self->block_views);
    Py_XDECREF(self->block);
    Py_XDECREF(self->new_block);
    dispose(object);
}

/* The horizon of a design from (sizes, scalars, arrays); level counts and pending of the design must be there. */
static int attach_horizon(views *v, PyObject *parts, const fsw_design *d, fsw_horizon *h)
{
    unsigned int steps, moves, states, order, lead, terminal, tail, exclusive, dominance, patience, budget;
    double far;
    PyObject *arrays;
    if (!PyArg_ParseTuple(parts, "(IIIIIIIIIII)dO", &steps, &moves, &states, &order, &lead, &terminal, &tail,
                          &exclusive, &dominance, &patience, &budget, &far, &arrays))
        return 0;
    const fsw_horizon sizes = {.steps = (uint16_t)steps,
                               .moves = (uint16_t)moves,
                               .states = (uint16_t)states,
                               .inputs = d->inputs,
                               .outputs = d->outputs,
                               .candidates = d->candidates,
                               .disturbances = d->disturbances,
                               .order = (uint16_t)order,
                               .lead = (uint16_t)lead,
                               .terminal = (uint16_t)terminal,
                               .tail = (uint8_t)tail,
                               .exclusive = (uint8_t)exclusive,
                               .dominance = (uint8_t)dominance,
                               .patience = patience,
                               .node_budget = budget,
                               .far = (fsw_real)far};
    *h = sizes;
    const Py_ssize_t n = states, m = d->inputs, q = d->outputs, p = d->disturbances, C = d->candidates, K = moves,
                     N = steps, T = terminal;
    Py_ssize_t pending = 0;
    for (Py_ssize_t j = 0; j < m; j++) pending += (Py_ssize_t)d->pending[j] * d->level_count[j] * n;
    const slot slots[] = {
        {"start_row", REAL, n * d->states, 0, 0, &h->start_row},
        {"start_disturbance", REAL, n * p, 0, 0, &h->start_disturbance},
        {"start_offset", REAL, n, 0, 0, &h->start_offset},
        {"pending_table", REAL, pending, 0, 0, &h->pending_table},
        {"drift", REAL, n, 0, 0, &h->drift},
        {"drift_disturbance", REAL, n * p, 0, 0, &h->drift_disturbance},
        {"row_disturbance", REAL, q * p, 0, 0, &h->row_disturbance},
        {"row_offset", REAL, q, 0, 0, &h->row_offset},
        {"reference_row", REAL, q * order, 0, 0, &h->reference_row},
        {"terminal_reference", REAL, T * q, 0, 0, &h->terminal_reference},
        {"terminal_disturbance", REAL, T * p, 0, 0, &h->terminal_disturbance},
        {"terminal_offset", REAL, T, 0, 0, &h->terminal_offset},
        {"F", REAL, n * n, 0, 0, &h->F},
        {"G", REAL, n * m, 0, 0, &h->G},
        {"S", REAL, q * n, 0, 0, &h->S},
        {"root_weight", REAL, N * q, 0, 0, &h->root_weight},
        {"T", REAL, T * n, 0, 0, &h->T},
        {"move_weight", REAL, m, 0, 0, &h->move_weight},
        {"lift", REAL, K * m, 0, 0, &h->lift},
        {"lift_centre", REAL, K * m, 0, 0, &h->lift_centre},
        {"last_value", REAL, (n + m) * (n + m), 0, 0, &h->last_value},
        {"hull", REAL, m * 2, 0, 0, &h->hull},
        {"value", REAL, C * m, 0, 0, &h->value},
        {"effect", REAL, C * n, 0, 0, &h->effect},
        {"gain", REAL, K * m * n, 0, 0, &h->gain},
        {"gain_previous", REAL, K * m * m, 0, 0, &h->gain_previous},
        {"pull", REAL, K * m * m, 0, 0, &h->pull},
        {"place", REAL, K * C * m, 0, 0, &h->place},
        {"from_place", REAL, K * C * m, 0, 0, &h->from_place},
        {"metric", REAL, K * (n + m) * n, 0, 0, &h->metric},
        {"from_metric", REAL, K * C * (n + m), 0, 0, &h->from_metric},
        {"switch_cost", REAL, C * C, 0, 1, &h->switch_cost},
        {"level", 'B', C * m, 0, 0, &h->level},
        {"dwell", 'H', C * m, 0, 1, &h->dwell},
    };
    return attach_all(v, arrays, slots, COUNT(slots));
}

static PyObject *predictive_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    unsigned short n, m, q, p, order, rows, candidates, bad_limit, measured, loads, gate_limit;
    PyObject *arrays, *horizon, *new_block;
    if (!PyArg_ParseTuple(args, "(HHHHHHHHHHH)OOO", &n, &m, &q, &p, &order, &rows, &candidates, &bad_limit, &measured,
                          &loads, &gate_limit, &arrays, &horizon, &new_block))
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
                              .bad_limit = bad_limit,
                              .measured = measured,
                              .loads = loads,
                              .gate_limit = gate_limit};
    *d = sizes;
    const Py_ssize_t N = n, M = m, Q = q, P = p, Z = measured;
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
            {"state_row", REAL, Q * N, 0, horizon != Py_None, &d->state_row},
            {"disturbance_row", REAL, Q * P, 0, horizon != Py_None, &d->disturbance_row},
            {"offset", REAL, Q, 0, horizon != Py_None, &d->offset},
            {"reference_row", REAL, Q * order, 0, horizon != Py_None, &d->reference_row},
            {"half_weight", REAL, Q, 0, horizon != Py_None, &d->half_weight},
            {"pending_table", REAL, pending, 0, horizon != Py_None, &d->pending_table},
            {"hold_row", REAL, holds, 0, horizon != Py_None, &d->hold_row},
            {"total_row", REAL, Q * M, 0, horizon != Py_None, &d->total_row},
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
            {"gain", REAL, (N + loads) * Z, 0, 1, &d->gain},
            {"output_row", REAL, Z * N, 0, 1, &d->output_row},
            {"output_offset", REAL, Z, 0, 1, &d->output_offset},
            {"start_row", REAL, N * Z, 0, 1, &d->start_row},
            {"start_offset", REAL, N, 0, 1, &d->start_offset},
            {"gate", REAL, Z * Z, 0, 1, &d->gate},
        };
        ok = attach_all(v, tail, slots, COUNT(slots));
    } else if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "arrays must be a tuple");
    Py_XDECREF(head);
    Py_XDECREF(tail);
    if (ok && horizon != Py_None) {
        ok = attach_horizon(&self->horizon_views, horizon, d, &self->horizon);
        d->horizon = &self->horizon;
    }
    if (!ok) return Py_DECREF(self), NULL;
    self->new_block = Py_NewRef(new_block);

    const fsw_validity validity = fsw_init(d, &core->state);
    if (validity != FSW_VALID) {
        PyErr_SetString(
            PyExc_ValueError,
            validity == FSW_TOO_LARGE
                ? "the design is larger than the core's limits; give it a longer period, fewer states, "
                  "commands or moves"
                : "the design contradicts itself, or has a number out of its range in this arithmetic, as levels "
                  "that coincide or overflow; give real = 'float64', or units in which they do not");
        return Py_DECREF(self), NULL;
    }
    const size_t width = fsw_reference_size(d);
    core->buffer = PyMem_Malloc(sizeof(fsw_real) * ((size_t)measured + width + p + m));
    self->decision_costs = PyMem_Malloc(sizeof(fsw_real) * candidates);
    if (!core->buffer || !self->decision_costs) return Py_DECREF(self), PyErr_NoMemory();
    core->law.step = fsw_predictive_step;
    Law *base = &self->base;
    base->law = &core->law;
    base->measured = measured, base->reference_width = (uint32_t)width, base->disturbances = (uint32_t)(p - loads);
    base->inputs = m, base->outputs = q, base->order = order;
    base->from_outputs = d->gain != NULL;
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

/* x (measured,), reference (scalar; (order,) for one output; canonical) and w (p,) or None into the buffer; 0 if any is
 * of another form or the reference is not finite: the caller's Python then words the complaint or converts. */
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
        if (base->reference_width == base->order) given = read_array(reference, r, base->order, 1, 1);
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
    const Law *base = &self->base;
    fsw_real *x = core->buffer, *r = x + base->measured, *w = r + base->reference_width;
    self->status = (unsigned char)fsw_step(&core->design, &core->state, x, r, w, w + base->disturbances).status;
    const uint8_t *command = fsw_issued(&core->design, &core->state, 1);
    const double *levels = core->levels;
    for (uint32_t j = 0; j < base->inputs; j++) {
        u[j] = levels[command[j]];
        levels += core->design.level_count[j];
    }
    return command_array;
}

/* decide(x, reference, w, costs) -> (candidate, cost, nodes, status, gap), or None as above */
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
    return Py_BuildValue("idkid", (int)decision.candidate, (double)decision.cost, (unsigned long)decision.nodes,
                         (int)decision.status, (double)decision.gap);
}

/* sequence() -> bytes: candidates of the sequence that the last decide() or step() found; of a horizon only */
static PyObject *predictive_sequence(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    Predictive *self = (Predictive *)object;
    const fsw_horizon *h = self->core.design.horizon;
    if (!h) Py_RETURN_NONE;
    return PyBytes_FromStringAndSize((const char *)self->core.state.scratch.best, h->moves);
}

/* preload(line, wait, keep=False): commands under way and running dwell; whether to keep what was measured */
static PyObject *predictive_preload(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    PyObject *line_object, *wait_object;
    int keep = 0;
    if (!PyArg_ParseTuple(args, "OO|p", &line_object, &wait_object, &keep)) return NULL;
    views v = {.count = 0};
    const fsw_design *d = &self->core.design;
    const uint8_t *line;
    const uint32_t *wait;
    if (!attach(&v, line_object, "line", 'B', (Py_ssize_t)d->rows * d->inputs, 0, 0, &line) ||
        !attach(&v, wait_object, "wait", 'I', d->inputs, 0, 0, &wait))
        return release(&v), NULL;
    if (!keep) {
        (void)fsw_init(d, &self->core.state);
        self->status = FSW_OK;
    }
    const fsw_validity validity = fsw_preload(d, &self->core.state, line, wait);
    release(&v);
    if (validity != FSW_VALID) return PyErr_SetString(PyExc_ValueError, "a level index is out of range"), NULL;
    Py_RETURN_NONE;
}

/* What was measured, (x, w), float64 arrays, into the buffer; x None: nothing, and *x becomes null. */
static int read_measured(Predictive *self, PyObject *x_object, PyObject *w_object, const fsw_real **x,
                         const fsw_real **w)
{
    const Law *base = &self->base;
    fsw_real *to = self->core.buffer;
    *x = NULL, *w = to + base->measured;
    if (x_object == Py_None) return 1;
    *x = to;
    if (read_array(x_object, to, base->measured, 1, 0) == (Py_ssize_t)base->measured &&
        read_array(w_object, to + base->measured, base->disturbances, 1, 0) == (Py_ssize_t)base->disturbances)
        return 1;
    return PyErr_SetString(PyExc_ValueError, "x and w must be float64 arrays of the design's sizes"), 0;
}

/* track(x, w, command): a period in which somebody else chose; level indices */
static PyObject *predictive_track(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    const fsw_design *d = &self->core.design;
    PyObject *x_object, *w_object, *command_object;
    const fsw_real *x, *w;
    const uint8_t *command;
    views v = {.count = 0};
    if (!PyArg_ParseTuple(args, "OOO", &x_object, &w_object, &command_object) ||
        !read_measured(self, x_object, w_object, &x, &w))
        return NULL;
    if (!attach(&v, command_object, "command", 'B', d->inputs, 0, 0, &command)) return release(&v), NULL;
    const fsw_validity validity = fsw_track(d, &self->core.state, x, w, command);
    release(&v);
    if (validity != FSW_VALID) return PyErr_SetString(PyExc_ValueError, "a level index is out of range"), NULL;
    Py_RETURN_NONE;
}

/* missed(periods): the command in force went on */
static PyObject *predictive_missed(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    unsigned short periods;
    if (!PyArg_ParseTuple(args, "H", &periods)) return NULL;
    fsw_missed(&self->core.design, &self->core.state, periods);
    Py_RETURN_NONE;
}

/* safe(x, w): a period at the safe levels */
static PyObject *predictive_safe(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    PyObject *x_object, *w_object;
    const fsw_real *x, *w;
    fsw_real u[FSW_MAX_INPUTS];
    if (!PyArg_ParseTuple(args, "OO", &x_object, &w_object) || !read_measured(self, x_object, w_object, &x, &w))
        return NULL;
    fsw_safe(&self->core.design, &self->core.state, x, w, u);
    self->status = FSW_SAFE;
    Py_RETURN_NONE;
}

/* bad() -> (in a row, in total) */
static PyObject *predictive_bad(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    const fsw_state *s = &((Predictive *)object)->core.state;
    return Py_BuildValue("ik", (int)s->bad, (unsigned long)s->bad_total);
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

/* start(x, w): a known state, and the disturbances with the loads behind them */
static PyObject *predictive_start(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    const fsw_design *d = &self->core.design;
    views v = {.count = 0};
    const fsw_real *x, *w;
    const slot slots[] = {{"x", REAL, d->states, 0, 0, &x}, {"w", REAL, d->disturbances, 0, 0, &w}};
    const int ok = attach_all(&v, args, slots, COUNT(slots));
    const fsw_validity validity = ok ? fsw_start(d, &self->core.state, x, w) : FSW_VALID;
    release(&v);
    if (!ok) return NULL;
    if (validity != FSW_VALID) return PyErr_SetString(PyExc_ValueError, "a value is too large"), NULL;
    Py_RETURN_NONE;
}

/* estimate(x, w): what the latest step is based on, into float64 arrays; False if there is nothing yet */
static PyObject *predictive_estimate(PyObject *object, PyObject *args)
{
    Predictive *self = (Predictive *)object;
    const fsw_design *d = &self->core.design;
    const fsw_state *s = &self->core.state;
    views v = {.count = 0};
    double *x, *w;
    const slot slots[] = {{"x", 'd', d->states, 1, 0, &x}, {"w", 'd', d->disturbances, 1, 0, &w}};
    const int ok = attach_all(&v, args, slots, COUNT(slots));
    for (uint16_t i = 0; ok && i < d->states; i++) x[i] = (double)s->x[i];
    for (uint16_t i = 0; ok && i < d->disturbances; i++) w[i] = (double)s->w[i];
    release(&v);
    return ok ? PyBool_FromLong(s->primed) : NULL;
}

/* wait() -> bytes: periods, uint32, that each input must still keep its level */
static PyObject *predictive_wait(PyObject *object, PyObject *nothing)
{
    (void)nothing;
    Predictive *self = (Predictive *)object;
    const Py_ssize_t size = (Py_ssize_t)(self->base.inputs * sizeof *self->core.state.wait);
    return PyBytes_FromStringAndSize((const char *)self->core.state.wait, size);
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
    PyMem_Free(self->core.channels);
    PyMem_Free(self->core.wanted);
    Py_XDECREF(self->plant);
    dispose(object);
}

/* Baseline(kind, plant, order, period, safe, (hysteresis, deadband, lead), (kp, ki, kd, kf, bias, carrier),
 * (rate, mix, forbidden, level_count, levels, dwell)); safe is a tuple of level indices */
static PyObject *baseline_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *plant, *safe, *arrays;
    int kind;
    unsigned int order, carrier;
    double period, hysteresis, deadband, lead, kp, ki, kd, kf, bias;
    if (!PyArg_ParseTuple(args, "iO!IdO!(ddd)(dddddI)O!", &kind, plant_type, &plant, &order, &period, &PyTuple_Type,
                          &safe, &hysteresis, &deadband, &lead, &kp, &ki, &kd, &kf, &bias, &carrier, &PyTuple_Type,
                          &arrays))
        return NULL;
    const fsw_plant *model = &((Plant *)plant)->plant;
    const uint32_t n = model->states, m = model->inputs, q = model->outputs;
    if (n > FSW_MAX_STATES || q > FSW_MAX_OUTPUTS || order < 1 || carrier < 1 || PyTuple_Size(safe) != (Py_ssize_t)m ||
        PyTuple_Size(arrays) != 6)
        return PyErr_SetString(PyExc_ValueError, "the baseline's sizes contradict each other"), NULL;
    Baseline *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_baseline *c = &self->core;
    self->plant = Py_NewRef(plant);
    c->plant = model;
    c->channels = PyMem_Calloc(m, sizeof *c->channels);
    c->wanted = PyMem_Calloc(m, sizeof *c->wanted);
    c->model = PyMem_Calloc(2 * (size_t)n, sizeof *c->model);
    c->depth = ((Plant *)plant)->longest + 1;
    c->history = PyMem_Calloc((size_t)c->depth * m, sizeof *c->history);
    if (!c->channels || !c->wanted || !c->model || !c->history) return Py_DECREF(self), PyErr_NoMemory();

    views *v = &self->base.views;
    const uint8_t *counts;
    const double *levels;
    const uint32_t *dwell;
    const Py_ssize_t forbidden = PyObject_Size(PyTuple_GetItem(arrays, 2));
    int ok = forbidden >= 0 && attach(v, PyTuple_GetItem(arrays, 3), "level_count", 'B', m, 0, 0, &counts);
    Py_ssize_t total = 0;
    for (uint32_t j = 0; ok && j < m; j++) total += counts[j];
    ok = ok && attach(v, PyTuple_GetItem(arrays, 0), "rate", 'd', (Py_ssize_t)q * n, 0, 0, &c->rate) &&
         attach(v, PyTuple_GetItem(arrays, 1), "mix", 'd', (Py_ssize_t)m * q, 0, 0, &c->mix) &&
         attach(v, PyTuple_GetItem(arrays, 2), "forbidden", 'B', forbidden * m, 0, 0, &c->forbidden) &&
         attach(v, PyTuple_GetItem(arrays, 4), "levels", 'd', total, 0, 0, &levels) &&
         attach(v, PyTuple_GetItem(arrays, 5), "dwell", 'I', total, 0, 0, &dwell);
    for (uint32_t j = 0; ok && j < m; j++) {
        fsw_channel *channel = c->channels + j;
        const long level = PyLong_AsLong(PyTuple_GetItem(safe, j));
        if (level < 0 || level >= counts[j] || counts[j] < 2)
            ok = (PyErr_SetString(PyExc_ValueError, "a safe level is out of range"), 0);
        channel->levels = levels, channel->dwell = dwell;
        channel->level_count = counts[j], channel->safe = (uint32_t)level;
        levels += counts[j], dwell += counts[j];
    }
    if (!ok) return Py_DECREF(self), NULL;
    c->forbidden_count = (uint32_t)forbidden;
    c->kind = (fsw_baseline_kind)kind;
    c->order = order, c->period = period;
    c->hysteresis = hysteresis, c->deadband = deadband, c->lead = lead;
    c->kp = kp, c->ki = ki, c->kd = kd, c->kf = kf, c->bias = bias, c->carrier = carrier;
    c->law.step = fsw_baseline_step;
    fsw_baseline_reset(c);
    Law *base = &self->base;
    base->law = &c->law;
    base->measured = n, base->order = order, base->reference_width = q * order;
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
    const int ok = attach_all(&v, args, slots, COUNT(slots));
    if (ok) base->law->step(base->law, x, r, w, u);
    release(&v);
    if (!ok) return NULL;
    Py_RETURN_NONE;
}

/* ---- Sensor ---- */

typedef struct {
    PyObject_HEAD views views;
    fsw_sensor sensor;
    uint32_t seen; /* states or outputs */
} Sensor;

static PyTypeObject *sensor_type;

static void sensor_dealloc(PyObject *object)
{
    release(&((Sensor *)object)->views);
    dispose(object);
}

/* Sensor(measured, seen, missing, late, (matrix, deviation, quantum, low, high, outages)) */
static PyObject *sensor_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    unsigned int measured, seen;
    double missing, late;
    PyObject *arrays;
    if (!PyArg_ParseTuple(args, "IIddO", &measured, &seen, &missing, &late, &arrays)) return NULL;
    Sensor *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_sensor *s = &self->sensor;
    self->seen = seen;
    s->measured = measured, s->missing = missing, s->late = late;
    const Py_ssize_t Z = measured, N = seen;
    PyObject *outages = PyTuple_Check(arrays) && PyTuple_Size(arrays) == 6 ? PyTuple_GetItem(arrays, 5) : Py_None;
    const Py_ssize_t count = outages == Py_None ? 0 : PyObject_Size(outages);
    const slot slots[] = {
        {"matrix", 'd', Z * N, 0, 1, &s->matrix}, {"deviation", 'd', Z, 0, 1, &s->deviation},
        {"quantum", 'd', Z, 0, 1, &s->quantum},   {"low", 'd', Z, 0, 1, &s->low},
        {"high", 'd', Z, 0, 1, &s->high},         {"outages", 'Q', 2 * count, 0, 1, (void *)&s->outage},
    };
    if (count < 0 || !attach_all(&self->views, arrays, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    s->outages = (uint32_t)count;
    if (!s->matrix && measured != seen) {
        PyErr_SetString(PyExc_ValueError, "a sensor matrix is needed where the law's state is not the plant's");
        return Py_DECREF(self), NULL;
    }
    return (PyObject *)self;
}

/* ---- Rig ---- */

/* A truth stepped by Python: advance(k, x, levels, w, next) and output(x, y) on memory views. */
typedef struct {
    fsw_truth truth;
    uint32_t segments;
    PyObject *advance, *output;
} Called;

typedef struct {
    PyObject_HEAD views views;
    fsw_rig rig;
    fsw_linear linear;
    Called called;
    fsw_stuck *stuck;
} Rig;

static PyTypeObject *rig_type;

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

/* Rig((n, m, q, p), segments, pieces, length, (rise, fall, process), faults, model): faults are (input, level, from,
 * to) in periods; model is the tuple of arrays of a linear plant, or (advance, output) */
static PyObject *rig_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    unsigned int n, m, q, p, segments, pieces;
    unsigned long long length;
    PyObject *timing, *faults, *model;
    if (!PyArg_ParseTuple(args, "(IIII)IIKOOO", &n, &m, &q, &p, &segments, &pieces, &length, &timing, &faults, &model))
        return NULL;
    if (n > FSW_MAX_STATES || m == 0 || segments == 0 || pieces == 0 || length == 0)
        return PyErr_SetString(PyExc_ValueError, "the rig's sizes are out of range"), NULL;
    Rig *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_rig *rig = &self->rig;
    fsw_actuators *a = &rig->actuators;
    const Py_ssize_t N = n, M = m, Q = q, P = p, S = segments;
    const slot times[] = {
        {"rise", 'I', M, 0, 0, &a->rise}, {"fall", 'I', M, 0, 0, &a->fall}, {"process", 'd', N, 0, 1, &rig->process}};
    if (!attach_all(&self->views, timing, times, COUNT(times)) || !rig_faults(self, faults, m))
        return Py_DECREF(self), NULL;
    a->inputs = m, a->segments = segments;
    for (unsigned int j = 0; j < m; j++) {
        const uint32_t longest = a->rise[j] > a->fall[j] ? a->rise[j] : a->fall[j];
        if (longest / segments + 2 > a->capacity) a->capacity = longest / segments + 2;
    }
    a->command = PyMem_Calloc(2 * (size_t)m, sizeof *a->command);
    a->level = a->command + m;
    a->count = PyMem_Calloc(m, sizeof *a->count);
    a->edges = PyMem_Calloc((size_t)m * a->capacity, sizeof *a->edges);
    rig->levels = PyMem_Calloc((size_t)segments * m, sizeof *rig->levels);
    if (!a->command || !a->count || !a->edges || !rig->levels) return Py_DECREF(self), PyErr_NoMemory();

    const fsw_truth sizes = {.states = n, .inputs = m, .outputs = q, .disturbances = p};
    if (PyTuple_Check(model) && PyTuple_Size(model) == 2) {
        Called *c = &self->called;
        c->truth = sizes;
        c->truth.advance = called_advance, c->truth.output = called_output;
        c->segments = segments;
        c->advance = Py_NewRef(PyTuple_GetItem(model, 0)), c->output = Py_NewRef(PyTuple_GetItem(model, 1));
        rig->truth = &c->truth;
        return (PyObject *)self;
    }
    fsw_linear *l = &self->linear;
    l->truth = sizes;
    l->truth.advance = fsw_linear_advance, l->truth.output = fsw_linear_output;
    l->segments = segments, l->pieces = pieces, l->length = length;
    const Py_ssize_t R = pieces;
    const slot slots[] = {
        {"transition", 'd', R * S * N * N, 0, 0, &l->transition},
        {"input", 'd', R * S * M * N, 0, 0, &l->input},
        {"disturbance", 'd', R * S * N * P, 0, 0, &l->disturbance},
        {"drift", 'd', R * S * N, 0, 0, &l->drift},
        {"output", 'd', R * Q * N, 0, 0, &l->output},
        {"output_zero", 'd', R * Q, 0, 0, &l->output_zero},
    };
    if (!attach_all(&self->views, model, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    rig->truth = &l->truth;
    return (PyObject *)self;
}

/* ---- Closed loop ---- */

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

/* run(law, body, sensor, seed, steps, history, arrays, first, last): fill rows first..last of the arrays in place */
static PyObject *run(PyObject *module, PyObject *args)
{
    (void)module;
    PyObject *law, *body, *sensor, *arrays;
    unsigned long long seed;
    Py_ssize_t steps, history, first, last;
    if (!PyArg_ParseTuple(args, "OOOKnnOnn", &law, &body, &sensor, &seed, &steps, &history, &arrays, &first, &last))
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
    int ok = attach_all(&v, arrays, slots, COUNT(slots));
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

/* batch(law, body, sensor, steps, history, arrays): many runs of one loop, figures of merit only. arrays: reference, w,
 * load, past [history][m], wanted [steps+1][q], safe [m], seeds [R], x0 [R][n], and out: rms [R][q], largest [R][q],
 * switches [R][m], on [R][m]. The law's state at entry is every run's first. */
static PyObject *batch(PyObject *module, PyObject *args)
{
    (void)module;
    PyObject *law, *body, *sensor, *arrays;
    Py_ssize_t steps, history;
    if (!PyArg_ParseTuple(args, "OOOnnO", &law, &body, &sensor, &steps, &history, &arrays)) return NULL;
    parts c;
    if (!gather(&c, law, body, sensor, history)) return NULL;
    if (c.rig && c.rig->truth != &((Rig *)body)->linear.truth)
        return PyErr_SetString(PyExc_ValueError, "only linear plants run in batches"), NULL;
    const Py_ssize_t runs =
        PyTuple_Check(arrays) && PyTuple_Size(arrays) == 12 ? PyObject_Size(PyTuple_GetItem(arrays, 6)) : -1;
    if (runs < 0) return PyErr_SetString(PyExc_ValueError, "twelve arrays are needed"), NULL;
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
    if (!attach_all(&v, arrays, slots, COUNT(slots))) return release(&v), NULL;
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

/* metrics(instants, q, m, (y, r, u, safe, rms, largest, switches, on)) */
static PyObject *metrics(PyObject *module, PyObject *args)
{
    (void)module;
    Py_ssize_t rows, q, m;
    PyObject *arrays;
    if (!PyArg_ParseTuple(args, "nnnO", &rows, &q, &m, &arrays)) return NULL;
    const double *y, *r, *u, *safe;
    double *rms, *largest, *switches, *on;
    views v = {.count = 0};
    const slot slots[] = {
        {"y", 'd', rows * q, 0, 0, &y},        {"r", 'd', rows * q, 0, 0, &r}, {"u", 'd', (rows - 1) * m, 0, 0, &u},
        {"safe", 'd', m, 0, 0, &safe},         {"rms", 'd', q, 1, 0, &rms},    {"largest", 'd', q, 1, 0, &largest},
        {"switches", 'd', m, 1, 0, &switches}, {"on", 'd', m, 1, 0, &on},
    };
    const int ok = rows > 0 && attach_all(&v, arrays, slots, COUNT(slots));
    if (ok) fsw_metrics((uint64_t)rows, (uint32_t)q, (uint32_t)m, y, r, u, safe, rms, largest, switches, on);
    release(&v);
    return ok ? Py_NewRef(Py_None) : NULL;
}

/* ---- Module ---- */

#define FAST(function) ((PyCFunction)(void (*)(void))(function))

static PyMethodDef predictive_methods[] = {
    {"step", FAST(predictive_step), METH_FASTCALL, NULL},
    {"decide", FAST(predictive_decide), METH_FASTCALL, NULL},
    {"preload", predictive_preload, METH_VARARGS, NULL},
    {"line", predictive_line, METH_NOARGS, NULL},
    {"wait", predictive_wait, METH_NOARGS, NULL},
    {"save", predictive_save, METH_NOARGS, NULL},
    {"restore", predictive_restore, METH_O, NULL},
    {"start", predictive_start, METH_VARARGS, NULL},
    {"track", predictive_track, METH_VARARGS, NULL},
    {"missed", predictive_missed, METH_VARARGS, NULL},
    {"safe", predictive_safe, METH_VARARGS, NULL},
    {"bad", predictive_bad, METH_NOARGS, NULL},
    {"estimate", predictive_estimate, METH_VARARGS, NULL},
    {"sequence", predictive_sequence, METH_NOARGS, NULL},
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
static PyMethodDef functions[] = {
    {"run", run, METH_VARARGS, NULL},
    {"batch", batch, METH_VARARGS, NULL},
    {"metrics", metrics, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot plant_slots[] = {{Py_tp_new, plant_new}, {Py_tp_dealloc, plant_dealloc}, {0, NULL}};
static PyType_Slot predictive_slots[] = {{Py_tp_new, predictive_new},
                                         {Py_tp_dealloc, predictive_dealloc},
                                         {Py_tp_methods, predictive_methods},
                                         {Py_tp_members, predictive_members},
                                         {0, NULL}};
static PyType_Slot baseline_slots[] = {
    {Py_tp_new, baseline_new}, {Py_tp_dealloc, baseline_dealloc}, {Py_tp_methods, baseline_methods}, {0, NULL}};
static PyType_Slot sensor_slots[] = {{Py_tp_new, sensor_new}, {Py_tp_dealloc, sensor_dealloc}, {0, NULL}};
static PyType_Slot rig_slots[] = {{Py_tp_new, rig_new}, {Py_tp_dealloc, rig_dealloc}, {0, NULL}};
static PyType_Spec sensor_spec = {"foreswitch." MODULE ".Sensor", sizeof(Sensor), 0, Py_TPFLAGS_DEFAULT, sensor_slots};
static PyType_Spec rig_spec = {"foreswitch." MODULE ".Rig", sizeof(Rig), 0, Py_TPFLAGS_DEFAULT, rig_slots};
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
    sensor_type = add_type(module, &sensor_spec, "Sensor");
    rig_type = add_type(module, &rig_spec, "Rig");
    predictive_type = add_type(module, &predictive_spec, "Predictive");
    baseline_type = add_type(module, &baseline_spec, "Baseline");
    const int limits[] = {FSW_MAX_STATES, FSW_MAX_INPUTS, FSW_MAX_OUTPUTS,    FSW_MAX_DISTURBANCES,  FSW_MAX_LINE,
                          FSW_MAX_STEPS,  FSW_MAX_MOVES,  FSW_HORIZON_STATES, FSW_HORIZON_CANDIDATES};
    const char *names[] = {"MAX_STATES", "MAX_INPUTS", "MAX_OUTPUTS",    "MAX_DISTURBANCES",  "MAX_LINE",
                           "MAX_STEPS",  "MAX_MOVES",  "HORIZON_STATES", "HORIZON_CANDIDATES"};
    for (int i = 0; i < 9; i++)
        if (PyModule_AddIntConstant(module, names[i], limits[i]) < 0) return Py_DECREF(module), NULL;
    if (!plant_type || !sensor_type || !rig_type || !predictive_type || !baseline_type) return Py_DECREF(module), NULL;
    return module;
}
