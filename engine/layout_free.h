/* What a sweep improves, and what the end of the step needs of it. */
typedef struct {
    lanes x[RUN(X)];
} RUN(iterate);

enum { RUN(RESULT) = RUN(X) };

/* There are no constraints. */
typedef struct {
    lanes defect; /* none */
} RUN(bound);
