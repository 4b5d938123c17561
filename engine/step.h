/* One step; the constants of the run are prepared. */
static int advance(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    real q1[N], real p1[N], real multipliers[ROOM], int *iterations)
{
    real q_end[N], p_end[N];
    int status = newton(w, options, dt, q, p, w->x, iterations);
    if (status == OK)
        status = finish(w, dt, q, p, w->x, q_end, p_end, multipliers);
    if (status != OK)
        return status;
    note_work(w, dt, q, p, w->x);
    for (int a = 0; a < N; ++a) {
        q1[a] = q_end[a];
        p1[a] = p_end[a];
    }
    return OK;
}

void NAME(guess)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    real x[U], work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    guess(work, dt, q, p, x);
}

void NAME(residual)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real r[U], work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    residual(work, dt, q, p, x, r);
}

void NAME(jacobian)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real J[U*U], work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    residual(work, dt, q, p, x, work->r);
    jacobian(work, dt, q, p, x, work->J);
    spread_jacobian(work->J, J);
}

real NAME(increment_size)(real dt, const real q[N], const real p[N], const real x[U],
    const real dx[U], const work_t *work)
{
    return increment_size(work, dt, q, p, x, dx);
}

int NAME(lands)(real dt, const real q[N], const real x[U], work_t *work)
{
    return lands(work, dt, q, x);
}

real NAME(last_increment)(const work_t *work)
{
    return work->increment;
}

void NAME(hamiltonian)(const parameters_t *parameters, long count, TIMED(
    const real *t,) const real *q, const real *p,
    real *H)
{
    constants c;
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i)
        H[i] = hamiltonian(AT(&c, time_of(parameters, t, i)), q + i*N, p + i*N);
}
