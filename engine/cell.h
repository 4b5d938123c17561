/* W += G X G^T of one cell of n momenta: `rows` rows of G, places of the products in `slot` */
static inline void ON(add_cell)(int n, int rows, const NUMBER *G, const NUMBER *X,
    const int *slot, NUMBER *W)
{
    for (int r = 0; r < rows; ++r) {
        NUMBER v[LARGEST_CELL];
        for (int a = 0; a < n; ++a) {
            v[a] = X[a*n]*G[r*n];
            for (int b = 1; b < n; ++b)
                v[a] += X[a*n + b]*G[r*n + b];
        }
        for (int s = 0; s <= r; ++s) {
            NUMBER sum = G[s*n]*v[0];
            for (int a = 1; a < n; ++a)
                sum += G[s*n + a]*v[a];
            W[*slot++] += sum;
        }
    }
}
