/* Solutions with the Jacobian of a linearised step, a band matrix of a system of element templates. */

/* b <- J^-1 b */
static inline void TYPED(solve_step)(TYPED(linearisation_t) *l, NUMBER b[U])
{
#if GS_ELEMENTS
    (void)band_substitute(l->w->J, l->w->exponents, l->w->pivots, b, l->w->forward);
#else
    TYPED(solve_with)(U, l->J, l->pivots, b);
#endif
}

/* b <- J^-T b */
static inline void TYPED(solve_step_transposed)(TYPED(linearisation_t) *l, NUMBER b[U])
{
#if GS_ELEMENTS
    band_substitute_transposed(l->w->J, l->w->exponents, l->w->pivots, b, l->w->forward);
#else
    TYPED(solve_transposed_with)(U, l->J, l->pivots, b);
#endif
}
