/* What a sweep improves. */
typedef struct {
    lanes x[RUN(X)];
} RUN(iterate);

/* There are no constraints. */
typedef struct {
    lanes defect; /* none */
} RUN(bound);
