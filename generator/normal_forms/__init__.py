"""Normal forms: H, g, F and quantities in one form, however they were written.

``canonical_system.canonical`` does it, before anything is derived.

1. **expand**    expressions multiplied out, within limits, and divided by the sums in their
   denominators (``expansion``, on the dictionaries of ``terms``)
2. **split**     terms → blocks of the kinetic energy, potentials, rows of F, each in as few
   coordinates as possible (``coordinate_coupling``, ``additive_terms``)
3. **shorten**   the terms of a part → the cheapest form (``shortest_sum``), of common factors and
   products (``common_factors``, ``products_of_sums``, by ``sparse_elimination``), squares and
   higher powers of sums (``sums_of_squares``, ``powers_of_sums``). The given form is kept where
   expansion takes too long or makes it clearly dearer (``canonical_expressions``)
"""
