/* A stepper as an FMU for co-simulation, FMI 3.0: no event mode, no clocks, no early return. */
#include "core.h"
#include "export.h"
#include "fmi3.h"

typedef struct {
    model_t model;
    fmi3LogMessageCallback log;
    void *environment;
} instance_t;

#define MODEL(c) (&((instance_t *)(c))->model)

/* The status of FMI, with the sentence to the logger. */
static fmi3Status report(fmi3Instance c, status_t status, const reason_t *why)
{
    static const fmi3Status of[] = { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error };
    const instance_t *i = c;
    if (status != CORE_OK && i->log != NULL)
        i->log(i->environment, of[status], "logStatus", why->text);
    return of[status];
}

static fmi3Status refuse(fmi3Instance c, const char *text)
{
    const instance_t *i = c;
    if (i->log != NULL)
        i->log(i->environment, fmi3Error, "logStatus", text);
    return fmi3Error;
}

#include "common.h"

EXPORT const char *FMI(GetVersion)(void) { return FMI3_VERSION; }

EXPORT fmi3Instance FMI(InstantiateCoSimulation)(fmi3String name, fmi3String token,
    fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)required,
        (void)n, (void)update;
    const char *wrong = events ? "this FMU has no event mode"
        : token == NULL || strcmp(token, GUID) != 0
        ? "the token is not that of this FMU: description and library differ" : NULL;
    instance_t *i = wrong == NULL ? calloc(1, sizeof *i) : NULL;
    if (i == NULL) {
        if (log != NULL)
            log(environment, fmi3Error, "logStatus",
                wrong != NULL ? wrong : "there is no memory for an instance");
        return NULL;
    }
    i->model = initial;
    i->log = log;
    i->environment = environment;
    return i;
}

EXPORT fmi3Status FMI(EnterInitializationMode)(fmi3Instance c, fmi3Boolean has_tolerance,
    fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    REPORT(c, core_enter(MODEL(c), start, why));
}

EXPORT fmi3Status FMI(GetFloat64)(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    fmi3Float64 values[], size_t count)
{
    if (count != n)
        return refuse(c, "all variables are scalars: as many values as references");
    REPORT(c, core_get(MODEL(c), r, n, values, why));
}

EXPORT fmi3Status FMI(SetFloat64)(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const fmi3Float64 values[], size_t count)
{
    if (count != n)
        return refuse(c, "all variables are scalars: as many values as references");
    REPORT(c, core_set(MODEL(c), r, n, values, why));
}

EXPORT fmi3Status FMI(DoStep)(fmi3Instance c, fmi3Float64 t, fmi3Float64 H, fmi3Boolean no_way_back,
    fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    (void)no_way_back;
    reason_t reason = { "" };
    const status_t status = core_step(MODEL(c), t, H, &reason);
    *event = *terminate = *early = false;
    *last = MODEL(c)->time;
    return report(c, status, &reason);
}

/* The rest of the interface. */
ABSENT_INSTANCE(InstantiateModelExchange) ABSENT_INSTANCE(InstantiateScheduledExecution)
#define ABSENT_TYPE(type) \
    ABSENT_OF_VARIABLES(Get##type) ABSENT_OF_VARIABLES(Set##type)
ABSENT_TYPE(Float32) ABSENT_TYPE(Int8) ABSENT_TYPE(UInt8) ABSENT_TYPE(Int16) ABSENT_TYPE(UInt16)
ABSENT_TYPE(Int32) ABSENT_TYPE(UInt32) ABSENT_TYPE(Int64) ABSENT_TYPE(UInt64) ABSENT_TYPE(Boolean)
ABSENT_TYPE(String) ABSENT_TYPE(Binary) ABSENT_TYPE(Clock) ABSENT_TYPE(IntervalDecimal)
ABSENT_TYPE(IntervalFraction) ABSENT_TYPE(ShiftDecimal) ABSENT_TYPE(ShiftFraction)
ABSENT_OF_VARIABLES(GetDirectionalDerivative) ABSENT_OF_VARIABLES(GetAdjointDerivative)
ABSENT_OF_VARIABLES(GetOutputDerivatives)
ABSENT(GetNumberOfVariableDependencies) ABSENT(GetVariableDependencies)
ABSENT(EnterConfigurationMode) ABSENT(ExitConfigurationMode) ABSENT(EnterEventMode)
ABSENT(EvaluateDiscreteStates) ABSENT(UpdateDiscreteStates) ABSENT(EnterStepMode)
ABSENT(EnterContinuousTimeMode) ABSENT(CompletedIntegratorStep) ABSENT(SetTime)
ABSENT(SetContinuousStates) ABSENT(GetContinuousStates) ABSENT(GetContinuousStateDerivatives)
ABSENT(GetNominalsOfContinuousStates) ABSENT(GetEventIndicators) ABSENT(GetNumberOfEventIndicators)
ABSENT(GetNumberOfContinuousStates) ABSENT(ActivateModelPartition)
