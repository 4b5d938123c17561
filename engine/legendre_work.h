/* F(q, v, t) of a state */
static inline void ON(applied_force)(const HELD *c, const NUMBER q[N], const NUMBER p[N],
    const NUMBER t[1], NUMBER F[N])
{
    NUMBER A[MASS], v[N];
    ON(factor_mass)(c, q, A);
    ON(velocities)(c, q, p, A, v);
    ON(force_of_velocity)(c, q, v, t, F);
}
