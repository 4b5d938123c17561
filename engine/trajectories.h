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
 * y_i = base_i + sum_j table_ij x_j, `width` numbers each row. Two rows by four numbers at a time:
 * then multiply-adds, not loads, are the limit.
 */
INLINE void RUN(four)(int rows, int columns, int width, int count, const lanes *restrict base,
    int stride, const real *restrict table, const lanes *restrict x, lanes *restrict y)
{
    for (int i = 0; i < rows; i += 2) {
        const int next = i + 1 < rows ? i + 1 : i;
        const real *first = table + i*columns, *second = table + next*columns;
        LOAD_AGAIN(x);
        lanes upper[4], lower[4];
        for (int a = 0; a < count; ++a) {
            upper[a] = base[i*stride + a];
            lower[a] = base[next*stride + a];
        }
        for (int j = 0; j < columns; ++j)
            for (int a = 0; a < count; ++a) {
                upper[a] += splat(first[j])*x[j*width + a];
                lower[a] += splat(second[j])*x[j*width + a];
            }
        for (int a = 0; a < count; ++a) {
            y[i*width + a] = upper[a];
            y[next*width + a] = lower[a];
        }
    }
}

INLINE void RUN(product)(int rows, int columns, int width, const lanes *base, int stride,
    const real *table, const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= width; start += 4)
        RUN(four)(rows, columns, width, 4, base + start, stride, table, x + start, y + start);
    if (width % 4 > 0)
        RUN(four)(rows, columns, width, width % 4, base + start, stride, table, x + start,
            y + start);
}

NOINLINE void RUN(stages_of_stages)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(S), S, N, base, stride, table, x, y);
}

/* sum over the `count` rows of x */
INLINE void RUN(total)(int count, int width, const lanes *x, lanes *total)
{
    for (int a = 0; a < width; ++a) {
        total[a] = x[a];
        for (int j = 1; j < count; ++j)
            total[a] += x[j*width + a];
    }
}

/* The weights of all lanes. */
static void RUN(set_weights)(RUN(t) *w)
{
    for (int i = 0; i < S; ++i) {
        w->hb[i] = w->h*tableau.b[i];
        w->hb_hat[i] = w->h*tableau.b_hat[i];
        w->late[i] = w->h*tableau.c[i];
    }
}
