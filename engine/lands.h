/*
 * Small increments of huge unknowns are no solution: the constraints at the end of the step tell.
 */
static int lands(work_t *w, real dt, const real q[N], const real x[U])
{
    real d[N], q1[N], g[M], dg[M], reach[M];
    displacement(dt, x, d);
    for (int a = 0; a < N; ++a)
        q1[a] = q[a] + d[a];
    constraint(AT(&w->constants, w->t), q, g);
    constraint_increment(BETWEEN(&w->constants, w->t, w->span), q, d, dg);
    constraint_reach(AT(&w->constants, w->t + w->span), q1, reach);
    const real way = norm(N, d)/1000 + 64*epsilon*norm(N, q);
    for (int mu = 0; mu < M; ++mu) {
        const real allowed = MATH(fabs)(g[mu]) + reach[mu]*way;
        if (!(MATH(fabs)(g[mu] + dg[mu]) <= allowed))
            return isfinite(allowed) ? DIVERGED : NOT_FINITE;
    }
    return OK;
}
