"""The report of a simulated scenario."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gramian._text import brief, number, signed
from gramian.monte_carlo.experiment import Experiment
from gramian.monte_carlo.result import MonteCarloResult
from gramian.monte_carlo.run import run
from gramian.report import Picture, Report, Table, Tone

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["report", "simulate"]


def simulate(
    experiment: Experiment,
    trials: int,
    seed: int,
    *,
    title: str,
    subtitle: str,
    facts: Sequence[tuple[str, str]] = (),
    resume: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Report:
    """Run the experiment's own estimator and report its errors beside the bound."""
    result = run(experiment, trials, seed, resume=resume, progress=progress)
    return report(result, title=title, subtitle=subtitle, facts=facts)


def report(
    result: MonteCarloResult, *, title: str, subtitle: str, facts: Sequence[tuple[str, str]] = ()
) -> Report:
    """Return the report of a run: verdict, states, consistency, failures, plot."""
    headline, verdict = result.verdict.split(": ", 1)
    tables = [_states(result)] if result.used else []
    if result.failures:
        tables.append(_failures(result))
    return Report(
        title=title,
        subtitle=f"{subtitle}, {result.trials} trials, seed {result.seed}",
        tone=_tone(result, headline),
        headline=headline,
        verdict=verdict,
        facts=[*_facts(result), *facts],
        tables=tables,
        pictures=_pictures(result) if result.used else [],
        data={"monte_carlo": result.to_dict()},
    )


def _tone(result: MonteCarloResult, headline: str) -> Tone:
    if headline in ("NO ESTIMATE", "NOT OBSERVABLE"):
        return "bad"
    honest = result.nees is None or result.nees.consistent
    return "good" if headline == "REACHES THE BOUND" and honest and not result.failed else "weak"


def _facts(result: MonteCarloResult) -> list[tuple[str, str]]:
    facts = []
    if result.nees is not None:
        low, high = result.nees.band
        answer = "yes" if result.nees.consistent else "NO"
        facts.append(
            (
                "is its covariance consistent?",
                f"{answer}: NEES {brief(result.nees.mean, 4)}, expected {brief(low, 4)} to "
                f"{brief(high, 4)}; "
                f"{brief(100 * result.nees.inside)} % of the errors within the 95 % ellipsoid",
            )
        )
    biased = [
        f"{name} {signed(bias)} {unit}".rstrip()
        for name, unit, bias in zip(result.names, result.units, result.bias, strict=True)
        if name in result.biased
    ]
    if result.used:
        answer = f"NO: {', '.join(biased)}" if biased else "yes, all states together at 99 %"
        facts.append(("is it unbiased?", answer))
    failed = f"{result.failed} of {result.trials}" if result.failed else "none"
    facts.append(("trials without an estimate", failed))
    facts.append(("speed", f"{result.rate:,.0f} trials/s"))
    return facts


def _states(result: MonteCarloResult) -> Table:
    bound, ratio, interval = result.bound, result.efficiency, result.efficiency_interval
    columns = ["state", "unit", "bias", "RMSE"]
    columns += ["95 % of it"] if bound is None else ["bound", "RMSE / bound", "95 % of it"]
    rows = []
    for i, name in enumerate(result.names):
        row = [name, result.units[i], number(result.bias[i], 3), number(result.rmse[i])]
        if bound is None or ratio is None or interval is None:
            low, high = result.rmse_interval[i]
            row.append(f"{number(low)} to {number(high)}")
        else:
            known = bool(np.isfinite(bound[i]))
            low, high = interval[i]
            row += [number(bound[i]), f"{ratio[i]:.3f}" if known else "-"]
            row.append(f"{low:.3f} to {high:.3f}" if known else "-")
        rows.append(row)
    return Table("Errors beside the bound", columns, rows)


def _failures(result: MonteCarloResult) -> Table:
    rows = [[f.kind, str(f.count), str(f.first_trial), f.gist] for f in result.failures]
    return Table(
        "Trials that failed",
        ["kind", "trials", "first trial", "what it said"],
        rows,
        "They are in no average.",
    )


def _pictures(result: MonteCarloResult) -> list[Picture]:
    def drawn(what: str, **options: Any) -> Figure:
        # Loaded when a page is written: matplotlib is no part of a plain install.
        from gramian.monte_carlo import plot

        return plot.single(result, getattr(plot, what), **options)

    shown = [
        Picture(
            f"Errors of {result.names[i]} and {result.names[j]}",
            "Each point is a trial. The solid ellipse holds 95 % of normal errors with this "
            "spread, the dashed one is the bound's.",
            partial(drawn, "error_cloud", states=(i, j)),
        )
        for i, j in ((0, 1), (2, 3))
        if j < len(result.names)
    ]
    shown.append(
        Picture(
            "RMSE against the bound",
            "1 is the least that an unbiased estimator can have; bars are 95 % confidence.",
            partial(drawn, "rmse_and_bound"),
        )
    )
    if result.nees is not None:
        shown.append(
            Picture(
                "Is the covariance consistent?",
                "Squared errors over the covariance that the estimator claims: a consistent one "
                "follows the chi-square curve, an optimistic one lies to its right.",
                partial(drawn, "nees_histogram"),
            )
        )
    return shown
