/* SPARK with exact energy: free numbers theta of the tableau, one or two for each step. */
#ifndef GS_SPARK_EXACT_ENERGY_H
#define GS_SPARK_EXACT_ENERGY_H

#include "gyrospark/linear_algebra/norms.h"

#if GS_EXACT_ENERGY
/* Entry of A + theta_0 Z with Z_ij = b_j (u_i v_j - v_i u_j), of rank two. */
static real stage_entry(const real theta[2], int i, int j)
{
    return tableau.A[i][j] + theta[0]*(tableau.b[j]*(energy_u[i]*energy_v[j]
        - energy_v[i]*energy_u[j]));
}

#if GS_CONSTRAINED
/* Directions of theta: Z of the stages, and the pair Z-, Z~ of the constraint nodes. */
enum { DIRECTIONS = 2 };

/*
 * Entries of A- + theta_1 Z- and A~ + theta_1 Z~ with Z-_lj = w_l b_j u_j, Z~_il = -b~_l w_l u_i: of
 * rank one, and zero at the first and the last node.
 */
static real node_entry(const real theta[2], int l, int j)
{
    return tableau.A_bar[l][j] + theta[1]*(energy_w[l]*(tableau.b[j]*energy_u[j]));
}

static real force_entry(const real theta[2], int i, int l)
{
    return tableau.A_tilde[i][l] - theta[1]*(tableau.b_tilde[l]*energy_w[l]*energy_u[i]);
}

/* D_l += dt theta_1 sum Z-_lj k_j */
static void add_theta_to_nodes(work_t *w, real dt, const real x[U])
{
    for (int a = 0; a < N; ++a) {
        real moment = 0;
        for (int j = 0; j < S; ++j)
            moment += tableau.b[j]*energy_u[j]*x[j*N + a];
        for (int l = 1; l < P; ++l)
            w->D[l][a] += dt*w->theta[1]*(energy_w[l]*moment);
    }
}

/* P_i -= dt theta_1 sum Z~_il G_l^T Lambda_l */
static void add_theta_to_forces(work_t *w, real dt)
{
    for (int a = 0; a < N; ++a) {
        real moment = 0;
        for (int l = 1; l < P; ++l)
            moment += tableau.b_tilde[l]*energy_w[l]*w->force[l][a];
        for (int i = 0; i < S; ++i)
            w->stage_p[i][a] += dt*w->theta[1]*(energy_u[i]*moment);
    }
}
#else
enum { DIRECTIONS = 1 };
#endif

/* Q_i += dt theta_0 sum Z_ij k_j, P_i += dt theta_0 sum Z_ij k^_j, and the constraint forces */
static void add_theta_to_stages(work_t *w, real dt, const real x[U])
{
    for (int group = 0; group < 2; ++group)
        for (int a = 0; a < N; ++a) {
            real by_u = 0, by_v = 0;
            for (int j = 0; j < S; ++j) {
                const real rate = tableau.b[j]*x[group*S*N + j*N + a];
                by_u += energy_u[j]*rate;
                by_v += energy_v[j]*rate;
            }
            for (int i = 0; i < S; ++i)
                (group == 0 ? w->stage_q[i] : w->stage_p[i])[a] +=
                    dt*w->theta[0]*(energy_u[i]*by_v - energy_v[i]*by_u);
        }
    IF_CONSTRAINED(add_theta_to_forces(w, dt);)
}

/*
 * Search for theta with H(q1, p1) = H_0 + work. The error of the energy at theta = 0 and near it
 * gives its gradient g; then theta = y g/|g|^2 with y from secants: the smallest theta, to first
 * order. theta changes a step by O(dt^(2s-1)) theta; |theta| <= bound = O(dt^2) keeps the order 2s.
 * Where H(q1, p1) hardly depends on theta, no theta within the bound exists: the step then has
 * theta = 0, and a later step, whose H_0 is the same, compensates its error.
 */
typedef struct {
    real theta[2];            /* candidate */
    real gradient[2], square; /* of the error by theta, and |g|^2 */
    real y, last_y;           /* theta = y g/|g|^2 */
    real first_error, last_error;
    real bound, tolerance;    /* of |theta| and of |error| */
    int candidates;
    int stagnates;            /* 1: the last candidate, the better one of two at round-off */
    int waits;                /* 1: no theta was found */
} energy_search_t;

/* Most candidates of a step, theta = 0 included. */
enum { MOST_CANDIDATES = 12 };

/* Ends the search with theta = 0: the energy waits. */
static int give_up(energy_search_t *search)
{
    search->theta[0] = search->theta[1] = 0;
    search->waits = 1;
    return 0;
}

/*
 * Takes the error of the candidate search->theta. Returns 1 if search->theta is another candidate;
 * 0 if it is the theta of the step, or if the energy waits and search->theta is 0.
 */
static int next_theta(energy_search_t *search, real error)
{
    const int k = search->candidates++;
    if (MATH(fabs)(error) <= search->tolerance || search->stagnates) {
        search->waits = 0;
        return 0;
    }
    if (search->waits > 0) /* theta at its bound: taken if it decreases the error */
        return MATH(fabs)(error) < MATH(fabs)(search->first_error) ? 0 : give_up(search);
    if (k == 0)
        search->first_error = error;
    if (1 <= k && k <= DIRECTIONS) {
        search->gradient[k - 1] = (error - search->first_error)/search->theta[k - 1];
        search->square += search->gradient[k - 1]*search->gradient[k - 1];
        search->theta[k - 1] = 0;
    }
    if (k < DIRECTIONS) {
        search->theta[k] = search->bound/8;
        return search->bound > 0 ? 1 : give_up(search);
    }
    const int small = 1000*MATH(fabs)(error) <= MATH(fabs)(search->first_error);
    const real most = search->bound*MATH(sqrt)(search->square);
    real y;
    if (k == DIRECTIONS) {
        search->last_error = search->first_error;
        y = -search->first_error;
    } else if (MATH(fabs)(error) >= MATH(fabs)(search->last_error)/2 && small) {
        search->stagnates = 1; /* at round-off, after a decrease by a factor of a thousand */
        if (MATH(fabs)(error) <= MATH(fabs)(search->last_error))
            return 0;
        y = search->last_y;
    } else {
        y = search->y - error*(search->y - search->last_y)/(error - search->last_error);
        search->last_y = search->y;
        search->last_error = error;
    }
    if (k + 1 == MOST_CANDIDATES || !isfinite(y))
        return small ? 0 : give_up(search);
    if (MATH(fabs)(y) > most) {
        y = search->first_error < 0 ? most : -most;
        search->waits = 1;
    }
    search->y = y;
    for (int d = 0; d < DIRECTIONS; ++d)
        search->theta[d] = y*search->gradient[d]/search->square;
    return 1;
}

/*
 * Begins a search at theta = 0. Bounds: |theta| <= r^2 with the largest relative change r of q or p
 * in the step, and 2 epsilon of the energy, |H_0| or p.dq/(2 dt), the kinetic energy.
 */
static energy_search_t begin_energy_search(real H_0, real dt, const real q[N], const real p[N],
    const real q1[N], const real p1[N])
{
    energy_search_t search = { .candidates = 0 };
    real dq[N], dp[N], action = 0;
    for (int a = 0; a < N; ++a) {
        dq[a] = q1[a] - q[a];
        dp[a] = p1[a] - p[a];
        action += a < MEASURED ? MATH(fabs)(p1[a]*dq[a]) : 0;
    }
    const real of_q = state_norm(1, dq)/(state_norm(1, q) + state_norm(1, dq));
    const real of_p = state_norm(1, dp)/(state_norm(1, p) + state_norm(1, dp));
    const real r = larger(of_q > 0 ? of_q : 0, of_p > 0 ? of_p : 0);
    search.bound = r*r;
    search.tolerance = 2*epsilon*larger(MATH(fabs)(H_0), action/2/MATH(fabs)(dt));
    return search;
}

/* Sets theta of the step; returns 1 if it has changed. */
static int set_theta(work_t *w, const real theta[2])
{
    const int differs = !(w->theta[0] == theta[0] && w->theta[1] == theta[1]);
    w->theta[0] = theta[0];
    w->theta[1] = theta[1];
    return differs;
}
#endif

#endif
