"""What an estimate consists of: its fit, alternatives, other solutions, intervals, regions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gramian._answers import Answer, Columns
from gramian._text import brief
from gramian._text import number as readable

__all__ = [
    "SMALL",
    "STATUSES",
    "Alternative",
    "Fit",
    "Interval",
    "Region",
    "Solution",
    "Status",
    "not_white",
]

Array = NDArray[np.float64]
Status = Literal["unobservable", "misfit", "not_converged", "ambiguous", "weak", "determined"]

#: Every status of an `Estimate`, worst first.
STATUSES = ("unobservable", "misfit", "not_converged", "ambiguous", "weak", "determined")

#: Residuals whose p is larger are too small.
SMALL = 0.999

#: The level of the test of neighbouring residuals, over that of the tests of the fit.
NEIGHBOURS = 0.1


def not_white(
    dof: int | NDArray[np.int_],
    p_value: float | Array,
    lag_p_value: float | Array,
    alpha: float,
) -> np.bool_ | NDArray[np.bool_]:
    """Whether neighbouring residuals are correlated by more than chance leaves.

    At a tenth of `alpha`, so that the test adds little to the false alarms of chi2 and of the
    alternatives; from 10 degrees of freedom on, where the normal tail is never below the true
    one; not of residuals that are too small, since those of exact data repeat themselves.
    """
    correlated = np.asarray(lag_p_value) < NEIGHBOURS * alpha
    return (np.asarray(dof) >= 10) & correlated & ~(np.asarray(p_value) > SMALL)


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Answer):
    """Another state that fits.

    Attributes
    ----------
    state : ndarray, shape (n,)
    chi2 : float
        Sum of its squared whitened residuals.
    distance : float
        |h(other) - h(best)|, whitened: how many deviations apart their exact data are.
    chance : float
        The chance that noise prefers the wrong one of the two.
    hits : int
        How many of the starts reached it.
    """

    state: Array
    chi2: float
    distance: float
    chance: float
    hits: int


@dataclass(frozen=True, eq=False, repr=False)
class Alternative(Answer):
    """What a test says of one way in which the model may be wrong.

    Attributes
    ----------
    name : str
    p_value : float
        Probability of as large a statistic where the model is true; of several parameters
        the harmonic mean of that of the score test, and that of a test for parameters of
        one size.
    restored : float
        p of the fit with the alternative in the model.
    size : ndarray, shape (parameters,)
        Its parameters that fit best.
    detectable : float
        The smallest size that is seen with 80 % power; `inf` where it leaves no trace,
        or has several parameters.
    effect : ndarray, shape (n,)
        What that size does to each state: the external reliability.
    per_unit : ndarray, shape (n,)
        By how much a size of one moves each state, also where it leaves no trace; NaN of
        several parameters.
    alike : tuple of str
        Alternatives that the residuals cannot tell from it (correlation above 0.9).
    dof : int
        Parameters that leave a trace outside the model's columns.
    unit : str
        Of the parameters and of `detectable`; empty where the model gives none.
    """

    name: str
    p_value: float
    restored: float
    size: Array
    detectable: float
    effect: Array
    per_unit: Array
    alike: tuple[str, ...]
    dof: int = 1
    unit: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Answer):
    """How well the model fits.

    Attributes
    ----------
    chi2 : float
        Sum of the squared whitened residuals, those of priors included.
    dof : int
        Measurements and priors less states.
    p_value : float
        Probability of a larger chi2 if the model is true; NaN without degrees of freedom.
    residuals : ndarray, shape (m,)
        Whitened residuals in the order of the measurements.
    standardized : ndarray, shape (m,)
        The same over their own deviations after the fit: standard normal each.
    lag1 : tuple of float
        Correlation of neighbouring residuals; its mean and standard deviation for a true
        model after this fit; the probability of a larger one.
    alternatives : tuple of Alternative
        What would explain a misfit, the likeliest first.
    faults : tuple of str
        Channels that are dead, stuck or doubled, in words.
    """

    chi2: float
    dof: int
    p_value: float
    residuals: Array
    standardized: Array
    lag1: tuple[float, float, float, float]
    alternatives: tuple[Alternative, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def outliers(self) -> NDArray[np.int64]:
        """Measurements whose residual one honest record in a hundred would exceed."""
        from scipy.special import ndtri

        count = max(self.standardized.size, 1)
        return np.flatnonzero(np.abs(self.standardized) > -ndtri(0.005 / count))

    @property
    def joint(self) -> float:
        """The p of the likeliest alternative times their number (Bonferroni); at most 1."""
        tested = [a.p_value for a in self.alternatives if a.dof > 0]
        return min(1.0, len(tested) * min(tested)) if tested else 1.0

    @property
    def warning(self) -> str:
        """What a p near 1 says; empty otherwise."""
        if self.dof > 0 and self.p_value > SMALL:
            return f"p = {self.p_value:.6g}: the residuals are too small; sigma or a unit is wrong"
        return ""

    @property
    def correlated(self) -> str:
        """What the correlation of neighbouring residuals is, and should be, in words."""
        value, mean, deviation, p_value = self.lag1
        return (
            f"neighbouring residuals are correlated, {brief(value, 2)} where white noise leaves "
            f"{brief(mean, 2)} +- {brief(deviation, 1)} (p = {brief(p_value, 2)}): the noise is "
            "not white, or the model is wrong"
        )

    def _as_table(self) -> Columns:
        values = {"residual": self.residuals}
        if self.standardized.shape == self.residuals.shape:
            values["standardized"] = self.standardized
        return Columns("measurement", range(len(self.residuals)), values, {})


@dataclass(frozen=True, eq=False, repr=False)
class Interval(Answer):
    """The values of a state or function that the measurements allow.

    Attributes
    ----------
    name, unit : str
    level : float
        Confidence.
    value : float
        At the estimate.
    pieces : tuple of (float or None, float or None)
        Ascending; None for an end that does not exist.
    local : float
        Half the length of the interval of the local Gaussian approximation.
    certain : bool
        Whether each end is one: not where a constrained solve beyond it did not converge,
        so that the interval may go on.
    """

    name: str
    unit: str
    level: float
    value: float
    pieces: tuple[tuple[float | None, float | None], ...]
    local: float
    certain: bool = True

    @property
    def length(self) -> float:
        """Distance from the lowest to the highest end; `inf` for an open interval."""
        low, high = self.pieces[0][0], self.pieces[-1][1]
        return np.inf if low is None or high is None else high - low

    @property
    def is_local(self) -> bool:
        """Whether the local approximation differs by less than 5 %."""
        if len(self.pieces) != 1 or not np.isfinite(self.length):
            return False
        low, high = self.pieces[0]
        ends = (self.value - (low or 0.0), (high or 0.0) - self.value)
        return all(abs(end - self.local) < 0.05 * self.local for end in ends)

    def __contains__(self, value: float) -> bool:
        # Ends are found to ten digits: the least value of a function is one of them.
        return any(
            (low is None or value >= low - 1e-9 * abs(low))
            and (high is None or value <= high + 1e-9 * abs(high))
            for low, high in self.pieces
        )

    def __str__(self) -> str:
        words = []
        unit = f" {self.unit}" if self.unit else ""
        for low, high in self.pieces:
            if low is None and high is None:
                words.append("no limit either way")
            elif high is None:
                words.append(f"at least {readable(float(low or 0))}{unit}, no upper limit")
            elif low is None:
                words.append(f"at most {readable(high)}{unit}, no lower limit")
            else:
                words.append(f"{readable(low)} to {readable(high)}{unit}")
        doubt = "" if self.certain else " (perhaps farther: a constrained solve did not converge)"
        return f"{self.name} {' or '.join(words)}{doubt}"


@dataclass(frozen=True, eq=False, repr=False)
class Region(Answer):
    """The values of a pair of states or functions that the measurements allow.

    Attributes
    ----------
    names : tuple of str, length 2
    level : float
    contours : tuple of (ndarray, shape (k, 2))
        A curve for each piece.
    closed : tuple of bool
        Whether each closes; one that does not has an open end.
    complete : tuple of bool
        Whether each was followed to its end: not where a constrained solve did not
        converge on the way.
    """

    names: tuple[str, str]
    level: float
    contours: tuple[Array, ...]
    closed: tuple[bool, ...]
    complete: tuple[bool, ...]

    def _as_table(self) -> Columns:
        points = np.vstack([*self.contours, np.zeros((0, 2))])
        pieces = np.repeat(np.arange(len(self.contours)), [len(c) for c in self.contours])
        values = {self.names[0]: points[:, 0], self.names[1]: points[:, 1], "piece": pieces}
        return Columns("point", range(len(points)), values, {})
