"""Cramer-Rao bounds of rows: what no unbiased estimator can do better than."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import as_float_array
from gramian._noise import as_knowledge
from gramian._text import describe_null_space
from gramian.analysis import analyze
from gramian.exceptions import InputError, UnobservableError
from gramian.problem import Problem, ProblemSource, as_problem, at_least_one_row, is_sparse

__all__ = ["crlb", "crlb_std", "gram"]

Array = NDArray[np.float64]


def gram(
    rows: ArrayLike, weights: ArrayLike | None = None, *, out: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Return the Gram matrix sum of w row^T row: with whitened rows, the Fisher information.

    Parameters
    ----------
    rows : array_like, shape (..., K, n)
        Whitened rows.
    weights : array_like, shape (..., K), optional
        Weights >= 0 of the rows; 1 by default.
    out : ndarray, shape of the result, optional
        Where the result is written: of its type, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., n, n)

    Raises
    ------
    InputError
        A wrong shape, an empty array, a number that is not finite, a negative weight.

    Notes
    -----
    Half the digits of the rows are lost in the sum, so take ranks, bounds and
    determinants from `gramian.analyze` or `crlb_std`, which work on the rows.

    Where all arrays are float32 (lists go along), the sums are float32 too, of four columns in
    twice as many lanes, and so is the result: an entry is off by up to about
    ``1e-7 (1 + K / 16)`` of the roots of its diagonal entries for four columns, ``1e-7 K`` for
    others. Sums of more than some thousands of rows are better taken in float64.

    Examples
    --------
    >>> gram([[1.0, 2.0], [0.0, 1.0]])
    array([[1., 2.],
           [2., 5.]])
    """
    return _core.gram(rows, weights, out)


def crlb_std(
    rows_or_problem: ArrayLike | Problem | ProblemSource,
    prior: Mapping[str, Any] | ArrayLike | None = None,
    *,
    out: Array | None = None,
) -> Array:
    """Return the smallest standard deviation of each state, `inf` where it is not observable.

    Parameters
    ----------
    rows_or_problem : array_like, shape (..., K, n), Problem or Model
        Whitened rows; also sparse ones.
    prior : mapping of str to float or (mean, sigma), or array_like, optional
        What is known beforehand: deviations by name (x0, x1, ... for plain rows), one
        for each state (n,), or their covariance (n, n). 0 is exact knowledge, `inf`
        none.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made. With plain rows, and
        no exact knowledge.

    Returns
    -------
    ndarray, shape (..., n)
        In the units of the states.

    Raises
    ------
    InputError
        A wrong shape, an empty array, a number that is not finite.

    Notes
    -----
    The rank is decided on columns scaled to unit length by orthogonal
    factorisation, so the answer does not depend on units. A state that an
    unobservable combination touches has the bound `inf`.

    Examples
    --------
    >>> crlb_std([[2.0, 0.0], [2.0, 0.0]])
    array([0.35355339, inf])
    """
    if isinstance(rows_or_problem, (Problem, ProblemSource)) or is_sparse(rows_or_problem):
        if out is not None:
            raise InputError("out goes with plain rows (..., K, n)")
        problem = as_problem(rows_or_problem, None)
        problem = problem if prior is None else problem.prior(prior)
        if is_sparse(problem.rows):
            return analyze(problem).crlb_std
        if problem.row_error is None and problem.row_sigma is None and not len(problem.constraints):
            known = at_least_one_row(problem.all_rows)
            return _core.crlb_std(known, problem.rtol)
        return problem.factor().crlb_std()
    rows: ArrayLike = rows_or_problem
    if prior is None and isinstance(rows, list):
        rows = as_float_array(rows, "rows")
    if prior is not None:
        rows = as_float_array(rows, "rows")
        if rows.ndim < 2:
            raise InputError(f"rows has shape {rows.shape}: must be (..., K, n)")
        before = as_knowledge(prior, [f"x{i}" for i in range(rows.shape[-1])])
        extra, exact = before.whitened, before.exact
        if len(exact):
            if out is not None:
                raise InputError("out goes without exact knowledge: a prior of 0")
            flat = rows.reshape(-1, *rows.shape[-2:])
            std = [
                _core.Analysis(at_least_one_row(np.vstack([one, extra])), None, exact).crlb_std()
                for one in flat
            ]
            return np.array(std).reshape(*rows.shape[:-2], rows.shape[-1])
        extra = np.broadcast_to(extra, (*rows.shape[:-2], *extra.shape))
        rows = np.concatenate([rows, extra], axis=-2)
    return _core.crlb_std(rows, None, out)


def crlb(
    rows_or_problem: ArrayLike | Problem | ProblemSource,
    prior: Mapping[str, Any] | ArrayLike | None = None,
) -> Array:
    """Return the Cramer-Rao bound on the covariance of all states.

    Parameters
    ----------
    rows_or_problem, prior
        As for `crlb_std`, without leading axes.

    Returns
    -------
    ndarray, shape (n, n)

    Raises
    ------
    UnobservableError
        When some combination is not observable, so that no covariance exists;
        it names the combinations.

    Examples
    --------
    >>> crlb([[2.0, 0.0], [0.0, 1.0]])
    array([[0.25, 0.  ],
           [0.  , 1.  ]])
    """
    problem = as_problem(rows_or_problem, None)
    if prior is not None:
        problem = problem.prior(prior)
    analysis = problem.factor()
    covariance = analysis.crlb()
    if covariance is None:
        combinations = describe_null_space(analysis.null_space(), problem.names)
        raise UnobservableError(
            f"no bound exists: rank {analysis.rank} of {problem.n}; "
            f"not observable: {'; '.join(combinations)}",
            combinations,
        )
    return covariance
