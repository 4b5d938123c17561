/* No forces, no change of them. */
static inline void add_force_change(const constants *c, const real q[N], const real v[N],
    const real t[1], const real dq[N], const real dv[N], real change[N])
{
    (void)c, (void)q, (void)v, (void)t, (void)dq, (void)dv, (void)change;
}
