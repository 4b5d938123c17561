/* ----------------------------------------------------------------------------------- the steps */

/* What changes are relative to: the state and the step's own length. */
static void sizes(state_t *w)
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
 * Sweeps until they have converged, at most max_sweeps, all told. They begin with what past
 * steps predict, and once more without it where the first of them shows it to be far off: that may
 * lead to another root.
 */
static int sweep_until_done(state_t *w)
{
    int predicted = w->known > 0, fresh = 1;
    progress_t progress;
    for (w->sweeps = 1;; ++w->sweeps) {
        if (fresh) {
            (predicted ? predict : first_values)(w);
            progress = no_sweeps;
        }
        if (fresh || (!predicted && (progress.sweeps == 1 || progress.sweeps == 3))) {
            sizes(w); /* again, for what is at rest has none before it moves */
            begin_sweeps(w);
        }
        w->change = sweep(w);
        const int close = w->change < (real)0.0004; /* 2 % */
        if (is_done(&progress, w->change, w->defect, w->tolerance))
            return OK;
        fresh = predicted && progress.sweeps == 1 && !close;
        predicted = predicted && !fresh;
        if (w->sweeps >= w->max_sweeps || (!fresh && !(w->change < 9)))
            return close ? NOT_CONVERGED : isnan(w->change) ? NOT_FINITE : DIVERGED;
    }
}
