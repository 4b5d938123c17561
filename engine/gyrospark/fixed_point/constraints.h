/* Constraints and multipliers in the fixed-point iteration. */

#if GS_CONSTRAINED
/* Multipliers of a lane: impulse/(h b~). */
static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    const lanes *impulse = w->now.x + SOLVER(IMPULSE);
    for (int mu = 0; mu < M; ++mu) {
        for (int l = 0; l < P; ++l) {
            const int node = l == 0 ? P - 1 : l - 1, at = lane + node % SOLVER(PER);
            multipliers[l*M + mu] = lane_get(&impulse[node/SOLVER(PER)*M + mu], at)
                /(lane_get(&w->h, lane)*tableau.b_tilde[l]);
        }
        multipliers[P*M + mu] = lane_get(&w->constraint_state.last_impulse[mu], lane)
            /(lane_get(&w->h, lane)*tableau.b_tilde[P]);
    }
}

/* Impulses of a lane: h b~ lambda. */
static void SOLVER(set_impulses)(SOLVER(t) *w, int lane, const real *multipliers)
{
    lanes *impulse = w->now.x + SOLVER(IMPULSE);
    for (int mu = 0; mu < M; ++mu)
        for (int l = 0; l < P; ++l) {
            const int node = l == 0 ? P - 1 : l - 1, at = lane + node % SOLVER(PER);
            lane_set(&impulse[node/SOLVER(PER)*M + mu], at,
                multipliers[l*M + mu]*lane_get(&w->h, lane)*tableau.b_tilde[l]);
        }
}

#include "gyrospark/fixed_point/schur.h"

#if GS_CONSTANT_SCHUR
/* impulse += (h W)^-1 defect at the nodes */
INLINE void SOLVER(apply_schur_inverse)(const SOLVER(t) *w, const lanes *defect, lanes *impulse)
{
    for (int j = 0; j < SOLVER(P); ++j)
        for (int mu = 0; mu < M; ++mu)
            for (int nu = 0; nu < M; ++nu)
                impulse[j*M + mu] += w->constraint_state.W_inverse[mu][nu]*defect[j*M + nu];
}
#else
/* Factorises W = G H_pp G^T at the nodes. */
INLINE void SOLVER(factorise_schur)(SOLVER(t) *w)
{
    for (int j = 0; j < SOLVER(P); ++j) {
        lanes position[N];
        SOLVER(node_position)(w, j, position);
        lanes_schur(LANES_AT(&w->constants,
            w->t + w->force_time[j]*w->step), position, w->p, w->now.factor[j]);
        lanes_factor(w->now.factor[j]);
    }
}

/* impulse += (h W)^-1 defect at the nodes */
INLINE void SOLVER(apply_schur_inverse)(SOLVER(t) *w, lanes *defect, lanes *impulse)
{
    lanes_substitute_all(SOLVER(P), w->now.factor, defect);
    for (int e = 0; e < SOLVER(P)*M; ++e)
        impulse[e] += w->h_inverse*defect[e];
}
#endif

/*
 * C_i = p + sum_j nu~_ij Y_j with the constraint forces Y_j = -G(Q~_j)^T impulse_j at the nodes
 * Q~_l = q + D_l, D_l = sum_j nu_lj L_j.
 */
INLINE void SOLVER(constraint_forces)(SOLVER(t) *w, lanes *C)
{
    const lanes *impulse = w->now.x + SOLVER(IMPULSE);
    for (int j = 0; j < SOLVER(P); ++j) {
        lanes position[N], *Y = w->now.Y + j*N;
        SOLVER(node_position)(w, j, position);
        lanes_constraint_force(LANES_AT(&w->constants,
            w->t + w->force_time[j]*w->step), position, impulse + j*M, Y);
        for (int a = 0; a < N; ++a)
            Y[a] = -Y[a];
    }
    SOLVER(add_constraint_forces)(w, w->now.Y, C);
}

/* Computes the node positions and the constraint forces of the starting values. */
INLINE void SOLVER(begin_iteration)(SOLVER(t) *w)
{
    SOLVER(node_displacements)(w, w->now.x, w->now.D);
    SOLVER(constraint_forces)(w, w->now.C);
    IF_FACTORISED(SOLVER(factorise_schur)(w);)
}

/* P_i = C_i + sum_j mu^_ij L^_j */
INLINE void SOLVER(stage_momenta)(const SOLVER(t) *w, const lanes *L_hat, lanes *momentum)
{
    SOLVER(add_momentum_rates)(w, w->now.C, N, L_hat, momentum);
}

/*
 * impulse += (h W)^-1 g: corrects the impulses so that the nodes of L satisfy g = 0, and computes
 * their forces C. The squared defect before the correction is stored for the convergence test.
 */
INLINE void SOLVER(correct_multipliers)(SOLVER(t) *w, const lanes *L, lanes *C)
{
    lanes g[SOLVER(P)*M], defect[SOLVER(P)*M];
    SOLVER(node_displacements)(w, L, w->now.D);
    for (int l = 0; l < SOLVER(P); ++l) {
        lanes increment[M];
        lanes_constraint_increment(LANES_BETWEEN(&w->constants,
            w->t, w->constraint_time[l]*w->step), w->q, w->now.D + l*N, increment);
        for (int mu = 0; mu < M; ++mu)
            g[l*M + mu] = w->constraint_state.g[mu] + increment[mu];
    }
    w->constraint_state.defect = splat(0);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(0);
        for (int l = 0; l < SOLVER(P); ++l)
            square += g[l*M + mu]*g[l*M + mu];
        w->constraint_state.defect += square*w->constraint_state.row_weight[mu];
    }
    w->constraint_state.defect *= w->q_weight;
    SOLVER(nodes_of_nodes)(w->zero, 0, TABLE(inverse), g, defect);
    SOLVER(apply_schur_inverse)(w, defect, w->now.x + SOLVER(IMPULSE));
    SOLVER(constraint_forces)(w, C);
}

/* dp += sum of the constraint forces + p_low (compensated summation) */
INLINE void SOLVER(add_impulses)(const SOLVER(t) *w, lanes dp[N])
{
    lanes impulse[N];
    SOLVER(sum_rows)(P, N, w->now.Y, impulse);
    for (int a = 0; a < N; ++a)
        dp[a] += impulse[a] + w->p_low[a];
}
#else
/* P_i = p + sum_j mu^_ij L^_j */
INLINE void SOLVER(stage_momenta)(const SOLVER(t) *w, const lanes *L_hat, lanes *momentum)
{
    SOLVER(add_momentum_rates)(w, w->p, 0, L_hat, momentum);
}

/* dp += p_low (compensated summation) */
INLINE void SOLVER(add_impulses)(const SOLVER(t) *w, lanes dp[N])
{
    for (int a = 0; a < N; ++a)
        dp[a] += w->p_low[a];
}
#endif
