
/*
 * Kernels: a thread for each trajectory. Number k of trajectory i lies at k*count + i, so that
 * neighbouring threads read neighbouring memory. Between two launches a trajectory is its state, its
 * work memory and its status.
 */

/* Numbers of the parameters, and 32-bit words of the work memory, of one trajectory. */
enum {
    FIELDS = (int)(sizeof(parameters_t)/sizeof(real)),
    WORDS = (int)(sizeof(state_t)/sizeof(unsigned))
};

/* The trajectory of this thread. */
#define THREAD ((long long)blockIdx.x*blockDim.x + threadIdx.x)

GS_DEVICE static void load_work(long long count, long long i, const unsigned *words, state_t *w)
{
    for (int k = 0; k < WORDS; ++k)
        memcpy((char *)w + k*sizeof(unsigned), words + k*count + i, sizeof(unsigned));
}

GS_DEVICE static void store_work(long long count, long long i, const state_t *w, unsigned *words)
{
    for (int k = 0; k < WORDS; ++k)
        memcpy(words + k*count + i, (const char *)w + k*sizeof(unsigned), sizeof(unsigned));
}

/* Numbers that a caller has to know: words of the work memory, parameters. */
GS_KERNEL NAME(measure)(long long *sizes)
{
    if (THREAD == 0) {
        sizes[0] = WORDS;
        sizes[1] = FIELDS;
    }
}

/* Copies q and p, whose strides are of the caller, to the state: q and p of all trajectories. */
GS_KERNEL NAME(gather_states)(long long count, const real *q, long long q_row, long long q_column,
    const real *p, long long p_row, long long p_column, real *state)
{
    const long long i = THREAD;
    if (i >= count)
        return;
    for (int a = 0; a < N; ++a) {
        state[a*count + i] = q[i*q_row + a*q_column];
        state[(N + a)*count + i] = p[i*p_row + a*p_column];
    }
}

/* Begins each trajectory at its state: status[i] is not 0 where that is refused. */
GS_KERNEL NAME(begin_trajectories)(long long count, const real *fields, const real *dt,
    real tolerance, int max_iterations, const real *state, unsigned *words, int *status,
    long long *steps, long long *iterations)
{
    const long long i = THREAD;
    if (i >= count)
        return;
    state_t w;
    real values[FIELDS], q[N], p[N];
    parameters_t parameters;
    const options_t options = { tolerance, max_iterations };
    for (int k = 0; k < FIELDS; ++k)
        values[k] = fields[k*count + i];
    memcpy(&parameters, values, sizeof values);
    for (int a = 0; a < N; ++a) {
        q[a] = state[a*count + i];
        p[a] = state[(N + a)*count + i];
    }
    memset(&w, 0, sizeof w);
    status[i] = (int)NAME(begin)(&w, &parameters, &options, dt[i], q, p);
    steps[i] = iterations[i] = 0;
    store_work(count, i, &w, words);
}

/*
 * Takes each trajectory from step `first` to step `last`. A trajectory whose step fails keeps the
 * state before that step; its later rows are NaN.
 *
 * States after steps that are multiples of `every`, and the one after step `total`, are rows: row
 * ceil(n/every) of step n, here less `row`, the number of the first row in memory.
 */
GS_KERNEL NAME(advance_trajectories)(long long count, long long first, long long last,
    long long every, long long total, long long row, real *state, unsigned *words, int *status,
    long long *steps, long long *iterations, real *q_rows, real *p_rows, int *iteration_rows)
{
    const long long i = THREAD;
    if (i >= count)
        return;
    state_t w;
    int failed = status[i];
    load_work(count, i, words, &w);
    for (long long n = first; n <= last; ++n) {
        const long long place = (n + every - 1)/every - row;
        if (n > first && !failed) {
            real q[N], p[N];
            for (int a = 0; a < N; ++a) {
                q[a] = state[a*count + i];
                p[a] = state[(N + a)*count + i];
            }
            failed = (int)NAME(advance)(&w, q, p);
            if (failed)
                status[i] = failed;
            else {
                const int used = NAME(iterations)(&w);
                for (int a = 0; a < N; ++a) {
                    state[a*count + i] = q[a];
                    state[(N + a)*count + i] = p[a];
                }
                steps[i] = n;
                iterations[i] += used;
                if (iteration_rows[place*count + i] < used)
                    iteration_rows[place*count + i] = used;
            }
        }
        const bool is_new = n > first || (n == 0 && row == 0);
        if (is_new && (n % every == 0 || n == total))
            for (int a = 0; a < N; ++a) {
                q_rows[(place*N + a)*count + i] = failed ? (real)NAN : state[a*count + i];
                p_rows[(place*N + a)*count + i] = failed ? (real)NAN : state[(N + a)*count + i];
            }
    }
    store_work(count, i, &w, words);
}
