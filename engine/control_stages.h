/* ------------------------------------------------------------------ a sweep over all the stages */

/*
 * The scaled unknowns x are L = h b k and L^ = h b^ k^ of the stages, then the impulses h b~ Lambda
 * of the constraint nodes 1..P-1 and last P, where g is asked for, or 0, where a multiplier acts.
 */
enum { HAT = S*N, IMPULSE = 2*S*N, X = 2*S*N + P*M };

/* y_i = base_i + sum_j table_ij x_j: rows of `width` numbers, those of the base `stride` apart. */
static void combine(int rows, int columns, int width, const real *base, int stride,
    const real *table, const real *x, real *y)
{
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < width; ++a) {
            real sum = base == NULL ? 0 : base[i*stride + a];
            for (int j = 0; j < columns; ++j)
                sum += table[i*columns + j]*x[j*width + a];
            y[i*width + a] = sum;
        }
}

/* Starting values without a past: the rates at the start of the step, no impulse. */
static void first_values(state_t *w)
{
    real H_q[N], H_p[N], shared[SHARED];
    first_rates(&w->constants, w->q, w->p, H_p, shared);
    second_rates(&w->constants, w->q, w->p, &w->t, shared, H_q);
    for (int e = 0; e < S*N; ++e) {
        w->x[e] = w->h*weights[e/N]*H_p[e % N];
        w->x[HAT + e] = -(w->h*weights_hat[e/N])*H_q[e % N];
    }
    for (int e = IMPULSE; e < X; ++e)
        w->x[e] = 0;
}
