/* ------------------------------------------------------------------------- onto the constraints */

/*
 * Moves p along G^T onto f(q, p) = 0 with Newton steps, p <- p - G^T W^-1 f, until the step is
 * round-off; impulse is the sum of all W^-1 f. One step is exact when H is quadratic in p, the
 * next one removes its round-off.
 */
static int project_momentum(const constants *c, const real q[N], real p[N], real impulse[M])
{
    real previous = HUGE_VAL;
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] = 0;
    for (int iteration = 0; iteration < 20; ++iteration) {
        real f[M], change[N];
        hidden_constraint(c, q, p, f);
        const int status = solve_momentum(c, q, p, f);
        if (status != OK)
            return status;
        constraint_force(c, q, f, change);
        for (int a = 0; a < N; ++a)
            p[a] -= change[a];
        for (int mu = 0; mu < M; ++mu)
            impulse[mu] += f[mu];
        const real step = norm(N, change), floor = epsilon*norm(N, p);
        if (!isfinite(step))
            return NOT_FINITE;
        if (step <= floor/2 || (step <= SLACK_OF_MOMENTUM*floor && step >= previous/2))
            return OK;
        previous = step;
    }
    return NOT_CONVERGED;
}

/* Moves q along G^T onto g(q) = 0: q <- q - G^T (G G^T)^-1 g. */
static int project_coordinates(const constants *c, real q[N])
{
    real previous = HUGE_VAL;
    for (int iteration = 0; iteration < 50; ++iteration) {
        real g[M], change[N];
        constraint(c, q, g);
        const int status = solve_place(c, q, g);
        if (status != OK)
            return status;
        constraint_force(c, q, g, change);
        for (int a = 0; a < N; ++a)
            q[a] -= change[a];
        const real step = norm(N, change), floor = epsilon*norm(N, q);
        if (!isfinite(step))
            return NOT_FINITE;
        if (step <= 2*floor || (step <= SLACK_OF_PLACE*floor && step >= previous/2))
            return OK;
        previous = step;
    }
    return NOT_CONVERGED;
}

int NAME(project)(const parameters_t *parameters, real q[N], real p[N])
{
    constants c;
    real impulse[M];
    prepare(parameters, &c);
    const int status = project_coordinates(AT(&c, start_time(parameters)), q);
    return status == OK ? project_momentum(&c, q, p, impulse) : status;
}

void NAME(defects)(const parameters_t *parameters, long count, TIMED(
    const real *t,) const real *q, const real *p,
    real *g, real *f)
{
    constants c;
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i) {
        constraint(AT(&c, time_of(parameters, t, i)), q + i*N, g + i*M);
        hidden_constraint(&c, q + i*N, p + i*N, f + i*M);
    }
}
