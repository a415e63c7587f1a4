/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* A controller as an FMU for co-simulation, FMI 2.0: the standard's functions round fsw_step.
 *
 * Everything a design adds comes in two headers: foreswitch_design.h, as in firmware, and foreswitch_fmu.h, which says
 * which value reference is which, the constants, and the commands under way at the start.
 *
 * Time. Decisions fall on the instants start + k Ts. fmi2DoStep(t, h) takes those in [t, t + h), each with the inputs
 * as they are; afterwards the outputs show the latest, until inputs are set at an instant that is still to be decided:
 * from then on they show what these inputs lead to. It becomes final with the step from there, so that
 *
 *     set inputs, step, get outputs        (a master that runs one FMU after the other)
 *     set inputs, get outputs, step        (one that knows of direct feedthrough)
 *
 * both see the command decided on those inputs. The clock counts periods: a step that is a whole number or a fraction
 * of them ends on an instant exactly, however the master's time is rounded.
 *
 * Memory is the instance and copies of its state, through the master's allocateMemory. */
#include <string.h>

#include "foreswitch_design.h"
#include "foreswitch_fmu.h"
#include "fmi2.h"

/* Value references of reals: inputs, outputs, locals, constants. */
enum {
    MEASURED = 0,
    REFERENCE = MEASURED + FSW_FMU_MEASURED,
    DISTURBANCE = REFERENCE + FSW_FMU_REFERENCE,
    COMMAND = DISTURBANCE + FSW_DISTURBANCES - FSW_LOADS,
    COST = COMMAND + FSW_MAX_INPUTS,
    GAP,
    STATE,
    LOAD = STATE + FSW_MAX_STATES,
    CONSTANT = LOAD + FSW_LOADS,
    REALS = CONSTANT + FSW_FMU_CONSTANTS,
    INPUTS = COMMAND
};
/* Of integers and booleans. */
enum { STATUS, BAD_IN_A_ROW, BAD_TOTAL, NODES, INTEGERS };
enum { OPTIMAL, BOOLEANS };

/* How far, in steps of at most one period, the end of a step may be from an instant to be taken for it. */
#define NEAR 1e-4
/* How far, in periods, a step may begin from where the latest ended. */
#define GAP_ALLOWED 1e-2
#define MOST_PERIODS 1e9

enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

/* All that changes: plain data. */
typedef struct {
    fmi2Real input[INPUTS];
    fmi2Real time;     /* where the latest step ended */
    fmi2Real position; /* the same since the start, in periods */
    fmi2Real next;     /* the first instant that is not final */
    fsw_decision decision;
    uint8_t mode;
    uint8_t fresh;   /* inputs were set since the latest step */
    uint8_t decided; /* `now` is what follows from the inputs at `next` */
    uint8_t warned;  /* of a step longer than a period */
    fsw_state before, now;
} run;

typedef struct {
    fmi2CallbackFunctions call;
    fmi2Boolean logging;
    char name[64];
    run run;
} instance;

typedef struct {
    char guid[sizeof FSW_FMU_GUID];
    uint32_t sum;
    run run;
} saved;

/* ---- Messages ---- */

static void say(const instance *self, fmi2Status status, fmi2String message, fmi2Real value)
{
    if (!self->call.logger || (status == fmi2Warning && !self->logging)) return;
    self->call.logger(self->call.componentEnvironment, self->name, status,
                      status == fmi2Warning ? "logStatusWarning" : "logStatusError", message, value);
}

static fmi2Status refuse(const instance *self, fmi2String message, fmi2Real value)
{
    if (self) say(self, fmi2Error, message, value);
    return fmi2Error;
}

/* ---- The controller ---- */

static int begin(run *r)
{
    memset(r, 0, sizeof *r);
    r->fresh = 1;
    r->decision.candidate = FSW_CANDIDATES;
    if (fsw_init(&FSW_DESIGN, &r->now) != FSW_VALID) return 0;
    if (fsw_preload(&FSW_DESIGN, &r->now, fsw_fmu_line, fsw_fmu_wait) != FSW_VALID) return 0;
#if FSW_FMU_PRIMED
    if (fsw_start(&FSW_DESIGN, &r->now, fsw_fmu_x, fsw_fmu_w) != FSW_VALID) return 0;
#endif
    r->before = r->now;
    return 1;
}

/* What single precision cannot hold is as far beyond a measurement as can be said in it. */
static fsw_real real_of(fmi2Real value)
{
#ifdef FSW_SINGLE
    if (value > 1e38) return 1e38f;
    if (value < -1e38) return -1e38f;
#endif
    return (fsw_real)value;
}

static void decide(run *r)
{
    fsw_real given[INPUTS], u[FSW_MAX_INPUTS];
    for (int i = 0; i < INPUTS; i++) given[i] = real_of(r->input[i]);
    r->now = r->before;
    r->decision = fsw_step(&FSW_DESIGN, &r->now, given + MEASURED, given + REFERENCE,
                           DISTURBANCE < COMMAND ? given + DISTURBANCE : 0, u);
    r->fresh = 0, r->decided = 1;
}

/* Bring the outputs up to date with the inputs. */
static void settle(run *r)
{
    const int running = r->mode == INITIALIZING || r->mode == STEPPING;
    if (running && r->fresh && r->position >= r->next) decide(r);
}

/* The level of an input in force, exactly. */
static fmi2Real level(const run *r, unsigned input)
{
    unsigned at = fsw_issued(&FSW_DESIGN, &r->now, 1)[input];
    for (unsigned j = 0; j < input; j++) at += FSW_DESIGN.level_count[j];
    return fsw_fmu_level[at];
}

/* ---- Life ---- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    instance *self = c;
    if (!self || (n > 0 && !categories)) return refuse(self, "fmi2SetDebugLogging: categories is null", 0);
    int wanted = n == 0;
    for (size_t i = 0; i < n; i++) {
        if (!categories[i]) return refuse(self, "fmi2SetDebugLogging: a category is null", 0);
        wanted = wanted || strcmp(categories[i], "logStatusWarning") == 0;
    }
    if (wanted) self->logging = on;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!functions || !functions->allocateMemory || !functions->freeMemory) return 0;
    fmi2String why = type != fmi2CoSimulation                   ? "fmi2Instantiate: only co-simulation is offered"
                     : !guid || strcmp(guid, FSW_FMU_GUID) != 0 ? "fmi2Instantiate: the GUID is another FMU's"
                                                                : 0;
    instance *self = why ? 0 : functions->allocateMemory(1, sizeof *self);
    if (!self) {
        if (!why) why = "fmi2Instantiate: no memory";
        if (functions->logger)
            functions->logger(functions->componentEnvironment, name ? name : "", fmi2Error, "logStatusError", why);
        return 0;
    }
    memset(self, 0, sizeof *self);
    self->call = *functions;
    self->logging = logging;
    for (size_t i = 0; name && name[i] && i + 1 < sizeof self->name; i++) self->name[i] = name[i];
    if (!begin(&self->run)) {
        refuse(self, "fmi2Instantiate: the design is not valid", 0);
        functions->freeMemory(self);
        return 0;
    }
    return self;
}

void fmi2FreeInstance(fmi2Component c)
{
    instance *self = c;
    if (self) self->call.freeMemory(self);
}

/* NaN is in no range. */
static int within(fmi2Real value, fmi2Real bound) { return value >= -bound && value <= bound; }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    instance *self = c;
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (!self || self->run.mode != INSTANTIATED)
        return refuse(self, "fmi2SetupExperiment: call it once instantiated, before initialization", 0);
    if (!within(start, 1e300)) return refuse(self, "fmi2SetupExperiment: startTime is %g; give a finite one", start);
    self->run.time = start;
    return fmi2OK;
}

static fmi2Status move(instance *self, uint8_t from, uint8_t to, fmi2String message)
{
    if (!self || self->run.mode != from) return refuse(self, message, 0);
    self->run.mode = to;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return move(c, INSTANTIATED, INITIALIZING, "fmi2EnterInitializationMode: reset first");
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return move(c, INITIALIZING, STEPPING, "fmi2ExitInitializationMode: enter it first");
}

fmi2Status fmi2Terminate(fmi2Component c) { return move(c, STEPPING, TERMINATED, "fmi2Terminate: nothing is running"); }

fmi2Status fmi2Reset(fmi2Component c)
{
    instance *self = c;
    return self && begin(&self->run) ? fmi2OK : fmi2Error;
}

/* ---- Values ---- */

static int in_range(const fmi2ValueReference vr[], size_t n, fmi2ValueReference end, const void *value)
{
    if (n > 0 && (!vr || !value)) return 0;
    for (size_t i = 0; i < n; i++)
        if (vr[i] >= end) return 0;
    return 1;
}

#define NO_SUCH "%g value references: one of them is no such variable, or an argument is null"

static fmi2Real real(run *r, fmi2ValueReference at)
{
    if (at < INPUTS) return r->input[at];
    if (at >= CONSTANT) return fsw_fmu_constant[at - CONSTANT];
    settle(r);
#if FSW_LOADS > 0
    if (at >= LOAD) return (fmi2Real)r->now.w[at - LOAD + FSW_DISTURBANCES - FSW_LOADS];
#endif
    if (at >= STATE) return (fmi2Real)r->now.x[at - STATE];
    if (at == GAP) return (fmi2Real)r->decision.gap;
    if (at == COST) return (fmi2Real)r->decision.cost;
    return level(r, at - COMMAND);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    instance *self = c;
    if (!self || !in_range(vr, n, REALS, value)) return refuse(self, "fmi2GetReal of " NO_SUCH, (fmi2Real)n);
    for (size_t i = 0; i < n; i++) value[i] = real(&self->run, vr[i]);
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    instance *self = c;
    if (!self || !in_range(vr, n, INPUTS, value))
        return refuse(self, "fmi2SetReal of " NO_SUCH ", or no input", (fmi2Real)n);
    if (self->run.mode == TERMINATED) return refuse(self, "fmi2SetReal: the run has ended, reset first", 0);
    for (size_t i = 0; i < n; i++) self->run.input[vr[i]] = value[i];
    if (n > 0) self->run.fresh = 1;
    return fmi2OK;
}

static fmi2Integer integer(uint32_t value) { return value > 2147483647u ? 2147483647 : (fmi2Integer)value; }

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    instance *self = c;
    if (!self || !in_range(vr, n, INTEGERS, value)) return refuse(self, "fmi2GetInteger of " NO_SUCH, (fmi2Real)n);
    run *r = &self->run;
    settle(r);
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == STATUS         ? (fmi2Integer)r->decision.status
                   : vr[i] == BAD_IN_A_ROW ? (fmi2Integer)r->now.bad
                                           : integer(vr[i] == BAD_TOTAL ? r->now.bad_total : r->decision.nodes);
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    instance *self = c;
    if (!self || !in_range(vr, n, BOOLEANS, value)) return refuse(self, "fmi2GetBoolean of " NO_SUCH, (fmi2Real)n);
    run *r = &self->run;
    settle(r);
    for (size_t i = 0; i < n; i++)
        value[i] = r->decision.candidate < FSW_CANDIDATES && !(r->decision.gap > 0) ? fmi2True : fmi2False;
    return fmi2OK;
}

/* There are no strings, and no integer or boolean to set; none of none is as good as any. */
static fmi2Status none(const instance *self, size_t n, fmi2String message)
{
    return self && n == 0 ? fmi2OK : refuse(self, message, (fmi2Real)n);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)vr, (void)value;
    return none(c, n, "fmi2GetString of %g variables: there is none");
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    (void)vr, (void)value;
    return none(c, n, "fmi2SetInteger of %g variables: no integer is an input");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    (void)vr, (void)value;
    return none(c, n, "fmi2SetBoolean of %g variables: no boolean is an input");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)vr, (void)value;
    return none(c, n, "fmi2SetString of %g variables: there is none");
}

/* ---- Steps ---- */

static fmi2String const remedy[] = {
    "the command rests on the measurement again",
    "a measurement is not finite or an outlier, the model's prediction stands in for it; check the sensor",
    "nothing usable was measured yet or a reference is not finite, the command is kept; connect all inputs",
    "the safe level is commanded after bad measurements in a row; repair the sensor",
};

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_return)
{
    instance *self = c;
    (void)no_return;
    if (!self || self->run.mode != STEPPING) return refuse(self, "fmi2DoStep: initialize first", 0);
    run *r = &self->run;
    const fmi2Real periods = size / FSW_FMU_TS;
    if (!(size > 0) || !(periods < MOST_PERIODS))
        return refuse(self, "fmi2DoStep: the step size is %g; give a positive and finite one", size);
    const fmi2Real allowed = GAP_ALLOWED * FSW_FMU_TS + 1e-9 * (r->time < 0 ? -r->time : r->time);
    if (!within(point - r->time, allowed))
        return refuse(self, "fmi2DoStep: the step begins at %g; begin where the latest ended", point);
    if (periods > 1.5 && !r->warned) {
        say(self, fmi2Warning, "%g periods in one step: each decides on the same inputs; step once per period",
            periods);
        r->warned = 1;
    }
    fmi2Real end = r->position + periods;
    const fmi2Real nearest = (fmi2Real)(int64_t)(end + 0.5);
    if (nearest > r->position && within(end - nearest, NEAR * (periods < 1 ? periods : 1))) end = nearest;
    while (r->next < end) {
        const fsw_status status = r->decision.status;
        if (r->fresh || !r->decided) decide(r);
        r->before = r->now;
        r->decided = 0;
        r->next += 1;
        if (r->decision.status != status) say(self, fmi2Warning, remedy[r->decision.status], 0);
    }
    r->position = end;
    r->time = point + size;
    r->fresh = 0;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) { return refuse(c, "fmi2CancelStep: a step is never pending", 0); }

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return none(c, n, "fmi2SetRealInputDerivatives of %g variables: inputs are sampled, not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return none(c, n, "fmi2GetRealOutputDerivatives of %g variables: outputs are held");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                        fmi2Real derivative[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)derivative;
    return refuse(c, "fmi2GetDirectionalDerivative: levels have no derivative", 0);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const instance *self = c;
    if (!self || !value || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = self->run.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (!c || !value || kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

/* ---- State ---- */

static uint32_t sum_of(const run *r)
{
    const unsigned char *bytes = (const unsigned char *)r;
    uint32_t sum = 2166136261u; /* FNV-1a */
    for (size_t i = 0; i < sizeof *r; i++) sum = (sum ^ bytes[i]) * 16777619u;
    return sum;
}

/* Memory for a copy where there is none yet. */
static run *copy_at(const instance *self, fmi2FMUstate *state)
{
    if (!*state) *state = self->call.allocateMemory(1, sizeof(run));
    return *state;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const instance *self = c;
    if (!self || !state) return refuse(self, "fmi2GetFMUstate: state is null", 0);
    run *copy = copy_at(self, state);
    if (!copy) return refuse(self, "fmi2GetFMUstate: no memory", 0);
    memcpy(copy, &self->run, sizeof *copy);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    instance *self = c;
    if (!self || !state) return refuse(self, "fmi2SetFMUstate: state is null", 0);
    memcpy(&self->run, state, sizeof self->run);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const instance *self = c;
    if (!self) return fmi2Error;
    if (state && *state) {
        self->call.freeMemory(*state);
        *state = 0;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    if (!c || !state || !size) return refuse(c, "fmi2SerializedFMUstateSize: an argument is null", 0);
    *size = sizeof(saved);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (!c || !state || !bytes || size < sizeof(saved))
        return refuse(c, "fmi2SerializeFMUstate: %g bytes are too few, or an argument is null", (fmi2Real)size);
    const uint32_t sum = sum_of(state);
    memset(bytes, 0, size);
    memcpy(bytes + offsetof(saved, guid), FSW_FMU_GUID, sizeof FSW_FMU_GUID);
    memcpy(bytes + offsetof(saved, sum), &sum, sizeof sum);
    memcpy(bytes + offsetof(saved, run), state, sizeof(run));
    return fmi2OK;
}

/* Bytes of another FMU, or damaged ones, would send the core astray. */
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    const instance *self = c;
    if (!self || !bytes || !state || size < sizeof(saved))
        return refuse(self, "fmi2DeSerializeFMUstate: %g bytes are too few, or an argument is null", (fmi2Real)size);
    uint32_t sum;
    memcpy(&sum, bytes + offsetof(saved, sum), sizeof sum);
    if (memcmp(bytes + offsetof(saved, guid), FSW_FMU_GUID, sizeof FSW_FMU_GUID) != 0)
        return refuse(self, "fmi2DeSerializeFMUstate: these bytes are another FMU's", 0);
    fmi2FMUstate made = 0;
    run *copy = copy_at(self, &made);
    if (!copy) return refuse(self, "fmi2DeSerializeFMUstate: no memory", 0);
    memcpy(copy, bytes + offsetof(saved, run), sizeof *copy);
    if (sum_of(copy) != sum) {
        self->call.freeMemory(copy);
        return refuse(self, "fmi2DeSerializeFMUstate: the bytes are damaged", 0);
    }
    if (*state) self->call.freeMemory(*state);
    *state = copy;
    return fmi2OK;
}
