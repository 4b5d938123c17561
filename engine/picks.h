/* What lanes do by masks, for one number. */
typedef int mask;

INLINE mask others(mask m)
{
    return !m;
}

INLINE mask pick_mask(mask m, mask x, mask y)
{
    return m ? x : y;
}

INLINE real pick(mask m, real x, real y)
{
    return m ? x : y;
}

INLINE int any(mask m)
{
    return m;
}

INLINE real smaller(real a, real b)
{
    return a < b ? a : b;
}

INLINE real root(real x)
{
    return MATH(sqrt)(x);
}

INLINE real power(real x, real y)
{
    return MATH(pow)(x, y);
}

INLINE real all(real x)
{
    return x;
}
