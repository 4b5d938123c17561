/* H_t = -L_t at the v of a state */
static inline NUMBER ON(drive)(const HELD *c, const NUMBER q[N], const NUMBER p[N])
{
    NUMBER A[MASS], v[N];
    ON(factor_mass)(c, q, A);
    ON(velocities)(c, q, p, A, v);
    return ON(drive_of_velocity)(c, q, v);
}
