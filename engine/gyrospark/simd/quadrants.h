/* Sine and cosine of y + n pi/2 from those of y. */
#ifndef GS_SIMD_QUADRANTS_H
#define GS_SIMD_QUADRANTS_H

#if !GS_PROFILE_CONTROL && !GS_PROFILE_RUN
#include "gyrospark/simd/vector.h"
#endif

/*
 * Numbers and lanes give the same bits only if a sum of products is contracted to the same fma in
 * both. A product that an optimiser moves out of a loop is not contracted any more: the state is
 * loaded again in each turn of a loop.
 */
#if GS_PROFILE_CONTROL || GS_PROFILE_RUN
#define RELOAD_STATE ((void)0)
#else
#if defined(__GNUC__)
#define RELOAD_STATE __asm__ volatile("" ::: "memory")
#else
#define RELOAD_STATE ((void)0)
#endif
#endif

#if !GS_WIDE_REAL
/* Of a larger angle, in quarters of a turn, round-off is all that is left. */
enum { MOST_QUARTERS = 1000000 };

/* n is a whole number; n + 3/(2 epsilon) is `shifted`, whose last bits are those of n. */
INLINE void select_quadrant(real n, real shifted, real s, real c, real *sine, real *cosine)
{
    (void)shifted;
    if ((n > (real)-MOST_QUARTERS) && (n < (real)MOST_QUARTERS)) {
        const unsigned turns = (unsigned)(int)n;
        const real first = ((turns & 1U) != 0U) ? c : s;
        const real second = ((turns & 1U) != 0U) ? s : c;
        *sine = ((turns & 2U) != 0U) ? -first : first;
        *cosine = (((turns + 1U) & 2U) != 0U) ? -second : second;
    } else {
        *sine = (real)NAN;
        *cosine = (real)NAN;
    }
}

#if !GS_PROFILE_CONTROL && !GS_PROFILE_RUN
#if defined(LANE_BYTES)
/* By bits. */
INLINE void lanes_select_quadrant(lanes n, lanes shifted, lanes s, lanes c, lanes *sine,
    lanes *cosine)
{
    const lanes_mask turns = (lanes_mask)shifted, odd = -(turns & 1);
    const lanes_mask sign = (lanes_mask)splat((real)-0.0);
    const lanes_mask first = lanes_select_mask(odd, (lanes_mask)c, (lanes_mask)s);
    const lanes_mask second = lanes_select_mask(odd, (lanes_mask)s, (lanes_mask)c);
    const lanes_mask far = lanes_mask_not(
        (n > splat((real)-MOST_QUARTERS)) & (n < splat((real)MOST_QUARTERS)));
    *sine = lanes_select_value(far, splat((real)NAN),
        (lanes)(first ^ (-(turns >> 1 & 1) & sign)));
    *cosine = lanes_select_value(far, splat((real)NAN),
        (lanes)(second ^ (-((turns + 1) >> 1 & 1) & sign)));
}
#else
#define lanes_select_quadrant select_quadrant
#endif
#endif
#endif

#endif
