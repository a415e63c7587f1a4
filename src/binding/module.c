/* The extension module, once per arithmetic (_core_float64, _core_float32): arrays in, status out, no arithmetic. */
#include "types.h"

#ifdef FSW_SINGLE
#define INIT PyInit__core_float32
#else
#define INIT PyInit__core_float64
#endif

PyTypeObject *plant_type, *predictive_type, *baseline_type, *sensor_type, *rig_type;

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec, const char *name)
{
    PyObject *type = PyType_FromSpec(spec);
    if (type && PyModule_AddObjectRef(module, name, type) < 0) Py_CLEAR(type);
    return (PyTypeObject *)type;
}

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, MODULE, NULL, -1, loop_functions, NULL, NULL, NULL, NULL};

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
