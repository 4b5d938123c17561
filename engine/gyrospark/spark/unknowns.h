/* SPARK methods: where the unknowns of a step are in x. */
#ifndef GS_SPARK_UNKNOWNS_H
#define GS_SPARK_UNKNOWNS_H

#include "gyrospark/engine.h"

/* Offsets of the unknowns (B.2) in x: k_1..k_S, k^_1..k^_S, Lambda_0..Lambda_(P-1). */
enum { K_HAT = S*N, LAMBDA = 2*S*N };

#endif
