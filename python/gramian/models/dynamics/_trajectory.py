"""Trajectories of the user's own functions, with their transitions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array, finite, number, real, whole
from gramian._units import labelled
from gramian.bounds import PosteriorBound, posterior
from gramian.exceptions import InputError
from gramian.models.dynamics._functions import Function, OneByOne, System
from gramian.models.dynamics._windows import Windows
from gramian.problem import Problem

__all__ = ["Trajectory", "empirical_gramian", "from_map", "from_ode", "unit_norm"]

Array = NDArray[np.float64]

#: Steps of the integrator: a minute or so of functions in Python.
MOST_STEPS = 200_000


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Answer):
    """A trajectory of a system, its outputs and the derivatives of both.

    Attributes
    ----------
    names, units : tuple of str, length n
    times : ndarray, shape (K,)
    states : ndarray, shape (K, n)
    outputs : ndarray, shape (K, p)
    transitions : ndarray, shape (K - 1, n, n)
        d x(t[k+1]) / d x(t[k]).
    jacobians : ndarray, shape (K, p, n)
        d h / d x.
    transition_changes : ndarray, shape (K - 1, n, n)
        What steps twice as long would change in the transitions: many times their error,
        and never less than rounding.
    jacobian_errors : ndarray, shape (K, p, n)
        How wrong each entry may be, by differences and by the error of the state.
    sigma : ndarray, shape (p,)
        Standard deviation of each output.
    scale : ndarray, shape (n,)
        A typical move of each state.
    tangent : ndarray, shape (K, n, m), or None
        The directions that constraints on the state leave free.
    steps : int
        Steps the integrator took.
    vectorized : tuple of str
        Which of the functions (f, h and the Jacobians given) were asked about many states
        in one call.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    times: Array
    states: Array
    outputs: Array
    transitions: Array
    jacobians: Array
    transition_changes: Array
    jacobian_errors: Array
    sigma: Array
    scale: Array
    tangent: Array | None
    steps: int
    vectorized: tuple[str, ...]

    def _white(self) -> Array:
        return np.ascontiguousarray(self.jacobians / self.sigma[:, None])

    def _path(self) -> tuple[Array, Array, Array, Array]:
        """Return what rows are made of, as the extension takes it."""
        errors = np.ascontiguousarray(self.jacobian_errors / self.sigma[:, None])
        return self.transitions, self.transition_changes, self._white(), errors

    def _place(self, time: float | None, default: int, name: str) -> int:
        if time is None:
            return default
        at = number(time, f"{name} [-]")
        found = int(np.argmin(np.abs(self.times - at)))
        if not np.isclose(self.times[found], at, rtol=1e-9, atol=1e-12):
            raise InputError(f"{name} = {time}: must be one of the times of the trajectory")
        return found

    def rows(self, about: float | None = None, until: float | None = None) -> Array:
        """Return whitened rows about the state at one time, of the outputs from then on.

        Parameters
        ----------
        about, until : float, optional
            Times of the trajectory; the first and the last by default.

        Returns
        -------
        ndarray, shape (samples p, n)
        """
        return self.rows_and_errors(about, until)[0]

    def rows_and_errors(
        self, about: float | None = None, until: float | None = None
    ) -> tuple[Array, Array]:
        """Return the rows and how wrong each entry may be, both (samples p, n).

        The errors are those of the integrator and of the derivatives of h. That of df/dx by
        differences is not in them.
        """
        first = self._place(about, 0, "about")
        last = self._place(until, len(self.times) - 1, "until") + 1
        if last <= first:
            raise InputError(f"until = {until}: must not be before about = {about}")
        return _core.dynamics_rows(*self._path(), first, last)

    def problem(self, about: float | None = None, until: float | None = None) -> Problem:
        """Return the problem of the state at one time, for `gramian.analyze`.

        Where the trajectory has a `tangent`, what it leaves out is known exactly. What the
        errors of the rows cannot tell from zero makes the status "undecided".
        """
        rows, errors = self.rows_and_errors(about, until)
        found = Problem(rows, self.names, units=self.units, row_error=errors)
        if self.tangent is None:
            return found
        free = self.tangent[self._place(about, 0, "about")]
        fixed = np.linalg.qr(free, mode="complete")[0][:, free.shape[1] :]
        return found.constrain(fixed.T) if fixed.size else found

    def windows(self, width: float, *, rtol: float | None = None) -> Windows:
        """Say what a window of outputs tells of the state at its beginning, as it slides.

        Parameters
        ----------
        width : float
            How long outputs are taken, > 0; windows hold as many samples for every
            beginning as the first has.
        rtol : float, optional
            Relative accuracy of the rows; by default what `rows_and_errors` says. What it
            cannot tell from zero is not counted in the ranks.

        Returns
        -------
        Windows
        """
        width, rtol = number(width, "width"), options.tolerance(rtol)
        count = int(np.sum(self.times <= self.times[0] + width * (1 + 1e-12)))
        if not width > 0 or width > (self.times[-1] - self.times[0]) * (1 + 1e-9):
            span = self.times[-1] - self.times[0]
            raise InputError(f"width = {width}: must be > 0 and no longer than {span:g}")
        rank, std, values, null = _core.dynamics_windows(*self._path(), count, rtol, self.tangent)
        return Windows(
            names=self.names,
            units=self.units,
            times=self.times[: len(rank)],
            width=width,
            samples=count,
            rank=np.array(rank),
            free=len(self.names) if self.tangent is None else self.tangent.shape[2],
            std=std,
            singular_values=values,
            null_spaces=tuple(space.T for space in null),
        )

    def posterior(self, Q: ArrayLike, prior: ArrayLike | Mapping[str, float]) -> PosteriorBound:
        """Return the bound of every filter along the trajectory.

        Parameters
        ----------
        Q : array_like, shape (n, n) or (K - 1, n, n)
            Covariance of the process noise between two times.
        prior : array_like, shape (n,) or (n, n), or mapping of str to float
            Deviations or covariance at the first time; `inf` for nothing known.
        """
        if isinstance(prior, Mapping):
            known = np.full(len(self.names), np.inf)
            for name, value in prior.items():
                if name not in self.names:
                    states = ", ".join(self.names)
                    raise InputError(
                        f"no state is named {options.given(name)}: the states are {states}"
                    )
                k = self.names.index(name)
                known[k] = real(value, labelled(f"prior of {name}", self.units[k]))
            prior = known
        return posterior(self._white(), self.transitions, Q, prior)

    def _as_table(self) -> Columns:
        values = dict(zip(self.names, self.states.T, strict=True))
        return Columns("time", self.times, values, dict(zip(self.names, self.units, strict=True)))


def from_ode(
    f: Function,
    h: Function,
    x0: ArrayLike,
    times: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    sigma: ArrayLike = 1.0,
    units: Sequence[str] | None = None,
    scale: ArrayLike | None = None,
    jacobian: str | tuple[Any, Any] = "auto",
    vectorized: bool | None = None,
    tangent: Callable[[Array], ArrayLike] | None = None,
    rtol: float = 1e-9,
    max_steps: int = MOST_STEPS,
) -> Trajectory:
    """Follow x' = f(t, x) with outputs y = h(t, x), and their derivatives beside it.

    Parameters
    ----------
    f : callable
        f(t, x) -> (n,), x of shape (n,). An input is a function of t inside f. Of many
        states, t has shape (k,), x (n, k) and the value (n, k).
    h : callable
        h(t, x) -> (p,), likewise.
    x0 : array_like, shape (n,)
        The state at the first time.
    times : array_like, shape (K,)
        Increasing; outputs are taken at each.
    names, units : sequence of str, length n, optional
    sigma : array_like, shape () or (p,)
        Standard deviation of each output.
    scale : array_like, shape (n,), optional
        A typical move of each state, over which f and h bend: differences take steps of
        a thousandth of it. By default what `gramian.from_function` finds at x0 serves
        wherever differences are taken, and else the size of x0, at least 1.
    jacobian : {"auto", "complex", "differences", "jax"} or (callable, callable)
        Where df/dx and dh/dx come from: complex steps (exact where the code is analytic),
        central differences with extrapolation, JAX, or two functions of (t, x). "auto"
        takes complex steps where they agree with differences at x0, differences elsewhere.
    vectorized : bool, optional
        Whether f and h take many states at once: much faster. By default it is found out,
        and the answer is the same: most functions that are written for one state take an
        array of many as it is (`x[0] * np.cos(x[2])`). See the notes.
    tangent : callable, optional
        tangent(x) -> (n, m): the directions that constraints on the state leave free at
        x, as `unit_norm` makes. Answers are then about these.
    rtol : float
        Accuracy of states and transitions from one time to the next.
    max_steps : int
        So many steps of the integrator at most, those it tried and threw away among them.

    Returns
    -------
    Trajectory

    Raises
    ------
    InputError
        Shapes that do not fit, times that do not increase, a trajectory that cannot be
        followed, or not in `max_steps`.

    Notes
    -----
    Gauss-Legendre steps of order six, each differentiated as it was computed (the
    variational equations); their number between two times is doubled until state and
    transition agree to `rtol`. Vectorized functions are asked about all steps of many
    intervals at once, by one Newton iteration for all of them, and so also about states
    that are guesses.

    Whether a function takes many states is found out by comparing, to rounding, what it
    says of a dozen near x0, and of both signs, with what it says of each alone. Constants in
    a list of outputs, `[x[1], 0.0]`, may stay. It is compared again in every call, at one
    state at least and wherever a state or the time is beyond what was compared before;
    where it does not agree, everything is done again, one state at a time.
    `Trajectory.vectorized` says what was found.

    An h whose differences at two steps do not agree (an angle
    that wraps there, detail within the step) is an error.

    Examples
    --------
    A bearing to a beacon from a vehicle that drives straight on does not tell how far it
    is, nor how fast.

    >>> import numpy as np
    >>> import gramian as gm
    >>> def drive(t, x):
    ...     return np.array([x[2], x[3], 0 * x[0], 0 * x[0]])
    >>> def bearing(t, x):
    ...     return np.arctan(x[0] / x[1])
    >>> path = gm.dynamics.from_ode(
    ...     drive, bearing, [3.0, 4.0, 1.0, 0.0], np.arange(6.0), ["x", "y", "vx", "vy"], sigma=0.01
    ... )
    >>> path.windows(4.0).rank
    array([3, 3])
    """
    most = whole(max_steps, "max_steps", 1)
    return _follow(
        f, h, x0, times, names, sigma, units, scale, jacobian, vectorized, tangent, rtol, most
    )


def from_map(
    f: Function,
    h: Function,
    x0: ArrayLike,
    times: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    sigma: ArrayLike = 1.0,
    units: Sequence[str] | None = None,
    scale: ArrayLike | None = None,
    jacobian: str | tuple[Any, Any] = "auto",
    vectorized: bool | None = None,
    tangent: Callable[[Array], ArrayLike] | None = None,
) -> Trajectory:
    """Follow x[k+1] = f(t[k], x[k]) with outputs y = h(t, x).

    Parameters
    ----------
    f, h, x0, times, names, sigma, units, scale, jacobian, vectorized, tangent
        As for `from_ode`; f gives the next state.

    Returns
    -------
    Trajectory

    Examples
    --------
    >>> path = from_map(lambda t, x: 0.5 * x, lambda t, x: x**2, [1.0], [0, 1, 2])
    >>> path.states.T
    array([[1.  , 0.5 , 0.25]])
    """
    return _follow(
        f, h, x0, times, names, sigma, units, scale, jacobian, vectorized, tangent, None, 0
    )


def _follow(
    f: Function,
    h: Function,
    x0: ArrayLike,
    times: ArrayLike,
    names: Sequence[str] | None,
    sigma: ArrayLike,
    units: Sequence[str] | None,
    scale: ArrayLike | None,
    jacobian: str | tuple[Any, Any],
    vectorized: bool | None,
    tangent: Callable[[Array], ArrayLike] | None,
    rtol: float | None,
    most: int,
) -> Trajectory:
    for function, name in ((f, "f"), (h, "h")):
        options.function(function, name)
    if vectorized is not None:
        vectorized = options.flag(vectorized, "vectorized")
    start = np.atleast_1d(finite(x0, "x0"))
    if start.ndim != 1 or not start.size:
        raise InputError(f"x0 has shape {start.shape}: must be (n,)")
    n = len(start)
    at = np.atleast_1d(finite(times, "times [-]"))
    if at.ndim != 1 or len(at) < 2:
        raise InputError(f"times has shape {at.shape}: must be (K,) with K >= 2")
    if (bad := np.flatnonzero(np.diff(at) <= 0)).size:
        k = bad[0] + 1
        raise InputError(f"times[{k}] = {at[k]}: must be later than the one before, {at[k - 1]}")
    if rtol is not None:
        rtol = options.fraction(rtol, "rtol")
        if rtol < 1e-14:
            raise InputError(f"rtol = {rtol}: must be at least 1e-14 and below 1")
    labels, measures, moves = described(names, units, scale, start)
    parts = _two(jacobian)
    singly: set[str] = set()
    while True:
        asked = System(f, h, n, vectorized, singly)
        try:
            asked.look(at, start, moves, parts)
            deviations = _deviations(sigma, asked.outputs)
            step = moves if scale is not None else asked.moves(at[0], start, labels, moves)
            # Guesses that go astray are no news; what is not finite in the end is an error.
            with np.errstate(all="ignore") if asked.takes_many else nullcontext():
                states, outputs, transitions, jacobians, changes, errors, steps = (
                    _core.dynamics_follow(
                        asked.rate,
                        asked.by_rate,
                        asked.output,
                        asked.by_output,
                        asked.outputs,
                        step.tolist(),
                        start.tolist(),
                        at.tolist(),
                        rtol,
                        most,
                        list(labels),
                        asked.takes_many,
                    )
                )
            break
        except OneByOne as told:
            singly.add(told.name)
    free = None
    if tangent is not None:
        options.function(tangent, "tangent")
        bases = [finite(tangent(x), "what tangent returned") for x in states]
        if any(b.ndim != 2 or b.shape != bases[0].shape or len(b) != n for b in bases):
            raise InputError(f"tangent returned shape {bases[0].shape}: must be ({n}, m)")
        free = np.array(bases)
    return Trajectory(
        names=labels,
        units=measures,
        times=at,
        states=states,
        outputs=outputs,
        transitions=transitions,
        jacobians=jacobians,
        transition_changes=changes,
        jacobian_errors=errors,
        sigma=deviations,
        scale=step,
        tangent=free,
        steps=steps,
        vectorized=asked.vectorized,
    )


def _deviations(sigma: ArrayLike, p: int) -> Array:
    """Return the deviation of each output."""
    given = as_float_array(sigma, "sigma")
    if given.shape not in {(), (1,), (p,)}:
        raise InputError(f"sigma has shape {given.shape}: must be one number or ({p},)")
    deviations = np.broadcast_to(given, (p,)).copy()
    if (bad := np.flatnonzero(~((deviations > 0) & np.isfinite(deviations)))).size:
        raise InputError(f"sigma[{bad[0]}] = {deviations[bad[0]]}: must be > 0 and finite")
    return deviations


def _two(jacobian: str | tuple[Any, Any]) -> list[Any]:
    """Return where the derivatives of f and of h come from."""
    wanted = "a word or two functions, of f and of h"
    parts = (
        [jacobian, jacobian]
        if isinstance(jacobian, str)
        else options.sequence(jacobian, "jacobian", wanted)
    )
    if len(parts) != 2:
        raise InputError(f"jacobian = {options.given(jacobian)}: must be {wanted}")
    return parts


def described(
    names: Sequence[str] | None,
    units: Sequence[str] | None,
    scale: ArrayLike | None,
    start: Array,
) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Return names, units and typical moves of the states."""
    n = len(start)
    labels = tuple(f"x{i}" for i in range(n)) if names is None else options.names(names, "names")
    if len(labels) != n or len(set(labels)) < n:
        raise InputError(f"names has {len(labels)} entries: must have {n} different ones")
    measures = ("",) * n if units is None else options.names(units, "units", "strings")
    if len(measures) != n:
        raise InputError(f"units has {len(measures)} entries: must have {n}, one for each state")
    moves = np.maximum(np.abs(start), 1.0) if scale is None else finite(scale, "scale").copy()
    if moves.shape != (n,):
        raise InputError(f"scale has shape {moves.shape}: must be ({n},), one for each state")
    if (bad := np.flatnonzero(~(moves > 0))).size:
        raise InputError(f"scale[{bad[0]}] = {moves[bad[0]]}: must be > 0")
    return labels, measures, moves


def unit_norm(*groups: Sequence[int]) -> Callable[[Array], Array]:
    """Return the tangent of states of which groups have a fixed norm: unit quaternions.

    Parameters
    ----------
    *groups : sequence of int
        The places of the components of each group.

    Returns
    -------
    callable
        tangent(x) -> (n, n - number of groups), orthonormal columns.

    Examples
    --------
    >>> unit_norm([0, 1])([0.0, 1.0, 5.0]).round(12)
    array([[-1.,  0.],
           [ 0.,  0.],
           [ 0.,  1.]])
    """
    places = []
    for i, group in enumerate(groups):
        whole_ones = options.sequence(group, f"groups[{i}]", "a sequence of places of components")
        places.append([whole(k, f"groups[{i}]") for k in whole_ones])
        if not places[-1]:
            raise InputError(f"groups[{i}] is empty: must name at least one component")
    most = max((k for group in places for k in group), default=-1)

    def tangent(x: ArrayLike) -> Array:
        state = finite(x, "x")
        if state.ndim != 1 or state.size <= most:
            raise InputError(f"x has shape {state.shape}: must be (n,) with n > {most}")
        n = len(state)
        normals = np.zeros((n, len(groups)))
        for column, chosen in enumerate(places):
            length = np.linalg.norm(state[chosen])
            if not length > 0:
                raise InputError(f"unit_norm: the states {chosen} are all zero")
            normals[chosen, column] = state[chosen] / length
        free: Array = np.linalg.qr(normals, mode="complete")[0][:, len(groups) :]
        return free

    return tangent


def empirical_gramian(
    f: Function,
    h: Function,
    x0: ArrayLike,
    times: ArrayLike,
    *,
    step: ArrayLike,
    sigma: ArrayLike = 1.0,
    discrete: bool = False,
    vectorized: bool | None = None,
    rtol: float = 1e-9,
    max_steps: int = MOST_STEPS,
) -> Array:
    """Return the empirical observability Gramian: differences of whole trajectories.

    Parameters
    ----------
    f, h, x0, times, sigma, vectorized, rtol, max_steps
        As for `from_ode`, for each of the 2 n trajectories.
    step : array_like, shape () or (n,)
        How far each state is moved to either side. As it goes to zero the Gramian
        becomes the information of `Trajectory.rows`.
    discrete : bool
        Whether f gives the next state, as for `from_map`.

    Returns
    -------
    ndarray, shape (n, n)
        Sum over the times of (y+ - y-)_i^T (y+ - y-)_j / (4 step_i step_j), outputs in
        units of their deviations (Krener & Ide 2009, sec. III).

    Examples
    --------
    >>> empirical_gramian(lambda t, x: -x, lambda t, x: x, [1.0], [0.0, 1.0], step=0.1).round(4)
    array([[1.1353]])
    """
    discrete = options.flag(discrete, "discrete")
    start = np.atleast_1d(finite(x0, "x0"))
    given = finite(step, "step")
    if start.ndim != 1 or given.shape not in {(), (1,), start.shape}:
        raise InputError(
            f"step has shape {given.shape}: must be one number or {start.shape}, as x0"
        )
    moves = np.broadcast_to(given, start.shape)
    if not (moves > 0).all():
        raise InputError(f"step = {moves.tolist()}: must be > 0")
    columns = []
    for i, move in enumerate(moves):
        ends = []
        for sign in (1.0, -1.0):
            moved = start.copy()
            moved[i] += sign * move
            given_too: dict[str, Any] = {"sigma": sigma, "vectorized": vectorized}
            path = (
                from_map(f, h, moved, times, **given_too)
                if discrete
                else from_ode(f, h, moved, times, rtol=rtol, max_steps=max_steps, **given_too)
            )
            ends.append((path.outputs / path.sigma).ravel())
        columns.append((ends[0] - ends[1]) / (2 * move))
    rows = np.array(columns)
    with np.errstate(over="ignore", invalid="ignore"):
        gramian: Array = rows @ rows.T
    if not np.isfinite(gramian).all():
        raise InputError("the Gramian overflows float64: choose other units, or a larger sigma")
    return gramian
