/* ------------------------------------------------------------------------- the public functions */

int NAME(step)(const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N], real q1[N], real p1[N], real multipliers[ROOM],
    int *iterations, work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    return single_step(work, options, dt, q, p, q1, p1, multipliers, iterations);
}
