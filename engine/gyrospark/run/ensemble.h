/* Integration of an ensemble of trajectories. */
#ifndef GS_RUN_ENSEMBLE_H
#define GS_RUN_ENSEMBLE_H

#include "gyrospark/run/integrate.h"

#if GS_FIXED_POINT
#include "gyrospark/run/batch.h"
#endif

#if GS_SPLITTING
#include "gyrospark/splitting/batch.h"
#elif GS_FIXED_POINT
void NAME(integrate_many)(long count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(const real *inputs, long hold, long input_rows,)
    const real *dt, long steps, long every, real *q, real *p, real *q_out, real *p_out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    const long rows = steps/every, together = options->solver == NEWTON ? 1 : LANES;
    for (long i = 0; i < count; i += together) {
        const rows_t out = { .q = q_out == NULL ? NULL : q_out + i*rows*N,
            .p = p_out == NULL ? NULL : p_out + i*rows*N };
        IF_INPUTS(const inputs_t own = { inputs == NULL ? NULL : inputs + i*input_rows*INPUTS,)
            IF_INPUTS(hold, input_rows };)
        if (options->solver == NEWTON)
            status[i] = integrate(parameters + i, options, IF_INPUTS(
                own,) dt[i], steps, every, q + i*N, p + i*N,
                out, reports + i, work);
        else
            integrate_lanes(count - i < LANES ? (int)(count - i) : LANES, parameters + i, options,
                IF_INPUTS(own,)
                dt + i, steps, every, rows, q + i*N, p + i*N, out, reports + i, status + i, batch,
                work);
    }
    IF_FRAME(rotate_runs(count, parameters, dt, rows, every, q, p, q_out, p_out, reports);)
}
#else
void NAME(integrate_many)(long count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(const real *inputs, long hold, long input_rows,)
    const real *dt, long steps, long every, real *q, real *p, real *q_out, real *p_out,
    report_t *reports, int *status, work_t *work)
{
    const long rows = steps/every;
    for (long i = 0; i < count; ++i) {
        const rows_t out = { .q = q_out == NULL ? NULL : q_out + i*rows*N,
            .p = p_out == NULL ? NULL : p_out + i*rows*N };
        IF_INPUTS(const inputs_t own = { inputs == NULL ? NULL : inputs + i*input_rows*INPUTS,)
            IF_INPUTS(hold, input_rows };)
        status[i] = integrate(parameters + i, options, IF_INPUTS(
                own,) dt[i], steps, every, q + i*N, p + i*N, out,
            reports + i, work);
    }
    IF_FRAME(rotate_runs(count, parameters, dt, rows, every, q, p, q_out, p_out, reports);)
}
#endif

#endif
