"""The paper, reproduced: every table and figure from compiled steppers, beside the printed one.

In: a case: problem, scheme, parameter, Δt, steps, norm.
Out: tables, figures and findings, compared with the paper's.
Open first: ``case_runner.Engine``, then ``invariants``.

One short file for each group of results; each says what it computes as data (problem, scheme,
representation, parameter, Δt, number of steps, norm) and shares the runner of cases:

``study_result``  what a result is: Table, Figure, Finding, with cells, panels and claims
``case_runner``   runs a case once and remembers it
``reference_motion``  the motion to compare with: a closed form, or a far more accurate run
``verdict``     ours beside the paper's: agrees, round-off, misprint, differs
``printed``     the paper's numbers, as printed
``invariants``  Tables 2, 3, Figs. 5-7
``accuracy``    Tables 4-7, Figs. 8, 9
``parameter``   Figs. 11-15: error against 1/γ and 1/α
``convergence`` Figs. 10, 16
``robustness``  Table 8: the largest Δt that converges
``iterations``  Tables 9-14
``beyond``      what the paper left open: the findings, each in a file of its own (``equivalence``,
                ``odd_stages``, ``zeros``, ``one_stage``) over the expansion of one step in Δt
                (``one_step``, ``body_frame``, ``power_series``, ``sampled_energy``,
                ``energy_law``, ``odd_proof``)
``newton_study`` and ``inexact_jacobian``  the iterations of Tables 8-14, not of the product
``line_fit``, ``labels``, ``drawing``  lines and slopes, words, SVG
``summary``      counts of verdicts, claims that hold or do not
``composition_search``  the search for compositions of exact flows; a program
``study_registry``  the name of every result → how to compute it
``report``        Markdown, JSON and CSV
"""
