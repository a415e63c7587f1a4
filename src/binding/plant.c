#include "types.h"

static void plant_dealloc(PyObject *object)
{
    release(&((Plant *)object)->views);
    dispose(object);
}

/* Plant(tables): sizes and arrays by the names of fsw_plant */
static PyObject *plant_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *tables;
    if (!PyArg_ParseTuple(args, "O", &tables)) return NULL;
    Plant *self = (void *)PyType_GenericAlloc(type, 0) /* zeroed */;
    if (!self) return NULL;
    fsw_plant *c = &self->plant;
    const scalar sizes[] = {{"states", 'I', &c->states},
                            {"inputs", 'I', &c->inputs},
                            {"outputs", 'I', &c->outputs},
                            {"disturbances", 'I', &c->disturbances}};
    if (!read_scalars(tables, sizes, COUNT(sizes))) return Py_DECREF(self), NULL;
    const Py_ssize_t N = c->states, M = c->inputs, Q = c->outputs, P = c->disturbances;
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
    if (!attach_tables(&self->views, tables, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    for (uint32_t j = 0; j < c->inputs; j++)
        if (c->delay[j] > self->longest) self->longest = c->delay[j];
    return (PyObject *)self;
}

static PyType_Slot plant_slots[] = {{Py_tp_new, plant_new}, {Py_tp_dealloc, plant_dealloc}, {0, NULL}};
PyType_Spec plant_spec = {"foreswitch._binding." MODULE ".Plant", sizeof(Plant), 0, Py_TPFLAGS_DEFAULT, plant_slots};
