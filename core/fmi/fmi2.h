/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* The part of FMI 2.0 that fmi.c implements, by the standard's own names, types and values, so that it is the same
 * binary interface. The standard's headers may be included before it; then the compiler compares. */
#ifndef FORESWITCH_FMI2_H
#define FORESWITCH_FMI2_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Types: section 2.1.2 of the standard, platform "default" ---- */

#ifndef fmi2TypesPlatform_h
#define fmi2TypesPlatform "default"
#define fmi2True 1
#define fmi2False 0
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
#endif

#ifndef fmi2FunctionTypes_h
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                                   fmi2String category, fmi2String message, ...);
typedef void *(*fmi2CallbackAllocateMemory)(size_t count, size_t size);
typedef void (*fmi2CallbackFreeMemory)(void *memory);
typedef void (*fmi2StepFinished)(fmi2ComponentEnvironment environment, fmi2Status status);

typedef struct {
    fmi2CallbackLogger logger;
    fmi2CallbackAllocateMemory allocateMemory;
    fmi2CallbackFreeMemory freeMemory;
    fmi2StepFinished stepFinished;
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
#endif

/* ---- Functions. One whose sources are linked into a program bears the model's name before its own:
 * -DFMI2_FUNCTION_PREFIX=controller_ ---- */

#ifndef fmi2Functions_h
#define fmi2Version "2.0"
#ifndef FMI2_Export
#if defined(_WIN32) || defined(__CYGWIN__)
#define FMI2_Export __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI2_Export __attribute__((visibility("default")))
#else
#define FMI2_Export
#endif
#endif
#ifdef FMI2_FUNCTION_PREFIX
#define FSW_FMI_JOIN(prefix, name) prefix##name
#define FSW_FMI_NAME(prefix, name) FSW_FMI_JOIN(prefix, name)
#define fmi2GetTypesPlatform FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetTypesPlatform)
#define fmi2GetVersion FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetVersion)
#define fmi2SetDebugLogging FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetDebugLogging)
#define fmi2Instantiate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2Instantiate)
#define fmi2FreeInstance FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2FreeInstance)
#define fmi2SetupExperiment FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetupExperiment)
#define fmi2EnterInitializationMode FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2EnterInitializationMode)
#define fmi2ExitInitializationMode FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2ExitInitializationMode)
#define fmi2Terminate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2Terminate)
#define fmi2Reset FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2Reset)
#define fmi2GetReal FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetReal)
#define fmi2GetInteger FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetInteger)
#define fmi2GetBoolean FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetBoolean)
#define fmi2GetString FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetString)
#define fmi2SetReal FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetReal)
#define fmi2SetInteger FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetInteger)
#define fmi2SetBoolean FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetBoolean)
#define fmi2SetString FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetString)
#define fmi2GetFMUstate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetFMUstate)
#define fmi2SetFMUstate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetFMUstate)
#define fmi2FreeFMUstate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2FreeFMUstate)
#define fmi2SerializedFMUstateSize FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SerializedFMUstateSize)
#define fmi2SerializeFMUstate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SerializeFMUstate)
#define fmi2DeSerializeFMUstate FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2DeSerializeFMUstate)
#define fmi2GetDirectionalDerivative FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetDirectionalDerivative)
#define fmi2SetRealInputDerivatives FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2SetRealInputDerivatives)
#define fmi2GetRealOutputDerivatives FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetRealOutputDerivatives)
#define fmi2DoStep FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2DoStep)
#define fmi2CancelStep FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2CancelStep)
#define fmi2GetStatus FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetStatus)
#define fmi2GetRealStatus FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetRealStatus)
#define fmi2GetIntegerStatus FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetIntegerStatus)
#define fmi2GetBooleanStatus FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetBooleanStatus)
#define fmi2GetStringStatus FSW_FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2GetStringStatus)
#endif
#endif

FMI2_Export const char *fmi2GetTypesPlatform(void);
FMI2_Export const char *fmi2GetVersion(void);
FMI2_Export fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]);

FMI2_Export fmi2Component fmi2Instantiate(fmi2String instance, fmi2Type type, fmi2String guid, fmi2String resources,
                                          const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                          fmi2Boolean logging);
FMI2_Export void fmi2FreeInstance(fmi2Component c);
FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                           fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop);
FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c);
FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c);
FMI2_Export fmi2Status fmi2Terminate(fmi2Component c);
FMI2_Export fmi2Status fmi2Reset(fmi2Component c);

FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]);
FMI2_Export fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]);
FMI2_Export fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]);
FMI2_Export fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]);
FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]);
FMI2_Export fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                      const fmi2Integer value[]);
FMI2_Export fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                      const fmi2Boolean value[]);
FMI2_Export fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                     const fmi2String value[]);

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state);
FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state);
FMI2_Export fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state);
FMI2_Export fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size);
FMI2_Export fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size);
FMI2_Export fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                               fmi2FMUstate *state);
FMI2_Export fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                                    size_t unknowns, const fmi2ValueReference known[], size_t knowns,
                                                    const fmi2Real seed[], fmi2Real derivative[]);

FMI2_Export fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[]);
FMI2_Export fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[]);
FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_return);
FMI2_Export fmi2Status fmi2CancelStep(fmi2Component c);
FMI2_Export fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value);
FMI2_Export fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value);
FMI2_Export fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value);
FMI2_Export fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value);
FMI2_Export fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value);

#ifdef __cplusplus
}
#endif
#endif
