/* Sine and cosine of y + turns pi/2 from those of y. */
#ifndef GS_SIMD_QUADRANTS_H
#define GS_SIMD_QUADRANTS_H

#include "gyrospark/simd/vector.h"

#if !GS_WIDE_REAL
INLINE void select_quadrant(real turns, real s, real c, real *sine, real *cosine)
{
    const int n = (int)turns;
    const real first = n & 1 ? c : s, second = n & 1 ? s : c;
    *sine = n & 2 ? -first : first;
    *cosine = (n + 1) & 2 ? -second : second;
}

#if defined(LANE_BYTES)
/* turns/4 and turns/2 rounded to integers show the two lowest bits of turns. */
INLINE void lanes_select_quadrant(lanes turns, lanes s, lanes c, lanes *sine, lanes *cosine)
{
    const real shift = (real)3/(2*epsilon);
    const lanes quarter = turns - 4*((turns*(real)0.25 + shift) - shift); /* -2, -1, 0, 1 or 2 */
    const lanes_mask odd = quarter*quarter == splat(1);
    const lanes first = lanes_select_value(odd, c, s), second = lanes_select_value(odd, s, c);
    const lanes_mask half = quarter*quarter == splat(4);
    const lanes_mask sine_falls = half | (quarter == splat(-1));
    const lanes_mask cosine_falls = half | (quarter == splat(1));
    *sine = lanes_select_value(sine_falls, -first, first);
    *cosine = lanes_select_value(cosine_falls, -second, second);
}
#else
INLINE void lanes_select_quadrant(lanes turns, lanes s, lanes c, lanes *sine, lanes *cosine)
{
    select_quadrant(turns, s, c, sine, cosine);
}
#endif
#endif

#endif
