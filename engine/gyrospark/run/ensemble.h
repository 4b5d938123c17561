/* Integration of an ensemble of trajectories. */
#ifndef GS_RUN_ENSEMBLE_H
#define GS_RUN_ENSEMBLE_H

#include "gyrospark/run/integrate.h"

#if GS_FIXED_POINT
#include "gyrospark/run/batch.h"
#endif

#if GS_SPLITTING
#include "gyrospark/splitting/batch.h"
#endif

void NAME(integrate_many)(long count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(const real *inputs, long hold, long input_rows,)
    const real *dt, long steps, long every, real *q, real *p, real *q_out, real *p_out,
#if GS_FIXED_POINT || GS_SPLITTING
    report_t *reports, int *status, batch_memory *batch, work_t *work)
#else
    report_t *reports, int *status, work_t *work)
#endif
{
    const long rows = steps/every;
#if GS_SPLITTING
    const int together = TRAJECTORIES;
#elif GS_FIXED_POINT
    const int together = options->solver == NEWTON ? 0 : LANES;
#else
    const int together = 0;
#endif
    for (long i = 0; i < count; i += together > 0 ? together : 1) {
        const rows_t out = { .q = q_out == NULL ? NULL : q_out + i*rows*N,
            .p = p_out == NULL ? NULL : p_out + i*rows*N };
        IF_INPUTS(const inputs_t own = { inputs == NULL ? NULL : inputs + i*input_rows*INPUTS,)
            IF_INPUTS(hold, input_rows };)
#if !GS_SPLITTING
        if (together == 0)
            status[i] = integrate(parameters + i, options, IF_INPUTS(own,) dt[i], steps, every,
                q + i*N, p + i*N, out, reports + i, work);
#endif
#if GS_FIXED_POINT || GS_SPLITTING
        if (together > 0)
            integrate_lanes(count - i < together ? (int)(count - i) : together, parameters + i,
                options, IF_INPUTS(own,) dt + i, steps, every, rows, q + i*N, p + i*N, out,
                reports + i, status + i, batch, work);
#endif
    }
    IF_FRAME(rotate_runs(count, parameters, dt, rows, every, q, p, q_out, p_out, reports);)
}

#endif
