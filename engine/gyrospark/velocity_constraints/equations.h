/* Velocity constraints A(q, t) q' + a(q, t) = 0 in the residual and in the Jacobian of T1. */
#ifndef GS_VELOCITY_CONSTRAINTS_EQUATIONS_H
#define GS_VELOCITY_CONSTRAINTS_EQUATIONS_H

#include "gyrospark/constraints/projection.h"

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

/* d(A(Q_i)^T M_i) in the rows of k^_i: by the rates dt a_ij K_i, by M_i the transpose of A */
static void add_reaction_derivatives(work_t *w, real dt, const real x[U], real J[U*U])
{
    for (int i = 0; i < S; ++i) {
        real A[ROWS][N], K[N][N];
        const real *mu = x + REACTIONS + i*ROWS;
        velocity_rows(AT(&w->constants, w->t + dt*tableau.c[i]), w->stage_q[i], A);
        reaction_curvature(AT(&w->constants, w->t + dt*tableau.c[i]), w->stage_q[i], mu, K);
        for (int a = 0; a < N; ++a) {
            real *row = J + ((S + i)*N + a)*U;
            for (int j = 0; j < S; ++j)
                for (int b = 0; b < N; ++b)
                    row[j*N + b] += dt*tableau.A[i][j]*K[a][b];
            for (int nu = 0; nu < ROWS; ++nu)
                row[REACTIONS + i*ROWS + nu] = A[nu][a];
        }
    }
}

/*
 * One row of J: the derivatives of a condition at the node i whose derivatives by Q~_i and P~_i are
 * f_q and f_p. With K_l = d(G_l^T Lambda_l)/dQ~_l,
 *   dP~_i/dk_j = -dt^2 sum v_il a-_lj K_l,   dP~_i/dk^_j = dt a-_ij,   dP~_i/dLambda_l = -dt v_il G_l^T
 */
static void fill_velocity_row(const work_t *w, real dt, int i, const real f_q[N],
    const real f_p[N], real row[U])
{
    (void)w; /* without constraints g(q) = 0 */
    for (int j = 0; j < S; ++j)
        for (int b = 0; b < N; ++b) {
            row[j*N + b] = dt*tableau.A_bar[i][j]*f_q[b];
            row[(S + j)*N + b] = dt*tableau.A_bar[i][j]*f_p[b];
        }
#if GS_CONSTRAINED
    for (int l = 0; l <= P; ++l) {
        const real weight = dt*velocity_table[i][l];
        for (int mu = 0; mu < M; ++mu) {
            real sum = 0;
            for (int a = 0; a < N; ++a)
                sum += f_p[a]*w->G[l][mu][a];
            row[FIRST_LAMBDA + l*M + mu] = -weight*sum;
        }
        for (int b = 0; b < N; ++b) {
            real sum = 0;
            for (int a = 0; a < N; ++a)
                sum += f_p[a]*w->K[l][a][b];
            for (int j = 0; j < S; ++j)
                row[j*N + b] -= dt*weight*tableau.A_bar[l][j]*sum;
        }
    }
#endif
}

/* Adds the velocity constraints to J at the stage values of the last residual. */
static void add_velocity_constraints(work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], real J[U*U])
{
#if GS_CONSTRAINED
    constraint_curvature(AT(&w->constants, w->t + w->node_time[P]), w->Q_tilde[P],
        x + FIRST_LAMBDA + P*M, w->K[P]);
#endif
    add_reaction_derivatives(w, dt, x, J);
    for (int i = 1; i <= P; ++i) {
        const real t = w->t + dt*tableau.c_tilde[i];
        real Q[N], momentum[N], H_q[N], H_p[N], B[HIDDEN][N], by_q[HIDDEN][N];
        real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N];
        node_state(w, dt, q, p, x, i, Q, momentum);
        gradient(AT(&w->constants, t), Q, momentum, &t, H_q, H_p);
        rates_by_state(&w->constants, Q, momentum, &t, H_qq, H_qp, H_pq, H_pp);
        force_directions(&w->constants, Q, B);
        velocity_defect_by_q(&w->constants, Q, H_p, by_q);
        for (int e = i == P ? 0 : M; e < HIDDEN; ++e) {
            real f_q[N], f_p[N];
            for (int b = 0; b < N; ++b) {
                f_q[b] = by_q[e][b];
                f_p[b] = 0;
                for (int a = 0; a < N; ++a) {
                    f_q[b] += B[e][a]*H_pq[a][b];
                    f_p[b] += B[e][a]*H_pp[a][b];
                }
            }
            const int row = e < M ? FIRST_LAMBDA + P*M + e : REACTIONS + (i - 1)*ROWS + e - M;
            fill_velocity_row(w, dt, i, f_q, f_p, J + row*U);
        }
    }
}

#endif
