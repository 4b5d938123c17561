/* Several trajectories, one in each lane (SPARK). */
#ifndef GS_FIXED_POINT_BATCH_H
#define GS_FIXED_POINT_BATCH_H

#include "gyrospark/fixed_point/single.h"

#if GS_SPARK
#define GS_STAGES_IN_LANES 0
#define SOLVER(f) BATCH(f)
#define TABLE(name) &table_##name[0][0]
#define COEFFICIENT real
#define TABLE_PRODUCT NOINLINE

#include "gyrospark/fixed_point/state.h"

#include "gyrospark/fixed_point/constraints.h"

#include "gyrospark/fixed_point/update.h"

#include "gyrospark/fixed_point/work.h"

#include "gyrospark/predictor/select.h"

#if GS_FRAME
#include "gyrospark/frames/relative_equilibrium.h"
#endif

#include "gyrospark/fixed_point/iteration.h"

#undef GS_STAGES_IN_LANES
#undef SOLVER
#undef TABLE
#undef COEFFICIENT
#undef TABLE_PRODUCT
#endif

#endif
