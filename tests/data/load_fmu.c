/*
 * Loads the library of an FMU where Python is not, such as under Wine: takes steps without inputs
 * and prints the bits of the first values.
 *
 *     load_fmu LIBRARY TOKEN STEPS DT FIRST COUNT
 *
 * FIRST is a value reference, COUNT how many are printed. -DVERSION=2 or 3 says which FMI it is. With
 * -DLINKED the functions are linked to it, and LIBRARY is not read.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#if VERSION == 2
#include "fmi2.h"
#else
#include "fmi3.h"
#endif
#ifdef LINKED
#define LOAD(file) ((void *)(file))
#define GET(result, name, ...) extern result name(__VA_ARGS__);
#elif defined _WIN32
#include <windows.h>
#define LOAD(file) LoadLibraryA(file)
#define FIND(library, name) (void *)GetProcAddress(library, name)
#else
#include <dlfcn.h>
#define LOAD(file) dlopen(file, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif

#ifndef LINKED
#define GET(result, name, ...) \
    result (*name)(__VA_ARGS__) = FIND(library, #name); \
    if (name == NULL) { \
        puts("no " #name); \
        return 1; \
    }
#endif

int main(int count, char **a)
{
    void *library = count == 7 ? LOAD(a[1]) : NULL;
    double x[32] = { 0 };
    unsigned r[32];
    if (library == NULL) {
        puts("no library");
        return 1;
    }
    const int steps = atoi(a[3]);
    const double dt = atof(a[4]);
    const size_t n = (size_t)atoi(a[6]);
    for (size_t k = 0; k < n && k < 32; ++k)
        r[k] = (unsigned)(atoi(a[5]) + (int)k);
    int failed = 0;
#if VERSION == 2
    GET(void *, fmi2Instantiate, fmi2String, fmi2Type, fmi2String, fmi2String,
        const fmi2CallbackFunctions *, int, int)
    GET(fmi2Status, fmi2SetupExperiment, void *, int, double, double, int, double)
    GET(fmi2Status, fmi2EnterInitializationMode, void *)
    GET(fmi2Status, fmi2ExitInitializationMode, void *)
    GET(fmi2Status, fmi2DoStep, void *, double, double, int)
    GET(fmi2Status, fmi2GetReal, void *, const unsigned *, size_t, double *)
    GET(void, fmi2FreeInstance, void *)
    const fmi2CallbackFunctions calls = { NULL, calloc, free, NULL, NULL };
    void *c = fmi2Instantiate("model", fmi2CoSimulation, a[2], "", &calls, 0, 0);
    failed |= c == NULL || fmi2SetupExperiment(c, 0, 0, 0, 0, 0)
        || fmi2EnterInitializationMode(c) || fmi2ExitInitializationMode(c);
    for (int k = 0; k < steps && !failed; ++k)
        failed |= fmi2DoStep(c, k*dt, dt, 1) != fmi2OK;
    failed = failed || fmi2GetReal(c, r, n, x);
#define FREE fmi2FreeInstance
#else
    GET(void *, fmi3InstantiateCoSimulation, fmi3String, fmi3String, fmi3String, bool, bool, bool,
        bool, const uint32_t *, size_t, void *, fmi3LogMessageCallback,
        fmi3IntermediateUpdateCallback)
    GET(fmi3Status, fmi3EnterInitializationMode, void *, bool, double, double, bool, double)
    GET(fmi3Status, fmi3ExitInitializationMode, void *)
    GET(fmi3Status, fmi3DoStep, void *, double, double, bool, bool *, bool *, bool *, double *)
    GET(fmi3Status, fmi3GetFloat64, void *, const uint32_t *, size_t, double *, size_t)
    GET(void, fmi3FreeInstance, void *)
    bool flags[3];
    double last;
    void *c = fmi3InstantiateCoSimulation("model", a[2], NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    failed |= c == NULL || fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0)
        || fmi3ExitInitializationMode(c);
    for (int k = 0; k < steps && !failed; ++k)
        failed |= fmi3DoStep(c, k*dt, dt, 1, flags, flags + 1, flags + 2, &last) != fmi3OK;
    failed = failed || fmi3GetFloat64(c, r, n, x, n);
#define FREE fmi3FreeInstance
#endif
    for (size_t k = 0; k < n && !failed; ++k) {
        uint64_t bits;
        memcpy(&bits, x + k, sizeof bits);
        printf("%016llx\n", (unsigned long long)bits);
    }
    if (c != NULL)
        FREE(c);
    return failed;
}
