"""What a window of outputs tells: Gramians, rows, and systems constant by segments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array, finite, number
from gramian._text import describe_direction
from gramian.exceptions import InputError
from gramian.models.linear._levels import observability_matrix
from gramian.models.linear._systems import (
    System,
    SystemLike,
    matrices,
    sampled,
    system_of,
    time_of,
    whitener,
)
from gramian.problem import Problem

__all__ = [
    "Piecewise",
    "gramian",
    "piecewise",
    "problem",
    "rows",
    "rows_of_segments",
    "transition",
]

Array = NDArray[np.float64]

#: Rows are kept, a block for each sample.
MOST_SAMPLES = 10_000_000
#: So many of them at once are moved on by the same number of steps.
CHUNK = 1024
#: Panels of a quadrature that are halved at once.
MOST_PANELS = 4096
#: How often a function of time is looked at between the nodes of a panel, of which the
#: first are 16 to the window, and at least two between breakpoints.
PROBES = 128


def transition(A: ArrayLike, duration: float) -> Array:
    """Return e^(A duration), the transition of the state over a duration.

    Parameters
    ----------
    A : array_like, shape (n, n)
    duration : float
        In the unit of time of A.

    Raises
    ------
    InputError
        A result that exceeds the numbers.

    Examples
    --------
    >>> transition([[0, 1], [0, 0]], 3.0)
    array([[1., 3.],
           [0., 1.]])
    """
    return _core.linear_transition(A, number(duration, "duration [-]"))


def gramian(
    A: SystemLike | Callable[[float], ArrayLike],
    C: ArrayLike | Callable[[float], ArrayLike] | None = None,
    *,
    window: float | None = None,
    dt: float | None = None,
    times: ArrayLike | None = None,
    R: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    breakpoints: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return the observability Gramian of a finite window: the information about x(0).

    Parameters
    ----------
    A : array_like, shape (..., n, n), or state-space object
        Of x' = A x; with `dt`, of x[k+1] = A x[k]. Need not be stable. A system that
        varies: A(t) -> (n, n) from time 0 on, or from the first of `times`.
    C : array_like, shape (..., p, n)
        Likewise.
    window : float, optional
        How long outputs are taken, > 0, in the unit of time of the system.
    dt : float, optional
        Time between samples of a discrete system; there are
        floor(window / dt) + 1 of them, from 0 on. A discrete state-space object has its own.
    times : array_like, shape (K,), optional
        In place of `window`: samples of a continuous system at these times, at any
        intervals.
    R : array_like, shape (), (p,) or (p, p), optional
        Covariance of the outputs (variances, or the matrix), in continuous time
        its density; 1 by default, or the noise of a `System`.
    Q : array_like, shape (n, n), optional
        Covariance of the process noise of a step, in continuous time its
        density. It makes what is seen late say less about the beginning.
    breakpoints : array_like, shape (m,), optional
        Of a system that varies: times inside the window where A(t) or C(t) jumps, or
        where something short begins or ends.
    out : ndarray, shape of the result, optional
        Where the result is written: of float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made. For constant systems in a
        `window`.

    Returns
    -------
    ndarray, shape (..., n, n)
        Without Q, the integral of e^(A^T t) C^T R^-1 C e^(A t), or the sum of
        Phi^kT C^T R^-1 C Phi^k.

    Raises
    ------
    InputError
        Shapes that do not fit, a window that is not positive, a covariance that
        is not one, a Gramian that exceeds the numbers.

    Notes
    -----
    A short window by the exponential of Van Loan 1978's block matrix, then
    doubled as often as it takes; all sums are of positive terms. Rank and
    bounds of long windows keep twice the digits when taken from `problem`.

    Where A or C varies, Gauss-Legendre quadrature, each panel halved until the Gramian keeps
    eleven digits. Functions can be asked at points only: A(t) and C(t) are looked at about
    2200 times in the window, and at least 276 times between two breakpoints. A burst that
    falls between these points is missed unless `breakpoints` say where it begins and ends.

    Examples
    --------
    >>> gramian([[0, 1], [0, 0]], [[1, 0]], window=2.0)
    array([[2.        , 2.        ],
           [2.        , 2.66666667]])
    """
    if times is not None:
        if any(given is not None for given in (window, dt, Q, breakpoints, out)):
            raise InputError("times goes without window, dt, Q, breakpoints and out")
        seen = rows(A, C, times=times, R=R)
        return _square(seen, "times")
    if window is None:
        raise InputError("window is missing: give it, or times")
    if _varies(A) or _varies(C):
        if dt is not None or Q is not None or out is not None:
            raise InputError("a system that varies goes without dt, Q and out")
        return _integral(A, C, number(window, "window"), R, breakpoints)
    if breakpoints is not None:
        raise InputError("breakpoints go with A(t) or C(t), and a window")
    dt = sampled(A, dt)
    constant: tuple[Any, Any] = (A, C)
    a, c = matrices(*constant)
    c = as_float_array(c, "C")
    if c.ndim < 2:
        raise InputError(f"C has shape {c.shape}: must be (outputs, states)")
    samples = _samples(window, dt)
    noise = A.noise if isinstance(A, System) else None
    white = whitener(R, c.shape[-2], noise) @ c
    if Q is not None:
        q = finite(Q, "Q")
        if q.ndim < 2 or q.shape[-1] != q.shape[-2] or not q.size:
            raise InputError(f"Q has shape {q.shape}: must be a covariance (n, n) of the states")
        if not np.allclose(q, np.swapaxes(q, -1, -2), rtol=1e-10, atol=0):
            raise InputError("Q is not symmetric: a covariance must be")
        spread = np.sqrt(np.abs(np.diagonal(q, axis1=-2, axis2=-1)))
        spread = np.where(spread > 0, spread, 1.0)
        scaled = q / spread[..., :, None] / spread[..., None, :]
        if (np.linalg.eigvalsh(scaled) < -1e-10).any():
            raise InputError("Q has a negative eigenvalue: a covariance must not")
    return _core.linear_gramian(a, white, Q, number(window, "window"), samples, out)


def _square(seen: Array, what: str) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        found: Array = seen.T @ seen
    if not np.isfinite(found).all():
        raise InputError(f"{what}: the Gramian overflows float64")
    return found


def _integral(
    A: Any, C: Any, window: float, R: ArrayLike | None, breakpoints: ArrayLike | None
) -> Array:
    """Return the Gramian of a system that varies."""
    if not window > 0:
        raise InputError(f"window = {window}: must be > 0 and finite")
    nodes, weights = np.polynomial.legendre.leggauss(8)
    begins, ends = _resolved(A, C, _panels(window, breakpoints), nodes)

    def grams(begins: Array, ends: Array) -> Array:
        # All at once: the transition is followed through the nodes of all panels in turn.
        half = (ends - begins) / 2
        at = ((begins + half)[:, None] + half[:, None] * nodes).ravel()
        seen = rows(A, C, times=np.concatenate([[0.0], at]), R=R)
        seen = seen.reshape(len(at) + 1, -1, seen.shape[1])[1:]
        seen = seen * np.sqrt(half[:, None] * weights).ravel()[:, None, None]
        seen = seen.reshape(len(begins), -1, seen.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):
            found: Array = np.swapaxes(seen, 1, 2) @ seen
        if not np.isfinite(found).all():
            raise InputError(f"window = {window}: the Gramian overflows float64")
        return found

    coarse = grams(begins, ends)
    done: Array = np.zeros(coarse.shape[1:])
    for _ in range(20):
        middles = (begins + ends) / 2
        order = np.argsort(np.concatenate([begins, middles]), kind="stable")
        begins = np.concatenate([begins, middles])[order]
        ends = np.concatenate([middles, ends])[order]
        fine = grams(begins, ends)
        halves = fine.reshape(-1, 2, *fine.shape[1:]).sum(axis=1)
        size = np.abs(done + halves.sum(axis=0)).max()
        off = np.abs(halves - coarse).max(axis=(1, 2)) > 1e-12 * size
        done += halves[~off].sum(axis=0)
        if not off.any():
            return done
        again = off.repeat(2)
        begins, ends, coarse = begins[again], ends[again], fine[again]
        if len(begins) > MOST_PANELS:
            break
    raise InputError(
        f"window = {window}: the Gramian does not settle about t = {begins[0]:.6g}: A(t) or C(t) "
        "jumps there, which breakpoints would say, or the window is too long"
    )


def _panels(window: float, breakpoints: ArrayLike | None) -> Array:
    """Return the ends of the first panels of a quadrature, (panels + 1,)."""
    given = np.atleast_1d(finite([] if breakpoints is None else breakpoints, "breakpoints [-]"))
    if given.ndim != 1:
        raise InputError(f"breakpoints has shape {given.shape}: must be (m,)")
    if (bad := np.flatnonzero((given <= 0) | (given >= window))).size:
        k = bad[0]
        raise InputError(
            f"breakpoints[{k}] = {given[k]}: must be inside the window, between 0 and {window}"
        )
    inner = np.unique(given)
    between = np.concatenate([[0.0], inner, [window]])
    counts = np.maximum(2, np.ceil(16 * np.diff(between) / window)).astype(int)
    parts = [
        np.linspace(a, b, count + 1)[:-1]
        for a, b, count in zip(between[:-1], between[1:], counts, strict=True)
    ]
    return np.concatenate([*parts, [window]])


def _resolved(A: Any, C: Any, edges: Array, nodes: Array) -> tuple[Array, Array]:
    """Return beginnings and ends of panels, those cut that hide something between nodes."""
    powers = np.polynomial.legendre.legvander(nodes, 7)
    todo = list(zip(edges[:-1], edges[1:], [5] * (len(edges) - 1), strict=True))
    # What A(t) and C(t) are between the nodes, at times without a pattern.
    inside = np.concatenate([[0.0, 1.0], (np.arange(PROBES) * 0.618033988749895) % 1.0])
    out: list[tuple[float, float]] = []
    functions = [(given, name) for given, name in ((A, "A"), (C, "C")) if _varies(given)]
    largest = {name: 0.0 for _, name in functions}
    while todo:
        begin, end, left = todo.pop()
        middle, half = (begin + end) / 2, (end - begin) / 2
        smooth = True
        for given, name in functions:
            values = np.array([_at(given, middle + half * x, name, None) for x in nodes])
            fit = np.linalg.solve(powers, values.reshape(len(nodes), -1))
            at = 2 * inside - 1
            guess = np.polynomial.legendre.legvander(at, 7) @ fit
            seen = np.array([_at(given, middle + half * x, name, None) for x in at])
            seen = seen.reshape(guess.shape)
            largest[name] = max(largest[name], float(np.abs(seen).max(initial=0.0)))
            smooth &= bool(np.abs(seen - guess).max(initial=0.0) <= 1e-3 * largest[name])
        if smooth or left == 0:
            out.append((begin, end))
        else:
            todo += [(begin, middle, left - 1), (middle, end, left - 1)]
    found = np.array(sorted(out))
    return found[:, 0], found[:, 1]


def rows(
    A: SystemLike | Callable[[float], ArrayLike],
    C: ArrayLike | Callable[[float], ArrayLike] | None = None,
    *,
    window: float | None = None,
    dt: float | None = None,
    times: ArrayLike | None = None,
    R: ArrayLike | None = None,
    time: str = "continuous",
    rtol: float = 1e-12,
) -> Array:
    """Return whitened rows R^-1/2 C Phi(t, t_0) of samples: of a window, or at any times.

    Parameters
    ----------
    A, C : array_like or state-space object, or functions of the time
        One system; for one that varies, A(t) -> (n, n), C(t) -> (p, n) or either of them
        constant.
    window, dt : float, optional
        How long and how often outputs are taken: floor(window / dt) + 1 samples, from 0 on.
    times : array_like, shape (K,), optional
        In place of them: increasing, at any intervals.
    R : array_like, optional
        Covariance of the outputs of one sample.
    time : {"continuous", "discrete"}
        Whether A is that of x' = A x, or of x[k+1] = A x[k] with step `dt`; with `times`
        it is continuous. A state-space object with a nonzero attribute ``dt`` is discrete.
    rtol : float
        Accuracy of the transition between two times where A is a function.

    Returns
    -------
    ndarray, shape (samples p, n)
        About the state at time 0, or at the first of `times`.

    Notes
    -----
    Where A varies, by the integrator of `gramian.dynamics.from_ode` (Gauss-Legendre, order
    six), which is exact for the transition to `rtol`.

    Examples
    --------
    >>> rows([[0, 1], [0, 0]], [[1, 0]], times=[2.0, 3.0, 7.0])
    array([[1., 0.],
           [1., 1.],
           [1., 5.]])
    >>> rows(lambda t: [[0, 2 * t], [0, 0]], [[1, 0]], times=[0.0, 1.0, 3.0]).round(9)
    array([[1., 0.],
           [1., 1.],
           [1., 9.]])
    """
    return _sampled_rows(A, C, window, dt, times, R, time, rtol)[0]


def _sampled_rows(
    A: Any,
    C: Any,
    window: float | None,
    dt: float | None,
    times: ArrayLike | None,
    R: ArrayLike | None,
    time: str,
    rtol: float = 1e-12,
) -> tuple[Array, Array | None]:
    """Return rows, and their errors where they are worse than rounding."""
    time = time_of(A, time)
    if times is None:
        dt = sampled(A, dt)
        if window is None or dt is None:
            raise InputError("window and dt are missing: give both, or times")
        if not (_varies(A) or _varies(C)):
            return _regular(A, C, window, dt, R, time), None
        at = _times(window, dt)
    elif window is not None or dt is not None:
        raise InputError("times was given beside window and dt: give one or the other")
    else:
        at = _increasing(times)
    if time == "discrete":
        raise InputError('time = "discrete" goes with window and dt of a constant A')
    if _varies(A) or _varies(C):
        return _varying(A, C, at, R, rtol)
    system = system_of(A, C, R=R)
    block = whitener(R, len(system.C), system.noise) @ system.C
    steps = {span: transition(system.A, span) for span in set(np.diff(at).tolist())}
    out = [block]
    with np.errstate(over="ignore", invalid="ignore"):
        for span in np.diff(at).tolist():
            block = block @ steps[span]
            out.append(block)
    return _stacked(out, f"times to {at[-1]}"), None


def _times(window: float, dt: float) -> Array:
    """Return the times of the samples of a window."""
    count = _samples(window, number(dt, "dt [-]"))
    assert count is not None
    _require_few(count, window, dt)
    return dt * np.arange(float(count))


def _increasing(times: ArrayLike) -> Array:
    at = np.atleast_1d(finite(times, "times [-]"))
    if at.ndim != 1 or not at.size:
        raise InputError(f"times has shape {at.shape}: must be (K,), not empty")
    if (bad := np.flatnonzero(np.diff(at) <= 0)).size:
        k = bad[0] + 1
        raise InputError(f"times[{k}] = {at[k]}: must be later than the one before, {at[k - 1]}")
    return at


def _stacked(blocks: list[Array], where: str) -> Array:
    if not np.isfinite(blocks[-1]).all():
        raise InputError(f"{where}: the rows overflow float64, the system grows too fast for it")
    return np.concatenate(blocks)


def _require_few(samples: int, window: float, dt: float) -> None:
    if samples > MOST_SAMPLES:
        raise InputError(
            f"window = {window} and dt = {dt}: {samples} samples, more than {MOST_SAMPLES}: "
            "sample less often, or take `gramian`, which keeps no rows"
        )


def _regular(
    A: SystemLike, C: ArrayLike | None, window: float, dt: float, R: ArrayLike | None, time: str
) -> Array:
    system = system_of(A, C, R=R)
    samples = _samples(window, number(dt, "dt [-]"))
    assert samples is not None
    _require_few(samples, window, dt)
    white = whitener(R, len(system.C), system.noise) @ system.C
    step = transition(system.A, dt) if time == "continuous" else system.A
    out = [white]
    with np.errstate(over="ignore", invalid="ignore"):
        leap = np.linalg.matrix_power(step, CHUNK)
        # What no output sees may overflow long before the rows do: then one by one.
        alone = samples if not np.isfinite(leap).all() else min(samples, CHUNK)
        for _ in range(alone - 1):
            out.append(out[-1] @ step)
        chunks = [np.concatenate(out)]
        for _ in range(alone, samples, CHUNK):
            chunks.append(chunks[-1] @ leap)
    return _stacked(chunks, f"window = {window}")[: samples * len(white)]


def _varies(given: Any) -> bool:
    # State-space objects of SciPy and python-control can be called too.
    return callable(given) and not (hasattr(given, "A") and hasattr(given, "C"))


def _at(given: Any, t: float, name: str, shape: tuple[int, ...] | None) -> Array:
    """Return a matrix that may be a function of the time."""
    value = finite(given(t) if callable(given) else given, f"{name}(t = {t:g})")
    if shape is not None and value.shape != shape:
        raise InputError(f"{name}(t = {t:g}) has shape {value.shape}: must be {shape} as before")
    return value


def _varying(A: Any, C: Any, at: Array, R: ArrayLike | None, rtol: float) -> tuple[Array, Array]:
    """Return the rows of a system that varies, and their errors."""
    from gramian.models.dynamics import from_ode

    if C is None:
        raise InputError("C is missing: give A and C")
    first = system_of(_at(A, at[0], "A", None), _at(C, at[0], "C", None))
    a_shape, c_shape = first.A.shape, first.C.shape
    white = whitener(R, c_shape[0])
    if len(at) == 1:
        return white @ first.C, np.zeros_like(first.C)
    path = from_ode(
        lambda t, x: _at(A, t, "A", a_shape) @ x,
        lambda t, x: _at(C, t, "C", c_shape) @ x,
        # A linear system has its transitions about any state.
        np.zeros(first.n),
        at,
        jacobian=(lambda t, x: _at(A, t, "A", a_shape), lambda t, x: _at(C, t, "C", c_shape)),
        rtol=rtol,
    )
    seen, error = (part.reshape(len(at), *c_shape) for part in path.rows_and_errors())
    return (white @ seen).reshape(-1, first.n), (np.abs(white) @ error).reshape(-1, first.n)


def problem(
    A: SystemLike | Callable[[float], ArrayLike],
    C: ArrayLike | Callable[[float], ArrayLike] | None = None,
    *,
    window: float | None = None,
    dt: float | None = None,
    times: ArrayLike | None = None,
    R: ArrayLike | None = None,
    time: str = "continuous",
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    prior: ArrayLike | Mapping[str, float] | None = None,
) -> Problem:
    """Return the problem of a window of samples, for `gramian.analyze`.

    Parameters
    ----------
    A, C, window, dt, times, R, time
        As for `rows`.
    names, units : sequence of str, length n, optional
    prior : array_like, shape (n,), or mapping of str to float, optional
        Standard deviation of what is known beforehand of each state (NaN: not at
        all); that of a `System` by default.

    Returns
    -------
    Problem
        About the state at time 0, or at the first of `times`.

    Examples
    --------
    >>> import gramian as gm
    >>> answer = gm.analyze(problem([[0, 1], [0, 0]], [[1, 0]], window=10.0, dt=1.0))
    >>> answer.status
    'observable'
    """
    varies = _varies(A) or _varies(C)
    seen, error = _sampled_rows(A, C, window, dt, times, R, time)
    if varies:
        start = float(_increasing(times)[0]) if times is not None else 0.0
        system = system_of(
            _at(A, start, "A", None), _at(C, start, "C", None), names, units, prior, R
        )
    else:
        constant: tuple[Any, Any] = (A, C)
        system = system_of(*constant, names, units, prior, R)
        # What no output shows is zero in the rows but for rounding, which would count.
        hidden = _core.LinearUnobservable(system.A, system.C, None)
        if hidden.null_space().size:
            seen = hidden.project(seen)
        if times is None and time_of(A, time) == "continuous":
            hidden = _core.LinearUnobservable(
                _step(system, sampled(A, dt), np.array(hidden.scales[0])), system.C, None
            )
            if hidden.null_space().size:
                seen = hidden.project(seen)
    found = Problem(
        seen,
        system.names,
        # As accurate as the transitions are.
        row_error=error,
        units=system.units,
        scale=system.prior,
        combinations=dict(system.combinations),
    )
    known = ~np.isnan(system.prior)
    return found.prior(
        {name: s for name, s, k in zip(system.names, system.prior, known, strict=True) if k}
    )


def _step(system: System, dt: float | None, scales: Array) -> Array:
    """Return the transition from sample to sample, for what samples cannot show.

    Those at a period of the system may hide what the outputs between them would show. In
    the balanced states of A rounding is told from couplings.
    """
    dt = number(dt, "dt [-]")
    # A fast growth over a step would hide the rest of the pencil.
    if np.linalg.eigvals(system.A).real.max() * dt > np.log(1e3):
        return system.A
    balance = scales / scales[:, None]
    step = transition(system.A, dt) * balance
    step[np.abs(step) <= 64 * np.finfo(float).eps * np.abs(step).max()] = 0.0
    cleaned: Array = step / balance
    return cleaned


@dataclass(frozen=True, eq=False, repr=False)
class Piecewise(Answer):
    """A system that is constant by segments, and what each of them adds.

    Attributes
    ----------
    names : tuple of str, length n
    segment_ranks : tuple of int
        The rank of each segment alone.
    stripped_ranks : tuple of int
        The rank of [Q_1; ..; Q_j], the stripped observability matrix, after each.
    total_ranks : tuple of int
        The rank of [Q_1; Q_2 Phi_1; ..], the total one: what counts.
    kernel_rests : tuple of bool
        Whether the kernel of each segment's Q lies in that of its A. Where all
        do, stripped and total matrix have the same kernel.
    determined : ndarray of bool, shape (segments, n)
        Which states, as they are at the beginning, are known after each segment.
    null_space : ndarray, shape (n, nullity)
        What the whole does not see of the state at the beginning.
    A, C : ndarray, shape (segments, n, n) and (segments, p, n)
    durations : ndarray, shape (segments,)
    """

    names: tuple[str, ...]
    segment_ranks: tuple[int, ...]
    stripped_ranks: tuple[int, ...]
    total_ranks: tuple[int, ...]
    kernel_rests: tuple[bool, ...]
    determined: NDArray[np.bool_]
    null_space: Array
    A: Array
    C: Array
    durations: Array

    _more_in_dict = ("null_combinations",)
    _not_in_dict = frozenset({"A", "C"})

    @property
    def rank(self) -> int:
        """Rank of the total observability matrix."""
        return self.total_ranks[-1]

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """The null space in words."""
        return tuple(describe_direction(column, self.names) for column in self.null_space.T)

    def stripped_matrix(self) -> Array:
        """Return [Q_1; ..; Q_r], shape (r n p, n)."""
        stacked = observability_matrix(self.A, self.C)
        return stacked.reshape(-1, stacked.shape[-1])

    def rows(self, *, dt: float, R: ArrayLike | None = None) -> Array:
        """Return whitened rows of samples at 0, dt, 2 dt, ... from the beginning.

        Parameters
        ----------
        dt : float
            Time between samples; the last is that at the end, if one falls there.
        R : array_like, optional
            Covariance of the outputs of one sample.

        Returns
        -------
        ndarray, shape (samples p, n)
            About the state at the beginning.
        """
        return rows_of_segments(self.A, lambda k, _: self.C[k], self.durations, dt, R)

    def summary(self) -> str:
        """Return the ranks segment by segment, as text."""
        lines = [f"rank {self.rank} of {len(self.names)} after {len(self.durations)} segments"]
        ranks = zip(self.segment_ranks, self.stripped_ranks, self.total_ranks, strict=True)
        for j, (alone, stripped, total) in enumerate(ranks):
            lines.append(f"  segment {j}: alone {alone}, stripped {stripped}, total {total}")
        lines += [f"  never seen: {text}" for text in self.null_combinations]
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values = {
            "duration": self.durations,
            "alone": np.array(self.segment_ranks),
            "stripped": np.array(self.stripped_ranks),
            "total": np.array(self.total_ranks),
        }
        return Columns("segment", range(len(self.durations)), values, {})


def rows_of_segments(
    A: Array,
    outputs: Callable[[int, float], Array],
    durations: Array,
    dt: float,
    R: ArrayLike | None,
) -> Array:
    """Return whitened rows of samples every `dt` about the state at the beginning.

    `outputs` gives C (p, n) of a segment at a time.
    """
    dt = number(dt, "dt [-]")
    if not dt > 0:
        raise InputError(f"dt = {dt}: must be > 0 and finite")
    if durations.sum() / dt > MOST_SAMPLES:
        raise InputError(f"dt = {dt}: more than {MOST_SAMPLES} samples: take a longer dt")
    p, n = outputs(0, 0.0).shape
    white = whitener(R, p)
    ends = np.cumsum(durations)
    # A sample at the border of two segments is the second one's; but for rounding.
    counts = np.ceil(ends / dt * (1 - 1e-12)).astype(int)
    counts[-1] = int(ends[-1] / dt * (1 + 1e-12)) + 1
    phi, out = np.eye(n), np.empty((counts[-1], p, n))
    begin, first = 0.0, 0
    for j, (a, end, last) in enumerate(zip(A, ends, counts, strict=True)):
        if last > first:
            here = transition(a, max(first * dt - begin, 0.0)) @ phi
            step = transition(a, dt)
            for k in range(first, last):
                out[k] = white @ outputs(j, k * dt) @ here
                if k + 1 < last:
                    here = step @ here
        phi = transition(a, end - begin) @ phi
        begin, first = end, max(first, last)
    return out.reshape(-1, n)


def piecewise(
    A: ArrayLike,
    C: ArrayLike,
    durations: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    rtol: float | None = None,
) -> Piecewise:
    """Analyse a system that is constant by segments: a maneuver, a time-varying system.

    Parameters
    ----------
    A : array_like, shape (segments, n, n)
    C : array_like, shape (segments, p, n) or (p, n)
    durations : array_like, shape (segments,)
        Each > 0.
    names : sequence of str, length n, optional
    rtol : float, optional
        As for `levels`.

    Returns
    -------
    Piecewise

    Raises
    ------
    InputError
        Shapes that do not fit, a duration that is not positive, an unknown name.

    Notes
    -----
    Goshen-Meskin & Bar-Itzhack 1992. The stripped matrix may be used in place of
    the total one where the kernel of each segment rests, A_j N_j = 0 (their
    theorem 1); the total rank is found in any case. Segments are compared in one
    balance of the states, kernel by kernel, not by powers of A. A time-varying
    system is given as short segments.

    Examples
    --------
    >>> still, moved = [[0, 0], [0, 0]], [[0, 1], [0, 0]]
    >>> found = piecewise([still, moved], [[1, 0]], [1.0, 1.0])
    >>> found.total_ranks
    (1, 2)
    """
    a = as_float_array(A, "A")
    if a.ndim != 3 or len(a) == 0:
        raise InputError(f"A has shape {a.shape}: must be (segments, n, n)")
    c = as_float_array(C, "C")
    if c.ndim == 2:
        c = np.broadcast_to(c, (len(a), *c.shape))
    if c.ndim != 3 or len(c) != len(a):
        raise InputError(
            f"C has shape {c.shape}: must be (p, n), or (segments, p, n) with a C for each of the "
            f"{len(a)} segments of A"
        )
    times = np.atleast_1d(as_float_array(durations, "durations"))
    checked = system_of(a[0], c[0], names).names
    if rtol is not None:
        rtol = options.fraction(rtol, "rtol")
    alone, stripped, total, rests, determined, null = _core.piecewise_ranks(a, c, times, rtol)
    return Piecewise(
        names=checked,
        segment_ranks=tuple(alone.tolist()),
        stripped_ranks=tuple(stripped.tolist()),
        total_ranks=tuple(total.tolist()),
        kernel_rests=tuple(rests),
        determined=np.array(determined, dtype=bool),
        null_space=null,
        A=a,
        C=c,
        durations=times,
    )


def _samples(window: float, dt: float | None) -> int | None:
    window = number(window, "window")
    if not window > 0:
        raise InputError(f"window = {window}: must be > 0 and finite")
    if dt is None:
        return None
    dt = number(dt, "dt [-]")
    if not 0 < dt <= window:
        raise InputError(f"dt = {dt}: must be > 0 and no longer than the window, {window}")
    if not window / dt < 2**53:
        raise InputError(f"window = {window} and dt = {dt}: more samples than can be counted")
    # A window of whole steps counts its last sample in spite of rounding.
    return int(np.floor(window / dt * (1 + 1e-12))) + 1
