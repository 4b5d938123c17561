/* --------------------------------------------------------------------------- sums and rounding */

/* sum_j x_j over rows of N */
static void total(int rows, const real *x, real sum[N])
{
    for (int a = 0; a < N; ++a) {
        sum[a] = x[a];
        for (int j = 1; j < rows; ++j)
            sum[a] += x[j*N + a];
    }
}

/* old + change = end + low exactly, for a rounded end: what rounding leaves over is not lost. */
static void move_on(const real old[N], const real change[N], real end[N], real low[N])
{
    for (int a = 0; a < N; ++a) {
        const real sum = old[a] + change[a], share = sum - old[a];
        low[a] = (old[a] - (sum - share)) + (change[a] - share);
        end[a] = sum;
    }
}
