/* -------------------------------------------------------- what the past of a motion says of it */

/*
 * The stages of a step are values of one motion at different times. Those of the next step are a
 * linear function of all stages of the last one and of a few of each step before it, the same
 * function for all coordinates. It is fitted to the steps in memory by least squares; the ridge is
 * their round-off, which keeps the coefficients small. One lesson serves one trajectory.
 */
enum { PICKS = S > 1 ? 2 : 1, LAGS = 12, KNOWN = S + PICKS*LAGS };
enum { WIDEST = S + 2*LAGS, LESSON_ROWS = 16 }; /* no less than ORDER */

typedef struct {
    int known, rights; /* unknown coefficients; right sides */
    int count;         /* equations that wait in A */
    real R[WIDEST][WIDEST + S]; /* triangular, right sides last */
    real A[LESSON_ROWS][WIDEST + S];
} lesson_t;

/* Regressor k is a stage of some steps ago. */
INLINE int known_lag(int k)
{
    return k < S ? 1 : 2 + (k - S)/PICKS;
}

INLINE int known_stage(int k)
{
    return k < S ? k : (k - S) % PICKS*(S/2);
}

/* How many steps before the last there are equations for, after `steps` steps; -1: for none. */
static int lags_after(long steps)
{
    int lags = LAGS;
    while (lags >= 0 && (steps - 1 - lags)*N < S + PICKS*lags)
        --lags;
    return lags;
}

/* Of `available` equations, how many places from one that is taken to the next. */
static int stride_of(int available, int known)
{
    return available > 3*known ? (available - 1)/(3*known) + 1 : 1;
}

static void begin_lesson(lesson_t *l, int known, int rights, real ridge)
{
    l->known = known;
    l->rights = rights;
    l->count = 0;
    for (int k = 0; k < known; ++k) {
        for (int j = 0; j < known + rights; ++j)
            l->R[k][j] = 0;
        l->R[k][k] = ridge;
    }
}

/* Reflections put the equations in A into R, column by column. */
static void take_in(lesson_t *l)
{
    const int width = l->known + l->rights;
    for (int k = 0; k < l->known; ++k) {
        const real diagonal = l->R[k][k];
        real square = diagonal*diagonal, share[WIDEST + S];
        for (int i = 0; i < l->count; ++i)
            square += l->A[i][k]*l->A[i][k];
        const real length = MATH(sqrt)(square);
        const real first = diagonal < 0 ? diagonal - length : diagonal + length;
        const real factor = 1/(length*(first < 0 ? -first : first)); /* 2/|v|^2 */
        for (int j = k; j < width; ++j)
            share[j] = first*l->R[k][j];
        for (int i = 0; i < l->count; ++i) {
            const real value = l->A[i][k];
            for (int j = k; j < width; ++j)
                share[j] += value*l->A[i][j];
        }
        for (int j = k; j < width; ++j) {
            share[j] *= factor;
            l->R[k][j] -= first*share[j];
        }
        for (int i = 0; i < l->count; ++i) {
            const real value = l->A[i][k];
            for (int j = k; j < width; ++j)
                l->A[i][j] -= value*share[j];
        }
    }
    l->count = 0;
}

/* The next equation, to be filled in. */
static real *next_row(lesson_t *l)
{
    if (l->count == LESSON_ROWS)
        take_in(l);
    return l->A[l->count++];
}

/* Coefficients in place of the right sides. */
static void end_lesson(lesson_t *l)
{
    take_in(l);
    for (int k = l->known - 1; k >= 0; --k)
        for (int i = l->known; i < l->known + l->rights; ++i) {
            real sum = l->R[k][i];
            for (int j = k + 1; j < l->known; ++j)
                sum -= l->R[k][j]*l->R[j][i];
            l->R[k][i] = sum/l->R[k][k];
        }
}
