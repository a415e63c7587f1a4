#include "types.h"

static void sensor_dealloc(PyObject *object)
{
    release(&((Sensor *)object)->views);
    dispose(object);
}

/* Sensor(tables): by the names of fsw_sensor; seen: states or outputs */
static PyObject *sensor_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    (void)keywords;
    PyObject *tables;
    if (!PyArg_ParseTuple(args, "O", &tables)) return NULL;
    Sensor *self = (void *)PyType_GenericAlloc(type, 0); /* zeroed */
    if (!self) return NULL;
    fsw_sensor *s = &self->sensor;
    const scalar scalars[] = {{"measured", 'I', &s->measured},
                              {"seen", 'I', &self->seen},
                              {"missing", 'd', &s->missing},
                              {"late", 'd', &s->late}};
    const Py_ssize_t count = length_of(tables, "outages");
    if (count < 0 || !read_scalars(tables, scalars, COUNT(scalars))) return Py_DECREF(self), NULL;
    const Py_ssize_t Z = s->measured, N = self->seen;
    const slot slots[] = {
        {"matrix", 'd', Z * N, 0, 1, &s->matrix}, {"deviation", 'd', Z, 0, 1, &s->deviation},
        {"quantum", 'd', Z, 0, 1, &s->quantum},   {"low", 'd', Z, 0, 1, &s->low},
        {"high", 'd', Z, 0, 1, &s->high},         {"outages", 'Q', 2 * count, 0, 1, (void *)&s->outage},
    };
    if (!attach_tables(&self->views, tables, slots, COUNT(slots))) return Py_DECREF(self), NULL;
    s->outages = (uint32_t)count;
    if (!s->matrix && s->measured != self->seen) {
        PyErr_SetString(PyExc_ValueError, "a sensor matrix is needed where the law's state is not the plant's");
        return Py_DECREF(self), NULL;
    }
    return (PyObject *)self;
}

/* read(seed, k, seen, measured): what the law is given at period k, of `seen` [k + 1][seen], into `measured` */
static PyObject *sensor_read(PyObject *object, PyObject *args)
{
    const Sensor *self = (Sensor *)object;
    unsigned long long seed;
    Py_ssize_t k;
    PyObject *seen_object, *measured_object;
    if (!PyArg_ParseTuple(args, "KnOO", &seed, &k, &seen_object, &measured_object)) return NULL;
    if (k < 0) return PyErr_SetString(PyExc_ValueError, "k is negative; give a period of the run"), NULL;
    views v = {.count = 0};
    const double *seen;
    double *measured;
    const int ok = attach(&v, seen_object, (slot){"seen", 'd', (k + 1) * self->seen, 0, 0, &seen}) &&
                   attach(&v, measured_object, (slot){"measured", 'd', self->sensor.measured, 1, 0, &measured});
    if (ok) {
        fsw_sensor sensor = self->sensor;
        sensor.seed = seed;
        fsw_sensor_read(&sensor, (uint64_t)k, seen, self->seen, measured);
    }
    release(&v);
    if (!ok) return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef sensor_methods[] = {{"read", sensor_read, METH_VARARGS, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot sensor_slots[] = {
    {Py_tp_new, sensor_new}, {Py_tp_dealloc, sensor_dealloc}, {Py_tp_methods, sensor_methods}, {0, NULL}};
PyType_Spec sensor_spec = {"foreswitch._binding." MODULE ".Sensor", sizeof(Sensor), 0, Py_TPFLAGS_DEFAULT,
                           sensor_slots};
