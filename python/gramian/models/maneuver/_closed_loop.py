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

#: Ways to choose headings that look ahead.
PLANS = ("plan", "plan_estimate")
#: Stands for no false bearing: a number beyond a whole turn.
NONE = 1e300
#: Standard deviations within which a bearing may be the target's, where some are false.
GATE = 4.0


@dataclass(frozen=True, eq=False, repr=False)
class LoopRun(Answer):
    """All trials of one way of choosing headings.

    Attributes
    ----------
    method : str
        A law, "plan" or "plan_estimate".
    paths : ndarray, shape (trials, samples, 2)
    estimates : ndarray, shape (trials, samples, 2 or 4)
        Of the target, after each bearing: its position, and for a moving target its
        position at the start and its velocity.
    believed : ndarray, shape (trials, samples)
        The standard deviation of the present position that the estimator believes, metres.
    errors : ndarray, shape (trials, samples)
        Distance of the estimated present position from the true one, metres.
    surprise : ndarray, shape (trials, samples)
        Twice the log of the likelihood at the estimate over that at the truth, what was
        known before included: chi-square with as many degrees of freedom as states.
    ranges : ndarray, shape (trials, samples)
        True range from the observer to the target, metres.
    nearest : ndarray, shape (trials,)
        The smallest true range of a path, metres: below the stand-off range
        where the estimate was wrong by that much.
    """

    method: str
    paths: Array = field(repr=False)
    estimates: Array = field(repr=False)
    believed: Array = field(repr=False)
    errors: Array = field(repr=False)
    surprise: Array = field(repr=False)
    ranges: Array = field(repr=False)
    nearest: Array = field(repr=False)
    dt: float = field(repr=False)

    def coverage(self, level: float = 0.95) -> Array:
        """Return the share of trials whose likelihood region holds the true state.

        The region counts what was thought before as one more measurement. It holds the
        truth as often as it says where the truths are spread as that says. One truth in
        all trials is held more often if it is near to what was thought, less often if far.

        Parameters
        ----------
        level : float
            Of the region, above 0 and below 1.

        Returns
        -------
        ndarray, shape (samples,)
            After each bearing. Its standard error is the root of
            ``level * (1 - level) / trials``.

        Raises
        ------
        InputError
            A level that is none.
        """
        if not 0 < number(level, "level") < 1:
            raise InputError(f"level = {level}: must be above 0 and below 1")
        most = _core.chi_square_critical(1 - level, self.estimates.shape[-1])
        inside: Array = (self.surprise <= most).mean(axis=0)
        return inside

    def time_to(self, share: float = 0.1) -> Array:
        """Return when each trial's error falls to a share of the range for good.

        Parameters
        ----------
        share : float
            Of the true range at that time, > 0.

        Returns
        -------
        ndarray, shape (trials,)
            Seconds from the start; infinite where the last error is above it.

        Raises
        ------
        InputError
            A share that is not above zero.
        """
        positive(share, "share", "")
        above = self.errors > number(share, "share") * self.ranges
        samples = above.shape[1]
        last = samples - np.argmax(above[:, ::-1], axis=1)
        first = np.where(above.any(axis=1), last, 0)
        times: Array = np.where(first < samples, first * self.dt, np.inf)
        return times

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
    target : ndarray, shape (2,) or (4,), or (trials, 2) or (trials, 4)
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
                "coverage_95": float(run.coverage()[-1]),
                "time_to_10_percent_s": float(np.median(run.time_to())),
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
        head = (
            f"{'method':>14}  trials   final error rms      median    90 %   believed   nearest"
            "   in 95 %   to 10 %"
        )
        lines = (
            f"{line['method']:>14}  {line['trials']:6d}   "
            f"{line['final_rms_m']:8.3g} +- {brief(line['final_rms_uncertainty_m'], 1)} m  "
            f"{line['final_median_m']:6.3g} m {line['final_p90_m']:6.3g} m "
            f"{line['believed_m']:7.3g} m {line['nearest_m']:7.4g} m"
            f"   {100 * float(line['coverage_95']):5.1f} %   {line['time_to_10_percent_s']:5.4g} s"
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
        units["time_to_10_percent_s"] = "s"
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
    first_speed: float | None = None,
    methods: Sequence[str] = LAWS,
    side: Literal[1, -1] = 1,
    lost: float = 0.0,
    false_alarms: float = 0.0,
    when_lost: Literal["predict", "hold"] = "predict",
    opening: int = 0,
    standoff: float | None = None,
    keep_out: ArrayLike | None = None,
    max_turn_rate: float | None = None,
    replan: int = 10,
    horizon: int | None = None,
    trials: int = 1000,
    seed: int = 0,
) -> ClosedLoop:
    """Compare ways of choosing headings by the error they end with.

    An observer that does not know where the target is takes a bearing, estimates
    the target from all bearings so far, chooses a heading by that estimate, moves,
    and takes the next bearing. Every method meets the same noise, the same lost
    bearings and the same false ones.

    Parameters
    ----------
    target : array_like, shape (2,) or (4,), or (trials, 2) or (trials, 4)
        Where a fixed target truly is, metres; or (x0, y0, vx, vy) of one at constant
        velocity, which is unknown too. With one row for each trial, each has a truth of
        its own, as is needed to see whether the regions hold it as often as they say.
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
        metres, > 0. It is the estimator's prior of the range from the start.
    first_speed : float, optional
        For a moving target, and needed there: the standard deviation of each component
        of its velocity about zero, m/s, > 0, the estimator's prior.
    methods : sequence of str
        Laws, as for `trajectory`, and two plans of the path, made anew every `replan`
        bearings with what the bearings so far tell: "plan" over the targets that they
        leave possible (the belief), "plan_estimate" for the estimate alone.
    side : {1, -1}
        The side of the laws, kept throughout. Over more than two legs a change of
        side can do better: see `trajectory`.
    lost : float
        Probability that a bearing (not the first) is lost, from 0 to below 1.
    when_lost : {"predict", "hold"}
        At a lost bearing a law takes the one that the estimate predicts, or holds
        the heading. A plan goes on as it is.
    false_alarms : float
        Probability that a sample brings a false bearing, uniform over the circle, from 0
        to below 1. Of the bearings of a sample the one nearest to what is expected is
        taken, within four standard deviations; none where none is.
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
    horizon : int, optional
        Bearings that are planned ahead, >= 2: all that are left by default.
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
    of the range and the velocity, started from the estimate before; where a path tells
    enough it reaches the Cramer-Rao bound. Over truths that are spread as was thought
    before, its likelihood region holds the true state as often as it says
    (`LoopRun.coverage`). Cost: about 30 ns for each pair of samples and
    law, and twice that for a moving target; a plan takes some tenths of a second.

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
        if not isinstance(method, str) or method not in (*LAWS, *PLANS):
            known = ", ".join(f'"{law}"' for law in (*LAWS, *PLANS))
            raise InputError(f"methods[{i}] = {method!r}: must be one of {known}")
    if options.choice(side, "side", (1, -1)) not in (1, -1):
        raise InputError(f"side = {side}: must be 1 or -1")
    trials, replan = whole(trials, "trials", 1), whole(replan, "replan", 1)
    seed, opening = whole(seed, "seed", 0, SEED_MOST), whole(opening, "opening")
    for name, share in (("lost", lost), ("false_alarms", false_alarms)):
        if not 0 <= number(share, name) < 1:
            raise InputError(f"{name} = {share}: must be from 0 to below 1")
    if horizon is not None:
        horizon = whole(horizon, "horizon", 2)
    setting = _Setting.checked(
        trials=trials,
        target=target,
        start=start,
        speed=speed,
        dt=dt,
        samples=samples,
        sigma=sigma,
        first_range=first_range,
        first_speed=first_speed,
        false_alarms=false_alarms,
        opening=opening,
        when_lost=when_lost,
        standoff=standoff,
        keep_out=keep_out,
        max_turn_rate=max_turn_rate,
    )
    happens = _Happens.drawn(whole(samples, "samples", 2), trials, seed, lost, false_alarms)
    runs = []
    for method in methods:
        if method in PLANS:
            out = _planned(setting, happens, replan, horizon, method == "plan")
        else:
            out = setting.run(method, [float(side)], happens)
        runs.append(_run(method, out, setting))
    runs.sort(key=lambda run: run.final_rms)
    return ClosedLoop(
        tuple(runs), setting.target[..., : setting.states], setting.dt, number(lost, "lost"), seed
    )


@dataclass(frozen=True, eq=False)
class _Setting:
    #: (x0, y0, vx, vy), of all trials or of each.
    target: Array
    start: Array
    dt: float
    length: float
    moves: int
    sigma: float
    first_range: tuple[float, float]
    first_speed: float | None
    gate: float
    opening: int
    when_lost: str
    standoff: float
    keep_out: Array
    max_turn: float

    @classmethod
    def checked(
        cls,
        *,
        trials: int,
        target: ArrayLike,
        start: ArrayLike,
        speed: float,
        dt: float,
        samples: int,
        sigma: float,
        first_range: tuple[float, float],
        first_speed: float | None,
        false_alarms: float,
        opening: int,
        when_lost: str,
        standoff: float | None,
        keep_out: ArrayLike | None,
        max_turn_rate: float | None,
    ) -> _Setting:
        place, origin = finite(target, "target"), finite(start, "start [m]")
        if place.shape not in ((2,), (4,), (trials, 2), (trials, 4)):
            raise InputError(
                f"target has shape {place.shape}: must be (2,), east and north, or (4,), "
                f"and its velocity; or a row of that for each of the {trials} trials"
            )
        if origin.shape != (2,):
            raise InputError(f"start has shape {origin.shape}: must be (2,), east and north")
        states = place.shape[-1]
        if states == 4 and first_speed is None:
            raise InputError(
                "first_speed is needed for a moving target: what is known of its velocity before"
            )
        if states == 2 and first_speed is not None:
            raise InputError("first_speed is for a moving target: give its velocity with target")
        if first_speed is not None:
            positive(first_speed, "first_speed", "m/s")
            first_speed = number(first_speed, "first_speed")
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
        place = np.concatenate([place, np.zeros((*place.shape[:-1], 4 - states))], axis=-1)
        check_outside(origin, np.atleast_2d(place), standoff, discs)
        return cls(
            target=place,
            start=origin,
            dt=dt,
            length=speed * dt,
            moves=int(samples) - 1,
            sigma=sigma,
            first_range=(mean, deviation),
            first_speed=first_speed,
            gate=GATE if false_alarms > 0 else np.inf,
            opening=int(opening),
            when_lost=when_lost,
            standoff=float(speed * dt if standoff is None else standoff),
            keep_out=discs,
            max_turn=np.inf if max_turn_rate is None else float(max_turn_rate * dt),
        )

    @property
    def states(self) -> int:
        """How many states of the target are unknown."""
        return 2 if self.first_speed is None else 4

    def run(self, guide: str, wanted: ArrayLike, happens: _Happens) -> Array:
        return _core.maneuver_closed_loop(
            self.target,
            self.start,
            self.dt,
            self.length,
            happens.noise.shape[-1] - 1,
            self.sigma,
            self.first_range,
            self.first_speed,
            self.gate,
            self.opening,
            self.when_lost,
            self.standoff,
            self.keep_out,
            self.max_turn,
            guide,
            wanted,
            happens.noise,
            happens.lost,
            happens.alarms,
        )


@dataclass(frozen=True, eq=False)
class _Happens:
    """What happens to the bearings, (trials, samples) each."""

    noise: Array
    #: 1 for lost.
    lost: Array
    #: False bearings, NONE where there is none.
    alarms: Array

    @classmethod
    def drawn(
        cls, samples: int, trials: int, seed: int, lost: float, false_alarms: float
    ) -> _Happens:
        from scipy.special import ndtr, ndtri

        count = 4 if false_alarms > 0 else 2
        numbers = _core.normals(seed, 0, trials, count * samples).reshape(trials, count, samples)
        alarms = np.full((trials, samples), NONE)
        if false_alarms > 0:
            false = numbers[:, 2] < ndtri(false_alarms)
            alarms[false] = np.pi * (2 * ndtr(numbers[:, 3][false]) - 1)
        return cls(
            noise=np.ascontiguousarray(numbers[:, 0]),
            lost=(numbers[:, 1] < ndtri(lost)).astype(float),
            alarms=alarms,
        )

    def until(self, samples: int) -> _Happens:
        """Return what happens to the first samples."""
        parts = (self.noise, self.lost, self.alarms)
        return _Happens(*(np.ascontiguousarray(part[:, :samples]) for part in parts))


def _run(method: str, out: Array, setting: _Setting) -> LoopRun:
    paths, estimates = out[..., :2], out[..., 2 : 2 + setting.states]
    times = setting.dt * np.arange(out.shape[-2])[:, None]
    target = setting.target[..., None, :]
    true = target[..., :2] + times * target[..., 2:]
    away = out[..., 2:4] + times * out[..., 4:6] - true
    ranges = np.hypot(*np.moveaxis(paths - true, -1, 0))
    return LoopRun(
        method=method,
        paths=paths,
        estimates=estimates,
        believed=out[..., 6],
        errors=np.hypot(away[..., 0], away[..., 1]),
        surprise=out[..., 7],
        ranges=ranges,
        nearest=ranges.min(axis=-1),
        dt=setting.dt,
    )


def _planned(
    setting: _Setting, happens: _Happens, replan: int, horizon: int | None, belief: bool
) -> Array:
    """Fly the plan of every `replan` bearings; all trials move together."""
    trials, samples = happens.noise.shape
    headings = np.zeros((trials, setting.moves))
    for first in range(0, setting.moves, replan):
        # The path so far is the same whatever is planned from here on.
        out = setting.run("headings", headings[:, :first], happens.until(first + 1))
        ahead = min(samples - first, max(horizon or samples, replan + 1))
        for trial in range(trials):
            found = _headings(setting, out[trial], happens.lost[trial], ahead, belief)
            headings[trial, first : first + len(found)] = found
    return setting.run("headings", headings, happens)


def _headings(setting: _Setting, out: Array, lost: Array, bearings: int, belief: bool) -> Array:
    """Plan the next part of a path from what is known of the target now."""
    n, at, now = setting.states, out[-1, :2], setting.dt * (len(out) - 1)
    state = out[-1, 2:6].copy()
    seen = (lost[: len(out)] == 0) | (np.arange(len(out)) == 0)
    information = _information(setting, out[:, :2], seen, state)
    # From the state at the start to that of now.
    ahead = np.eye(n)
    ahead[:2, 2:] = now * np.eye(2)[:, : n - 2]
    back = 2 * np.eye(n) - ahead
    information = back.T @ information @ back
    state[:2] += now * state[2:]
    # Three points with the mean and the variance of the direction that moves the target
    # most while the path lasts.
    unit = np.array([1.0, 1.0, 1 / (bearings * setting.dt), 1 / (bearings * setting.dt)])[:n]
    covariance = np.linalg.inv(information * np.outer(unit, unit))
    spread, axes = np.linalg.eigh(covariance)
    along = np.zeros(4)
    along[:n] = unit * np.sqrt(3 * spread[-1]) * axes[:, -1]
    targets = state + np.outer([-1.0, 0.0, 1.0], along)
    weights = np.array([1 / 6, 2 / 3, 1 / 6])
    ranges = np.hypot(*(targets[:, :2] - at).T)
    # What the stand-off range rules out by itself, or is behind the observer.
    there = (targets[:, :2] - at) @ (state[:2] - at) > 0
    use = there & (ranges > setting.length) & (belief | (weights > 0.5))
    use[1] = True
    before = out[-1, :2] - out[-2, :2] if len(out) > 1 else None
    chosen = plan(
        targets[use, :n],
        at,
        setting.length / setting.dt,
        setting.dt,
        bearings,
        sigma=setting.sigma,
        standoff=min(setting.standoff, 0.999 * float(ranges[use].min())),
        keep_out=_passed(setting.keep_out, at),
        max_turn_rate=setting.max_turn / setting.dt if np.isfinite(setting.max_turn) else None,
        heading=None if before is None else float(np.arctan2(*before)),
        prior=(information + information.T) / 2,
        weights=weights[use],
        starts=2,
        restarts=0,
        bound=False,
        max_iterations=15,
    )
    return chosen.headings


def _information(setting: _Setting, path: Array, seen: NDArray[np.bool_], state: Array) -> Array:
    """Return the information on the state at the start, what was known before included."""
    n = setting.states
    times = setting.dt * np.arange(len(path))[seen, None]
    offset = state[:2] + times * state[2:] - path[seen]
    squared = (offset**2).sum(axis=1)[:, None]
    place = offset[:, ::-1] * (1.0, -1.0) / (setting.sigma * squared)
    rows = np.hstack([place, times * place])[:, :n]
    away = state[:2] - setting.start
    sight = away / np.hypot(*away) / setting.first_range[1]
    information: Array = rows.T @ rows
    information[:2, :2] += np.outer(sight, sight)
    if setting.first_speed is not None:
        information[2:, 2:] += np.eye(2) / setting.first_speed**2
    return information


def _passed(discs: Array, at: Array) -> Array | None:
    """Return circles whose edge rounding has not put the observer inside of."""
    if not len(discs):
        return None
    kept = discs.copy()
    kept[:, 2] = np.minimum(discs[:, 2], np.hypot(*(discs[:, :2] - at).T) * (1 - 1e-12))
    return kept
