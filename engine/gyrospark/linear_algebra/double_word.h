/* Double-word arithmetic (Dekker, 1971) for the angles of a co-moving frame. */
#ifndef GS_LINEAR_ALGEBRA_DOUBLE_WORD_H
#define GS_LINEAR_ALGEBRA_DOUBLE_WORD_H

#include "gyrospark/engine.h"

/* The unevaluated sum high + low, |low| <= ulp(high)/2: twice the working precision. */
typedef struct {
    wide_real high, low;
} double_word;

/* Rounds a product: volatile prevents its contraction into a fused multiply-add. */
static wide_real rounded_wide(volatile wide_real value)
{
    return value;
}

/* a + b without error (two-sum) */
static double_word sum_of(wide_real a, wide_real b)
{
    const wide_real sum = a + b, part = sum - a;
    return (double_word){ sum, (a - (sum - part)) + (b - part) };
}

/* a b without error (two-product) */
static double_word product_of(wide_real a, wide_real b)
{
    const wide_real product = rounded_wide(a*b);
    return (double_word){ product, WIDE_MATH(fma)(a, b, -product) };
}

/* a + b in double-word precision */
static double_word plus(double_word a, double_word b)
{
    const double_word high = sum_of(a.high, b.high), low = sum_of(a.low, b.low);
    const double_word sum = sum_of(high.high, high.low + low.high);
    return sum_of(sum.high, sum.low + low.low);
}

/* a b in double-word precision */
static double_word times(double_word a, double_word b)
{
    const double_word product = product_of(a.high, b.high);
    return sum_of(product.high, product.low + (a.high*b.low + a.low*b.high));
}

/* The Euclidean norm of (x, y, z): a square root with one Newton correction */
static inline double_word length_of(wide_real x, wide_real y, wide_real z)
{
    const double_word square = plus(plus(product_of(x, x), product_of(y, y)), product_of(z, z));
    const wide_real root = WIDE_MATH(sqrt)(square.high);
    if (!(root > 0))
        return (double_word){ root, 0 };
    return sum_of(root, (WIDE_MATH(fma)(-root, root, square.high) + square.low)/(2*root));
}

/*
 * cos and sin of an angle. The range reduction (Cody-Waite) subtracts multiples of pi/2, which
 * quarter[] holds in triple-word precision, so that the reduced angle keeps its relative accuracy.
 */
static void cos_sin(double_word angle, wide_real *cosine, wide_real *sine)
{
    const wide_real quarters = WIDE_MATH(floor)(angle.high/quarter[0] + (wide_real)0.5);
    if (!(WIDE_MATH(fabs)(quarters) < (wide_real)4503599627370496.0)) {
        *cosine = WIDE_MATH(cos)(angle.high); /* beyond 2^52 quarters: no digit is left */
        *sine = WIDE_MATH(sin)(angle.high);
        return;
    }
    for (int i = 0; i < 3; ++i)
        angle = plus(angle, product_of(-quarters, quarter[i]));
    const wide_real c = WIDE_MATH(cos)(angle.high), s = WIDE_MATH(sin)(angle.high);
    const wide_real x = c - angle.low*s, y = s + angle.low*c;
    const int quadrant = (int)(quarters - 4*WIDE_MATH(floor)(quarters/4));
    *cosine = quadrant == 0 ? x : quadrant == 1 ? -y : quadrant == 2 ? -x : y;
    *sine = quadrant == 0 ? y : quadrant == 1 ? x : quadrant == 2 ? -y : -x;
}

#endif
