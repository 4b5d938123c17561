/* W = G H_pp G^T, which does not depend on p */
INLINE void lanes_schur(const lane_constants *c, const lanes q[N], const lanes p[N],
    lanes W[M][M])
{
    lanes_hidden_matrix(c, q, p, W);
}
