"""Systems with velocity constraints, and their motions computed in another way."""

from functools import cache

import numpy as np
import sympy as sp

import gyrospark as gs
from gyrospark.generator.systems.system import System


@cache
def stepper_of(make, stages, scheme="G-L", real="double"):
    """Return a stepper of one of these systems, built once."""
    return gs.stepper(scheme, stages, system=make(), real=real)


SLEIGH = {"m": 1.0, "I": 0.5, "a": 0.3}


@cache
def sleigh() -> System:
    """Chaplygin's sleigh: a blade at distance a behind the centre of mass.

    The parameters are any numbers, as in a model file, which so has the same stepper.
    """
    (x, y, th), p = sp.symbols("x y th", real=True), sp.symbols("px py pth", real=True)
    vx, vy, w = v = sp.symbols("vx vy w", real=True)
    (m, inertia), a = sp.symbols("m I", real=True, nonzero=True), sp.Symbol("a", real=True)
    return System((x, y, th), p, (m, inertia, a),
                  (p[0]**2 / m + p[1]**2 / m + p[2]**2 / inertia) / 2,
                  velocities=v, name="sleigh",
                  velocity_constraints=(-sp.sin(th) * vx + sp.cos(th) * vy - a * w,))


def sleigh_state(u, w, th=0.3, x=0.0, y=0.0):
    """Return (q, p) of a sleigh whose blade goes on at the speed u while it turns at the rate w."""
    m, inertia, a = SLEIGH.values()
    p = [m * (u * np.cos(th) - a * w * np.sin(th)), m * (u * np.sin(th) + a * w * np.cos(th)),
         inertia * w]
    return np.array([x, y, th]), np.array(p)


def sleigh_end(u, w, th, t):
    """Return u, w and th after a time, in closed form: u = E tanh, w = E sech of one angle.

    u' = a w², w' = -m a u w/(I + m a²) keep E² = u² + k² w² with k² = (I + m a²)/m.
    """
    m, inertia, a = SLEIGH.values()
    k = np.sqrt((inertia + m * a * a) / m)
    E, rate = np.hypot(u, k * w), a / k**2
    s0 = np.arctanh(u / E)
    s = s0 + rate * E * t
    turn = 2 * (np.arctan(np.tanh(s / 2)) - np.arctan(np.tanh(s0 / 2)))
    return E * np.tanh(s), E / k / np.cosh(s), th + k / a * turn


def _L(q):
    return sp.Matrix([[-q[1], q[0], q[3], -q[2]], [-q[2], -q[3], q[0], q[1]],
                      [-q[3], q[2], -q[1], q[0]]])


def _R(q):
    a, b, c, d = q
    return sp.Matrix([[a*a + b*b - c*c - d*d, 2*(b*c - a*d), 2*(b*d + a*c)],
                      [2*(b*c + a*d), a*a - b*b + c*c - d*d, 2*(c*d - a*b)],
                      [2*(b*d - a*c), 2*(c*d + a*b), a*a - b*b - c*c + d*d]])


def _rolling(name, contact, extra_parameters=()) -> System:
    """Return a body that rolls on the plane z = 0: its contact is a function of R(q)ᵀe_z."""
    x, q = sp.symbols("x y z", real=True), sp.symbols("q0:4", real=True)
    px, pq = sp.symbols("px py pz", real=True), sp.symbols("p0:4", real=True)
    v = sp.symbols("vx vy vz v0:4", real=True)
    m, I1, I2, I3, gravity, gamma = sp.symbols("m I1 I2 I3 gravity gamma", positive=True)
    l = _L(q) * sp.Matrix(pq)  # noqa: E741
    spin = sum((l[i]**2 * (1 / J - 1 / gamma) for i, J in enumerate((I1, I2, I3))),
               sum(e**2 for e in pq) / gamma) / 8
    R = _R(q)
    arm = contact(R.T * sp.Matrix([0, 0, 1]))
    omega = 2 * _L(q) * sp.Matrix(v[3:])
    slip = sp.Matrix(v[:3]) + R * omega.cross(arm)
    return System((*x, *q), (*px, *pq), (m, I1, I2, I3, gravity, gamma, *extra_parameters),
                  sum(e**2 for e in px) / (2 * m) + spin + m * gravity * x[2],
                  (sum(e**2 for e in q) - 1,), name=name, velocities=v,
                  velocity_constraints=tuple(slip))


@cache
def disc() -> System:
    """A thin disc of radius 1 whose axis has the moment I3."""
    return _rolling("disc", lambda u: -sp.Matrix([u[0], u[1], 0]) / sp.sqrt(u[0]**2 + u[1]**2))


@cache
def rattleback() -> System:
    """An ellipsoid with the half axes a, b, c; its centre is h above the centre of mass (Kane)."""
    a, b, c, h, ce, se = sp.symbols("a b c h ce se", real=True)

    def contact(u):
        turn = sp.Matrix([[ce, se, 0], [-se, ce, 0], [0, 0, 1]])
        M = turn.T * sp.diag(a**2, b**2, c**2) * turn
        return -M * u / sp.sqrt((u.T * M * u)[0]) + sp.Matrix([0, 0, h])

    return _rolling("rattleback", contact, (a, b, c, h, ce, se))


def rolling_state(parameters, q, omega, contact):
    """Return (q, p) of a body with the quaternion q and the angular velocity in its own axes."""
    q = np.asarray(q, float) / np.linalg.norm(q)
    R = np.array(_R(q).tolist(), float)
    L = np.array(_L(q).tolist(), float)
    arm = contact(R.T[:, 2])
    J = np.array([parameters[name] for name in ("I1", "I2", "I3")])
    v = -R @ np.cross(omega, arm)
    return (np.concatenate([[0, 0, -(R @ arm)[2]], q]),
            np.concatenate([parameters["m"] * v, 2 * L.T @ (J * omega)]))


DISC = {"m": 1.0, "I1": 0.25, "I2": 0.25, "I3": 0.5, "gravity": 9.81, "gamma": 1 / 3}


def disc_state():
    """Return a start of the disc that leans, rolls and spins."""
    return rolling_state(DISC, [np.cos(0.6), np.sin(0.6), 0, 0], np.array([0.3, 0.5, 3.0]),
                         lambda u: -np.array([u[0], u[1], 0]) / np.hypot(u[0], u[1]))


@cache
def skate_chain() -> System:
    """A skate that pulls a pendulum of a rod: g, which the reaction of the skate turns, and A."""
    x, y, th, u, v = q = sp.symbols("x y th u v", real=True)
    p = sp.symbols("px py pth pu pv", real=True)
    vx, vy, *_ = rates = sp.symbols("vx vy vth vu vv", real=True)
    m, inertia, k = sp.symbols("m I k", positive=True)
    H = (p[0]**2 + p[1]**2) / (2 * m) + p[2]**2 / (2 * inertia) + (p[3]**2 + p[4]**2) / 2 \
        + v + y / 2 + (u**2 + v**2 + k * (th**2 + u * th)) / 2
    rod = (u - x - sp.cos(th) / 2)**2 + (v - y - sp.sin(th) / 2)**2 - 1
    return System(q, p, (m, inertia, k), H, (rod,), name="skate_chain", velocities=rates,
                  velocity_constraints=(-sp.sin(th) * vx + sp.cos(th) * vy,))


SKATE_CHAIN = {"m": 2.0, "I": 0.7, "k": 1.5}
#: The rod is horizontal, and nothing moves against it or sideways.
SKATE_CHAIN_START = (np.array([0.0, 0.0, 0.0, 1.5, 0.0]), np.array([1.6, 0.0, 0.35, 0.8, 0.4]))


def _rattleback_parameters():
    """Return Kane and Levinson's data, with the moments about principal axes."""
    A, B, C, D = 0.0002, 0.0016, 0.0017, -0.00002
    half = np.arctan2(2 * D, A - B) / 2  # the angle of the axes from the ellipsoid's
    (I1, I2), axes = np.linalg.eigh(np.array([[A, D], [D, B]]))
    angle = np.arctan(axes[1, 0] / axes[0, 0])
    assert abs(np.sin(2 * (half - angle))) < 1e-12
    return {"m": 1.0, "I1": I1, "I2": I2, "I3": C, "gravity": 9.81, "gamma": (I1 + I2 + C) / 3,
            "a": 0.2, "b": 0.03, "c": 0.02, "h": 0.01, "ce": np.cos(angle), "se": -np.sin(angle)}


RATTLEBACK = _rattleback_parameters()


def rattleback_contact(u):
    """Return the contact of the rattleback in its own axes."""
    ce, se = RATTLEBACK["ce"], RATTLEBACK["se"]
    turn = np.array([[ce, se, 0], [-se, ce, 0], [0, 0, 1]])
    M = turn.T @ np.diag([0.2**2, 0.03**2, 0.02**2]) @ turn
    return -M @ u / np.sqrt(u @ M @ u) + np.array([0, 0, 0.01])


def rattleback_state(degrees=0.5, spin=-5.0):
    """Return a start that leans and spins the wrong way round."""
    tilt = np.radians(degrees)
    return rolling_state(RATTLEBACK, [np.cos(tilt / 2), np.sin(tilt / 2), 0, 0],
                         np.array([0, 0, spin]), rattleback_contact)


@cache
def transmission() -> System:
    """Two oscillators that a pendulum couples: a continuously variable transmission.

    The constraint does not act on the pendulum (Modin, Verdier 2020); k turns its potential into
    one without a mirror.
    """
    (x, y, s), p = sp.symbols("x y s", real=True), sp.symbols("px py ps", real=True)
    vx, vy, _ = v = sp.symbols("vx vy vs", real=True)
    k = sp.Symbol("k", real=True)
    H = sum(e**2 for e in p) / 2 + (x**2 + y**2) / 2 - sp.cos(s) + k * sp.sin(2 * s)
    return System((x, y, s), p, (k,), H, name="transmission", velocities=v,
                  velocity_constraints=(vy - sp.sin(s) * vx,))
