/* IMS and EMS: where the unknowns of a step are in x. */
#ifndef GS_MIDPOINT_UNKNOWNS_H
#define GS_MIDPOINT_UNKNOWNS_H

#include "gyrospark/engine.h"

/* Offsets of the unknowns in x: dq = q1 - q, dp = p1 - p, lambda. */
enum { DP = N, LAMBDA = 2*N };

#endif
