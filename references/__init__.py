"""Reference problems of the field: exact digits, and the errors of our schemes.

In: the name of a problem.
Out: its model, certified digits, and errors and costs of our runs.
Open first: ``problem.Reference``.

>>> import gyrospark as gs
>>> gs.references.names()[:2]
('car-axis', 'andrews')
>>> problem = gs.references.reference("andrews")
>>> problem.truth.values["gamma'"]
'11.0329119106185937453273'
>>> format(problem.deviations["gamma'"], ".0e")         # of the published digits
'3e-08'
>>> for run in gs.references.measure(problem):              # doctest: +SKIP
...     print(run.scheme, run.steps, run.error, run.cpu_seconds)

Modules::

    problem           a problem: model, digits, invariants, published digits
    true_digits       the digits, from digits.json, which benchmarks/make_digits.py writes
    mechanisms        car axis, Andrews' squeezing mechanism
    governor          the flyball governor with stiff dampers
    linkages          four-bars in a row, Bricard's, Bennett's, a spatial slider-crank
    pendulums         the pendulum in a plane and on a sphere
    surfaces          Neumann's oscillator, the geodesic of an ellipsoid, a bead on a wire that
                      turns, a mass that grows
    rigid_bodies      free bodies, and tops that are integrable
    problem_registry  all of them by name
    work_precision    error against cost
    picture           the same, drawn
    results_page      the page of the documents
"""

from .problem import Published, Reference
from .problem_registry import names, reference
from .results_page import page
from .true_digits import Truth
from .work_precision import WorkPrecisionRun, measure

__all__ = ["Published", "Reference", "Truth", "WorkPrecisionRun", "measure", "names", "page",
           "reference"]


def __dir__() -> list[str]:
    return __all__
