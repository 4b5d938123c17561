/*
 * An FMU for co-simulation of a stepper of profile control: what FMI 2.0 and FMI 3.0 share.
 *
 * model.h is generated. It includes the header of the stepper and defines
 *
 *   GUID               token of the model description
 *   STEPPER(x)         public name of the stepper, STATUS(x) a status of it
 *   N, V, OBSERVED     numbers of coordinates, of velocities (0: the start is q and p), of quantities
 *   ITERATIONS         of a step, at most
 *   START(m), VELOCITY(m), OBSERVE(m), SET_TIME(m)
 *                      calls of the functions of the stepper, 0 or nothing where there are none
 *   VARIABLES          rows of variables[], in the order of value references
 *   INITIAL            start values of a model
 *
 * The state of an FMU is one struct of plain data, so that a copy of its bytes restores it.
 */
#ifndef GYROSPARK_FMI_CORE_H
#define GYROSPARK_FMI_CORE_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define ROOM(n) ((n) > 0 ? (n) : 1)

typedef enum { CREATED, INITIALISING, RUNNING, TERMINATED } phase_t;
/* BEFORE_THE_START: without an effect on the state there, as START_STATE has one. */
typedef enum { AT_ANY_TIME, BEFORE_THE_START, START_STATE, NEVER } settable_t;
typedef enum { REAL, NONZERO, POSITIVE } domain_t;

typedef struct {
    phase_t phase;
    int moved;          /* whether another start than that of INITIAL was set */
    double time, dt;    /* now; the longest step */
    double begun, h;    /* of the run in progress: its start time, its step */
    int64_t steps;      /* taken in this run */
    double q[N], p[N], velocity[ROOM(V)], quantities[ROOM(OBSERVED)], energy;
    STEPPER(parameters) parameters, applied; /* as they were set; those of the run */
    STEPPER(work) work;
} model_t;

typedef struct {
    const char *name;
    size_t place; /* in model_t */
    settable_t settable;
    domain_t domain;
} variable_t;

static const variable_t variables[] = { VARIABLES };
static const unsigned variable_count = sizeof variables/sizeof variables[0];
static const model_t initial = INITIAL;

/* A function that fails writes a sentence here and returns its status; OK leaves it alone. */
typedef struct { char text[200]; } reason_t;
typedef enum { CORE_OK, CORE_WARNING, CORE_DISCARD, CORE_ERROR } status_t;
#define FAIL(status, ...) (snprintf(why->text, sizeof why->text, __VA_ARGS__), (status_t)(status))

static double *value_at(model_t *m, unsigned reference)
{
    return (double *)(void *)((char *)m + variables[reference].place);
}

/* Outputs of the state. */
static void observe(model_t *m)
{
    VELOCITY(m);
    OBSERVE(m);
    m->energy = STEPPER(energy)(&m->parameters, m->time, m->q, m->p);
}

static status_t check_domains(model_t *m, reason_t *why)
{
    for (unsigned k = 0; k < variable_count; ++k) {
        const double value = *value_at(m, k);
        if (variables[k].domain == POSITIVE && !(value > 0))
            return FAIL(CORE_ERROR, "%s = %g is not above 0", variables[k].name, value);
        if (variables[k].domain == NONZERO && value == 0)
            return FAIL(CORE_ERROR, "%s is 0, where any other number would do", variables[k].name);
    }
    return CORE_OK;
}

static status_t begin_run(model_t *m, double t, double h, reason_t *why)
{
    const STEPPER(options) options = { .tolerance = 0, .max_iterations = ITERATIONS };
    m->begun = m->time = t;
    m->h = h;
    m->steps = 0;
    SET_TIME(m);
    m->applied = m->parameters;
    return STEPPER(begin)(&m->work, &m->parameters, &options, h, m->q, m->p) == STATUS(OK)
        ? CORE_OK : FAIL(CORE_ERROR, "no run can begin with these values: a step of %g s, a "
            "parameter or the attitude is outside of its domain", h);
}

/* The state from what can be set: q and velocities, or q and p; that of INITIAL knows its p. */
static status_t core_start(model_t *m, reason_t *why)
{
    status_t status = check_domains(m, why);
    if (status == CORE_OK && m->moved && START(m) != STATUS(OK))
        status = FAIL(CORE_ERROR, "%s", V > 0
            ? "q and the velocities are no state of this model: they are off its constraints, or the "
              "numbers of an attitude are all 0"
            : "this FMU cannot check q, p and parameters against the constraints; build it again with "
              "these numbers");
    if (status == CORE_OK)
        status = begin_run(m, m->time, m->dt, why);
    if (status == CORE_OK)
        observe(m);
    return status;
}

/* From t to t + H in as few equal steps as are no longer than dt. A failed one changes nothing. */
static status_t core_step(model_t *m, double t, double H, reason_t *why)
{
    const model_t before = *m;
    const double count = fmax(1, ceil(H/m->dt*(1 - 1e-9))), h = H/count;
    const double ulp = DBL_EPSILON*fabs(t);
    status_t result = CORE_OK;
    if (m->phase != RUNNING)
        return FAIL(CORE_ERROR, "a step needs the initialisation to be over");
    if (!(H > 0 && isfinite(H) && isfinite(t)))
        return FAIL(CORE_ERROR, "the communication step is %g, and has to be above 0", H);
    if (!(fabs(t - m->time) <= 1e-3*H + 8*ulp))
        return FAIL(CORE_ERROR, "the step begins at t = %.17g, but the model is at %.17g", t, m->time);
    if (!(count < 1e9))
        return FAIL(CORE_ERROR, "%g is %g steps of dt, more than 1e9", H, count);
    /* Sums of steps are rounded in a master, by far less than a millionth of a step. */
    if (fabs(t - m->time) > 1e-6*H + 8*ulp)
        result = FAIL(CORE_WARNING, "the step begins at t = %.17g and the model is at %.17g: what is "
            "between them is not integrated", t, m->time);
    /* The run goes on, with its rounding and start values, unless step or time differ. */
    if (fabs(h - m->h)*count > 1e-12*H + ulp
        || fabs(t - (m->begun + (double)m->steps*m->h)) > 1e-9*H + 4*ulp) {
        if (begin_run(m, t, h, why) != CORE_OK)
            result = CORE_ERROR;
    } else if (memcmp(&m->applied, &m->parameters, sizeof m->applied) != 0) {
        m->applied = m->parameters;
        if (STEPPER(set_parameters)(&m->work, &m->parameters) != STATUS(OK))
            result = check_domains(m, why) != CORE_OK
                ? CORE_ERROR : FAIL(CORE_ERROR, "an input is outside of its domain");
    }
    for (int64_t k = 0; k < (int64_t)count && result < CORE_DISCARD; ++k) {
        const int status = (int)STEPPER(advance)(&m->work, m->q, m->p);
        if (status == STATUS(NOT_CONVERGED))
            result = FAIL(CORE_WARNING, "an iteration did not come down to round-off");
        else if (status != STATUS(OK))
            result = FAIL(CORE_DISCARD, "the step from t = %.17g by %g failed and nothing was "
                "done; a shorter one may do", t, H);
    }
    if (result >= CORE_DISCARD) {
        *m = before;
        return result;
    }
    m->steps += (int64_t)count;
    m->time = t + H;
    observe(m);
    return result;
}

/* The time at which the initialisation is to begin. */
static status_t core_set_up(model_t *m, double start, reason_t *why)
{
    if (m->phase != CREATED || !isfinite(start))
        return FAIL(CORE_ERROR, "the initialisation begins once, at a finite time, not at %g", start);
    m->time = start;
    return CORE_OK;
}

static status_t core_enter(model_t *m, double start, reason_t *why)
{
    const status_t status = core_set_up(m, start, why);
    if (status == CORE_OK)
        m->phase = INITIALISING;
    return status;
}

static status_t core_exit(model_t *m, reason_t *why)
{
    const model_t before = *m;
    const status_t status = m->phase == INITIALISING
        ? core_start(m, why) : FAIL(CORE_ERROR, "the initialisation has not begun");
    if (status == CORE_OK)
        m->phase = RUNNING;
    else
        *m = before;
    return status;
}

static status_t core_terminate(model_t *m, reason_t *why)
{
    if (m->phase != RUNNING)
        return FAIL(CORE_ERROR, "a model that does not run cannot be terminated");
    m->phase = TERMINATED;
    return CORE_OK;
}

/* Values; before the start those that follow from others are of the state that the start would be. */
static status_t core_get(model_t *m, const unsigned r[], size_t n, double values[], reason_t *why)
{
    model_t started;
    model_t *of_results = m;
    for (size_t k = 0; k < n; ++k) {
        if (r[k] >= variable_count)
            return FAIL(CORE_ERROR, "there is no value reference %u", r[k]);
        const int follows = variables[r[k]].settable == NEVER;
        if (follows && of_results == m && m->phase < RUNNING) {
            started = *m;
            of_results = &started;
            if (core_start(&started, why) != CORE_OK)
                return CORE_ERROR;
        }
        values[k] = *value_at(follows ? of_results : m, r[k]);
    }
    return CORE_OK;
}

static status_t core_set(model_t *m, const unsigned r[], size_t n, const double values[],
    reason_t *why)
{
    for (size_t k = 0; k < n; ++k) {
        if (r[k] >= variable_count)
            return FAIL(CORE_ERROR, "there is no value reference %u", r[k]);
        const settable_t settable = variables[r[k]].settable;
        if (settable == NEVER || (settable != AT_ANY_TIME && m->phase >= RUNNING))
            return FAIL(CORE_ERROR, "%s cannot be set %s", variables[r[k]].name,
                settable == NEVER ? "at all" : "after the initialisation");
        if (!isfinite(values[k]))
            return FAIL(CORE_ERROR, "%s = %g is not finite", variables[r[k]].name, values[k]);
    }
    for (size_t k = 0; k < n; ++k) {
        double *value = value_at(m, r[k]);
        m->moved |= variables[r[k]].settable == START_STATE && *value != values[k];
        *value = values[k];
    }
    return CORE_OK;
}

/* A serialised state: the token of the model, then the bytes of model_t. */
enum { TOKEN = sizeof GUID - 1, STATE_BYTES = TOKEN + sizeof(model_t) };

static status_t core_keep(const model_t *m, void **state, reason_t *why)
{
    if (*state == NULL)
        *state = malloc(sizeof *m);
    if (*state == NULL)
        return FAIL(CORE_ERROR, "there is no memory for a state of %zu bytes", sizeof *m);
    memcpy(*state, m, sizeof *m);
    return CORE_OK;
}

static status_t core_restore(model_t *m, const void *state, reason_t *why)
{
    if (state == NULL)
        return FAIL(CORE_ERROR, "there is no state to go back to");
    memcpy(m, state, sizeof *m);
    return CORE_OK;
}

static status_t core_write(const void *state, unsigned char bytes[], size_t size, reason_t *why)
{
    if (state == NULL || size < STATE_BYTES)
        return FAIL(CORE_ERROR, "a state takes %d bytes, there are %zu", (int)STATE_BYTES, size);
    memcpy(bytes, GUID, TOKEN);
    memcpy(bytes + TOKEN, state, sizeof(model_t));
    return CORE_OK;
}

static status_t core_read(const unsigned char bytes[], size_t size, void **state, reason_t *why)
{
    if (size != STATE_BYTES || memcmp(bytes, GUID, TOKEN) != 0)
        return FAIL(CORE_ERROR, "these %zu bytes are no state of this FMU", size);
    model_t m;
    memcpy(&m, bytes + TOKEN, sizeof m);
    return core_keep(&m, state, why);
}

#endif
