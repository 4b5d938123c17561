typedef struct {
    lane_constants constants;
    lanes h, h_inverse;
    lanes q[N], p[N];         /* the state, rounded, */
    lanes q_low[N], p_low[N]; /* and what rounding left over */
    lanes q_size, p_size;     /* 1/(|q|^2 + |dq|^2), and of p: what changes are relative to */
    lanes moved;              /* |dq|^2 and |dp|^2 relative to these */
    lanes t;                  /* at the start of the step */
    TIMED(lanes span;)
    lanes work, work_low;     /* done by the forces since the start */
    lanes change, noise;      /* of the last sweep; what rounding is worth in one */
    TURNED(int still[LANES];)
    RUN(iterate) now;
    RUN(bound) bound;
    predictor_t predictor;
    lanes through[RUN(X)]; /* what went before, once more */
    lanes past[HISTORY*RUN(X)];
} RUN(t);

/* The means of the ends (51). */
INLINE void RUN(means)(const RUN(t) *w, const lanes *x, lanes *q_mean, lanes *p_mean)
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[RUN(HAT) + a];
    }
}

/* dq = h D_p between the state and the end that x says. */
INLINE void RUN(move)(const RUN(t) *w, lanes *x)
{
    lanes q_mean[N], p_mean[N], rate[N];
    RUN(means)(w, x, q_mean, p_mean);
    lanes_mean_velocity(&w->constants, q_mean, p_mean, x, x + RUN(HAT), rate);
    for (int a = 0; a < N; ++a)
        x[a] = w->h*rate[a];
}

/* The momentum's increment a; the squares of what a sweep has changed are added up. */
INLINE void RUN(take)(const RUN(t) *w, int a, lanes force, lanes *x, lanes *q_change,
    lanes *p_change)
{
    x[RUN(HAT) + a] = force;
    const lanes dq = x[a] - w->now.x[a], dp = force - w->now.x[RUN(HAT) + a];
    *q_change += dq*dq;
    *p_change += dp*dp;
}

/* D_q - F there, with F at the means and the middle of the step. */
INLINE void RUN(kick)(const RUN(t) *w, const lanes *x, lanes *rate)
{
    lanes q_mean[N], p_mean[N];
    const lanes t = w->t + (real)0.5*w->h;
    RUN(means)(w, x, q_mean, p_mean);
    lanes_mean_force(&w->constants, q_mean, p_mean, x, x + RUN(HAT), &t, rate);
}
