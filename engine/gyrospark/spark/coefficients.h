/* SPARK methods: coefficients of a step, which free numbers theta change for exact energy. */
#ifndef GS_SPARK_COEFFICIENTS_H
#define GS_SPARK_COEFFICIENTS_H

/* Coefficients a_ij, a^_ij, a~_il and a-_lj; theta is not read without GS_EXACT_ENERGY. */
#if GS_EXACT_ENERGY
#include "gyrospark/spark/exact_energy.h"

#define A_STAGE(theta, i, j) stage_entry(theta, i, j)
#define A_HAT(theta, i, j) stage_entry(theta, i, j)
#define A_TILDE(theta, i, l) force_entry(theta, i, l)
#define A_BAR(theta, l, j) node_entry(theta, l, j)
#else
#define A_STAGE(theta, i, j) tableau.A[i][j]
#define A_HAT(theta, i, j) tableau.A_hat[i][j]
#define A_TILDE(theta, i, l) tableau.A_tilde[i][l]
#define A_BAR(theta, l, j) tableau.A_bar[l][j]
#endif

#endif
