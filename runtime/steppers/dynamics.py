"""Accelerations, inverse dynamics and mass matrices of a stepper's system at states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_items, as_mapping, as_text, few, shown, unknown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.exact_numbers import Number
from ...core.start import HasStart
from ..bindings.array_checks import as_numbers
from ..compilation.stepper_module import load_module
from ..integration.run_arguments import StartNumbers
from ..integration.starts import after_start, merged_start
from .differentiation import Differentiation

if TYPE_CHECKING:
    from ..derivatives.motion import Accelerations, MotionBinding, StateMotion

__all__ = ["Dynamics"]

#: Relative tolerance, in units of |G| |δq̈|, of G δq̈ = 0; and of ẏ(u) = its target, in units of ẏ.
_OFF = 1e-9


class Dynamics(Differentiation):
    """Methods of ``Stepper`` for forces and accelerations; compiled at the first use.
    """

    _motion: MotionBinding | None = None

    def accelerations(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        parameters: Mapping[str, Number] | None = None, t: Number | ArrayLike | None = None,
    ) -> Accelerations:
        """Return d²q/dt², dp/dt and the multipliers of states on the constraints.

            q̇ = H_p,   ṗ = F − H_q − g_qᵀ λ,   d/dt (g_q H_p + g_t) = 0,
            q̈ = H_pq q̇ + H_pp ṗ + H_pt

        They are exact but for rounding, without differences. ``.joint(name)`` is the acceleration
        of a hinge or a slide, ``.body(name)`` that of a body and the rate of its angular velocity,
        ``.quantities[name]`` the rate of a quantity. Cylindrical joints and screws count as hinges,
        or as slides where the system has the quantity NAME_speed and no NAME_rate. MuJoCo's
        ``qacc`` and the result of Pinocchio's ``aba`` are the rates of their velocities: for hinges
        and slides the accelerations of ``.joint(name)``, for a ball the rate of an angular velocity
        and not d²q/dt² of a quaternion.

        Parameters
        ----------
        start : Start, or array_like of shape (..., n)
            A start as of ``integrate``, or q followed by p: states on the constraints, as
            ``integrate`` and ``project`` return them.
        p : array_like, shape (..., n), optional
        parameters : mapping
            Values that replace those of the start; the two together have all parameters and inputs.
        t : number or array_like, shape (...)
            One time for all states, or one for each; by default that of the start, 0 for arrays.

        Raises
        ------
        InputError
            Where constraints depend on each other, so that multipliers are not determined; for
            steppers of flows, and systems with velocity constraints.
        """
        from ..derivatives.motion import Accelerations, StateMotion

        state = merged_start(self, start, p, parameters, t, impacts=True)
        shape, q_rows, p_rows = self._state_rows(state.q, state.p)
        times, values = self._times(state.t, shape), self._values(state.parameters)
        motions = tuple(StateMotion(self._motion_binding(), values, *row)
                        for row in zip(times, q_rows, p_rows, strict=True))

        def rows(name: str, width: int) -> Array:
            """Return an attribute of the motion at each state, shape (*leading axes, width)."""
            arrays = np.array([getattr(motion, name) for motion in motions], self.binding.dtype)
            return arrays.reshape(*shape, width)

        # d/dt of quantities at each state, name → rate; [()] makes that of a single state a number
        rates = [motion.quantity_rates() for motion in motions]
        return Accelerations(
            q=rows("acceleration", self.n), p=rows("p_rate", self.n), velocities=rows("v", self.n),
            multipliers=rows("multipliers", self.m),
            quantities={name: np.array([rate[name] for rate in rates]).reshape(shape)[()]
                        for name in self.binding.quantity_names},
            _layout=self._motion_binding().layout, _parameters=values, _states=q_rows)

    def mass_matrix(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
        joints: str | Sequence[str] | None = None, parameters: Mapping[str, Number] | None = None,
        t: Number | None = None,
    ) -> Array:
        """Return the mass matrix M at a state: of its coordinates, or of joints.

        Of coordinates it is H_pp⁻¹, shape (n, n), and ½ q̇ᵀ M q̇ the kinetic energy. In directions
        off the constraints it is that of the representation: a quaternion has 4γ, or 4α, along q.

        Of joints with the rates C q̇ it is M = (C Π Cᵀ)⁻¹ with
        Π = H_pp − H_pp g_qᵀ (g_q H_pp g_qᵀ)⁻¹ g_q H_pp, free of γ: torques τ on them add M⁻¹ τ to
        their accelerations, and joints that are not named move freely. Of all joints of a tree it
        is the mass matrix of MuJoCo (``mj_fullM``) and of Pinocchio (``crba``). In doubles,
        whatever the stepper's type.

        Parameters
        ----------
        start : Start, or array_like of shape (n,)
            A start as of ``integrate``, or q followed by p.
        p : array_like, shape (n,), optional
        joints : str or sequence of str, optional
            Hinges and slides, a row each as ``accelerations`` has it, and bodies: six rows of one
            that moves freely, for the velocity of its centre of mass and ω in space axes; three of
            one that turns about a held point. A name of both is the joint's.
        parameters, t
            As of ``accelerations``.

        Raises
        ------
        InputError
            For unknown names, with the known ones; for rates that depend on each other; where H_pp
            is singular; what ``accelerations`` raises.
        """
        from ..derivatives.motion import joint_inertia

        motion = self._state_motion(merged_start(self, start, p, parameters, t, impacts=True))
        if joints is not None:
            return joint_inertia(motion, self._names("joints", joints))[0]
        H_pp = motion.inverse_mass()
        # beyond 1/eps the inverse would have no right digit; of bodies H_pp is singular along q for
        # γ → ∞ alone
        if np.linalg.cond(H_pp) * np.finfo(float).eps > 1:
            raise InputError(f"H_pp of {self.name} is singular at this state, so that velocities "
                             "do not determine momenta: there is no mass matrix of its "
                             "coordinates; name joints.")
        M = np.linalg.inv(H_pp)
        return (M + M.T) / 2

    def inverse_dynamics(
        self, start: HasStart | ArrayLike, /, *accelerations: Any,
        inputs: str | Sequence[str] | None = None,
        parameters: Mapping[str, Number] | None = None, t: Number | None = None,
    ) -> dict[str, Any] | Array:
        """Return the forces that must be added for given accelerations, or the inputs that do.

        ``inverse_dynamics(start, accelerations)`` or ``inverse_dynamics(q, p, accelerations)``.
        The forces of the system act too, with the inputs that ``parameters`` has. MuJoCo calls
        this ``mj_inverse``, Pinocchio ``rnea``:

            τ = M (ẏ − ẏ(0)),   M the ``mass_matrix``, ẏ(0) the accelerations without τ

        y are the rates of the named joints and bodies, in the order of the rows of M; of all
        coordinates y = q̇.

        Parameters
        ----------
        start : Start, or q and p, array_like of shape (n,)
            A start as of ``integrate``.
        accelerations : mapping of str to number or array_like, or array_like of shape (n,)
            Those of joints and bodies by their names, each with as many numbers as it has rows in
            ``mass_matrix``; no force is added to others. Or d²q/dt² of all coordinates.
        inputs : str or sequence of str, optional
            Inputs of the system, as many as there are rows, whose values are wanted in place of
            forces on the joints. The forces must be linear in them.
        parameters, t
            As of ``accelerations``.

        Returns
        -------
        dict of str to float or array, or array
            Name → torque of a hinge in N m, force of a slide in N, force and torque on a body; name
            → input. Of coordinates the generalised forces Q, shape (n,), to which any g_qᵀ μ may be
            added.

        Raises
        ------
        InputError
            For accelerations that leave the constraints or that the inputs do not reach; what
            ``mass_matrix`` raises.
        """
        p, target_values = after_start("accelerations", accelerations)
        from ..derivatives.motion import joint_inertia

        state = merged_start(self, start, p, parameters, t, impacts=True)
        motion = self._state_motion(state)
        if not isinstance(target_values, Mapping):
            if inputs is not None:
                raise InputError("Inputs are found for accelerations of joints; give these by "
                                 "name, as in {'elbow': 0.5}.")
            return self._generalised_forces(motion, target_values)
        targets_by_name = as_mapping("accelerations", target_values, "{'elbow': 0.5}")
        if not targets_by_name:
            raise InputError("accelerations is empty; give those of joints or bodies, as in "
                             "{'elbow': 0.5}.")
        # ẏ(0), the accelerations without further forces
        M, accelerations_now = joint_inertia(motion, list(targets_by_name))
        targets = [_row(name, value, len(rows)) for (name, value), rows
                   in zip(targets_by_name.items(), accelerations_now, strict=True)]
        if inputs is not None:
            return self._solve_inputs(state, dict(zip(targets_by_name, targets, strict=True)),
                                      self._names("inputs", inputs))
        forces = M @ (np.concatenate(targets) - np.concatenate(accelerations_now))
        group_ends = np.cumsum([len(rows) for rows in accelerations_now])[:-1]
        return {name: float(force[0]) if len(force) == 1 else force
                for name, force in zip(targets_by_name, np.split(forces, group_ends), strict=True)}

    # ------------------------------------------------------------ inside

    def _generalised_forces(self, motion: StateMotion, accelerations: ArrayLike) -> Array:
        """Return Q = H_pp⁻¹ (q̈ − q̈(0)), shape (n,), the forces that change q̈(0) to q̈.

        Raises InputError where q̈ leaves the constraints: d²g/dt² = 0 requires G (q̈ − q̈(0)) = 0.
        """
        q_dd = as_numbers("accelerations", accelerations).astype(float)
        if q_dd.shape != (self.n,):
            raise InputError(f"accelerations has the shape {q_dd.shape}; give a dict of joints, "
                             f"or an entry for each of {self.n} coordinates.")
        q_dd_now = motion.acceleration.astype(float)
        delta_q_dd, G = q_dd - q_dd_now, motion.constraint_jacobian()
        # Σ|G_ij| (|q̈| + |q̈(0)|) bounds the terms of row i, which cancel up to round-off
        bound = np.abs(G).sum(axis=1) * (np.abs(q_dd).max() + np.abs(q_dd_now).max())
        off = np.abs(G @ delta_q_dd) > _OFF * bound
        if off.any():
            raise InputError("These accelerations leave the constraints "
                             f"{few(np.array(self.constraint_names)[off])}; give those of joints, "
                             "or such as keep d²g/dt² = 0.")
        Q: Array = np.linalg.solve(motion.inverse_mass(), delta_q_dd)
        return Q

    def _solve_inputs(
        self, state: StartNumbers, targets: Mapping[str, Array], names: Sequence[str]
    ) -> dict[str, Any]:
        """Return the values of inputs u with ẏ(u) = the targets, name → number.

        ẏ(u) = ẏ(0) + S u if forces are linear in the inputs, with the columns S_k = ẏ(e_k) − ẏ(0).
        Raises InputError where ẏ(u) is off the targets: S is singular, or ẏ is not linear.
        """
        for name in names:
            if name not in self.binding.input_names:
                raise unknown("input", name, self.binding.input_names or ["none: it has no inputs"])

        def accelerations_with(values: ArrayLike) -> Array:
            """Return the accelerations with these values of the inputs."""
            inputs = dict(zip(names, map(float, np.asarray(values)), strict=True))
            motion = self._state_motion(replace(state, parameters={**state.parameters, **inputs}))
            return np.concatenate([motion.rate(name).y_rate for name in targets])

        target, base = np.concatenate([*targets.values()]), accelerations_with(np.zeros(len(names)))
        if len(target) != len(names):
            raise InputError(f"{len(names)} inputs cannot be found for {len(target)} "
                             "accelerations; give as many of one as of the other.")
        slopes = np.stack([accelerations_with(unit) - base for unit in np.eye(len(names))], axis=1)
        try:
            values = np.linalg.solve(slopes, target - base)
        except np.linalg.LinAlgError:
            values = np.full(len(names), np.nan)
        # ẏ at the solution says whether it is one: singular or nonlinear ones miss the targets
        size = np.abs(target).max() + np.abs(base).max()
        with np.errstate(invalid="ignore"):
            off_target = not np.isfinite(values).all() or np.abs(
                accelerations_with(values) - target).max() > _OFF * size
        if off_target:
            raise InputError(f"No values of {', '.join(names)} give these accelerations: their "
                             "forces do not act on the joints one by one, or are not linear in "
                             "them; leave out inputs for the forces on the joints.")
        return dict(zip(names, values.tolist(), strict=True))

    def _names(self, label: str, name_or_names: Any) -> list[str]:
        """Return one name or several as a list; InputError for none and for a repeated one."""
        names = [name_or_names] if isinstance(name_or_names, str) else [
            as_text(f"an entry of {label}", x) for x in as_items(label, name_or_names, "names")]
        if not names or len({*names}) < len(names):
            raise InputError(f"{label} = {shown(name_or_names)} must name one or more, each once.")
        return names

    def _state_motion(self, start: StartNumbers) -> StateMotion:
        """Return the accelerations at a state, with the functions that joints and bodies need."""
        from ..derivatives.motion import StateMotion

        state, values = self._state(start.q, start.p), self._values(start.parameters)
        (time,) = self._times(start.t, ())
        return StateMotion(self._motion_binding(), values, time, *state)

    def _values(self, parameters: Mapping[str, Number]) -> dict[str, Any]:
        """Return the checked parameters, with rates of the frame 0: q̈ is taken in space."""
        values = dict(self.check_parameters(parameters))
        at_rest = self.binding.number(Fraction(0))
        return values | {symmetry.name: at_rest for symmetry in self.symmetries}

    def _motion_binding(self) -> MotionBinding:
        """Calls of accelerations, derived and compiled when first called."""
        from ..derivatives.motion import MotionBinding

        self._refuse_scaled(accelerations="accelerations, mass matrices and inverse dynamics")
        if not self.binding.solves:
            self._refuse_unless_solving("accelerations")
        with self._deriving:
            if self._motion is None:
                module = load_module(self.name, self._derivative_files(), "motion")
                self._motion = MotionBinding(self._bind(module), self.manifest)
        return self._motion


def _row(name: str, acceleration: Any, width: int) -> Array:
    """Return the acceleration of a joint or a body as ``width`` finite doubles, shape (width,).

    A joint with one degree of freedom has width 1; wider rows have dv/dt and dω/dt in space axes.
    """
    row = as_numbers(f"accelerations[{name!r}]", acceleration).astype(float)
    if row.shape not in ((width,), ()) or row.size != width or not np.isfinite(row).all():
        raise InputError(f"accelerations[{name!r}] = {shown(acceleration)} is not {width} finite "
                         f"number{'s' * (width > 1)}"
                         + (": a velocity's and ω's, in space axes." if width > 1 else "."))
    return row.reshape(width)
