/* Ensembles of systems of many molecules, one after another: their lanes are full of molecules. */
#ifndef GS_SPLITTING_MOLECULES_BATCH_H
#define GS_SPLITTING_MOLECULES_BATCH_H

#include "gyrospark/splitting/molecules_run.h"
#include "gyrospark/run/integrate.h"

_Static_assert(sizeof(work_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");

int NAME(lanes)(void)
{
    return 1;
}

/* Integrates one system in place; the public header documents the arguments. */
static void integrate_lanes(int count, const parameters_t *parameters, const options_t *options,
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    work_t *own = (work_t *)(void *)(((size_t)batch->memory + 63) & ~(size_t)63);
    (void)rows, (void)work;
    if (count > 0 && *status == OK)
        *status = integrate(parameters, options, *dt, steps, every, q, p, out, reports, own);
}

void NAME(integrate_many)(long count, const parameters_t *parameters, const options_t *options,
    const real *dt, long steps, long every, real *q, real *p, real *q_out, real *p_out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    const long rows = steps/every;
    for (long i = 0; i < count; ++i) {
        const rows_t out = { .q = q_out == NULL ? NULL : q_out + i*rows*N,
            .p = p_out == NULL ? NULL : p_out + i*rows*N };
        integrate_lanes(1, parameters + i, options, dt + i, steps, every, rows, q + i*N, p + i*N,
            out, reports + i, status + i, batch, work);
    }
}

#endif
