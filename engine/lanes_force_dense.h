/* G^T lambda */
INLINE void lanes_constraint_force(const lane_constants *c, const lanes q[N], const lanes lambda[M],
    lanes force[N])
{
    lanes G[M][N];
    lanes_constraint_jacobian(c, q, G);
    for (int a = 0; a < N; ++a) {
        lanes sum = G[0][a]*lambda[0];
        for (int mu = 1; mu < M; ++mu)
            sum += G[mu][a]*lambda[mu];
        force[a] = sum;
    }
}
