"""The moving page has the numbers of the run; its shapes have the inertia, its script draws."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.core.shapes import Shape
from gyrospark.runtime.plotting.scene import scene_of
from gyrospark.runtime.plotting.solids import mesh_of
from processes import DATA, ROOT

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="without Node.js")


def integrated(model, steps=40, name=None, **options):
    step = systems.stepper(name) if name else gs.stepper("IMS", system=model.system)
    return step.integrate(model.q0, model.p0, steps=steps, parameters=dict(model.parameters),
                          **{"dt": model.dt} | options)


@pytest.fixture(scope="module")
def tops():
    return integrated(gs.models.double_top(), name="double_top")


#: Triangles of a box, as the keys of ``drawn`` have them.
BOX = str(len(mesh_of(Shape("box", np.ones(3))).faces))


def triangles(report):
    return sum(int(size) * count for size, count in report["drawn"].items())


def scene_in(page):
    return json.loads(re.search(r'id="scene">(.*?)</script>', page, flags=re.DOTALL)[1])


def floats(text):
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def executed(page, tmp_path, *arguments):
    target = tmp_path / "page.html"
    target.write_text(page, encoding="utf-8")
    done = subprocess.run(["node", DATA / "run_view.js", target, *arguments], check=True,
                          capture_output=True, text=True)
    return json.loads(done.stdout)


def test_a_page_has_the_run_and_needs_no_network(tops, tmp_path):
    view = tops.show(tmp_path / "tops.html")
    page = view.path.read_text(encoding="utf-8")
    assert page == view.page
    assert not re.search(r"https?://|src=|@[A-Z]+@|import ", page)
    scene = scene_in(page)
    assert np.abs(floats(scene["t"]) - tops.t).max() < 1e-7
    assert np.abs(floats(scene["energy"]) - tops.energy_error()).max() < 1e-18
    assert not len(floats(scene["impacts"]))
    for body, name in zip(scene["bodies"], tops.bodies, strict=True):
        assert body["name"] == name
        q = floats(body["q"]).reshape(-1, 4)
        assert np.abs(q - tops.body(name).attitude).max() < 1e-7
    assert np.abs(floats(scene["bodies"][1]["x"]).reshape(-1, 3) - tops.q[:, 8:11]).max() < 1e-6
    assert [tie["kind"] for tie in scene["ties"]] == ["ball"]


def test_shapes_have_the_inertia_of_their_bodies():
    """A box has m (b² + c²)/3, an ellipsoid m (b² + c²)/5, each moved to the origin."""
    run = systems.run("tied", systems.stepper("tied", "IMS"), 2)
    for scene_part in scene_of(run, 10).parts:
        body = run.body(scene_part.name)
        for kind, share in (("box", 3), ("ellipsoid", 5)):
            a2 = scene_part.sizes[kind] ** 2
            centred = (scene_part.axes @ np.diag(body.mass / share * (a2.sum() - a2))
                       @ scene_part.axes.T)
            c = scene_part.centre
            inertia = centred + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
            assert np.abs(inertia - body.inertia).max() < 1e-14
        assert np.linalg.det(scene_part.axes) > 0.999
        assert scene_part.to_scale


@pytest.mark.parametrize(("inertia", "kind"), [
    ([1, 1, 1], "sphere"), ([1, 1, 1.5], "disc"), ([1, 1.2, 1.5], "box")])
def test_equal_moments_are_seen(inertia, kind, gl3):
    free = gs.problems.free_body(inertia=inertia)
    (scene_part,) = scene_of(gl3.integrate(free, dt=1e-3, steps=1), 10).parts
    assert scene_part.shapes[0].kind == kind


def test_a_body_without_a_mass_has_the_proportions_of_its_moments(gl3):
    free = gs.problems.free_body()
    (scene_part,) = scene_of(gl3.integrate(free, dt=1e-3, steps=20), 10).parts
    assert not scene_part.to_scale
    I1, I2, I3 = free.inertia
    squares = np.array([I2 + I3 - I1, I3 + I1 - I2, I1 + I2 - I3])
    for size in scene_part.sizes.values():
        assert size.max() == 1
        assert np.abs(size**2 - squares / squares.max()).max() < 1e-12


def test_joints_are_where_the_run_has_them():
    run = integrated(gs.models.four_bar(), 30, name="four_bar")
    scene = scene_of(run, 31)
    for tie in scene.ties:
        assert tie.kind == "hinge"
        on_second = scene.parts[tie.b].at(tie.on_b)[:, 0] if tie.b >= 0 else tie.on_b
        assert np.abs(on_second - run.joint(tie.name).position()).max() < 1e-14
        on_first = scene.parts[tie.a].at(tie.on_a)[:, 0] if tie.a >= 0 else tie.on_a
        assert np.abs(on_second - on_first).max() < 1e-12
    assert np.abs(scene.up - [0, 1, 0]).max() == 0


def test_a_ring_reaches_from_its_axis_to_the_next():
    """The outer ring of a gimbal has bars of a circle about its centre, and two pairs of studs."""
    scene = scene_of(integrated(gs.models.gimbal(), 2, "gimbal"), 3)
    ring = max(scene.parts, key=lambda scene_part: len(scene_part.shapes))
    assert len(ring.shapes) > 36
    distances = [np.linalg.norm(shape.centre - ring.centre) for shape in ring.shapes]
    assert np.ptp(distances[:36]) < 1e-12 < distances[0]
    assert distances[0] < max(distances[36:]) < 1.2 * distances[0]


def test_long_runs_are_thinned_and_their_pages_stay_small(gl3):
    long = gl3.integrate(TOP.q0, TOP.p0, steps=9000, **RUN)
    scene = scene_in(long.show().page)
    t = floats(scene["t"])
    assert 3000 < len(t) <= 3600
    assert t[-1] == np.float32(9.0)
    copied = replace(long, manifest=long.manifest)
    assert len(copied.show().page) < 400e3
    chain = integrated(gs.models.double_top(), 30, "double_top")
    repeated = {name: np.repeat(getattr(chain, name), 120, axis=0)
                for name in ("q", "p", "energies", "work")}
    repeated["t"] = np.linspace(0, 6, len(repeated["q"]))
    page = replace(chain, **repeated).show().page
    assert len(page) < 6e5
    assert len(floats(scene_in(page)["t"])) > 3000


def test_times_in_any_order_are_shown_in_theirs(gl3):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=40, **RUN)
    mixed = run.at([0.03, 0.0105, 0.02])
    t = floats(scene_in(mixed.show().page)["t"])
    assert np.abs(t - [0, 0.0095, 0.0195]).max() < 1e-8
    scene = scene_of(mixed, 10)
    assert np.array_equal(scene.parts[0].q, mixed.q[[1, 2, 0]])


def test_a_spin_too_fast_to_be_followed_is_reported(gl3):
    slow, fast = (gl3.integrate(TOP.q0, TOP.p0, steps=400, every=every, **RUN) for every in (1, 50))
    assert len(scene_of(slow, 4000).remarks) == 1  # the mass is not known
    assert "1.0 turns" in scene_of(fast, 4000).remarks[1]


@needs_node
@pytest.mark.parametrize("name", [
    "one state", *(pytest.param(name, marks=pytest.mark.slow)  # each frame takes a second of Node
                   for name in ("two states", "two bodies", "glass"))])
def test_the_script_is_javascript_and_draws(name, tops, gl3, tmp_path):
    for script in ("scene.js", "solids.js", "view.js"):
        subprocess.run(["node", "--check", ROOT / "runtime/plotting" / script], check=True)
    runs = {"one state": lambda: (gl3.integrate(TOP.q0, TOP.p0, steps=0, **RUN), 1),
            "two states": lambda: (gl3.integrate(TOP.q0, TOP.p0, steps=1, **RUN), 1),
            "two bodies": lambda: (tops, 2),
            "glass": lambda: (integrated(gs.models.gimbal(), 5, dt=-1e-3), 3)}
    for run, bodies in (runs[name](),):
        drawn = executed(run.show().page, tmp_path)
        assert drawn["bad"] == 0
        boxes = run.show(shape="box").page
        of_boxes = executed(boxes, tmp_path)
        assert of_boxes["bad"] == 0
        # Bodies and their shadows; the two rings of the gimbal are seen through: front and back.
        seen_through, shadows = 2 * (bodies == 3), bodies * scene_in(boxes)["gravity"]
        assert of_boxes["drawn"][BOX] == bodies + shadows + seen_through
        assert sum(of_boxes["drawn"].values()) - of_boxes["drawn"][BOX] <= len(run.joints)
        assert triangles(drawn) > triangles(of_boxes)
        assert len(set(of_boxes["speeds"])) == 10
        assert of_boxes["glass"] == (bodies == 3)  # the rotor is inside its rings
    if name == "two bodies":
        assert executed(tops.show().page, tmp_path, "#t=0.02")["clock"] == "0.0200 of 0.0400 s"


@needs_node
def test_text_of_others_stays_text(tops, tmp_path):
    method = "</script><b>@CONTENT@ & \"x\""
    manifest = replace(tops.manifest, scheme=replace(tops.manifest.scheme, method=method))
    hostile = replace(tops, manifest=manifest)
    page = hostile.show().page
    assert "<b>" not in page
    assert scene_in(page)["title"].endswith('</script><b>@CONTENT@ & "x"')
    assert executed(page, tmp_path)["bad"] == 0


def test_jupyter_shows_it_in_a_frame(tops, tmp_path):
    shown = tops.show()
    text = shown._repr_html_()
    assert text.startswith("<iframe ")
    assert text.count("<") == 2
    assert len(repr(shown)) < 200
    assert "View" in repr(shown)
    assert "None" not in repr(shown)
    assert "top.html" in repr(tops.show(tmp_path / "top.html"))


def test_on_the_command_line(gyrospark, tmp_path):
    """One run has every kind of picture; a system without a body has none."""
    run = ["run", "fast-top", "--dt", "1e-3", "--steps", "1"]
    names = ["top.html", "top.png", "top.glb"]
    answer = gyrospark(*run, *(word for name in names for word in ("--show", name)), "--json")
    assert answer.code == 0
    assert answer.document["show"] == names
    page = (tmp_path / "top.html").read_text(encoding="utf-8")
    assert len(floats(scene_in(page)["t"])) == 2
    assert {path.name for path in tmp_path.iterdir()} == {*names}
    answer = gyrospark(*run, "--show", "top.avi")
    assert answer.code == 2
    assert "'top.avi'" in answer.stderr
    answer = gyrospark("run", ROOT / "examples/pendulum.toml", "--scheme", "G-L",
                       "--stages", "2", "--show", "p.html")
    assert answer.code == 2
    assert "'pendulum'" in answer.stderr
    assert not (tmp_path / "p.html").exists()


def test_what_is_no_body_is_not_shown():
    run = systems.run("pendulum", systems.stepper("pendulum"), 3)
    with pytest.raises(gs.InputError, match="'pendulum'"):
        run.show()
