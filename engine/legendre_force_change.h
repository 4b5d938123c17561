/* change += dF along (dq, dv) */
static void add_force_change(const constants *c, const real q[N], const real v[N],
    const real t[1], const real dq[N], const real dv[N], real change[N])
{
    real dF[N];
    force_change(c, q, v, t, dq, dv, dF);
    for (int a = 0; a < N; ++a)
        change[a] += dF[a];
}
