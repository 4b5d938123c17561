/* Rows of a run near which a quantity crosses a level. */
#ifndef GS_RUN_CROSSINGS_H
#define GS_RUN_CROSSINGS_H

#include "gyrospark/linear_algebra/norms.h"

/* States whose quantities are evaluated together. */
enum { TOGETHER = 32 };

/*
 * Of a row of values, a stride apart, that come behind one which is near a level: no further from
 * it than it moves in the steps before and behind. The first and the last go to `rows`, unless
 * others are; `last` is the value before the first, less the level, and how far it moved.
 */
static void flag_near_crossing(long from, long count, const real *values, long stride, real level,
    real last[2], long rows[2])
{
    const real rounded = 2*epsilon*MATH(fabs)(level);
    real previous = last[0], last_change = last[1];
    for (long i = 0; i < count; ++i) {
        const real now = values[i*stride] - level, change = MATH(fabs)(now - previous);
        if (!(MATH(fabs)(previous) > last_change + change + rounded)) {
            if (rows[0] < 0 || from + i < rows[0])
                rows[0] = from + i;
            if (from + i > rows[1])
                rows[1] = from + i;
        }
        previous = now;
        last_change = change;
    }
    last[0] = previous;
    last[1] = last_change;
}

#endif
