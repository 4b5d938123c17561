/* SPARK methods: derivatives of H_q - F and H_p by q and p, and rows of J from them, on numbers. */
#ifndef GS_SPARK_RATES_BY_STATE_H
#define GS_SPARK_RATES_BY_STATE_H

#include "gyrospark/engine.h"
#include "gyrospark/simd/numbers.h"

#if GS_LAGRANGIAN
#include "gyrospark/lagrangian/derivatives.h"
#endif

#include "gyrospark/spark/jacobian_rows.h"

#endif
