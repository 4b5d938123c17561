/*
 * SPARK methods: the linearisation of a step of a system that is written out in full, on numbers or
 * lanes, as matrices.
 */

/* What derivatives of one step are made of. Index P of the nodes is the end of the step. */
typedef struct {
    NUMBER h;
    NUMBER q_rate[S][N], p_rate[S][N]; /* derivatives of Q_i and P_i by h at fixed x */
    NUMBER node_rate[P + 1][N], end_rate[N]; /* those of Q~_l, and of p1 before its projection */
    NUMBER H_qq[S][N][N], H_qp[S][N][N], H_pq[S][N][N], H_pp[S][N][N]; /* of H_q - F and H_p */
    NUMBER H_qc[S][N][E], H_pc[S][N][E];
#if GS_CONSTRAINED
    NUMBER G[P + 1][M][N], K[P + 1][N][N]; /* K[P] with the impulse of the projection */
    NUMBER impulse[M]; /* mu of the projection */
    NUMBER g_c[P + 1][M][E], force_c[P + 1][N][E];
    NUMBER f_q[M][N], f_p[M][N], f_c[M][E]; /* hidden constraints at the end */
    NUMBER W[M*M]; /* f_p G^T */
    TYPED(pivots_t) W_pivots[2*M];
#endif
    NUMBER J[U*U];
    TYPED(pivots_t) pivots[2*U];
} TYPED(linearisation_t);

#if GS_DERIVATIVES_IN_LANES || GS_ON_DUALS
#include "gyrospark/spark/jacobian_rows.h"
#endif

#if !GS_LAGRANGIAN
/* Derivatives of H_q - F and H_p by q, p, and constants. */
static inline void TYPED(rates_derivative)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], const NUMBER t[1], NUMBER H_qq[N][N], NUMBER H_qp[N][N], NUMBER H_pq[N][N],
    NUMBER H_pp[N][N], NUMBER H_qc[N][E], NUMBER H_pc[N][E])
{
    TYPED(rates_by_state)(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
    TYPED(rates_by_constants)(c, q, p, t, H_qc, H_pc);
}
#endif

#if GS_CONSTRAINED
/* Constraint forces of the nodes; their derivatives are those of the stage momenta. */
static void TYPED(linearise_nodes)(TYPED(constants) *c, NUMBER t, NUMBER h, const NUMBER q[N],
    const NUMBER x[U], NUMBER force[P][N], TYPED(linearisation_t) *l)
{
    for (int k = 0; k <= P; ++k) {
        NUMBER Q[N];
        const TYPED(constants) *at = TYPED_AT(c, t + h*tableau.c_tilde[k]);
        (void)t;
        for (int a = 0; a < N; ++a) {
            NUMBER sum = TYPED(broadcast)(0);
            for (int j = 0; j < S; ++j)
                sum += tableau.A_bar[k][j]*x[j*N + a];
            l->node_rate[k][a] = sum;
            Q[a] = q[a] + h*sum;
        }
        TYPED(constraint_jacobian)(at, Q, l->G[k]);
        if (k == P)
            break;
        const NUMBER *lambda = x + LAMBDA + k*M;
        TYPED(constraint_curvature)(at, Q, lambda, l->K[k]);
        TYPED(force_by_constants)(at, Q, lambda, l->force_c[k]);
        TYPED(constraint_by_constants)(at, Q, l->g_c[k]);
        for (int a = 0; a < N; ++a) {
            force[k][a] = l->G[k][0][a]*lambda[0];
            for (int mu = 1; mu < M; ++mu)
                force[k][a] += l->G[k][mu][a]*lambda[mu];
        }
    }
}

/* The end of the step: p1 = P - G^T mu with f(q1, p1) = 0; P - p1 determines mu. */
static int TYPED(linearise_end)(TYPED(constants) *c, NUMBER t, const NUMBER q1[N],
    const NUMBER p1[N], const NUMBER p_end[N], TYPED(linearisation_t) *l)
{
    NUMBER *mu = l->impulse;
    const TYPED(constants) *at = TYPED_AT(c, t);
    (void)t;
    TYPED(hidden_derivative)(at, q1, p1, l->f_q, l->f_p, l->f_c);
    for (int m = 0; m < M; ++m) {
        mu[m] = TYPED(broadcast)(0);
        for (int a = 0; a < N; ++a)
            mu[m] += l->f_p[m][a]*(p_end[a] - p1[a]);
        for (int k = 0; k < M; ++k) {
            l->W[m*M + k] = TYPED(broadcast)(0);
            for (int a = 0; a < N; ++a)
                l->W[m*M + k] += l->f_p[m][a]*l->G[P][k][a];
        }
    }
    const int status = TYPED(factorise_matrix)(M, l->W, l->W_pivots);
    if (status != OK)
        return status;
    TYPED(solve_with)(M, l->W, l->W_pivots, mu);
    TYPED(constraint_curvature)(at, q1, mu, l->K[P]);
    TYPED(force_by_constants)(at, q1, mu, l->force_c[P]);
    TYPED(constraint_by_constants)(at, q1, l->g_c[P]);
    return OK;
}
#endif

/*
 * Linearises the step from (q, p) with the unknowns x to (q1, p1), which starts at t. `c` are the
 * constants, in which the time may be set.
 */
static int TYPED(linearise)(TYPED(constants) *c, NUMBER t, NUMBER h, const NUMBER q[N],
    const NUMBER p[N], const NUMBER x[U], const NUMBER q1[N], const NUMBER p1[N],
    TYPED(linearisation_t) *l)
{
    NUMBER p_end[N];
    l->h = h;
#if GS_CONSTRAINED
    NUMBER force[P][N];
    TYPED(linearise_nodes)(c, t, h, q, x, force, l);
#else
    (void)q1, (void)p1;
#endif
    for (int i = 0; i < S; ++i) {
        NUMBER Q[N], momentum[N];
        const NUMBER stage_time = t + h*tableau.c[i];
        for (int a = 0; a < N; ++a) {
            NUMBER rate = TYPED(broadcast)(0), change = TYPED(broadcast)(0);
            for (int j = 0; j < S; ++j) {
                rate += tableau.A[i][j]*x[j*N + a];
                change += tableau.A_hat[i][j]*x[K_HAT + j*N + a];
            }
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                change -= tableau.A_tilde[i][k]*force[k][a];
#endif
            l->q_rate[i][a] = rate;
            l->p_rate[i][a] = change;
            Q[a] = q[a] + h*rate;
            momentum[a] = p[a] + h*change;
        }
        const TYPED(constants) *at = TYPED_AT(c, stage_time);
        TYPED(rates_derivative)(at, Q, momentum, &stage_time, l->H_qq[i], l->H_qp[i], l->H_pq[i],
            l->H_pp[i], l->H_qc[i], l->H_pc[i]);
    }
    for (int a = 0; a < N; ++a) {
        NUMBER rate = TYPED(broadcast)(0), change = TYPED(broadcast)(0);
        for (int j = 0; j < S; ++j) {
            rate += tableau.b[j]*x[j*N + a];
            change += tableau.b_hat[j]*x[K_HAT + j*N + a];
        }
#if GS_CONSTRAINED
        for (int k = 0; k < P; ++k)
            change -= tableau.b_tilde[k]*force[k][a];
#endif
        l->node_rate[P][a] = rate;
        l->end_rate[a] = change;
        p_end[a] = p[a] + h*change;
    }
#if GS_CONSTRAINED
    const int status = TYPED(linearise_end)(c, t + h, q1, p1, p_end, l);
    if (status != OK)
        return status;
#else
    (void)p_end;
#endif
    for (int e = 0; e < U*U; ++e)
        l->J[e] = TYPED(broadcast)(0);
    for (int i = 0; i < S; ++i)
        TYPED(fill_stage_rows)(NULL, h, i, l->H_qq[i], l->H_qp[i], l->H_pq[i], l->H_pp[i],
            IF_CONSTRAINED(l->G, l->K,) l->J);
    IF_CONSTRAINED(TYPED(fill_node_rows)(NULL, h, l->G, l->J);)
    return TYPED(factorise_matrix)(U, l->J, l->pivots);
}

/* (force, velocity) += the derivative of (H_q - F, H_p) of stage i along (dq, dp, dc) */
static inline void TYPED(stage_times)(const TYPED(linearisation_t) *l, int i, const NUMBER dq[N],
    const NUMBER dp[N], const NUMBER dc[E], NUMBER force[N], NUMBER velocity[N])
{
    TYPED(add_times)(N, N, &l->H_qq[i][0][0], dq, force);
    TYPED(add_times)(N, N, &l->H_qp[i][0][0], dp, force);
    TYPED(add_times)(N, E, &l->H_qc[i][0][0], dc, force);
    TYPED(add_times)(N, N, &l->H_pq[i][0][0], dq, velocity);
    TYPED(add_times)(N, N, &l->H_pp[i][0][0], dp, velocity);
    TYPED(add_times)(N, E, &l->H_pc[i][0][0], dc, velocity);
}

/* The transpose of stage_times, added to (q, p, c) */
static inline void TYPED(stage_transposed)(const TYPED(linearisation_t) *l, int i,
    const NUMBER force[N], const NUMBER velocity[N], NUMBER q[N], NUMBER p[N], NUMBER c[E])
{
    TYPED(add_transposed)(N, N, &l->H_qq[i][0][0], force, q);
    TYPED(add_transposed)(N, N, &l->H_pq[i][0][0], velocity, q);
    TYPED(add_transposed)(N, N, &l->H_qp[i][0][0], force, p);
    TYPED(add_transposed)(N, N, &l->H_pp[i][0][0], velocity, p);
    TYPED(add_transposed)(N, E, &l->H_qc[i][0][0], force, c);
    TYPED(add_transposed)(N, E, &l->H_pc[i][0][0], velocity, c);
}

#if GS_CONSTRAINED
/* force += the derivative of G^T lambda at node k along (dq, dc), at fixed lambda; dc may be NULL */
static inline void TYPED(force_times)(const TYPED(linearisation_t) *l, int k, const NUMBER dq[N],
    const NUMBER *dc, NUMBER force[N])
{
    TYPED(add_times)(N, N, &l->K[k][0][0], dq, force);
    if (dc != NULL)
        TYPED(add_times)(N, E, &l->force_c[k][0][0], dc, force);
}

/* The transpose of force_times, added to (q, c); c may be NULL */
static inline void TYPED(force_transposed)(const TYPED(linearisation_t) *l, int k,
    const NUMBER force[N], NUMBER q[N], NUMBER *c)
{
    TYPED(add_transposed)(N, N, &l->K[k][0][0], force, q);
    if (c != NULL)
        TYPED(add_transposed)(N, E, &l->force_c[k][0][0], force, c);
}

/* dg += G dq + g_c dc at node k; dc may be NULL */
static inline void TYPED(constraint_times)(const TYPED(linearisation_t) *l, int k,
    const NUMBER dq[N], const NUMBER *dc, NUMBER dg[M])
{
    TYPED(add_times)(M, N, &l->G[k][0][0], dq, dg);
    if (dc != NULL)
        TYPED(add_times)(M, E, &l->g_c[k][0][0], dc, dg);
}

/* q += G^T g, c += g_c^T g; c may be NULL */
static inline void TYPED(constraint_transposed)(const TYPED(linearisation_t) *l, int k,
    const NUMBER g[M], NUMBER q[N], NUMBER *c)
{
    TYPED(add_transposed)(M, N, &l->G[k][0][0], g, q);
    if (c != NULL)
        TYPED(add_transposed)(M, E, &l->g_c[k][0][0], g, c);
}

/* df += the derivative of the hidden constraints at the end along (dq, dp, dc) */
static inline void TYPED(hidden_times)(const TYPED(linearisation_t) *l, const NUMBER dq[N],
    const NUMBER dp[N], const NUMBER dc[E], NUMBER df[M])
{
    TYPED(add_times)(M, N, &l->f_q[0][0], dq, df);
    TYPED(add_times)(M, N, &l->f_p[0][0], dp, df);
    TYPED(add_times)(M, E, &l->f_c[0][0], dc, df);
}

/* The transpose of hidden_times, added to (q, p, c) */
static inline void TYPED(hidden_transposed)(const TYPED(linearisation_t) *l, const NUMBER f[M],
    NUMBER q[N], NUMBER p[N], NUMBER c[E])
{
    TYPED(add_transposed)(M, N, &l->f_q[0][0], f, q);
    TYPED(add_transposed)(M, N, &l->f_p[0][0], f, p);
    TYPED(add_transposed)(M, E, &l->f_c[0][0], f, c);
}

/* b <- W^-1 b, b <- W^-T b with W = f_p G^T */
static inline void TYPED(solve_hidden)(TYPED(linearisation_t) *l, NUMBER b[M])
{
    TYPED(solve_with)(M, l->W, l->W_pivots, b);
}

static inline void TYPED(solve_hidden_transposed)(TYPED(linearisation_t) *l, NUMBER b[M])
{
    TYPED(solve_transposed_with)(M, l->W, l->W_pivots, b);
}
#endif
