"""Levels: at which derivative of the output a combination of states becomes known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import finite, whole
from gramian._registry import draw
from gramian._text import describe_combination
from gramian.exceptions import InputError
from gramian.models.linear._systems import SystemLike, matrices, system_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BatchLevels", "Levels", "batch_levels", "levels", "observability_matrix"]

Array = NDArray[np.float64]


def observability_matrix(
    A: SystemLike, C: ArrayLike | None = None, order: int | None = None
) -> Array:
    """Return [C; CA; ..; CA^order].

    Parameters
    ----------
    A : array_like, shape (..., n, n), or state-space object
        Taken from the attributes ``A`` and ``C`` of an object, as those of
        `scipy.signal.StateSpace` and `control.StateSpace`.
    C : array_like, shape (..., p, n)
    order : int, optional
        The highest power of A, >= 0; n - 1 by default.

    Returns
    -------
    ndarray, shape (..., (order + 1) p, n)

    Raises
    ------
    InputError
        An A that is not square, a C of another width, powers that overflow.

    Notes
    -----
    Do not decide observability from the numerical rank of this matrix: with a
    slow unit of time its powers span more decades than double precision has.
    `levels` decides without forming it.

    Examples
    --------
    >>> observability_matrix([[1, 2], [3, 4]], [[5, 7]])
    array([[ 5.,  7.],
           [26., 38.]])
    """
    if order is not None:
        order = whole(order, "order")
    a, c = matrices(A, C)
    return _core.observability_matrix(a, c, order)


@dataclass(frozen=True, eq=False)
class BatchLevels:
    """Levels of many systems.

    Attributes
    ----------
    ranks : ndarray of int, shape (..., n)
        Rank of O_k for k = 0, 1, .., n - 1.
    levels : ndarray, shape (..., n)
        The level of each state; `inf` where no derivative determines it.
    rank : ndarray of int, shape (...)
        Rank of the whole observability matrix.
    """

    ranks: NDArray[np.int64]
    levels: Array

    @property
    def rank(self) -> NDArray[np.int64]:
        """Rank of the whole observability matrix of each system."""
        last: NDArray[np.int64] = self.ranks[..., -1]
        return last


@dataclass(frozen=True, eq=False)
class Levels:
    """What each derivative of the output adds.

    Attributes
    ----------
    names : tuple of str, length n
    ranks : tuple of int, length n
        Rank of O_k for k = 0, 1, .., n - 1.
    rank, nullity : int
        Of the whole observability matrix.
    states : mapping of str to (int or None)
        The level of each state: the derivative from which on it is known. None
        for never.
    combinations : mapping of str to (int or None)
        The same of the named combinations.
    new : tuple of ndarray, shape (n, m)
        For each level up to the last that adds something, the combinations that
        become known there, one a column, in physical units; a combination of one
        level is determined up to those of lower ones.
    null_space : ndarray, shape (n, nullity)
        What no derivative sees, in physical units, each with a leading
        coefficient of 1.
    margins : (float, float)
        The weakest coupling that counted and the strongest that was taken for
        rounding, relative to the norms of the balanced A and C: far apart where
        the ranks are clear. The tolerance is between them.
    rtol : float
    """

    names: tuple[str, ...]
    ranks: tuple[int, ...]
    states: Mapping[str, int | None]
    combinations: Mapping[str, int | None]
    new: tuple[Array, ...]
    null_space: Array
    margins: tuple[float, float]
    rtol: float
    _analysis: _core.LinearAnalysis = field(repr=False)

    @property
    def rank(self) -> int:
        """Rank of the whole observability matrix."""
        return self.ranks[-1]

    @property
    def nullity(self) -> int:
        """Number of combinations that no derivative sees."""
        return len(self.names) - self.rank

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """The null space in words: "1 phi_U + 6.4e-05 eps_W"."""
        return tuple(describe_combination(column, self.names) for column in self.null_space.T)

    @property
    def new_combinations(self) -> tuple[tuple[str, ...], ...]:
        """For each level, what becomes known, in words."""
        return tuple(
            tuple(describe_combination(column, self.names) for column in level.T)
            for level in self.new
        )

    def level_of(
        self, combination: ArrayLike | Mapping[str, float], tolerance: float | None = None
    ) -> int | None:
        """Return the level of a combination of the states, None for never.

        Parameters
        ----------
        combination : array_like, shape (n,), or mapping of str to float
            Its coefficients, in physical units.
        tolerance : float, optional
            The part of the combination, in balanced states, that may be left
            open; by default what rounding explains.
        """
        if tolerance is not None and not 0 < tolerance < 1:
            raise InputError(f"tolerance = {tolerance}: must be between 0 and 1")
        return self._analysis.level_of(coefficients(combination, self.names), tolerance)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists, numbers and strings, fit for JSON."""
        return {
            "names": list(self.names),
            "ranks": list(self.ranks),
            "rank": self.rank,
            "nullity": self.nullity,
            "states": dict(self.states),
            "combinations": dict(self.combinations),
            "new": [list(level) for level in self.new_combinations],
            "null_space": self.null_space.tolist(),
            "null_combinations": list(self.null_combinations),
            "margins": list(self.margins),
            "rtol": self.rtol,
        }

    def summary(self) -> str:
        """Return what becomes known at each derivative, as text."""
        n = len(self.names)
        head = "OBSERVABLE" if self.nullity == 0 else "UNOBSERVABLE"
        lines = [f"{head}: rank {self.rank} of {n}"]
        for k, level in enumerate(self.new_combinations):
            source = "the output itself" if k == 0 else f"derivative {k}"
            lines.append(f"  {source} gives (rank {self.ranks[k]})")
            lines += [f"    {text}" for text in level]
        lines += [f"  never seen: {text}" for text in self.null_combinations]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw the ranks as steps and the level of each state; needs matplotlib."""
        return draw(self, "level_steps")


def levels(
    A: SystemLike,
    C: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    *,
    combinations: Mapping[str, ArrayLike | Mapping[str, float]] | None = None,
    rtol: float | None = None,
) -> Levels:
    """Say which combinations of the states the output and each derivative determine.

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
    C : array_like, shape (p, n)
    names : sequence of str, length n, optional
        The states; x0, x1, ... by default.
    combinations : mapping of str to coefficients, optional
        Combinations to find the level of: arrays (n,) or mappings of state to
        coefficient.
    rtol : float, optional
        A coupling below this part of the norms of the balanced A and C counts as
        zero; 1024 eps sqrt(n) by default. Raise it for matrices that come from
        measurements or differences.

    Returns
    -------
    Levels
        For one system; `batch_levels` takes many.

    Raises
    ------
    InputError
        An A that is not square, a C of another width, an unknown name, a number
        that is not finite.

    See Also
    --------
    batch_levels : the same for many systems at once.

    Notes
    -----
    The level of a combination is the smallest k for which it lies in the row
    space of O_k = [C; CA; ..; CA^k]. It needs no threshold and does not change
    with the units of states, outputs or time, unlike the order beta of Yang & Yin
    2012, sec. 3, which is found from eigenvectors of Q^T Q that do.

    The system is balanced by powers of two (Curtis & Reid 1972) and reduced to
    staircase form by reflections (Paige 1981), one kernel after the other; powers
    of A are not formed. An entry that should be zero must be zero: 1e-17 counts
    as a coupling.

    A discrete system (Phi, C) may be given as well; levels then count samples.

    Examples
    --------
    >>> found = levels([[0, 1, 0], [0, 0, 0], [0, 0, 0]], [[1, 0, 0]], ["x", "v", "b"])
    >>> found.ranks, dict(found.states)
    ((1, 2, 2), {'x': 0, 'v': 1, 'b': None})
    >>> print(found.summary())
    UNOBSERVABLE: rank 2 of 3
      the output itself gives (rank 1)
        1 x
      derivative 1 gives (rank 2)
        1 v
      never seen: 1 b
    """
    system = system_of(A, C, names)
    analysis = _core.LinearAnalysis(system.A, system.C, rtol)
    wanted = dict(system.combinations) | dict(combinations or {})
    named = {
        name: analysis.level_of(coefficients(value, system.names), None)
        for name, value in wanted.items()
    }
    return Levels(
        names=system.names,
        ranks=tuple(analysis.ranks()),
        states=dict(zip(system.names, analysis.state_levels(), strict=True)),
        combinations=named,
        new=tuple(analysis.combinations()),
        null_space=analysis.null_space(),
        margins=analysis.margins,
        rtol=analysis.rtol,
        _analysis=analysis,
    )


def batch_levels(
    A: SystemLike, C: ArrayLike | None = None, *, rtol: float | None = None
) -> BatchLevels:
    """Return ranks and state levels of many systems at once.

    Parameters
    ----------
    A : array_like, shape (..., n, n)
    C : array_like, shape (..., p, n)
        Leading axes are broadcast against those of A.
    rtol : float, optional
        As for `levels`.

    Returns
    -------
    BatchLevels

    Examples
    --------
    >>> import numpy as np
    >>> found = batch_levels(np.zeros((4, 2, 2)), [[1.0, 1.0]])
    >>> found.rank
    array([1, 1, 1, 1])
    """
    a, c = matrices(A, C)
    both = _core.linear_levels(a, c, rtol)
    return BatchLevels(ranks=both[..., 0, :].astype(np.int64), levels=both[..., 1, :])


def coefficients(value: ArrayLike | Mapping[str, float], names: Sequence[str]) -> Array:
    """Return the coefficients (n,) of a combination given in either way."""
    if isinstance(value, Mapping):
        out = np.zeros(len(names))
        for name, factor in value.items():
            if name not in names:
                raise InputError(f"no state is named {name!r}: the states are {', '.join(names)}")
            out[list(names).index(name)] = factor
        return out
    array = finite(value, "combination")
    if array.shape != (len(names),):
        raise InputError(f"combination has shape {array.shape}: must be ({len(names)},)")
    return array
