/* Python binding of core/host/response.h on the stable ABI: arrays in, arrays filled, no arithmetic. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "response.h"

typedef struct {
    const char *name;
    char type;
    int writable;
    Py_ssize_t items; /* found, filled by attach */
    void *data;
    Py_buffer view;
} array;

static void release(array *arrays, int count)
{
    while (count > 0) PyBuffer_Release(&arrays[--count].view);
}

/* Contiguous arrays of the struct-module types given; on failure none is held. */
static int attach(array *arrays, PyObject **objects, int count)
{
    for (int i = 0; i < count; i++) {
        array *a = arrays + i;
        if (PyObject_GetBuffer(objects[i], &a->view,
                               PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (a->writable ? PyBUF_WRITABLE : 0)) < 0)
            return release(arrays, i), 0;
        const char *format = a->view.format ? a->view.format : "";
        if (format[0] != a->type || format[1]) {
            PyErr_Format(PyExc_ValueError, "%s holds items of type '%s', not '%c'", a->name, format, a->type);
            return release(arrays, i + 1), 0;
        }
        a->items = a->view.len / a->view.itemsize;
        a->data = a->view.buf;
    }
    return 1;
}

static PyObject *mismatch(array *arrays, int count)
{
    release(arrays, count);
    PyErr_SetString(PyExc_ValueError, "the shapes of the arrays contradict each other");
    return NULL;
}

static PyObject *discretise(PyObject *module, PyObject *args)
{
    (void)module;
    enum { SYSTEM, ENTRY, LENGTHS, PHI, GAMMA, COUNT };
    array a[COUNT] = {{"A", 'd', 0}, {"b", 'd', 0}, {"h", 'd', 0}, {"phi", 'd', 1}, {"gamma", 'd', 1}};
    PyObject *objects[COUNT];
    if (!PyArg_ParseTuple(args, "OOOOO", &objects[0], &objects[1], &objects[2], &objects[3], &objects[4]) ||
        !attach(a, objects, COUNT))
        return NULL;
    const Py_ssize_t n = a[ENTRY].items, count = a[LENGTHS].items;
    if (n < 1 || n > FSW_RESPONSE_MAX_STATES || a[SYSTEM].items != n * n || a[PHI].items != count * n * n ||
        a[GAMMA].items != count * n)
        return mismatch(a, COUNT);
    Py_BEGIN_ALLOW_THREADS;
    fsw_discretise((size_t)n, a[SYSTEM].data, a[ENTRY].data, (size_t)count, a[LENGTHS].data, a[PHI].data,
                   a[GAMMA].data);
    Py_END_ALLOW_THREADS;
    release(a, COUNT);
    return Py_NewRef(Py_None);
}

static PyObject *discretise_evenly(PyObject *module, PyObject *args)
{
    (void)module;
    enum { SYSTEM, ENTRY, PHI, GAMMA, COUNT };
    array a[COUNT] = {{"A", 'd', 0}, {"b", 'd', 0}, {"phi", 'd', 1}, {"gamma", 'd', 1}};
    PyObject *o[COUNT];
    double first, step;
    if (!PyArg_ParseTuple(args, "OOddOO", &o[0], &o[1], &first, &step, &o[2], &o[3]) || !attach(a, o, COUNT))
        return NULL;
    const Py_ssize_t n = a[ENTRY].items, count = n > 0 ? a[GAMMA].items / n : 0;
    if (n < 1 || n > FSW_RESPONSE_MAX_STATES || a[SYSTEM].items != n * n || a[PHI].items != count * n * n ||
        a[GAMMA].items != count * n)
        return mismatch(a, COUNT);
    Py_BEGIN_ALLOW_THREADS;
    fsw_discretise_evenly((size_t)n, a[SYSTEM].data, a[ENTRY].data, (size_t)count, first, step, a[PHI].data,
                          a[GAMMA].data);
    Py_END_ALLOW_THREADS;
    release(a, COUNT);
    return Py_NewRef(Py_None);
}

enum { SYSTEM, ENTRY, PHI, GAMMA, WHICH, OVER, SYSTEM_ARRAYS };
#define SYSTEM_SLOTS                                                                                                   \
    {"A", 'd', 0}, {"b", 'd', 0}, {"phi", 'd', 0}, {"gamma", 'd', 0}, {"which", 'I', 0}, {"over", 'd', 0}

/* The system that the first arrays hold, for `count` intervals; `over` may be empty. */
static int system_from(const array *a, Py_ssize_t count, fsw_response *system)
{
    const Py_ssize_t n = a[ENTRY].items, tables = n > 0 ? a[GAMMA].items / n : 0;
    if (n < 1 || n > FSW_RESPONSE_MAX_STATES || a[SYSTEM].items != n * n || a[GAMMA].items != tables * n ||
        a[PHI].items != tables * n * n || a[WHICH].items != count || (a[OVER].items != count && a[OVER].items != 0))
        return 0;
    const uint32_t *which = a[WHICH].data;
    for (Py_ssize_t i = 0; i < count; i++)
        if (which[i] >= (size_t)tables) return 0;
    *system = (fsw_response){(size_t)n,
                             a[SYSTEM].data,
                             a[ENTRY].data,
                             a[PHI].data,
                             a[GAMMA].data,
                             which,
                             a[OVER].items ? a[OVER].data : NULL};
    return 1;
}

static PyObject *respond(PyObject *module, PyObject *args)
{
    (void)module;
    enum { INPUT = SYSTEM_ARRAYS, STATES, COUNT };
    array a[COUNT] = {SYSTEM_SLOTS, {"u", 'd', 0}, {"x", 'd', 1}};
    PyObject *o[COUNT];
    fsw_response system;
    if (!PyArg_ParseTuple(args, "OOOOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7]) ||
        !attach(a, o, COUNT))
        return NULL;
    const Py_ssize_t count = a[INPUT].items;
    if (!system_from(a, count, &system) || a[STATES].items != (count + 1) * a[ENTRY].items) return mismatch(a, COUNT);
    Py_BEGIN_ALLOW_THREADS;
    fsw_respond(&system, (size_t)count, a[INPUT].data, a[STATES].data);
    Py_END_ALLOW_THREADS;
    release(a, COUNT);
    return Py_NewRef(Py_None);
}

static PyObject *carry(PyObject *module, PyObject *args)
{
    (void)module;
    enum { AT = SYSTEM_ARRAYS, INPUT, STATES, LATE, SLOPE, COUNT };
    array a[COUNT] = {SYSTEM_SLOTS, {"at", 'l', 0}, {"u", 'd', 0}, {"x", 'd', 0}, {"late", 'd', 1}, {"slope", 'd', 1}};
    PyObject *o[COUNT];
    fsw_response system;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7], &o[8], &o[9],
                          &o[10]) ||
        !attach(a, o, COUNT))
        return NULL;
    const Py_ssize_t count = a[AT].items, n = a[ENTRY].items, samples = a[INPUT].items;
    int valid = system_from(a, count, &system) && a[AT].view.itemsize == 8 && a[STATES].items == samples * n &&
                a[LATE].items == count * n && a[SLOPE].items == count * n;
    const int64_t *at = a[AT].data;
    for (Py_ssize_t i = 0; valid && i < count; i++) valid = at[i] < samples;
    if (!valid) return mismatch(a, COUNT);
    Py_BEGIN_ALLOW_THREADS;
    fsw_carry(&system, (size_t)count, at, a[INPUT].data, a[STATES].data, a[LATE].data, a[SLOPE].data);
    Py_END_ALLOW_THREADS;
    release(a, COUNT);
    return Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {{"discretise", discretise, METH_VARARGS, NULL},
                                {"discretise_evenly", discretise_evenly, METH_VARARGS, NULL},
                                {"respond", respond, METH_VARARGS, NULL},
                                {"carry", carry, METH_VARARGS, NULL},
                                {NULL, NULL, 0, NULL}};

static PyModuleDef module = {PyModuleDef_HEAD_INIT, "_response", NULL, 0, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__response(void) { return PyModule_Create(&module); }
