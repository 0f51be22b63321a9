"""What each part of a flight makes observable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import number
from gramian._registry import draw
from gramian._text import brief, describe_direction
from gramian.exceptions import InputError
from gramian.models.inertial._flight import Flight
from gramian.models.linear._degrees import history, posterior

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Maneuvers", "maneuvers"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: A state whose posterior exceeds this part of its prior: the flight tells less than that.
WEAK = float(np.sqrt(0.5))
MOST_SAMPLES = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class Maneuvers(Answer):
    """Which states each leg of a flight makes observable: what `maneuvers` finds.

    Attributes
    ----------
    names, units : tuple of str, length n
        The states.
    legs : tuple of str
        The legs by name.
    ends : ndarray, shape (legs,)
        When each ends, seconds from the beginning.
    rank_alone, rank : ndarray of int, shape (legs,)
        Of a leg by itself, and of the flight up to its end.
    known_alone, known : ndarray of bool, shape (legs, n)
        Whether a leg by itself, and the flight up to its end, determine each state as it
        was at the beginning: a question of rank, without noise.
    ratio_alone, ratio : ndarray, shape (legs, n)
        Posterior over prior standard deviation of each state, with the noise and priors
        of the flight: 1 where nothing was learned.
    null_space : ndarray, shape (n, nullity)
        What the whole flight does not determine.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    legs: tuple[str, ...]
    ends: Array
    rank_alone: NDArray[np.int64]
    rank: NDArray[np.int64]
    known_alone: Flags
    known: Flags
    ratio_alone: Array
    ratio: Array
    null_space: Array

    _more_in_dict = ("status", "reason", "null_combinations")

    @property
    def status(self) -> str:
        """The status of the whole flight: "unobservable", "weak" or "observable"."""
        if self.null_space.shape[1]:
            return "unobservable"
        return "weak" if self.ratio[-1].max() > WEAK else "observable"

    @property
    def reason(self) -> str:
        """What decided the status."""
        n, worst = len(self.names), int(np.argmax(self.ratio[-1]))
        rank = f"rank {self.rank[-1]} of {n} after {len(self.legs)} legs"
        if self.status == "unobservable":
            return f"{rank}; {n - self.rank[-1]} combinations are not determined"
        told = f"{self.names[worst]} has posterior / prior {brief(self.ratio[-1, worst])}"
        return f"{rank}; {told}"

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """What the whole flight does not determine, in words."""
        return tuple(describe_direction(column, self.names) for column in self.null_space.T)

    def gained(self, leg: int) -> tuple[str, ...]:
        """Return the states that the flight determines since a leg, and not before it."""
        before = self.known[leg - 1] if leg else np.zeros(len(self.names), dtype=bool)
        return tuple(
            name for name, new in zip(self.names, self.known[leg] & ~before, strict=True) if new
        )

    def summary(self) -> str:
        """Return the legs and what each of them makes observable, as text."""
        lines = [self._verdict_line(), "leg, to: rank alone, so far; determined since this leg"]
        for k, leg in enumerate(self.legs):
            new = ", ".join(self.gained(k)) or "-"
            end = brief(self.ends[k])
            lines.append(f"  {leg}, {end} s: {self.rank_alone[k]}, {self.rank[k]}; {new}")
        lines += [f"  not determined: {text}" for text in self.null_combinations]
        lines.append("posterior / prior after each leg (- where not determined)")
        width = max(len(name) for name in self.names)
        for i, name in enumerate(self.names):
            cells = (
                brief(ratio) if known else "-"
                for ratio, known in zip(self.ratio[:, i], self.known[:, i], strict=True)
            )
            lines.append(f"  {name:<{width}}" + "".join(f"  {cell:>8}" for cell in cells))
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw posterior over prior of each state after each leg as a map; needs matplotlib."""
        return draw(self, "maneuver_map")

    def _as_table(self) -> Columns:
        values: dict[str, Array | Flags] = {}
        for k, leg in enumerate(self.legs):
            values[f"{leg}: alone, determined"] = self.known_alone[k]
            values[f"{leg}: alone, ratio"] = self.ratio_alone[k]
            values[f"{leg}: determined"] = self.known[k]
            values[f"{leg}: ratio"] = self.ratio[k]
        return Columns("state", self.names, values, {}, self.units)


def maneuvers(flight: Flight, *, legs: Sequence[str] | None = None, dt: float = 1.0) -> Maneuvers:
    """Find which states each leg of a flight makes observable.

    Parameters
    ----------
    flight : Flight
        Of `segments`, `recorded` or `sway`.
    legs : sequence of str, optional
        Names of the legs; "leg 1", "leg 2", ... by default.
    dt : float
        Seconds between the measurements, for the ratios.

    Returns
    -------
    Maneuvers

    Raises
    ------
    InputError
        Names that do not fit the legs, more than 100 000 samples.

    Notes
    -----
    Ranks by the total observability matrix of the piecewise constant system
    (Goshen-Meskin & Bar-Itzhack 1992), of the flight up to the end of each leg and of
    each leg by itself. A rank knows neither noise nor time: a state that it calls
    determined may be so weakly that nothing is learned of it, which the ratios show.

    Examples
    --------
    >>> import math
    >>> from gramian.models.inertial import Leg, segments
    >>> flight = segments([Leg(60.0), Leg(30.0, turn=math.pi / 2)], 0.6, speed=50.0)
    >>> found = maneuvers(flight, legs=["straight", "turn"])
    >>> found.rank.tolist(), found.gained(1)[:3]
    ([12, 15], ('phi_N', 'phi_W', 'phi_U'))
    """
    if not isinstance(flight, Flight):
        raise InputError(f"flight = {options.given(flight)}: must be a Flight")
    count = int(flight.leg.max()) + 1
    if legs is None:
        names = tuple(f"leg {k + 1}" for k in range(count))
    else:
        wrong = isinstance(legs, str) or not isinstance(legs, (list, tuple))
        if wrong or not all(isinstance(leg, str) for leg in legs):
            raise InputError(f"legs = {options.given(legs)}: must be a sequence of names")
        names = tuple(legs)
        if len(names) != count or len(set(names)) != count:
            raise InputError(f"legs has {len(names)} names: must be {count} different ones")
    dt = number(dt, "dt")
    if not dt > 0:
        raise InputError(f"dt = {dt}: must be > 0")
    system, block = flight.system, flight.C.shape[-2]
    total = float(flight.durations.sum())
    if total / dt > MOST_SAMPLES:
        raise InputError(
            f"dt = {dt} s makes {total / dt:.0f} samples, more than {MOST_SAMPLES}: a longer dt"
        )
    root = np.diag(system.prior)
    whole = flight.piecewise()
    lasts = [int(np.flatnonzero(flight.leg == k)[-1]) for k in range(count)]
    ends = np.cumsum(flight.durations)[lasts]
    samples = [int(end / dt * (1 + 1e-12)) + 1 for end in ends]
    ratio, _ = history(flight.rows(dt=dt), root, block, samples)
    alone, ranks, ratios = [], [], []
    for k in range(count):
        part = flight.only(k)
        found = part.piecewise()
        alone.append(found.determined[-1])
        ranks.append(found.rank)
        rows = part.rows(dt=min(dt, float(part.durations.sum())))
        seen = posterior(rows @ root, root, system.names, system.units, 0.0)
        ratios.append(seen.ratio)
    return Maneuvers(
        names=system.names,
        units=system.units,
        legs=names,
        ends=ends,
        rank_alone=np.array(ranks, dtype=np.int64),
        rank=np.array(whole.total_ranks, dtype=np.int64)[lasts],
        known_alone=np.array(alone),
        known=whole.determined[lasts],
        ratio_alone=np.array(ratios),
        ratio=ratio,
        null_space=whole.null_space,
    )
