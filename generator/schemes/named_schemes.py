"""Named schemes: one record each. Their properties are derived in ``certificates``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from ...core.arguments import choose
from ...core.records import dataclass

if TYPE_CHECKING:
    from ..tableaux.tableau import Tableau

__all__ = ["DEFAULT_SCHEME", "DEFAULT_STAGES", "MAX_STAGES", "SCHEMES", "Scheme", "SchemeName",
           "scheme_named"]

#: Largest number of stages of a family: tableaux with more stages are not tested.
MAX_STAGES = 16

#: Values of ``scheme``; the keys of ``SCHEMES``, for editors and type checkers.
SchemeName = Literal["IMS", "EMS", "G-L", "LIIIA-B", "Radau-L", "splitting"]


@dataclass(frozen=True)
class Scheme:
    """A scheme: a family of SPARK tableaux, or one mean value of the gradient.

    Attributes
    ----------
    name : str
        The name in the paper.
    title : str
        Full name.
    fewest : int
        Smallest number of stages; 0 for a scheme without stages.
    most : int
        Largest number of stages; users may omit the number if both are equal.
    tableau : callable or None
        Number of stages → its exact tableau; None for a mean value.
    discrete : bool
        Whether the mean value is the discrete gradient, else the gradient at the midpoint.
    composed : bool
        Whether a step is a composition of exact flows, for which users give the order.
    velocity_constraints : bool
        Whether it has equations for velocity constraints, A(q, t) q̇ + a(q, t) = 0.
    energy : bool
        Whether A + θZ with one θ a step can conserve the energy exactly (``energy_parameter``).
    sources : dict of str to str
        Key in ``certificates/citations.py`` → the subject of the work.
    """

    name: SchemeName
    title: str
    fewest: int = 0
    tableau: Callable[[int], Tableau] | None = None
    discrete: bool = False
    composed: bool = False
    most: int = MAX_STAGES
    velocity_constraints: bool = False
    energy: bool = False
    sources: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """The name in file names: ``ims``, ``gl``, ``liiiab``."""
        return self.name.lower().replace("-", "")

    @property
    def takes_stages(self) -> bool:
        """Whether it is a family, for which users give the number of stages."""
        return 0 < self.fewest < self.most


def _gauss_lobatto(stages: int) -> Tableau:
    """Return the Gauss-Lobatto tableau of a number of stages."""
    from ..tableaux.families import gauss_lobatto  # SymPy, only when needed

    return gauss_lobatto(stages)


def _lobatto_iiiab(stages: int) -> Tableau:
    """Return the Lobatto IIIA-B tableau of a number of stages."""
    from ..tableaux.families import lobatto_iiiab

    return lobatto_iiiab(stages)


def _radau_lobatto(stages: int) -> Tableau:
    """Return the Radau-Lobatto tableau of a number of stages."""
    from ..tableaux.families import radau_lobatto

    return radau_lobatto(stages)


SCHEMES: dict[SchemeName, Scheme] = {
    scheme.name: scheme
    for scheme in (
        Scheme("IMS", "implicit midpoint scheme",
               sources={"hairer2006": "the implicit midpoint rule and what it keeps"}),
        Scheme("EMS", "energy-momentum preserving scheme", discrete=True, sources={
            "gonzalez1996": "discrete gradients, energy and momentum",
            "gonzalez1999": "the same with constraints",
            "mclachlan1999": "discrete gradients as a class of methods"}),
        Scheme("G-L", "Gauss-Lobatto SPARK method", fewest=1, tableau=_gauss_lobatto, energy=True,
               velocity_constraints=True),
        Scheme("LIIIA-B", "Lobatto IIIA-B SPARK method", fewest=2, tableau=_lobatto_iiiab,
               sources={"jay1996": "Lobatto IIIA-IIIB pairs with constraints"}),
        Scheme("Radau-L", "Radau-Lobatto SPARK method", fewest=1, tableau=_radau_lobatto,
               velocity_constraints=True,
               sources={"hairer1996": "Radau IIA methods, L-stable"}),
        Scheme("splitting", "composition of exact flows", composed=True,
               sources={"mclachlan2002": "splitting methods"}),
    )
}
#: Taken where no scheme, or no number of stages, is named: order 6, symplectic.
DEFAULT_SCHEME: SchemeName = "G-L"
DEFAULT_STAGES = 3


def scheme_named(name: Any) -> Scheme:
    """Return the scheme of a name.

    Raises InputError for an unknown name; names the allowed ones.
    """
    return SCHEMES[choose("scheme", name, SCHEMES, "; the Butcher tableau of another method is "
                          "given as tableau=gyrospark.tableau(A=..., b=..., c=...)")]
