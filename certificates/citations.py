"""Citations of a stepper: ``gyrospark.cite``, the works to cite with its results.

The works are chosen by the manifest: by the scheme's record, by rigid bodies with γ or α, by the
way steps are solved.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from .._version import __version__
from ..core.arguments import shown
from ..core.calls import explain_arguments
from ..core.errors import InputError
from ..core.html import card, table
from ..core.manifest import Manifest, SchemeManifest
from ..generator.schemes.named_schemes import SCHEMES
from ..runtime.compilation.body_columns import bodies_of

__all__ = ["WORKS", "Citations", "Work", "cite"]


@dataclass(frozen=True)
class Work:
    """A work, its fields as BibTeX has them.

    Attributes
    ----------
    key, kind : str
        Of BibTeX: ``jay2007``, ``article``.
    authors : tuple of str
        Each ``Family, Given``.
    title, year : str
    where : dict
        Journal or publisher, volume, pages, DOI.
    """

    key: str
    kind: str
    authors: tuple[str, ...]
    title: str
    year: str
    where: dict[str, str] = field(default_factory=dict)

    def bibtex(self) -> str:
        """Return the entry as BibTeX, in ASCII but for names."""
        fields = {"author": " and ".join(self.authors), "title": f"{{{self.title}}}",
                  "year": self.year, **self.where}
        inner = ",\n".join(f"  {name} = {{{value}}}" for name, value in fields.items() if value)
        return f"@{self.kind}{{{self.key},\n{inner}\n}}"

    def __str__(self) -> str:
        names = [" ".join([*_initials(given_names), family]) for family, _, given_names in
                 (author.partition(", ") for author in self.authors)]
        publication = ", ".join(self.where[name] for name in (
            "journal", "volume", "pages", "publisher", "version") if name in self.where)
        doi = f" doi:{self.where['doi']}" if "doi" in self.where else ""
        fields = ", ".join(field
                           for field in (", ".join(names), self.title, publication, self.year)
                           if field)
        return f"{fields}.{doi}".replace("--", "–").replace("{", "").replace("}", "")


def _initials(given_names: str) -> list[str]:
    """Return the initials of first names: "Jean-Pierre" gives ["J.", "P."]."""
    return [f"{name[0]}." for name in given_names.replace("-", " ").split()]


def _article(key: str, authors: str, title: str, year: str, **where: str) -> Work:
    """Return a work of a journal; ``authors`` are joined by " and " as in BibTeX."""
    return Work(key, "article", tuple(authors.split(" and ")), title, year, where)


#: Every work that ``cite`` may name, by its key.
WORKS = {work.key: work for work in (
    Work("gyrospark", "software", ("{the gyrospark authors}",),
         "gyrospark: compiled steppers for rigid-body motion on its constraint, generated from "
         "symbols", "", {"version": __version__}),
    _article("xu2020", "Xu, Xiaoming and Luo, Jiahui and Wu, Zhigang",
             "The numerical influence of additional parameters of inertia representations for "
             "quaternion-based rigid body dynamics", "2020",
             journal="Multibody System Dynamics", volume="49", doi="10.1007/s11044-019-09697-x"),
    _article("betsch2009", "Betsch, Peter and Siebert, Ralf",
             "Rigid body dynamics in terms of quaternions: Hamiltonian formulation and conserving "
             "numerical integration", "2009",
             journal="International Journal for Numerical Methods in Engineering", volume="79",
             pages="444--473", doi="10.1002/nme.2586"),
    _article("mclachlan2002", "McLachlan, Robert I. and Quispel, G. Reinout W.",
             "Splitting methods", "2002", journal="Acta Numerica", volume="11", pages="341--434",
             doi="10.1017/S0962492902000053"),
    _article("jay1996", "Jay, Laurent",
             "Symplectic partitioned Runge-Kutta methods for constrained Hamiltonian systems",
             "1996", journal="SIAM Journal on Numerical Analysis", volume="33", pages="368--387",
             doi="10.1137/0733019"),
    _article("jay2007", "Jay, Laurent O.",
             "Specialized partitioned additive Runge-Kutta methods for systems of overdetermined "
             "DAEs with holonomic constraints", "2007",
             journal="SIAM Journal on Numerical Analysis", volume="45", pages="1814--1842",
             doi="10.1137/060667475"),
    Work("hairer2006", "book", ("Hairer, Ernst", "Lubich, Christian", "Wanner, Gerhard"),
         "Geometric Numerical Integration: Structure-Preserving Algorithms for Ordinary "
         "Differential Equations", "2006",
         {"publisher": "Springer", "doi": "10.1007/3-540-30666-8"}),
    Work("hairer1996", "book", ("Hairer, Ernst", "Wanner, Gerhard"),
         "Solving Ordinary Differential Equations II: Stiff and Differential-Algebraic Problems",
         "1996", {"publisher": "Springer", "doi": "10.1007/978-3-642-05221-7"}),
    _article("gonzalez1996", "Gonzalez, Oscar",
             "Time integration and discrete Hamiltonian systems", "1996",
             journal="Journal of Nonlinear Science", volume="6", pages="449--467",
             doi="10.1007/BF02440162"),
    _article("gonzalez1999", "Gonzalez, Oscar",
             "Mechanical systems subject to holonomic constraints: differential-algebraic "
             "formulations and conservative integration", "1999",
             journal="Physica D", volume="132", pages="165--174",
             doi="10.1016/S0167-2789(99)00054-8"),
    _article("modin2020", "Modin, Klas and Verdier, Olivier",
             "What makes nonholonomic integrators work?", "2020",
             journal="Numerische Mathematik", volume="145", pages="405--435",
             doi="10.1007/s00211-020-01126-y"),
    _article("mclachlan1999", "McLachlan, Robert I. and Quispel, G. R. W. and Robidoux, Nicolas",
             "Geometric integration using discrete gradients", "1999",
             journal="Philosophical Transactions of the Royal Society A", volume="357",
             pages="1021--1045", doi="10.1098/rsta.1999.0363"),
    _article("hairer2008", "Hairer, Ernst and McLachlan, Robert I. and Razakarivony, Alain",
             "Achieving Brouwer's law with implicit Runge-Kutta methods", "2008",
             journal="BIT Numerical Mathematics", volume="48", pages="231--243",
             doi="10.1007/s10543-008-0170-3"),
    _article("antonana2017", "Antoñana, Mikel and Makazaga, Joseba and Murua, Ander",
             "Reducing and monitoring round-off error propagation for symplectic implicit "
             "Runge-Kutta schemes", "2017",
             journal="Numerical Algorithms", volume="76", pages="861--880",
             doi="10.1007/s11075-017-0287-z"),
)}


@explain_arguments
@dataclass(frozen=True)
class Citations:
    """The works to cite with results of a stepper, each with the reason.

    ``print`` shows them as text; ``bibtex()`` returns the entries.

    Attributes
    ----------
    reasons : dict of str to str
        Key of each work → the part of the stepper for which it is cited.
    """

    reasons: dict[str, str]

    def __iter__(self) -> Iterator[Work]:
        return iter([WORKS[key] for key in self.reasons])

    def __len__(self) -> int:
        return len(self.reasons)

    def bibtex(self) -> str:
        """Return the entries as BibTeX, to be written to a .bib file."""
        return "\n\n".join(work.bibtex() for work in self) + "\n"

    def __str__(self) -> str:
        return "\n".join(f"{work}\n    {reason}" for work, reason in
                         zip(self, self.reasons.values(), strict=True))

    def __repr__(self) -> str:
        return f"<Citations: {', '.join(self.reasons)}; print them, or take .bibtex()>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: each work, and the reason to cite it."""
        return card("Citations", table(zip(self, self.reasons.values(), strict=True)))


def cite(stepper: Any) -> Citations:
    """Return the works to cite with results of a stepper: of its scheme, bodies and sums.

    Parameters
    ----------
    stepper : Stepper, Trajectory or Simulation
        A stepper, or a result of one.

    Raises
    ------
    InputError
        For anything else.

    Examples
    --------
    >>> import gyrospark as gs
    >>> [work.key for work in gs.cite(gs.stepper("EMS"))]
    ['gyrospark', 'xu2020', 'betsch2009', 'gonzalez1996', 'gonzalez1999', 'mclachlan1999']
    """
    # a simulation has that of its stepper
    manifest = getattr(getattr(stepper, "_stepper", stepper), "manifest", None)
    if not isinstance(manifest, Manifest):
        raise InputError(f"cite takes a stepper, or a trajectory that one made, not "
                         f"{shown(stepper)}.")
    return Citations(dict(_reasons(manifest)))


def _reasons(manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Yield the key of each work to cite and the reason: the program, bodies, scheme, its loops."""
    scheme, constrained = manifest.scheme, bool(manifest.system.constraints)
    yield "gyrospark", "the program"
    if bodies_of(manifest):  # systems with rigid bodies in unit quaternions
        yield "xu2020", "rigid bodies in unit quaternions with the free parameter γ or α"
        yield "betsch2009", "rigid bodies in unit quaternions, in Hamilton's form"
    yield from _of_scheme(scheme, constrained)
    if manifest.system.velocity_constraints:
        yield "modin2020", "near energy of reversible motions with velocity constraints"
    if scheme.kind == "spark" and manifest.fast_path.available:
        yield "hairer2008", "implicit Runge-Kutta methods in which round-off grows like √t"
        yield "antonana2017", "fixed-point sweeps down to round-off, coefficients that are " \
                              "symplectic in floating point"


def _of_scheme(scheme: SchemeManifest, constrained: bool) -> Iterator[tuple[str, str]]:
    """Yield keys and reasons of the works behind a scheme: of its record, then of its kind.

    Works on constraints are left out for a system that has none.
    """
    name = re.sub(r"^\d+-", "", scheme.method)  # "3-G-L"; "SPARK ..." is a tableau of a user
    record = next((scheme_record for scheme_record in SCHEMES.values()
                   if scheme_record.name == name), None)
    for key, reason in (record.sources if record else {}).items():
        # Gonzalez 1999 and Jay 1996 are about constraints alone
        if constrained or key not in ("gonzalez1999", "jay1996"):
            yield key, reason
    if scheme.kind == "spark":
        yield ("jay2007", "SPARK methods, their order and their constraints") if constrained else (
            "hairer2006", "Runge-Kutta methods for Hamiltonian systems")
