"""Which measurement depends on which state, and rows that are sparse by it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError
from gramian.problem import Array, is_sparse

__all__ = ["SPARSE_STATES", "as_columns", "by_nan", "sparse_rows"]

#: From so many states on, and up to such a share of entries, rows are sparse.
SPARSE_STATES = 100
SPARSE_SHARE = 0.1


def as_columns(sparsity: Any, count: int, n: int) -> list[list[int]]:
    """Return for each of n states which of the measurements it may move."""
    pattern: Any = sparsity if is_sparse(sparsity) else np.asarray(sparsity)
    if pattern.shape != (count, n):
        raise InputError(f"sparsity has shape {pattern.shape}: must be ({count}, {n})")
    if is_sparse(pattern):
        columns = pattern.tocsc(copy=True)
        columns.eliminate_zeros()
        columns.sum_duplicates()
        listed = [part.tolist() for part in np.split(columns.indices, columns.indptr[1:-1])]
    else:
        listed = [np.flatnonzero(column).tolist() for column in pattern.T]
    return listed


def by_nan(batch: Callable[[Array], Array], state: Array, count: int) -> NDArray[np.bool_]:
    """Return which outputs (count, n) each state may move: those that NaN in its place reaches."""
    n = state.size
    generator = np.random.default_rng(0)
    possible = np.ones((count, n), dtype=bool)
    share, settled = 0.5, 0
    # Groups of states at once: an output that stays finite depends on none of them.
    for _ in range(12 * int(np.ceil(np.log2(n + 1))) + 40):
        group = generator.random(n) < share
        points = np.where(group, np.nan, state)[None, :]
        untouched = np.isfinite(batch(points)[0])
        before = possible.sum()
        possible[np.ix_(untouched, group)] = False
        # Most is learned where about a third of the outputs stay finite.
        share = min(0.5, share * (1.5 if untouched.mean() > 0.37 else 0.7))
        settled = settled + 1 if possible.sum() == before else 0
        if settled >= 20:
            break
    return possible


def sparse_rows(
    values: Array,
    error: Array | None,
    columns: Sequence[Sequence[int]],
    root: Array,
    names: Sequence[str],
    rtol: float | None,
) -> tuple[Any, float | None] | None:
    """Return sparse rows and their relative accuracy; None where they have no use or place.

    `root` is what whitens independent measurements: one over their deviations, 0 where missing.
    """
    n = values.shape[1]
    if sum(map(len, columns)) > SPARSE_SHARE * values.size:
        return None
    from scipy.sparse import csr_array

    j = np.repeat(np.arange(n), [len(column) for column in columns])
    i = np.concatenate([np.asarray(column, dtype=int) for column in columns])
    if (missed := np.count_nonzero(values)) > np.count_nonzero(values[i, j]):
        outside = values != 0
        outside[i, j] = False
        row, column = np.argwhere(outside)[0]
        raise InputError(
            f"sparsity leaves out {missed - np.count_nonzero(values[i, j])} entries of the "
            f"Jacobian: h(x)[{row}] depends on {names[column]}"
        )
    kept = np.flatnonzero(root > 0)
    whitened = csr_array((values[i, j] * root[i], (i, j)), shape=values.shape)[kept]
    if error is not None and rtol is None:
        # As `Problem.doubt`: ranks are decided above the errors of the columns.
        lengths = np.sqrt(np.asarray(whitened.multiply(whitened).sum(axis=0)).ravel())
        errors = csr_array((error[i, j] * root[i], (i, j)), shape=values.shape)
        off = np.sqrt(np.asarray(errors.multiply(errors).sum(axis=0)).ravel())
        if ((off > 0) & ~(off < lengths / 3)).any():
            return None
        relative = float(np.linalg.norm(off / np.where(lengths > 0, lengths, 1.0)))
        default = 32 * np.finfo(float).eps * np.sqrt(max(whitened.shape))
        rtol = min(relative, 0.5) if relative > default else None
    return whitened, rtol
