/* Double-word arithmetic, for angles. */
#ifndef GS_LINEAR_ALGEBRA_DOUBLE_WORD_H
#define GS_LINEAR_ALGEBRA_DOUBLE_WORD_H

#include "gyrospark/engine.h"

/* high + low: a number of twice the digits. */
typedef struct {
    turning high, low;
} twofold;

/* A rounded value: volatile keeps the compiler from contracting its product into a sum. */
static turning settled(volatile turning value)
{
    return value;
}

/* a + b, exactly */
static twofold sum_of(turning a, turning b)
{
    const turning sum = a + b, part = sum - a;
    return (twofold){ sum, (a - (sum - part)) + (b - part) };
}

/* a b, exactly */
static twofold product_of(turning a, turning b)
{
    const turning product = settled(a*b);
    return (twofold){ product, WIDE_MATH(fma)(a, b, -product) };
}

static twofold plus(twofold a, twofold b)
{
    const twofold high = sum_of(a.high, b.high), low = sum_of(a.low, b.low);
    const twofold sum = sum_of(high.high, high.low + low.high);
    return sum_of(sum.high, sum.low + low.low);
}

static twofold times(twofold a, twofold b)
{
    const twofold product = product_of(a.high, b.high);
    return sum_of(product.high, product.low + (a.high*b.low + a.low*b.high));
}

/* |x| of a vector in space */
static inline twofold length_of(turning x, turning y, turning z)
{
    const twofold square = plus(plus(product_of(x, x), product_of(y, y)), product_of(z, z));
    const turning root = WIDE_MATH(sqrt)(square.high);
    if (!(root > 0))
        return (twofold){ root, 0 };
    return sum_of(root, (WIDE_MATH(fma)(-root, root, square.high) + square.low)/(2*root));
}

/*
 * cos and sin of an angle: turned back by quarters of a circle, of which three numbers hold three
 * times the digits, it loses none of its own.
 */
static void circle(twofold angle, turning *cosine, turning *sine)
{
    const turning quarters = WIDE_MATH(floor)(angle.high/quarter[0] + (turning)0.5);
    if (!(WIDE_MATH(fabs)(quarters) < (turning)4503599627370496.0)) {
        *cosine = WIDE_MATH(cos)(angle.high); /* no digit is left to be kept */
        *sine = WIDE_MATH(sin)(angle.high);
        return;
    }
    for (int i = 0; i < 3; ++i)
        angle = plus(angle, product_of(-quarters, quarter[i]));
    const turning c = WIDE_MATH(cos)(angle.high), s = WIDE_MATH(sin)(angle.high);
    const turning x = c - angle.low*s, y = s + angle.low*c;
    const int turns = (int)(quarters - 4*WIDE_MATH(floor)(quarters/4));
    *cosine = turns == 0 ? x : turns == 1 ? -y : turns == 2 ? -x : y;
    *sine = turns == 0 ? y : turns == 1 ? x : turns == 2 ? -y : -x;
}

#endif
