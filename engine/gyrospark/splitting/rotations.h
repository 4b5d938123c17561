/*
 * Rotations of a unit quaternion, for numbers and for lanes. q maps body axes to space axes; l is
 * the angular momentum in space axes, m = R(q)^T l in body axes.
 */

/* |l|, never 0, so that sin(turn |l|)/|l| is turn for a body at rest */
INLINE NUMBER TYPED(size_of)(const NUMBER l[3])
{
#if GS_ON_DUALS
    const real x = value_of(l[0]);
    const real y = value_of(l[1]);
    const real z = value_of(l[2]);
    const real size = MATH(sqrt)(x*x + y*y + z*z + LIMIT(MIN));
    return make_dual(size, (x*scaled_slope_of(l[0]) + y*scaled_slope_of(l[1])
        + z*scaled_slope_of(l[2]))/size);
#else
    return TYPED(square_root)((l[0]*l[0]) + (l[1]*l[1]) + (l[2]*l[2]) + LIMIT(MIN));
#endif
}

/* ab <- a b */
INLINE void TYPED(quaternion_product)(const NUMBER a[4], const NUMBER b[4], NUMBER ab[4])
{
    ab[0] = (a[0]*b[0]) - (a[1]*b[1]) - (a[2]*b[2]) - (a[3]*b[3]);
    ab[1] = (a[0]*b[1]) + (a[1]*b[0]) + (a[2]*b[3]) - (a[3]*b[2]);
    ab[2] = (a[0]*b[2]) + (a[2]*b[0]) + (a[3]*b[1]) - (a[1]*b[3]);
    ab[3] = (a[0]*b[3]) + (a[3]*b[0]) + (a[1]*b[2]) - (a[2]*b[1]);
}

/* Copies the quaternion r to its places in q. */
INLINE void TYPED(set_quaternion)(const NUMBER r[4], const int at[4], NUMBER *q)
{
    for (int e = 0; e < 4; ++e) {
        q[at[e]] = r[e];
    }
}

/*
 * q <- exp(turn l) q, the free motion of a body with inertia I in all directions: l is constant, and
 * turn is the time over 2 I.
 */
INLINE void TYPED(rotate_freely)(NUMBER q[4], const NUMBER l[3], NUMBER turn)
{
    const NUMBER size = TYPED(size_of)(l);
    const NUMBER inverse = (real)1/size; /* beside the sine */
    NUMBER s;
    NUMBER c;
    TYPED(sine_cosine)(turn*size, &s, &c);
    const NUMBER k = s*inverse;
    const NUMBER rotation[4] = { c, k*l[0], k*l[1], k*l[2] };
    const NUMBER old[4] = { q[0], q[1], q[2], q[3] };
    TYPED(quaternion_product)(rotation, old, q);
}

/* q <- q (cos, sin e): a rotation about a body axis; `which` is 0, 1 or 2 for a coordinate axis. */
INLINE void TYPED(rotate_about_axis)(NUMBER q[4], int which, const NUMBER e[3], NUMBER c, NUMBER s)
{
    const NUMBER old[4] = { q[0], q[1], q[2], q[3] };
    if (which < 3) {
        const int i = 1 + which;
        const int j = 1 + ((which + 1)%3);
        const int k = 1 + ((which + 2)%3);
        q[0] = (c*old[0]) - (s*old[i]);
        q[i] = (c*old[i]) + (s*old[0]);
        q[j] = (c*old[j]) + (s*old[k]);
        q[k] = (c*old[k]) - (s*old[j]);
    } else {
        const NUMBER x = s*e[0];
        const NUMBER y = s*e[1];
        const NUMBER z = s*e[2];
        q[0] = (c*old[0]) - (x*old[1]) - (y*old[2]) - (z*old[3]);
        q[1] = (c*old[1]) + (x*old[0]) + (z*old[2]) - (y*old[3]);
        q[2] = (c*old[2]) + (y*old[0]) + (x*old[3]) - (z*old[1]);
        q[3] = (c*old[3]) + (z*old[0]) + (y*old[1]) - (x*old[2]);
    }
}

/* m_i, the angular momentum about body axis i: (R e_i).l */
INLINE NUMBER TYPED(body_momentum)(const NUMBER q[4], const NUMBER l[3], int i)
{
    const int j = (i + 1)%3;
    const int k = (i + 2)%3;
    const NUMBER a = q[0];
    const NUMBER x = q[1 + i];
    const NUMBER y = q[1 + j];
    const NUMBER z = q[1 + k];
    return (l[i]*((a*a) + (x*x) - (y*y) - (z*z))) + (l[j]*((real)2*((x*y) + (a*z))))
        + (l[k]*((real)2*((x*z) - (a*y))));
}

/* e.m for a unit vector e in body axes */
INLINE NUMBER TYPED(axis_momentum)(const NUMBER q[4], const NUMBER l[3], int which,
    const NUMBER e[3])
{
    NUMBER momentum;
    if (which < 3) {
        momentum = TYPED(body_momentum)(q, l, which);
    } else {
        momentum = (e[0]*TYPED(body_momentum)(q, l, 0)) + (e[1]*TYPED(body_momentum)(q, l, 1))
            + (e[2]*TYPED(body_momentum)(q, l, 2));
    }
    return momentum;
}

/* Scales q to |q| = 1: a factor that is rounded would be biased near 1, an increment is not. */
INLINE void TYPED(normalise)(NUMBER q[4])
{
    NUMBER defect = (real)1 - (q[0]*q[0]); /* contracted to fma */
    defect -= q[1]*q[1];
    defect -= q[2]*q[2];
    defect -= q[3]*q[3];
    defect *= (real)0.5;
    for (int i = 0; i < 4; ++i) {
        q[i] += q[i]*defect;
    }
}

/* p = 2 L(q)^T m, the product 2 l q of quaternions */
INLINE void TYPED(momentum_of)(const NUMBER q[4], const NUMBER l[3], NUMBER p[4])
{
    p[0] = (real)-2*((l[0]*q[1]) + (l[1]*q[2]) + (l[2]*q[3]));
    p[1] = (real)2*((l[0]*q[0]) + (l[1]*q[3]) - (l[2]*q[2]));
    p[2] = (real)2*((l[1]*q[0]) + (l[2]*q[1]) - (l[0]*q[3]));
    p[3] = (real)2*((l[2]*q[0]) + (l[0]*q[2]) - (l[1]*q[1]));
}

/* l = R(q) L(q) p/2 for |q| = 1 */
INLINE void TYPED(angular_momentum_of)(const NUMBER q[4], const NUMBER p[4], NUMBER l[3])
{
    l[0] = (real)0.5*((q[0]*p[1]) - (p[0]*q[1]) - ((p[2]*q[3]) - (p[3]*q[2])));
    l[1] = (real)0.5*((q[0]*p[2]) - (p[0]*q[2]) - ((p[3]*q[1]) - (p[1]*q[3])));
    l[2] = (real)0.5*((q[0]*p[3]) - (p[0]*q[3]) - ((p[1]*q[2]) - (p[2]*q[1])));
}

/* *sum += increment by compensated summation (Kahan); *low is what the sum has lost. */
INLINE void TYPED(accumulate)(NUMBER *sum, NUMBER *low, NUMBER increment)
{
    const NUMBER share = increment + *low;
    const NUMBER total = *sum + share;
    const NUMBER part = total - *sum;
    *low = (*sum - (total - part)) + (share - part);
    *sum = total;
}
