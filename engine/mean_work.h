/* F.dq: the work of the forces. For a discrete gradient it is what H gains, exactly. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real F[N], sum = 0;
    CARRIED(real v[N];)
    const real t = w->t + dt/2;
    mean_values(w, q, p, x);
    applied_force(BETWEEN(&w->constants, w->t, w->span), w->q_mean, w->p_mean, &t, F);
    for (int a = 0; a < N; ++a)
        sum += F[a]*x[a];
    CARRIED(carried(&w->constants, w->q_mean, v));
    CARRIED(for (int a = 0; a < N; ++a))
        CARRIED(sum += dt*F[a]*v[a]);
    TIMED(sum += w->span*mean_drive(&w->constants, w->q_mean, w->p_mean, x, x + DP);)
    TIMED(sum += w->span*drive_of_constraints(w, x);)
    return sum;
}
