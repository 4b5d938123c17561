/* sin x and cos x of flows, for numbers and lanes by the same operations, thus to the same bits. */
#if !GS_WIDE_REAL
/*
 * Sine and cosine of y + n pi/2, n = `turns`, by the Taylor polynomials of degrees 17 and 16 on
 * |y| <= pi/4, whose remainder is below 1e-19, by Estrin's scheme: few operations wait for others.
 */
INLINE void TYPED(sine_cosine_polynomials)(NUMBER turns, NUMBER shifted, NUMBER y, NUMBER *sine,
    NUMBER *cosine)
{
    const NUMBER z = y*y;
    const NUMBER z2 = z*z;
    const NUMBER z4 = z2*z2;
    const NUMBER s = y + (y*z*((((real)(-1./6) + (z*(real)(1./120))) + (z2*((real)(-1./5040)
        + (z*(real)(1./362880))))) + (z4*(((real)(-1./39916800) + (z*(real)(1./6227020800.)))
        + (z2*((real)(-1./1307674368000.) + (z*(real)(1./355687428096000.))))))));
    const NUMBER c = (real)1 - (z*(real)0.5) + (z2*((((real)(1./24) + (z*(real)(-1./720)))
        + (z2*((real)(1./40320) + (z*(real)(-1./3628800))))) + (z4*(((real)(1./479001600)
        + (z*(real)(-1./87178291200.))) + (z2*(real)(1./20922789888000.))))));
    TYPED(select_quadrant)(turns, shifted, s, c, sine, cosine);
}

#if GS_SPLITTING
/* x is reduced by multiples of pi/2 in two words (Cody and Waite), |x| < 2^20. */
INLINE void TYPED(sine_cosine)(NUMBER x, NUMBER *sine, NUMBER *cosine)
{
    const real shift = (real)3/((real)2*epsilon); /* adding it rounds to an integer */
    const NUMBER shifted = (x*(real)0.63661977236758134308) + shift;
    const NUMBER turns = shifted - shift;
    const NUMBER y = (x - (turns*half_pi[0])) - (turns*half_pi[1]);
    TYPED(sine_cosine_polynomials)(turns, shifted, y, sine, cosine);
}
#endif
#elif GS_SPLITTING
INLINE void TYPED(sine_cosine)(NUMBER x, NUMBER *sine, NUMBER *cosine)
{
    *sine = MATH(sin)(x);
    *cosine = MATH(cos)(x);
}
#endif
