/* --------------------------------------------------------------- a sweep: one mean value a step */

/* The unknowns x are the increments dq and dp of the step, and the impulses h lambda. */
enum { HAT = N, IMPULSE = 2*N, X = 2*N + M };

/* The means of the ends (51). */
static void means(const state_t *w, const real x[X], real q_mean[N], real p_mean[N])
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[HAT + a];
    }
}

/* dq = h D_p between the state and the end that x says. */
static void move(const state_t *w, real x[X])
{
    real q_mean[N], p_mean[N], rate[N];
    means(w, x, q_mean, p_mean);
    mean_velocity(&w->constants, q_mean, p_mean, x, x + HAT, rate);
    for (int a = 0; a < N; ++a)
        x[a] = w->h*rate[a];
}

/* dp = -h (D_q - F) there, with F in the middle of the step; constraint forces are left out. */
static void kick(const state_t *w, const real x[X], real dp[N])
{
    real q_mean[N], p_mean[N], rate[N];
    const real t = w->t + (real)0.5*w->h;
    means(w, x, q_mean, p_mean);
    mean_force(&w->constants, q_mean, p_mean, x, x + HAT, &t, rate);
    for (int a = 0; a < N; ++a)
        dp[a] = -w->h*rate[a];
}

/* Starting values without a past: an explicit Euler step, no impulse. */
static void first_values(state_t *w)
{
    real dp[N];
    for (int e = 0; e < X; ++e)
        w->x[e] = 0;
    kick(w, w->x, dp);
    move(w, w->x);
    for (int a = 0; a < N; ++a)
        w->x[HAT + a] = dp[a];
}
