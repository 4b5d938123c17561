/* sum b~_l Lambda_l.g_t(Q~_l, t_l): what a drive does through the constraints, by dt. */
static real drive_of_nodes(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real q1[N], p1[N], multipliers[ROOM], rate[M], sum = 0;
    if (finish(w, dt, q, p, x, q1, p1, multipliers) != OK)
        return NAN;
    for (int l = 0; l <= P; ++l) {
        constraint_rate(AT(&w->constants, w->t + w->late[l]), w->Q_tilde[l], rate);
        for (int mu = 0; mu < M; ++mu)
            sum += tableau.b_tilde[l]*multipliers[l*M + mu]*rate[mu];
    }
    return sum;
}
