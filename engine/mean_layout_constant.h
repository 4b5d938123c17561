/* What a sweep improves: W is constant. */
typedef struct {
    lanes x[RUN(X)];
} RUN(iterate);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes shortness[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
    lanes W_inverse[M][M]; /* by h */
    lanes correction;      /* c, with H_pp G^T = c G^T */
} RUN(bound);
