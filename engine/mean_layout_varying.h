/* What a sweep improves, and the factors of W at the end of the step. */
typedef struct {
    lanes x[RUN(X)];
    schur_t factor;
} RUN(iterate);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes shortness[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
} RUN(bound);
