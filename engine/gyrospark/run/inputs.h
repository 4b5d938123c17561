/* Inputs of a run. */
#ifndef GS_RUN_INPUTS_H
#define GS_RUN_INPUTS_H

#include "gyrospark/engine.h"

/*
 * Inputs of a run: a row has one value of each and is held for so many steps, throughout where hold
 * is 0; NULL for those among the parameters. Those of a trajectory begin `rows` rows behind those
 * of the one before.
 */
typedef struct {
    const real *values;
    long hold, rows;
} inputs_t;

/* The inputs of a step take their places among the constants. */
static void set_step_inputs(constants *c, const inputs_t *inputs, long trajectory, long step)
{
    const long row = trajectory*inputs->rows + (inputs->hold > 0 ? step/inputs->hold : 0);
    if (inputs->values != NULL)
        set_inputs(c, inputs->values + row*INPUTS);
}

#endif
