/* Functions that the library exports, and refusals of those that this FMU does not offer. */
#ifndef EXPORT_H
#define EXPORT_H

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#if defined __GNUC__ /* the importer has the prototypes */
#pragma GCC diagnostic ignored "-Wmissing-prototypes"
#endif

#define JOIN_TEXT(prefix, name) prefix##name
#define JOIN(prefix, name) JOIN_TEXT(prefix, name)

/* The importer passes more arguments than a refusal reads: the C calling conventions of Linux,
 * macOS and Windows let the caller remove them. */
#define ABSENT(function) \
    EXPORT int FMI(function)(void *instance) \
    { return (int)refuse(instance, FMI_NAME(function) " is not offered by this FMU"); }
/* A function of variables succeeds for none of them. */
#define ABSENT_OF_VARIABLES(function) \
    EXPORT int FMI(function)(void *instance, const void *references, size_t count) \
    { \
        (void)references; \
        return count == 0 ? 0 \
            : (int)refuse(instance, FMI_NAME(function) " is not offered by this FMU"); \
    }
/* Another kind of instance is refused by a null pointer. */
#define ABSENT_INSTANCE(function) \
    EXPORT void *FMI(function)(const char *name) { (void)name; return NULL; }

#endif
