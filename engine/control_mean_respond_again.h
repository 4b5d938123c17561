/* What a pull changes of the velocity is found by another look at it. */
static void respond(const state_t *w, int a, real pull, real x[X])
{
    (void)w;
    x[HAT + a] -= pull;
}

static void move_again(const state_t *w, real x[X])
{
    move(w, x);
}
