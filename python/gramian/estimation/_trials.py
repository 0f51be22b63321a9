"""Estimates of many simulated records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._answers import Answer
from gramian._arrays import SEED_MOST, finite, whole
from gramian._handle import EstimationModel, as_model, exact_data
from gramian._noise import as_box, as_pair
from gramian.estimation._knowledge import (
    columns_of,
    critical_at,
    informed,
    knowledge_of,
    levels,
    spread_of,
    starts_of,
)
from gramian.estimation._parts import STATUSES, not_white
from gramian.exceptions import InputError

__all__ = ["Trials", "estimate_trials"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Trials(Answer):
    """What `estimate_trials` found; arrays have one entry a trial.

    Attributes
    ----------
    names : tuple of str, length n
    truth : ndarray, shape (n,)
    states : ndarray, shape (trials, n)
        NaN, as `chi2`, where nothing of a trial could be computed: it did not converge.
    status : ndarray of str, shape (trials,)
        As of an `Estimate`.
    chi2, p_values, lag_p_values : ndarray, shape (trials,)
    chances : ndarray, shape (trials,)
        The largest chance that noise prefers another solution.
    inside : ndarray of bool, shape (trials,)
        Whether the truth is in the likelihood region of all states.
    covered : ndarray of bool, shape (trials,)
        Whether it is in the interval of `function`; all True without one.
    intervals : ndarray, shape (trials, 2)
        Lowest and highest end; infinite where open, NaN without a function.
    certain : ndarray of bool, shape (trials,)
    solves : ndarray, shape (trials,)
        Constrained solves an interval took.
    alternatives : mapping of str to ndarray, shape (trials,)
        p of the score test of each; NaN as `states`.
    """

    names: tuple[str, ...]
    truth: Array
    states: Array
    status: NDArray[np.str_]
    chi2: Array
    p_values: Array
    lag_p_values: Array
    chances: Array
    inside: NDArray[np.bool_]
    covered: NDArray[np.bool_]
    intervals: Array
    certain: NDArray[np.bool_]
    solves: Array
    alternatives: Mapping[str, Array]

    @property
    def shares(self) -> dict[str, float]:
        """Share of the trials with each status."""
        return {name: float((self.status == name).mean()) for name in STATUSES}

    @property
    def wrong(self) -> float:
        """Share of all trials that say "determined" with the truth outside the region."""
        return float(((self.status == "determined") & ~self.inside).mean())

    def to_dict(self) -> dict[str, Any]:
        """Return the shares as plain numbers, fit for JSON."""
        return {
            "trials": len(self.status),
            "shares": self.shares,
            "inside": float(self.inside.mean()),
            "covered": float(self.covered.mean()),
            "wrong": self.wrong,
            "uncertain": float((~self.certain).mean()),
        }

    def __str__(self) -> str:
        said = ", ".join(f"{100 * v:.3g} % {name}" for name, v in self.shares.items() if v > 0)
        inside = f"truth in the region {100 * self.inside.mean():.3g} %"
        if not np.isnan(self.intervals).all():
            inside += f", in the interval {100 * self.covered.mean():.3g} %"
        return f"{len(self.status)} trials: {said}; {inside}"


def estimate_trials(
    model: EstimationModel,
    truth: ArrayLike,
    *,
    seed: int,
    trials: int,
    first: int = 0,
    level: float = 0.95,
    function: str | None = None,
    alternatives: Mapping[str, ArrayLike] | None = None,
    shift: ArrayLike | None = None,
    start: ArrayLike | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    starts: int = 0,
    alpha: float = 0.001,
    chance: float = 0.01,
    weak_ratio: float = 0.25,
) -> Trials:
    """Simulate a state many times, estimate it each time, and ask whether the answers hold.

    Parameters
    ----------
    model : EstimationModel
    truth : array_like, shape (n,)
    seed : int
        >= 0. Trial i depends on (seed, i) alone.
    trials : int
        How many, >= 1.
    first : int
        Number of the first trial.
    level : float
        Confidence of regions and intervals.
    function : str, optional
        A function of the model: its interval is found in each trial, and makes an answer
        "weak" as in `estimate`. By default the first one the model judges by, if any.
    alternatives : mapping of str to array_like, shape (m,) or (m, parameters), optional
        Whitened columns of the score tests; by default the model's own, at the truth.
    shift : array_like, shape (m,), optional
        What the data have that the model has not, whitened: a bias, for one.
    start, prior, box, alpha, chance, weak_ratio
        As for `estimate`; a prior's mean is drawn about the truth.
    starts : int
        Points of prior and box that are followed in search of other solutions.

    Returns
    -------
    Trials

    Raises
    ------
    InputError
        As `estimate`.

    Notes
    -----
    Whitened noise is added to the residuals of exact data, on all threads, in the crate.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> model = gm.bearings.BearingsModel(t, path, np.array([1e-3]))
    >>> found = estimate_trials(model, [2000.0, 6000.0, 3.0, -1.0], seed=1, trials=100)
    >>> bool(found.inside.mean() > 0.85)
    True
    """
    model = as_model(model)
    x = finite(truth, "truth")
    names = tuple(model.names)
    if x.shape != (len(names),):
        raise InputError(f"truth has shape {x.shape}: must be ({len(names)},)")
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials, starts = whole(trials, "trials", 1), whole(starts, "starts", 0, 2**31)
    alpha, chance, weak_ratio = levels(alpha, chance, weak_ratio)
    z = exact_data(model, x)
    centred = {}
    for state, pair in options.mapping(prior, "prior", "name to (mean, sigma)").items():
        if state not in names:
            raise InputError(f"prior of {state!r}: the states are {', '.join(names)}")
        k = names.index(state)
        centred[state] = (float(x[k]), as_pair(pair, f"prior of {state}", model.units[k])[1])
    before, exact = knowledge_of(model, centred or None, {})
    if exact:
        raise InputError(f"prior of {next(iter(exact))}: sigma = 0, must be > 0 in trials")
    handle = informed(model, z, before, {})
    spread = spread_of(names, before, as_box(box, names, model.units), names)
    places = starts_of(model, z, start, list(range(len(names))), spread, before, names)
    functions = getattr(model, "functions", {})
    judged = tuple(getattr(model, "judged", functions))
    if function is not None and not isinstance(function, str):
        raise InputError(f"function = {options.given(function)}: must be the name of a function")
    name = function if function is not None else (judged[0] if judged else None)
    what = None
    if name is not None:
        if name not in functions:
            there = ", ".join(functions) or "none"
            raise InputError(f"function = {name!r}: the model has {there}")
        what = functions[name][0]
        if not callable(what):
            what = (list(what[0]), [float(value) for value in what[1]])
    if alternatives is None:
        made = getattr(model, "alternatives", None)
        alternatives = {} if made is None else made(x, z)
    columns = columns_of(alternatives)
    out = handle.trials(
        x,
        places,
        spread,
        (starts, seed) if starts or spread is not None else (0, seed),
        what,
        (critical_at(level, 1), critical_at(level, len(names))),
        list(columns.values()),
        None if shift is None else finite(shift, "shift"),
        seed,
        first,
        trials,
    )
    head, n = 14, len(names)
    p = out[:, head + n :]
    with np.errstate(invalid="ignore"):
        tested = p.shape[1]
        dof = z.size + len(centred) - n
        misfit = (out[:, 2] < alpha) & (dof > 0)
        if tested:
            misfit |= tested * p.min(axis=1) < alpha
        misfit |= not_white(dof, out[:, 2], out[:, 3], alpha)
        long = out[:, 8] - out[:, 7] > 2 * 1.96 * weak_ratio * np.abs(out[:, 12])
        status = np.select(
            [
                misfit,
                out[:, 0] != 1,
                out[:, 4] > chance,
                long & (what is not None and name in judged),
            ],
            ["misfit", "not_converged", "ambiguous", "weak"],
            "determined",
        )
    return Trials(
        names=names,
        truth=x,
        states=out[:, head : head + n],
        status=status,
        chi2=out[:, 1],
        p_values=out[:, 2],
        lag_p_values=out[:, 3],
        chances=out[:, 4],
        inside=out[:, 5] == 1,
        covered=(out[:, 6] == 1) | (what is None),
        intervals=out[:, 7:9],
        certain=(out[:, 10] == 1) | (what is None),
        solves=out[:, 13],
        alternatives=dict(zip(columns, p.T, strict=True)),
    )
