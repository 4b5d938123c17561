/* Velocity constraints A(q, t) q' + a(q, t) = 0 in the residual of T1. */
#ifndef GS_VELOCITY_CONSTRAINTS_RESIDUAL_H
#define GS_VELOCITY_CONSTRAINTS_RESIDUAL_H

#include "gyrospark/velocity_constraints/projection.h"

/* Offsets in x: multipliers Lambda_0..Lambda_P of g, then M_1..M_S of the velocity constraints. */
enum { FIRST_LAMBDA = 2*S*N, REACTIONS = FIRST_LAMBDA + (P + 1)*M };

/* r += A(Q_i)^T M_i in the rows of k^_i, which contains the reactions -A(Q_i)^T M_i */
static void add_reactions(work_t *w, real dt, const real x[U], real r[U])
{
    (void)dt; /* if A does not depend on time */
    for (int i = 0; i < S; ++i) {
        real A[ROWS][N];
        velocity_rows(AT(&w->constants, w->t + dt*tableau.c[i]), w->stage_q[i], A);
        for (int a = 0; a < N; ++a)
            for (int nu = 0; nu < ROWS; ++nu)
                r[(S + i)*N + a] += A[nu][a]*x[REACTIONS + i*ROWS + nu];
    }
}

/*
 * Q~_i and P~_i = p + dt sum a-_ij k^_j - dt sum v_il G(Q~_l)^T Lambda_l at the node i, where the
 * velocity constraints hold. P~_P is the end of the step.
 */
static void node_state(const work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    int i, real Q[N], real momentum[N])
{
    for (int a = 0; a < N; ++a) {
        real force = 0;
        for (int j = 0; j < S; ++j)
            force += tableau.A_bar[i][j]*x[(S + j)*N + a];
#if GS_CONSTRAINED
        for (int l = 0; l <= P; ++l)
            force -= velocity_table[i][l]*w->force[l][a];
#endif
        Q[a] = q[a] + w->D[i][a];
        momentum[a] = p[a] + dt*force;
    }
}

/*
 * Rows of r: A H_p + a at (Q~_i, P~_i), i = 1..P, and g_q H_p + g_t at the end of the step. The last
 * determines Lambda_P, which enters P~_i.
 */
static void velocity_residuals(work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], real r[U])
{
    for (int i = 1; i <= P; ++i) {
        real Q[N], momentum[N], f[HIDDEN];
        node_state(w, dt, q, p, x, i, Q, momentum);
        momentum_defect(AT(&w->constants, w->t + w->node_time[i]), Q, momentum, f);
        for (int nu = 0; nu < ROWS; ++nu)
            r[REACTIONS + (i - 1)*ROWS + nu] = f[M + nu];
        for (int mu = 0; mu < M && i == P; ++mu)
            r[FIRST_LAMBDA + P*M + mu] = f[mu];
    }
}

#endif
