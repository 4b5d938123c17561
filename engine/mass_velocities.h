/* v with M v = p - b, from the factors of M */
static void ON(velocities)(const HELD *c, const NUMBER q[N], const NUMBER p[N],
    const NUMBER A[MASS], NUMBER v[N])
{
    ON(rest_momentum)(c, q, v);
    for (int a = 0; a < N; ++a)
        v[a] = p[a] - v[a];
    ON(solve_mass)(A, v);
}
