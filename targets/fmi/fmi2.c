/* A stepper as an FMU for co-simulation, FMI 2.0. */
#include "core.h"
#include "export.h"
#include "fmi2.h"

typedef struct {
    model_t model;
    fmi2CallbackFunctions calls;
    char name[64];
} instance_t;

#define MODEL(c) (&((instance_t *)(c))->model)

/* The text is the format: there is no % in it, and callers need not know variable arguments. */
static void say(const fmi2CallbackFunctions *calls, const char *name, fmi2Status status,
    const char *text)
{
    if (calls != NULL && calls->logger != NULL)
        calls->logger(calls->componentEnvironment, name, status, "logStatus", text);
}

/* The status of FMI, with the sentence to the logger. */
static fmi2Status report(fmi2Component c, status_t status, const reason_t *why)
{
    static const fmi2Status of[] = { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error };
    const instance_t *i = c;
    if (status != CORE_OK)
        say(&i->calls, i->name, of[status], why->text);
    return of[status];
}

static fmi2Status refuse(fmi2Component c, const char *text)
{
    const instance_t *i = c;
    say(&i->calls, i->name, fmi2Error, text);
    return fmi2Error;
}

#include "common.h"

EXPORT const char *FMI(GetTypesPlatform)(void) { return FMI2_PLATFORM; }
EXPORT const char *FMI(GetVersion)(void) { return FMI2_VERSION; }

EXPORT fmi2Component FMI(Instantiate)(fmi2String name, fmi2Type type, fmi2String guid,
    fmi2String resources, const fmi2CallbackFunctions *calls, fmi2Boolean visible,
    fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    const char *wrong = type != fmi2CoSimulation ? "this FMU is for co-simulation only"
        : guid == NULL || strcmp(guid, GUID) != 0
        ? "the guid is not that of this FMU: description and library differ" : NULL;
    instance_t *i = wrong == NULL ? calloc(1, sizeof *i) : NULL;
    if (i == NULL) {
        say(calls, name, fmi2Error, wrong != NULL ? wrong : "there is no memory for an instance");
        return NULL;
    }
    i->model = initial;
    if (calls != NULL)
        i->calls = *calls;
    snprintf(i->name, sizeof i->name, "%s", name != NULL ? name : "");
    return i;
}

EXPORT fmi2Status FMI(SetupExperiment)(fmi2Component c, fmi2Boolean has_tolerance,
    fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    REPORT(c, core_set_up(MODEL(c), start, why));
}

EXPORT fmi2Status FMI(EnterInitializationMode)(fmi2Component c)
{
    REPORT(c, core_enter(MODEL(c), MODEL(c)->time, why));
}

EXPORT fmi2Status FMI(GetReal)(fmi2Component c, const fmi2ValueReference r[], size_t n,
    fmi2Real values[])
{
    REPORT(c, core_get(MODEL(c), r, n, values, why));
}

EXPORT fmi2Status FMI(SetReal)(fmi2Component c, const fmi2ValueReference r[], size_t n,
    const fmi2Real values[])
{
    REPORT(c, core_set(MODEL(c), r, n, values, why));
}

EXPORT fmi2Status FMI(DoStep)(fmi2Component c, fmi2Real t, fmi2Real H, fmi2Boolean no_way_back)
{
    (void)no_way_back;
    REPORT(c, core_step(MODEL(c), t, H, why));
}

/* After a step that was discarded: the model is where it was. */
EXPORT fmi2Status FMI(GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return refuse(c, "the one status that is a real number is fmi2LastSuccessfulTime");
    *value = MODEL(c)->time;
    return fmi2OK;
}

EXPORT fmi2Status FMI(GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind,
    fmi2Boolean *value)
{
    if (kind != fmi2Terminated)
        return refuse(c, "the one status that is a boolean is fmi2Terminated");
    *value = 0;
    return fmi2OK;
}

/* The rest of the interface. */
ABSENT_OF_VARIABLES(GetInteger) ABSENT_OF_VARIABLES(GetBoolean) ABSENT_OF_VARIABLES(GetString)
ABSENT_OF_VARIABLES(SetInteger) ABSENT_OF_VARIABLES(SetBoolean) ABSENT_OF_VARIABLES(SetString)
ABSENT_OF_VARIABLES(GetDirectionalDerivative) ABSENT_OF_VARIABLES(SetRealInputDerivatives)
ABSENT_OF_VARIABLES(GetRealOutputDerivatives)
ABSENT(EnterEventMode) ABSENT(NewDiscreteStates) ABSENT(EnterContinuousTimeMode)
ABSENT(CompletedIntegratorStep) ABSENT(SetTime) ABSENT(SetContinuousStates) ABSENT(GetDerivatives)
ABSENT(GetEventIndicators) ABSENT(GetContinuousStates) ABSENT(GetNominalsOfContinuousStates)
ABSENT(CancelStep) ABSENT(GetStatus) ABSENT(GetIntegerStatus) ABSENT(GetStringStatus)
