/* H = (p - b)^T M^-1 (p - b)/2 + V */
static NUMBER ON(hamiltonian)(const HELD *c, const NUMBER q[N], const NUMBER p[N])
{
    NUMBER A[MASS], b[N], v[N];
    ON(factor_mass)(c, q, A);
    ON(velocities)(c, q, p, A, v);
    ON(rest_momentum)(c, q, b);
    NUMBER sum = (p[0] - b[0])*v[0];
    for (int a = 1; a < N; ++a)
        sum += (p[a] - b[a])*v[a];
    return (real)0.5*sum + ON(potential)(c, q);
}
