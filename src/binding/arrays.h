/* Arrays and numbers by name: how Python's tables become the pointers of the core's structures, on the stable ABI and
 * by the buffer protocol. No arithmetic. */
#ifndef FORESWITCH_BINDING_ARRAYS_H
#define FORESWITCH_BINDING_ARRAYS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdint.h>

enum { MAX_VIEWS = 40 };

/* Buffers that an object keeps alive, because its C struct points into them. */
typedef struct {
    Py_buffer view[MAX_VIEWS];
    int count;
} views;

void release(views *v);

/* A contiguous array of `count` items of struct-module `type`; None gives null where that is allowed. */
typedef struct {
    const char *name;
    char type;
    Py_ssize_t count;
    int writable, optional;
    void *pointer;
} slot;

/* A number: 'B', 'H', 'I', 'Q' unsigned of 8, 16, 32 and 64 bits, 'f' and 'd' floating. */
typedef struct {
    const char *name;
    char type;
    void *pointer;
} scalar;

#define COUNT(array) ((Py_ssize_t)(sizeof(array) / sizeof(array)[0]))

/* Each returns 1, or 0 with an exception that names what does not fit. What was attached so far stays in `v`. */
int attach(views *v, PyObject *object, slot wanted);
int attach_tables(views *v, PyObject *tables, const slot *slots, Py_ssize_t count);   /* items of a dict, by name */
int attach_arguments(views *v, PyObject *tuple, const slot *slots, Py_ssize_t count); /* of a call, in order */
int read_scalars(PyObject *tables, const scalar *scalars, Py_ssize_t count);          /* items of a dict, by name */

/* Items of a table before it is attached, where its length tells a count; 0 for None, -1 with an exception. */
Py_ssize_t length_of(PyObject *tables, const char *name);

/* Free an object of a heap type, which holds a reference to its type. */
void dispose(PyObject *self);

#endif
