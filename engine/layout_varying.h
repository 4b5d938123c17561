/* What a sweep improves, and what the end of the step needs of it: W differs from node to node. */
typedef struct {
    lanes x[RUN(X)];
    lanes Y[RUN(P)*N];
    lanes C[RUN(S)*N], D[RUN(P)*N]; /* not needed once converged, but C for the work of forces */
    schur_t factor[RUN(P)];
} RUN(iterate);

enum { RUN(RESULT) = RUN(X) + RUN(P)*N + RUN(S)*N };

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes shortness[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
    lanes last[M]; /* the last impulse, h b~_P Lambda_P */
} RUN(bound);
