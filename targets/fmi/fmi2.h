/* Types of FMI 2.0 (https://fmi-standard.org) that co-simulation reads, with their numbers. */
#ifndef FMI2_H
#define FMI2_H

#include <stddef.h>

/* The name of a function; an importer that links several FMUs defines a prefix for each. */
#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX
#endif
#define FMI(name) JOIN(FMI2_FUNCTION_PREFIX, fmi2##name)
#define FMI_NAME(name) "fmi2" #name
/* Names of functions of kept states, which the versions of FMI spell differently. */
#define FMI_STATE(verb) FMI(verb##FMUstate)
#define FMI_DESERIALIZE FMI(DeSerializeFMUstate)
#define FMI_STATE_SIZE FMI(SerializedFMUstateSize)
#define FMI2_VERSION "2.0"
#define FMI2_PLATFORM "default"

typedef void *fmi2Component, *fmi2FMUstate;
typedef const char *fmi2String;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Boolean; /* 0 or 1 */
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated
} fmi2StatusKind;

/* Of these the FMU calls the logger alone: it allocates with malloc, and its steps end at once. */
typedef struct {
    void (*logger)(void *environment, fmi2String instance, fmi2Status, fmi2String category,
        fmi2String text, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

/* Types of common.h. */
typedef fmi2Status fmi_status;
typedef fmi2Boolean fmi_boolean;
typedef fmi2Byte fmi_byte;

#endif
