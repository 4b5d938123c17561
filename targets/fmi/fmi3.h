/* Types of FMI 3.0 (https://fmi-standard.org) that co-simulation reads, with their numbers. */
#ifndef FMI3_H
#define FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The name of a function; an importer that links several FMUs defines a prefix for each. */
#ifdef FMI3_OVERRIDE_FUNCTION_PREFIX
#define PREFIX FMI3_ACTUAL_FUNCTION_PREFIX
#else
#define PREFIX FMI3_FUNCTION_PREFIX
#endif
#ifndef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX
#endif
#ifndef FMI3_ACTUAL_FUNCTION_PREFIX
#define FMI3_ACTUAL_FUNCTION_PREFIX
#endif
#define FMI(name) JOIN(PREFIX, fmi3##name)
#define FMI_NAME(name) "fmi3" #name
/* Names of functions of kept states, which the versions of FMI spell differently. */
#define FMI_STATE(verb) FMI(verb##FMUState)
#define FMI_DESERIALIZE FMI(DeserializeFMUState)
#define FMI_STATE_SIZE FMI(SerializedFMUStateSize)
#define FMI3_VERSION "3.0"

typedef void *fmi3Instance, *fmi3FMUState, *fmi3InstanceEnvironment;
typedef const char *fmi3String;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error } fmi3Status;
typedef void (*fmi3LogMessageCallback)(
    void *environment, fmi3Status, fmi3String category, fmi3String text);
/* Of intermediate values, which the FMU has none of: never called. */
typedef void (*fmi3IntermediateUpdateCallback)(void);

/* Types of common.h. */
typedef fmi3Status fmi_status;
typedef fmi3Boolean fmi_boolean;
typedef fmi3Byte fmi_byte;

#endif
