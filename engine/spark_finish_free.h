/* T2 without constraints: q1 = q + dt sum b_j k_j, p1 = p + dt sum b^_j k^_j (A.3). */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    (void)multipliers;
    stage_values(w, dt, q, p, x);
    for (int a = 0; a < N; ++a) {
        real force = 0;
        for (int j = 0; j < S; ++j)
            force += tableau.b_hat[j]*x[K_HAT + j*N + a];
        q1[a] = q[a] + w->D[P][a];
        p1[a] = p[a] + dt*force;
    }
    return isfinite(norm(N, q1) + norm(N, p1)) ? OK : NOT_FINITE;
}
