"""Fits: parameters and start of a motion from measured data, by least squares with exact tangents.

The residuals r are predictions less data. Each iteration integrates once with the tangents of the
start and of all free parameters, so that J = ∂r/∂(θ, y) is exact, and takes a step of
Levenberg and Marquardt. The start moves in coordinates y of the tangent space of the constraints,
z = consistent(z0 + B y). Over a long horizon the phase of a fast motion is ambiguous: the first
samples, about as many as determine all unknowns, are fitted first, then twice as many, and so on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_items, check_stepper, shown, unknown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.exact_numbers import Number, as_double
from ...core.html import card, table
from ...core.progress import Progress, as_progress, log_progress
from ...core.start import HasStart, Rule
from ...core.start import Start as StateStart
from ...core.warnings import capture_warnings
from ..bindings.array_checks import as_numbers, as_positive_count, as_real
from ..bindings.inputs import InputRows, Inputs, as_inputs
from ..derivatives.kept_steps import refuse_run
from ..derivatives.tangent_run import tangents_of
from ..derivatives.tangent_space import Tangents
from ..integration.run_arguments import StartNumbers, step_argument
from ..integration.starts import merged_start
from ..rigid_body.gamma_rules import is_inertia_parameter
from .fit_coordinates import Coordinates
from .least_squares import (
    RANK,
    SHARE,
    Linear,
    Minimum,
    identify,
    minimise,
    reduced_basis,
    triangle,
)
from .observations import Observation, Observe, Residuals, observation_of

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["Fit", "fit"]

#: Fewest samples of the first horizon; each other has twice as many.
_FIRST = 4
#: Iterations of a horizon that is not the last, and where it ends.
_EARLY, _EARLY_TOLERANCE = 8, 1e-1
#: A step ends the last horizon when it is below 1e-4 of a standard deviation.
_TOLERANCE = 1e-8
#: How far a time may be from a whole number of steps, in steps.
_OFF_GRID = 1e-3
#: A user's derivatives are wrong if differences of values are off by this share of them.
_WRONG = 0.15


@explain_arguments
@dataclass(frozen=True)
class Fit:
    """Parameters and a start that fit data.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters, the fitted ones among them; without inputs that change.
    q, p : array, shape (n,)
        The start at ``t0``.
    names : list of str
        The fitted quantities: parameters, and start[0], start[1], … for the columns of ``basis``.
    covariance : array, shape (names, names)
        σ²(JᵀJ)⁺ of the estimates, in units of the parameters, over the determined directions; the
        ``undetermined`` ones are left out.
    sigma : dict of str to float
        One standard deviation of each name; infinite where the data determine a quantity to no
        better than its own size.
    undetermined : list of dict of str to float
        Combinations that the data do not determine, each as relative changes of parameters (of a
        parameter that is 0, the change itself) and of the "start" (the larger of |dq|/|q| and
        |dp|/|p|) that leave the predictions as they are: of a common factor all are 1. The values
        are then one choice of many.
    residuals : array, shape (samples, C)
        Predictions less data; of an attitude three columns, 2 sin(θ/2) n of the rotation by θ about
        n from the measured one, in axes of the body: in rad for small angles.
    rms : float
        Root mean square of the residuals.
    truncation : float
        Root mean square of prediction(dt/2) − prediction(dt): a fit can be no better than this.
    basis : array, shape (2 n, k)
        Directions of (q, p) along which start[0], start[1], … are measured.
    horizons : list of int
        The numbers of samples that were fitted one after the other.
    iterations : int
        Runs with tangents that were accepted, of all horizons.
    converged : bool
        Whether the last horizon ended at a minimum, not at ``max_iterations``.
    """

    parameters: dict[str, float]
    q: Array
    p: Array
    names: list[str]
    covariance: Array
    sigma: dict[str, float]
    undetermined: list[dict[str, float]]
    residuals: Array
    rms: float
    truncation: float
    basis: Array
    horizons: list[int]
    iterations: int
    converged: bool

    def __repr__(self) -> str:
        """Return how good the fit is, and a line for each parameter with its deviation."""
        samples, columns = self.residuals.shape
        state = "" if self.converged else ", not converged"
        lines = [f"<Fit of {samples} samples in {columns} columns: rms {self.rms:.3g}, truncation "
                 f"{self.truncation:.1g}, {self.iterations} iterations{state}"]
        for name, sigma in self.sigma.items():
            if name in self.parameters:
                lines.append(f"  {name} = {with_sigma(self.parameters[name], sigma)}")
        starts = sum(name not in self.parameters for name in self.names)
        if starts:
            lines.append(f"  start: {starts} coordinates")
        for words, times in Counter(map(in_words, self.undetermined)).items():
            lines.append(f"  undetermined: {words}" + f" ({times} directions)" * (times > 1))
        return "\n".join(lines) + ">"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the parameters with standard deviations, and the report."""
        heading, *rows = repr(self)[1:-1].splitlines()
        return card(heading, table([row.strip().split(" = ", 1) for row in rows]))


def with_sigma(estimate: float, sigma: float) -> str:
    """Return an estimate and its standard deviation as "0.1234 ± 0.0012", sigma to two digits.

    The estimate alone, if sigma is 0; with "(not determined)", if sigma is infinite or NaN.
    """
    if not np.isfinite(sigma):
        return f"{estimate:.6g} (not determined)"
    if sigma == 0:
        return f"{estimate:.9g}"
    # the last digit of the estimate is the second one of sigma; a double has 15
    leading = np.floor(np.log10(abs(estimate) or sigma))
    digits = max(1, min(15, int(leading - np.floor(np.log10(sigma))) + 2))
    return f"{estimate:.{digits}g} ± {sigma:.2g}"


def in_words(combination: Mapping[str, float]) -> str:
    """Return an undetermined combination, name → relative change, in words."""
    # equal relative changes: a common factor, to which the data are blind
    if all(abs(weight - 1) < 1e-2 for weight in combination.values()):
        *names, last_name = combination
        return f"a common factor of {', '.join(names)} and {last_name}" if names else last_name
    return "relative changes " + ", ".join(
        f"{weight:+.3g} of {name}" for name, weight in combination.items())


@dataclass
class Point:
    """Parameters and a start; once it is linearised, the basis of its tangent space, and sizes.

    ``sizes`` are largest |q| and |p| of the samples, for each coordinate and momentum.
    """

    parameters: dict[str, float]
    q: Array
    p: Array
    basis: Array = field(default_factory=lambda: np.zeros((0, 0)))
    sizes: Array = field(default_factory=lambda: np.zeros(0))


class Fitting:
    """The data of a fit as functions of a point, over the first samples."""

    def __init__(
        self, step: Stepper, observation: Observation, run: RunArguments, sample_steps: Array,
        data: Array, sigma: Array, free: Sequence[str],
        clock: tuple[Any, Array] | None = None,
    ) -> None:
        """Keep the run and its measurements: ``data`` at the states after ``sample_steps`` steps.

        Shapes: sample_steps (samples,), data (samples, columns), sigma (1,) or (c,), c the number
        of residuals of a sample. ``free`` names the parameters to fit, and "start" if the start is
        fitted too. ``clock`` is t0 and the times of the samples, shape (samples,), in scaled time.
        """
        self.step, self.observation, self.run = step, observation, run
        self.sample_steps, self.data, self.sigma = sample_steps, data, sigma
        self.fits_start, self.free = "start" in free, [name for name in free if name != "start"]
        self.coordinates = Coordinates(step, self.free, run.parameters)
        self.samples = len(data)
        #: In scaled time the start's t, and the times of the samples, which lie between steps.
        self.clock = clock

    def arguments(self, point: Point, halvings: int = 0) -> tuple[RunArguments, Array]:
        """Return the run of the first samples, and the stored row of each of them.

        Its steps are Δt/2^halvings.
        """
        factor = 2**halvings
        # every = gcd of the samples' steps: the fewest stored rows that include all samples.
        sample_steps = self.sample_steps[: self.samples] * factor
        last_step = int(sample_steps[-1])
        every = max(1, int(np.gcd.reduce(sample_steps)))  # 0 of a single sample, at the start
        inputs = self.run.inputs
        if halvings and inputs is not None:
            inputs = inputs.refine(factor)  # each row is held for as many of the shorter steps
        binding = self.step.binding
        free_parameters = {name: as_real(name, point.parameters[name], binding.number)
                           for name in self.free}
        run = replace(self.run, q=binding.array("q", point.q, point.q.shape),
                      p=binding.array("p", point.p, point.p.shape), steps=last_step,
                      every=every, dt=self.run.dt / factor, inputs=inputs,
                      parameters=self.run.parameters | free_parameters)
        return run, sample_steps // every

    def states(self, point: Point, halvings: int = 0) -> tuple[Array, Array]:
        """Return q and p at the times of the samples, shape (samples, n) each."""
        if self.clock is not None:
            trajectory, sample_rows = self._in_scaled_time(point, halvings), np.arange(self.samples)
        else:
            run, sample_rows = self.arguments(point, halvings)
            trajectory = self.step._run(run)
        q, p = (np.asarray(x[sample_rows], dtype=float) for x in (trajectory.q, trajectory.p))
        return q, p

    def _in_scaled_time(
        self, point: Point, halvings: int = 0, tangents: Tangents | None = None
    ) -> Trajectory:
        """Return the states at the times of the samples, and their tangents at fixed times.

        The steps of τ are 2^``halvings`` times shorter than in the run of the fit.
        """
        assert self.clock is not None
        t0, times = self.clock
        # a second sample where there is one: the first may be at the start, which is no t_end
        last_sample = min(max(self.samples, 2), len(times)) - 1
        start = StateStart(point.q, point.p, self.run.parameters | point.parameters, t0)
        # each iteration would warn again; runs of constant steps warn of nothing here either
        with capture_warnings():
            return self.step.integrate(
                start, dtau=self.run.dt / 2**halvings, t_end=times[last_sample],
                t_eval=times[: self.samples], tangents=tangents)

    def residuals(self, point: Point, halvings: int = 0) -> Array:
        """Return residuals of the samples, shape (samples, c)."""
        return self._evaluate_residuals(point, *self.states(point, halvings)).values

    def _evaluate_residuals(self, point: Point, q: Array, p: Array) -> Residuals:
        """Return the residuals of the samples at their states q and p, (samples, n)."""
        return self.observation.residuals(
            self.data[: self.samples], q, p, self.run.parameters | point.parameters)

    def scaled_residuals(self, point: Point) -> Array:
        """Return residuals in standard deviations."""
        return (self.residuals(point) / self.sigma).ravel()

    def truncation(self, point: Point) -> float:
        """Return the root mean square of prediction(dt/2) − prediction(dt), in units of σ."""
        changes = (self.residuals(point, halvings=1) - self.residuals(point)) / self.sigma
        return float(np.sqrt(np.mean(changes**2)))

    def derivatives(self, point: Point) -> tuple[Array, Array]:
        """Return residuals, shape (samples, c), and their derivatives J, shape (samples, c, k).

            J = r_q dq + r_p dp + r_θ,   (dq, dp) the tangents of the motion at each sample

        The columns of J belong to the free parameters θ and then to the coordinates y of the start.
        Sets the basis and the sizes of ``point``.
        """
        q, p = self.states(point)
        r, by_q, by_p, by_parameters = self._evaluate_residuals(point, q, p)
        directions = Tangents(start="all" if self.fits_start else None, parameters=self.free)
        if self.clock is not None:
            tangents: Any = self._in_scaled_time(point, tangents=directions).tangents
            sample_rows = np.arange(self.samples)
        else:
            run, sample_rows = self.arguments(point)
            tangents = tangents_of(self.step, run, directions)
        dq, dp = (np.asarray(x[sample_rows], dtype=float) for x in (tangents.q, tangents.p))
        J = by_q @ dq + by_p @ dp
        starts = J.shape[2] - len(self.free)
        for column, name in enumerate(self.free, starts):
            J[:, :, column] += by_parameters.get(name, 0.0)
        point.basis = np.asarray(tangents.start[:, :starts], dtype=float)
        largest = [float(np.linalg.norm(x, axis=1).max()) or 1.0 for x in (q, p)]
        point.sizes = np.repeat(largest, self.step.n)
        # the tangents begin with the coordinates of the start, J with the parameters
        return r, J[:, :, [*range(starts, J.shape[2]), *range(starts)]]

    def linearise(self, point: Point) -> Linear:
        """Return residuals in standard deviations, linearised in the coordinates of a step."""
        r, J = self.derivatives(point)
        count = len(self.free)
        J = np.concatenate([J[:, :, :count] @ self.coordinates.jacobian(point.parameters),
                            J[:, :, count:]], axis=2)
        return self.scale_residuals(point, r, J, self.coordinates.units(point.parameters))

    def scale_residuals(self, point: Point, r: Array, J: Array, units: Array) -> Linear:
        """Return residuals in standard deviations, with the units of parameters and of the start.

        r, (samples, c), and J, (samples, c, k), become r/σ and J/σ, with a row for each entry of r.
        Each column of J has a unit: ``units`` for the parameters; the unit 1/|B_k/sizes| of a
        coordinate y_k of the start, B the ``basis`` of the point, changes the state by its size.
        """
        jacobian = (J / self.sigma[:, None]).reshape(-1, J.shape[2])
        relative = point.basis / point.sizes[:, None]
        units = np.concatenate([units, 1 / np.linalg.norm(relative, axis=0)])
        # a parameter that is 0 has no size: its unit has the largest effect of all others' units
        without_unit = ~np.isfinite(units)
        slopes = np.linalg.norm(jacobian, axis=0)
        largest_effect = np.max(slopes[~without_unit] * units[~without_unit], initial=0.0)
        own_slopes = slopes[without_unit]
        units[without_unit] = largest_effect / np.where(own_slopes > 0, own_slopes, 1.0)
        units[units == 0] = 1.0  # no unknown has an effect
        return Linear((r / self.sigma).ravel(), jacobian, units)

    def apply_step(self, point: Point, y: Array) -> Point:
        """Return the point after a step y: parameters θ(y), and z + B y on the constraints."""
        count = len(self.free)
        parameters = self.coordinates.apply_step(point.parameters, y[:count])
        z = np.concatenate([point.q, point.p])
        if self.fits_start:
            z = z + point.basis @ y[count:]
        return self.consistent(parameters, z[: self.step.n], z[self.step.n :])

    def consistent(self, parameters: dict[str, float], q: Array, p: Array) -> Point:
        """Return the point of parameters and of (q, p), projected onto the constraints."""
        # the constraints may depend on the parameters, which the step has changed
        if self.step.m:
            all_parameters = self.step._parameters_with_inputs(self.run.parameters, self.run.inputs)
            t = self.run.t0 if self.clock is None else self.clock[0]
            q, p = self.step.project(q, p, parameters=all_parameters | parameters, t=t)
        return Point(parameters, np.asarray(q, dtype=float), np.asarray(p, dtype=float))

    def fewest(self, point: Point) -> int:
        """Return the length of the first horizon: samples enough for more residuals than unknowns.

        Sets ``samples`` as a side effect; the fit sets it for each horizon.
        """
        self.samples = 1
        columns = int(self.residuals(point).shape[1])
        unknowns = len(self.free) + 2 * (self.step.n - self.step.m) * self.fits_start
        return max(_FIRST, math.ceil(unknowns / columns) + 1)

    def excess(self, point: Point, y: Array) -> float:
        """Return the length of the step y as a multiple of the longest step allowed."""
        return self.coordinates.excess(point.parameters, y[: len(self.free)])


def fit(
    stepper: Stepper, start: HasStart, /, t: ArrayLike, data: ArrayLike, *,
    dt: Number | None = None, dtau: Number | None = None,
    parameters: Mapping[str, Number] | None = None,
    inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
    observe: str | Sequence[str] | Observe = "attitude", free: Sequence[str] | None = None,
    fixed: Sequence[str] = (), sigma: ArrayLike | None = None,
    horizons: Sequence[int] | None = None, max_iterations: int = 50, progress: Progress = None,
) -> Fit:
    """Fit parameters and the start of a motion to data: minimise Σ ((prediction − data)/σ)².

    Parameters
    ----------
    stepper : Stepper
        It integrates the motion, and its tangents are the exact derivatives of that.
    start : Start
        A model, a problem, ``gs.Start(q, p, parameters, t)``: the start, a first guess of it where
        it is free, at a time not after ``t[0]``. It is moved onto the constraints.
    t : array_like, shape (N,)
        Times of the samples in seconds, increasing, each a whole number of steps from the start, to
        a thousandth of a step.
    data : array_like, shape (N, C)
        A row for each sample. Of attitudes unit quaternions from body to space axes, scalar first,
        of either sign; of angular velocities Ω in body axes, in rad/s.
    dt : float, optional
        Time step; by default the smallest distance of two samples.
    dtau : float
        In place of dt, of systems with ``time_scale``: the step of scaled time. Samples may then
        lie at any times.
    parameters : mapping
        As of ``integrate``; first guesses of the free ones. A γ that is not given keeps the mean
        of the first guess's moments: it changes no motion beyond truncation.
    inputs
        As of ``integrate``.
    observe : {"attitude", "angular_velocity", "q", "p"}, name, sequence of them, or callable
        What the columns of data are, in their order: the attitudes of all bodies, four columns
        each, or of one, "upper attitude"; the angular velocities, three columns each, as
        ``run.body().angular_velocity()`` has them, or "upper angular_velocity"; all coordinates or
        momenta; a coordinate or a momentum by name. A function
        of q and p, rows of states of shape (N, n), returns (values, by_q, by_p) of the shapes
        (N, C), (N, C, n) and (N, C, n): what the data measure, and its
        derivatives.
    free : sequence of str, optional
        Names of parameters, and "start". By default all but ``fixed``, inputs, γ and α.
    fixed : sequence of str
        Names of parameters that are not fitted.
    sigma : float or array_like, shape (C,), optional
        One standard deviation of the noise, of attitudes three numbers in rad. By default that of
        the residuals.
    horizons : sequence of int, optional
        Numbers of samples that are fitted one after the other; by default about as many as there
        are unknowns, twice as many, and so on up to all. ``[]``: all at once.
    max_iterations : int
        Of the last horizon.
    progress : callable or bool, optional
        As of ``integrate``; a function is called with the number of horizons done.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        For unknown names, with the nearest; for data of another shape, and for NaN; for times
        between steps.
    StepFailed
        When the first guess, or the fit of a shorter horizon, has a step without a solution.

    Notes
    -----
    Positive parameters are fitted by their logarithms. Three principal moments of a body are fitted
    as I_i = Σ_{j≠i} d_j², six entries of an inverse tensor as those of (tr(Σ) − Σ)⁻¹, Σ = LLᵀ, so
    that they are those of a body (Wensing, Kim, Slotine, IEEE Robot. Autom. Lett. 3, 2018); first
    guesses that are not are moved there. The start moves along the tangent space of the
    constraints, and is made consistent after each step.

    Examples
    --------
    >>> import gyrospark as gs, numpy as np
    >>> step = gs.stepper("G-L", 2)
    >>> top = gs.problems.fast_top()
    >>> true = top.parameters | {"gamma": 1.6e-3}
    >>> run = step.integrate(top.q0, top.p0, dt=1e-3, steps=64, every=2, parameters=true)
    >>> guess = true | {"I3": 1.1*true["I3"]}
    >>> found = gs.fit(step, top, run.t[1:], run.q[1:], parameters=guess, dt=1e-3,
    ...                free=["I3", "start"])
    >>> round(found.parameters["I3"], 12)
    0.0008
    """
    check_stepper(stepper)
    first_guess = merged_start(stepper, start, p=None, parameters=parameters)
    observation = observation_of(stepper, observe)
    iteration_limit = as_positive_count("max_iterations", max_iterations, minimum=1)
    as_progress(progress)
    t0 = as_real("t", first_guess.t, stepper.binding.number)
    times = _sample_times(t, float(t0))
    samples = observation.check_data(data, len(times))
    clocked = stepper.binding.clocked
    if clocked or dtau is not None:
        # samples lie between steps, whose number is not known: 1 stands for it
        step_size, sample_steps = step_argument(stepper.binding, dt, dtau), np.ones(1, int)
    else:
        step_size, sample_steps = _steps_at(times, float(t0), dt)
    free_names = _free_names(stepper, free, fixed)
    run = _first_run(stepper, first_guess, step_size, int(sample_steps[-1]), inputs)
    # The first point, sigma and the horizons follow from each other, by methods of ``fitting``: the
    # point is consistent by the run, sigma has an entry for each residual of a sample at the point,
    # and the first horizon has more residuals than unknowns. Without a sigma residuals have the
    # unit 1, and the noise is estimated from them.
    fitting = Fitting(stepper, observation, run, sample_steps, samples, sigma=np.ones(1),
                      free=free_names, clock=(t0, times) if clocked else None)
    point = _first_point(fitting)
    if sigma is not None:
        fitting.sigma = _sigma(sigma, fitting, point)
    counts = _horizons(horizons, len(times), fitting.fewest(point))
    fitting.samples = counts[0]
    if observation.function is not None:
        _refuse_wrong_derivatives(fitting, point)
    with log_progress(f"fitting {stepper.name}", len(counts), progress) as report:
        minimum = _minimise_horizons(fitting, point, counts, iteration_limit, report)
    return _result(fitting, minimum.point, minimum.iterations, counts, minimum.converged,
                   sigma_known=sigma is not None)


def _first_point(fitting: Fitting) -> Point:
    """Return the first guess in doubles: physical parameters, and a start on the constraints."""
    stepper, run = fitting.step, fitting.run
    # inputs that change have no one number
    changing = stepper.binding.input_names if run.inputs is not None else []
    parameters = {name: float(x) for name, x in run.parameters.items()
                  if name in stepper.parameter_domains and name not in changing}
    # in scaled time t and −H are behind the n coordinates and momenta
    q, p = (np.asarray(x[: stepper.n], float) for x in (run.q, run.p))
    return fitting.consistent(fitting.coordinates.inside(parameters), q, p)


def _refuse_wrong_derivatives(fitting: Fitting, point: Point) -> None:
    """Refuse a user's function whose derivatives differ from differences of its values.

    A step y = h · units changes all unknowns by a part h of their units: (r(y) − r(−y))/2 is J y.
    The median of the samples counts, because an angle may jump by 2π at one of them.
    """
    # above the round-off of residuals, which are doubles, and a part of a period of a long motion
    h = max(fitting.step.binding.epsilon, float(np.finfo(float).eps)) ** 0.4
    linear = fitting.linearise(point)
    y = linear.units * h
    after, before = (fitting.residuals(fitting.apply_step(point, x)) for x in (y, -y))
    differences, predicted = (after - before) / 2, (linear.J @ y).reshape(after.shape)
    errors, sizes = (np.median(np.abs(x), axis=0)
                     for x in (differences - predicted, np.abs(differences) + np.abs(predicted)))
    column = int(np.argmax(errors - _WRONG * sizes))
    round_off = h**2 * np.abs(fitting.data).max()  # of columns that no unknown moves
    if errors[column] > _WRONG * sizes[column] + round_off:
        i = int(np.argmax(np.abs(differences - predicted)[:, column]))
        raise InputError(
            f"The derivatives that observe returned are not those of its values: where column "
            f"{column} changes by {differences[i, column]:.3g}, they say "
            f"{predicted[i, column]:.3g}. Correct them, by q or by p.")


def _minimise_horizons(
    fitting: Fitting, point: Point, counts: list[int], iteration_limit: int,
    report: Callable[[int], Any] | None,
) -> Minimum[Point]:
    """Return the minimum for all samples, with the sum of the iterations of all horizons.

    ``counts`` are the numbers of samples, one after the other. Short horizons come first: the error
    of a guess grows along a run, and a long one has many minima.
    """
    iterations = 0
    for horizon, count in enumerate(counts):
        is_last = count == counts[-1]
        fitting.samples = count
        linearise = fitting.linearise if report is None else partial(
            _linearise_and_report, fitting.linearise, report, horizon)
        minimum = minimise(point, fitting.scaled_residuals, linearise, fitting.apply_step,
                           fitting.excess, tolerance=_TOLERANCE if is_last else _EARLY_TOLERANCE,
                           iteration_limit=iteration_limit if is_last else _EARLY,
                           noise=fitting.truncation(point))
        point, iterations = minimum.point, iterations + minimum.iterations
    if report is not None:
        report(len(counts))
    return Minimum(point, iterations, minimum.converged)


def _linearise_and_report(
    linearise: Callable[[Point], Linear], report: Callable[[int], Any], horizons_done: int,
    point: Point
) -> Linear:
    """Return the residuals at a point with their derivatives; report the horizons that are done."""
    report(horizons_done)
    return linearise(point)


def _sample_times(t: ArrayLike, t0: float) -> Array:
    """Return the times of the samples, shape (samples,), which increase and begin not before t0."""
    numbers = as_numbers("t", t)
    if numbers.ndim != 1 or not len(numbers):
        raise InputError(f"t has the shape {numbers.shape}; give one time for each row of data.")
    times = np.array(numbers, dtype=float)
    if not np.isfinite(times).all():
        raise InputError("A time in t is not finite; leave out samples that are missing.")
    if (np.diff(times) <= 0).any() or times[0] < t0:
        raise InputError("The times in t do not increase from the start's; sort the samples, one "
                         "for each time, and give a start not after the first of them.")
    return times


def _steps_at(times: Array, t0: float, dt: Any) -> tuple[Any, Array]:
    """Return dt and the number of steps to each time.

    Without a dt it is about the smallest distance of two samples, so that the last sample is a
    whole number of steps from the start. Raises InputError for a time that is no whole number of
    steps, to a thousandth of a step.
    """
    if dt is None:
        gaps = np.diff([t0, *times])
        if not times[-1] > t0:
            raise InputError("All samples are at the start, from which no dt follows; give dt.")
        smallest_gap = float(gaps[gaps > 0].min(initial=np.inf))
        dt = (times[-1] - t0) / max(1.0, np.rint((times[-1] - t0) / smallest_gap))
    step_size = float(as_real("dt", dt))
    if not (np.isfinite(step_size) and step_size > 0):
        raise InputError(f"dt = {shown(dt)} is no time step; give a number of seconds above 0.")
    steps = (times - t0) / step_size
    whole_steps = np.rint(steps).astype(int)
    i = int(np.argmax(np.abs(steps - whole_steps)))
    if abs(steps[i] - whole_steps[i]) > _OFF_GRID:
        raise InputError(f"t[{i}] = {times[i]:.9g} s is {steps[i]:.6g} steps of "
                         f"dt = {step_size:g} s from the start: no whole number. Give a dt "
                         "that divides the times of all samples.")
    return dt, whole_steps


def _free_names(step: Stepper, free: Sequence[str] | None, fixed: Sequence[str]) -> list[str]:
    """Return the names that are fitted: ``free``, or all but γ and α, without ``fixed``.

    Inputs are never fitted. Raises InputError for unknown names, a name in both, and no name.
    """
    parameter_names = [name for name in step.parameter_domains
                       if name not in step.binding.input_names]
    allowed = [*parameter_names, "start"]
    fixed = as_items("fixed", [fixed] if isinstance(fixed, str) else fixed, "names",
                     is_ordered=False)
    for name in fixed:
        if not isinstance(name, str) or name not in allowed:
            raise unknown("name in fixed", name, allowed)
    # γ and α change the motion within truncation alone: they are fitted only if they are named
    if free is None:
        free_names = [name for name in allowed if not is_inertia_parameter(name)]
    else:
        free_names = as_items("free", [free] if isinstance(free, str) else free, "names")
    for name in free_names:
        if not isinstance(name, str) or name not in allowed:
            raise unknown("name in free", name, allowed)
    overlapping = [name for name in free_names if name in fixed]
    if free is not None and overlapping:
        raise InputError(f"{overlapping[0]!r} is in free and in fixed; give it in one of them.")
    free_names = [name for name in dict.fromkeys(free_names) if name not in fixed]
    if not free_names:
        raise InputError(f"Nothing is free; choose among {', '.join(allowed)}.")
    return free_names


def _first_run(
    step: Stepper, start: StartNumbers, dt: Any, steps: int, inputs: Any
) -> RunArguments:
    """Return the run of the first guess, its start on the constraints.

    ``start`` is the first guess, integrated ``steps`` steps of ``dt`` with the inputs.
    """
    input_rows: InputRows | None = as_inputs(inputs, step.binding, steps)
    all_parameters = step._parameters_with_inputs(start.parameters, input_rows)
    q, p = start.q, start.p
    if step.m:
        # constraints depend on no γ, whose value by a rule is not known yet
        numeric_parameters = {name: 1.0 if isinstance(x, Rule) else x
                              for name, x in all_parameters.items()}
        q, p = step.project(q, p, parameters=numeric_parameters, t=start.t)
    run = step._resolve(step._run_arguments(
        replace(start, q=q, p=p), dt=dt, steps=steps, inputs=input_rows, scaled=True))
    refuse_run(run)
    return run


def _sigma(sigma: ArrayLike, fitting: Fitting, point: Point) -> Array:
    """Return a standard deviation for each column of residuals, shape (columns,).

    One number serves all columns. Sets ``fitting.samples`` to 1: one sample has all columns.
    """
    fitting.samples = 1
    columns = fitting.residuals(point).shape[1]
    numbers = as_numbers("sigma", sigma)
    deviations = np.reshape([as_double(x) for x in numbers.flat], numbers.shape)
    positive = (np.isfinite(deviations) & (deviations > 0)).all()
    if deviations.shape not in ((), (1,), (columns,)) or not positive:
        raise InputError(f"sigma = {shown(sigma)} is no noise; give a number above 0, or one for "
                         f"each of {columns} columns of residuals.")
    column_deviations: Array = np.broadcast_to(deviations, (columns,)).copy()
    return column_deviations


def _horizons(horizons: Sequence[int] | None, samples: int, fewest: int) -> list[int]:
    """Return increasing numbers of samples: the user's ``horizons``, and at last all samples.

    Without the user's numbers, None, they are ``fewest`` · 2^k, ``fewest`` the samples of the first
    horizon.
    """
    if horizons is None:
        counts = [fewest * 2**k for k in range(64) if fewest * 2**k < samples]
    else:
        counts = [as_positive_count("horizon", x, minimum=1) for x in as_items(
            "horizons", horizons, "numbers of samples")]
        if counts != sorted(counts) or (counts and counts[-1] > samples):
            raise InputError(f"horizons = {shown(horizons)} do not increase up to {samples}, the "
                             "number of samples; give for example [16, 64, 256].")
    return [*(x for x in counts if x < samples), samples]


def _result(
    fitting: Fitting, point: Point, iterations: int, horizons: list[int], converged: bool, *,
    sigma_known: bool,
) -> Fit:
    """Return the fit at a minimum, with covariance (JᵀJ)⁺ over the determined directions.

    If σ is not known, the covariance is scaled by the variance of the residuals.
    """
    free_names, coordinates = fitting.free, fitting.coordinates
    r, J = fitting.derivatives(point)
    basis, halved = point.basis, fitting.residuals(point, halvings=1)
    rms, truncation = (float(np.sqrt(np.mean(x**2))) for x in (r, halved - r))
    estimates = np.array([point.parameters[name] for name in free_names])
    scaled = (r / fitting.sigma).ravel()
    # by the parameters themselves, not by the coordinates that steps move
    linear = fitting.scale_residuals(point, r, J, coordinates.scales(point.parameters))
    # a direction without effect fits no residual
    s = np.linalg.svd(triangle(linear.J * linear.units), compute_uv=False)
    degrees_of_freedom = max(1, len(scaled) - int(np.sum(s > RANK * s[0])))
    noise = 1.0 if sigma_known else float(np.sqrt(scaled @ scaled / degrees_of_freedom))
    # a direction that the data fix no better than the error of Δt is not determined by them
    scaled_truncation = np.sqrt(np.mean(((halved - r) / fitting.sigma) ** 2))
    noise_with_truncation = float(np.hypot(noise, scaled_truncation))
    identified = identify(linear, noise_with_truncation)
    covariance = identified.covariance * noise**2
    names = [*free_names, *(f"start[{k}]" for k in range(basis.shape[1]))]
    undetermined = _combinations(identified.null, free_names, estimates, basis, _start_sizes(point))
    sigma = {name: noise * float(np.sqrt(variance))
             for name, variance in zip(names, identified.variances, strict=True)}
    return Fit(
        dict(point.parameters), point.q, point.p, names=names, covariance=covariance, sigma=sigma,
        undetermined=undetermined, residuals=r, rms=rms, truncation=truncation, basis=basis,
        horizons=horizons, iterations=iterations, converged=converged)


def _start_sizes(point: Point) -> Array:
    """Return |q| and |p| of the start, shape (2 n,).

    At a start with q = 0 or p = 0: the largest |q| or |p| of the samples.
    """
    # a body at rest has p = 0, and no relative change of it
    start_norms = np.repeat([np.linalg.norm(x) for x in (point.q, point.p)], len(point.q))
    return np.where(start_norms > 1e-6 * point.sizes, start_norms, point.sizes)


def _combinations(
    null: Array, free_names: list[str], estimates: Array, basis: Array, sizes: Array
) -> list[dict[str, float]]:
    """Return undetermined directions as relative changes, name → change.

    ``null`` has the directions in columns; its rows are the free parameters, of size ``estimates``,
    then the coordinates y of the start, which moves by B y with B = ``basis`` and has ``sizes``.
    The change of "start" is the larger one of |δq| and |δp| over their sizes.
    """
    count, n = len(free_names), len(sizes) // 2
    starts = basis @ null[count:] / sizes[:, None]
    relative = null[:count] / np.where(estimates == 0, 1.0, estimates)[:, None]
    combinations: list[dict[str, float]] = []
    # in reduced echelon form a direction has few names, of which one changes by a factor 1
    for row in reduced_basis(np.concatenate([relative, starts])):
        weights = dict(zip(free_names, row[:count].tolist(), strict=True))
        if basis.shape[1]:
            weights["start"] = float(max(np.linalg.norm(row[count : count + n]),
                                         np.linalg.norm(row[count + n :])))
        combinations.append({name: x for name, x in weights.items() if abs(x) > SHARE})
    return combinations
