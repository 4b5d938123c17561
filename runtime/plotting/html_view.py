"""A trajectory as a page that moves: one HTML file that needs no network."""

from __future__ import annotations

import base64
import html
import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import choose
from ...core.file_formats import checked_path, result_file
from ...core.shapes import Shape
from ...core.warnings import warn
from .meshes import BUDGET, MESHES, IndexedMesh, MeshesName, encode, read_meshes
from .scene import DRAWN, DrawnName, Scene, scene_of
from .solids import encoded_solids

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["View", "view"]

_HERE = Path(__file__).resolve().parent
#: Frames of a page: enough for a minute of smooth motion, and no more bytes than that of poses.
_FRAMES = 3600
_BYTES = 900_000
#: Height of a page inside a notebook, in CSS pixels.
_HEIGHT = 560


class View:
    """An animated page; Jupyter shows it where it is the last value of a cell.

    Attributes
    ----------
    page : str
        The HTML document.
    path : Path or None
        Where it was written.
    """

    def __init__(self, title: str, page: str, scene: Scene | None = None,
                 meshes: Mapping[str, IndexedMesh] | None = None) -> None:
        self._scene, self._meshes, self._title, self.page = scene, meshes or {}, title, page
        self.path: Path | None = None

    def __repr__(self) -> str:
        where = "" if self.path is None else f" in {str(self.path)!r}"
        return f"<View of {self._title}{where}: {len(self.page) / 1e3:,.0f} kB of HTML>"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page to a file whose name ends in .html; return its path.

        Raises
        ------
        InputError
            For another ending.
        GyrosparkError
            If the file cannot be written.
        """
        self.path = checked_path(path, "top.html", "A page", "page")
        with result_file(self.path, "The page") as partial_file:
            partial_file.write_text(self.page, encoding="utf-8")
        return self.path

    def _repr_html_(self) -> str:
        """Return the page in an iframe, which keeps its styles and names apart."""
        return (f'<iframe title="{html.escape(self._title)}" style="width:100%;height:{_HEIGHT}px;'
                f'border:0" sandbox="allow-scripts" srcdoc="{html.escape(self.page)}"></iframe>')

    def _repr_png_(self) -> bytes | None:
        """Return a picture for programs that show no pages: printed notebooks, lists of pages."""
        from .picture import draw_scene  # which imports this module

        return None if self._scene is None else draw_scene(self._scene, self._meshes)._repr_png_()


def view(trajectory: Trajectory, path: str | os.PathLike[str] | None = None, *,
         shape: DrawnName = "auto", meshes: MeshesName = "small") -> View:
    """Return the trajectory as a page that moves, and write it where a path is given.

    Bodies are boxes or ellipsoids of their inertia, joints, rods and springs stand between them,
    and their centres leave traces. Beside the scene are the energy error, a slider and the speed. A
    drag turns the scene, a wheel or two fingers bring it nearer.

    Parameters
    ----------
    trajectory : Trajectory
        Of at least one rigid body. Of more states than a page needs, as many as it needs are shown.
    path : path, optional
        A name that ends in .html.
    shape : {"auto", "box", "ellipsoid"}
        What bodies look like at first; the page can change it. The uniform box or ellipsoid with
        the inertia of each, or by "auto" the shapes that distinguish them best.
    meshes : {"small", "full", "none"}
        How much is shown of the meshes of a robot's file: as many triangles as fit into 0.7 MB,
        all of them, or none. Meshes that cannot be read are named on the page.

    Raises
    ------
    InputError
        Where there is no rigid body; for another ending, shape or number of meshes.
    GyrosparkError
        If the file cannot be written.
    """
    choose("shape", shape, DRAWN)
    choose("meshes", meshes, MESHES)
    target = None if path is None else checked_path(path, "top.html", "A page", "page")
    # seven floats of four bytes for the pose of a body, and two numbers a frame
    count = max(2, min(_FRAMES, _BYTES // (28 * max(len(trajectory.bodies), 1) + 8)))
    inertia_scene = scene_of(trajectory, count)
    scene, mesh_files = with_visuals(trajectory, inertia_scene, meshes)
    page_view = View(inertia_scene.title, _page(scene, shape, mesh_files), scene, mesh_files)
    if target is not None:
        page_view.save(target)
    return page_view


def with_visuals(
    trajectory: Trajectory, scene: Scene, meshes: MeshesName, budget: int = BUDGET
) -> tuple[Scene, dict[str, IndexedMesh]]:
    """Return a scene with the visuals of the model, and its meshes by file.

    ``budget`` is the number of bytes of all meshes together for ``"small"``.
    """
    visuals = getattr(trajectory._stepper, "visuals", {})
    files = [shape.file for shapes in visuals.values() for shape in shapes if shape.file]
    mesh_files, reasons = read_meshes(files, meshes, budget)
    # shapes without a file, and those whose mesh could be read
    shapes_by_body = {name: [shape for shape in shapes
                             if not shape.file or shape.file in mesh_files]
                      for name, shapes in visuals.items()}
    remarks = [f"The mesh {Path(file).name} is not shown: {reason}"
               for file, reason in reasons.items()]
    for remark in remarks:
        warn(remark)
    parts = [replace(body, shapes=shapes_by_body[body.name], glass=False, own=True)
             if shapes_by_body.get(body.name) else body for body in scene.parts]
    return replace(scene, parts=parts, ground=shapes_by_body.get("", []),
                   remarks=[*scene.remarks, *remarks]), mesh_files


def _page(scene: Scene, shape: DrawnName, meshes: Mapping[str, IndexedMesh]) -> str:
    """Return the HTML document with styles, script and scene in one."""
    return filled_page(page_file("view.html"), scene.title, _content(scene, shape, meshes),
                       {"SCRIPT": compact(page_file("view.js"))})


def filled_page(
    template: str, title: str, content: Mapping[str, Any], parts: Mapping[str, str]
) -> str:
    """Return a page with bodies: a template with style, drawing and scripts in place of @NAME@.

    ``content`` is its data, for JSON; ``parts`` are further texts by NAME.
    """
    # "</script>" in a name would end the script
    data = json.dumps(content, allow_nan=False).replace("<", "\\u003c")
    page = template
    for name, text in {"STYLE": page_file("view.css"), "DRAWING": compact(drawing()),
                       **parts}.items():
        page = page.replace(f"@{name}@\n" if text.endswith("\n") else f"@{name}@", text)
    # both at once: a title may contain "@CONTENT@"
    texts = {"@TITLE@": html.escape(title), "@CONTENT@": data}
    return re.sub("|".join(texts), lambda match: texts[match[0]], page)


def page_file(name: str) -> str:
    """Return the text of a part of a page in this folder, such as ``"view.js"``."""
    return (_HERE / name).read_text(encoding="utf-8")


def drawing() -> str:
    """Return the script that draws bodies in space, for all pages that show some."""
    return "".join(map(page_file, ("solids.js", "webgl.js", "scene.js")))


def compact(script: str) -> str:
    """Return a script without its indentation, empty lines, and lines that are comments."""
    text = re.sub(r"^\s*/\*\*.*?\*/\n", "", script, flags=re.DOTALL | re.MULTILINE)
    lines = (re.sub(r"  // .*", "", line).strip() for line in text.splitlines())
    return "".join(f"{line}\n" for line in lines if line and not line.startswith("//"))


def _content(scene: Scene, shape: DrawnName, meshes: Mapping[str, IndexedMesh]) -> dict[str, Any]:
    """Return the scene for JSON, long arrays as base64 of 32-bit floats.

    view.js and scene.js read these keys. A position that stays is one row.
    """
    mesh_numbers = {file: i for i, file in enumerate(meshes)}
    encoded_meshes = {i: [encode(mesh)] for i, mesh in enumerate(meshes.values())}
    return {
        "meshes": {**encoded_solids(), **encoded_meshes},
        "ground": _shapes_content(scene.ground, mesh_numbers),
        "title": scene.title, "shape": shape, "remarks": scene.remarks,
        "up": scene.up.tolist(), "gravity": scene.gravity,
        "t": _as_base64(scene.t - scene.t[0]), "start": float(scene.t[0]),
        "energy": _as_base64(scene.energy_error),
        "impacts": _as_base64(scene.impacts - scene.t[0]),
        "bodies": [{
            "name": body.name, "q": _as_base64(body.q), "centre": body.centre.tolist(),
            # a body that stays has one row for all frames
            "x": _as_base64(body.x if np.ptp(body.x, axis=0).any() else body.x[:1]),
            "axes": body.axes.T.tolist(), "tip": body.tip.tolist(),
            "sizes": {kind: size.tolist() for kind, size in body.sizes.items()},
            "scaled": body.to_scale, "shapes": _shapes_content(body.shapes, mesh_numbers),
            "glass": body.glass, "own": body.own,
        } for body in scene.parts],
        "ties": [{
            "name": tie.name, "kind": tie.kind, "slides": tie.slides, "a": tie.a, "b": tie.b,
            "onA": tie.on_a.tolist(),
            "onB": tie.on_b.tolist(), "axis": None if tie.axis is None else tie.axis.tolist(),
        } for tie in scene.ties],
    }


def _shapes_content(
    shapes: Iterable[Shape], mesh_numbers: Mapping[str, int]
) -> list[dict[str, Any]]:
    """Return shapes as the page reads them, a mesh file as its number in the list of meshes."""
    return [{"kind": shape.kind, "size": shape.size.tolist(), "centre": shape.centre.tolist(),
             "axes": shape.axes.T.tolist(), "colour": shape.colour,
             **({"mesh": mesh_numbers[shape.file]} if shape.file else {})}
            for shape in shapes]


def _as_base64(array: Any) -> str:
    """Return numbers as base64 of little-endian 32-bit floats, NaN as 0."""
    return base64.b64encode(np.nan_to_num(array).astype("<f4").tobytes()).decode("ascii")
