"""Tables and lists of the package for pages: ``{{ name }}`` on its own line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import site_uses

import gyrospark as gs
from gyrospark.certificates.citations import WORKS
from gyrospark.generator.models.formulas import CONSTANTS, FUNCTIONS
from gyrospark.generator.models.multibody_file import FORCES, JOINTS, ON_JOINTS
from gyrospark.generator.multibody.multibody import Multibody
from gyrospark.targets import TARGETS

__all__ = ["API", "TABLES"]

ROOT = Path(__file__).resolve().parent.parent

#: Page of the reference → its names, in order; result classes by their modules. Every public name
#: is on one page.
API = {
    "runs": [
        "stepper", "Stepper", "Start", "Solver", "Inputs", "Trajectory",
        "runtime.results.body_motion.BodyMotion", "runtime.results.joint_motion.JointMotion",
        "runtime.results.beam_motion.BeamMotion",
        "runtime.results.diagnostics.Report", "Simulation", "Ensemble",
        "runtime.devices.ensemble.DeviceEnsemble", "Event", "Impact",
        "runtime.results.crossings.Crossings", "runtime.results.crossings.Impacts",
        "section", "runtime.events.poincare_section.Section", "GyrosparkError", "InputError",
        "StepFailed", "errors"],
    "systems": [
        "System", "scales", "from_mechanics", "Model", "Multibody", "Shape", "body_system",
        "symbols", "load_model", "models", "problems", "references", "exact", "tableau",
        "consistent", "core.projection.Projection"],
    "tuning": [
        "gamma", "tune", "runtime.tuning.tune.Tuned", "certify",
        "certificates.certificate.Certificate", "cite", "certificates.citations.Citations"],
    "differentiation": [
        "Tangents", "runtime.results.tangent_rows.TangentRows",
        "runtime.derivatives.gradient.Gradient", "lyapunov", "runtime.analysis.lyapunov.Lyapunov",
        "periodic_orbit", "runtime.analysis.periodic_orbit.PeriodicOrbit", "fit",
        "runtime.analysis.fit.Fit", "interop"],
    "stores": [
        "load", "resume", "storage.recording.Recording", "sweep", "load_sweep"],
    "artefacts": ["build", "targets.artefact.Built", "playground"],
}


def api(page: str) -> str:
    """Return the directives of a page of the reference."""
    listed = {name for names in API.values() for name in names if "." not in name}
    missing = set(gs.__all__) - listed - {"__version__"}
    assert not missing, f"site_tables.API has no place for {sorted(missing)}"
    return "\n".join(["```{eval-rst}", *(_directive(name) for name in API[page]), "```"])


def _directive(name: str) -> str:
    whole = f"gyrospark.{name}"
    module, _, inner = whole.rpartition(".")
    thing = getattr(__import__(module, fromlist=[inner]), inner)
    if inspect.ismodule(thing):
        inside = [each for each in thing.__all__ if each not in gs.__all__]
        members = "" if name == "symbols" else f"   :members: {', '.join(inside)}\n"
        return f".. automodule:: {thing.__name__}\n{members}\n"
    if isinstance(thing, type):
        members = "" if issubclass(thing, Exception) else (
            "   :members:\n   :inherited-members: object,str,int,tuple,Mapping\n")
        return f".. autoclass:: {whole}\n{members}\n"
    return f".. autofunction:: {whole}\n"


def joints() -> str:
    """Return the types of [[joints]] with their keys, and the files that have them."""
    rows = []
    for kind, parameters in JOINTS.items():
        keys = [f"`{key}`" + ("" if one.default is one.empty else " (or not)")
                for key, one in parameters.items() if one.kind is one.KEYWORD_ONLY]
        summary = (inspect.getdoc(getattr(Multibody, kind)) or "").partition("\n")[0]
        rows.append([f"`{kind}`", summary, ", ".join(keys), _files("joints", kind)])
    return _table(["type", "does", "keys in addition to `name` and "
                   "`bodies` (`joints` of gear and couple)", "in"], rows)


def forces() -> str:
    """Return the types of [[forces]] with their keys."""
    rows = [[f"`{kind}`", "`joints`" if kind in ON_JOINTS else "`bodies`",
             ", ".join(f"`{key}`" for key in keys), _files("forces", kind)]
            for kind, keys in FORCES.items()]
    return _table(["type", "acts on", "keys", "in"], rows)


def functions() -> str:
    """Return the functions and constants of formulas."""
    return ("Functions: " + ", ".join(f"`{name}`" for name in sorted(FUNCTIONS))
            + ". Constants: " + ", ".join(f"`{name}`" for name in sorted(CONSTANTS)) + ".")


def keys() -> str:
    """Return the tables of model files, and the files that have them."""
    about = {
        "body": "one body with a fixed point", "system": "any holonomic Hamiltonian system",
        "bodies": "several bodies", "joints": "constraints between bodies", "forces": "loads",
        "points": "moving points of the ground", "drives": "angles as functions of time",
        "parameters": "numbers by name", "inputs": "numbers that forces use, set in each step",
        "start": "the initial state", "run": "`dt`, `steps`",
        "quantities": "formulas evaluated with the motion", "events": "levels of quantities",
    }
    rows = [[f"`[{name}]`", summary, ", ".join(site_uses.users_of_key(lambda text, name=name:
                                                                    name in text))]
            for name, summary in about.items()]
    return _table(["table", "holds", "in"], rows)


def examples() -> str:
    """Return the source of every example, each with its own heading."""
    parts = []
    for label, path in site_uses.examples().items():
        language = {"py": "python", "toml": "toml"}.get(path.rpartition(".")[2], "xml")
        parts.append(f"({label})=\n## {path}\n\n```{{literalinclude}} ../../{path}\n"
                     f":language: {language}\n```\n")
    return "\n".join(parts)


def artefacts() -> str:
    """Return the targets of ``gyrospark build``."""
    rows = []
    for target in TARGETS.values():
        kind = f"file {target.suffix}" if target.suffix else "folder"
        rows.append([f"`{target.name}`", f"{kind}: {target.about}",
                     ", ".join(target.needs) or "–", ", ".join(target.checks)])
    return _table(["target", "artefact", "building needs", "`--check` needs"], rows)


def works() -> str:
    """Return the works that ``gs.cite`` may name."""
    return "\n".join(f"- {work}" for work in WORKS.values())


def _files(table: str, kind: str) -> str:
    return ", ".join(site_uses.users_of_key(
        lambda text: any(one.get("type") == kind for one in _tables(text, table))))


def _tables(text: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found = text.get(name, [])
    return found if isinstance(found, list) else []


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head), *map(list, rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |"
                     for line in lines)


TABLES: dict[str, Callable[[], str]] = {
    **{f"api_{page}": (lambda page=page: api(page)) for page in API},
    "joints": joints, "forces": forces, "functions": functions, "keys": keys,
    "examples": examples, "works": works, "artefacts": artefacts,
}
