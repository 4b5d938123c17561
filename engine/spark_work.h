/* dt sum b_i F(Q_i, P_i, t_i).k_i: the work of the forces, of the order of the method. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real sum = 0;
    stage_values(w, dt, q, p, x);
    for (int i = 0; i < S; ++i) {
        real F[N], power = 0;
        CARRIED(real v[N];)
        const real t = w->t + dt*tableau.c[i];
        applied_force(AT(&w->constants, t), w->stage_q[i], w->stage_p[i], &t, F);
        for (int a = 0; a < N; ++a)
            power += F[a]*x[i*N + a];
        CARRIED(carried(&w->constants, w->stage_q[i], v));
        CARRIED(for (int a = 0; a < N; ++a))
            CARRIED(power += F[a]*v[a]);
        TIMED(power += drive(&w->constants, w->stage_q[i], w->stage_p[i]);)
        sum += tableau.b[i]*power;
    }
    TIMED(sum += drive_of_nodes(w, dt, q, p, x);)
    return dt*sum;
}
