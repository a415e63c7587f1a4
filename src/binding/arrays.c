#include "arrays.h"

void release(views *v)
{
    while (v->count > 0) PyBuffer_Release(&v->view[--v->count]);
}

static Py_ssize_t width(char type) { return type == 'B' ? 1 : type == 'H' ? 2 : type == 'I' || type == 'f' ? 4 : 8; }

int attach(views *v, PyObject *object, slot s)
{
    *(void **)s.pointer = NULL;
    if (s.optional && object == Py_None) return 1;
    if (v->count == MAX_VIEWS) return PyErr_SetString(PyExc_SystemError, "too many arrays"), 0;
    Py_buffer *view = &v->view[v->count];
    if (PyObject_GetBuffer(object, view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (s.writable ? PyBUF_WRITABLE : 0)) < 0)
        return 0;
    v->count++;
    const char given = view->format && view->format[0] == 'L' && view->itemsize == 8 ? 'Q'
                       : view->format                                                ? view->format[0]
                                                                                     : 0;
    if (given != s.type || view->format[1] != 0 || view->len != s.count * width(s.type)) {
        PyErr_Format(PyExc_ValueError, "%s holds %zd bytes of type '%s'; %zd items of type '%c' are needed", s.name,
                     view->len, view->format ? view->format : "B", s.count, s.type);
        return 0;
    }
    *(void **)s.pointer = view->buf;
    return 1;
}

/* Borrowed; null with an exception. */
static PyObject *named(PyObject *tables, const char *name)
{
    if (!PyDict_Check(tables)) return PyErr_SetString(PyExc_TypeError, "tables must be a dict"), NULL;
    PyObject *found = PyDict_GetItemString(tables, name);
    if (!found) PyErr_Format(PyExc_ValueError, "%s is missing; give all tables by name", name);
    return found;
}

int attach_tables(views *v, PyObject *tables, const slot *slots, Py_ssize_t count)
{
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *item = named(tables, slots[i].name);
        if (!item || !attach(v, item, slots[i])) return 0;
    }
    return 1;
}

int attach_arguments(views *v, PyObject *tuple, const slot *slots, Py_ssize_t count)
{
    if (PyTuple_Size(tuple) != count) return PyErr_Format(PyExc_TypeError, "%zd arguments are needed", count), 0;
    for (Py_ssize_t i = 0; i < count; i++)
        if (!attach(v, PyTuple_GetItem(tuple, i), slots[i])) return 0;
    return 1;
}

static int read_scalar(PyObject *item, scalar s)
{
    if (s.type == 'f' || s.type == 'd') {
        const double value = PyFloat_AsDouble(item);
        if (value == -1.0 && PyErr_Occurred()) return 0;
        if (s.type == 'f')
            *(float *)s.pointer = (float)value;
        else
            *(double *)s.pointer = value;
        return 1;
    }
    const unsigned long long most = UINT64_MAX >> (64 - 8 * width(s.type)), value = PyLong_AsUnsignedLongLong(item);
    if (PyErr_Occurred() || value > most) {
        PyErr_Clear();
        PyErr_Format(PyExc_ValueError, "%s is %R; give a whole number from 0 to %llu", s.name, item, most);
        return 0;
    }
    if (s.type == 'B')
        *(uint8_t *)s.pointer = (uint8_t)value;
    else if (s.type == 'H')
        *(uint16_t *)s.pointer = (uint16_t)value;
    else if (s.type == 'Q')
        *(uint64_t *)s.pointer = (uint64_t)value;
    else
        *(uint32_t *)s.pointer = (uint32_t)value;
    return 1;
}

int read_scalars(PyObject *tables, const scalar *scalars, Py_ssize_t count)
{
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *item = named(tables, scalars[i].name);
        if (!item || !read_scalar(item, scalars[i])) return 0;
    }
    return 1;
}

Py_ssize_t length_of(PyObject *tables, const char *name)
{
    PyObject *item = named(tables, name);
    return !item ? -1 : item == Py_None ? 0 : PyObject_Size(item);
}

void dispose(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    freefunc free_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    free_object(self);
    Py_DECREF(type);
}
