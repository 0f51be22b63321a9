"""Noise and prior knowledge in every form they come in: the one place that reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._arrays import as_float_array, finite, number
from gramian._text import brief
from gramian._units import bare, labelled
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = [
    "Knowledge",
    "Noise",
    "as_box",
    "as_knowledge",
    "as_known",
    "as_mean_and_sigma",
    "as_noise",
    "as_pair",
    "negligible",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Noise(Value):
    """How to whiten measurements, and which combinations of them are exact.

    Attributes
    ----------
    root : ndarray, shape (m,) or (r, m)
        What whitens: one factor for each measurement (0 for a missing one), or a matrix.
    exact : ndarray, shape (q, m)
        Combinations of the measurements without noise.
    spread : ndarray, shape (m,) or (m, r)
        What makes noise of independent standard normal numbers.
    sigma : ndarray, shape (m,)
        Standard deviation of each measurement.
    """

    root: Array
    exact: Array
    spread: Array
    sigma: Array

    def whiten(self, values: Array) -> Array:
        """Return values (m, ...) in units of their noise."""
        if self.root.ndim == 1:
            kept = self.root > 0
            shape = (-1,) + (1,) * (values.ndim - 1)
            scaled: Array = values[kept] * self.root[kept].reshape(shape)
            return scaled
        whitened: Array = self.root @ values
        return whitened

    def errors(self, error: Array) -> Array:
        """Return the errors (m, ...) of values whitened, at most."""
        if self.root.ndim == 1:
            return self.whiten(error)
        whitened: Array = np.sqrt((self.root**2) @ error**2)
        return whitened

    def sample(self, normals: Array) -> Array:
        """Return noise (..., m) of standard normal numbers (..., draws)."""
        if self.spread.ndim == 1:
            return normals * self.spread
        # A product for each sample: one of all together would round differently for
        # another number of them.
        noise: Array = np.matmul(normals[..., None, :], self.spread.T)[..., 0, :]
        return noise

    def keep(self, kept: NDArray[np.bool_]) -> Noise:
        """Return the noise of some of the measurements, a mask (m,)."""
        if kept.all():
            return self
        if self.root.ndim == 1:
            exact = np.eye(len(kept))[self.sigma == 0][:, kept]
            return Noise(
                self.root[kept], exact[exact.any(axis=1)], self.spread[kept], self.sigma[kept]
            )
        spread = self.spread[kept]
        return _covariance(spread @ spread.T)

    @property
    def draws(self) -> int:
        """How many independent numbers one sample of the noise takes."""
        return int(self.spread.shape[-1])


def as_noise(sigma: ArrayLike, count: int, *, is_complex: bool = False) -> Noise:
    """Return the noise of `count` measurements.

    Parameters
    ----------
    sigma : array_like, shape (), (m,), (m, m) or (b, k, k)
        One standard deviation, one for each measurement (0: exact, `inf`: missing), a
        covariance, which may be singular, or its blocks along the diagonal. For complex
        measurements a Hermitian covariance or deviations: of circular noise, half its
        variance in each part.
    count : int
        Number of real measurements: of complex ones the real parts, then the imaginary.
    is_complex : bool
    """
    sigma = bare(sigma, "sigma")
    try:
        given = np.asarray(sigma)
    except ValueError as error:  # lists of different length
        raise InputError(f"sigma: {error}") from None
    whole = count // 2 if is_complex else count
    if np.iscomplexobj(given) and given.ndim >= 2:
        if not is_complex:
            raise InputError("sigma is complex, but h(x) is real: must be a real covariance")
        covariance = _square(given, whole)
        real, imag = covariance.real, covariance.imag
        return _covariance(0.5 * np.block([[real, -imag], [imag, real]]))
    noise = as_float_array(sigma, "sigma")
    if noise.ndim >= 2:
        covariance = _square(noise, whole)
        if is_complex:
            nothing = np.zeros_like(covariance)
            covariance = 0.5 * np.block([[covariance, nothing], [nothing, covariance]])
        return _covariance(covariance)
    if noise.ndim == 1 and noise.shape != (whole,):
        raise InputError(f"sigma has {noise.shape[0]} entries: must have 1 or {whole}")
    each = np.broadcast_to(noise, (whole,))
    if noise.ndim == 0 and not 0 <= noise < np.inf:
        raise InputError(f"sigma = {noise}: must be > 0 (0: exact) and finite")
    if (bad := np.flatnonzero(~(each >= 0))).size:
        raise InputError(f"sigma[{bad[0]}] = {each[bad[0]]}: must be > 0 (0: exact, inf: missing)")
    if is_complex:
        each = np.tile(each, 2) / np.sqrt(2)
    with np.errstate(divide="ignore"):
        root = np.where(each == 0, 0.0, 1 / each)
    exact = np.eye(count)[each == 0]
    return Noise(root, exact, np.where(np.isinf(each), np.nan, each), np.array(each))


def _square(noise: NDArray[np.generic], count: int) -> Array:
    """Return the covariance (m, m) of what may be blocks of it."""
    if noise.ndim == 3:
        blocks, k = noise.shape[0], noise.shape[1]
        if noise.shape[2] != k or blocks * k != count:
            raise InputError(
                f"sigma has shape {noise.shape}: blocks must be (b, k, k) with b k = {count}"
            )
        whole = np.zeros((count, count), dtype=noise.dtype)
        for b in range(blocks):
            whole[b * k : (b + 1) * k, b * k : (b + 1) * k] = noise[b]
        noise = whole
    if noise.shape != (count, count):
        raise InputError(f"sigma has shape {noise.shape}: a covariance must be ({count}, {count})")
    if len(bad := np.argwhere(~np.isfinite(noise))):
        i, j = bad[0]
        raise InputError(f"sigma[{i}, {j}] = {noise[i, j]}: must be finite")
    if not np.allclose(noise, noise.conj().T, rtol=1e-10, atol=0):
        word = "Hermitian" if np.iscomplexobj(noise) else "symmetric"
        raise InputError(f"sigma is not {word}: a covariance must be")
    result: Array = noise  # type: ignore[assignment]
    return result


def _covariance(covariance: Array) -> Noise:
    variances = np.diag(covariance)
    if (bad := np.flatnonzero(variances < 0)).size:
        i = bad[0]
        raise InputError(f"sigma[{i}, {i}] = {variances[i]}: a variance must be >= 0")
    sizes = np.sqrt(variances)
    scale = np.where(sizes > 0, sizes, 1.0)
    correlation = covariance / scale[:, None] / scale
    values, vectors = np.linalg.eigh(correlation)
    slack = 64 * np.finfo(float).eps * len(values)
    if values[0] < -slack * max(1.0, values[-1]):
        raise InputError(
            f"sigma is not positive semidefinite: as correlations it has the eigenvalue "
            f"{brief(values[0])}; a covariance must be"
        )
    kept = values > slack * max(values[-1], 0.0)
    root = (vectors[:, kept] / np.sqrt(values[kept])).T / scale
    exact = vectors[:, ~kept].T / scale
    spread = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return Noise(root, exact, spread, sizes)


@dataclass(frozen=True, eq=False)
class Knowledge(Value):
    """What is known of the states beforehand: combinations of them, each independent.

    Attributes
    ----------
    names : tuple of str or None, length q
        The state or named combination that each is; None for one of a covariance.
    rows : ndarray, shape (q, n)
        Coefficients.
    mean : ndarray, shape (q,)
        NaN where none was given.
    sigma : ndarray, shape (q,)
        Standard deviations; 0 for what is known exactly.
    state_mean, state_sigma : ndarray, shape (n,)
        Of each state by itself, combinations left out; `inf` where nothing is known.
    """

    names: tuple[str | None, ...]
    rows: Array
    mean: Array
    sigma: Array
    state_mean: Array
    state_sigma: Array

    @property
    def whitened(self) -> Array:
        """Rows (..., n) of what is known, but not exactly."""
        some = self.sigma > 0
        rows: Array = self.rows[some] / self.sigma[some, None]
        return rows

    @property
    def exact(self) -> Array:
        """Combinations (..., n) that are known exactly."""
        rows: Array = self.rows[self.sigma == 0]
        return rows


def as_knowledge(
    prior: object,
    names: Sequence[str],
    combinations: Mapping[str, Array] | None = None,
    *,
    units: Sequence[str] = (),
    label: str = "prior",
) -> Knowledge:
    """Return prior knowledge of any form.

    Parameters
    ----------
    prior : None, mapping of str to float or (mean, sigma), array_like or (mean, covariance)
        By name: a standard deviation, or a mean and one. For all states: deviations (n,),
        a covariance (n, n), or a tuple of means (n,) and a covariance (n, n). A deviation
        of 0 is exact knowledge, `inf`, also on the diagonal of a covariance, is none; a
        covariance may be singular.
    names : sequence of str, length n
    combinations : mapping of str to ndarray, shape (n,), optional
        What else has a name.
    units : sequence of str, length n, optional
        Of the states: quantities of pint and astropy by name are converted to them.
    label : str
        What the argument is called.

    Raises
    ------
    InputError
        A form, shape, name or number that does not fit.
    """
    n = len(names)
    if prior is None:
        prior = {}
    if isinstance(prior, Mapping):
        return _named(prior, names, combinations or {}, units, label)
    mean = np.full(n, np.nan)
    if isinstance(prior, tuple) and len(prior) == 2 and np.ndim(prior[1]) == 2:
        mean, prior = finite(prior[0], f"{label} mean"), prior[1]
        if mean.shape != (n,):
            raise InputError(f"{label} mean has shape {mean.shape}: must be ({n},)")
    sigma = as_float_array(prior, label)  # type: ignore[arg-type]
    if sigma.shape not in {(n,), (n, n)}:
        raise InputError(f"{label} has shape {sigma.shape}: must be ({n},) or ({n}, {n})")
    if sigma.ndim == 1:
        if (bad := np.flatnonzero(~(sigma >= 0))).size:
            raise InputError(
                f"{label}[{bad[0]}] = {sigma[bad[0]]}: must be >= 0 (0: exact, inf: none)"
            )
        known = np.flatnonzero(np.isfinite(sigma)).tolist()
        some = tuple(names[i] for i in known)
        return Knowledge(some, np.eye(n)[known], mean[known], sigma[known], mean, sigma)
    # Of a state with an infinite variance nothing is known, whatever it goes with.
    kept = np.flatnonzero(~np.isposinf(np.diagonal(sigma)))
    each = np.full(n, np.inf)
    if not kept.size:
        return Knowledge((), np.zeros((0, n)), np.zeros(0), np.zeros(0), mean, each)
    try:
        noise = as_noise(sigma[np.ix_(kept, kept)], kept.size)
    except InputError as error:
        raise InputError(str(error).replace("sigma", label, 1)) from error
    rows = np.vstack([noise.whiten(np.eye(n)[kept]), noise.exact @ np.eye(n)[kept]])
    each[kept] = noise.sigma
    deviations = np.repeat([1.0, 0.0], [len(rows) - len(noise.exact), len(noise.exact)])
    return Knowledge((None,) * len(rows), rows, rows @ mean, deviations, mean, each)


def _named(
    prior: Mapping[str, object],
    names: Sequence[str],
    combinations: Mapping[str, Array],
    units: Sequence[str],
    label: str,
) -> Knowledge:
    given, means, sigmas, rows = [], [], [], []
    state_mean, state_sigma = np.full(len(names), np.nan), np.full(len(names), np.inf)
    position = {name: i for i, name in enumerate(names)}
    for name, value in options.mapping(prior, label, "name to sigma or (mean, sigma)").items():
        if name in combinations:
            row = combinations[name]
        elif name in position:
            row = np.zeros(len(names))
            row[position[name]] = 1.0
        else:
            what = "state or combination" if combinations else "state"
            raise InputError(
                f"{label} of {name!r}: no {what} has that name; there are "
                f"{', '.join((*names, *combinations))}"
            )
        unit = units[position[name]] if units and name in position else ""
        mean, sigma = as_mean_and_sigma(value, f"{label} of {name}", unit)
        if sigma < np.inf:
            given.append(name)
            rows.append(row)
            means.append(mean)
            sigmas.append(sigma)
            if name in position:
                state_mean[position[name]], state_sigma[position[name]] = mean, sigma
    stacked = np.array(rows) if rows else np.zeros((0, len(names)))
    return Knowledge(
        tuple(given),
        stacked,
        np.array(means, float),
        np.array(sigmas, float),
        state_mean,
        state_sigma,
    )


def as_mean_and_sigma(value: object, label: str, unit: str = "") -> tuple[float, float]:
    """Return the mean, NaN where none is given, and deviation: 0 exact, inf none."""
    pair = as_float_array(value, labelled(label, unit))  # type: ignore[arg-type]
    if pair.shape not in {(), (2,)}:
        raise InputError(f"{label} = {options.given(value)}: must be a sigma, or (mean, sigma)")
    mean, sigma = (np.nan, float(pair)) if pair.ndim == 0 else (float(pair[0]), float(pair[1]))
    if not sigma >= 0:
        raise InputError(f"{label} = {sigma}: must be >= 0 (0: exact, inf: none)")
    if pair.ndim and not np.isfinite(mean):
        raise InputError(f"{label}: its mean is {mean}: must be finite")
    return mean, sigma


def as_pair(value: object, label: str, unit: str = "") -> tuple[float, float]:
    """Return the mean and deviation, both finite, of a state that a prior says something of."""
    pair = finite(value, labelled(label, unit))  # type: ignore[arg-type]
    if pair.shape != (2,):
        raise InputError(f"{label} = {options.given(value)}: must be (mean, sigma)")
    mean, sigma = float(pair[0]), float(pair[1])
    if not sigma > 0:
        raise InputError(f"{label} = ({mean}, {sigma}): must have sigma > 0")
    return mean, sigma


def as_known(
    known: Mapping[str, object] | None, names: Sequence[str], units: Sequence[str], label: str
) -> dict[str, float]:
    """Return what is known exactly by name, in the units of the states.

    Raises
    ------
    InputError
        A name that is none of the states', a value that is no finite number.
    """
    values = {}
    for name, value in options.mapping(known, label, "name to value").items():
        if name not in names:
            raise InputError(f"{label} of {name!r}: the states are {', '.join(names)}")
        unit = units[list(names).index(name)] if units else ""
        values[name] = number(value, labelled(f"{label} of {name}", unit))
    return values


def as_box(
    box: Mapping[str, object] | None, names: Sequence[str], units: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Return two finite ends by name, ascending, in the units of the states."""
    ends = {}
    for name, value in options.mapping(box, "box", "name to (low, high)").items():
        if name not in names:
            raise InputError(f"box of {name!r}: the states are {', '.join(names)}")
        unit = units[list(names).index(name)] if units else ""
        pair = as_float_array(value, labelled(f"box of {name}", unit))  # type: ignore[arg-type]
        if pair.shape != (2,) or not np.isfinite(pair).all() or not pair[0] < pair[1]:
            raise InputError(
                f"box of {name} = {options.given(value)}: must be two finite ends, ascending"
            )
        ends[name] = (float(pair[0]), float(pair[1]))
    return ends


def negligible(rows: Array, combinations: Array) -> Array:
    """Return deviations of combinations (q, n) far below what rows (K, n) tell of them.

    For a kernel that takes exact knowledge as a measurement: no digit of the result is
    lost, and the combination is off by less than a millionth of its bound.
    """
    lengths = np.linalg.norm(rows, axis=0)
    with np.errstate(divide="ignore"):
        relative = np.where(combinations != 0, lengths / np.abs(combinations), 0.0)
    most = relative.max(axis=1, initial=0.0)
    return 1e-6 / np.where(most > 0, most, 1.0)
