"""Estimates of the biases from reports, with what they cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import SEED_MOST, as_float_array, number, whole
from gramian._text import brief, describe_direction
from gramian.exceptions import ConvergenceError, InputError, UnobservableError
from gramian.models.registration._model import gauges
from gramian.models.registration._reports import Reports, report_array
from gramian.models.registration._setup import Array, Extra, SensorsLike, Setup, setup
from gramian.models.registration._tracks import singular_tracks

Method = Literal["ls", "gls", "ml"]
STATUSES = ("determined", "not converged", "unobservable")

#: Information of which more than this share is made by the noise of the positions is none.
NOISE_SHARE = 0.5
#: Nor is information that grows by more than this share within its own deviation.
BEND = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Answer):
    """What `estimate` found; arrays have the leading axes of the reports.

    Attributes
    ----------
    names, units : tuple of str, length n
    biases : ndarray, shape (..., n)
    std : ndarray, shape (..., n)
        Standard deviations; `inf` for a bias that is not determined and has no prior.
    covariance : ndarray, shape (..., n, n)
        Where something is not determined, on the rest.
    status : ndarray of str, shape (...)
        "determined", "not converged" or "unobservable".
    held_by_prior : tuple of str
        The combinations that the reports do not determine and only the prior
        does; told for one set of reports, without trials.
    iterations : ndarray of int, shape (...)
        Linearisations made.
    chi_square : ndarray, shape (...)
        Sum of squared residuals over their deviations.
    dof : int
        What chi-square is on average when reports agree with the model.
    noise_share : ndarray, shape (...)
        Share of the weakest direction's information that noise would make alone.
    bend : ndarray, shape (...)
        Its growth within the direction's own deviation.
    positions : ndarray, shape (..., K, d)
        The targets.
    method : {"ls", "gls", "ml"}
    prior : mapping of str to float
        Deviations known beforehand.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    biases: Array
    std: Array
    covariance: Array
    status: NDArray[np.str_]
    held_by_prior: tuple[str, ...]
    iterations: NDArray[np.int_]
    chi_square: Array
    dof: int
    noise_share: Array
    bend: Array
    positions: Array = field(repr=False)
    method: Method
    prior: Mapping[str, float]

    _more_in_dict = ("p_value",)
    _not_in_dict = frozenset({"positions"})

    @property
    def p_value(self) -> Array:
        """Probability of a larger chi-square: small when reports and model disagree.

        NaN without degrees of freedom.
        """
        if self.dof < 1:
            return np.nan * self.chi_square
        value: Array = _core.chi_square_survival(self.chi_square, self.dof)[()]
        return value

    def __getitem__(self, name: str) -> Array:
        """Return one bias by name."""
        if name not in self.names:
            raise InputError(f"no bias is named {name!r}: there are {', '.join(self.names)}")
        value: Array = self.biases[..., self.names.index(name)]
        return value

    def summary(self) -> str:
        """Return one estimate as text; of many, their number and states."""
        if self.biases.ndim > 1:
            counts = [f"{int((self.status == name).sum())} {name}" for name in STATUSES]
            return f"{self.status.size} estimates: {', '.join(counts)}"
        lines = [f"{self.method.upper()}: {self.status}"]
        width = max(len(name) for name in self.names)
        for name, unit, value, std in zip(
            self.names, self.units, self.biases, self.std, strict=True
        ):
            if np.isinf(std):
                lines.append(f"  {name:<{width}}  not observable")
            elif unit == "rad":
                degrees = np.degrees([value, std])
                lines.append(f"  {name:<{width}}  {degrees[0]:.5g} +- {brief(degrees[1], 2)} deg")
            else:
                lines.append(f"  {name:<{width}}  {value:.5g} +- {brief(std, 2)} {unit}".rstrip())
        lines += [f"  held by the prior alone: {text}" for text in self.held_by_prior]
        if self.dof > 0:
            lines.append(
                f"  chi-square {brief(self.chi_square, 4)} of {self.dof} (p = "
                f"{brief(self.p_value, 2)})"
            )
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        others = {"status": self.status, "chi2": self.chi_square, "p_value": self.p_value}
        return columns_of_states(
            self.names, self.units, {"": self.biases, "std": self.std}, others, self.covariance
        )


def estimate(
    reports: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    method: Method = "ml",
    prior: ArrayLike | Mapping[str, float] | None = None,
    extras: Sequence[Extra] = (),
    iterations: int | None = None,
    tolerance: float = 1e-6,
    on_failure: Literal["raise", "report"] = "raise",
) -> Estimate:
    """Estimate the biases from reports alone: the targets' positions are not needed.

    Parameters
    ----------
    reports : array_like, shape (..., K, N, d), or Reports
        For each look and sensor range (m), azimuth and, with d = 3, elevation
        (rad). Leading axes are trials.
    sensors, sigma, extras
        As for `rows`.
    method : {"ls", "gls", "ml"}
        "ml": maximum likelihood, by Gauss-Newton over the biases and all
        positions, which reaches the bound. "gls": least squares weighted by the
        noise, linearised at the reports. "ls": the same unweighted, in metres, as
        in Zhu, Tang & He 2013.
    prior : mapping of str to float, or array_like, shape (n,), optional
        Standard deviations of biases known beforehand to be near 0 (`inf` for
        none): what a singular geometry needs. Not with "ls".
    iterations : int, optional
        Linearisations at most: 100 for "ml", 1 for "gls" and "ls". With more,
        those are linearised again at the corrected reports, as large biases need.
    tolerance : float
        "ml" ends when a step is below so many standard deviations.
    on_failure : {"raise", "report"}
        Raise when biases are not determined or the iteration did not end; or say
        so in `status` and `std`. With trials the first failure counts.

    Returns
    -------
    Estimate

    Raises
    ------
    UnobservableError
        Reports from a singular geometry without a prior; it names the combination
        of biases and, for two sensors, the track.
    ConvergenceError
        An iteration that did not end.
    InputError
        As `rows`; reports of a wrong shape.

    Warns
    -----
    UserWarning
        Angles beyond a whole turn: degrees by mistake.

    Notes
    -----
    Each look's equations in position and biases are reduced by an orthogonal
    transformation; what is left gives d xi = (sum P_k)^-1 sum P_k e_k, with
    P = W - W G (G^T W G)^-1 G^T W, W = Sigma^-1 and G = dh/dp; positions follow by
    back-substitution. Azimuth residuals are wrapped. Least squares has two
    defects: linearisation at large biases, cured by linearising again, and noise
    in the coefficients, cured only by maximum likelihood.

    Reports put even a target on a singular track a little beside it, so the rows
    never look singular. A direction is refused when half of its information would
    be made by the noise of the positions, or when its information grows by 5 % or
    more within its own standard deviation (then the deviation is not one). The
    check is not perfect: abeam a sensor about one set of reports in ten fits
    another, regular track as well as the true one, and is answered. Where a target
    may be on a singular track, ask `check_track` too.

    Examples
    --------
    >>> import numpy as np
    >>> path = np.stack([np.linspace(-20e3, 60e3, 100), np.full(100, 25e3)], axis=1)
    >>> sensors, sigma = {"A": (0, 0), "B": (60e3, 0)}, (50.0, np.radians(0.1))
    >>> from gramian.models.registration import simulate
    >>> reports = simulate(path, sensors, sigma, {"A.range": 300, "B.azimuth": -0.007}, seed=1)
    >>> answer = estimate(reports, sensors, sigma)
    >>> bool(abs(answer["A.range"] - 300) < 4 * answer.std[0])
    True
    """
    options.choice(method, "method", ("ls", "gls", "ml"))
    known = setup(sensors, sigma, extras)
    values = reports.values if isinstance(reports, Reports) else report_array(reports)
    if method == "ls" and prior is not None:
        raise InputError('method "ls" is not weighted: a prior needs "gls" or "ml"')
    options.choice(on_failure, "on_failure", ("raise", "report"))
    count = _iterations(iterations, method)
    if not number(tolerance, "tolerance") > 0:
        raise InputError(f"tolerance = {tolerance}: must be > 0")
    deviations = _prior(known, prior)
    found = _core.registration_estimate(
        values, known.places, known.sigma, known.flags, deviations, method,
        (count, tolerance, NOISE_SHARE, BEND), True,
    )  # fmt: skip
    looks = values.shape[-3]
    return _unpacked(known, found, looks, method, deviations, on_failure)


def estimate_trials(
    positions: ArrayLike,
    sensors: SensorsLike,
    sigma: ArrayLike,
    biases: ArrayLike | Mapping[str, float] | None = None,
    *,
    seed: int,
    trials: int,
    first: int = 0,
    method: Method = "ml",
    prior: ArrayLike | Mapping[str, float] | None = None,
    extras: Sequence[Extra] = (),
    iterations: int | None = None,
    tolerance: float = 1e-6,
) -> Estimate:
    """Simulate and estimate in one pass: what `estimate` makes of `simulate`, for many trials.

    Parameters
    ----------
    positions, biases
        The truth, as for `simulate`.
    sensors, sigma, extras, method, prior, iterations, tolerance
        As for `estimate`.
    seed, first, trials : int
        Trials first, first + 1, ... under this seed.

    Returns
    -------
    Estimate
        Failures are in `status`. Positions are not kept: shape (trials, 0, d).

    Examples
    --------
    >>> import numpy as np
    >>> path = np.stack([np.linspace(-20e3, 60e3, 100), np.full(100, 25e3)], axis=1)
    >>> sensors, sigma = {"A": (0, 0), "B": (60e3, 0)}, (50.0, np.radians(0.1))
    >>> estimate_trials(path, sensors, sigma, {"A.range": 300}, seed=1, trials=50).summary()
    '50 estimates: 50 determined, 0 not converged, 0 unobservable'
    """
    known = setup(sensors, sigma, extras)
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials = whole(trials, "trials", 1)
    options.choice(method, "method", ("ls", "gls", "ml"))
    if method == "ls" and prior is not None:
        raise InputError('method "ls" is not weighted: a prior needs "gls" or "ml"')
    count = _iterations(iterations, method)
    deviations = _prior(known, prior)
    found = _core.registration_estimate_trials(
        positions, known.places, known.sigma, known.biases(biases), known.flags, deviations,
        method, (count, tolerance, NOISE_SHARE, BEND), seed, first, trials,
    )  # fmt: skip
    looks = as_float_array(positions, "positions").shape[0]
    return _unpacked(known, found, looks, method, deviations, "report")


def _iterations(given: int | None, method: str) -> int:
    if given is None:
        return 100 if method == "ml" else 1
    return whole(given, "iterations", 1, 100_000)


def _prior(known: Setup, prior: ArrayLike | Mapping[str, float] | None) -> Array | None:
    if prior is None:
        return None
    deviations = np.full(known.n, np.inf)
    if isinstance(prior, Mapping):
        for name, value in options.mapping(prior, "prior").items():
            deviations[known.index(name)] = as_float_array(value, f"prior of {name}")
    else:
        deviations = known.biases(prior, "prior").copy()
    for name, value in zip(known.names, deviations, strict=True):
        if not value > 0:
            raise InputError(f"prior of {name} = {value}: must be > 0, or inf for none")
    return deviations


def _unpacked(
    known: Setup,
    found: _core._Registered,
    looks: int,
    method: Method,
    prior: Array | None,
    on_failure: Literal["raise", "report"],
) -> Estimate:
    n, d = known.n, known.d
    biases, covariance, directions = found["biases"], found["covariance"], found["directions"]
    # Numbers where there is one estimate.
    code, nullity, iterations = (
        found["status"][()],
        found["nullity"][()],
        found["iterations"][()],
    )
    lead = biases.shape[:-1]
    status = np.array(STATUSES)[code.astype(int)]
    std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0))
    # The directions are orthonormal on the scale of what each bias alone would be known to.
    scale = np.linalg.norm(directions, axis=-2)
    scale = np.where(scale > 0, scale, 1.0)
    touched = np.abs(directions) / scale[..., None, :] > 0.05
    free = (touched & (np.arange(n)[:, None] < nullity[..., None, None])).any(axis=-2)
    std = np.where(free & (code == 2)[..., None], np.inf, std)
    held: tuple[str, ...] = ()
    if (nullity > 0).any():
        first = np.unravel_index(int(np.argmax(nullity > 0)), nullity.shape) if lead else ()
        m = int(nullity[first])
        texts, where = _named(known, directions[first][:m], scale[first])
        if prior is not None and not lead:
            held = texts
        if on_failure == "raise" and (code == 2).any():
            place = f"at batch index {list(map(int, first))}: " if lead else ""
            advice = "take other targets or give a prior"
            if prior is not None:
                advice = "take other targets or a prior of these biases too"
            raise UnobservableError(
                f"{place}these reports do not determine {'; '.join(texts)}{where}: {advice}", texts
            )
    if on_failure == "raise" and (code == 1).any():
        raise ConvergenceError(
            f"{int((code == 1).sum())} of {code.size} estimates did not settle in "
            f"{int(iterations.max())} linearisations: the geometry is weak or the reports are "
            "far from the model"
        )
    dof = looks * (len(known.labels) - 1) * d - n
    if prior is not None:
        dof += int(np.isfinite(prior).sum())
    given = {} if prior is None else dict(zip(known.names, prior.tolist(), strict=True))
    return Estimate(
        names=known.names,
        units=known.units,
        biases=biases,
        std=std,
        covariance=covariance,
        status=status,
        held_by_prior=held,
        iterations=iterations.astype(int),
        chi_square=found["chi_square"][()],
        dof=dof,
        noise_share=found["noise_share"][()],
        bend=found["bend"][()],
        positions=found["positions"],
        method=method,
        prior={name: value for name, value in given.items() if np.isfinite(value)},
    )


def _named(known: Setup, directions: Array, scale: Array) -> tuple[tuple[str, ...], str]:
    """Name the combinations that span these directions, and for two sensors the track."""
    basis = np.linalg.qr((directions / scale).T)[0]
    if known.is_pair and len(directions) == 1:
        for track in singular_tracks(dict(zip(known.labels, known.places, strict=True))):
            for side, vector in track.null_vectors.items():
                scaled = vector / scale
                inside = np.linalg.norm(basis.T @ scaled) / np.linalg.norm(scaled)
                if inside > 0.98:
                    return (track.combinations[side],), f" (as for targets {track.where})"
    freedoms = {
        name: vector
        for name, vector in gauges(
            dict(zip(known.labels, known.places, strict=True)), known.extras
        ).items()
        if np.linalg.norm(basis.T @ (vector / scale)) > 0.98 * np.linalg.norm(vector / scale)
    }
    scaled = np.array([vector / scale / np.linalg.norm(vector / scale)
                       for vector in freedoms.values()])  # fmt: skip
    if freedoms and np.linalg.matrix_rank(scaled, rtol=1e-6) == len(directions):
        return tuple(
            f"{name} ({describe_direction(vector, known.names)})"
            for name, vector in freedoms.items()
        ), ""
    # Reduced so that each has a leading bias that the others do not contain.
    rows = basis.T.copy()
    for k in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[k])))
        rows[k] /= rows[k, pivot]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot] * rows[k]
    texts = []
    for row in rows:
        lead = int(np.argmax(np.abs(row) > 0.5 * np.abs(row).max()))
        kept = np.where(np.abs(row) > 0.05 * np.abs(row).max(), row, 0.0) * scale
        kept /= kept[lead]
        texts.append(describe_direction(np.array([float(f"{x:.2g}") for x in kept]), known.names))
    return tuple(texts), ""
