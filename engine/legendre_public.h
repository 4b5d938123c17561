void NAME(velocities)(const parameters_t *parameters, long count, TIMED(
    const real *t,) const real *q, const real *p,
    real *v)
{
    constants c;
    real A[MASS];
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i) {
        factor_mass(AT(&c, time_of(parameters, t, i)), q + i*N, A);
        velocities(&c, q + i*N, p + i*N, A, v + i*N);
    }
}

void NAME(momenta)(const parameters_t *parameters, long count, TIMED(
    const real *t,) const real *q, const real *v,
    real *p)
{
    constants c;
    real A[MASS];
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i, q += N, v += N, p += N) {
        const int *row = mass_row, *slot = mass_slot;
        mass_matrix(AT(&c, time_of(parameters, t, i)), q, A);
        rest_momentum(&c, q, p);
        for (int k = 0; k < N; ++k) {
            const int pivot = mass_order[k];
            p[pivot] += A[pivot]*v[pivot];
            for (int j = 0; j < mass_rows[k]; ++j, ++row, ++slot) {
                p[pivot] += A[*slot]*v[*row];
                p[*row] += A[*slot]*v[pivot];
            }
        }
    }
}
