typedef struct {
    lane_constants constants;
    lanes h, h_inverse;
    lanes zero[N];
    lanes q[N], p[N];         /* the state, rounded, */
    lanes q_low[N], p_low[N]; /* and what rounding left over */
    lanes q_size, p_size;     /* 1/(|q|^2 + |dq|^2), and of p: what changes are relative to */
    lanes moved;              /* |dq|^2 and |dp|^2 relative to these */
    lanes t;                  /* at the start of the step */
    TIMED(lanes span;)
    TIMED(lanes ask[RUN(P)], act[RUN(P)];)
    lanes hb[RUN(S)], hb_hat[RUN(S)];
    lanes late[RUN(S)];    /* h c: stages after the start of the step */
    lanes work, work_low;  /* done by the forces since the start */
    lanes mu[S*RUN(S)], mu_hat[S*RUN(S)], onward[S*RUN(S)];
    lanes nu[S*RUN(P)], nu_tilde[P*RUN(S)], inverse[P*RUN(P)], onward_nodes[P*RUN(P)];
    lanes moves[RUN(P)]; /* 0 at node 0, which stays where the step starts */
    lanes change, noise; /* of the last sweep; what rounding is worth in one */
    TURNED(int still[LANES];)
    RUN(iterate) now;
    RUN(bound) bound;
    RUN(lessons) lessons;
    predictor_t predictor;
    lanes through[RUN(X)]; /* the polynomial through the last stages, one step on */
    lanes past[HISTORY*RUN(X)];
} RUN(t);

/*
 * y_i = base_i + sum_j table_ij x_j over items of as many rows as lanes: `width` numbers each row,
 * `columns` of them. Four numbers at a time: as many sums as a register file holds, and enough of
 * them to hide latency.
 */
INLINE void RUN(four)(int rows, int columns, int width, int count, const lanes *restrict base,
    int stride, const lanes *restrict table, const lanes *restrict x, lanes *restrict y)
{
    /*
     * Few numbers at a time take several sums each: additions wait for one another. The base, which
     * is large, comes last: so the sum is rounded to it once.
     */
    const int sums = count == 1 ? 4 : count == 2 ? 2 : 1;
    lanes sum[4][4][RUN(S) > RUN(P) ? RUN(S) : RUN(P)];
    LOAD_AGAIN(x);
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < rows; ++i)
            for (int k = 0; k < sums; ++k)
                sum[k][a][i] = splat(0);
    for (int from = 0; from < columns; from += LANES, x += width)
        for (int j = 0; j < LANES && from + j < columns; ++j, table += rows)
            for (int a = 0; a < count; ++a) {
                const lanes value = splat(part(&x[a], j));
                for (int i = 0; i < rows; ++i)
                    sum[j % sums][a][i] += table[i]*value;
            }
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < rows; ++i) {
            lanes total = sum[0][a][i];
            if (sums > 1)
                total += sum[1][a][i];
            if (sums > 2)
                total += sum[2][a][i] + sum[3][a][i];
            y[i*width + a] = base[i*stride + a] + total;
        }
}

INLINE void RUN(product)(int rows, int columns, int width, const lanes *base, int stride,
    const lanes *table, const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= width; start += 4)
        RUN(four)(rows, columns, width, 4, base + start, stride, table, x + start, y + start);
    if (width % 4 > 0)
        RUN(four)(rows, columns, width, width % 4, base + start, stride, table, x + start,
            y + start);
}

PRODUCT void RUN(stages_of_stages)(const lanes *base, int stride, const lanes *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(S), S, N, base, stride, table, x, y);
}

/* sum over the `count` rows of x */
INLINE void RUN(total)(int count, int width, const lanes *x, lanes *total)
{
    for (int a = 0; a < width; ++a) {
        real sum = part(&x[a], 0);
        for (int j = 1; j < count; ++j)
            sum += part(&x[j/LANES*width + a], j % LANES);
        total[a] = splat(sum);
    }
}

static void RUN(fill)(lanes *to, int rows, int columns, const real *from)
{
    const int items = (rows + LANES - 1)/LANES;
    for (int j = 0; j < columns; ++j)
        for (int i = 0; i < items*LANES; ++i)
            set_part(&to[j*items + i/LANES], i % LANES, i < rows ? from[i*columns + j] : 0);
}

/* The weights and tables of all lanes. */
static void RUN(set_weights)(RUN(t) *w)
{
    RUN(fill)(w->mu, S, S, &fast_mu[0][0]);
    RUN(fill)(w->mu_hat, S, S, &fast_mu_hat[0][0]);
    RUN(fill)(w->onward, S, S, &fast_onward[0][0]);
    for (int i = 0; i < RUN(S)*LANES; ++i) {
        set_part(&w->hb[i/LANES], i % LANES, i < S ? part(&w->h, 0)*tableau.b[i] : 0);
        set_part(&w->hb_hat[i/LANES], i % LANES, i < S ? part(&w->h, 0)*tableau.b_hat[i] : 0);
        set_part(&w->late[i/LANES], i % LANES, i < S ? part(&w->h, 0)*tableau.c[i] : 0);
    }
}
