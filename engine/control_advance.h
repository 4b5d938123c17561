/* ----------------------------------------------------------------------------------- the steps */

/* What changes are relative to: the state and the step's own length. */
static void sizes(work_t *w)
{
    real dq[N], dp[N], q_square = LIMIT(MIN), p_square = LIMIT(MIN);
    total(S, w->x, dq);
    total(S, w->x + HAT, dp);
    for (int a = 0; a < N; ++a) {
        q_square += w->q[a]*w->q[a] + dq[a]*dq[a];
        p_square += w->p[a]*w->p[a] + dp[a]*dp[a];
    }
    w->q_size = 1/q_square;
    w->p_size = 1/p_square;
}

/*
 * Sweeps until they have converged, at most options.max_sweeps, all told. They begin with what past
 * steps predict, and once more without it where the first of them shows it to be far off: that may
 * lead to another root.
 */
static int solve(work_t *w)
{
    int predicted = w->known > 0, fresh = 1;
    progress_t progress;
    for (w->sweeps = 1;; ++w->sweeps) {
        if (fresh) {
            (predicted ? predict : guess)(w);
            progress = no_sweeps;
        }
        if (fresh || (!predicted && (progress.sweeps == 1 || progress.sweeps == 3))) {
            sizes(w); /* again, for what is at rest has none before it moves */
            begin_sweeps(w);
        }
        w->change = sweep(w);
        const int close = w->change < (real)0.0004; /* 2 % */
        if (is_done(&progress, w->change, w->defect, w->options.tolerance))
            return OK;
        fresh = predicted && progress.sweeps == 1 && !close;
        predicted = predicted && !fresh;
        if (w->sweeps >= w->options.max_sweeps || (!fresh && !(w->change < 9)))
            return close ? NOT_CONVERGED : isnan(w->change) ? NOT_FINITE : DIVERGED;
    }
}

/* The state as the caller has it; where that is not new, what rounding left over stays with it. */
static void take_over(real state[N], real low[N], const real given[N])
{
    for (int a = 0; a < N; ++a)
        if (!(state[a] == given[a])) {
            state[a] = given[a];
            low[a] = 0;
        }
}

size_t NAME(work_size)(void)
{
    return sizeof(work_t);
}

void NAME(set_parameters)(work_t *w, const parameters_t *parameters)
{
    prepare(parameters, &w->constants);
}

void NAME(begin)(work_t *w, const parameters_t *parameters,
    const options_t *options, real dt, const real q[N], const real p[N])
{
    w->options = *options;
    w->h = dt;
    w->h_inverse = 1/dt;
    w->t = w->start_time = start_time(parameters);
    w->steps = w->known = w->order = w->sweeps = 0;
    w->change = 0;
    for (int a = 0; a < N; ++a) {
        w->q[a] = q[a];
        w->p[a] = p[a];
        w->q_low[a] = w->p_low[a] = 0;
    }
    prepare(parameters, &w->constants);
}

int NAME(advance)(work_t *w, real q[N], real p[N])
{
    real q_end[N], p_end[N], q_low[N], p_low[N], size = 0;
    take_over(w->q, w->q_low, q);
    take_over(w->p, w->p_low, p);
    look(w);
    const int status = solve(w);
    if (status != OK && status != NOT_CONVERGED)
        return status;
    finish(w, q_end, p_end, q_low, p_low);
    for (int a = 0; a < N; ++a)
        size += q_end[a] + p_end[a];
    if (!isfinite(size))
        return NOT_FINITE;
    record(w);
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] = q_end[a];
        p[a] = w->p[a] = p_end[a];
        w->q_low[a] = q_low[a];
        w->p_low[a] = p_low[a];
    }
    w->t = w->start_time + (real)++w->steps*w->h;
    return status;
}

int NAME(sweeps)(const work_t *w)
{
    return w->sweeps;
}

real NAME(change)(const work_t *w)
{
    return MATH(sqrt)(w->change);
}
