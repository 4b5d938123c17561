"""Target web: a page that integrates a model while it is looked at. One file, no network."""

from __future__ import annotations

import base64
import json
import re
import tempfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._version import __version__
from ...core.errors import InputError
from ...core.exact_numbers import Number
from ...core.inertia import RepName
from ...core.manifest import Manifest, NumberManifest
from ...core.progress import Progress
from ...core.real_types import RealName
from ...runtime.compilation.body_columns import bodies_of
from ...runtime.plotting.html_view import View, compact, filled_page
from ...runtime.plotting.scene import check_bodies, drawn_joints
from ...runtime.plotting.solids import encoded_solids
from ..artefact import MARKER, Built, Options
from ..build import build
from . import webassembly
from .webassembly import (
    SOURCES,
    c_files,
    compile_module,
    read,
    schemes_of,
    start_of,
    velocities_of,
)

if TYPE_CHECKING:
    from ...generator.multibody.model import Model
    from ...generator.systems.system import System
    from ...runtime.rigid_body.problems import Problem

__all__ = ["check", "compile", "files", "playground"]

_PAGE = "page.html"
#: In the page, the base64 of the module, compressed.
_MODULE = "@MODULE@"


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the C, and the page but for the module.

    Raises
    ------
    InputError
        For a system without a rigid body that coordinates give the place of.
    """
    check_bodies(manifest)
    if not bodies_of(manifest):
        raise InputError(f"The place of the bodies of {manifest.system.name!r} is a formula "
                         "of its coordinates, which a page does not evaluate; build target wasm.")
    page = filled_page(read("page.html"), _title(manifest), _page_data(manifest, options), {
        "OWN_STYLE": read("page.css"), "STEPPER": compact(read("stepper.js")),
        "SCRIPT": compact(read("page.js"))})
    return {**c_files(options), _PAGE: page}


def _title(manifest: Manifest) -> str:
    """Return the name of a system as a heading, "Heavy top" for ``heavy_top``."""
    name = str(manifest.system.name).replace("_", " ")
    return name[:1].upper() + name[1:]


def _page_data(manifest: Manifest, options: Options) -> dict[str, Any]:
    """Return the data for page.js by key: schemes, start, sliders, bodies and joints to draw.

    A body has the indices of its coordinates in q, "a" and "b" of a joint are indices of bodies.
    """
    system, bodies = manifest.system, bodies_of(manifest)
    velocities = velocities_of(manifest)
    index_of = {name: i for i, name in enumerate(bodies)} | {"": -1}  # −1: the ground
    description = " ".join(filter(None, [
        options.description,
        f"The generated C of gyrospark {__version__}, as WebAssembly, integrates in this page."]))
    return {
        "about": description, MARKER: "web",
        "hash": [stepper.manifest.hash for stepper in options.steppers],
        "conserves": not system.forces and system.time is None,
        "schemes": schemes_of(options), "start": start_of(manifest, options),
        # more constraints than |q|² = 1 of each body: a coordinate alone cannot be moved
        "jointed": len(system.constraints) > len(bodies),
        "curves": 3 if system.constraints else 1,  # errors of H, g and f
        "velocities": [_velocity_field(quantity, bodies) for quantity in velocities],
        "spins": [i for i, quantity in enumerate(velocities)
                  if "omega" in _name_without_body(quantity.name, bodies)[1]],
        "numbers": _sliders(manifest),
        "bodies": [{"name": name, "q": body.q, "x": body.x, "origin": body.origin,
                    "centre": body.centre, "inertia": body.inertia, "mass": body.mass}
                   for name, body in bodies.items()],
        "ties": [{"name": name, "kind": kind, "slides": kind == "hinge" and joint.slides,
                  "a": index_of[joint.a], "b": index_of[joint.b], "onA": joint.on_a,
                  "onB": joint.on_b, "axis": joint.axis_b or None}
                 for name, (kind, joint) in drawn_joints(manifest).items()],
        "meshes": encoded_solids(), "wasm": _MODULE,
    }


def _name_without_body(name: str, bodies: Iterable[str]) -> tuple[str, str]:
    """Return the body whose name begins the name of a velocity, "" for none, and the rest."""
    # the longest name that fits: bodies may be "arm" and "arm_2"
    body = next((body for body in sorted(bodies, key=len, reverse=True)
                 if name.startswith(f"{body}_")), "")
    return body, name.removeprefix(f"{body}_")


def _velocity_field(quantity: NumberManifest, bodies: Iterable[str]) -> dict[str, str]:
    """Return the field of page.js in which a velocity of the start is typed."""
    body, text = _name_without_body(quantity.name, bodies)
    return {"name": quantity.name, "body": body, "unit": _unit(quantity.unit),
            "text": text.replace("omega", "ω").replace("_", " ")}


def _sliders(manifest: Manifest) -> list[dict[str, str]]:
    """Return the sliders of page.js: inputs, then the parameters that no constraint has.

    A slider for a parameter of a constraint would move the start off the constraint.
    """
    system = manifest.system
    in_constraints = {*re.findall(r"\w+", " ".join(system.constraints))}
    units = {quantity.name: quantity.unit for quantity in system.numbers}
    inputs = [*system.inputs]
    names = sorted(system.parameters, key=lambda name: name not in inputs)
    return [{"name": name, "domain": system.parameters[name],
             "role": "input" if name in inputs else "parameter", "unit": _unit(units.get(name))}
            for name in names if name not in in_constraints]


def _unit(unit: str | None) -> str:
    """Return a unit as a page shows it, of FMI's spelling: ``kg m²`` of ``kg.m2``."""
    digits = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    text = (unit or "").replace(".", " ").replace("-", "⁻")
    return re.sub(r"(?<=[a-zA-Z⁻])\d", lambda match: match[0].translate(digits), text)


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Compile the module, and put it into the page; return the page."""
    module, page = folder / "stepper.wasm", folder / _PAGE
    compile_module(folder / SOURCES, module, level="-Oz")  # small: the page carries it as text
    packed = base64.b64encode(zlib.compress(module.read_bytes(), level=9)).decode("ascii")
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace(_MODULE, packed), encoding="utf-8")
    return page


def module_of(page: str) -> bytes:
    """Return the WebAssembly of a page."""
    content = json.loads(page.split('id="content">')[1].split("</script>")[0])
    return zlib.decompress(base64.b64decode(content["wasm"]))


def check(built: Built) -> str:
    """Run the module of the page in wasmtime and Node, and compare bits with native C."""
    return webassembly.compare(built, module_of(built.path.read_text(encoding="utf-8")))


def playground(
    system: str | Path | System | Model | Problem, *,
    scheme: str | Sequence[str] = ("3-G-L", "IMS", "EMS"), stages: int | None = None,
    rep: RepName | None = None, order: int | None = None, composition: str | None = None,
    real: RealName | None = None, dt: float | None = None, start: tuple[Any, Any] | None = None,
    parameters: Mapping[str, Number] | None = None, progress: Progress = None
) -> View:
    """Return a page in which a model moves, integrated while it is looked at.

    It shows the bodies in space, sliders for step, start and parameters, and the errors of energy
    and constraints. The page is one file without network; Jupyter shows it where it is the last
    value of a cell, ``save`` writes it.

    Parameters
    ----------
    system : str, path, Problem, Model or System
        As for ``build``: with bodies.
    scheme : str or sequence of str
        Schemes that the page offers, the first to begin with.
    stages, rep, order, composition, real, dt, start, parameters, progress
        As for ``build``.

    Returns
    -------
    View
        ``.page`` is the HTML document, ``.save(path)`` writes it.

    Raises
    ------
    InputError
        As ``build``; for a system without a body; where ziglang is missing, with the cure.
    """
    with tempfile.TemporaryDirectory() as folder_name:
        artefact = build("web", system, scheme=scheme, stages=stages, rep=rep, order=order,
                         composition=composition, real=real, dt=dt, start=start,
                         parameters=parameters, out=Path(folder_name) / "page.html",
                         progress=progress)
        page = artefact.path.read_text(encoding="utf-8")
    return View(_title(artefact.stepper.manifest), page)
