"""A dipole that maneuvers, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, number
from gramian._noise import as_pair
from gramian._text import brief
from gramian._text import number as readable
from gramian.exceptions import InputError
from gramian.models.dipole._model import NAMES, UNITS

__all__ = ["Track", "track"]

Array = NDArray[np.float64]

#: Names of the states at a sample: those of a pass, without the 0 of its first time.
_NOW = tuple(name.removesuffix("0") for name in NAMES)


@dataclass(frozen=True, eq=False, repr=False)
class Track(Answer):
    """The answer of `track`: a filter's states after each sample.

    Attributes
    ----------
    times : ndarray, shape (K,)
        Seconds.
    states : ndarray, shape (K, 9)
        Position, velocity and moment at each time, from the samples up to it.
    std : ndarray, shape (K, 9)
        Standard deviations, in the local approximation.
    bound : ndarray, shape (K, 9), or None
        The posterior Cramer-Rao bound along the true states, where these were given.
    chi2 : ndarray, shape (K,)
        What each sample adds to the least squares.
    dof : int
        Degrees of freedom of all of them: the numbers of the field.
    alpha : float
        Level of the test of the fit.
    """

    times: Array
    states: Array
    std: Array
    bound: Array | None
    chi2: Array
    dof: int
    alpha: float
    _root: Array
    _bound_root: Array | None

    _more_in_dict: ClassVar[tuple[str, ...]] = ("names", "units", "p_value", "status")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return _NOW

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return UNITS

    @property
    def p_value(self) -> float:
        """Probability of as large a sum of `chi2` where the model is true."""
        return float(_core.chi_square_survival(float(self.chi2.sum()), self.dof))

    @property
    def status(self) -> str:
        """Whether the samples contradict the model at `alpha`: "misfit", else "determined"."""
        return "misfit" if self.p_value < self.alpha else "determined"

    def summary(self) -> str:
        """Return the state after the last sample, and how the samples fit, as text."""
        lines = [f"{self.status.upper()}: after {len(self.times)} samples"]
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            value = readable(float(self.states[-1, k]), 6)
            beside = "" if self.bound is None else f" (bound {brief(self.bound[-1, k])})"
            lines.append(f"  {name}  {value} +- {brief(self.std[-1, k])} {unit}{beside}")
        lines.append(
            f"  chi2 {brief(self.chi2.sum(), 4)} with {self.dof} degrees of freedom, "
            f"p {brief(self.p_value)}"
        )
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values = dict(zip(self.names, self.states.T, strict=True))
        values |= {f"std {n}": s for n, s in zip(self.names, self.std.T, strict=True)}
        if self.bound is not None:
            values |= {f"bound {n}": s for n, s in zip(self.names, self.bound.T, strict=True)}
        return Columns("time", self.times.tolist(), values | {"chi2": self.chi2}, {})


def track(
    times: ArrayLike,
    field: ArrayLike,
    start: Mapping[str, tuple[float, float]] | Track,
    *,
    sigma: ArrayLike,
    acceleration: float = 0.0,
    moment: float = 0.0,
    sensors: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    alpha: float = 0.001,
) -> Track:
    """Follow a dipole that maneuvers, sample by sample.

    Parameters
    ----------
    times : array_like, shape (K,)
        Seconds, not decreasing.
    field : array_like, shape (K, 3), or (K, S, 3) for S sensors
        Tesla, the background taken off.
    start : mapping of str to (mean, sigma), or Track
        What is known of every state ("x", "y", "z", "vx", .., "mz") at the first time; or
        where an earlier track ended, to go on from.
    sigma : array_like, shape () or (K,)
        Standard deviation of each component, T, > 0.
    acceleration : float
        Spectral density of the dipole's acceleration, (m/s^2)^2/Hz: in a time t each
        component of its velocity gains a standard deviation of sqrt(acceleration t).
    moment : float
        The same of its moment, (A m^2)^2/s, as where the body turns.
    sensors : array_like, shape (S, 3), optional
        Metres; by default one at the origin.
    truth : array_like, shape (K, 9), optional
        The true states, of a simulation: with them the bound is found.
    alpha : float
        Level of the test of the fit.

    Returns
    -------
    Track

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that decrease, a state
        without a start, a deviation that is not positive, a dipole on a sensor.

    Notes
    -----
    An iterated square-root information filter (Bierman 1977, chapters V and VI): each sample
    is taken in at the state that fits it and all before it best. The bound is the recursion of
    Tichavsky, Muravchik & Nehorai 1998 along the one true course that is given.

    `localize` needs no start; its answer, moved on to the first time, is a good one. One
    sensor alone never tells a small dipole near by from a large one far away: what a track
    says of that it has from its start, and where that is wide `std` is too small (with 20 %
    of the moment the normalized squared error of nine states is 10 in the median, not 8.3, and
    much larger in one record of a hundred).

    The Rust type under it, `dipole::tracker::Tracker`, needs no allocator and 400 bytes in
    single precision.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 20.0, 0.5)
    >>> seen = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, sigma=1e-9, seed=1)
    >>> means = dict(x=-10.5, y=-9.5, z=5, vx=1, vy=1, vz=0, mx=11, my=19, mz=9)
    >>> sigmas = dict(x=1, y=1, z=0.3, vx=0.1, vy=0.1, vz=0.1, mx=2, my=2, mz=2)
    >>> start = {name: (mean, sigmas[name]) for name, mean in means.items()}
    >>> found = track(t, seen, start, sigma=1e-9, acceleration=1e-4)
    >>> found.status, bool(abs(found.states[-1, 0] - 9.5) < 4 * found.std[-1, 0])
    ('determined', True)
    """
    when = finite(times, "times [s]")
    if when.ndim != 1 or not when.size:
        raise InputError(f"times has shape {when.shape}: must be (K,), not empty")
    places = np.zeros((1, 3)) if sensors is None else finite(sensors, "sensors [m]")
    if places.ndim != 2 or places.shape[1] != 3 or not len(places):
        raise InputError(f"sensors has shape {places.shape}: must be (S, 3)")
    seen = finite(field, "field [T]")
    shape = (when.size, len(places), 3)
    if seen.shape != shape and not (len(places) == 1 and seen.shape == (when.size, 3)):
        raise InputError(f"field has shape {seen.shape}: must be {shape}")
    deviations = finite(sigma, "sigma [T]")
    if deviations.shape not in ((), (when.size,)):
        raise InputError(f"sigma has shape {deviations.shape}: must be () or ({when.size},)")
    real = None if truth is None else finite(truth, "truth")
    if real is not None and real.shape != (when.size, 9):
        raise InputError(f"truth has shape {real.shape}: must be ({when.size}, 9)")
    wander = (number(acceleration, "acceleration"), number(moment, "moment"))
    options.fraction(alpha, "alpha")
    first, state, root, bound_root = _begin(start, float(when[0]))
    found = _core.dipole_track(
        when,
        seen.reshape(shape),
        places.tolist(),
        np.broadcast_to(deviations, when.shape).copy(),
        first,
        state.tolist(),
        root,
        wander,
        real,
        bound_root if real is not None else None,
    )
    return Track(
        times=when,
        states=found["states"],
        std=found["std"],
        bound=None if real is None else found["bound"],
        chi2=found["chi2"],
        dof=int(seen.size),
        alpha=alpha,
        _root=found["root"],
        _bound_root=None if real is None else found["bound_root"],
    )


def _begin(start: Any, first: float) -> tuple[float, Array, Array, Array]:
    """Return time, state and roots of the information of filter and bound to begin with."""
    if isinstance(start, Track):
        bound = start._root if start._bound_root is None else start._bound_root
        return float(start.times[-1]), start.states[-1], start._root, bound
    given = options.mapping(start, "start", "name to (mean, sigma)")
    for name in given:
        if name not in _NOW:
            raise InputError(f"start of {name!r}: the states are {', '.join(_NOW)}")
    missing = [name for name in _NOW if name not in given]
    if missing:
        raise InputError(f"start has no {', '.join(missing)}: every state needs (mean, sigma)")
    pairs = []
    for name, unit in zip(_NOW, UNITS, strict=True):
        pairs.append(as_pair(given[name], f"start of {name}", unit))
    means, sigmas = np.array(pairs).T
    root = np.diag(1.0 / sigmas)
    return first, means, root, root
