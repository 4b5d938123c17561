/* g does not turn, and multipliers are the same. */
static void turn_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    (void)frame, (void)dt, (void)k, (void)multipliers;
}
