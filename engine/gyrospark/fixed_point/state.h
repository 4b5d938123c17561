/* Scaled unknowns and state of the fixed-point iteration, and products with the tableau. */

/*
 * A trajectory alone has its stages in lanes: an item is a group of LANES stages, or of LANES
 * constraint nodes. Otherwise a trajectory has one lane, and an item is one stage or one node of all
 * trajectories; IMS and EMS have one item. Nodes are stored in the order 1..P-1 and last P (for g)
 * or 0 (for the multipliers). Layout of the scaled unknowns: L = h b k item by item, L^ = h b^ k^
 * item by item, impulses h b~ Lambda. Those of IMS and EMS are dq, dp and h lambda.
 */
#if GS_STAGES_IN_LANES
enum { SOLVER(PER) = LANES };
#else
enum { SOLVER(PER) = 1 };
#endif
enum { SOLVER(S) = (S + SOLVER(PER) - 1)/SOLVER(PER), SOLVER(P) = (P + SOLVER(PER) - 1)/SOLVER(PER) };
enum { SOLVER(HAT) = SOLVER(S)*N, SOLVER(IMPULSE) = 2*SOLVER(S)*N,
    SOLVER(X) = 2*SOLVER(S)*N + SOLVER(P)*M };
static const int SOLVER(group_ends)[GROUPS] = { SOLVER(HAT), SOLVER(IMPULSE), SOLVER(X) };
#if GS_STAGES_IN_LANES || !GS_SPARK
static const int SOLVER(group_rows)[GROUPS] = { MEASURED, MEASURED, M };
#elif GS_CLOCK /* rows end before the time */
static const int SOLVER(group_rows)[GROUPS] = { MEASURED, MEASURED, (P > 1 ? 2 : 1)*M };
#else
static const int SOLVER(group_rows)[GROUPS] = { (S > 1 ? 2 : 1)*N, (S > 1 ? 2 : 1)*N,
    (P > 1 ? 2 : 1)*M };
#endif

/* Unknowns of the iteration, and quantities for the end of the step. */
typedef struct {
    lanes x[SOLVER(X)];
#if GS_CONSTRAINED
#if GS_SPARK
    lanes Y[SOLVER(P)*N];
    lanes C[SOLVER(S)*N], D[SOLVER(P)*N]; /* after convergence: C for the work of forces */
#endif
#if !GS_CONSTANT_SCHUR
    schur_t factor[SOLVER(P)]; /* of W at the nodes, or at the end of the step */
#endif
#endif
} SOLVER(unknowns);

#if GS_SPARK && GS_CONSTRAINED
enum { SOLVER(RESULT) = SOLVER(X) + SOLVER(P)*N + SOLVER(S)*N };
#else
enum { SOLVER(RESULT) = SOLVER(X) };
#endif

/* State of the constraints. */
typedef struct {
    lanes defect; /* squared constraint defect of the last iteration, relative to the state, or 0 */
#if GS_CONSTRAINED
    lanes row_weight[M]; /* 1/|G_mu|^2, rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at q + q_low, and at the rounded q */
#if GS_SPARK
    lanes last_impulse[M]; /* h b~_P Lambda_P */
#endif
#if GS_CONSTANT_SCHUR
    lanes W_inverse[M][M]; /* (h W)^-1 */
    lanes correction;      /* c in H_pp G^T = c G^T */
#endif
#endif
} SOLVER(constraint_state);

#if GS_SPARK
/* Least-squares predictor: coefficients, candidate and selection of each trajectory. */
enum { SOLVER(TRAJECTORIES) = LANES/SOLVER(PER) };

typedef struct {
    lanes coefficients[REGRESSORS*2*SOLVER(S)]; /* of L and L^; regressors L and L^ alternate */
    lanes multiplier_coefficients[ORDER]; /* recurrence of the multipliers */
    lanes candidate[SOLVER(X)];           /* least-squares prediction of this step */
    lanes baseline[SOLVER(IMPULSE)];      /* polynomial or recurrence prediction of this step */
    real error[SOLVER(TRAJECTORIES)];     /* squared error of the candidate at its comparison */
    int lags, order;                      /* of the coefficients */
    int selected[SOLVER(TRAJECTORIES)];   /* 1: the trajectory uses least squares */
    int permanent[SOLVER(TRAJECTORIES)];  /* 1: the selection is final */
    int pending[SOLVER(TRAJECTORIES)];    /* 1: the next step compares candidate and baseline */
    long last_fit[SOLVER(TRAJECTORIES)];  /* step of the last fit */
} SOLVER(least_squares);
#endif

typedef struct {
    lanes_constants constants;
    lanes h, h_inverse;
    lanes q[N], p[N];         /* the state, rounded */
    lanes q_low[N], p_low[N]; /* compensation of the sums: round-off of q and p */
    lanes q_weight, p_weight; /* 1/(|q|^2 + |dq|^2), and the same for p: scales of changes */
    lanes step_squared;       /* |dq|^2 q_weight + |dp|^2 p_weight */
    lanes t;                  /* time at the start of the step */
    IF_TIME(lanes step;)
    lanes work, work_low;     /* work of the forces since the start, and its round-off */
    lanes change, round_off;  /* of an iteration: squared change, estimated round-off */
    IF_FRAME(int stationary[LANES];)
#if GS_SPARK
    lanes zero[N];
    IF_TIME(lanes constraint_time[SOLVER(P)], force_time[SOLVER(P)];)
    lanes h_b[SOLVER(S)], h_b_hat[SOLVER(S)];
    lanes stage_time[SOLVER(S)]; /* h c, relative to the start of the step */
#if GS_STAGES_IN_LANES
    lanes mu[S*SOLVER(S)], mu_hat[S*SOLVER(S)], onward[S*SOLVER(S)];
    lanes nu[S*SOLVER(P)], nu_tilde[P*SOLVER(S)], inverse[P*SOLVER(P)], onward_nodes[P*SOLVER(P)];
    lanes node_free[SOLVER(P)]; /* 0 at node 0, which is at q; else 1 */
#endif
    SOLVER(least_squares) least_squares;
#endif
    SOLVER(unknowns) now;
    SOLVER(constraint_state) constraint_state;
    predictor_t predictor;
    lanes extrapolated[SOLVER(X)]; /* collocation polynomial of the last step, or its increments */
    lanes history[HISTORY*SOLVER(X)];
} SOLVER(t);

#if GS_SPARK
#if GS_STAGES_IN_LANES
/*
 * y_i = base_i + sum_j table_ij x_j over items of LANES rows; a row has `width` entries. Four
 * entries at a time: their sums fit into the registers, and suffice to hide latency.
 */
INLINE void SOLVER(product_of_columns)(int rows, int columns, int width, int count,
    const lanes *restrict base, int stride, const lanes *restrict table, const lanes *restrict x,
    lanes *restrict y)
{
    /*
     * Few entries have several partial sums each, because dependent additions have latency. The
     * large base is added last, so that only one addition rounds at its magnitude.
     */
    const int sums = count == 1 ? 4 : count == 2 ? 2 : 1;
    lanes sum[4][4][SOLVER(S) > SOLVER(P) ? SOLVER(S) : SOLVER(P)];
    LOAD_AGAIN(x);
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < rows; ++i)
            for (int k = 0; k < sums; ++k)
                sum[k][a][i] = splat(0);
    for (int from = 0; from < columns; from += LANES, x += width)
        for (int j = 0; j < LANES && from + j < columns; ++j, table += rows)
            for (int a = 0; a < count; ++a) {
                const lanes value = splat(lane_get(&x[a], j));
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

/* sum over the `count` rows of x */
INLINE void SOLVER(sum_rows)(int count, int width, const lanes *x, lanes *total)
{
    for (int a = 0; a < width; ++a) {
        real sum = lane_get(&x[a], 0);
        for (int j = 1; j < count; ++j)
            sum += lane_get(&x[j/LANES*width + a], j % LANES);
        total[a] = splat(sum);
    }
}

/* Copies a table to lanes, row i to lane i % LANES; lanes beyond the rows are 0. */
static void SOLVER(fill)(lanes *to, int rows, int columns, const real *from)
{
    const int items = (rows + LANES - 1)/LANES;
    for (int j = 0; j < columns; ++j)
        for (int i = 0; i < items*LANES; ++i)
            lane_set(&to[j*items + i/LANES], i % LANES, i < rows ? from[i*columns + j] : 0);
}

/* Computes the weights h b, h b^, h c and copies the tables into lanes. */
static void SOLVER(set_weights)(SOLVER(t) *w)
{
    SOLVER(fill)(w->mu, S, S, &table_mu[0][0]);
    SOLVER(fill)(w->mu_hat, S, S, &table_mu_hat[0][0]);
    SOLVER(fill)(w->onward, S, S, &table_onward[0][0]);
    for (int i = 0; i < SOLVER(S)*LANES; ++i) {
        lane_set(&w->h_b[i/LANES], i % LANES, i < S ? lane_get(&w->h, 0)*tableau.b[i] : 0);
        lane_set(&w->h_b_hat[i/LANES], i % LANES, i < S ? lane_get(&w->h, 0)*tableau.b_hat[i] : 0);
        lane_set(&w->stage_time[i/LANES], i % LANES, i < S ? lane_get(&w->h, 0)*tableau.c[i] : 0);
    }
}
#else
/*
 * y_i = base_i + sum_j table_ij x_j; a row has `width` entries. Two rows by four entries at a time,
 * so that multiply-adds and not loads are the bottleneck.
 */
INLINE void SOLVER(product_of_columns)(int rows, int columns, int width, int count,
    const lanes *restrict base, int stride, const real *restrict table, const lanes *restrict x,
    lanes *restrict y)
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

/* sum over the `count` rows of x */
INLINE void SOLVER(sum_rows)(int count, int width, const lanes *x, lanes *total)
{
    for (int a = 0; a < width; ++a) {
        total[a] = x[a];
        for (int j = 1; j < count; ++j)
            total[a] += x[j*width + a];
    }
}

/* Computes the weights h b, h b^ and h c. */
static void SOLVER(set_weights)(SOLVER(t) *w)
{
    for (int i = 0; i < S; ++i) {
        w->h_b[i] = w->h*tableau.b[i];
        w->h_b_hat[i] = w->h*tableau.b_hat[i];
        w->stage_time[i] = w->h*tableau.c[i];
    }
}
#endif

/* y = base + T x, up to four entries of a row at a time */
INLINE void SOLVER(product)(int rows, int columns, int width, const lanes *base, int stride,
    const COEFFICIENT *table, const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= width; start += 4)
        SOLVER(product_of_columns)(rows, columns, width, 4, base + start, stride, table, x + start,
            y + start);
    if (width % 4 > 0)
        SOLVER(product_of_columns)(rows, columns, width, width % 4, base + start, stride, table,
            x + start, y + start);
}

TABLE_PRODUCT void SOLVER(stages_of_stages)(const lanes *base, int stride, const COEFFICIENT *table,
    const lanes *x, lanes *y)
{
    SOLVER(product)(SOLVER(S), S, N, base, stride, table, x, y);
}

#if GS_EVEN_ODD && !GS_STAGES_IN_LANES
/*
 * y = base + T x for a table that is symmetric in time, T_ij + T_i'j' = 1, where i' and j' count
 * from the other end. Even-odd splitting: y = (sum of x)/2 + terms in x_j - x_j' + terms in
 * x_j + x_j', which halves the number of coefficients. A row of the table has the coefficients of
 * the differences, of the sums, and of the middle column. An additional column or row
 * (more_columns, more_rows) is all ones.
 */
INLINE void SOLVER(even_odd_columns)(int rows, int columns, int more_columns, int more_rows,
    int count, const lanes *restrict base, int stride, const real *restrict table,
    const lanes *restrict x, lanes *restrict y)
{
    enum { PAIRS = S/2 > 0 ? S/2 : 1 };
    const int pairs = columns/2, last_column = columns*N, last_row = (rows - 1)*N;
    lanes odd[PAIRS][2], even[PAIRS][2], centre[2], sum[2], half[2];
    for (int a = 0; a < count; ++a) {
        centre[a] = columns % 2 > 0 ? x[pairs*N + a] : splat(0);
        sum[a] = centre[a];
        for (int j = 0; j < pairs; ++j) {
            odd[j][a] = x[j*N + a] - x[(columns - 1 - j)*N + a];
            even[j][a] = x[j*N + a] + x[(columns - 1 - j)*N + a];
            sum[a] += even[j][a];
        }
        half[a] = more_columns > 0 ? (real)0.5*sum[a] + x[last_column + a] : (real)0.5*sum[a];
    }
    for (int i = 0; i < rows/2; ++i, table += columns) {
        lanes by_odd[2], by_even[2];
        for (int a = 0; a < count; ++a) {
            by_odd[a] = half[a];
            by_even[a] = splat(0);
        }
        for (int j = 0; j < pairs; ++j)
            for (int a = 0; a < count; ++a) {
                by_odd[a] += splat(table[j])*odd[j][a];
                by_even[a] += splat(table[pairs + j])*even[j][a];
            }
        for (int a = 0; a < count; ++a) {
            if (columns % 2 > 0)
                by_even[a] += splat(table[2*pairs])*centre[a];
            y[i*N + a] = base[i*stride + a] + (by_odd[a] + by_even[a]);
            y[last_row - i*N + a] = base[(rows - 1 - i)*stride + a] + (by_odd[a] - by_even[a]);
        }
    }
    for (int a = 0; a < count; ++a) {
        lanes by_odd = half[a];
        for (int j = 0; j < pairs && rows % 2 > 0; ++j)
            by_odd += splat(table[j])*odd[j][a];
        if (rows % 2 > 0)
            y[rows/2*N + a] = base[rows/2*stride + a] + by_odd;
        if (more_rows > 0)
            y[rows*N + a] = base[rows*stride + a] + sum[a];
    }
}

/* Two entries at a time: the sums and differences of more would not fit into the registers. */
INLINE void SOLVER(even_odd_product)(int rows, int columns, int more_columns, int more_rows,
    const lanes *base, int stride, const real *table, const lanes *x, lanes *y)
{
    for (int a = 0; a < N; a += 2) {
        const real *reloaded = table;
        LOAD_AGAIN(reloaded);
        if (a + 2 <= N)
            SOLVER(even_odd_columns)(rows, columns, more_columns, more_rows, 2, base + a, stride,
                reloaded, x + a, y + a);
        else
            SOLVER(even_odd_columns)(rows, columns, more_columns, more_rows, 1, base + a, stride,
                reloaded, x + a, y + a);
    }
}

NOINLINE void SOLVER(even_odd_stages)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    SOLVER(even_odd_product)(S, S, 0, 0, base, stride, table, x, y);
}

/* Q_i = q + sum_j mu_ij L_j */
INLINE void SOLVER(stage_positions)(const SOLVER(t) *w, const lanes *L, lanes *Q)
{
    SOLVER(even_odd_stages)(w->q, 0, &even_odd_mu[0][0], L, Q);
}

/* base_i + sum_j mu^_ij L^_j */
INLINE void SOLVER(add_momentum_rates)(const SOLVER(t) *w, const lanes *base, int stride,
    const lanes *L_hat, lanes *momentum)
{
    (void)w;
    SOLVER(even_odd_stages)(base, stride, &even_odd_mu_hat[0][0], L_hat, momentum);
}
#else
/* Q_i = q + sum_j mu_ij L_j */
INLINE void SOLVER(stage_positions)(const SOLVER(t) *w, const lanes *L, lanes *Q)
{
    SOLVER(stages_of_stages)(w->q, 0, TABLE(mu), L, Q);
}

/* base_i + sum_j mu^_ij L^_j */
INLINE void SOLVER(add_momentum_rates)(const SOLVER(t) *w, const lanes *base, int stride,
    const lanes *L_hat, lanes *momentum)
{
    (void)w;
    SOLVER(stages_of_stages)(base, stride, TABLE(mu_hat), L_hat, momentum);
}
#endif

#if GS_CONSTRAINED
TABLE_PRODUCT void SOLVER(nodes_of_nodes)(const lanes *base, int stride, const COEFFICIENT *table,
    const lanes *x, lanes *y)
{
    SOLVER(product)(SOLVER(P), P, M, base, stride, table, x, y);
}

#if GS_STAGES_IN_LANES
/* Positions of the nodes of item j, where multipliers act; node 0 is at q. */
INLINE void SOLVER(node_position)(const SOLVER(t) *w, int j, lanes *position)
{
    for (int a = 0; a < N; ++a)
        position[a] = w->q[a] + w->node_free[j]*w->now.D[j*N + a];
}

/* Copies the tables of the nodes to lanes, and sets their times in units of the step. */
static void SOLVER(set_nodes)(SOLVER(t) *w)
{
    SOLVER(fill)(w->nu, P, S, &table_nu[0][0]);
    SOLVER(fill)(w->nu_tilde, S, P, &table_nu_tilde[0][0]);
    SOLVER(fill)(w->inverse, P, P, &table_inverse[0][0]);
    SOLVER(fill)(w->onward_nodes, P, P, &table_onward_nodes[0][0]);
    for (int l = 0; l < SOLVER(P)*LANES; ++l)
        lane_set(&w->node_free[l/LANES], l % LANES, l < P - 1);
    IF_TIME(for (int l = 0; l < SOLVER(P)*LANES; ++l) {)
        IF_TIME(const real stage_time = l < P ? tableau.c_tilde[l + 1] : 0;)
        IF_TIME(lane_set(&w->constraint_time[l/LANES], l % LANES, stage_time);)
        IF_TIME(lane_set(&w->force_time[l/LANES], l % LANES, l < P - 1 ? stage_time : 0);)
    IF_TIME(})
}
#else
/* Position of node j, where multipliers act; node 0 is stored last and is at q. */
INLINE void SOLVER(node_position)(const SOLVER(t) *w, int j, lanes *position)
{
    for (int a = 0; a < N; ++a)
        position[a] = j < P - 1 ? w->q[a] + w->now.D[j*N + a] : w->q[a];
}

static void SOLVER(set_nodes)(SOLVER(t) *w)
{
    (void)w;
    IF_TIME(for (int l = 0; l < P; ++l) {)
        IF_TIME(w->constraint_time[l] = splat(tableau.c_tilde[l + 1]);)
        IF_TIME(w->force_time[l] = splat(l < P - 1 ? tableau.c_tilde[l + 1] : 0);)
    IF_TIME(})
}
#endif

#if GS_EVEN_ODD && !GS_STAGES_IN_LANES
/* D_l = sum_j nu_lj L_j */
NOINLINE void SOLVER(node_displacements)(const SOLVER(t) *w, const lanes *L, lanes *D)
{
    SOLVER(even_odd_product)(P - 1, S, 0, 1, w->zero, 0, &even_odd_nu[0][0], L, D);
}

/* C_i = p + sum_j nu~_ij Y_j */
NOINLINE void SOLVER(add_constraint_forces)(const SOLVER(t) *w, const lanes *Y, lanes *C)
{
    SOLVER(even_odd_product)(S, P - 1, 1, 0, w->p, 0, &even_odd_nu_tilde[0][0], Y, C);
}
#else
TABLE_PRODUCT void SOLVER(nodes_of_stages)(const lanes *base, int stride, const COEFFICIENT *table,
    const lanes *x, lanes *y)
{
    SOLVER(product)(SOLVER(P), S, N, base, stride, table, x, y);
}

TABLE_PRODUCT void SOLVER(stages_of_nodes)(const lanes *base, int stride, const COEFFICIENT *table,
    const lanes *x, lanes *y)
{
    SOLVER(product)(SOLVER(S), P, N, base, stride, table, x, y);
}

/* D_l = sum_j nu_lj L_j */
INLINE void SOLVER(node_displacements)(const SOLVER(t) *w, const lanes *L, lanes *D)
{
    SOLVER(nodes_of_stages)(w->zero, 0, TABLE(nu), L, D);
}

/* C_i = p + sum_j nu~_ij Y_j */
INLINE void SOLVER(add_constraint_forces)(const SOLVER(t) *w, const lanes *Y, lanes *C)
{
    SOLVER(stages_of_nodes)(w->p, 0, TABLE(nu_tilde), Y, C);
}
#endif
#endif
#endif

/* H_p and H_q - F at a state (q, p), with forces at the time t and the time among the constants. */
INLINE void SOLVER(rates_at)(const SOLVER(t) *w, const lanes t[1], const lanes q[N],
    const lanes p[N], lanes H_p[N], lanes H_q[N])
{
#if GS_SPARK
    lanes shared[SHARED];
    first_rates(&w->constants, q, p, H_p, shared);
    second_rates(&w->constants, q, p, t, shared, H_p, H_q);
#else
    lanes zero[N];
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(&w->constants, q, p, zero, zero, H_p);
    lanes_mean_force(&w->constants, q, p, zero, zero, t, H_q);
#endif
}
