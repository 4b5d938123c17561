/* Piecewise constant inputs of a run. */
#ifndef GS_RUN_INPUTS_H
#define GS_RUN_INPUTS_H

#include "gyrospark/engine.h"

/*
 * Inputs of a run, one row of INPUTS values per `hold` steps; hold = 0 holds the first row for the
 * whole run. If values is NULL, the parameters hold the inputs. Trajectory i starts at row i*rows.
 */
typedef struct {
    const real *values;
    long hold, rows;
} inputs_t;

/* Copies the inputs of a step to the constants. */
static void set_step_inputs(constants *c, const inputs_t *inputs, long trajectory, long step)
{
    const long row = trajectory*inputs->rows + (inputs->hold > 0 ? step/inputs->hold : 0);
    if (inputs->values != NULL)
        set_inputs(c, inputs->values + row*INPUTS);
}

#endif
