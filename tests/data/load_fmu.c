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
#include "fmi2Functions.h"
#else
#include "fmi3Functions.h"
#endif
#ifdef LINKED
#define LOAD(file) ((void *)(file))
#define GET(prefix, name) prefix##name##TYPE *name = prefix##name;
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
#define GET(prefix, name) \
    prefix##name##TYPE *name = FIND(library, #prefix #name); \
    if (name == NULL) { \
        puts("no " #prefix #name); \
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
    GET(fmi2, Instantiate) GET(fmi2, SetupExperiment) GET(fmi2, EnterInitializationMode)
    GET(fmi2, ExitInitializationMode) GET(fmi2, DoStep) GET(fmi2, GetReal) GET(fmi2, FreeInstance)
    const fmi2CallbackFunctions calls = { NULL, calloc, free, NULL, NULL };
    fmi2Component c = Instantiate("model", fmi2CoSimulation, a[2], "", &calls, 0, 0);
    failed |= c == NULL || SetupExperiment(c, 0, 0, 0, 0, 0) || EnterInitializationMode(c)
        || ExitInitializationMode(c);
    for (int k = 0; k < steps && !failed; ++k)
        failed |= DoStep(c, k*dt, dt, 1);
    failed = failed || GetReal(c, r, n, x);
#else
    GET(fmi3, InstantiateCoSimulation) GET(fmi3, EnterInitializationMode)
    GET(fmi3, ExitInitializationMode) GET(fmi3, DoStep) GET(fmi3, GetFloat64)
    GET(fmi3, FreeInstance)
    bool flags[3];
    double last;
    fmi3Instance c = InstantiateCoSimulation("model", a[2], NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL,
        NULL);
    failed |= c == NULL || EnterInitializationMode(c, 0, 0, 0, 0, 0) || ExitInitializationMode(c);
    for (int k = 0; k < steps && !failed; ++k)
        failed |= DoStep(c, k*dt, dt, 1, flags, flags + 1, flags + 2, &last);
    failed = failed || GetFloat64(c, r, n, x, n);
#endif
    for (size_t k = 0; k < n && !failed; ++k) {
        uint64_t bits;
        memcpy(&bits, x + k, sizeof bits);
        printf("%016llx\n", (unsigned long long)bits);
    }
    if (c != NULL)
        FreeInstance(c);
    return failed;
}
