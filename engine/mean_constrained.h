/* What constraints add to the residual: the pull of the multipliers, and g at the end. */
static void constraint_rows(work_t *w, const real q[N], const real x[U], real r[U])
{
    real g[M], dg[M];
    add_mean_pull(&w->constants, w->q_mean, x, x + 2*N, r + N);
    constraint(AT(&w->constants, w->t), q, g);
    constraint_increment(BETWEEN(&w->constants, w->t, w->span), q, x, dg);
    for (int mu = 0; mu < M; ++mu)
        r[2*N + mu] = g[mu] + dg[mu];
}

/* q1 - q */
static void displacement(real dt, const real x[U], real d[N])
{
    (void)dt;
    for (int a = 0; a < N; ++a)
        d[a] = x[a];
}

/* The multipliers of a step, from its unknowns. */
static void step_multipliers(const real x[U], real multipliers[ROOM])
{
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = x[2*N + mu];
}
