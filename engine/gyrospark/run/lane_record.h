/* The report of trajectories that lie in lanes: energy error and constraint errors. */
#ifndef GS_RUN_LANE_RECORD_H
#define GS_RUN_LANE_RECORD_H

#include "gyrospark/simd/vector.h"

/* Members of a report, in lanes. */
typedef struct {
    lanes energy_start, energy_error_max, energy_error_sum;
    lanes constraint_max, constraint_sum, hidden_max, hidden_sum;
} lanes_record;

/* Adds the errors of states with energies H, work, and the M numbers g and f to the record. */
static void observe_lanes(lanes_record *record, lanes H, lanes work, const lanes *g, const lanes *f)
{
    const lanes error = lanes_size(H - record->energy_start - work);
    lanes g_size = splat(0), f_size = splat(0);
    (void)g, (void)f; /* without constraints */
    for (int mu = 0; mu < M; ++mu) {
        g_size = lanes_larger(g_size, lanes_size(g[mu]));
        f_size = lanes_larger(f_size, lanes_size(f[mu]));
    }
    record->energy_error_max = lanes_larger(error, record->energy_error_max);
    record->energy_error_sum += error;
    record->constraint_max = lanes_larger(g_size, record->constraint_max);
    record->constraint_sum += g_size;
    record->hidden_max = lanes_larger(f_size, record->hidden_max);
    record->hidden_sum += f_size;
}

/* Copies the errors of a lane to the report of its trajectory. */
static void write_record(const lanes_record *record, int lane, report_t *report)
{
    report->energy_error_max = lane_get(&record->energy_error_max, lane);
    report->energy_error_sum = lane_get(&record->energy_error_sum, lane);
    report->constraint_max = lane_get(&record->constraint_max, lane);
    report->constraint_sum = lane_get(&record->constraint_sum, lane);
    report->hidden_max = lane_get(&record->hidden_max, lane);
    report->hidden_sum = lane_get(&record->hidden_sum, lane);
}

#endif
