/* Work of the forces and of rheonomic constraints. */

#if GS_FORCES
/* work += done, by compensated summation */
INLINE void SOLVER(add_to_work)(SOLVER(t) *w, lanes done)
{
    lanes total;
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
#endif

#if GS_TIME_DEPENDENT && GS_CONSTRAINED
/* work += sum impulse_j.g_t at the nodes 0..P-1: work of the rheonomic constraints. */
INLINE void SOLVER(add_constraint_work)(SOLVER(t) *w)
{
    const lanes *impulse = w->now.x + SOLVER(IMPULSE);
    lanes terms[SOLVER(P)], done;
    SOLVER(node_displacements)(w, w->now.x, w->now.D);
    for (int j = 0; j < SOLVER(P); ++j) {
        lanes position[N], rate[M];
        SOLVER(node_position)(w, j, position);
        lanes_constraint_rate(LANES_AT(&w->constants, w->t + w->force_time[j]*w->step),
            position, rate);
        terms[j] = splat(0);
        for (int mu = 0; mu < M; ++mu)
            terms[j] += impulse[j*M + mu]*rate[mu];
    }
    SOLVER(sum_rows)(P, 1, terms, &done);
    SOLVER(add_to_work)(w, done);
}

/* work += last_impulse.g_t at the end of the step. */
INLINE void SOLVER(add_final_constraint_work)(SOLVER(t) *w)
{
    lanes rate[M], done = splat(0);
    lanes_constraint_rate(&w->constants, w->q, rate);
    for (int mu = 0; mu < M; ++mu)
        done += w->constraint_state.last_impulse[mu]*rate[mu];
    SOLVER(add_to_work)(w, done);
}
#endif

#if GS_FORCES && !GS_CLOCK
/* work += h sum b_i F(Q_i, P_i, t_i).k_i, the work of the forces. */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    const lanes *L = w->now.x;
    lanes Q[SOLVER(S)*N], momentum[SOLVER(S)*N], terms[SOLVER(S)], done;
    SOLVER(stage_positions)(w, L, Q);
    SOLVER(stage_momenta)(w, L + SOLVER(HAT), momentum);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes F[N];
        IF_FRAME_WORK(lanes v[N];)
        const lanes t = w->t + w->stage_time[i];
        lanes_applied_force(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, F);
        terms[i] = splat(0);
        for (int a = 0; a < N; ++a)
            terms[i] += F[a]*L[i*N + a];
        IF_FRAME_WORK(lanes_frame_velocity(&w->constants, Q + i*N, v);)
        IF_FRAME_WORK(for (int a = 0; a < N; ++a))
            IF_FRAME_WORK(terms[i] += w->h_b[i]*F[a]*v[a];)
        IF_TIME(terms[i] += w->h_b[i]*lanes_energy_rate(&w->constants, Q + i*N, momentum + i*N);)
    }
    SOLVER(sum_rows)(S, 1, terms, &done);
    SOLVER(add_to_work)(w, done);
    IF_TIME(IF_CONSTRAINED(SOLVER(add_constraint_work)(w);))
}
#endif
