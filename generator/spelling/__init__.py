"""One form for all spellings: H, g, F and quantities as if nobody had written them.

``canonical.canonical`` does it, before anything is derived.

1. **terms**     expressions multiplied out, within limits, and divided by the sums under their bars
   (``normal_form``, on the dictionaries of ``terms``): the same for all spellings
2. **pieces**    terms → cells of the kinetic energy, potentials, rows of F that depend on no more
   than they must (``coupling``, ``pieces``)
3. **shortest**  the terms of a piece → the form that costs least (``compact``), of common factors
   and products (``factors``, ``products``, by the exact elimination of ``echelon``) and of squares
   and higher powers of sums (``squares``, ``powers``); what was written is kept where multiplying
   out takes too long or has lost a form that costs clearly less (``forms``)
"""
