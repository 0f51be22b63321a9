"""Bounds that know of other solutions, and the noise at which the local bound fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, whole
from gramian._handle import EstimationModel, as_model, handle_of
from gramian._noise import as_pair
from gramian.exceptions import InputError, UnobservableError

__all__ = ["Threshold", "WeissWeinstein", "barankin", "threshold", "weiss_weinstein"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class WeissWeinstein(Answer):
    """The answer of `weiss_weinstein`.

    Attributes
    ----------
    bound : ndarray, shape (n, n)
        On the mean square errors.
    standard_error : ndarray, shape (n,)
        Of its diagonal, from parts of the samples.
    used : tuple of int
        Which test vectors count.
    """

    bound: Array
    standard_error: Array
    used: tuple[int, ...]

    @property
    def std(self) -> Array:
        """Bound on the root mean square error of each state (n,)."""
        std: Array = np.sqrt(np.diagonal(self.bound))
        return std

    def _as_table(self) -> Columns:
        values = {"std": self.std, "standard_error": self.standard_error}
        names = [f"x{i}" for i in range(len(self.bound))]
        return Columns("state", names, values, {}, None, {"bound": self.bound})


@dataclass(frozen=True, eq=False, repr=False)
class Threshold(Answer):
    """The answer of `threshold`.

    Attributes
    ----------
    noise : ndarray, shape (k,)
        Factors on the noise of the model, ascending.
    local, bound : ndarray, shape (k, n)
        Bayesian Cramer-Rao and Weiss-Weinstein bounds on the variances.
    factor : ndarray, shape (n,)
        The noise at which the second passes twice the first, for each state; `inf` where
        it does not up to the largest noise.
    """

    noise: Array
    local: Array
    bound: Array
    factor: Array

    def _as_table(self) -> Columns:
        values: dict[str, Array] = {}
        for i in range(self.local.shape[1]):
            values |= {f"local_x{i}": self.local[:, i], f"bound_x{i}": self.bound[:, i]}
        return Columns("noise", self.noise, values, {})


def barankin(model: EstimationModel, x: ArrayLike, points: ArrayLike) -> Array:
    """Return the bound of Barankin on the covariance of unbiased estimators at a state.

    Parameters
    ----------
    model : EstimationModel
    x : array_like, shape (n,)
        The true state.
    points : array_like, shape (k, n)
        Test points: other solutions, and places along the weakest direction. With none
        this is the Cramer-Rao bound.

    Returns
    -------
    ndarray, shape (n, n)

    Raises
    ------
    InputError
        Shapes that do not fit.
    UnobservableError
        Where the rows at x do not determine the states.

    Notes
    -----
    McAulay & Hofstetter 1971. A test point that noise never prefers adds nothing.
    """
    model = as_model(model)
    state, others = finite(x, "x"), finite(points, "points")
    n = len(model.names)
    if state.shape != (n,):
        raise InputError(f"x has shape {state.shape}: must be ({n},)")
    if others.size == 0:
        others = others.reshape(0, n)
    if others.ndim != 2 or others.shape[1] != n:
        raise InputError(f"points has shape {others.shape}: must be (k, {n})")
    exact = model.h(state)
    apart = [model.residuals(state, model.h(point)) for point in others]
    differences = np.array(apart).reshape(len(others), exact.size)
    bound = _core.barankin(model.rows(state), others - state, differences)
    if bound is None:
        raise UnobservableError("no bound exists: the rows at x do not determine the states")
    return bound


def weiss_weinstein(
    model: EstimationModel,
    prior: Mapping[str, tuple[float, float]],
    vectors: ArrayLike,
    *,
    samples: int = 256,
) -> WeissWeinstein:
    """Return the bound of Weiss and Weinstein on the mean square error of any estimator.

    Parameters
    ----------
    model : EstimationModel
    prior : mapping of str to (mean, sigma)
        Of every state.
    vectors : array_like, shape (k, n)
        Test vectors: small ones give the Bayesian Cramer-Rao bound, ones that reach from
        a state to another that fits as well give the threshold.
    samples : int
        Points of the prior for the integrals.

    Raises
    ------
    InputError
        A state without a prior, shapes that do not fit, no value at a point of the prior.

    Notes
    -----
    Weiss & Weinstein 1988 with s = 1/2. Vectors whose integral is below 1e-8 are left out.
    """
    model = as_model(model)
    mean, sigma = _normal(model, prior)
    steps = finite(vectors, "vectors")
    if steps.ndim != 2 or steps.shape[1] != mean.size:
        raise InputError(f"vectors has shape {steps.shape}: must be (k, {mean.size})")
    handle = handle_of(model, model.h(mean))
    count = whole(samples, "samples", 1, 2**31)
    bound, error, used = handle.weiss_weinstein(mean, sigma, steps, count)
    return WeissWeinstein(bound, error, tuple(used))


def threshold(
    model: EstimationModel,
    prior: Mapping[str, tuple[float, float]],
    vectors: ArrayLike,
    noise: ArrayLike,
    *,
    samples: int = 256,
) -> Threshold:
    """Return the noise at which the local bound stops being true.

    Parameters
    ----------
    model, prior, vectors, samples
        As for `weiss_weinstein`; a hundredth of the local deviation of each state is
        added to the test vectors.
    noise : array_like, shape (k,)
        Factors on the noise of the model to look at, ascending, > 0.

    Returns
    -------
    Threshold
    """
    model = as_model(model)
    factors = finite(noise, "noise")
    if factors.ndim != 1 or factors.size < 2 or not (np.diff(factors) > 0).all() or factors[0] <= 0:
        raise InputError(f"noise = {factors}: must be two factors or more, ascending and > 0")
    mean, sigma = _normal(model, prior)
    given = finite(vectors, "vectors")
    if given.ndim != 2 or given.shape[1] != mean.size:
        raise InputError(f"vectors has shape {given.shape}: must be (k, {mean.size})")
    draws = _core.normals(0, 0, whole(samples, "samples", 1, 2**31), mean.size)
    rows = np.array([model.rows(mean + sigma * draw) for draw in draws])
    information = np.einsum("sij,sik->jk", rows, rows) / len(rows)
    local, bound = [], []
    for factor in factors:
        covariance = np.linalg.inv(information / factor**2 + np.diag(sigma**-2))
        local.append(np.diagonal(covariance))
        small = 0.01 * np.diag(np.sqrt(local[-1]))
        steps = np.concatenate([small, given])
        found = weiss_weinstein(_Louder(model, float(factor)), prior, steps, samples=samples)
        bound.append(np.diagonal(found.bound))
    low, high = np.array(local), np.array(bound)
    passed = np.full(mean.size, np.inf)
    for k in range(mean.size):
        ratio = np.log(high[:, k] / low[:, k] / 2)
        above = np.flatnonzero(ratio > 0)
        if above.size:
            i = above[0]
            share = 0.0 if i == 0 else ratio[i - 1] / (ratio[i - 1] - ratio[i])
            start = factors[max(i - 1, 0)]
            passed[k] = start * (factors[i] / start) ** share
    return Threshold(factors, low, high, passed)


class _Louder:
    """A model with its noise multiplied."""

    def __init__(self, model: EstimationModel, factor: float) -> None:
        self._model, self._factor = model, factor
        self.names, self.units = model.names, model.units

    def h(self, x: Array) -> Array:
        return self._model.h(x)

    def residuals(self, x: Array, z: Array) -> Array:
        return self._model.residuals(x, z) / self._factor

    def rows(self, x: Array) -> Array:
        return self._model.rows(x) / self._factor


def _normal(
    model: EstimationModel, prior: Mapping[str, tuple[float, float]]
) -> tuple[Array, Array]:
    given = options.mapping(prior, "prior", "name to (mean, sigma)")
    missing = [name for name in model.names if name not in given]
    if missing:
        raise InputError(f"prior lacks {', '.join(missing)}: every state must have one")
    if more := [name for name in given if name not in model.names]:
        raise InputError(f"prior of {more[0]!r}: the states are {', '.join(model.names)}")
    pairs = [
        as_pair(given[name], f"prior of {name}", unit)
        for name, unit in zip(model.names, model.units, strict=True)
    ]
    return np.array([mean for mean, _ in pairs]), np.array([sigma for _, sigma in pairs])
