/* Newton's system of T1 without the rates of momenta, which the rows of k give block by block. */
#ifndef GS_NEWTON_CONDENSED_H
#define GS_NEWTON_CONDENSED_H

#include "gyrospark/engine.h"

#if GS_CONDENSED
#include "gyrospark/linear_algebra/band_lu.h"

/*
 * With y = dk - r, of the rows of k, these give dP = H_pp^-1 (y - H_pq dQ), and the rows of k^
 *
 *     H_pp^-1 (y - H_pq dQ) + dt A^ (D dQ + C y) + dt A~ (G^T dLambda + K dD) = dt A^ r^,
 *     X = H_qp - F_p,  C = X H_pp^-1,  D = H_qq - F_q - C H_pq,
 *
 * with dQ = dt A dk, dD = dt A- dk, and G dD = r of the constraints. A chain keeps S times the
 * coordinates of a body and its multipliers; a band holds them. dk^ = r^ - D dQ - C y follows. The
 * generated file has the matrices row by row: `coupling_first` and `coupling_column`. The place of
 * dk is -1 if C and D are 0 and H_pp^-1 is a mass: this row gives dk, and couples the multipliers of
 * `free_pair`. IMS and EMS are the case of one stage with coefficients 1 and dq = dt k; their dp is
 * dP.
 */
#if !GS_SPARK
enum { K_HAT = DP };
#define A_STAGE(theta, i, j) 1
#define A_HAT(theta, i, j) 1
#define A_TILDE(theta, i, l) 1
#define A_BAR(theta, l, j) 1
#else
#include "gyrospark/spark/coefficients.h"
#endif

/* a <- a^-1 by Gauss-Jordan elimination with partial pivoting */
static int invert(int n, real *a)
{
    int pivots[LARGEST_BLOCK];
    for (int k = 0; k < n; ++k) {
        int pivot = k;
        for (int i = k + 1; i < n; ++i)
            if (MATH(fabs)(a[i*n + k]) > MATH(fabs)(a[pivot*n + k]))
                pivot = i;
        pivots[k] = pivot;
        if (!(MATH(fabs)(a[pivot*n + k]) > 0))
            return SINGULAR;
        for (int j = 0; j < n && pivot != k; ++j) {
            const real swap = a[k*n + j];
            a[k*n + j] = a[pivot*n + j];
            a[pivot*n + j] = swap;
        }
        const real inverse = 1/a[k*n + k];
        a[k*n + k] = 1;
        for (int j = 0; j < n; ++j)
            a[k*n + j] *= inverse;
        for (int i = 0; i < n; ++i) {
            const real factor = a[i*n + k];
            if (i == k || factor == 0)
                continue;
            a[i*n + k] = 0;
            for (int j = 0; j < n; ++j)
                a[i*n + j] -= factor*a[k*n + j];
        }
    }
    for (int k = n - 1; k >= 0; --k)
        for (int i = 0; i < n && pivots[k] != k; ++i) {
            const real swap = a[i*n + k];
            a[i*n + k] = a[i*n + pivots[k]];
            a[i*n + pivots[k]] = swap;
        }
    return OK;
}

/*
 * Adds the derivatives of an element of H to stage i: H_pp (which becomes its inverse), H_pq, H_qp,
 * H_qq, whose entries are at slot[] in this order. Element (b, a) of H_qp is qp[b*row + a*column].
 */
static int add_energy(condensed_t *m, int i, int np, int nq, real *pp, const real *pq,
    const real *qp, int row, int column, const real *qq, const int *slot)
{
    const int *at_pq = slot + np*np, *at_qp = at_pq + np*nq, *at_qq = at_qp + nq*np;
    real change[LARGEST_BLOCK]; /* dP/dQ */
    if (np > 0 && invert(np, pp) != OK)
        return SINGULAR;
    for (int e = 0; e < np*np; ++e)
        m->momentum_by_rate[i][slot[e]] += pp[e];
    for (int a = 0; a < np; ++a)
        for (int b = 0; b < nq; ++b) {
            real sum = 0, by_rate = 0;
            for (int e = 0; e < np; ++e) {
                sum -= pp[a*np + e]*pq[e*nq + b];
                by_rate += qp[b*row + e*column]*pp[e*np + a];
            }
            change[a*nq + b] = sum;
            m->momentum_by_q[i][at_pq[a*nq + b]] += sum;
            m->force_by_rate[i][at_qp[b*np + a]] += by_rate;
        }
    for (int a = 0; a < nq; ++a)
        for (int b = 0; b < nq; ++b) {
            real sum = qq[a*nq + b];
            for (int e = 0; e < np; ++e)
                sum += qp[a*row + e*column]*change[e*nq + b];
            m->force_by_q[i][at_qq[a*nq + b]] += sum;
        }
    return OK;
}

/* Adds the derivative -F_p of a force on `row` by momentum `a` to stage i: X dP. */
static inline void add_damping(condensed_t *m, int i, int row, int a, real F_p)
{
    int at = coupling_first[row];
    for (int e = coupling_first[a]; e < moved_end[a]; ++e) {
        const real by_rate = m->momentum_by_rate[i][e], by_q = m->momentum_by_q[i][e];
        if (by_rate == 0 && by_q == 0)
            continue;
        while (coupling_column[at] != coupling_column[e])
            ++at;
        m->force_by_rate[i][at] -= F_p*by_rate;
        m->force_by_q[i][at] -= F_p*by_q;
    }
}

/* Whether the row of k alone gives the rate of coordinate a */
static inline int is_free(int a)
{
    return condensed_position[a] < 0;
}

#if GS_CONSTRAINED
/* Entry e of G at a constraint node */
static inline real constraint_entry(const condensed_t *m, int node, int e)
{
    return m->constraint_by_q[node][constraint_place[e]];
}
#endif

/*
 * Assembles the condensed band from the matrices of stages and constraint nodes. Places of stages
 * follow one another, and those of nodes: blocks of S or P rows and columns.
 */
static void assemble_condensed(work_t *w, real dt)
{
    condensed_t *m = &w->condensed;
    real *J = w->J, by_q[S][S], by_force[S][S], by_stage[S][S][S];
    for (int r = 0; r < CONDENSED; ++r) {
        real *row = band_row(J, CONDENSED_BAND, r);
        for (int e = r - CONDENSED_BAND; e <= r + CONDENSED_BAND; ++e)
            row[e] = 0;
    }
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a)
            m->mobility[i][a] = is_free(a) ? 1/m->momentum_by_rate[i][coupling_first[a]] : 0;
#if GS_CONSTRAINED
    real by_curvature[S][P][S], by_mobility[P][P][S];
    for (int l = 0; l < P; ++l)
        for (int n = 0; n < P; ++n)
            for (int i = 0; i < S; ++i)
                by_mobility[l][n][i] = dt*A_BAR(w->theta, l + 1, i)*(dt*A_TILDE(w->theta, i, n));
#endif
    for (int i = 0; i < S; ++i)
        for (int j = 0; j < S; ++j) {
            by_q[i][j] = dt*A_STAGE(w->theta, i, j);
            by_force[i][j] = dt*A_HAT(w->theta, i, j);
            for (int k = 0; k < S; ++k)
                by_stage[i][k][j] = dt*A_HAT(w->theta, i, k)*(dt*A_STAGE(w->theta, k, j));
#if GS_CONSTRAINED
            for (int l = 0; l < P; ++l)
                by_curvature[i][l][j] = dt*A_TILDE(w->theta, i, l)*(dt*A_BAR(w->theta, l, j));
#endif
        }
    for (int a = 0; a < N; ++a)
        for (int e = coupling_first[a]; e < coupling_first[a + 1] && !is_free(a); ++e) {
            const int column = condensed_position[coupling_column[e]];
            for (int i = 0; i < S; ++i) {
                real *restrict block = band_row(J, CONDENSED_BAND, condensed_position[a] + i) + column;
                real sums[S] = { 0 };
                for (int k = 0; k < S; ++k)
                    for (int j = 0; j < S; ++j)
                        sums[j] += by_stage[i][k][j]*m->force_by_q[k][e];
#if GS_CONSTRAINED
                for (int l = 0; l < P; ++l)
                    for (int j = 0; j < S; ++j)
                        sums[j] += by_curvature[i][l][j]*m->curvature[l][e];
#endif
                if (e < moved_end[a]) {
                    for (int j = 0; j < S; ++j)
                        sums[j] += by_q[i][j]*m->momentum_by_q[i][e]
                            + by_force[i][j]*m->force_by_rate[j][e];
                    sums[i] += m->momentum_by_rate[i][e];
                }
                for (int j = 0; j < S; ++j)
                    block[j] = sums[j];
            }
        }
#if GS_CONSTRAINED
    for (int e = FREE_COUPLINGS; e < CONSTRAINT_COUPLINGS; ++e) {
        const int multiplier = condensed_position[S*N + constraint_coupling_row[e]],
            coordinate = condensed_position[constraint_coupling_column[e]];
        for (int l = 0; l < P; ++l)
            for (int i = 0; i < S; ++i) {
                band_row(J, CONDENSED_BAND, multiplier + l)[coordinate + i] =
                    dt*A_BAR(w->theta, l + 1, i)*constraint_entry(m, l + 1, e);
                band_row(J, CONDENSED_BAND, coordinate + i)[multiplier + l] =
                    dt*A_TILDE(w->theta, i, l)*constraint_entry(m, l, e);
            }
    }
    for (int e = 0; e < FREE_PAIRS; ++e) {
        const int one = free_pair[e][0], other = free_pair[e][1],
            a = constraint_coupling_column[one],
            row = condensed_position[S*N + constraint_coupling_row[one]],
            column = condensed_position[S*N + constraint_coupling_row[other]];
        for (int l = 0; l < P; ++l)
            for (int n = 0; n < P; ++n) {
                real sum = 0;
                for (int i = 0; i < S; ++i)
                    sum += by_mobility[l][n][i]*m->mobility[i][a];
                band_row(J, CONDENSED_BAND, row + l)[column + n] -=
                    sum*constraint_entry(m, l + 1, one)*constraint_entry(m, n, other);
            }
    }
#endif
}

#if GS_CONSTRAINED
/*
 * With the rates y of free coordinates without multipliers in b: subtracts G y from the rows of
 * constraints in z, or with is_solved the multipliers' part from the rates, with dLambda in z.
 */
static void eliminate_free(const work_t *w, real dt, int is_solved, real *restrict b,
    real *restrict z)
{
    const condensed_t *m = &w->condensed;
    for (int e = 0; e < FREE_COUPLINGS; ++e) {
        const int a = constraint_coupling_column[e];
        real *multipliers = z + condensed_position[S*N + constraint_coupling_row[e]];
        for (int l = 0; l < P; ++l)
            for (int i = 0; i < S; ++i)
                if (is_solved)
                    b[i*N + a] -= dt*A_TILDE(w->theta, i, l)*constraint_entry(m, l, e)*m->mobility[i][a]
                        *multipliers[l];
                else
                    multipliers[l] -= dt*A_BAR(w->theta, l + 1, i)*constraint_entry(m, l + 1, e)*b[i*N + a];
    }
}
#endif

/* Linearises and factorises T1 at the stage values of the last residual. */
static int condensed_factorise(work_t *w, real dt, const real q[N], const real x[U])
{
    if (linearise_condensed(w, dt, q, x) != OK)
        return SINGULAR;
    assemble_condensed(w, dt);
    return band_factorise(CONDENSED, CONDENSED_BAND, w->J, w->pivots, w->forward, w->rows,
        &w->products);
}

/* b <- J^-1 b, with the rows of k, k^ and the constraints */
static int condensed_solve(work_t *w, real dt, real b[U])
{
    condensed_t *m = &w->condensed;
    real *z = w->forward, (*by_rate)[N] = m->by_rate, (*force)[N] = m->force, (*dQ)[N] = m->dQ;
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            real momentum = 0, reaction = b[K_HAT + i*N + a];
            for (int e = coupling_first[a]; e < moved_end[a]; ++e) {
                const real r = b[i*N + coupling_column[e]];
                momentum += m->momentum_by_rate[i][e]*r;
                reaction += m->force_by_rate[i][e]*r;
            }
            by_rate[i][a] = momentum;
            force[i][a] = reaction;
        }
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            real sum = by_rate[i][a];
            for (int j = 0; j < S; ++j)
                sum += dt*A_HAT(w->theta, i, j)*force[j][a];
            if (is_free(a))
                b[i*N + a] = sum*m->mobility[i][a];
            else
                z[condensed_position[i*N + a]] = sum;
        }
#if GS_CONSTRAINED
    for (int e = 0; e < P*M; ++e)
        z[condensed_position[S*N + e]] = b[LAMBDA + e];
    eliminate_free(w, dt, 0, b, z);
#endif
    const int status = band_substitute(CONDENSED, CONDENSED_BAND, w->J, w->pivots, z);
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a)
            if (!is_free(a))
                b[i*N + a] = z[condensed_position[i*N + a]];
#if GS_CONSTRAINED
    eliminate_free(w, dt, 1, b, z);
    for (int e = 0; e < P*M; ++e)
        b[LAMBDA + e] = z[condensed_position[S*N + e]];
#endif
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            dQ[i][a] = 0;
            for (int j = 0; j < S; ++j)
                dQ[i][a] += dt*A_STAGE(w->theta, i, j)*b[j*N + a];
        }
#if GS_SPARK
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            real sum = force[i][a];
            for (int e = coupling_first[a]; e < coupling_first[a + 1]; ++e)
                sum -= m->force_by_q[i][e]*dQ[i][coupling_column[e]];
            for (int e = coupling_first[a]; e < moved_end[a]; ++e)
                sum -= m->force_by_rate[i][e]*b[i*N + coupling_column[e]];
            b[K_HAT + i*N + a] = sum;
        }
#else
    for (int a = 0; a < N; ++a) {
        real sum = -by_rate[0][a];
        for (int e = coupling_first[a]; e < moved_end[a]; ++e)
            sum += m->momentum_by_rate[0][e]*b[coupling_column[e]]
                + m->momentum_by_q[0][e]*dQ[0][coupling_column[e]];
        b[DP + a] = sum;
    }
    for (int a = 0; a < N; ++a)
        b[a] *= dt;
#endif
    return status;
}

#endif
#endif
