"""The closed loop: estimate, choose a heading, move, measure, and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import SEED_MOST, number, whole
from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models.maneuver._laws import LAWS
from gramian.models.maneuver._planner import plan
from gramian.models.maneuver._task import check_outside, checked_discs, finite, positive

__all__ = ["ClosedLoop", "LoopRun", "closed_loop"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class LoopRun(Answer):
    """All trials of one way of choosing headings.

    Attributes
    ----------
    method : str
        A law, or "plan".
    paths : ndarray, shape (trials, samples, 2)
    estimates : ndarray, shape (trials, samples, 2)
        Of the target, after each bearing.
    believed : ndarray, shape (trials, samples)
        The standard deviation of the position that the estimator believes, metres.
    errors : ndarray, shape (trials, samples)
        Distance of the estimate from the target, metres.
    nearest : ndarray, shape (trials,)
        The smallest true range of a path, metres: below the stand-off range
        where the estimate was wrong by that much.
    """

    method: str
    paths: Array = field(repr=False)
    estimates: Array = field(repr=False)
    believed: Array = field(repr=False)
    errors: Array = field(repr=False)
    nearest: Array = field(repr=False)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.errors)

    @property
    def rms(self) -> Array:
        """Root mean square error after each bearing, metres."""
        rms: Array = np.sqrt((self.errors**2).mean(axis=0))
        return rms

    @property
    def final_rms(self) -> float:
        """Root mean square of the final error, metres."""
        return float(self.rms[-1])

    @property
    def final_median(self) -> float:
        """Median of the final error, metres."""
        return float(np.median(self.errors[:, -1]))

    @property
    def final_p90(self) -> float:
        """Final error that nine trials in ten stay below, metres."""
        return float(np.quantile(self.errors[:, -1], 0.9))

    @property
    def uncertainty(self) -> float:
        """Standard error of `final_rms` over the trials, metres."""
        square = self.errors[:, -1] ** 2
        if self.trials < 2 or self.final_rms == 0:
            return float("inf")
        return float(square.std(ddof=1) / np.sqrt(self.trials) / (2 * self.final_rms))


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Answer):
    """The closed loop of several methods on the same noise; made by `closed_loop`.

    Attributes
    ----------
    runs : tuple of LoopRun
        The smallest final error first.
    target : ndarray, shape (2,)
    dt : float
    lost : float
        Probability that a bearing is lost.
    seed : int
    """

    runs: tuple[LoopRun, ...]
    target: Array
    dt: float
    lost: float
    seed: int

    def __getitem__(self, method: str) -> LoopRun:
        """Return the run of a method."""
        for run in self.runs:
            if run.method == method:
                return run
        raise KeyError(method)

    def table(self) -> list[dict[str, float | str]]:
        """Return a line of numbers for each method, the best first."""
        return [
            {
                "method": run.method,
                "trials": run.trials,
                "final_rms_m": run.final_rms,
                "final_rms_uncertainty_m": run.uncertainty,
                "final_median_m": run.final_median,
                "final_p90_m": run.final_p90,
                "believed_m": float(np.sqrt((run.believed[:, -1] ** 2).mean())),
                "nearest_m": float(run.nearest.min()),
            }
            for run in self.runs
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the table and the errors against time as plain numbers."""
        return {
            "target_m": self.target.tolist(),
            "lost": self.lost,
            "seed": self.seed,
            "methods": [
                line | {"rms_m": run.rms.tolist()}
                for line, run in zip(self.table(), self.runs, strict=True)
            ],
        }

    def summary(self) -> str:
        """Return the comparison in a few lines."""
        head = f"{'method':>14}  trials   final error rms      median    90 %   believed   nearest"
        lines = (
            f"{line['method']:>14}  {line['trials']:6d}   "
            f"{line['final_rms_m']:8.3g} +- {brief(line['final_rms_uncertainty_m'], 1)} m  "
            f"{line['final_median_m']:6.3g} m {line['final_p90_m']:6.3g} m "
            f"{line['believed_m']:7.3g} m {line['nearest_m']:7.4g} m"
            for line in self.table()
        )
        return "\n".join([head, *lines])

    def _verdict_line(self) -> str:
        """Say which method came nearest."""
        best = min(self.runs, key=lambda run: run.final_rms)
        return f"{best.method} ends nearest: final error {brief(best.final_rms)} m rms"

    def _as_table(self) -> Columns:
        lines = self.table()
        values = {name: [line[name] for line in lines] for name in lines[0] if name != "method"}
        units = {name: "m" for name in values if name.endswith("_m")}
        return Columns("method", [run.method for run in self.runs], values, units)


def closed_loop(
    target: ArrayLike,
    start: ArrayLike,
    speed: float,
    dt: float,
    samples: int,
    *,
    sigma: float,
    first_range: tuple[float, float],
    methods: Sequence[str] = LAWS,
    side: Literal[1, -1] = 1,
    lost: float = 0.0,
    when_lost: Literal["predict", "hold"] = "predict",
    opening: int = 0,
    standoff: float | None = None,
    keep_out: ArrayLike | None = None,
    max_turn_rate: float | None = None,
    replan: int = 10,
    trials: int = 1000,
    seed: int = 0,
) -> ClosedLoop:
    """Compare ways of choosing headings by the error they end with.

    An observer that does not know where the target is takes a bearing, estimates
    the target from all bearings so far, chooses a heading by that estimate, moves,
    and takes the next bearing. Every method meets the same noise and the same
    lost bearings.

    Parameters
    ----------
    target : array_like, shape (2,)
        Where a fixed target truly is, metres.
    start : array_like, shape (2,)
    speed : float
        m/s, > 0.
    dt : float
        Time from one bearing to the next, seconds, > 0.
    samples : int
        Number of bearings >= 2, the first at the start.
    sigma : float
        Standard deviation of a bearing, radians, > 0.
    first_range : (float, float)
        What is thought of the range before: its mean and standard deviation,
        metres, > 0. It is the estimator's prior along the first bearing.
    methods : sequence of str
        Laws, as for `trajectory`, and "plan": the rest of the path is planned anew
        every `replan` bearings, over the targets that the estimate leaves possible.
    side : {1, -1}
        The side of the laws, kept throughout. Over more than two legs a change of
        side can do better: see `trajectory`.
    lost : float
        Probability that a bearing (not the first) is lost, from 0 to below 1.
    when_lost : {"predict", "hold"}
        At a lost bearing a law takes the one that the estimate predicts, or holds
        the heading. A plan goes on as it is.
    opening : int
        So many legs go along the measured line of sight before a law begins.
    standoff : float, optional
        The range to the *estimated* target not to go below, metres. By default
        one step.
    keep_out, max_turn_rate : optional
        As for `plan`. A law looks one step ahead: with a slow turn it may come into
        a circle, which a plan avoids.
    replan : int
        Bearings from one plan to the next, >= 1.
    trials : int
        >= 1.
    seed : int
        >= 0. The noise of trial i depends on (seed, i) alone.

    Returns
    -------
    ClosedLoop

    Raises
    ------
    InputError
        Values that cannot be used; a start inside the stand-off range or a circle.

    Notes
    -----
    The rules for an unknown range, an opening along the line of sight and lost
    bearings are those of Xu et al. 2009, section 4. (Along the line of sight
    itself bearings say nothing of the range, so an opening costs more than it
    gives: compare.) The estimator is Gauss-Newton on all bearings with the prior
    of the range, started from the estimate before; where a path tells enough it
    reaches the Cramer-Rao bound. Cost: about 30 ns for each pair of samples and law;
    a plan takes some hundredths of a second.

    Examples
    --------
    >>> import gramian as gm
    >>> result = gm.maneuver.closed_loop(
    ...     [0, 1000], [0, 0], 20.0, 1.0, 60, sigma=0.01, first_range=(1500, 500), trials=200
    ... )
    >>> result.runs[0].method
    'max_det'
    """
    if isinstance(methods, str) or not isinstance(methods, Sequence):
        raise InputError(f"methods = {methods!r}: must be a sequence of names")
    if not methods:
        raise InputError("methods is empty: must name one at least")
    for i, method in enumerate(methods):
        if not isinstance(method, str) or (method != "plan" and method not in LAWS):
            known = ", ".join(f'"{law}"' for law in (*LAWS, "plan"))
            raise InputError(f"methods[{i}] = {method!r}: must be one of {known}")
    if options.choice(side, "side", (1, -1)) not in (1, -1):
        raise InputError(f"side = {side}: must be 1 or -1")
    trials, replan = whole(trials, "trials", 1), whole(replan, "replan", 1)
    seed, opening = whole(seed, "seed", 0, SEED_MOST), whole(opening, "opening")
    if not 0 <= number(lost, "lost") < 1:
        raise InputError(f"lost = {lost}: must be from 0 to below 1")
    setting = _Setting.checked(
        target=target,
        start=start,
        speed=speed,
        dt=dt,
        samples=samples,
        sigma=sigma,
        first_range=first_range,
        opening=opening,
        when_lost=when_lost,
        standoff=standoff,
        keep_out=keep_out,
        max_turn_rate=max_turn_rate,
    )
    noise, gone = _noise(int(samples), trials, seed, lost)
    runs = []
    for method in methods:
        if method == "plan":
            out = _planned(setting, noise, gone, replan)
        else:
            out = setting.run(method, [float(side)], noise, gone)
        runs.append(_run(method, out, setting.target))
    runs.sort(key=lambda run: run.final_rms)
    return ClosedLoop(tuple(runs), setting.target, number(dt, "dt"), number(lost, "lost"), seed)


@dataclass(frozen=True, eq=False)
class _Setting:
    target: Array
    start: Array
    length: float
    moves: int
    sigma: float
    first_range: tuple[float, float]
    opening: int
    when_lost: str
    standoff: float
    keep_out: Array
    max_turn: float

    @classmethod
    def checked(
        cls,
        *,
        target: ArrayLike,
        start: ArrayLike,
        speed: float,
        dt: float,
        samples: int,
        sigma: float,
        first_range: tuple[float, float],
        opening: int,
        when_lost: str,
        standoff: float | None,
        keep_out: ArrayLike | None,
        max_turn_rate: float | None,
    ) -> _Setting:
        place, origin = finite(target, "target"), finite(start, "start [m]")
        for name, point in (("target", place), ("start", origin)):
            if point.shape != (2,):
                raise InputError(f"{name} has shape {point.shape}: must be (2,), east and north")
        samples = whole(samples, "samples", 2)
        if not 0 <= opening < samples:
            raise InputError(f"opening = {opening}: must be from 0 to below samples, {samples}")
        guess = finite(first_range, "first_range")
        if guess.shape != (2,):
            raise InputError(f"first_range has shape {guess.shape}: must be (mean, deviation)")
        mean, deviation = (float(value) for value in guess)
        for name, value, unit in (
            ("speed", speed, "m/s"),
            ("dt", dt, "s"),
            ("sigma", sigma, "rad"),
            ("first_range[0]", mean, "m"),
            ("first_range[1]", deviation, "m"),
        ):
            positive(value, name, unit)
        speed, dt, sigma = number(speed, "speed"), number(dt, "dt"), number(sigma, "sigma [rad]")
        if not speed * dt < 1e150:
            raise InputError(f"a step of {brief(speed * dt)} m: its square overflows float64")
        standoff = None if standoff is None else number(standoff, "standoff")
        if max_turn_rate is not None:
            positive(max_turn_rate, "max_turn_rate", "rad/s")
            max_turn_rate = number(max_turn_rate, "max_turn_rate")
        discs = checked_discs(keep_out)
        check_outside(origin, np.concatenate([place, [0.0, 0.0]])[None], standoff, discs)
        return cls(
            target=place,
            start=origin,
            length=speed * dt,
            moves=int(samples) - 1,
            sigma=sigma,
            first_range=(mean, deviation),
            opening=int(opening),
            when_lost=when_lost,
            standoff=float(speed * dt if standoff is None else standoff),
            keep_out=discs,
            max_turn=np.inf if max_turn_rate is None else float(max_turn_rate * dt),
        )

    def run(self, guide: str, wanted: ArrayLike, noise: Array, lost: Array) -> Array:
        return _core.maneuver_closed_loop(
            self.target,
            self.start,
            self.length,
            noise.shape[-1] - 1,
            self.sigma,
            self.first_range,
            self.opening,
            self.when_lost,
            self.standoff,
            self.keep_out,
            self.max_turn,
            guide,
            wanted,
            noise,
            lost,
        )


def _noise(samples: int, trials: int, seed: int, lost: float) -> tuple[Array, Array]:
    """Return standard normal noise and lost bearings (1 for lost), (trials, samples) each."""
    from scipy.special import ndtri

    numbers = _core.normals(seed, 0, trials, 2 * samples)
    gone = (numbers[:, samples:] < ndtri(lost)).astype(float)
    return np.ascontiguousarray(numbers[:, :samples]), gone


def _run(method: str, out: Array, target: Array) -> LoopRun:
    paths, estimates = out[..., :2], out[..., 2:4]
    away = estimates - target
    ranges = np.hypot(paths[..., 0] - target[0], paths[..., 1] - target[1])
    return LoopRun(
        method=method,
        paths=paths,
        estimates=estimates,
        believed=out[..., 4],
        errors=np.hypot(away[..., 0], away[..., 1]),
        nearest=ranges.min(axis=-1),
    )


def _planned(setting: _Setting, noise: Array, lost: Array, replan: int) -> Array:
    """Fly the plan of every `replan` bearings; all trials move together."""
    trials, samples = noise.shape
    headings = np.zeros((trials, setting.moves))
    for first in range(0, setting.moves, replan):
        # The path so far is the same whatever is planned from here on.
        out = setting.run(
            "headings",
            headings[:, :first] if first else np.zeros((trials, 0)),
            noise[:, : first + 1],
            lost[:, : first + 1],
        )
        for trial in range(trials):
            headings[trial, first:] = _headings(setting, out[trial], lost[trial], samples - first)
    return setting.run("headings", headings, noise, lost)


def _headings(setting: _Setting, out: Array, lost: Array, bearings: int) -> Array:
    """Plan the rest of a path from what is known of the target now."""
    at, estimate = out[-1, :2], out[-1, 2:4]
    seen = out[:, :2][(lost[: len(out)] == 0) | (np.arange(len(out)) == 0)]
    information = _information(setting, seen, estimate)
    covariance = np.linalg.inv(information)
    spread, axes = np.linalg.eigh(covariance)
    along = np.sqrt(3 * spread[1]) * axes[:, 1]
    # Three points with the mean and the variance of the weakest direction.
    targets = estimate + np.outer([-1.0, 0.0, 1.0], along)
    weights = np.array([1 / 6, 2 / 3, 1 / 6])
    ranges = np.hypot(*(targets - at).T)
    # What the stand-off range rules out by itself, or is behind the observer.
    ahead = (targets - setting.start) @ (estimate - setting.start) > 0
    use = ahead & (ranges > setting.length)
    if not use[1]:
        use = np.array([False, True, False])
    before = out[-1, :2] - out[-2, :2] if len(out) > 1 else None
    chosen = plan(
        targets[use],
        at,
        setting.length,
        1.0,
        bearings,
        sigma=setting.sigma,
        standoff=min(setting.standoff, 0.999 * float(ranges[use].min())),
        keep_out=_passed(setting.keep_out, at),
        max_turn_rate=setting.max_turn if np.isfinite(setting.max_turn) else None,
        heading=None if before is None else float(np.arctan2(*before)),
        prior=information,
        weights=weights[use],
        starts=1,
        restarts=0,
        bound=False,
        max_iterations=15,
    )
    return chosen.headings


def _information(setting: _Setting, seen: Array, estimate: Array) -> Array:
    offset = estimate - seen
    squared = (offset**2).sum(axis=1)[:, None]
    rows = offset[:, ::-1] * (1.0, -1.0) / (setting.sigma * squared)
    away = estimate - setting.start
    sight = away / np.hypot(*away) / setting.first_range[1]
    information: Array = rows.T @ rows + np.outer(sight, sight)
    return information


def _passed(discs: Array, at: Array) -> Array | None:
    """Return circles whose edge rounding has not put the observer inside of."""
    if not len(discs):
        return None
    kept = discs.copy()
    kept[:, 2] = np.minimum(discs[:, 2], np.hypot(*(discs[:, :2] - at).T) * (1 - 1e-12))
    return kept
