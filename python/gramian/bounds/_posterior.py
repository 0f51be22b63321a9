"""The posterior Cramer-Rao bound: what no filter of a moving state can do better than.

Reached as `gramian.bounds.posterior` and its neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array, finite
from gramian._noise import Knowledge, as_knowledge, as_noise
from gramian._values import Value
from gramian.exceptions import InputError, UnobservableError
from gramian.problem import Problem, ProblemSource, as_problem, at_least_one_row

__all__ = [
    "Form",
    "Posterior",
    "PosteriorBound",
    "cubature_points",
    "expected_rows",
    "expected_transition",
    "posterior",
]

Array = NDArray[np.float64]
Form = Literal["covariance", "information"]


@dataclass(frozen=True, eq=False)
class Posterior(Value):
    """What is known of a state at one instant; `predict` and `update` give the next.

    Attributes
    ----------
    root : ndarray, shape (..., n, n)
        Upper triangular factor: of the covariance, P = root^T root, or of the
        information, J = root^T root.
    form : {"covariance", "information"}
        Which.

    Notes
    -----
    The covariance form takes any transition but needs a finite prior; the
    information form takes any prior, none included, but needs a transition that
    can be inverted. Both keep a factor and never form or invert P, J or Q.

    Examples
    --------
    >>> start = Posterior.of_prior([5.0, np.inf])
    >>> start.form
    'information'
    >>> start.predict([[1, 1], [0, 1]], np.zeros((2, 2))).update([[1.0, 0.0]]).std.round(3)
    array([1.   , 5.099])
    """

    root: Array
    form: Form

    @classmethod
    def of_prior(
        cls,
        prior: Mapping[str, Any] | ArrayLike | tuple[ArrayLike, ArrayLike],
        form: Form | None = None,
        *,
        names: Sequence[str] | None = None,
        combinations: Mapping[str, Array] | None = None,
    ) -> Posterior:
        """Start from a prior.

        Parameters
        ----------
        prior : mapping, array_like or tuple
            Standard deviations (n,), `inf` for a state of which nothing is known, 0 for
            one that is known exactly; a covariance (..., n, n), which may be singular; or
            by name, as for `gramian.crlb_std`.
        form : {"covariance", "information"}, optional
            By default the covariance form where the prior is finite.
        names : sequence of str, length n, optional
            Of the states, for a prior by name.
        combinations : mapping of str to ndarray, shape (n,), optional
            What else has a name.

        Raises
        ------
        InputError
            A deviation that is negative, a matrix that is not a covariance, a form that
            cannot hold the prior.
        """
        if names is not None:
            names = options.names(names, "names", "names of states")
        start, exact = _start(prior, form, names, combinations)
        return start.know(exact) if len(exact) else start

    def know(self, combinations: ArrayLike) -> Posterior:
        """Take in combinations (q, n) of the states that are known exactly.

        Returns
        -------
        Posterior
            In covariance form, whose covariance is singular then.

        Raises
        ------
        InputError
            Where the other combinations are not all determined yet, and the covariance
            form cannot hold them.
        """
        exact = finite(combinations, "combinations")
        if exact.ndim != 2 or exact.shape[1] != self.n or self.root.ndim != 2:
            raise InputError(f"combinations has shape {exact.shape}: must be (q, {self.n})")
        rows = self.root
        if self.form == "covariance":
            noise = as_noise(self.root.T @ self.root, self.n)
            rows, exact = noise.whiten(np.eye(self.n)), np.vstack([noise.exact, exact])
        covariance = _core.Analysis(at_least_one_row(rows), None, exact).crlb()
        if covariance is None:
            raise InputError(
                "exact knowledge beside states of which nothing is known: no form holds both; "
                "give the others a finite prior, or measure them at the same step"
            )
        return Posterior(_roots(covariance, "covariance"), "covariance")

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.root.shape[-1])

    def predict(
        self,
        transition: ArrayLike,
        process_noise: ArrayLike,
        spread: ArrayLike | None = None,
    ) -> Posterior:
        """Move the state: x' = F x + w.

        Parameters
        ----------
        transition : array_like, shape (..., n, n)
            F, or the Jacobian of the motion.
        process_noise : array_like, shape (..., n, n)
            Covariance of w; it may be singular or zero.
        spread : array_like, shape (..., m, n), optional
            Rows of an uncertain transition; see `expected_transition`.
        """
        start = self if spread is None else self.update(spread)
        moved = _transition(transition, self.form, self.n)[..., None, :, :]
        noise = _roots(process_noise, "process_noise")[..., None, :, :]
        n = self.n
        return self._run(start.root, np.zeros((2, 0, n)), moved, noise)

    def update(self, rows: ArrayLike, detection: ArrayLike = 1.0) -> Posterior:
        """Take in measurements.

        Parameters
        ----------
        rows : array_like, shape (..., k, n)
            Whitened rows (d h / d x) / sigma.
        detection : array_like, shape () or (k,)
            Probability that they are had, in [0, 1].
        """
        matrix = as_float_array(rows, "rows")
        chance, n = _probability(detection), self.n
        if matrix.ndim < 2 or matrix.shape[-1] != n:
            raise InputError(f"rows has shape {matrix.shape}: must be (k, {n}) or (..., k, {n})")
        if chance.ndim and chance.shape != matrix.shape[-2:-1]:
            raise InputError(
                f"detection has shape {chance.shape}: must be () or ({matrix.shape[-2]},)"
            )
        weighted = matrix * np.sqrt(chance)[..., None]
        found = self._run(
            self.root, weighted[..., None, :, :], np.eye(n)[None], np.zeros((1, n, n))
        )
        if self.form == "information" and self.root.ndim == weighted.ndim == 2:
            return self._with_heavy(weighted, found)
        return found

    def _with_heavy(self, rows: Array, found: Posterior) -> Posterior:
        """Return `found`, or the covariance where a factor of the information loses digits.

        Beside rows heavier by half their digits or more the others fade in one triangular
        factor; the axes of the error ellipsoid keep both.
        """
        every = np.vstack([self.root, rows])
        every = every[every.any(axis=1)]
        if not _uneven(every):
            # What is far below all rows is left by rounding of some that say the same.
            units = np.abs(every).max(axis=0, initial=0.0)
            sizes = np.abs(found.root / np.where(units > 0, units, 1.0)).max(axis=1)
            noise = 32 * np.finfo(float).eps * np.sqrt(max(every.shape))
            return replace(found, root=np.where((sizes > noise)[:, None], found.root, 0.0))
        analysis = _core.Analysis(every, None, None)
        axes = analysis.crlb_root()
        if axes is not None:
            return Posterior(_triangle(axes), "covariance")
        if len(every) > analysis.rank:
            raise InputError(
                "rows so heavy that the others fade beside them, and states of which nothing is "
                "known: no form holds both; give the others a finite prior, or measure them at "
                "the same step"
            )
        return found

    @property
    def std(self) -> Array:
        """Bound (..., n) on each state; `inf` where it is not determined."""
        n = self.n
        nothing = np.zeros((1, 0, n))
        found = _core.posterior(
            self.root,
            nothing,
            np.zeros((0, 0, n)),
            np.eye(n)[None],
            np.zeros((1, n, n)),
            self.form == "covariance",
            False,
        )
        return found["std"][..., 0, :]

    @property
    def covariance(self) -> Array:
        """Bound (..., n, n) on the covariance.

        Raises
        ------
        UnobservableError
            Where none exists.
        """
        return _covariance(self.root, self.form, self.std)

    def _run(self, root: Array, rows: Array, transition: Array, noise: Array) -> Posterior:
        steps = rows.shape[-3]
        found = _core.posterior(
            root,
            rows,
            np.zeros((steps - 1, 0, self.n)),
            transition,
            noise,
            self.form == "covariance",
            False,
        )
        after = found["roots"][..., 0, :, :]
        if np.isnan(after).any():
            raise InputError("a bound overflows float64: choose other units")
        return replace(self, root=after)


@dataclass(frozen=True, eq=False, repr=False)
class PosteriorBound(Answer):
    """The posterior bound over time.

    Attributes
    ----------
    std : ndarray, shape (..., steps, n)
        Bound on each state after the measurements of each step; `inf` where a
        state is not determined yet.
    last : Posterior
        What is known at the end, to go on from.
    roots : ndarray, shape (..., steps, n, n), or None
        The factor at every step, if kept.
    """

    std: Array
    last: Posterior
    roots: Array | None = None

    _more_in_dict = ("form",)
    _not_in_dict = frozenset({"last", "roots"})

    @property
    def form(self) -> Form:
        """What is kept: "covariance" or "information"."""
        return self.last.form

    def rmse(self, states: Sequence[int]) -> Array:
        """Bound (..., steps) on the root mean square error of several states together.

        Parameters
        ----------
        states : sequence of int
            Which: the components of a position, for instance.
        """
        chosen = self.std[..., list(states)]
        # Infinite ones stay infinite.
        rmse: Array = np.sqrt(np.sum(chosen**2, axis=-1))
        return rmse

    @property
    def covariance(self) -> Array:
        """Bound (..., steps, n, n) on the covariance at every step.

        Raises
        ------
        InputError
            When the factors were not kept.
        UnobservableError
            When there is a step at which none exists.
        """
        if self.roots is None:
            raise InputError('the factors were not kept: call posterior with keep="all"')
        return _covariance(self.roots, self.last.form, self.std)

    def summary(self) -> str:
        """Return the first and last bound in words."""
        first, last = self.std[..., 0, :], self.std[..., -1, :]
        if self.std.ndim > 2:
            first, last = (np.median(x.reshape(-1, x.shape[-1]), axis=0) for x in (first, last))
        text = [
            f"x{i}: {a:.6g} to {b:.6g}" for i, (a, b) in enumerate(zip(first, last, strict=True))
        ]
        return f"posterior bound over {self.std.shape[-2]} steps: " + ", ".join(text)

    def _as_table(self) -> Columns:
        if self.std.ndim > 2:
            raise InputError("a table is of one run: this is a batch")
        values = {f"x{i}": column for i, column in enumerate(self.std.T)}
        return Columns("step", range(len(self.std)), values, {})


def posterior(
    rows: ArrayLike | Sequence[ArrayLike | Problem | ProblemSource | None],
    transition: ArrayLike,
    process_noise: ArrayLike,
    prior: ArrayLike | Mapping[str, Any] | tuple[ArrayLike, ArrayLike] | Posterior,
    *,
    detection: ArrayLike = 1.0,
    spread: ArrayLike | None = None,
    form: Form | None = None,
    keep: Literal["std", "all"] = "std",
) -> PosteriorBound:
    """Return the posterior Cramer-Rao bound of a filter, step by step.

    Parameters
    ----------
    rows : array_like, shape (..., steps, k, n), or sequence of array_like (k_i, n) or None
        Whitened measurement rows (d h / d x) / sigma at every step, the first
        included. Sensors may move, differ and be absent: a sequence may hold any
        number of rows at each step, a Problem or Model, whose exact knowledge counts too,
        or None.
    transition : array_like, shape (n, n) or (..., steps - 1, n, n)
        F, or the Jacobian of the motion, from each step to the next; a leading
        axis of 1 instead of steps - 1 serves all steps.
    process_noise : array_like, shape (n, n) or (..., steps - 1, n, n)
        Covariance of the process noise; it may be singular or zero.
    prior : array_like, shape (n,) or (..., n, n), mapping, or Posterior
        Before the first measurement: standard deviations (`inf` for nothing known, 0 for
        exactly), a covariance, both also by name as for `gramian.crlb_std`, or where an
        earlier bound ended.
    detection : array_like, shape (), (steps,) or (steps, k)
        Probability in [0, 1] that a measurement is had.
    spread : array_like, shape (..., steps - 1, m, n), optional
        Rows of uncertain transitions; see `expected_transition`.
    form : {"covariance", "information"}, optional
        Which factor is propagated. By default the covariance form where the prior
        is finite, which is the faster; see `Posterior`.
    keep : {"std", "all"}
        Whether the factors of every step are kept, for `PosteriorBound.covariance`.

    Returns
    -------
    PosteriorBound

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, a prior or process
        noise that is not a covariance, a probability outside [0, 1], a
        transition without inverse in information form.

    Notes
    -----
    The recursion of Tichavsky, Muravchik & Nehorai 1998 (eqs. (4) and (5) of Xu et
    al. 2009) on triangular factors: neither P, J nor Q is inverted, so that small
    process noise costs no digits. For nonlinear motion and measurements give the
    Jacobians at the true state, or `expected_rows` and `expected_transition` over
    a set of trajectories.

    With a detection probability p the information of a measurement is multiplied
    by p, its mean over detections (the information reduction factor). That is a
    bound, if not the tightest one: the mean over all sequences of detections is
    larger (Hernandez, Farina & Ristic 2006).

    Cost: about 1.5 microseconds for a trial of 100 steps with 4 states, in a batch.

    Examples
    --------
    A position and velocity in the plane, the position measured to sqrt(5) m after
    the first step:

    >>> import numpy as np
    >>> turn = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    >>> noise = 0.05 * np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1.0]])
    >>> seen = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]]) / 5**0.5
    >>> bound = posterior([None] + 20 * [seen], turn, noise, np.diag([5.0, 10, 5, 10]))
    >>> bound.rmse([0, 2])[[0, 1, 20]]
    array([3.16227766, 2.73899281, 1.89934607])
    >>> bound.rmse([1, 3])[[0, 20]]
    array([4.47213595, 0.63338613])
    """
    options.choice(keep, "keep", ("std", "all"))
    if isinstance(prior, Posterior):
        if form not in (None, prior.form):
            raise InputError(f'form = "{form}": the prior given is in form "{prior.form}"')
        start, exact = prior, np.zeros((0, prior.n))
    else:
        source = _first_problem(rows)
        names = None if source is None else source.names
        more = None if source is None else source.combinations
        units = () if source is None else source.units
        start, exact = _start(prior, form, names, more, units)
    n = start.n
    plain, constraints = _plain_rows(rows, exact)
    if constraints:
        if spread is not None:
            raise InputError("spread: not beside exact knowledge")
        return _step_by_step(start, plain, transition, process_noise, detection, constraints, keep)
    stacked = _stacked(plain, n)
    if start.form == "information" and _fades(start.root, stacked, transition):
        # One triangular factor of the information does not hold both the heavy and the light:
        # that of the covariance does.
        whole = _whole(start)
        if whole is not None:
            start = whole
        elif spread is None:
            return _trial_by_trial(start, stacked, transition, process_noise, detection, keep)
    steps = stacked.shape[-3]
    weighted = _detected(stacked, detection)
    moved = _transition(transition, start.form, n)
    noise = _roots(process_noise, "process_noise")
    found = _core.posterior(
        start.root,
        weighted,
        np.zeros((steps - 1, 0, n)) if spread is None else spread,
        moved[None] if moved.ndim == 2 else moved,
        noise[None] if noise.ndim == 2 else noise,
        start.form == "covariance",
        keep == "all",
    )
    std, roots = found["std"], found["roots"]
    # The least of all is NaN where one is: one way over the numbers, no array between.
    if np.isnan(std.min(initial=0.0) + roots.min(initial=0.0)):
        raise InputError("a bound overflows float64: choose other units")
    return PosteriorBound(
        std=std,
        last=Posterior(np.ascontiguousarray(roots[..., -1, :, :]), start.form),
        roots=roots if keep == "all" else None,
    )


def _start(
    prior: Any,
    form: Form | None,
    names: Sequence[str] | None,
    combinations: Mapping[str, Array] | None,
    units: Sequence[str] = (),
) -> tuple[Posterior, Array]:
    """Return the start of a prior, and what it knows exactly and that start does not hold."""
    if form is not None:
        options.choice(form, "form", ("covariance", "information"))
    covariance = prior[1] if isinstance(prior, tuple) and len(prior) == 2 else prior
    if names is None:
        if prior is None or isinstance(prior, Mapping):
            raise InputError("prior by name: the rows must be problems or models, or names given")
        given = as_float_array(covariance, "prior")
        if given.ndim >= 2:
            return _of_covariance(given, form), np.zeros((0, given.shape[-1]))
        names = [f"x{i}" for i in range(given.size)]
    n = len(names)
    known = as_knowledge(prior, names, combinations, units=units)
    rows, exact = known.whitened, known.exact
    everything = np.linalg.matrix_rank(known.rows) == n if len(known.rows) >= n else False
    if form == "covariance" and not everything:
        raise InputError(
            f'prior of {_open_state(known, names)} = inf: form = "covariance" needs a finite prior'
        )
    if everything and form != "information":
        held = _core.Analysis(at_least_one_row(rows), None, exact).crlb()
        if held is not None:
            return Posterior(_roots(held, "prior"), "covariance"), exact[:0]
    if form == "information" and len(exact):
        raise InputError('prior is singular: form = "information" needs one that is not')
    padded = np.vstack([rows, np.zeros((max(0, n - len(rows)), n))])
    return Posterior(_triangle(padded), "information"), exact


def _open_state(known: Knowledge, names: Sequence[str]) -> str:
    untouched = ~known.rows.any(axis=0)
    return names[int(np.argmax(untouched))]


def _of_covariance(given: Array, form: Form | None) -> Posterior:
    root = _roots(given, "prior")
    if form != "information":
        return Posterior(root, "covariance")
    if (np.diagonal(root, axis1=-2, axis2=-1) == 0).any():
        raise InputError('prior is singular: form = "information" needs one that is not')
    inverse = np.linalg.inv(root)
    return Posterior(_triangle(np.swapaxes(inverse, -1, -2)), form)


def _first_problem(rows: Any) -> Problem | None:
    if isinstance(rows, (list, tuple)):
        for part in rows:
            if isinstance(part, (Problem, ProblemSource)):
                return as_problem(part, None)
    return None


def _plain_rows(rows: Any, exact: Array) -> tuple[Any, dict[int, Array]]:
    """Return rows without problems, and the exact combinations of each step that has some."""
    constraints = {0: exact} if len(exact) else {}
    if not isinstance(rows, (list, tuple)):
        return rows, constraints
    plain: list[Any] = []
    for step, part in enumerate(rows):
        if not isinstance(part, (Problem, ProblemSource)):
            plain.append(part)
            continue
        problem = as_problem(part, None)
        plain.append(problem.all_rows)
        if len(problem.constraints):
            before = constraints.get(step, exact[:0])
            constraints[step] = np.vstack([before, problem.constraints])
    return plain, constraints


def _step_by_step(
    start: Posterior,
    rows: Any,
    transition: ArrayLike,
    process_noise: ArrayLike,
    detection: ArrayLike,
    constraints: Mapping[int, Array],
    keep: str,
) -> PosteriorBound:
    """Return the bound where some steps know combinations exactly."""
    n = start.n
    stacked = _stacked(rows, n)
    if stacked.ndim != 3:
        raise InputError(f"rows has shape {stacked.shape}: exact knowledge goes with one trial")
    weighted = _detected(stacked, detection)
    steps = len(weighted)
    moved, noise = (
        np.broadcast_to(as_float_array(given, name), (max(steps - 1, 1), n, n))
        for given, name in ((transition, "transition"), (process_noise, "process_noise"))
    )
    at, std, roots = start, np.zeros((steps, n)), np.zeros((steps, n, n))
    for k in range(steps):
        if k:
            at = at.predict(moved[k - 1], noise[k - 1])
        at = at.update(weighted[k])
        if k in constraints:
            at = at.know(constraints[k])
        std[k], roots[k] = at.std, at.root
    same = start.form == at.form
    return PosteriorBound(std, at, roots if keep == "all" and same else None)


def _fades(root: Array, rows: Array, transition: ArrayLike) -> bool:
    """Say whether rows are so heavy, now or after the first move, that others fade beside them."""
    n = root.shape[-1]
    every = [root.reshape(-1, n), rows.reshape(-1, n)]
    if not all(np.isfinite(part).all() for part in every):
        return False
    moved = as_float_array(transition, "transition")
    if moved.ndim >= 2 and moved.shape[-2:] == (n, n) and moved.size:
        first = moved if moved.ndim == 2 else moved[..., 0, :, :]
        every.append((root @ _inverse(first)).reshape(-1, n))
    return _uneven(np.vstack(every))


def _whole(start: Posterior) -> Posterior | None:
    """Return the covariance form of what is known of all states; None where it is not all."""
    roots = start.root.reshape(-1, start.n, start.n)
    triangles = []
    for root in roots:
        axes = _core.Analysis(root, None, None).crlb_root()
        if axes is None:
            return None
        triangles.append(_triangle(axes))
    return Posterior(np.array(triangles).reshape(start.root.shape), "covariance")


def _trial_by_trial(
    start: Posterior,
    rows: Array,
    transition: ArrayLike,
    process_noise: ArrayLike,
    detection: ArrayLike,
    keep: str,
) -> PosteriorBound:
    """Return the bound of each trial by itself."""
    if rows.ndim == 3 and start.root.ndim == 2:
        return _step_by_step(start, rows, transition, process_noise, detection, {}, keep)
    n = start.n
    moved, noise = (
        given[None] if given.ndim == 2 else given
        for given in (
            as_float_array(transition, "transition"),
            as_float_array(process_noise, "process_noise"),
        )
    )
    batch = np.broadcast_shapes(
        rows.shape[:-3], moved.shape[:-3], noise.shape[:-3], start.root.shape[:-2]
    )
    roots, seen, moves, noises = (
        np.broadcast_to(part, batch + part.shape[part.ndim - own :])
        for part, own in ((start.root, 2), (rows, 3), (moved, 3), (noise, 3))
    )
    found = [
        _step_by_step(
            Posterior(roots[i], start.form), seen[i], moves[i], noises[i], detection, {}, keep
        )
        for i in np.ndindex(batch)
    ]
    lasts = [one.last for one in found]
    if len({last.form for last in lasts}) > 1:
        whole = [last if last.form == "covariance" else _whole(last) for last in lasts]
        if any(last is None for last in whole):
            raise InputError(
                "rows so heavy that the others fade beside them, and trials of which some end "
                "with states of which nothing is known: give these one by one"
            )
        lasts = [last for last in whole if last is not None]
    every = [one.roots for one in found if one.roots is not None]
    kept = np.array(every).reshape(*batch, -1, n, n) if len(every) == len(found) else None
    return PosteriorBound(
        np.array([one.std for one in found]).reshape(*batch, -1, n),
        Posterior(np.array([last.root for last in lasts]).reshape(*batch, n, n), lasts[0].form),
        kept,
    )


def expected_rows(rows: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Return rows whose information is the mean of that of several sets of rows.

    Parameters
    ----------
    rows : array_like, shape (samples, ..., k, n)
        Whitened rows at the points of a set: Monte Carlo trajectories, or the
        points of `cubature_points`.
    weights : array_like, shape (samples,), optional
        Weights >= 0 of the samples; equal by default.

    Returns
    -------
    ndarray, shape (..., n, n)
        Upper triangular rows: E[H^T R^-1 H] of the posterior bound, found without
        forming it.

    Examples
    --------
    >>> expected_rows([[[1.0, 0.0]], [[0.0, 1.0]]]).round(3)
    array([[0.707, 0.   ],
           [0.   , 0.707]])
    """
    values = finite(rows, "rows")
    if values.ndim < 3 or 0 in values.shape:
        raise InputError(f"rows has shape {values.shape}: must be (samples, ..., k, n)")
    samples, *batch, k, n = values.shape
    weighted = values * np.sqrt(_weights(weights, samples)).reshape(-1, *([1] * (values.ndim - 1)))
    tall = np.moveaxis(weighted, 0, -3).reshape(*batch, samples * k, n)
    if samples * k < n:
        tall = np.concatenate([tall, np.zeros((*batch, n - samples * k, n))], axis=-2)
    return _triangle(tall)


def expected_transition(
    transitions: ArrayLike, process_noise: ArrayLike, weights: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return the mean of several transitions, and the rows of their spread.

    Parameters
    ----------
    transitions : array_like, shape (samples, ..., n, n)
        Jacobians of the motion at the points of a set.
    process_noise : array_like, shape (n, n) or (..., n, n)
        Covariance of the process noise, not singular.
    weights : array_like, shape (samples,), optional
        Weights >= 0 of the samples; equal by default.

    Returns
    -------
    mean : ndarray, shape (..., n, n)
    spread : ndarray, shape (..., n, n)
        Rows S with S^T S = E[(F - mean)^T Q^-1 (F - mean)].

    Raises
    ------
    InputError
        Also where the process noise is singular: then a transition that varies
        has no finite mean information.

    Notes
    -----
    Tichavsky's D11 = E[F^T Q^-1 F] is that of the mean transition and S^T S; D12
    and D22 hold the mean alone. So the recursion with the mean transition, with
    the rows S taken in before each, is the exact one.
    """
    values = finite(transitions, "transitions")
    if values.ndim < 3 or values.shape[-1] != values.shape[-2] or 0 in values.shape:
        raise InputError(f"transitions has shape {values.shape}: must be (samples, ..., n, n)")
    chances = _weights(weights, values.shape[0])
    mean = np.tensordot(chances, values, axes=1)
    noise = _roots(process_noise, "process_noise")
    if (np.diagonal(noise, axis1=-2, axis2=-1) == 0).any():
        raise InputError("process_noise is singular: the mean of several transitions needs one")
    one, n = values.shape[1:], values.shape[-1]
    if noise.shape not in ((n, n), one):
        raise InputError(
            f"process_noise has shape {noise.shape}, the transitions {values.shape}: "
            f"must be ({n}, {n}) or {one}"
        )
    # Q^-1 = U^-1 U^-T for the factor Q = U^T U.
    whitened = np.linalg.solve(np.swapaxes(noise, -1, -2), values - mean)
    return mean, expected_rows(whitened, chances)


def cubature_points(mean: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Return points and weights that have the mean and covariance of a normal state.

    Parameters
    ----------
    mean : array_like, shape (n,)
    covariance : array_like, shape (n, n)
        It may be singular.

    Returns
    -------
    points : ndarray, shape (2 n, n)
    weights : ndarray, shape (2 n,)
        Equal: means of polynomials up to the third degree are exact.

    Notes
    -----
    The spherical-radial rule of Arasaratnam & Haykin 2009.

    Examples
    --------
    >>> cubature_points([1.0, 0.0], [[4.0, 0.0], [0.0, 1.0]])[0].round(3)
    array([[ 3.828,  0.   ],
           [ 1.   ,  1.414],
           [-1.828,  0.   ],
           [ 1.   , -1.414]])
    """
    centre = finite(mean, "mean")
    root = _roots(covariance, "covariance")
    n = centre.size
    if centre.shape != (n,) or root.shape != (n, n):
        raise InputError(
            f"mean has shape {centre.shape}, covariance {root.shape}: must be (n,) and (n, n)"
        )
    arms = np.sqrt(n) * root
    return np.concatenate([centre + arms, centre - arms]), np.full(2 * n, 1 / (2 * n))


def _uneven(rows: Array) -> bool:
    """Say whether rows differ in weight by more than half the digits."""
    units = np.abs(rows).max(axis=0)
    sizes = np.abs(rows / np.where(units > 0, units, 1.0)).max(axis=1)
    sizes = sizes[sizes > 0]
    return bool(sizes.size) and bool(sizes.max() > 1e8 * sizes.min())


def _triangle(rows: Array) -> Array:
    """Reduce rows to an upper triangle of the same information."""
    factor: Any = np.linalg.qr(rows, mode="r")
    triangle: Array = factor
    return triangle


def _roots(covariance: ArrayLike, name: str) -> Array:
    try:
        return _core.semidefinite_roots(covariance)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _transition(transition: ArrayLike, form: Form, n: int) -> Array:
    matrix = as_float_array(transition, "transition")
    if matrix.ndim < 2 or matrix.shape[-2:] != (n, n):
        raise InputError(f"transition has shape {matrix.shape}: must be (..., {n}, {n})")
    if form == "covariance":
        return np.ascontiguousarray(np.swapaxes(matrix, -1, -2))
    inverse = _inverse(matrix)
    if not np.isfinite(inverse).all():
        raise InputError(
            'transition has no inverse: form = "information" needs one; '
            'with a finite prior use form = "covariance"'
        )
    return inverse


def _inverse(matrix: Array) -> Array:
    """Return the inverse of square matrices in any units, NaN where there is none."""
    rows = columns = np.ones(matrix.shape[:-1])
    with np.errstate(all="ignore"):
        for _ in range(2):
            for axis in (-1, -2):
                scaled = matrix * rows[..., None] * columns[..., None, :]
                size = 2.0 ** -np.rint(np.log2(np.abs(scaled).max(axis=axis, initial=0.0)))
                size = np.where(np.isfinite(size), size, 1.0)
                rows, columns = (rows * size, columns) if axis == -1 else (rows, columns * size)
        scaled = matrix * rows[..., None] * columns[..., None, :]
        usable = np.isfinite(scaled).all(axis=(-1, -2), keepdims=True)
        scaled = np.where(usable, scaled, 0.0)
        condition = np.asarray(np.linalg.cond(scaled))[..., None, None]
        usable = usable & (condition < 1 / np.finfo(float).eps)
        inverse: Any = np.linalg.inv(np.where(usable, scaled, np.eye(matrix.shape[-1])))
        result: Array = np.where(usable, inverse * columns[..., None] * rows[..., None, :], np.nan)
    return result


def _probability(value: ArrayLike) -> Array:
    chance = as_float_array(value, "detection")
    if not ((chance >= 0) & (chance <= 1)).all():
        bad = np.argwhere(~((chance >= 0) & (chance <= 1)))
        index = f"[{', '.join(str(i) for i in bad[0])}]" if chance.ndim else ""
        raise InputError(f"detection{index} = {chance[tuple(bad[0])]}: must be in [0, 1]")
    return chance


def _detected(rows: Array, detection: ArrayLike) -> Array:
    chance = _probability(detection)
    if chance.ndim == 0:
        return rows if chance == 1 else np.multiply(rows, np.sqrt(chance), dtype=float)
    steps, k = rows.shape[-3:-1]
    if chance.shape == (steps,):
        chance = chance[:, None]
    elif chance.shape != (steps, k):
        raise InputError(
            f"detection has shape {chance.shape}: must be (), ({steps},) or ({steps}, {k})"
        )
    weighted: Array = rows * np.sqrt(chance)[..., None]
    return weighted


def _stacked(rows: ArrayLike | Sequence[ArrayLike | None], n: int) -> Array:
    if not isinstance(rows, (np.ndarray, memoryview)) and isinstance(rows, Sequence):
        parts = [
            np.zeros((0, n)) if part is None else as_float_array(part, f"rows[{i}]")
            for i, part in enumerate(rows)
        ]
        if len({part.shape for part in parts}) > 1:
            for i, part in enumerate(parts):
                if part.ndim != 2 or part.shape[1] != n:
                    raise InputError(f"rows[{i}] has shape {part.shape}: must be (k, {n})")
            # A row of zeros tells nothing.
            stacked = np.zeros((len(parts), max(part.shape[0] for part in parts), n))
            for whole, part in zip(stacked, parts, strict=True):
                whole[: part.shape[0]] = part
            return stacked
        values = np.array(parts)
    else:
        values = as_float_array(rows, "rows")
    if values.ndim < 3 or values.shape[-1] != n or values.shape[-3] == 0:
        raise InputError(f"rows has shape {values.shape}: must be (..., steps, k, {n})")
    return values


def _weights(weights: ArrayLike | None, samples: int) -> Array:
    if weights is None:
        return np.full(samples, 1 / samples)
    chances = as_float_array(weights, "weights")
    if chances.shape != (samples,):
        raise InputError(f"weights has shape {chances.shape}: must be ({samples},)")
    if (bad := np.flatnonzero(~(np.isfinite(chances) & (chances >= 0)))).size:
        raise InputError(f"weights[{bad[0]}] = {chances[bad[0]]}: must be >= 0 and finite")
    if not chances.sum() > 0:
        raise InputError("weights are all zero: one must be > 0")
    shares: Array = chances / chances.sum()
    return shares


def _covariance(root: Array, form: Form, std: Array) -> Array:
    if form == "covariance":
        covariance: Array = np.swapaxes(root, -1, -2) @ root
        return covariance
    if not np.isfinite(std).all():
        place = np.argwhere(~np.isfinite(std))[0]
        where = ", ".join(str(i) for i in place[:-1])
        raise UnobservableError(
            f"no covariance exists{f' at [{where}]' if where else ''}: "
            f"state {place[-1]} is not determined there"
        )
    inverse: Any = np.linalg.inv(root)
    result: Array = inverse @ np.swapaxes(inverse, -1, -2)
    return result
