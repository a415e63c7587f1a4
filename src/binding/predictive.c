#include "types.h"

#include <stddef.h>
#include <string.h>
#include <structmember.h>

/* ---- A design, by the names of core/foreswitch.h and core/horizon.h ---- */

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

/* The horizon of a design; the design's level counts and pending must be there. */
static int attach_horizon(views *v, PyObject *tables, const fsw_design *d, fsw_horizon *h)
{
    const scalar scalars[] = {{"steps", 'H', &h->steps},
                              {"moves", 'H', &h->moves},
                              {"states", 'H', &h->states},
                              {"inputs", 'H', &h->inputs},
                              {"outputs", 'H', &h->outputs},
                              {"candidates", 'H', &h->candidates},
                              {"disturbances", 'H', &h->disturbances},
                              {"order", 'H', &h->order},
                              {"lead", 'H', &h->lead},
                              {"terminal", 'H', &h->terminal},
                              {"tail", 'B', &h->tail},
                              {"exclusive", 'B', &h->exclusive},
                              {"dominance", 'B', &h->dominance},
                              {"patience", 'I', &h->patience},
                              {"node_budget", 'I', &h->node_budget},
                              {"far", REAL, &h->far}};
    if (!read_scalars(tables, scalars, COUNT(scalars))) return 0;
    const Py_ssize_t n = h->states, m = d->inputs, q = d->outputs, p = d->disturbances, C = d->candidates, K = h->moves,
                     N = h->steps, T = h->terminal, order = h->order;
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
    return attach_tables(v, tables, slots, COUNT(slots));
}

/* Sizes and tables of a design, its horizon apart. */
static int attach_design(views *v, PyObject *tables, int searched, fsw_design *d, const double **exact_levels)
{
    const scalar sizes[] = {{"states", 'H', &d->states},         {"inputs", 'H', &d->inputs},
                            {"outputs", 'H', &d->outputs},       {"disturbances", 'H', &d->disturbances},
                            {"order", 'H', &d->order},           {"rows", 'H', &d->rows},
                            {"candidates", 'H', &d->candidates}, {"bad_limit", 'H', &d->bad_limit},
                            {"measured", 'H', &d->measured},     {"loads", 'H', &d->loads},
                            {"gate_limit", 'H', &d->gate_limit}};
    if (!read_scalars(tables, sizes, COUNT(sizes))) return 0;
    const Py_ssize_t N = d->states, M = d->inputs, Q = d->outputs, P = d->disturbances, Z = d->measured,
                     order = d->order, candidates = d->candidates, loads = d->loads;
    /* these three give the sizes of the others */
    const slot first[] = {{"level_count", 'B', M, 0, 0, &d->level_count},
                          {"pending", 'H', M, 0, 0, &d->pending},
                          {"holds", 'H', M, 0, 0, &d->holds}};
    if (!attach_tables(v, tables, first, COUNT(first))) return 0;
    Py_ssize_t levels = 0, pending = 0, holds = 0;
    for (Py_ssize_t j = 0; j < M; j++) {
        levels += d->level_count[j];
        pending += (Py_ssize_t)d->pending[j] * d->level_count[j] * Q;
        holds += d->holds[j] * Q;
    }
    const slot slots[] = {
        {"exact_levels", 'd', levels, 0, 0, exact_levels},
        {"levels", REAL, levels, 0, 0, &d->levels},
        {"candidate", 'B', candidates * M, 0, 0, &d->candidate},
        {"safe", 'B', M, 0, 0, &d->safe},
        {"state_row", REAL, Q * N, 0, searched, &d->state_row},
        {"disturbance_row", REAL, Q * P, 0, searched, &d->disturbance_row},
        {"offset", REAL, Q, 0, searched, &d->offset},
        {"reference_row", REAL, Q * order, 0, searched, &d->reference_row},
        {"half_weight", REAL, Q, 0, searched, &d->half_weight},
        {"pending_table", REAL, pending, 0, searched, &d->pending_table},
        {"hold_row", REAL, holds, 0, searched, &d->hold_row},
        {"total_row", REAL, Q * M, 0, searched, &d->total_row},
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
    return attach_tables(v, tables, slots, COUNT(slots));
}

/* Predictive(design, horizon, new_block): tables by name, those of the horizon or None, and what makes an array
 * (rows, inputs) that commands are handed out from */
static PyObject *predictive_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *design, *horizon, *new_block;
    if (!PyArg_ParseTuple(args, "OOO", &design, &horizon, &new_block)) return NULL;
    Predictive *self = (void *)PyType_GenericAlloc(type, 0) /* zeroed */;
    if (!self) return NULL;
    fsw_predictive *core = &self->core;
    fsw_design *d = &core->design;
    const int searched = horizon != Py_None;
    if (!attach_design(&self->base.views, design, searched, d, &core->levels) ||
        (searched && !attach_horizon(&self->horizon_views, horizon, d, &self->horizon)))
        return Py_DECREF(self), NULL;
    if (searched) d->horizon = &self->horizon;
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
    core->buffer = PyMem_Malloc(sizeof(fsw_real) * ((size_t)d->measured + width + d->disturbances + d->inputs));
    self->decision_costs = PyMem_Malloc(sizeof(fsw_real) * d->candidates);
    if (!core->buffer || !self->decision_costs) return Py_DECREF(self), PyErr_NoMemory();
    core->law.step = fsw_predictive_step;
    Law *base = &self->base;
    base->law = &core->law;
    base->measured = d->measured, base->reference_width = (uint32_t)width;
    base->disturbances = (uint32_t)(d->disturbances - d->loads);
    base->inputs = d->inputs, base->outputs = d->outputs, base->order = d->order;
    base->from_outputs = d->gain != NULL;
    return (PyObject *)self;
}

/* ---- Steps ---- */

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
        if (count < 1 || !attach(&self->block_views, self->block, (slot){"block", 'd', count * m, 1, 0, &self->rows}))
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
    if (!attach(&v, args[3], (slot){"costs", 'd', d->candidates, 1, 0, &costs})) return release(&v), NULL;
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
    if (!attach(&v, line_object, (slot){"line", 'B', (Py_ssize_t)d->rows * d->inputs, 0, 0, &line}) ||
        !attach(&v, wait_object, (slot){"wait", 'I', d->inputs, 0, 0, &wait}))
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
    if (!attach(&v, command_object, (slot){"command", 'B', d->inputs, 0, 0, &command})) return release(&v), NULL;
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
    const int ok = attach_arguments(&v, args, slots, COUNT(slots));
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
    const int ok = attach_arguments(&v, args, slots, COUNT(slots));
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

Py_ssize_t state_size(const Predictive *self)
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
static PyType_Slot predictive_slots[] = {{Py_tp_new, predictive_new},
                                         {Py_tp_dealloc, predictive_dealloc},
                                         {Py_tp_methods, predictive_methods},
                                         {Py_tp_members, predictive_members},
                                         {0, NULL}};
PyType_Spec predictive_spec = {"foreswitch._binding." MODULE ".Predictive", sizeof(Predictive), 0, Py_TPFLAGS_DEFAULT,
                               predictive_slots};
