/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of a step: squares, relative to the state. */
typedef struct {
    int sweeps, idle;   /* all; those in a row that brought nothing nearer */
    real left, before;  /* what the last sweep changed or found amiss, and the one before it */
    real least;         /* of all */
} progress_t;

static const progress_t no_sweeps = { 0, 0, (real)HUGE_VAL, (real)HUGE_VAL, (real)HUGE_VAL };

/*
 * Whether sweeps may end: when the next would change less than round-off, at the rate of the last
 * two (modes may alternate), or when two in a row near round-off have brought nothing nearer.
 */
static int is_done(progress_t *s, real change, real defect, real tolerance)
{
    const real low = 4096*epsilon, beyond = epsilon/256, seen = (real)0.0001;
    const real left = change + (defect > 4*epsilon*epsilon ? defect : 0);
    const real of_two = s->sweeps < 2 ? seen : MATH(sqrt)(left/s->before);
    const real next = left*MATH(fmax)(left/s->left, of_two);
    s->idle = left < (real)0.8*s->least ? 0 : s->idle + 1;
    s->before = s->left;
    s->left = left;
    s->least = left < s->least ? left : s->least;
    return change <= tolerance*tolerance || (++s->sweeps > 1 && next < beyond*beyond)
        || (s->idle >= 2 && left < low*low);
}
