"""The command `localize` on measured bearings: where the target is, and how well."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, number, plain
from gramian.exceptions import InputError, UnobservableError
from gramian.models.bearings import _localize, _rows
from gramian.report import Picture, Report, Table, Tone

if TYPE_CHECKING:
    from gramian.models.bearings._localize import Localization
    from gramian.models.bearings.scenario import BearingsScenario

__all__ = ["localize"]

Array = NDArray[np.float64]

_VERDICTS: dict[str, tuple[Tone, str]] = {
    "determined": ("good", "LOCATED"),
    "weak": ("weak", "WEAKLY LOCATED"),
    "unbounded": ("bad", "NOT LOCATED"),
    "not_converged": ("bad", "NOT LOCATED"),
    "misfit": ("bad", "MISFIT"),
}


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
    try:
        answer = _localize.localize(times, seen, observer, scenario.sigma, _prior(scenario))
    except UnobservableError as error:
        return Report(
            title=title,
            subtitle=subtitle,
            tone="bad",
            headline="UNOBSERVABLE",
            verdict="these bearings do not determine a position",
            facts=[
                *(("changes no measurement", text) for text in error.null_combinations),
                ("what would help", "a turn of the observer, or a prior on one of these states"),
            ],
            data={"model": scenario.model, "status": "unobservable",
                  "null_combinations": list(error.null_combinations)},
        )  # fmt: skip
    except InputError as error:
        raise scenario.error("bearings", str(error)) from error
    return _report(scenario, title, subtitle, times, seen, observer, answer)


def _report(
    scenario: BearingsScenario,
    title: str,
    subtitle: str,
    times: Array,
    seen: Array,
    observer: Array,
    answer: Localization,
) -> Report:
    tone, headline = _VERDICTS[str(answer.status)]
    data: dict[str, Any] = {
        "model": scenario.model,
        "bearings": times.size,
        "epoch": scenario.epoch,
    }
    data |= answer.to_dict()
    agree = float(answer.p_value)
    if np.isnan(agree):
        says = "no degrees of freedom to tell"
    elif agree > 0.999:
        says = f"better than chance allows (p = {agree:.5g}): is sigma too large, or a unit wrong?"
    else:
        says = f"{'yes' if agree > 0.05 else 'NO'} (p = {brief(agree, 2)})"
    misfit = (
        f"no target at constant velocity gives these bearings (chi2 {number(float(answer.chi2))} "
        f"for {answer.dof} degrees of freedom, p = {brief(agree, 2)}): it turned, the bearings are "
        "biased, or their sigma is larger than stated"
    )
    facts = [("do the bearings agree with constant velocity?", says)]
    if not np.isfinite(answer.state).all():
        return Report(
            title=title,
            subtitle=subtitle,
            tone=tone,
            headline=headline,
            verdict=misfit
            if answer.status == "misfit"
            else "the likelihood grows towards infinite range: no position is the most likely",
            facts=facts,
            data=data,
        )
    vx, vy = answer.state[2:]
    course = np.degrees(np.arctan2(vx, vy)) % 360
    offset = answer.state[:2] - observer[0]
    reach = float(np.hypot(*offset))
    spread = _range_std(offset, answer.covariance[:2, :2])
    verdict = (
        f"{brief(reach, 4)} m +- {number(spread, 2)} m ({number(100 * spread / reach, 2)} %) "
        "on bearing "
        f"{np.degrees(np.arctan2(*offset)) % 360:.1f} deg, "
        f"moving {number(np.hypot(vx, vy), 3)} m/s on course {course:.0f} deg"
    )
    if answer.status == "not_converged":
        verdict = "the iterations did not settle; the last state is shown, do not use it"
    elif answer.status == "misfit":
        verdict = f"{misfit}; the state below trusts a model that does not hold, do not use it"
    elif agree <= 0.05:
        tone = "weak"
        headline += " IF IT KEEPS ITS COURSE"
        verdict += "; but the bearings do not agree with constant velocity and this noise"
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
    facts.append(
        (
            "error ellipse of the first position (95 %)",
            f"half axes {number(axes[0], 3)} m and {number(axes[1], 3)} m, the longer one "
            f"towards {np.degrees(angle):.0f} deg",
        )
    )
    facts.append(("time of the states", scenario.recording.when(float(times[0]))))
    rows = [
        [name, number(value, 6), number(std), unit]
        for name, value, std, unit in zip(
            answer.names, answer.state, answer.std, answer.units, strict=True
        )
    ]
    return Report(
        title=title,
        subtitle=subtitle,
        tone=tone,
        headline=headline,
        verdict=verdict,
        facts=facts,
        tables=[
            Table(
                "The most likely motion",
                ["state", "estimate", "standard deviation", "unit"],
                rows,
                "At the first bearing. The deviations are the Cramer-Rao bound there, priors "
                "included.",
            ),
            Table(
                "Residuals",
                ["chi-square", "degrees of freedom", "p", "largest (deg)", "rms (deg)"],
                [
                    [
                        number(float(answer.chi2)),
                        str(answer.dof),
                        "" if np.isnan(agree) else f"{brief(agree)}",
                        number(float(np.degrees(np.abs(left).max()))),
                        number(float(np.degrees(np.sqrt((left**2).mean())))),
                    ]
                ],
            ),
        ],
        pictures=[
            Picture(
                "Where it is",
                "The observer's path, some of its bearings, the estimated track, and the region "
                "that holds its first position with 95 % probability.",
                lambda: _pictures().located(
                    observer, seen, path, answer.covariance[:2, :2], recorded
                ),
            ),
            Picture(
                "Residuals",
                "What the estimate leaves of each bearing, against one and two standard "
                "deviations. A pattern says that the target did not keep its course.",
                lambda: _pictures().residuals(times, left, scenario.sigma),
            ),
        ],
        data=data,
    )


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


def _range_std(offset: Array, covariance: Array) -> float:
    along = offset / np.hypot(*offset)
    return float(np.sqrt(along @ covariance @ along))


def _ellipse(covariance: Array) -> tuple[Array, float]:
    """Semi-axes of the 95 % region, the longer first, and its azimuth in [0, pi)."""
    values, vectors = np.linalg.eigh(covariance)
    axes: Array = np.sqrt(-2 * np.log(0.05) * np.maximum(values[::-1], 0))
    return axes, float(np.arctan2(*vectors[:, 1]) % np.pi)


def _pictures() -> Any:
    from gramian.models.bearings import _plot_localize as pictures

    return pictures
