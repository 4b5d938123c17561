"""Derive and write: from H, g and a tableau to the C of a stepper.

The pipeline, told once; ``pipeline.generate`` runs it.

1. **specify**  command line or Python call → ``Spec`` (``spec``)
2. **system**   name → H(q, p), g(q), derivatives (``rigid_body``, ``system``); subexpressions of
   the parameters alone get names (``kernels``); a model file → the same with numbers
   (``model_file``, by the parser of ``grammar``); what has two sides, as Piecewise and |x|, is
   written with ``switches``, and where sides do not meet smoothly is found (``smoothness``); all
   spellings of one H become one (``spelling``)
3. **tableau**  scheme and s → exact coefficients from (A.8)-(A.18) (``nodes``, ``node_algebra``,
   ``families``, ``tableau``), or a file (``tableau_file``), and as numbers in proved bounds
   (``enclosures``); what they satisfy is proved (``conditions``) and the order measured
   (``observed_order``)
4. **scheme**   system and tableau → what a step must solve: unknowns, kernels (``schemes``); for
   EMS the discrete gradient is derived (``discrete_gradient``, ``discrete_functions``,
   ``discrete_switches``, ``pieces``, ``mean_conditions``)
   many bodies are taken apart into the few forms of their terms (``structure``)
5. **kernels**  expressions → C statements with shared subexpressions (``kernels``, ``c_printer``)
6. **emit**     kernels, tableau, templates → header, source, manifest (``emit``, ``emit_fast``,
   ``emit_structure``)

Nothing in this package knows a compiler; nothing in ``runtime`` knows SymPy. The manifest is the
whole contract between the two. This file imports nothing, so ``spec`` costs no SymPy.
"""
