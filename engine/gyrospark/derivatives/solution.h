/*
 * Solutions with the Jacobian J of a linearised step, and with its transpose. J of element templates
 * is a band matrix, which is factorised where no iteration solves.
 */

#if GS_ELEMENTS
/* Factorises J, once for each linearisation; the factors are in the work memory. */
static int factorise_step(linearisation_t *l)
{
    work_t *w = l->w;
    if (l->is_factorised)
        return OK;
    w->constants = l->c;
    jacobian(w, l->h, l->q, l->p, l->x, w->J);
    l->is_factorised = 1;
    return band_factorise(U, BAND, w->J, w->pivots, w->forward, w->rows, &w->products);
}
#endif

/* b <- J^-1 b, or J^-T b */
static inline int TYPED(solve_step)(TYPED(linearisation_t) *l, int transposed, NUMBER b[U])
{
#if GS_ELEMENTS
#if GS_SPARK && GS_FIXED_POINT
    if (iterate_step(l, transposed, b))
        return OK;
#endif
    const int status = factorise_step(l);
    if (status != OK)
        return status;
    if (transposed)
        band_substitute_transposed(l->w->J, l->w->pivots, b, l->w->forward);
    else
        (void)band_solve(l->w->J, l->w->pivots, b, l->w->forward);
#else
    if (transposed)
        TYPED(solve_transposed_with)(U, l->J, l->pivots, b);
    else
        TYPED(solve_with)(U, l->J, l->pivots, b);
#endif
    return OK;
}
