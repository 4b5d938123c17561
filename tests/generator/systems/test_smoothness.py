"""Systems with switching functions: lost properties, and the warnings of them.

Constraints need a tangent; a force that jumps may leave a step without a solution; a momentum map
must hold on every side; and a certificate checks the properties of smooth motion alone.
"""

import json
import pickle
import re

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.certificates.momentum_maps import momentum_maps
from gyrospark.core.manifest import Manifest
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.switching_functions import as_switches, switches_of
from gyrospark.generator.systems.smoothness import Continuity, Switching, continuity
from strategies import EPS

x, y, u, v, t = sp.symbols("x y u v t", real=True)
k, a = sp.symbols("k a", positive=True)
P, H = sp.Piecewise, sp.Heaviside
LENGTH, T = sp.sqrt(x**2 + y**2), (u**2 + v**2) / 2
JUMP, KINK, SMOOTH = Continuity.JUMP, Continuity.KINK, Continuity.SMOOTH


@pytest.mark.parametrize(("e", "expected"), [
    (sp.Abs(x), [KINK]), (sp.Abs(x) ** 3, [SMOOTH]), (sp.Max(x, y), [KINK]),
    (sp.Max(0, LENGTH - a) ** 2, [SMOOTH]), (H(x), [JUMP]), (x * H(x), [KINK]),
    (P((x**2, x < 0), (2 * x**2, True)), [SMOOTH]), (sp.sqrt(sp.Max(x, 0)), [KINK]),
    (sp.floor(x) * x, [JUMP]), (sp.sign(x) * sp.sin(x), [KINK]), (P((0, x < a), (x, True)), [JUMP]),
    (P((0, (x > -1) & (x < 1)), ((x**2 - 1) ** 2, True)), [SMOOTH, SMOOTH]),
    (sp.Abs(x - 1) + sp.sign(y) * y**2, [KINK, SMOOTH]),
    # w and −w are one switch: the sum is x, and |x|
    (sp.Max(0, x) - sp.Max(0, -x), [SMOOTH]), (sp.Max(0, x) + sp.Max(0, -x), [KINK]),
])
def test_how_sides_meet(e, expected):
    e = as_switches(e)
    assert [continuity(e, w, (x, y)) for w in switches_of([e])] == expected


def on_curve(profile, **options):
    """Return a bead that slides on the curve y = profile(x)."""
    return gs.System((x, y), (u, v), (k, a), T + k * y, (y - profile,), name="bead", **options)


@pytest.mark.parametrize(("profile", "reason"), [
    (sp.Abs(x), "'g0'.*'bead'.*kink.*x = 0"),
    (P((0, x < 0), (1, True)), "'g0'.*'bead'.*jumps.*x = 0"),
    (sp.Max(x, a * x + 1), "kink"),
    (sp.floor(x), "jumps where x = 0"),
])
def test_constraints_without_a_tangent_are_refused(profile, reason):
    with pytest.raises(gs.InputError, match=reason) as caught:
        gs.stepper("G-L", 2, system=on_curve(profile))
    assert "stiff" in str(caught.value)


@pytest.mark.slow  # a stepper
def test_a_bead_on_a_cam():
    """A bead stays on a ramp with tangents at both ends to round-off, and keeps its energy."""
    ramp = P((0, x < 0), (3 * x**2 - 2 * x**3, x < 1), (1, True)) / 4 + sp.Max(0, -x) ** 3
    step = gs.stepper("G-L", 2, system=on_curve(ramp))
    q, p = step.project([-0.5, 0.1], [1.6, 0.0], parameters={"k": 3.0, "a": 1.0})
    run = step.integrate(q, p, dt=0.01, steps=200, parameters={"k": 3.0, "a": 1.0})
    assert run.q[0, 0] < 0 < 1 < run.q[-1, 0]
    assert run.q[-1, 1] == pytest.approx(0.25, abs=4 * EPS)
    assert run.report.constraint_max <= 8 * EPS
    assert run.report.energy_error_max <= 1e-4
    flat = run.q[:, 0] > 1.05
    assert run.p[flat, 0] == pytest.approx(np.sqrt(2 * (run.energy()[0] - 0.75)), rel=1e-4)


def test_remarks():
    system = gs.System(
        (x, y), (u, v), (k,), T + k * sp.Max(0, LENGTH - 1) ** 2 + sp.Abs(x) + k * H(y), time=t,
        forces=(-sp.Abs(u) * u, -sp.sign(v) + P((1, (t > 0.5) & (t < 1)), (0, True))))
    fields = Switching(system).manifest_fields(4, discrete=False)
    order, potential, forces = fields["remarks"]
    assert re.search(r"order 4 .* y = 0, t - 0\.5 = 0, sqrt\(x\*\*2 \+ y\*\*2\) - 1 = 0 .*4", order)
    assert potential.startswith("H jumps at y = 0")
    assert forces.startswith("forces jump at v = 0, x = 0")
    assert fields["jumps"] == "v = 0, x = 0"
    assert Switching(system).manifest_fields(2, discrete=True)["jumps"] == "v = 0"
    # a switch of the time alone in H, where no coordinate crosses it
    switched_on = gs.System((x,), (u,), (), u**2 / 2 + x * sp.Max(0, t - 1), time=t)
    assert Switching(switched_on).jumps_of_H == []
    assert re.search("t - 1 = 0", Switching(switched_on).manifest_fields(4, discrete=False)[
        "remarks"][0])
    in_steps = gs.System((x,), (u,), (), u**2 / 2 + x * H(t - 1), time=t)
    assert Switching(in_steps).jumps_of_H == [1 - t]
    assert "work" in Switching(in_steps).manifest_fields(4, discrete=False)["remarks"][1]
    assert Switching(in_steps).jumps_of_forces(discrete=False) == []
    smooth = Switching(gs.System((x, y), (u, v), (k,), T + k * LENGTH))
    assert smooth.manifest_fields(2, discrete=True) == {}


def rubbing(friction, name):
    return gs.System((x,), (u,), (), u**2 / 2 + x**2 / 2, forces=(-friction,), name=name)


def test_a_stepper_says_where_its_order_does_not_hold():
    """The manifest's warnings are its remarks on the order; smooth systems have none."""
    source = generate(Spec("G-L", 2), system=rubbing(sp.sign(u), "rubbing")).source
    manifest = Manifest.from_text(source.manifest)
    assert [text for _, text in manifest.warnings] == list(manifest.system.remarks)
    assert re.search(r"order 4 .*u = 0", manifest.system.remarks[0])
    assert gs.stepper("G-L", 3).warnings == []


@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_a_step_without_a_solution_says_so(solver):
    """A body stopped by dry friction has no velocity consistent with its force: the step fails.

    The trajectory before it is the sliding motion, x − 1 a half cosine.
    """
    step = gs.stepper("G-L", 2, system=rubbing(sp.sign(u), "rubbing"))
    message = "jump.*u = 0.*tanh"
    with pytest.raises(gs.StepFailed, match=message) as end:
        step.integrate([3.0], [0.0], dt=0.01, steps=1000, parameters={}, solver=solver)
    assert end.value.step in (314, 315)
    trajectory = end.value.trajectory
    assert np.abs(trajectory.q[1:, 0] - 1 - 2 * np.cos(trajectory.t[1:])).max() < 1e-4
    again = pickle.loads(pickle.dumps(end.value))
    assert str(again) == str(end.value)


@pytest.mark.parametrize(("H_0", "forces", "expected"), [
    (k * sp.Max(0, LENGTH - a) ** 2 / 2, (), ["-u*y + v*x"]),
    (P((LENGTH**2, x < 5), (y, True)), (), []),
    (P((LENGTH**2, LENGTH < 5), (LENGTH**3 / 5, True)), (), ["-u*y + v*x"]),
    (sp.Abs(x), (), ["v"]),
    (sp.Max(x, y), (), []),
    (sp.Max(x, y, evaluate=False) + sp.Abs(x - y), (), []),
    # r² where w and −w switch together
    (LENGTH**2 + k * (sp.Max(0, x) - sp.Max(0, -x) - x), (), ["-u*y + v*x"]),
    (LENGTH**2, (P((0, x < 50), (1, True)), 0), []),
    (LENGTH**2, (P((0, LENGTH < 50), (-y, True)), P((0, LENGTH < 50), (x, True))), []),
])
def test_momentum_maps_of_every_side(H_0, forces, expected):
    """Maps need every side, also far from the start: a potential round near it alone has none."""
    system = gs.System((x, y), (u, v), (k, a), T + H_0, forces=forces)
    maps = momentum_maps(system, {"k": 3.0, "a": 0.5}, [1, 0.2], [0.3, 0.1])
    assert [str(J.J) for J in maps] == expected
    assert all(J.any_parameters and J.everywhere and J.proof == "expanded" for J in maps)


def test_constraints_that_switch_are_not_searched():
    system = on_curve(sp.Max(0, x) ** 2)
    with pytest.raises(gs.InputError, match="switches at x = 0"):
        momentum_maps(system, {"k": 3.0, "a": 0.5}, [1, 1], [0, 0])


@pytest.mark.slow  # a stepper of one system
def test_certificate_reports_what_kinks_leave():
    system = gs.System((x, y), (u, v), (k, a), T + k * sp.Max(0, LENGTH - a) ** 2 / 2, name="rope")
    model = gs.Model(system, {"k": 3.0, "a": 0.5}, [1.0, 0.2], [0.3, 0.1], dt=0.01, steps=100)
    certificate = gs.certify(model, "EMS")
    switch = "a - sqrt(x**2 + y**2) = 0"
    assert certificate.holds
    assert certificate.line("order").holds is None
    assert certificate.line("order").expected == "2 between crossings"
    assert switch in certificate.line("order").why
    assert certificate.line("loop").holds is None
    assert certificate.line("reversal").holds is True
    assert certificate.line("energy H").holds is True
    assert certificate.line("angular momentum").holds is None
    json.dumps(certificate.as_dict())


def test_certificate_of_a_force_that_jumps():
    """Reversal is reported without a verdict, for a step across a jump may have several ends."""
    model = gs.Model(rubbing(sp.sign(u), "rubbing"), {}, [3.0], [0.0], dt=0.01, steps=200)
    certificate = gs.certify(model, "G-L", 2)
    assert certificate.line("reversal").holds is None
    assert "jump at u = 0" in certificate.line("reversal").why
    assert certificate.holds


def test_run_says_it_before_a_step(gyrospark, tmp_path):
    path = tmp_path / "dry.toml"
    path.write_text('name = "rubbing"\n[system]\ncoordinates = ["x"]\nmomenta = ["u"]\n'
                    'hamiltonian = "u**2/2 + x**2/2"\nforces = ["-sign(u)"]\n'
                    '[start]\nq = [3]\np = [0]\n[run]\ndt = 0.01\nsteps = 400\n', encoding="utf-8")
    done = gyrospark("run", path, "--scheme", "G-L", "--stages", "2")
    lines = done.stdout.splitlines()
    assert done.code == 1
    assert re.fullmatch(r"system: order 4 .*u = 0", lines[0])
    assert lines[1].startswith("system: forces jump at u = 0")
    assert "steps of 0.01 s" in done.stdout
    assert "Traceback" not in done.stderr
    assert "jump at u = 0" in done.stderr
