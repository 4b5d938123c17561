/* At how many nodes multipliers act, l = 0..P-1 */
enum { ACTING = P };

/* G(Q~_l)^T Lambda_l at the nodes l = 0..P-1, where multipliers act */
static void node_forces(work_t *w, const real q[N], const real x[U])
{
    const real *lambda = x + 2*S*N;
    for (int l = 0; l <= P; ++l)
        for (int a = 0; a < N; ++a)
            w->Q_tilde[l][a] = q[a] + w->D[l][a];
    for (int l = 0; l < P; ++l)
        constraint_force(AT(&w->constants,
            w->t + w->late[l]), w->Q_tilde[l], lambda + l*M, w->force[l]);
}

/* g(Q~_l) at the nodes l = 1..P, where the constraints are asked for */
static void node_residuals(work_t *w, const real q[N], real r[P*M])
{
    real g[M];
    constraint(AT(&w->constants, w->t), q, g);
    for (int l = 1; l <= P; ++l) {
        real dg[M];
        constraint_increment(BETWEEN(&w->constants, w->t, w->late[l]), q, w->D[l], dg);
        for (int mu = 0; mu < M; ++mu)
            r[(l - 1)*M + mu] = g[mu] + dg[mu];
    }
}
