"""Energy, constraints, residual and Jacobian of a compiled stepper at a state; no step is taken."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_flag
from ...core.arrays import Array
from ...core.errors import GyrosparkError, InputError
from ...core.event import Event, Impact
from ...core.exact_numbers import Number
from ...core.frozen_dict import NO_PARAMETERS
from ...core.incompatibilities import refuse_together
from ...core.manifest import Manifest
from ...core.projection import Projection, project, report
from ...core.real_types import REALS, RealName
from ...core.records import FixedAttributes
from ...core.shapes import Shape
from ...core.start import HasStart
from ...engine.amalgamate import complete
from ..bindings.array_checks import as_real, as_step
from ..bindings.binding import REASONS, Binding, CompiledConstraints
from ..bindings.run_memory import ParameterStruct
from ..compilation.body_columns import built_inertias
from ..compilation.manifest import read_manifest
from ..compilation.stepper_module import load_module
from ..integration.consistency import stand_in_values
from ..integration.manifest_symmetries import Symmetry, symmetries_of
from ..integration.run_arguments import ParameterCheck, step_argument, warn_of_negative
from ..integration.starts import merged_start

__all__ = ["Evaluation"]


class Evaluation(FixedAttributes):
    """Compiled functions of states: H, velocities, constraints; the base of ``Stepper``."""

    _CURE = "gyrospark.stepper(...) makes another one, and a run takes what it may change"

    name: str
    files: dict[str, str]
    manifest: Manifest
    binding: Binding
    n: int
    m: int
    unknowns: int
    parameter_domains: Mapping[str, str]
    symmetries: tuple[Symmetry, ...]
    #: Shapes of bodies by their names, where its model has some; "" is the ground.
    visuals: Mapping[str, Sequence[Shape]]
    #: Returns parameters as numbers, or raises InputError.
    check_parameters: ParameterCheck

    def __init__(self, name: str, files: dict[str, str]) -> None:
        """Load the compiled module of the generated files, and read their manifest."""
        self.name = name
        self.files = complete(files)
        self.manifest = read_manifest(name, self.files)
        self.binding = self._bind(load_module(name, self.files))
        self._lanes_binding: list[Binding] = []
        self.n, self.m = self.binding.shown, self.binding.m
        self.unknowns = self.binding.unknowns
        self.parameter_domains = self.manifest.system.parameters
        self.symmetries = symmetries_of(self.manifest)
        self._inertias = built_inertias(self.manifest.system)
        self.check_parameters = ParameterCheck(self.parameter_domains, self.binding.number,
                                               self.symmetries, self._inertias)
        self.visuals = {}
        #: Events and impacts of the runs of its model, which steps from q and p leave out.
        self._model_events: Sequence[Event | Impact] = ()

    @property
    def _binding_of_many(self) -> Binding:
        """Calls for many trajectories; lanes are compiled when they are first asked for.

        Structs that are passed to it must be made by it: those of ``binding`` have another type.
        """
        if not self.binding.lanes:
            return self.binding
        if not self._lanes_binding:  # two threads may both load it; the first one's stays
            self._lanes_binding.append(
                self._bind(load_module(self.name, self.files, "lanes")))
        return self._lanes_binding[0]

    def _bind(self, module: Any) -> Binding:
        """Return the calls of a loaded module on arrays of this stepper's numbers."""
        return _binding_type(self.manifest.real)(module, self.name, self.manifest)

    # ------------------------------------------------------------ what a step solves

    def residual(
        self, x: ArrayLike, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        dt: Number | None = None, dtau: Number | None = None,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> Array:
        """Return r(x), shape (unknowns,): (B.1) of the paper for SPARK, (53) or (61) for IMS, EMS.

        ``x`` has the rates k, k̂ and multipliers Λ of the stages, of IMS and EMS the state (q, p)
        at the end of the step and λ; ``guess`` returns one. ``t`` is the time at the start of the
        step, ``dtau`` its length in scaled time.
        """
        self._refuse_unless_solving("residual")
        step = self._step_of(dt, dtau)
        state, compiled_parameters = self._at_start(start, p, parameters, t)
        return self.binding.residual(compiled_parameters, step, *state,
                                     self._increment(x, *state), self.binding.work())

    def jacobian(
        self, x: ArrayLike, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        dt: Number | None = None, dtau: Number | None = None,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> Array:
        """Return ∂r/∂x, shape (unknowns, unknowns)."""
        self._refuse_unless_solving("Jacobian")
        step = self._step_of(dt, dtau)
        state, compiled_parameters = self._at_start(start, p, parameters, t)
        return self.binding.jacobian(compiled_parameters, step, *state,
                                     self._increment(x, *state), self.binding.work())

    def guess(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        dt: Number | None = None, dtau: Number | None = None,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> Array:
        """Return the x from which a step's iteration starts."""
        self._refuse_unless_solving("starting guess")
        step = self._step_of(dt, dtau)
        state, compiled_parameters = self._at_start(start, p, parameters, t)
        x = self.binding.guess(compiled_parameters, step, *state, self.binding.work())
        return x + self._origin(*state)

    def _refuse_unless_solving(self, feature: str) -> None:
        """Raise InputError where steps solve no equations; ``feature`` is what was asked for."""
        if not self.binding.solves:
            raise InputError(f"{self.name} has no {feature}: its steps are compositions of exact "
                             "flows; take a stepper of scheme G-L for one.")

    # ------------------------------------------------------------ about a state

    def energy(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | ArrayLike | None = None,
        of_motion: bool = False,
    ) -> Array:
        """Return H(q, p, t) in the stepper's own representation, at a start or at states (q, p).

        Leading axes are kept. ``t``, which matters where H has it, is one time for all states, or
        one for each; by default that of the start, 0 for arrays.

        With ``of_motion`` it is the energy of the motion, H(q, Pp, t): P projects p along g_qᵀ onto
        f = 0, f = g_q H_p (+ g_t). For an H quadratic in p and f = g_q H_p, with W = g_q H_pp g_qᵀ,

            H(q, p) = H(q, Pp) + ½ fᵀ W⁻¹ f,

        where ½ fᵀ W⁻¹ f is a kinetic energy off the constraints that the body does not have:
        (qᵀp)²/8γ, or (qᵀp)²/8α, of one rigid body. Schemes that keep f = 0 have no difference.
        Where p cannot be projected, the result is NaN.
        """
        state = merged_start(self, start, p, parameters, t, impacts=True)
        shape, q_rows, p_rows = self._state_rows(state.q, state.p)
        times, values = self._times(state.t, shape), self._parameters(state.parameters)
        q_rows, p_rows = self.binding.in_scaled_time(values, q_rows, p_rows, times)
        unprojected = []  # rows whose momenta Newton's method cannot project; their H is NaN
        if as_flag("of_motion", of_motion) and self.m:
            for i, row in enumerate(p_rows):
                at_row = values if not self.binding.is_timed else self._parameters(
                    state.parameters, times[i])
                # moves the momenta of the row in place; a copy of q stays on its constraints
                if self.binding.project(at_row, q_rows[i].copy(), row):
                    unprojected.append(i)
        H = self.binding.hamiltonian(values, q_rows, p_rows, times)
        H[unprojected] = math.nan
        return H.reshape(shape)

    def momenta(
        self, q: ArrayLike, v: ArrayLike, /, *, parameters: Mapping[str, Number] = NO_PARAMETERS,
        t: Number | ArrayLike = 0.0,
    ) -> Array:
        """Return the momenta p = L_v(q, v, t) of velocities, of a system from its Lagrangian.

        Leading axes are kept; ``t``, which matters where L has it, is one time for all states, or
        one for each. On constraints velocities satisfy g_q v + g_t = 0: ``integrate`` names the
        constraints where they do not, ``project`` moves the momenta so that they do.

        Raises
        ------
        InputError
            For a system that was given by its H.
        """
        self._refuse_unless_lagrangian("momenta")
        shape, q_rows, v_rows = self._state_rows(q, v, "v")
        p = self.binding.momenta(self._parameters(parameters), q_rows, v_rows,
                                 self._times(t, shape))
        return p.reshape(*shape, self.n)

    def velocities(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | ArrayLike | None = None,
    ) -> Array:
        """Return the velocities v = H_p(q, p, t): the inverse of ``momenta``, with its errors."""
        self._refuse_unless_lagrangian("velocities")
        state = merged_start(self, start, p, parameters, t, impacts=True)
        shape, q_rows, p_rows = self._state_rows(state.q, state.p)
        v = self.binding.velocities(self._parameters(state.parameters), q_rows, p_rows,
                                    self._times(state.t, shape))
        return v.reshape(*shape, self.n)

    def _refuse_unless_lagrangian(self, feature: str) -> None:
        """Raise InputError where velocities are not known; ``feature`` is what was asked for."""
        if not self.manifest.system.velocity_names:
            raise InputError(f"{self.name} has no {feature}: its system was given by its "
                             "Hamiltonian; System.from_lagrangian makes one that knows them.")

    def quantities(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | ArrayLike | None = None,
    ) -> dict[str, Array]:
        """Return each quantity of the system at a start or at states (q, p), as ``energy`` does.
        """
        state = merged_start(self, start, p, parameters, t, impacts=True)
        shape, q_rows, p_rows = self._state_rows(state.q, state.p)
        compiled_parameters, times = self._parameters(state.parameters), self._times(state.t, shape)
        values = self.binding.quantities(compiled_parameters, times, *self.binding.in_scaled_time(
            compiled_parameters, q_rows, p_rows, times))
        return {name: values[:, i].reshape(shape)
                for i, name in enumerate(self.binding.quantity_names)}

    def defects(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> tuple[Array, Array]:
        """Return g(q, t) and the constraint on the momenta (qᵀp for a body), m entries each.

        With velocity constraints the second array ends with A H_p + a.
        """
        (q, p), compiled_parameters = self._at_start(start, p, parameters, t, has_searches=True)
        g, f = self.binding.defects(compiled_parameters, q[None], p[None])
        return g[0], f[0]

    def project(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> tuple[Array, Array]:
        """Return the state moved onto the constraints: q/|q| and p without its part along q.

        In general q moves along g_qᵀ onto g = 0, then p along g_qᵀ onto g_q H_p = 0, or
        g_q H_p + g_t = 0 at the time ``t`` where constraints depend on it. With velocity
        constraints p moves along g_qᵀ and Aᵀ, onto A H_p + a = 0 too.
        """
        state, compiled_parameters = self._at_start(start, p, parameters, t, has_searches=True)
        q, momenta = self._project(*state, compiled_parameters)
        return q[: self.n], momenta[: self.n]

    def consistent(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> Projection:
        """Project as ``project`` does; return the state with a report of the moves.

        The report's numbers are floats: |g| and the momentum constraint before and after by the
        constraints' names, and the coordinate and the momentum that moved furthest. To print it
        is to read it.

        Raises
        ------
        InputError
            Where it cannot be done, with the names of the constraints that are in the way.
        """
        (q0, p0), compiled_parameters = self._at_start(start, p, parameters, t, has_searches=True)
        q1, p1 = self._project(q0, p0, compiled_parameters)
        # in scaled time the last coordinate is t
        numeric = CompiledConstraints(self.binding, self.manifest, compiled_parameters, q0[-1])
        # three rows: the start; the projected q with the p of the start, whose f is the one before
        # the projection of p; the projected state
        states = np.stack([q0, q1, q1]), np.stack([p0, p0, p1])
        g, f = self.binding.defects(compiled_parameters, *map(np.ascontiguousarray, states))
        before, after = ((q[: self.n], p[: self.n]) for q, p in ((q0, p0), (q1, p1)))
        return report(numeric, before, after, (g[0], g[1]), (f[1], f[2]))

    def _project(self, q: Array, p: Array, parameters: ParameterStruct) -> tuple[Array, Array]:
        """Return the state (q, p) on the constraints, as ``project`` describes, or raise an error.

        Compiled code iterates first. Where it fails, damped steps from Python converge from farther
        away and name the constraints that cannot hold; they are for doubles, and for systems
        without velocity constraints, alone.
        """
        # C moves them in place
        q_near, p_near = q.copy(), p.copy()
        status = self.binding.project(parameters, q_near, p_near)
        if not status:
            return q_near, p_near
        if self.binding.dtype is not np.float64 or self.binding.rows:
            raise GyrosparkError(f"The state {q}, {p} cannot be projected: {REASONS[status]}; give "
                                 "a nearer one.")
        with np.errstate(all="ignore"):
            constraints = CompiledConstraints(self.binding, self.manifest, parameters, q[-1])
            projection = project(constraints, q[: self.n], p[: self.n])
        return projection.q, projection.p

    # ------------------------------------------------------------ inside

    def _refuse_scaled(self, **features: str) -> None:
        """Refuse features without a derivation for scaled time."""
        refuse_together(scaled=self.binding.clocked and f"the time_scale of {self.name}",
                        **features)

    def _state(self, q: ArrayLike, p: ArrayLike) -> tuple[Array, Array]:
        """Return checked copies of q and p of one state, shapes (n,), in the stepper's type."""
        as_array = self.binding.array
        try:
            return as_array("q", q, (self.n,)), as_array("p", p, (self.n,))
        except InputError as error:
            if np.asarray(q, dtype=object).ndim != 2:
                raise
            raise InputError(f"{error} Many starts at once, a row each, are integrated by "
                             "integrate_ensemble; other functions take one at a time.") from None

    def _state_rows(
        self, q: ArrayLike, p: ArrayLike, second: str = "p"
    ) -> tuple[tuple[int, ...], Array, Array]:
        """Return the leading axes of q and p, and both as rows, shape (states, n).

        ``second`` is the name of p in messages.
        """
        q_rows, p_rows = self.binding.numbers("q", q), self.binding.numbers(second, p)
        shape = q_rows.shape
        if shape[-1:] != (self.n,) or p_rows.shape != shape:
            raise InputError(f"q and {second} have shapes {shape} and {p_rows.shape}; "
                             f"give (..., {self.n}) for both.")
        q_rows, p_rows = (self._cast(a).reshape(-1, self.n) for a in (q_rows, p_rows))
        return shape[:-1], q_rows, p_rows

    def _times(self, t: Number | ArrayLike, shape: tuple[int, ...]) -> Array:
        """Return a time for each of the states with leading axes ``shape``, as one axis."""
        times = self.binding.numbers("t", t)
        if times.shape not in ((), shape):
            raise InputError(f"t has shape {times.shape}; give one time, or shape {shape}.")
        return self._cast(np.broadcast_to(times, shape)).reshape(-1)

    def _cast(self, numbers: Array) -> Array:
        """Return a copy in the stepper's number type; numbers beyond its range become infinite."""
        return self.binding.to_real(numbers)

    def _step_of(self, dt: Number | None, dtau: Number | None) -> Any:
        """Return the checked step: dt, or dtau in scaled time."""
        return self._step(step_argument(self.binding, dt, dtau), scaled=True)

    def _step(self, dt: Number, *, scaled: bool = False) -> Any:
        """Return a usable step, which in scaled time is Δτ of a caller that takes it."""
        if self.binding.clocked and not scaled:
            raise InputError(
                f"{self.name} takes steps of the scaled time τ: integrate, with tangents and "
                "gradients, integrate_ensemble, start, section, fit, tune, certify and sweep have "
                "dtau in place of dt; for all else take a stepper of the system without "
                "time_scale.")
        return as_step(dt, self.binding.number, "dtau" if self.binding.clocked else "dt")

    def _parameters(self, parameters: Mapping[str, Number], t: Number = 0.0) -> Any:
        """Return checked parameters and the time as the struct of the C."""
        number = self.binding.number
        values = self.check_parameters(parameters)
        warn_of_negative(values)
        return self.binding.parameters(values, as_real("t", t, number))

    def _at_start(
        self, start: Any, p: Any, parameters: Any, t: Any, *, has_searches: bool = False
    ) -> tuple[tuple[Array, Array], Any]:
        """Return the state (q, p) and the C struct of the parameters at its time.

        ``start`` is a start or, with ``p``, coordinates. In scaled time the state has t and −H in
        addition. ``has_searches``: a model may leave γ, α and the rates of a frame to searches, for
        constraints do not depend on them.
        """
        start_numbers = merged_start(self, start, p, parameters, t, impacts=True, as_it_is=True)
        time, state = start_numbers.t, self._state(start_numbers.q, start_numbers.p)
        numbers = start_numbers.parameters
        if has_searches and isinstance(numbers, Mapping):
            numbers = stand_in_values(numbers)
        compiled_parameters = self._parameters(numbers, time)
        return (self.binding.start_in_scaled_time(compiled_parameters, *state, time),
                compiled_parameters)

    def _increment(self, x: ArrayLike, q: Array, p: Array) -> Array:
        """Return the unknowns of the C: x of the caller, shape (unknowns,), less its origin."""
        return self.binding.array("x", x, (self.unknowns,)) - self._origin(q, p)

    def _origin(self, q: Array, p: Array) -> Array:
        """Return x minus the unknowns of the C, shape (unknowns,).

        IMS and EMS solve for increments, and their x is the end of the step, (q, p) + increments;
        other schemes have origin 0.
        """
        origin = self.binding.new(self.unknowns)
        if self.manifest.scheme.unknowns_are_state:
            origin[: 2 * self.binding.n] = np.concatenate([q, p])
        return origin


def _binding_type(real: RealName) -> type[Binding]:
    """Return the class for a floating-point type; only float128 costs the import of mpmath."""
    if not REALS[real].in_mpmath:
        return Binding
    from ..bindings.binary128_binding import QuadBinding

    return QuadBinding
