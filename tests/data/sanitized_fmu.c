/* An importer of an FMU 2.0 that gives each call memory of the size that the call names.
 *
 * GUID and variable_count are those of the FMU, whose C is part of this file. */
#include "fmi2.c"

static void *copy_of(const void *bytes, size_t size)
{
    void *copy = malloc(size > 0 ? size : 1);
    if (copy != NULL && size > 0)
        memcpy(copy, bytes, size);
    return copy;
}

#define CHECK(condition) \
    do { \
        if (!(condition)) { \
            fprintf(stderr, "line %d: %s\n", __LINE__, #condition); \
            exit(1); \
        } \
    } while (0)

/* Each value by itself, all of them at once, and none. */
static void read_and_write(fmi2Component c)
{
    for (unsigned first = 0; first <= variable_count; ++first)
        for (size_t n = 0; n <= variable_count - first; n += variable_count - 1) {
            unsigned references[sizeof variables/sizeof variables[0]];
            for (size_t k = 0; k < n; ++k)
                references[k] = first + (unsigned)k;
            unsigned *r = copy_of(references, n*sizeof *r);
            double *values = copy_of(NULL, 0);
            values = realloc(values, n > 0 ? n*sizeof *values : 1);
            CHECK(fmi2GetReal(c, r, n, values) == fmi2OK);
            fmi2SetReal(c, r, n, values); /* some cannot be set now */
            free(r);
            free(values);
        }
    unsigned *none = copy_of(&variable_count, sizeof variable_count);
    double *value = copy_of(&(double){ 0 }, sizeof *value);
    CHECK(fmi2GetReal(c, none, 1, value) == fmi2Error);
    CHECK(fmi2SetReal(c, none, 1, value) == fmi2Error);
    free(none);
    free(value);
}

static void keep_and_restore(fmi2Component c)
{
    fmi2FMUstate state = NULL, again = NULL;
    size_t size = 0;
    CHECK(fmi2GetFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK);
    fmi2Byte *bytes = malloc(size);
    CHECK(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    CHECK(fmi2DeSerializeFMUstate(c, bytes, size - 1, &again) == fmi2Error);
    CHECK(fmi2DeSerializeFMUstate(c, bytes, size, &again) == fmi2OK);
    CHECK(fmi2SetFMUstate(c, again) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, &again) == fmi2OK);
    free(bytes);
}

int main(void)
{
    char *guid = copy_of(GUID, sizeof GUID), name[200];
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = 0; /* longer than an instance keeps */
    CHECK(fmi2Instantiate(name, fmi2CoSimulation, "another", "", NULL, 0, 0) == NULL);
    fmi2Component c = fmi2Instantiate(name, fmi2CoSimulation, guid, "", NULL, 0, 0);
    CHECK(c != NULL);
    for (int round = 0; round < 2; ++round) {
        read_and_write(c);
        CHECK(fmi2SetupExperiment(c, 0, 0, 0.0, 0, 0) == fmi2OK);
        CHECK(fmi2EnterInitializationMode(c) == fmi2OK);
        read_and_write(c);
        CHECK(fmi2ExitInitializationMode(c) == fmi2OK);
        for (int k = 0; k < 5; ++k) {
            CHECK(fmi2DoStep(c, k*STEP, STEP, 1) == fmi2OK);
            read_and_write(c);
            keep_and_restore(c);
        }
        CHECK(fmi2DoStep(c, 0.0, -1.0, 1) == fmi2Error);
        CHECK(fmi2Terminate(c) == fmi2OK);
        CHECK(fmi2Reset(c) == fmi2OK);
    }
    fmi2FreeInstance(c);
    free(guid);
    return 0;
}
