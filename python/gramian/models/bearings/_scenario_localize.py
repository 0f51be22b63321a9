"""The command `localize` on measured bearings: where the target is, and how well."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, count, number, plain
from gramian.estimation import Estimate
from gramian.exceptions import InputError
from gramian.models.bearings import _localize, _rows
from gramian.report import Picture, Report, Table, Tone

if TYPE_CHECKING:
    from gramian.models.bearings.scenario import BearingsScenario
    from gramian.models.tracks import LegChoice

__all__ = ["localize"]

Array = NDArray[np.float64]

_VERDICTS: dict[str, tuple[Tone, str]] = {
    "determined": ("good", "LOCATED"),
    "weak": ("weak", "WEAKLY LOCATED"),
    "ambiguous": ("weak", "AMBIGUOUS"),
    "not_converged": ("bad", "NOT LOCATED"),
    "misfit": ("bad", "MISFIT"),
}

#: Legs that are tried where a target at constant velocity does not fit.
_MOST_LEGS = 3


def localize(scenario: BearingsScenario) -> Report:
    """Estimate the target's motion from the bearings in the file that a scenario names."""
    if scenario.bearings is None and not scenario.recording.sensors:
        raise scenario.error("bearings", "is missing: localize needs the file of measured bearings")
    if scenario.measured is None:
        there = ", ".join(map(repr, scenario.recording.sensors))
        raise scenario.error("bearings.sensor", f"is missing: the sensors are {there}")
    times, seen = scenario.measured
    observer = scenario.track(scenario.tracks.observer, times)
    title = f"{scenario.tracks.observer or 'observer'} -> {scenario.tracks.target or 'target'}"
    subtitle = (
        f"{times.size} bearings over {times[-1] - times[0]:g} s, "
        f"sigma {scenario.noise.bearing_deg:g} deg"
    )
    prior = _prior(scenario)
    try:
        answer = _localize.localize(times, seen, observer, scenario.sigma, prior)
    except InputError as error:
        raise scenario.error("bearings", str(error)) from error
    if answer.status == "unobservable":
        return Report(
            title=title,
            subtitle=subtitle,
            tone="bad",
            headline="UNOBSERVABLE",
            verdict="these bearings do not determine a position",
            facts=[
                *(("changes no measurement", text) for text in answer.null_combinations),
                ("what would help", "a turn of the observer, or a prior on one of these states"),
            ],
            data={"model": scenario.model, "status": "unobservable",
                  "null_combinations": list(answer.null_combinations)},
        )  # fmt: skip
    return _report(scenario, title, subtitle, (times, seen, observer), answer, prior)


def _report(
    scenario: BearingsScenario,
    title: str,
    subtitle: str,
    record: tuple[Array, Array, Array],
    answer: Estimate,
    prior: dict[str, tuple[float, float]],
) -> Report:
    times, seen, observer = record
    status, fit = answer.status, answer.fit
    tone, headline = _VERDICTS[status]
    data: dict[str, Any] = {"model": scenario.model, "bearings": times.size}
    data |= {"epoch": scenario.epoch, **answer.to_dict()}
    reach = answer.interval("range")
    data["range"] = reach.to_dict()
    verdict = _where(answer, observer)
    facts = [("do the bearings agree with constant velocity?", _agreement(fit.p_value))]
    legs = None
    if status == "misfit":
        legs = _legs(record, scenario.sigma, prior)
        facts.append(("what would explain them", _explanation(answer, legs, float(times[0]))))
        verdict = f"{answer.reason}; the state below trusts a model that does not hold"
    elif status == "not_converged":
        verdict = "the iterations did not settle; the last state is shown, do not use it"
    else:
        if status in ("weak", "ambiguous"):
            verdict = f"{answer.reason}; {verdict}"
        if fit.p_value <= 0.05:
            tone = "weak"
            headline += " IF IT KEEPS ITS COURSE"
            verdict += "; but the bearings do not agree with constant velocity and this noise"
        facts.append(("range at the first bearing (95 %)", str(reach).removeprefix("range ")))
    path = answer.state[:2] + (times - times[0])[:, None] * answer.state[2:]
    recorded = _recorded(scenario, times)
    if recorded is not None:
        error = float(np.hypot(*(recorded[0] - answer.state[:2])))
        facts.append(("distance from the recorded first position", f"{brief(error, 4)} m"))
        data["error"] = plain(answer.state[:2] - recorded[0])
    left = _localize.residuals(times, seen, observer, answer.state)
    data["residuals"] = plain(left)
    axes, angle = _ellipse(answer.covariance[:2, :2])
    data["error_ellipse"] = {"semi_axes": plain(axes), "major_axis_azimuth": plain(angle)}
    if status != "misfit" and np.isfinite(axes).all():
        facts.append(
            (
                "error ellipse of the first position (95 %)",
                f"half axes {number(axes[0], 3)} m and {number(axes[1], 3)} m, the longer one "
                f"towards {np.degrees(angle):.0f} deg",
            )
        )
    facts.extend(("would go unseen", text) for text in answer.unseen_errors)
    facts.append(("time of the states", scenario.recording.when(float(times[0]))))
    tables = [_states(answer), _residuals(answer, left)]
    if answer.others:
        tables.append(_others(answer))
    pictures = [
        Picture(
            "Where it is",
            "The observer's path, some of its bearings, the estimated track, and the region "
            "of the likelihood that holds its first position with 95 % probability.",
            lambda: _pictures().located(observer, seen, path, _region(answer), recorded),
        ),
        Picture(
            "Residuals",
            "What the estimate leaves of each bearing, against one and two standard "
            "deviations. A pattern says that the target did not keep its course.",
            lambda: _pictures().residuals(times, left, scenario.sigma),
        ),
    ]
    if legs is not None:
        tables.insert(0, _leg_table(legs))
        pictures.append(
            Picture(
                "Legs",
                f"Residuals with one leg, and with {count(int(legs.count), 'leg')}.",
                legs.plot,
            )
        )
        data["legs"] = {"count": int(legs.count), "estimate": legs.best.to_dict()}
    return Report(
        title=title,
        subtitle=subtitle,
        tone=tone,
        headline=headline,
        verdict=verdict,
        facts=facts,
        tables=tables,
        pictures=pictures,
        data=data,
    )


def _agreement(p: float) -> str:
    if np.isnan(p):
        return "no degrees of freedom to tell"
    if p > 0.999:
        return f"better than chance allows (p = {p:.5g}): is sigma too large, or a unit wrong?"
    return f"{'yes' if p > 0.05 else 'NO'} (p = {brief(p, 2)})"


def _where(answer: Estimate, observer: Array) -> str:
    """Return range, bearing, speed and course of an estimate in words."""
    vx, vy = answer.state[2:]
    offset = answer.state[:2] - observer[0]
    reach, interval = float(np.hypot(*offset)), answer.interval("range")
    spread = interval.local / 1.959964
    known = f"{brief(reach, 4)} m"
    if interval.is_local:
        known += f" +- {number(spread, 2)} m ({number(100 * spread / reach, 2)} %)"
    else:
        known += f" (95 %: {str(interval).removeprefix('range ')})"
    return (
        f"{known} on bearing {np.degrees(np.arctan2(*offset)) % 360:.1f} deg, "
        f"moving {number(np.hypot(vx, vy), 3)} m/s on course "
        f"{np.degrees(np.arctan2(vx, vy)) % 360:.0f} deg"
    )


def _legs(
    record: tuple[Array, Array, Array], sigma: float, prior: dict[str, tuple[float, float]]
) -> LegChoice | None:
    """Return how many legs the bearings call for; None where they cannot say."""
    from gramian.models import tracks

    times, seen, observer = record
    try:
        sensor = tracks.Sensor.bearing(tracks.Carrier(observer, times), times, sigma=sigma)
        scene = tracks.Scene(tracks.Motion.legs(count=1), [sensor])
        own = {{"vx": "vx_1", "vy": "vy_1"}.get(name, name): known for name, known in prior.items()}
        found = tracks.choose_legs(scene, [seen], most=_MOST_LEGS, prior=own)
    except InputError:
        return None
    return found if int(found.count) > 1 else None


def _explanation(answer: Estimate, legs: LegChoice | None, start: float) -> str:
    """Return what would explain a misfit, in words."""
    if legs is not None:
        best, turns = legs.best, int(legs.count) - 1
        at = " and ".join(
            f"{float(best.value(f'turn_{k}')) + best.scene.origin - start:.0f} s"
            for k in range(1, turns + 1)
        )
        fits = f"chi2 {brief(float(best.chi2), 4)} for {int(best.dof)} degrees of freedom"
        if float(best.p_value) > answer.alpha:
            says = f"{count(turns, 'turn')} of the target, {at} after the first bearing ({fits})"
            if best.status == "determined":
                return f'{says}: give motion of {turns + 1} legs to model = "tracks"'
            return f"{says}; but with that these bearings alone leave it {best.status}"
        return f"not {count(turns, 'turn')} of the target alone ({fits})"
    better = [a for a in answer.fit.alternatives if a.dof and a.restored > answer.alpha]
    if better:
        return f"{better[0].name} (p = {brief(better[0].restored, 2)} with it)"
    return "none of a turn, an acceleration, a bias or a clock offset: is sigma too small?"


def _states(answer: Estimate) -> Table:
    rows = []
    for name, value, std, unit in zip(
        answer.names, answer.state, answer.std, answer.units, strict=True
    ):
        allowed = "" if answer.status == "misfit" else str(answer.interval(name))
        rows.append([name, number(value, 6), number(std), unit, allowed.removeprefix(f"{name} ")])
    return Table(
        "The most likely motion",
        ["state", "estimate", "standard deviation", "unit", "95 % interval"],
        rows,
        "At the first bearing. The deviations are the Cramer-Rao bound there, priors included; "
        "the intervals are those of the profile likelihood.",
    )


def _residuals(answer: Estimate, left: Array) -> Table:
    fit = answer.fit
    return Table(
        "Residuals",
        ["chi-square", "degrees of freedom", "p", "largest (deg)", "rms (deg)"],
        [
            [
                number(fit.chi2),
                str(fit.dof),
                "" if np.isnan(fit.p_value) else f"{brief(fit.p_value)}",
                number(float(np.degrees(np.abs(left).max()))),
                number(float(np.degrees(np.sqrt((left**2).mean())))),
            ]
        ],
    )


def _others(answer: Estimate) -> Table:
    return Table(
        "Other solutions",
        [*answer.names, "chi-square", "chance that noise prefers it"],
        [
            [*(number(value, 5) for value in other.state), number(other.chi2), brief(other.chance)]
            for other in answer.others
        ],
    )


def _leg_table(legs: LegChoice) -> Table:
    rows = []
    for k, one in enumerate(legs.estimates):
        turns = (f"{float(one.value(f'turn_{j}')) + one.scene.origin:.4g}" for j in range(1, k + 1))
        rows.append(
            [
                f"{k + 1}{' (chosen)' if k + 1 == int(legs.count) else ''}",
                number(float(one.cost)),
                str(int(one.dof)),
                brief(float(one.p_value), 2),
                number(float(legs.penalty[k])),
                ", ".join(turns),
                str(one.status),
            ]
        )
    return Table(
        "Legs of the target",
        ["legs", "chi-square", "degrees of freedom", "p", "penalty", "turns (s)", "status"],
        rows,
        "The number of legs with the least chi-square and penalty (Bayesian information "
        "criterion) is chosen.",
    )


def _region(answer: Estimate) -> tuple[Array, ...]:
    return answer.region(("x0", "y0")).contours


def _prior(scenario: BearingsScenario) -> dict[str, tuple[float, float]]:
    if scenario.known:
        raise scenario.error(
            "known", "localize needs a value too: give a prior with a mean and a small sigma"
        )
    prior: dict[str, tuple[float, float]] = {}
    for name, value in scenario.prior.items():
        if name not in _rows.NAMES:
            raise scenario.error(
                f"prior.{name}", f"localize takes priors of {', '.join(_rows.NAMES)}"
            )
        if isinstance(value, float) or value.mean is None:
            raise scenario.error(f"prior.{name}", "localize needs its mean beside its sigma")
        prior[name] = (value.mean, value.sigma)
    return prior


def _recorded(scenario: BearingsScenario, times: Array) -> Array | None:
    if scenario.target is not None:
        t = scenario.target
        place: Array = np.array([t.x0, t.y0]) + np.outer(times - times[0], [t.vx, t.vy])
        return place
    if scenario.tracks.target is None and scenario.tracks.target_file is None:
        return None
    return scenario.target_at(times)


def _ellipse(covariance: Array) -> tuple[Array, float]:
    """Semi-axes of the 95 % region, the longer first, and its azimuth in [0, pi)."""
    values, vectors = np.linalg.eigh(covariance)
    axes: Array = np.sqrt(-2 * np.log(0.05) * np.maximum(values[::-1], 0))
    return axes, float(np.arctan2(*vectors[:, 1]) % np.pi)


def _pictures() -> Any:
    from gramian.models.bearings import _plot_localize as pictures

    return pictures
