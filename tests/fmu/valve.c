/* An FMU 2.0 for co-simulation: the paper's hot-gas plant with a vent, p' = v - vent, v' = (k u - v) / c, each step by
 * its closed form. A pressure beyond `burst` is an error. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#ifndef GUID
#define GUID "foreswitch-test-valve"
#endif

enum { U, VENT, P, V, K, C, BURST, COUNT };

typedef struct {
    double value[COUNT], time;
    enum { INSTANTIATED, INITIALISING, RUNNING } mode;
} valve;

#define UNUSED(x) ((void)(x))

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    UNUSED(c), UNUSED(on), UNUSED(n), UNUSED(categories);
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    UNUSED(name), UNUSED(resources), UNUSED(callbacks), UNUSED(visible), UNUSED(logging);
    if (type != fmi2CoSimulation || strcmp(guid, GUID) != 0) return NULL;
    valve *self = calloc(1, sizeof *self);
    if (!self) return NULL;
    self->value[K] = 16500, self->value[C] = 0.006, self->value[BURST] = 1e9;
    return self;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stopDefined, fmi2Real stop)
{
    UNUSED(toleranceDefined), UNUSED(tolerance), UNUSED(stopDefined), UNUSED(stop);
    ((valve *)c)->time = start;
    return fmi2OK;
}
static fmi2Status move(valve *self, int from, int to)
{
    if (self->mode != from) return fmi2Error;
    self->mode = to;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return move(c, INSTANTIATED, INITIALISING); }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return move(c, INITIALISING, RUNNING); }
fmi2Status fmi2Terminate(fmi2Component c) { return UNUSED(c), fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return UNUSED(c), fmi2Error; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= COUNT) return fmi2Error;
        value[i] = ((valve *)c)->value[vr[i]];
    }
    return fmi2OK;
}

/* Parameters and states only before initialisation. */
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    valve *self = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= COUNT || (self->mode != INSTANTIATED && vr[i] > VENT)) return fmi2Error;
        self->value[vr[i]] = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean noSet)
{
    UNUSED(noSet);
    valve *self = c;
    double *z = self->value;
    if (self->mode != RUNNING || !(h > 0) || fabs(t - self->time) > 1e-6 * h) return fmi2Error;
    self->time = t + h;
    const double end = z[K] * z[U], left = exp(-h / z[C]);
    z[P] += (end - z[VENT]) * h + (z[V] - end) * z[C] * (1 - left);
    z[V] = end + (z[V] - end) * left;
    return z[P] > z[BURST] ? fmi2Error : fmi2OK;
}

/* ---- What an FMU must also export ---- */

#define REFUSED { return fmi2Error; }
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Integer x[]) REFUSED
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Boolean x[]) REFUSED
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2String x[]) REFUSED
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer x[]) REFUSED
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Boolean x[]) REFUSED
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2String x[]) REFUSED
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) REFUSED
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) REFUSED
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) REFUSED
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) REFUSED
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) REFUSED
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) REFUSED
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t nu,
                                        const fmi2ValueReference k[], size_t nk, const fmi2Real d[],
                                        fmi2Real x[]) REFUSED
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
                                       const fmi2Real x[]) REFUSED
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
                                        fmi2Real x[]) REFUSED
fmi2Status fmi2CancelStep(fmi2Component c) REFUSED
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status *s) REFUSED
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *s) REFUSED
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *s) REFUSED
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *s) REFUSED
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String *s) REFUSED
