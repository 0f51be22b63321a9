"""Degrees of observability: the published ones, and one that units do not change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import as_float_array, finite, number
from gramian._registry import draw
from gramian._text import brief, describe_combination
from gramian.exceptions import InputError
from gramian.models.linear._levels import observability_matrix
from gramian.models.linear._systems import SystemLike, sampled, system_of, time_of
from gramian.models.linear._windows import gramian, rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Degree", "Information", "degree", "information"]

Array = NDArray[np.float64]
Method = Literal["eigenvalue", "singular_value", "order", "information"]


@dataclass(frozen=True, eq=False, repr=False)
class Degree(Answer):
    """Degrees of observability from the observability matrix Q, as published.

    Attributes
    ----------
    method : {"eigenvalue", "singular_value", "order"}
    names : tuple of str, length n
    values : ndarray, shape (n,)
        Ascending: eigenvalues of Q^T Q for "eigenvalue" and "order", singular
        values of Q for "singular_value". They change with every unit.
    normalized : ndarray, shape (n,)
        The same over the largest.
    vectors : ndarray, shape (n, n)
        The combinations that they belong to, one a column.
    states : tuple of str, length n
        The state with the largest component in each: what "singular_value"
        calls the owner of the value.
    published_order : tuple of int or None
        For "order", the paper's beta: the highest derivative in which the
        combination shows, above `threshold` of its largest; None for zero
        eigenvalues.
    order : tuple of (int or None)
        For "order", the level: the first derivative by which the combination is
        known but for the part `tolerance`; None for never, and for all where levels
        cannot be determined (see `levels`).
    """

    method: Method
    names: tuple[str, ...]
    values: Array
    normalized: Array
    vectors: Array
    states: tuple[str, ...]
    published_order: tuple[int | None, ...] = ()
    order: tuple[int | None, ...] = ()

    @property
    def combinations(self) -> tuple[str, ...]:
        """The combinations in words, without parts below a thousandth."""
        shown = []
        for column in self.vectors.T:
            kept = np.where(np.abs(column) >= 1e-3 * np.abs(column).max(), column, 0.0)
            shown.append(describe_combination(kept, self.names))
        return tuple(shown)

    def summary(self) -> str:
        """Return value, order and combination of each, as text."""
        lines = []
        for i, text in enumerate(self.combinations):
            order = ""
            if self.order:
                order = f"  order {self.order[i]} (published {self.published_order[i]})"
            lines.append(f"{self.values[i]:<12.6g}{order}  {text}")
        return "\n".join(lines)

    def _verdict_line(self) -> str:
        """Say which combination is determined worst."""
        worst = f"{self.combinations[0]} of {len(self.values)} combinations"
        return f"least observable by {self.method}: {worst} ({brief(self.values[0], 4)})"

    def _as_table(self) -> Columns:
        values = {"value": self.values, "normalized": self.normalized, "state": self.states}
        return Columns("combination", self.combinations, values, {})


@dataclass(frozen=True, eq=False, repr=False)
class Information(Answer):
    """What a window adds to prior knowledge: no unit changes it.

    Attributes
    ----------
    names, units : tuple of str, length n
    values : ndarray, shape (n,)
        Eigenvalues of P0 J, ascending: how much more the window knows of each
        combination than the prior, in variances. Below 1 the prior says more.
    vectors : ndarray, shape (n, n)
        The combinations, one a column: moves of one prior deviation, in
        physical units.
    ratio : ndarray, shape (n,)
        Posterior over prior standard deviation of each state: 1 where the window
        tells nothing.
    prior, posterior : ndarray, shape (n,)
        Standard deviations of each state.
    window : float
        How long outputs were taken.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    vectors: Array
    ratio: Array
    prior: Array
    posterior: Array
    window: float
    method: Method = field(default="information")

    @property
    def determined(self) -> int:
        """How many combinations the window knows better than the prior."""
        return int((self.values > 1).sum())

    def summary(self) -> str:
        """Return the ratio of each state, best known first, as text."""
        lines = [f"after a window of {self.window:g}, posterior / prior:"]
        width = max(len(name) for name in self.names)
        for i in np.argsort(self.ratio, kind="stable"):
            unit = f" {self.units[i]}" if self.units[i] else ""
            lines.append(
                f"  {self.names[i]:<{width}}  {brief(self.ratio[i])}"
                f"   ({brief(self.posterior[i])}{unit} of {brief(self.prior[i])}{unit})"
            )
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw what each combination is made of as a heat map; needs matplotlib."""
        return draw(self, "combination_map")

    def _verdict_line(self) -> str:
        """Say how much the window tells, and of what least."""
        worst = int(np.argmax(self.ratio))
        return (
            f"{self.determined} of {len(self.names)} combinations known better than beforehand; "
            f"least of {self.names[worst]} (posterior / prior {brief(self.ratio[worst])})"
        )

    def _as_table(self) -> Columns:
        values = {"prior": self.prior, "posterior": self.posterior, "ratio": self.ratio}
        return columns_of_states(self.names, self.units, values)


def degree(
    A: SystemLike,
    C: ArrayLike | None = None,
    method: Method = "information",
    *,
    names: Sequence[str] | None = None,
    threshold: float = 0.0,
    tolerance: float = 0.1,
    window: float | None = None,
    dt: float | None = None,
    R: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    prior: ArrayLike | Mapping[str, float] | None = None,
    time: str = "continuous",
) -> Degree | Information:
    """Return a degree of observability; the recommended one is "information".

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
    C : array_like, shape (p, n)
    method : {"information", "order", "eigenvalue", "singular_value"}
        "information": eigenvalues of P0 J over a window and posterior over prior
        deviation of each state; needs `window`, `dt` and `prior`, and does not
        depend on any unit.

        "eigenvalue": eigenvalues of Q^T Q over the largest (Feng & Yuan 1999).
        Misleads when they are compared with each other: for x1' = a x3 with y =
        (c1 x1, c2 x2) they are c1^2, c2^2 and a^2 c1^2, so that x3, known only
        by a derivative, comes before x1 as soon as a > 1; and a is 3600 times
        larger with the hour as unit than with the second.

        "singular_value": singular values of Q, each given to the state with the
        largest component (Shuai et al. 2004). The same numbers as above, their
        roots; and it misleads once more where states have different units: in
        the inertial example tilt has 0.99 and the accelerometer bias 0.1 of a
        combination to which both contribute alike.

        "order": pairs of eigenvalue and order (Yang & Yin 2012, sec. 3): zero
        means not observable, else the higher the order, the worse. As published
        it is the highest derivative in which a combination shows, which for the
        inertial example is 14 for nearly all of them if taken to the letter
        (``threshold=0``) and depends on the unit of time otherwise. `order`
        beside it is the level, the lowest derivative by which it is known;
        eigenvectors, though, still depend on units: prefer `levels`.
    names : sequence of str, length n, optional
    threshold : float
        For the published order: parts below this of the largest do not count.
    tolerance : float
        For `order`: the part of an eigenvector, its length in the given units
        being 1, that may be left open.
    window, dt, R, time
        As for `gramian.linear.rows`.
    Q : array_like, shape (n, n), optional
        For "information": covariance of the process noise of a step `dt`.
    prior : array_like, shape (n,), (n, n) or mapping of str to float, optional
        For "information": standard deviations or covariance of the states
        beforehand; those of a `System` by default.

    Returns
    -------
    Information or Degree

    Raises
    ------
    InputError
        An unknown method, a missing window or prior, what `levels` refuses.

    Examples
    --------
    The paper's example in seconds and in hours: x3 moves from last to first.

    >>> def example(a):
    ...     return [[0, 0, a], [0, 0, 0], [0, 0, 0]]
    >>> C = [[1, 0, 0], [0, 1, 0]]
    >>> degree(example(0.01), C, "eigenvalue").states[-1] == "x2"
    False
    >>> degree(example(36.0), C, "eigenvalue").states[-1]
    'x2'
    """
    options.choice(method, "method", ("information", "order", "eigenvalue", "singular_value"))
    if method == "information":
        dt = sampled(A, dt)
        if window is None or dt is None:
            raise InputError(
                'method = "information" needs window and dt: the span of the '
                "samples and the time between them"
            )
        return information(
            A, C, window=window, dt=dt, R=R, Q=Q, prior=prior, names=names, time=time
        )
    if not 0 <= number(threshold, "threshold") < 1:
        raise InputError(f"threshold = {threshold}: must be at least 0 and below 1")
    if not 0 <= number(tolerance, "tolerance") < 1:
        raise InputError(f"tolerance = {tolerance}: must be at least 0 and below 1")
    system = system_of(A, C, names)
    singular, directions = _core.right_singular(observability_matrix(system.A, system.C))
    if not 1e-150 < singular.max() < 1e150 and singular.max() != 0:
        raise InputError(
            "the observability matrix is too small or too large: its squares overflow or "
            "underflow float64: choose other units"
        )
    singular, vectors = singular[::-1], directions[::-1].T
    # The sign of a singular vector is free: its largest component is positive.
    signs = np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(len(singular))])
    vectors = vectors * np.where(signs == 0, 1, signs)
    values = singular if method == "singular_value" else singular**2
    published: tuple[int | None, ...] = ()
    order: tuple[int | None, ...] = ()
    if method == "order":
        analysis = _core.LinearAnalysis(system.A, system.C, None)
        nullity = system.n - analysis.rank
        told = analysis.ranks() is not None
        published = tuple(
            None if i < nullity else published_order(system.A, system.C, column, threshold)
            for i, column in enumerate(vectors.T)
        )
        order = tuple(
            None if i < nullity or not told else nearest_level(analysis, column, tolerance)
            for i, column in enumerate(vectors.T)
        )
    return Degree(
        method=method,
        names=system.names,
        values=values,
        normalized=values / values[-1] if values[-1] > 0 else values,
        vectors=vectors,
        states=tuple(system.names[i] for i in np.abs(vectors).argmax(axis=0)),
        published_order=published,
        order=order,
    )


def nearest_level(analysis: _core.LinearAnalysis, vector: Array, tolerance: float) -> int | None:
    """Return the first k whose row space leaves at most `tolerance` of a unit vector.

    An eigenvector of Q^T Q means something in the units it was found in, so it is
    measured in these.
    """
    known = np.zeros((len(vector), 0))
    for k, level in enumerate(analysis.combinations()):
        known = np.hstack([known, level / np.linalg.norm(level, axis=0)])
        basis, _ = np.linalg.qr(known)
        if np.linalg.norm(vector - basis @ (basis.T @ vector)) <= tolerance:
            return k
    return None


def published_order(A: Array, C: Array, vector: Array, threshold: float) -> int:
    """Return the highest k with |C A^k v| above threshold times the largest."""
    parts = (observability_matrix(A, C) @ vector).reshape(len(A), len(C))
    sizes = np.linalg.norm(parts, axis=1)
    return int(np.flatnonzero(sizes > threshold * sizes.max()).max(initial=0))


def information(
    A: SystemLike,
    C: ArrayLike | None = None,
    *,
    window: float,
    dt: float,
    R: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    prior: ArrayLike | Mapping[str, float] | None = None,
    names: Sequence[str] | None = None,
    time: str = "continuous",
) -> Information:
    """Return what a window of samples adds to prior knowledge of the state.

    Parameters
    ----------
    A, C, window, dt, R, time
        As for `gramian.linear.rows`.
    Q, prior, names
        As for `degree`.

    Returns
    -------
    Information

    Raises
    ------
    InputError
        A state without a prior, a prior that is not a covariance.

    Notes
    -----
    With P0 = L L^T and J the information of the window, the eigenvalues of P0 J
    are the squared singular values of the rows times L, found without forming J.
    They and the ratios are the same in all units of states, outputs and time.

    Examples
    --------
    >>> found = information(
    ...     [[0, 1], [0, 0]], [[1, 0]], window=10.0, dt=1.0, prior=[1.0, 1.0], names=["x", "v"]
    ... )
    >>> found.ratio.round(3)
    array([0.49 , 0.086])
    """
    time = time_of(A, time)
    covariance = None
    if prior is not None and not isinstance(prior, Mapping):
        given = as_float_array(prior, "prior")
        if given.ndim == 2:
            given = finite(given, "prior")
            if given.shape[0] != given.shape[1] or not np.allclose(
                given, given.T, rtol=1e-10, atol=0
            ):
                raise InputError(
                    f"prior has shape {given.shape}: a covariance must be square and symmetric"
                )
            covariance, prior = given, np.sqrt(np.abs(np.diagonal(given)))
    system = system_of(A, C, names, None, prior, R)
    std = system.prior
    if np.isnan(std).any():
        missing = ", ".join(np.array(system.names)[np.isnan(std)])
        raise InputError(f"prior is missing for {missing}: the degree compares with it")
    if not ((std > 1e-150) & (std < 1e150)).all():
        raise InputError(
            f"prior goes from {brief(std.min())} to {brief(std.max())}: their squares "
            "overflow float64"
        )
    if covariance is None:
        root = np.diag(std)
    else:
        try:
            scaled = covariance / np.outer(std, std)
            root = std[:, None] * np.linalg.cholesky(scaled)
        except np.linalg.LinAlgError:
            raise InputError("prior is not positive definite: a covariance must be") from None
    if Q is None:
        seen = rows(A, C, window=window, dt=dt, R=R, time=time)
    else:
        step = (
            system.A
            if time == "discrete"
            else _core.linear_transition(system.A, number(dt, "dt [-]"))
        )
        noise = np.diag(system.noise**2) if R is None and not np.isnan(system.noise).any() else R
        j = gramian(step, system.C, window=window, dt=dt, R=noise, Q=Q)
        weights, axes = np.linalg.eigh(root.T @ j @ root)
        seen = np.sqrt(np.maximum(weights, 0.0))[:, None] * axes.T @ np.linalg.inv(root)
    return posterior(seen @ root, root, system.names, system.units, window)


def posterior(
    seen: Array, root: Array, names: tuple[str, ...], units: tuple[str, ...], window: float
) -> Information:
    """Return the information of rows in units of a prior with the given root."""
    singular, directions = _core.right_singular(seen)
    if not np.isfinite(singular).all():
        raise InputError(
            "outputs and priors are too small or too large: their squares overflow or "
            "underflow float64: choose other units"
        )
    moves = root @ directions.T
    prior = np.sqrt((root**2).sum(axis=1))
    after = np.sqrt((moves**2 / (1 + singular**2)).sum(axis=1))
    return Information(
        names=names,
        units=units,
        values=(singular**2)[::-1],
        vectors=moves[:, ::-1],
        ratio=after / prior,
        prior=prior,
        posterior=after,
        window=float(window),
    )


def history(
    seen: Array, root: Array, block: int, samples: Sequence[int]
) -> tuple[Array, NDArray[np.int64]]:
    """Return posterior over prior of each state after so many samples each.

    `seen` holds `block` whitened rows a sample.
    """
    prior = np.sqrt((root**2).sum(axis=1))
    factor = np.zeros((0, len(root)))
    start, ratios = 0, []
    for count in samples:
        new = seen[start * block : count * block] @ root
        # numpy's types give mode "r" the result of the others.
        factor = np.asarray(np.linalg.qr(np.vstack([factor, new]), mode="r"))
        start = count
        singular, directions = _core.right_singular(factor)
        moves = root @ directions.T
        after = np.sqrt((moves**2 / (1 + singular**2)).sum(axis=1))
        ratios.append(after / prior)
    return np.array(ratios), np.array(samples)
