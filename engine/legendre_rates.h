/* What H_q shares with H_p at one place: the factors of M. */
enum { SHARED = MASS, ROUNDS = 1 };

/* H_p = v, and the factors */
INLINE void first_rates(const lane_constants *c, const lanes q[N], const lanes p[N],
    lanes H_p[N], lanes shared[SHARED])
{
    lanes_factor_mass(c, q, shared);
    lanes_velocities(c, q, p, shared, H_p);
}

/* H_q - F = -R(q, v, t), and H_p, from the factors */
static void second_rates(const lane_constants *c, const lanes q[N], const lanes p[N],
    const lanes t[1], const lanes shared[SHARED], lanes H_p[N], lanes H_q[N])
{
    lanes_velocities(c, q, p, shared, H_p);
    lanes_push(c, q, H_p, t, H_q);
    for (int a = 0; a < N; ++a)
        H_q[a] = -H_q[a];
}
