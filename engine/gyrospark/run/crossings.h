/* Detection of the steps in which a quantity may cross a level. */
#ifndef GS_RUN_CROSSINGS_H
#define GS_RUN_CROSSINGS_H

#include "gyrospark/linear_algebra/norms.h"

/* Number of states whose quantities are evaluated in one block. */
enum { TOGETHER = 32 };

/*
 * Extends the range rows[0]..rows[1] by the first and last value whose predecessor is near the
 * level. A value x_i is near if |x_i - level| <= |x_i - x_(i-1)| + |x_(i+1) - x_i|; a sign change
 * elsewhere would need a larger step. Values are `stride` apart. `last` carries x - level and the
 * last change from block to block.
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
