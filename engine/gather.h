/* The numbers of x that an instance reads, in its own order. */
static inline void ON(gather)(int count, const int *from, const NUMBER *x, NUMBER *y)
{
    for (int a = 0; a < count; ++a)
        y[a] = x[from[a]];
}
