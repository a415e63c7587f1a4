/* Puts an exported FMU's shell through its life, its refusals and long runs; to be linked with its sources under the
 * sanitizers. What is random is the same with every library. Prints "N passed, M failed". */
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "foreswitch_design.h"
#include "foreswitch_fmu.h"
#include "fmi2.h"

enum {
    INPUTS = FSW_FMU_MEASURED + FSW_FMU_REFERENCE + FSW_DISTURBANCES - FSW_LOADS,
    REALS = INPUTS + FSW_MAX_INPUTS + 2 + FSW_MAX_STATES + FSW_LOADS + FSW_FMU_CONSTANTS,
    STEPS = 1000
};

static int passed, failed, messages, refusals, blocks, left_to_allocate = -1;

static void check(int good, const char *what, int line)
{
    if (good)
        passed++;
    else
        failed++, printf("line %d: %s\n", line, what);
}
#define CHECK(x) check(x, #x, __LINE__)
#define REFUSED(x)                                                                                                     \
    do {                                                                                                               \
        const int before = messages;                                                                                   \
        CHECK((x) == fmi2Error);                                                                                       \
        CHECK(messages == before + 1);                                                                                 \
    } while (0)

static void *allocate(size_t count, size_t size)
{
    if (left_to_allocate == 0) return NULL;
    if (left_to_allocate > 0) left_to_allocate--;
    unsigned char *memory = malloc(count * size);
    if (memory) memset(memory, 0xa5, count * size), blocks++;
    return memory;
}

static void release(void *memory)
{
    if (memory) blocks--;
    free(memory);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    char text[400];
    va_list values;
    va_start(values, message);
    vsnprintf(text, sizeof text, message, values);
    va_end(values);
    messages++;
    if (status == fmi2Error) refusals++;
    if (!environment || !name || !strlen(text)) failed++, printf("a message without its place: %s\n", text);
    if (strcmp(category, status == fmi2Error ? "logStatusError" : "logStatusWarning")) failed++;
}

static int here;
static const fmi2CallbackFunctions callbacks = {logger, allocate, release, NULL, &here};

static double random_value(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    switch (*seed >> 26) {
    case 0:
        return NAN;
    case 1:
        return INFINITY;
    case 2:
        return -DBL_MAX;
    case 3:
        return 5e-324;
    case 4:
        return 3.5e38;
    default:
        return ((double)*seed / 2147483648.0 - 1.0) * 3.0;
    }
}

static fmi2Component started(fmi2Boolean logging)
{
    fmi2Component c = fmi2Instantiate("one with a name that is longer than the sixty-three letters kept of it, so cut",
                                      fmi2CoSimulation, FSW_FMU_GUID, "", &callbacks, fmi2False, logging);
    if (!c) return NULL;
    CHECK(fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0) == fmi2OK);
    CHECK(fmi2EnterInitializationMode(c) == fmi2OK && fmi2ExitInitializationMode(c) == fmi2OK);
    return c;
}

static fmi2ValueReference all[REALS];

/* One period on inputs of the seed; every output, by its bits. */
static void step(fmi2Component c, double *time, uint32_t *seed, double out[REALS])
{
    double given[INPUTS];
    for (int i = 0; i < INPUTS; i++) given[i] = random_value(seed);
    CHECK(fmi2SetReal(c, all, INPUTS, given) == fmi2OK);
    if (*seed & 4096) CHECK(fmi2GetReal(c, all, REALS, out) == fmi2OK);
    CHECK(fmi2DoStep(c, *time, FSW_FMU_TS, fmi2True) == fmi2OK);
    *time += FSW_FMU_TS;
    CHECK(fmi2GetReal(c, all, REALS, out) == fmi2OK);
}

static void life(void)
{
    fmi2CallbackFunctions without = callbacks;
    CHECK(!strcmp(fmi2GetVersion(), "2.0") && !strcmp(fmi2GetTypesPlatform(), "default"));
    CHECK(!fmi2Instantiate("a", fmi2CoSimulation, FSW_FMU_GUID, NULL, NULL, 0, 0));
    without.allocateMemory = NULL;
    CHECK(!fmi2Instantiate("a", fmi2CoSimulation, FSW_FMU_GUID, NULL, &without, 0, 0));
    without.allocateMemory = allocate, without.logger = NULL;
    CHECK(!fmi2Instantiate(NULL, fmi2CoSimulation, "{another}", NULL, &without, 0, 0));
    CHECK(messages == 0);
    CHECK(!fmi2Instantiate("a", fmi2CoSimulation, NULL, NULL, &callbacks, 0, 0) && messages == 1);
    CHECK(!fmi2Instantiate("a", fmi2ModelExchange, FSW_FMU_GUID, NULL, &callbacks, 0, 0) && messages == 2);
    left_to_allocate = 0;
    CHECK(!fmi2Instantiate("a", fmi2CoSimulation, FSW_FMU_GUID, NULL, &callbacks, 0, 0) && messages == 3);
    left_to_allocate = -1;
    CHECK(blocks == 0);

    fmi2Component quiet = fmi2Instantiate(NULL, fmi2CoSimulation, FSW_FMU_GUID, NULL, &without, 0, 0);
    CHECK(quiet && fmi2DoStep(quiet, 0, 1, 1) == fmi2Error);
    fmi2FreeInstance(quiet);
    fmi2FreeInstance(NULL);

    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, FSW_FMU_GUID, NULL, &callbacks, 0, 0);
    double value[REALS];
    fmi2Integer whole[4];
    fmi2Boolean flag;
    CHECK(c != NULL);
    REFUSED(fmi2DoStep(c, 0, FSW_FMU_TS, 1));
    REFUSED(fmi2ExitInitializationMode(c));
    REFUSED(fmi2Terminate(c));
    REFUSED(fmi2SetupExperiment(c, 0, 0, NAN, 0, 0));
    REFUSED(fmi2SetupExperiment(c, 0, 0, INFINITY, 0, 0));
    CHECK(fmi2SetupExperiment(c, 1, 1e-6, 7.0, 1, 8.0) == fmi2OK);
    CHECK(fmi2GetReal(c, all, REALS, value) == fmi2OK && fmi2SetReal(c, all, INPUTS, value) == fmi2OK);
    CHECK(fmi2EnterInitializationMode(c) == fmi2OK);
    REFUSED(fmi2EnterInitializationMode(c));
    REFUSED(fmi2SetupExperiment(c, 0, 0, 0, 0, 0));
    CHECK(fmi2GetReal(c, all, REALS, value) == fmi2OK && fmi2GetInteger(c, all, 4, whole) == fmi2OK);
    CHECK(fmi2GetBoolean(c, all, 1, &flag) == fmi2OK);
    CHECK(fmi2ExitInitializationMode(c) == fmi2OK);
    const double steps[] = {0, -1, NAN, INFINITY, -INFINITY, 1e300};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) REFUSED(fmi2DoStep(c, 7.0, steps[i], 1));
    const double points[] = {0, NAN, INFINITY, 7.0 + FSW_FMU_TS, 7.0 - FSW_FMU_TS};
    for (size_t i = 0; i < sizeof points / sizeof *points; i++) REFUSED(fmi2DoStep(c, points[i], FSW_FMU_TS, 1));
    CHECK(fmi2DoStep(c, 7.0, FSW_FMU_TS, 1) == fmi2OK);
    double time;
    fmi2Status status;
    fmi2String text;
    CHECK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time) == fmi2OK && time == 7.0 + FSW_FMU_TS);
    CHECK(fmi2GetBooleanStatus(c, fmi2Terminated, &flag) == fmi2OK && flag == fmi2False);
    CHECK(fmi2GetStatus(c, fmi2DoStepStatus, &status) == fmi2Discard);
    CHECK(fmi2GetIntegerStatus(c, fmi2DoStepStatus, whole) == fmi2Discard);
    CHECK(fmi2GetStringStatus(c, fmi2PendingStatus, &text) == fmi2Discard);
    CHECK(fmi2GetRealStatus(NULL, fmi2LastSuccessfulTime, NULL) == fmi2Discard);
    CHECK(fmi2GetBooleanStatus(NULL, fmi2Terminated, NULL) == fmi2Discard);

    const fmi2ValueReference beyond[] = {0, REALS}, far[] = {4294967295u}, output[] = {INPUTS},
                             constant[] = {REALS - 1};
    REFUSED(fmi2GetReal(c, beyond, 2, value));
    REFUSED(fmi2GetReal(c, far, 1, value));
    REFUSED(fmi2GetReal(c, NULL, 1, value));
    REFUSED(fmi2GetReal(c, all, 1, NULL));
    CHECK(fmi2GetReal(c, NULL, 0, NULL) == fmi2OK && fmi2SetReal(c, NULL, 0, NULL) == fmi2OK);
    REFUSED(fmi2SetReal(c, output, 1, value));
    REFUSED(fmi2SetReal(c, constant, 1, value));
    REFUSED(fmi2SetReal(c, NULL, 1, value));
    REFUSED(fmi2GetInteger(c, far, 1, whole));
    REFUSED(fmi2GetInteger(c, all, 1, NULL));
    REFUSED(fmi2GetBoolean(c, far, 1, whole));
    REFUSED(fmi2GetString(c, all, 1, &text));
    REFUSED(fmi2SetInteger(c, all, 1, whole));
    REFUSED(fmi2SetBoolean(c, all, 1, whole));
    REFUSED(fmi2SetString(c, all, 1, &text));
    REFUSED(fmi2SetRealInputDerivatives(c, all, 1, whole, value));
    REFUSED(fmi2GetRealOutputDerivatives(c, all, 1, whole, value));
    REFUSED(fmi2GetDirectionalDerivative(c, all, 1, all, 1, value, value));
    REFUSED(fmi2CancelStep(c));
    REFUSED(fmi2SetDebugLogging(c, 1, 1, NULL));
    CHECK(fmi2GetString(c, NULL, 0, NULL) == fmi2OK && fmi2SetInteger(c, NULL, 0, NULL) == fmi2OK);
    CHECK(fmi2SetBoolean(c, NULL, 0, NULL) == fmi2OK && fmi2SetString(c, NULL, 0, NULL) == fmi2OK);
    CHECK(fmi2GetReal(NULL, all, 1, value) == fmi2Error && fmi2SetReal(NULL, all, 1, value) == fmi2Error);
    CHECK(fmi2GetInteger(NULL, all, 1, whole) == fmi2Error && fmi2GetBoolean(NULL, all, 1, whole) == fmi2Error);
    CHECK(fmi2DoStep(NULL, 0, 1, 1) == fmi2Error && fmi2Reset(NULL) == fmi2Error && fmi2Terminate(NULL) == fmi2Error);

    fmi2String warnings[] = {"logStatusWarning"}, errors[] = {"logStatusError"}, broken[] = {NULL};
    CHECK(fmi2SetDebugLogging(c, 1, 1, warnings) == fmi2OK);
    const int before = messages;
    CHECK(fmi2DoStep(c, time, 20 * FSW_FMU_TS, 1) == fmi2OK && messages > before); /* many periods in one step */
    CHECK(fmi2SetDebugLogging(c, 0, 1, errors) == fmi2OK && fmi2SetDebugLogging(c, 0, 0, NULL) == fmi2OK);
    REFUSED(fmi2SetDebugLogging(c, 1, 1, broken));

    CHECK(fmi2Terminate(c) == fmi2OK);
    REFUSED(fmi2DoStep(c, time + 20 * FSW_FMU_TS, FSW_FMU_TS, 1));
    REFUSED(fmi2SetReal(c, all, 1, value));
    CHECK(fmi2GetReal(c, all, REALS, value) == fmi2OK);
    CHECK(fmi2Reset(c) == fmi2OK && fmi2EnterInitializationMode(c) == fmi2OK);
    fmi2FreeInstance(c);
    CHECK(blocks == 0);
}

static void states(void)
{
    fmi2Component c = started(0), other = started(0);
    fmi2FMUstate state = NULL, copy = NULL;
    double time = 0, later, value[REALS], again[REALS];
    uint32_t seed = 1, same;
    size_t size = 0;
    for (int k = 0; k < 50; k++) step(c, &time, &seed, value);
    CHECK(fmi2GetFMUstate(c, &state) == fmi2OK && blocks == 3);
    later = time, same = seed;
    for (int k = 0; k < 20; k++) step(c, &time, &seed, value);
    CHECK(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK);
    char *bytes = malloc(size), *second = malloc(size);
    CHECK(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    REFUSED(fmi2SerializeFMUstate(c, state, bytes, size - 1));
    CHECK(fmi2DeSerializeFMUstate(other, bytes, size, &copy) == fmi2OK && blocks == 4);
    CHECK(fmi2SetFMUstate(other, copy) == fmi2OK);
    time = later, seed = same;
    for (int k = 0; k < 20; k++) step(other, &time, &seed, again);
    CHECK(!memcmp(value, again, sizeof value));
    CHECK(fmi2SerializeFMUstate(other, copy, second, size) == fmi2OK && !memcmp(bytes, second, size));
    CHECK(fmi2DeSerializeFMUstate(other, bytes, size, &copy) == fmi2OK && blocks == 4);
    for (size_t i = 0; i < size; i += 7) { /* damaged bytes */
        memcpy(second, bytes, size);
        second[i] = (char)(second[i] ^ 16);
        const fmi2Status answer = fmi2DeSerializeFMUstate(other, second, size, &copy);
        CHECK(answer == fmi2Error || (answer == fmi2OK && i < sizeof FSW_FMU_GUID + 4));
    }
    REFUSED(fmi2DeSerializeFMUstate(other, bytes, size - 1, &copy));
    REFUSED(fmi2DeSerializeFMUstate(other, NULL, size, &copy));
    REFUSED(fmi2SetFMUstate(c, NULL));
    REFUSED(fmi2GetFMUstate(c, NULL));
    REFUSED(fmi2SerializedFMUstateSize(c, NULL, &size));
    fmi2FMUstate none = NULL;
    left_to_allocate = 0;
    REFUSED(fmi2GetFMUstate(c, &none));
    REFUSED(fmi2DeSerializeFMUstate(c, bytes, size, &none));
    left_to_allocate = -1;
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK && !state && fmi2FreeFMUstate(c, &copy) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK && fmi2FreeFMUstate(c, NULL) == fmi2OK);
    CHECK(fmi2FreeFMUstate(NULL, &state) == fmi2Error);
    fmi2FreeInstance(c), fmi2FreeInstance(other);
    free(bytes), free(second);
    CHECK(blocks == 0);
}

/* Two at once, other inputs, beside each alone; odd steps. */
static void runs(void)
{
    static double together[2][STEPS][REALS];
    double alone[REALS], time[2] = {0, 0};
    uint32_t seed[2] = {3, 4};
    fmi2Component c[2] = {started(1), started(0)};
    for (int k = 0; k < STEPS; k++)
        for (int i = 0; i < 2; i++) step(c[i], &time[i], &seed[i], together[i][k]);
    for (int i = 0; i < 2; i++) {
        CHECK(fmi2Reset(c[i]) == fmi2OK && fmi2EnterInitializationMode(c[i]) == fmi2OK);
        CHECK(fmi2ExitInitializationMode(c[i]) == fmi2OK);
        double now = 0;
        uint32_t from = i ? 4 : 3;
        int same = 1;
        for (int k = 0; k < STEPS; k++) {
            step(c[i], &now, &from, alone);
            same = same && !memcmp(alone, together[i][k], sizeof alone);
        }
        CHECK(same);
        for (int k = 0; k < STEPS; k++) {
            const double size = FSW_FMU_TS * ldexp(1.0 + (k % 7) * 0.37, k % 24 - 20);
            CHECK(fmi2DoStep(c[i], now, size, 1) == fmi2OK);
            now += size;
            CHECK(fmi2GetReal(c[i], all, REALS, alone) == fmi2OK);
        }
        fmi2FreeInstance(c[i]);
    }
    CHECK(blocks == 0);
}

int main(void)
{
    for (unsigned i = 0; i < REALS; i++) all[i] = i;
    life();
    states();
    runs();
    CHECK(refusals > 0);
    printf("%d passed, %d failed\n", passed, failed);
    return failed > 0;
}
