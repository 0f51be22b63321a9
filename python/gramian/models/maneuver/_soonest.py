"""How soon a wanted accuracy can be reached: the fewest samples of a planned path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gramian._answers import Answer, Columns
from gramian._arrays import number, whole
from gramian._text import brief, plain
from gramian.exceptions import InputError, UnobservableError
from gramian.models.maneuver._planner import Plan, plan
from gramian.models.maneuver._task import positive

__all__ = ["Soonest", "soonest"]


@dataclass(frozen=True, eq=False, repr=False)
class Soonest(Answer):
    """How soon an accuracy can be reached; made by `soonest`.

    Attributes
    ----------
    name : str
        The combination that is to be known.
    accuracy : float
        The standard deviation that is wanted.
    reached : float
        That of `plan`.
    plan : Plan
        The path that reaches it with the fewest samples; where none was found that does,
        the best one of all samples.
    samples : int or None
        Its number of samples; None where none was found.
    at_least : int
        No path reaches the accuracy with fewer samples, by the bound of the planner.
    tried : tuple of (int, float, float)
        Each number of samples that was planned for, with the standard deviation reached and
        the one that no path can go below.
    stopped : str
        "done", or what ended the search early: "time" or "interrupted". What was found until
        then holds; `samples` may not be the least that was to be found.
    dt : float
        Seconds between samples.
    """

    name: str
    accuracy: float
    reached: float
    plan: Plan = field(repr=False)
    samples: int | None
    at_least: int
    tried: tuple[tuple[int, float, float], ...] = field(repr=False)
    stopped: str
    dt: float = field(repr=False)

    @property
    def time(self) -> float:
        """Time of the last sample, seconds from the first; infinite where none was found."""
        return np.inf if self.samples is None else (self.samples - 1) * self.dt

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, strings and lists."""
        return {
            "name": self.name,
            "accuracy": self.accuracy,
            "reached": plain(self.reached),
            "samples": self.samples,
            "time_s": plain(self.time),
            "at_least": self.at_least,
            "stopped": self.stopped,
            "tried": [[n, plain(found), plain(least)] for n, found, least in self.tried],
            "plan": self.plan.to_dict(),
        }

    @property
    def reason(self) -> str:
        """After how many samples, and in how few no path does it."""
        wanted = f"{self.name} to {brief(self.accuracy)}"
        early = {"done": "", "time": "; the time was up", "interrupted": "; interrupted"}
        if self.samples is None:
            return (
                f"{wanted}: no path found in {len(self.plan.values)} samples, "
                f"the best comes to {brief(self.reached)}{early[self.stopped]}"
            )
        return (
            f"{wanted} after {self.samples} samples, {brief(self.time)} s; "
            f"no path in fewer than {self.at_least}{early[self.stopped]}"
        )

    def summary(self) -> str:
        """Return the answer in a few lines."""
        return f"{self.reason}\n{self.plan.summary()}"

    def _verdict_line(self) -> str:
        return self.reason

    def _as_table(self) -> Columns:
        counts, found, least = (list(column) for column in zip(*self.tried, strict=True))
        return Columns("samples", counts, {"reached": found, "no_less_than": least}, {})


def soonest(
    target: ArrayLike,
    start: ArrayLike,
    speed: float | tuple[float, float],
    dt: float,
    samples: int,
    *,
    accuracy: tuple[str, float],
    time_limit: float | None = None,
    progress: Callable[[int, int, float], object] | None = None,
    **options: Any,
) -> Soonest:
    """Plan the path that comes to a wanted accuracy in the fewest samples.

    Parameters
    ----------
    target, start, speed, dt
        As for `plan`.
    samples : int
        Number of samples at most, >= 2.
    accuracy : (str, float)
        A state or named combination of `plan` ("range", "bearing", "speed", "course"), and
        the standard deviation, > 0, that its bound is to fall to: that of the root of the
        mean variance where there are several beliefs (of the worst, or with a chance, by
        `over`).
    time_limit : float, optional
        Seconds in all; the best so far is returned.
    progress : callable, optional
        As for `plan`, of each plan in turn.
    **options
        All others of `plan` but "criterion". Paths of all numbers of samples keep the same
        limits: with `return_to` each ends there.

    Returns
    -------
    Soonest

    Raises
    ------
    InputError
        As `plan`, and for an accuracy that is none.
    UnobservableError
        No path of `samples` samples determines the states.

    Notes
    -----
    The number of samples is bisected, with a plan of the smallest variance for each. More
    samples never hurt, but a search can miss a path: `at_least` is certain, `samples` is not.
    The paths are those of `plan` with the criterion ``{"combination": name}``.

    Examples
    --------
    >>> import gramian as gm
    >>> found = gm.maneuver.soonest(
    ...     [0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 40,
    ...     accuracy=("range", 50.0), sigma=0.01, standoff=300.0,
    ... )
    >>> found.at_least <= found.samples <= 40
    True
    >>> found.reached <= 50.0
    True
    """
    if "criterion" in options:
        raise InputError("criterion: soonest plans for the variance of what accuracy names")
    name, wanted = _wanted(accuracy)
    most = whole(samples, "samples", 2, 1_000_000)
    ends = np.inf if time_limit is None else number(time_limit, "time_limit")
    if not ends > 0:
        raise InputError(f"time_limit = {time_limit} s: must be > 0")
    ends += monotonic()
    tried: dict[int, tuple[float, float]] = {}
    stopped = "done"

    def attempt(count: int, **effort: int) -> Plan:
        nonlocal stopped
        rest = None if time_limit is None else max(ends - monotonic(), 0.01)
        found = plan(
            target, start, speed, dt, count, criterion={"combination": name},
            time_limit=rest, progress=progress, **(options | effort),
        )  # fmt: skip
        stopped = found.stopped if stopped == "done" else stopped
        least = 0.0 if np.isnan(found.bound) else float(np.sqrt(found.bound))
        before = tried.get(count, (np.inf, 0.0))
        tried[count] = (min(before[0], float(np.sqrt(found.value))), max(before[1], least))
        return found

    def reaching(count: int, **effort: int) -> Plan | None:
        """Return a path that keeps all limits and is accurate enough."""
        nonlocal stopped
        try:
            found = attempt(count, **effort)
        except (InputError, UnobservableError):
            # So few samples keep no limit, as a way back, or do not determine the states; or
            # no path was found in the time left.
            stopped = "time" if stopped == "done" and monotonic() >= ends else stopped
            tried.setdefault(count, (np.inf, 0.0))
            return None
        return found if reaches(found) else None

    def reaches(found: Plan) -> bool:
        return not found.violations and float(np.sqrt(found.value)) <= wanted

    best = attempt(most)
    low, high = 1, most if reaches(best) else None
    while high is not None and high - low > 1 and stopped == "done":
        middle = (low + high) // 2
        found = reaching(middle)
        if found is None:
            low = middle
        else:
            best, high = found, middle
    # What is certain: the most samples for which no path is good enough.
    sure = max((n for n, (_, bound) in tried.items() if bound > wanted), default=1)
    above = min(
        (n for n, (_, bound) in tried.items() if n > sure and bound <= wanted), default=sure
    )
    while above - sure > 1 and options.get("bound", True) and stopped == "done":
        middle = (sure + above) // 2
        reaching(middle, starts=1, restarts=0)
        if tried.get(middle, (np.inf, 0.0))[1] > wanted:
            sure = middle
        else:
            above = middle
    return Soonest(
        name=name,
        accuracy=wanted,
        reached=float(np.sqrt(best.value)),
        plan=best,
        samples=high,
        at_least=sure + 1,
        tried=tuple((n, *tried[n]) for n in sorted(tried)),
        stopped=stopped,
        dt=number(dt, "dt"),
    )


def _wanted(accuracy: tuple[str, float]) -> tuple[str, float]:
    try:
        name, wanted = accuracy
    except (TypeError, ValueError):
        raise InputError(f"accuracy = {accuracy!r}: must be (name, deviation)") from None
    if not isinstance(name, str):
        raise InputError(f"accuracy[0] = {name!r}: must be the name of a combination")
    positive(wanted, "accuracy[1]", "")
    wanted = number(wanted, "accuracy[1]")
    return name, wanted
