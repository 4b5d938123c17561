/* H_p = v and H_q - F = -R(q, v, t) */
static void gradient(const constants *c, const real q[N], const real p[N], const real t[1],
    real H_q[N], real H_p[N])
{
    real A[MASS];
    factor_mass(c, q, A);
    velocities(c, q, p, A, H_p);
    push(c, q, H_p, t, H_q);
    for (int a = 0; a < N; ++a)
        H_q[a] = -H_q[a];
}
