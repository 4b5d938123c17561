/* ------------------------------------------- what a run is set up with, and learns of its past */

/*
 * The same of what runs of one trajectory call once a run, once a step or seldom, never in a sweep:
 * with GYROSPARK_OBJECT 4 it is compiled beside their sweeps.
 */
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT)
void NAME(apart_set_up)(ONE(t) *w);
void NAME(apart_noise)(ONE(t) *w);
void NAME(apart_remember)(ONE(t) *w);

#if GYROSPARK_OBJECT == 4 /* __GNUC__ */
void NAME(apart_set_up)(ONE(t) *w)
{
    ONE(set_up)(w);
}

void NAME(apart_noise)(ONE(t) *w)
{
    ONE(noise)(w);
}

void NAME(apart_remember)(ONE(t) *w)
{
    ONE(remember)(w);
}
#elif GYROSPARK_OBJECT == 2 /* __GNUC__ */
#define ONE(set_up)(...) NAME(apart_set_up)(__VA_ARGS__)
#define ONE(noise)(...) NAME(apart_noise)(__VA_ARGS__)
#define ONE(remember)(...) NAME(apart_remember)(__VA_ARGS__)
#endif
#endif
