/*
 * Sine and cosine of all lanes at once. x is reduced by multiples n of pi/2 in three words (Cody and
 * Waite): the first two have 33 bits, so that their products with n are exact. The values of a lane
 * whose n is beyond MOST_TURNS, or whose x is not finite, are no numbers.
 */
#ifndef GS_SIMD_TRIGONOMETRIC_H
#define GS_SIMD_TRIGONOMETRIC_H

#include "gyrospark/simd/quadrants.h"
#include "gyrospark/simd/lanes.h"
#include "gyrospark/simd/sine_cosine.h"

INLINE void lanes_sine_cosine_near(lanes x, lanes *sine, lanes *cosine)
{
    const real shift = (real)3/((real)2*epsilon); /* adding it rounds to an integer */
    const lanes shifted = (x*(real)0.63661977236758134308) + shift;
    const lanes turns = shifted - shift;
    const lanes y = ((x - (turns*(real)1.57079632673412561417e+00))
        - (turns*(real)6.07710050630396597660e-11)) - (turns*(real)2.02226624879595063154e-21);
    lanes_sine_cosine_polynomials(turns, shifted, y, sine, cosine);
}

#endif
