"""What came of a Monte Carlo run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gramian._answers import Answer, Columns, Tone
from gramian._compiled import TrialFunction
from gramian._registry import draw
from gramian._text import brief, plain
from gramian.exceptions import GramianError, InputError
from gramian.monte_carlo.chunks import Estimator, Failure, Statistics
from gramian.monte_carlo.experiment import Experiment
from gramian.monte_carlo.statistics import Moments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MonteCarloResult", "Nees", "Quantity"]

Array = NDArray[np.float64]
Table = NDArray[np.void]

LEVEL = 0.95
#: All tests of one verdict together: RMSE / bound and bias of every state, and the NEES.
FAMILY = 0.99
#: A difference of a deviation below this share is not told, however many trials show it.
MATERIAL = 0.05
#: Where an excess over the bound as large as this is not ruled out, nothing is said of it.
TOO_WIDE = 1.5
_ARRAYS = (
    "truth",
    "bias",
    "bias_interval",
    "std",
    "std_interval",
    "rmse",
    "rmse_interval",
    "covariance",
    "covariance_interval",
    "bound",
    "bound_covariance",
    "efficiency",
    "efficiency_interval",
)


@dataclass(frozen=True, eq=False, repr=False)
class Nees(Answer):
    """Normalised estimation error squared: whether errors fit the covariance claimed.

    Attributes
    ----------
    count : int
        Trials that have one.
    mean : float
    band : tuple of float
        Where the mean of a consistent estimator lies. Chi-square quantiles, so that all
        tests of the run's verdict hold together at 99 %; wider where the values spread
        more than chi-square ones do, and never narrower than what deviations wrong by
        5 % make of it.
    dof : int
        Expected mean: the number of states.
    inside : float
        Fraction of the trials within the 95 % ellipsoid of the claim.
    consistent : bool
        Whether the mean is in the band.
    edges, histogram : ndarray
        Counts between edges; the last count is of all above the last edge.
    """

    count: int
    mean: float
    band: tuple[float, float]
    dof: int
    inside: float
    consistent: bool
    edges: Array = field(repr=False)
    histogram: NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True, eq=False, repr=False)
class Quantity(Answer):
    """A number computed in every trial.

    Attributes
    ----------
    count : int
        Trials in which it is finite.
    mean, std : float
    mean_interval : tuple of float
        95 % confidence.
    low, high : float
        Extremes.
    """

    count: int
    mean: float
    mean_interval: tuple[float, float]
    std: float
    low: float
    high: float


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloResult(Answer):
    """An estimator's errors over many trials, beside the bound.

    All intervals are of 95 % confidence. Without an estimator the arrays of the
    states are empty of numbers (NaN) and `used` is 0.

    Attributes
    ----------
    names, units : tuple of str, length n
    truth : ndarray, shape (n,)
    seed, trials : int
    used : int
        Trials with an estimate: those that the averages are over.
    estimator : str or None
        Its name.
    bias, std, rmse : ndarray, shape (n,)
        Mean, standard deviation and root mean square of the errors.
    bias_interval, std_interval, rmse_interval : ndarray, shape (n, 2)
    rmse_dof : ndarray, shape (n,)
        Normal errors that would tell as much of the RMSE: fewer than `used` where the
        errors have long tails.
    covariance : ndarray, shape (n, n)
    covariance_interval : ndarray, shape (n, n, 2)
    bound : ndarray, shape (n,), or None
        On the standard deviation; `inf` where a state is not observable, None
        where the experiment has none.
    bound_covariance : ndarray, shape (n, n), or None
    efficiency : ndarray, shape (n,), or None
        RMSE / bound: 1 for an efficient estimator.
    efficiency_interval : ndarray, shape (n, 2), or None
    nees : Nees or None
        By the covariance the estimator returns, else by the bound; None where
        there is neither.
    quantities : mapping of str to Quantity
    failures : tuple of Failure
        By kind, the most frequent first. Failed trials are in no average.
    sample : structured ndarray
        The rows of the first trials (2048 at most), for pictures.
    table : structured ndarray, shape (trials,), or None
        The rows of all trials, if asked for: `trial`; `status`, 0 for success;
        `error_<state>`; `nees`; the quantities.
    seconds : float
        What the run took.
    simulated : int
        Trials that this run did itself; the others were resumed.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    truth: Array
    seed: int
    trials: int
    used: int
    estimator: str | None
    bias: Array
    bias_interval: Array
    std: Array
    std_interval: Array
    rmse: Array
    rmse_interval: Array
    rmse_dof: Array
    covariance: Array
    covariance_interval: Array
    bound: Array | None
    bound_covariance: Array | None
    efficiency: Array | None
    efficiency_interval: Array | None
    nees: Nees | None
    quantities: Mapping[str, Quantity]
    failures: tuple[Failure, ...]
    sample: Table = field(repr=False)
    table: Table | None = field(repr=False)
    seconds: float
    simulated: int

    _not_compared = frozenset({"seconds", "simulated"})

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        *,
        seed: int,
        estimator: str | Estimator | TrialFunction | None,
        bound: Array | None,
        bound_covariance: Array | None,
        statistics: Statistics,
        edges: Array | None,
        failures: tuple[Failure, ...],
        trials: int,
        sample: Table,
        table: Table | None,
        seconds: float,
        simulated: int,
    ) -> MonteCarloResult:
        """Return the result of finished statistics."""
        states = _states(statistics.errors, len(experiment.names))
        efficiency = interval = None
        if bound is not None:
            efficiency = states["rmse"] / bound
            interval = states["rmse_interval"] / bound[:, None]
        return cls(
            names=tuple(experiment.names),
            units=tuple(experiment.units),
            truth=np.asarray(experiment.truth, dtype=float),
            seed=seed,
            trials=trials,
            used=int(statistics.errors.count) if statistics.errors else 0,
            estimator=estimator
            if estimator is None or isinstance(estimator, str)
            else getattr(estimator, "__name__", type(estimator).__name__),
            bound=bound,
            bound_covariance=bound_covariance,
            efficiency=efficiency,
            efficiency_interval=interval,
            nees=_nees(statistics, edges, len(experiment.names), bound is not None),
            quantities=MappingProxyType(
                {
                    name: _quantity(node)
                    for name, node in statistics.scalars.items()
                    if name != "nees"
                }
            ),
            failures=failures,
            sample=sample,
            table=table,
            seconds=seconds,
            simulated=simulated,
            **states,
        )

    @property
    def rate(self) -> float:
        """Trials a second, of those that this run did itself."""
        return self.simulated / self.seconds if self.seconds > 0 else 0.0

    @property
    def failed(self) -> int:
        """Trials without an estimate."""
        return self.trials - self.used if self.estimator is not None else 0

    @property
    def biased(self) -> tuple[str, ...]:
        """States whose bias is significant, all tests of the verdict together, and material."""
        from scipy.special import stdtrit

        if self.used < 2:
            return ()
        each = stdtrit(self.used - 1, 0.5 + LEVEL / 2)
        reach = stdtrit(self.used - 1, 1 - self._error_rate / 2)
        half = (self.bias_interval[:, 1] - self.bias_interval[:, 0]) / 2
        significant = np.abs(self.bias) > half * reach / each
        material = np.abs(self.bias) > MATERIAL * self.rmse
        return tuple(
            name for name, found in zip(self.names, significant & material, strict=True) if found
        )

    @property
    def _error_rate(self) -> float:
        """The error rate of each two-sided test, so that all together keep `FAMILY`."""
        return _error_rate(len(self.names), self.bound is not None)

    @property
    def verdict(self) -> str:
        """The answer in one line.

        All that it compares, RMSE / bound and bias of every state and the NEES, holds at
        once with 99 %: of runs of an honest estimator one in a hundred is flagged.
        """
        if self.estimator is None:
            return f"SIMULATED: {self.trials} trials"
        if self.used == 0:
            return f"NO ESTIMATE: all {self.trials} trials failed"
        if self.bound is None or self.efficiency is None:
            return f"ESTIMATED: {self.used} trials, no bound to compare with"
        answer = self._against_bound(self.bound, self.efficiency)
        if self.failed and self.biased:
            # Failures that depend on the noise leave trials that are no fair sample.
            worst = max(self.biased, key=self._relative_bias)
            share = self._relative_bias(worst)
            return (
                f"BIASED SURVIVORS: {self.failed} of {self.trials} trials failed, and the mean "
                f"error of {worst} in the others is {share:.2g} of its RMSE; of them: {answer}"
            )
        return answer + (f"; {self.failed} of {self.trials} trials failed" if self.failed else "")

    def _relative_bias(self, name: str) -> float:
        i = self.names.index(name)
        return float(abs(self.bias[i]) / self.rmse[i]) if self.rmse[i] > 0 else 0.0

    def _against_bound(self, bound: Array, efficiency: Array) -> str:
        known = np.isfinite(bound) & (bound > 0)
        if not known.any():
            return "NOT OBSERVABLE: no state has a finite bound to compare with"
        worst = int(np.argmax(np.where(known, efficiency, -np.inf)))
        best = int(np.argmin(np.where(known, efficiency, np.inf)))
        ratio = f"RMSE / bound of {self.names[worst]} is {efficiency[worst]:.3f}"

        def limit(state: int, side: int) -> float:
            middle = float(efficiency[state])
            if not middle > 0:
                return 0.0
            factors = _chi_factors(self.rmse_dof[state : state + 1], 1 - self._error_rate)
            return middle * float(factors[0, side])

        if limit(worst, 0) > 1.0 and efficiency[worst] > 1 + MATERIAL:
            return f"ABOVE THE BOUND: {ratio}"
        if limit(best, 1) < 1.0 and efficiency[best] < 1 - MATERIAL:
            return (
                f"BELOW THE BOUND: RMSE / bound of {self.names[best]} is "
                f"{efficiency[best]:.3f}; the estimator is biased, or uses knowledge that "
                "the bound does not have"
            )
        if limit(worst, 1) > TOO_WIDE:
            return (
                f"TOO FEW TRIALS: {ratio}, give or take: {brief(limit(worst, 0), 2)} to "
                f"{brief(limit(worst, 1), 2)} (99 %, all states together)"
            )
        return f"REACHES THE BOUND: the largest {ratio.replace(' is', ',')}"

    def summary(self) -> str:
        """Return the verdict, the table of the states and the failures as text."""
        head = f"{self.trials} trials, seed {self.seed}"
        if self.estimator is not None:
            head += f", estimator {self.estimator}"
        lines = [self.verdict, f"  {head}, {self.rate:,.0f} trials/s"]
        if self.used:
            lines += ["  " + line for line in _columns(self._rows())]
        if self.nees is not None and self.nees.count:
            low, high = self.nees.band
            word = "consistent" if self.nees.consistent else "NOT CONSISTENT"
            lines.append(
                f"  NEES {brief(self.nees.mean, 4)}, {word}: expected {brief(low, 4)} to "
                f"{brief(high, 4)}; "
                f"{brief(100 * self.nees.inside)} % within the 95 % ellipsoid"
            )
        for name, quantity in self.quantities.items():
            low, high = quantity.mean_interval
            lines.append(
                f"  {name}: mean {quantity.mean:.6g} ({low:.6g} to {high:.6g}), "
                f"std {brief(quantity.std, 4)}, from {quantity.low:.6g} to {quantity.high:.6g}"
            )
        lines += [
            f"  {failure.count} of {self.trials}: {failure.kind}, first in trial "
            f"{failure.first_trial}: {failure.gist}"
            for failure in self.failures
        ]
        return "\n".join(lines)

    def _rows(self) -> list[list[str]]:
        rows = [["state", "unit", "bias", "(95 %)", "RMSE", "(95 %)", "bound", "RMSE/bound"]]
        for i, name in enumerate(self.names):
            bound = ratio = "-"
            if self.bound is not None and self.efficiency is not None:
                finite = bool(np.isfinite(self.bound[i]))
                bound = f"{brief(self.bound[i], 4)}" if finite else "not observable"
                ratio = f"{self.efficiency[i]:.3f}" if finite else "-"
            rows.append(
                [
                    name,
                    self.units[i],
                    f"{brief(self.bias[i])}",
                    "{:.3g} .. {:.3g}".format(*self.bias_interval[i]),
                    f"{brief(self.rmse[i], 4)}",
                    "{:.4g} .. {:.4g}".format(*self.rmse_interval[i]),
                    bound,
                    ratio,
                ]
            )
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return everything but tables and timings as plain values, fit for JSON.

        Two runs with equal numbers have equal dictionaries. Infinite values and
        NaN, which JSON does not have, become the strings "inf", "-inf" and "nan".
        """
        values: dict[str, Any] = {
            "verdict": self.verdict,
            "names": list(self.names),
            "units": list(self.units),
            "seed": self.seed,
            "trials": self.trials,
            "used": self.used,
            "estimator": self.estimator,
        }
        for name in _ARRAYS:
            array = getattr(self, name)
            values[name] = None if array is None else plain(array)
        values["nees"] = None
        if self.nees is not None:
            values["nees"] = {
                "count": self.nees.count,
                "mean": plain(self.nees.mean),
                "band": [plain(limit) for limit in self.nees.band],
                "dof": self.nees.dof,
                "inside": plain(self.nees.inside),
                "consistent": self.nees.consistent,
                "edges": plain(self.nees.edges),
                "histogram": [int(count) for count in self.nees.histogram],
            }
        values["quantities"] = {
            name: {
                "count": quantity.count,
                "mean": plain(quantity.mean),
                "mean_interval": [plain(limit) for limit in quantity.mean_interval],
                "std": plain(quantity.std),
                "low": plain(quantity.low),
                "high": plain(quantity.high),
            }
            for name, quantity in self.quantities.items()
        }
        values["failures"] = [
            {
                "kind": failure.kind,
                "count": failure.count,
                "first_trial": failure.first_trial,
                "message": failure.message,
            }
            for failure in self.failures
        ]
        return values

    def to_arrow(self, what: Literal["trials", "states"] = "trials") -> Any:
        """Return a pyarrow Table: a row for every trial, or one for every state.

        Raises
        ------
        InputError
            Rows of trials that were not kept.
        """
        try:
            from gramian.monte_carlo.resume import arrow_table

            if what == "trials":
                return arrow_table(self._trials())
            import pyarrow as pa

            return pa.table(self._state_columns())
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError("tables need pyarrow: pip install 'gramian[interop]'") from error

    def to_pandas(self, what: Literal["trials", "states"] = "trials") -> Any:
        """Return the same as `to_arrow` as a pandas DataFrame."""
        try:
            import pandas as pd
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError("frames need pandas: pip install 'gramian[interop]'") from error
        if what == "trials":
            table = self._trials()
            return pd.DataFrame({name: table[name] for name in table.dtype.names or ()})
        return pd.DataFrame(self._state_columns()).set_index("state")

    def _as_table(self) -> Columns:
        columns = self._state_columns()
        names, units = columns.pop("state"), columns.pop("unit")
        return Columns("state", names, columns, {}, units, {"covariance": self.covariance})

    def _verdict_line(self) -> str:
        return self.verdict

    @property
    def tone(self) -> Tone:
        """The colour of the verdict."""
        head = self.verdict.partition(":")[0]
        if head in {"REACHES THE BOUND", "SIMULATED", "ESTIMATED"}:
            return "good"
        return "bad" if head in {"NO ESTIMATE", "NOT OBSERVABLE", "BELOW THE BOUND"} else "weak"

    def to_parquet(
        self, path: str | os.PathLike[str], what: Literal["trials", "states"] = "trials"
    ) -> None:
        """Write the table of `to_arrow` to a Parquet file."""
        import pyarrow.parquet as pq

        pq.write_table(self.to_arrow(what), path)

    def _trials(self) -> Table:
        if self.table is None:
            raise InputError(
                'the rows of the trials were not kept: run with table = True, or ask for "states"'
            )
        return self.table

    def _state_columns(self) -> dict[str, Any]:
        columns: dict[str, Any] = {
            "state": list(self.names),
            "unit": list(self.units),
            "truth": self.truth,
        }
        for name in ("bias", "std", "rmse", "bound", "efficiency"):
            values = getattr(self, name)
            if values is not None:
                columns[name] = values
            limits = getattr(self, f"{name}_interval", None)
            if limits is not None:
                columns[f"{name}_low"], columns[f"{name}_high"] = limits.T
        return columns

    def plot(self) -> Figure:
        """Draw the error cloud, RMSE against bound, and the NEES; needs matplotlib."""
        return draw(self, "overview")


def _error_rate(states: int, bounded: bool) -> float:
    """Return the error rate of each two-sided test of a verdict on `states` states.

    One of several tests errs by chance more often than one alone does (Bonferroni).
    """
    return (1 - FAMILY) / ((2 if bounded else 1) * max(states, 1) + 1)


def _states(errors: Moments | None, n: int) -> dict[str, Array]:
    """Return bias, deviation, RMSE and covariance with their intervals."""
    from scipy.special import ndtri, stdtrit

    count = int(errors.count) if errors else 0
    if errors is None or count == 0:
        return _unknown(np.full(n, np.nan), np.nan)
    bias = errors.mean
    square = np.diag(errors.scatter) / count + bias**2
    rmse = np.sqrt(square)
    # Errors with long tails tell less of their mean square than normal ones: as
    # much as `dof` normal ones, by the variance of the squares.
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = errors.fourth / count / square**2 - 1
        dof = np.where(excess > 0, np.clip(2 * count / excess, 1.0, count), count)
    rmse_interval = rmse[:, None] * _chi_factors(dof)
    if count == 1:
        # One error has no spread to tell of.
        rmse_only = {"rmse": rmse, "rmse_interval": rmse_interval, "rmse_dof": np.asarray(dof)}
        return _unknown(bias, np.inf) | rmse_only
    covariance = errors.scatter / (count - 1)
    variance = np.diag(covariance)
    std = np.sqrt(variance)
    half = stdtrit(count - 1, 0.5 + LEVEL / 2) * std / np.sqrt(count)
    spread = np.maximum(dof - 1, 1.0)
    std_interval = std[:, None] * _chi_factors(spread)
    product = np.outer(variance, variance) + covariance**2
    reach = ndtri(0.5 + LEVEL / 2) * np.sqrt(product / np.minimum.outer(spread, spread))
    covariance_interval = np.stack([covariance - reach, covariance + reach], axis=-1)
    # A variance is not negative: its interval is the chi-square one.
    covariance_interval[np.arange(n), np.arange(n)] = std_interval**2
    return {
        "bias": bias,
        "bias_interval": np.stack([bias - half, bias + half], axis=1),
        "std": std,
        "std_interval": std_interval,
        "rmse": rmse,
        "rmse_interval": rmse_interval,
        "rmse_dof": np.asarray(dof, dtype=float),
        "covariance": covariance,
        "covariance_interval": covariance_interval,
    }


def _unknown(bias: Array, spread: float) -> dict[str, Array]:
    """Return what is known of no trial (`spread` NaN) or of one (infinite)."""
    n = bias.size
    limits = np.array([-spread, spread])
    none = np.full(n, np.nan)
    return {
        "bias": bias,
        "bias_interval": np.tile(limits, (n, 1)),
        "std": np.full(n, spread),
        "std_interval": np.tile(np.maximum(limits, 0), (n, 1)),
        "rmse": none,
        "rmse_interval": np.stack([none, none], axis=1),
        "rmse_dof": none,
        "covariance": np.full((n, n), spread),
        "covariance_interval": np.tile(limits, (n, n, 1)),
    }


def _chi_factors(dof: Array, level: float = LEVEL) -> Array:
    """Return what to multiply a deviation of `dof` degrees by for its interval (n, 2)."""
    from scipy.special import chdtri

    low, high = chdtri(dof, 0.5 - level / 2), chdtri(dof, 0.5 + level / 2)
    factors: Array = np.sqrt(np.stack([dof / low, dof / high], axis=-1))
    return factors


def _nees(statistics: Statistics, edges: Array | None, n: int, bounded: bool) -> Nees | None:
    node = statistics.scalars.get("nees")
    if node is None or edges is None or statistics.histogram is None or node.count == 0:
        return None
    from scipy.special import chdtri

    count = int(node.count)
    mean = float(node.mean[0])
    rate = _error_rate(n, bounded)
    low, high = chdtri(n * count, [1 - rate / 2, rate / 2]) / count
    # Long tails: how much more the values spread about their mean than chi-square ones.
    if count > 1 and mean > 0:
        spread = float(np.sqrt(node.scatter[0, 0] / (count - 1))) / mean
        tails = max(1.0, spread / np.sqrt(2 / n))
        low, high = n + tails * (low - n), n + tails * (high - n)
    low, high = min(low, n * (1 - MATERIAL) ** 2), max(high, n * (1 + MATERIAL) ** 2)
    return Nees(
        count,
        mean,
        (float(low), float(high)),
        n,
        statistics.inside / count,
        bool(low <= mean <= high),
        edges,
        statistics.histogram,
    )


def _quantity(node: Moments) -> Quantity:
    count = int(node.count)
    if count == 0:
        return Quantity(0, np.nan, (np.nan, np.nan), np.nan, np.nan, np.nan)
    from scipy.special import stdtrit

    mean = float(node.mean[0])
    std = float(np.sqrt(node.scatter[0, 0] / (count - 1))) if count > 1 else np.inf
    reach = float(stdtrit(count - 1, 0.5 + LEVEL / 2)) if count > 1 else np.inf
    half = reach * std / float(np.sqrt(count))
    return Quantity(
        count, mean, (mean - half, mean + half), std, float(node.low[0]), float(node.high[0])
    )


def _columns(rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
