"""Levels: at which derivative of the output a combination of states becomes known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, number, whole
from gramian._registry import draw
from gramian._text import describe_combination, describe_direction
from gramian.exceptions import InputError
from gramian.models.linear._systems import System, SystemLike, dense, matrices, system_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BatchLevels", "Levels", "batch_levels", "levels", "observability_matrix"]

Array = NDArray[np.float64]


def observability_matrix(
    A: SystemLike,
    C: ArrayLike | None = None,
    order: int | None = None,
    *,
    out: Array | None = None,
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
    out : ndarray, shape of the result, optional
        Where the result is written: of float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

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
        # Beyond, the extension says how much memory would be needed.
        if 10**7 < order < 10**9:
            raise InputError(f"order = {order}: must be at most 10000000; n - 1 is enough")
    a, c = (dense(part, name) for part, name in zip(matrices(A, C), "AC", strict=True))
    return _core.observability_matrix(a, c, order, out)


@dataclass(frozen=True, eq=False, repr=False)
class BatchLevels(Answer):
    """Levels of many systems.

    Attributes
    ----------
    ranks : ndarray of int, shape (..., n)
        Rank of O_k for k = 0, 1, .., n - 1; the last is right for every system, the
        others are -1 where `reliable` is False.
    levels : ndarray, shape (..., n)
        The level of each state; `inf` where no derivative determines it, NaN where
        `reliable` is False.
    rank : ndarray of int, shape (...)
        Rank of the whole observability matrix; where rounding does not decide it, the least
        it may be: see `Levels.undecided`.
    reliable : ndarray of bool, shape (...)
        Whether levels can be determined in double precision.
    """

    ranks: NDArray[np.int64]
    levels: Array

    @property
    def rank(self) -> NDArray[np.int64]:
        """Rank of the whole observability matrix of each system."""
        last: NDArray[np.int64] = self.ranks[..., -1]
        return last

    @property
    def reliable(self) -> NDArray[np.bool_]:
        """Whether the levels of each system can be determined."""
        told: NDArray[np.bool_] = ~np.isnan(self.levels[..., -1])
        return told


@dataclass(frozen=True, eq=False, repr=False)
class Levels(Answer):
    """What each derivative of the output adds.

    Attributes
    ----------
    names : tuple of str, length n
    ranks : tuple of int, length n, or None
        Rank of O_k for k = 0, 1, .., n - 1. None where levels cannot be determined in double
        precision: see `reason`.
    rank, nullity : int
        Of the whole observability matrix: right in any case, unless `undecided`.
    undecided : bool
        Whether the rank may be larger: what decides it is too near to rounding. Always
        False where `rtol` was given.
    states : mapping of str to (int or None), or None
        The level of each state: the derivative from which on it is known. None
        for never; None in place of the mapping where levels cannot be determined.
    combinations : mapping of str to (int or None), or None
        The same of the named combinations.
    reason : str or None
        Why levels cannot be determined.
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
    ranks: tuple[int, ...] | None
    states: Mapping[str, int | None] | None
    combinations: Mapping[str, int | None] | None
    new: tuple[Array, ...]
    null_space: Array
    margins: tuple[float, float]
    rtol: float
    rank: int
    undecided: bool
    reason: str | None
    _system: System

    _more_in_dict = ("nullity", "new_combinations", "null_combinations")

    @cached_property
    def _analysis(self) -> _core.LinearAnalysis:
        return _core.LinearAnalysis(self._system.A, self._system.C, self.rtol)

    @property
    def nullity(self) -> int:
        """Number of combinations that no derivative sees."""
        return len(self.names) - self.rank

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """The null space in words: "phi_U +1, eps_W +6.4e-05"."""
        return tuple(describe_direction(column, self.names) for column in self.null_space.T)

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
        if self.reason is not None:
            raise InputError(self.reason)
        if tolerance is not None:
            tolerance = options.fraction(tolerance, "tolerance")
        return self._analysis.level_of(coefficients(combination, self.names), tolerance)

    def summary(self) -> str:
        """Return what becomes known at each derivative, as text."""
        n = len(self.names)
        head = "OBSERVABLE" if self.nullity == 0 else "UNOBSERVABLE"
        lines = [f"{head}: rank {self.rank} of {n}"]
        if self.undecided:
            lines = [f"UNDECIDED: rank {self.rank} of {n} at least"]
        if self.ranks is None:
            lines.append(f"  {self.reason}")
        else:
            for k, level in enumerate(self.new_combinations):
                source = "the output itself" if k == 0 else f"derivative {k}"
                lines.append(f"  {source} gives (rank {self.ranks[k]})")
                lines += [f"    {text}" for text in level]
        lines += [f"  never seen: {text}" for text in self.null_combinations]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw the ranks as steps and the level of each state; needs matplotlib."""
        return draw(self, "level_steps")

    def _as_table(self) -> Columns:
        if self.states is None:
            raise InputError(str(self.reason))
        levels = [np.inf if level is None else float(level) for level in self.states.values()]
        return Columns("state", tuple(self.states), {"level": np.array(levels)}, {})


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

    Where the steps of the staircase magnify rounding too much (long chains, dense systems
    of more than about 20 states with few outputs), rank and null space come from the
    pencil as in `unobservable`, and levels are None, with a `reason`.

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
      never seen: b +1
    """
    system = system_of(A, C, names)
    if rtol is not None:
        rtol = options.fraction(rtol, "rtol")
    analysis = _core.LinearAnalysis(system.A, system.C, rtol)
    given = options.mapping(combinations, "combinations", "name to coefficients")
    wanted = {
        name: coefficients(value, system.names)
        for name, value in (dict(system.combinations) | dict(given)).items()
    }
    ranks, states = analysis.ranks(), analysis.state_levels()
    told = ranks is not None and states is not None
    reason = (
        "levels cannot be determined in double precision: the steps from one derivative "
        f"to the next magnify rounding {analysis.growth:.1e} times; `unobservable` and "
        "`distance` need none"
    )
    return Levels(
        names=system.names,
        ranks=None if ranks is None else tuple(ranks),
        states=None if states is None else dict(zip(system.names, states, strict=True)),
        combinations={k: analysis.level_of(v, None) for k, v in wanted.items()} if told else None,
        new=tuple(analysis.combinations()) if told else (),
        null_space=analysis.null_space(),
        margins=analysis.margins,
        rtol=analysis.rtol,
        rank=analysis.rank,
        undecided=analysis.undecided,
        reason=None if told else reason,
        _system=system,
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
    a, c = (dense(part, name) for part, name in zip(matrices(A, C), "AC", strict=True))
    if rtol is not None:
        rtol = options.fraction(rtol, "rtol")
    both = _core.linear_levels(a, c, rtol)
    ranks = np.nan_to_num(both[..., 0, :], nan=-1.0).astype(np.int64)
    return BatchLevels(ranks=ranks, levels=both[..., 1, :])


def coefficients(value: ArrayLike | Mapping[str, float], names: Sequence[str]) -> Array:
    """Return the coefficients (n,) of a combination given in either way."""
    if isinstance(value, Mapping):
        out = np.zeros(len(names))
        for name, factor in options.mapping(value, "combination").items():
            if name not in names:
                raise InputError(f"no state is named {name!r}: the states are {', '.join(names)}")
            out[list(names).index(name)] = number(factor, f"combination of {name}")
        return out
    array = finite(value, "combination")
    if array.shape != (len(names),):
        raise InputError(f"combination has shape {array.shape}: must be ({len(names)},)")
    return array
