/*
 * Calls of a stepper from C, with memory of exactly the documented sizes: below AddressSanitizer
 * every read and write beyond them ends the program. case.h includes the stepper's header and
 * defines its name and numbers.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "case.h"

#define JOIN(a, b) a##_##b
#define OF(name, function) JOIN(name, function)
#define CALL(function) OF(NAME, function)
enum { STEPS = 11, EVERY = 2, ROWS = STEPS/EVERY, MEMBERS = 5, COUNT = 3, STARTS = STEPS + 1 };

static void require(int holds, const char *what)
{
    if (!holds) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

static void *allocate(size_t count, size_t size)
{
    void *memory = calloc(count, size);
    require(memory != NULL, "out of memory");
    return memory;
}

static double *numbers(size_t count)
{
    return allocate(count, sizeof(double));
}

/* Returns `rows` copies of N numbers. */
static double *copies(const double *x, int rows)
{
    double *y = numbers((size_t)(rows*N));
    for (int i = 0; i < rows; ++i)
        memcpy(y + i*N, x, N*sizeof *x);
    return y;
}

static void run(const CALL(parameters) *parameters, int solver)
{
    const CALL(options) options = {.tolerance = 0, .max_iterations = 50, .solver = solver};
    CALL(work) *work = allocate(CALL(work_size)(), 1);
    CALL(report) *report = allocate(1, sizeof *report);
    double *q = copies(start_q, 1), *p = copies(start_p, 1), *held_q = copies(start_q, 1),
        *held_p = copies(start_p, 1), *q_out = numbers(ROWS*N), *p_out = numbers(ROWS*N),
        *multipliers = numbers(ROWS*MULTIPLIERS);
    int *iterations = allocate(ROWS, sizeof *iterations);

    CALL(begin)(work, parameters, &options, DT, held_q, held_p);
    require(CALL(advance)(work, 4, held_q, held_p) == 0, "advance");
    CALL(set_parameters)(work, parameters);
    require(CALL(advance)(work, STEPS - 4, held_q, held_p) == 0, "advance");
    require(CALL(report_of)(work)->steps == STEPS, "steps");
    require(CALL(integrate)(parameters, &options, DT, STEPS, EVERY, q, p, q_out, p_out,
        multipliers, iterations, report, work) == 0, "integrate");
    require(CALL(is_valid)(report, work), "a valid report");
    for (int a = 0; a < N; ++a)
        require(fabs(q[a] - held_q[a]) < 1e-12 && fabs(p[a] - held_p[a]) < 1e-9, "the same state");
    require(CALL(project)(parameters, q, p) == 0, "project");

    double *H = numbers(ROWS), *g = numbers(ROWS*CONSTRAINTS), *f = numbers(ROWS*HIDDEN);
    CALL(hamiltonian)(parameters, ROWS, q_out, p_out, H);
    CALL(defects)(parameters, ROWS, q_out, p_out, g, f);
    for (int i = 0; i < ROWS; ++i)
        require(isfinite(H[i]), "H");
    free(H), free(g), free(f), free(q), free(p), free(held_q), free(held_p), free(q_out),
        free(p_out), free(multipliers), free(iterations), free(report), free(work);
}

static void run_many(const CALL(parameters) *parameters)
{
    const CALL(options) options = {.tolerance = 0, .max_iterations = 50};
    CALL(work) *work = allocate(CALL(work_size)(), 1);
    CALL(report) *reports = allocate(MEMBERS, sizeof *reports);
    CALL(parameters) *all = allocate(MEMBERS, sizeof *all);
    double *q = copies(start_q, MEMBERS), *p = copies(start_p, MEMBERS), *dt = numbers(MEMBERS),
        *q_out = numbers(MEMBERS*ROWS*N), *p_out = numbers(MEMBERS*ROWS*N);
    int *status = allocate(MEMBERS, sizeof *status);
    for (int i = 0; i < MEMBERS; ++i) {
        all[i] = *parameters;
        dt[i] = DT/(1 + i);
    }
#if LANES
    CALL(batch) *batch = allocate(1, sizeof *batch);
    CALL(integrate_many)(MEMBERS, all, &options, dt, STEPS, EVERY, q, p, q_out, p_out, reports,
        status, batch, work);
    free(batch);
#else
    CALL(integrate_many)(MEMBERS, all, &options, dt, STEPS, EVERY, q, p, q_out, p_out, reports,
        status, work);
#endif
    for (int i = 0; i < MEMBERS; ++i)
        require(status[i] == 0 && reports[i].steps == STEPS, "a member");
    free(q), free(p), free(dt), free(q_out), free(p_out), free(status), free(reports), free(all),
        free(work);
}

#if DERIVATIVES
/* Tangents of a run along COUNT directions, and the adjoint of its end: <w, dz1> = <z_bar, dz>. */
static void differentiate(const CALL(parameters) *parameters)
{
    const CALL(options) options = {.tolerance = 0, .max_iterations = 50};
    CALL(work) *work = allocate(CALL(work_size)(), 1);
    CALL(report) *report = allocate(1, sizeof *report);
    void *memory = allocate(CALL(derivative_size)(), 1);
    double *q = numbers(STARTS*N), *p = numbers(STARTS*N), *x = numbers(STEPS*UNKNOWNS),
        *dz = numbers(Z*COUNT), *tangents = numbers(2*N*COUNT),
        *rows = numbers((ROWS + 1)*2*N*COUNT), *multipliers = numbers(STEPS*MULTIPLIERS*COUNT),
        *w = numbers(2*N), *z_bar = numbers(Z), *cotangents = numbers((ROWS + 1)*2*N),
        *g_z = numbers(CONSTRAINTS*Z), *f_z = numbers(HIDDEN*Z);
    memcpy(q, start_q, sizeof start_q);
    memcpy(p, start_p, sizeof start_p);
    require(CALL(integrate_and_keep)((size_t)&CALL(integrate), parameters, &options, DT, STEPS, q,
        p, x, report, work) == 0, "integrate and keep");
    CALL(constraint_derivatives)(parameters, q, p, g_z, f_z, memory);

    for (int i = 0; i < Z*COUNT; ++i)
        dz[i] = sin(1.0 + i);
    memcpy(tangents, dz, 2*N*COUNT*sizeof *dz);
    require(CALL(integrate_tangent)(parameters, DT, 0, STEPS, q, p, x, COUNT, dz, EVERY, rows,
        multipliers, tangents, memory) == 0, "tangents");
    for (int i = 0; i < 2*N; ++i)
        w[i] = cos(i);
    double along[COUNT] = {0}, size[COUNT] = {0};
    for (int k = 0; k < COUNT; ++k)
        for (int i = 0; i < 2*N; ++i) {
            along[k] += w[i]*tangents[i*COUNT + k];
            size[k] += fabs(w[i]*tangents[i*COUNT + k]);
        }
    double *none = numbers(STEPS*MULTIPLIERS);
    require(CALL(integrate_adjoint)(parameters, DT, 0, STEPS, q, p, x, cotangents, EVERY, none, w,
        z_bar, memory) == 0, "adjoint");
    for (int k = 0; k < COUNT; ++k) {
        double back = 0;
        for (int i = 0; i < Z; ++i)
            back += (i < 2*N ? w[i] : z_bar[i])*dz[i*COUNT + k];
        require(fabs(back - along[k]) <= 1e-9*size[k], "the adjoint of the tangents");
    }

    double *single = numbers(2*N*COUNT), *of_multipliers = numbers(MULTIPLIERS*COUNT);
    require(CALL(tangent)(parameters, DT, q, p, x, COUNT, dz, single, of_multipliers, memory) == 0,
        "the tangent of a step");
    require(CALL(adjoint)(parameters, DT, q, p, x, w, of_multipliers, z_bar, memory) == 0,
        "the adjoint of a step");
    free(none), free(single), free(of_multipliers), free(q), free(p), free(x), free(dz), free(tangents),
        free(rows), free(multipliers), free(w), free(z_bar), free(cotangents), free(g_z),
        free(f_z), free(memory), free(report), free(work);
}
#endif

int main(void)
{
    const CALL(parameters) parameters = PARAMETERS;
    for (int solver = 0; solver < SOLVERS; ++solver)
        run(&parameters, solver);
    run_many(&parameters);
#if DERIVATIVES
    differentiate(&parameters);
#endif
    return 0;
}
