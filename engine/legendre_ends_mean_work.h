/* F.dq: the work of the forces at the mean velocity dq/dt. It is what H gains, exactly. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real F[N], v[N], sum = 0;
    const real t = w->t + dt/2;
    mean_values(w, q, p, x);
    for (int a = 0; a < N; ++a)
        v[a] = x[a]/dt;
    force_of_velocity(BETWEEN(&w->constants, w->t, w->span), w->q_mean, v, &t, F);
    for (int a = 0; a < N; ++a)
        sum += F[a]*x[a];
    TIMED(sum += w->span*mean_drive(&w->constants, w->q_mean, w->p_mean, x, x + DP);)
    TIMED(sum += w->span*drive_of_constraints(w, x);)
    return sum;
}
