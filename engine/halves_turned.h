/* --------------------------------------------------------------------------- one step by Newton */

int NAME(T1)(const parameters_t *parameters, const options_t *options, real dt, const real q[N],
    const real p[N], real x[U], int *iterations, work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    return newton(work, options, dt, q, p, x, iterations);
}

/* Its frame stands still at the start of the step, where x is; the end is turned back. */
int NAME(T2)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real q1[N], real p1[N], real multipliers[ROOM], work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    const int status = finish(work, dt, q, p, x, q1, p1, multipliers);
    if (status == OK)
        turn_step(parameters, dt, q1, p1, multipliers);
    return status;
}
