"""Normal forms: one form of H, g, F and quantities for all equivalent expressions.

In: a system.
Out: an equivalent system, the same for all ways to write it, in few operations.
Open first: ``canonical_system.canonical``.

``canonical_system.canonical`` computes them before anything is derived.

1. **expand**    products and divisions by sums, within limits (``expansion``, on the dictionaries
   of ``terms``)
2. **split**     terms → blocks of the kinetic energy, potentials, rows of F, each in as few
   coordinates as possible (``coordinate_coupling``, ``additive_terms``)
3. **shorten**   terms → the cheapest form (``shortest_sum``): common factors
   (``common_factors``), products, squares and higher powers of sums (``products_of_sums``). The
   original form stays where expansion takes too long or costs clearly more
   (``canonical_expressions``)
"""
