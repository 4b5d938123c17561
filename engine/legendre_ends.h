/*
 * The velocities v0 and v1 of both ends of a difference, where times have their middle among the
 * constants; q1 is the later place, A the factors of M there.
 */
static void ON(ends)(const HELD *c, const NUMBER qm[N], const NUMBER pm[N], const NUMBER dq[N],
    const NUMBER dp[N], NUMBER q1[N], NUMBER A[MASS], NUMBER v0[N], NUMBER v1[N])
{
    NUMBER q0[N], p0[N], p1[N];
    TIMED(HELD end = *c;)
    TIMED(const NUMBER middle = c->_t, half = (real)0.5*c->_late;)
    TIMED(c = ON(at_time)(&end, middle - half);)
    for (int a = 0; a < N; ++a) {
        q0[a] = qm[a] - (real)0.5*dq[a];
        p0[a] = pm[a] - (real)0.5*dp[a];
        q1[a] = qm[a] + (real)0.5*dq[a];
        p1[a] = pm[a] + (real)0.5*dp[a];
    }
    ON(factor_mass)(c, q0, A);
    ON(velocities)(c, q0, p0, A, v0);
    TIMED(c = ON(at_time)(&end, middle + half);)
    ON(factor_mass)(c, q1, A);
    ON(velocities)(c, q1, p1, A, v1);
}
