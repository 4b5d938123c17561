/* q1 - q (A.3) */
static void displacement(real dt, const real x[U], real d[N])
{
    for (int a = 0; a < N; ++a) {
        real sum = 0;
        for (int j = 0; j < S; ++j)
            sum += tableau.b[j]*x[j*N + a];
        d[a] = dt*sum;
    }
}

/*
 * T2: q1 = q + dt sum b_j k_j (A.3), P = p + dt sum b^_j k^_j - dt sum_(l<p) b~_l G_l^T Lambda_l,
 * and the last multiplier from the constraint on the momenta (A.5), (A.6).
 */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    stage_values(w, dt, q, p, x);
    for (int a = 0; a < N; ++a) {
        real force = 0;
        for (int j = 0; j < S; ++j)
            force += tableau.b_hat[j]*x[K_HAT + j*N + a];
        for (int l = 0; l < ACTING; ++l)
            force -= tableau.b_tilde[l]*w->force[l][a];
        q1[a] = q[a] + w->D[P][a];
        p1[a] = p[a] + dt*force;
    }
    for (int l = 0; l < P*M; ++l)
        multipliers[l] = x[LAMBDA + l];
    const int status = project_momentum(AT(&w->constants,
        w->t + w->span), q1, p1, multipliers + P*M);
    for (int mu = 0; mu < M; ++mu)
        multipliers[P*M + mu] /= dt*tableau.b_tilde[P];
    return status != OK || isfinite(norm(N, q1) + norm(N, p1)) ? status : NOT_FINITE;
}
