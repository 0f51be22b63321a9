"""Noise and prior knowledge in every form they come in: the one place that reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import as_float_array
from gramian._text import brief
from gramian._units import bare
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = ["Noise", "as_noise", "prior_sigma"]

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
        noise: Array = normals @ self.spread.T
        return noise

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
    given = np.asarray(sigma)
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
    if (bad := np.flatnonzero(~(each >= 0))).size:
        place = f"[{bad[0]}]" if noise.ndim else ""
        raise InputError(f"sigma{place} = {each[bad[0]]}: must be > 0 (0: exact, inf: missing)")
    if noise.ndim == 0 and not 0 < noise < np.inf:
        raise InputError(f"sigma = {noise}: must be > 0 and finite")
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


def prior_sigma(value: object, name: str) -> float:
    """Return the deviation of a prior given as sigma or (mean, sigma): 0 exact, inf none."""
    pair = as_float_array(value, f"prior of {name}")  # type: ignore[arg-type]
    if pair.shape not in {(), (2,)}:
        raise InputError(f"prior of {name} = {value}: must be a sigma, or (mean, sigma)")
    sigma = float(pair if pair.ndim == 0 else pair[1])
    if not sigma >= 0:
        raise InputError(f"prior of {name} = {sigma}: must be >= 0 (0: exact, inf: none)")
    return sigma


def prior_rows(prior: Mapping[str, object] | ArrayLike, n: int) -> tuple[Array, Array]:
    """Return what a prior of unnamed states adds: whitened rows and exact rows (q, n).

    Parameters
    ----------
    prior : array_like, shape (n,) or (n, n)
        Deviations (0: exact, `inf`: none), or a covariance.
    n : int
    """
    if isinstance(prior, Mapping):
        raise InputError("prior of plain rows: must be one deviation for each state, as an array")
    sigma = as_float_array(prior, "prior")
    if sigma.shape not in {(n,), (n, n)}:
        raise InputError(f"prior has shape {sigma.shape}: must be ({n},) or ({n}, {n})")
    if sigma.ndim == 1 and (bad := np.flatnonzero(~(sigma >= 0))).size:
        raise InputError(f"prior[{bad[0]}] = {sigma[bad[0]]}: must be >= 0, or inf for none")
    try:
        noise = as_noise(sigma, n)
    except InputError as error:
        raise InputError(str(error).replace("sigma", "prior", 1)) from error
    return noise.whiten(np.eye(n)), noise.exact
