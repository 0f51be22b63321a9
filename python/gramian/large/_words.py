"""The null space of a sparse problem as a sparse basis, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gramian._text import describe_direction
from gramian._values import Value
from gramian.large._problem import SparseProblem

__all__ = ["NullCombination", "null_combinations", "some_of"]

Array = NDArray[np.float64]

#: A part of a null vector below this, relative to its largest, is rounding.
_ROUNDING = 1e-6
#: So many blocks or states are named; of the others, how many there are.
_LISTED = 10


@dataclass(frozen=True, eq=False)
class NullCombination(Value):
    """One combination of states that no measurement sees.

    Attributes
    ----------
    kind : {"untouched", "gauge", "shift", "combination"}
        A state that no measurement touches; a named gauge of the problem; states of one
        kind that shift alike; any other combination.
    text : str
        In words.
    gauge : str
        The name of the gauge, or of the kind of states that shift; empty for others.
    blocks : tuple of str
        The blocks that it moves.
    whole : bool
        Whether it moves a whole component of the problem: blocks that no measurement joins
        with others.
    component : int
        The number of the component, by first states.
    """

    kind: Literal["untouched", "gauge", "shift", "combination"]
    text: str
    gauge: str
    blocks: tuple[str, ...]
    whole: bool
    component: int


def null_combinations(
    problem: SparseProblem, vectors: Any, scale: Array, component: NDArray[Any]
) -> tuple[tuple[NullCombination, ...], Any]:
    """Return what the null vectors mean, and the sparse basis in units of the states.

    Parameters
    ----------
    problem : SparseProblem
    vectors : scipy.sparse.csc_array, shape (n, nullity)
        Orthonormal in scaled units, each in one component.
    scale : ndarray, shape (n,)
        Scaled units to those of the states.
    component : ndarray, shape (n,)
    """
    from scipy.sparse import csc_array

    n, nullity = vectors.shape
    found: list[NullCombination] = []
    columns: list[tuple[NDArray[Any], Array]] = []
    if nullity:
        first = vectors.indices[vectors.indptr[:-1]]
        of = component[first]
        sizes = np.bincount(component)
        kinds = _Kinds(problem)
        for c in np.unique(of):
            own = np.flatnonzero(of == c)
            part = vectors[:, own]
            states = np.unique(part.indices)
            if sizes[c] == 1:
                j = int(states[0])
                found.append(_untouched(problem, j, int(c)))
                columns.append((states, np.ones(1)))
                continue
            words = _Component(problem, kinds, int(c), states, part[states].toarray(), scale)
            for combination, (where, values) in words.combinations():
                found.append(combination)
                columns.append((where, values))
    basis = csc_array(
        (
            np.concatenate([values for _, values in columns]) if columns else np.zeros(0),
            np.concatenate([where for where, _ in columns]) if columns else np.zeros(0, int),
            np.cumsum([0, *(len(where) for where, _ in columns)]),
        ),
        shape=(n, nullity),
    )
    return tuple(found), basis


def _untouched(problem: SparseProblem, j: int, component: int) -> NullCombination:
    block = problem.blocks[problem.block_of[j]]
    return NullCombination(
        "untouched",
        f"{problem.names[j]}: no measurement touches it",
        "",
        (block,),
        True,
        component,
    )


class _Kinds:
    """The kind of each state: what stands after the last dot of its name."""

    def __init__(self, problem: SparseProblem) -> None:
        number: dict[str, int] = {}
        self.of = np.array(
            [number.setdefault(name.rpartition(".")[2], len(number)) for name in problem.names]
        )
        self.names = tuple(number)


class _Component:
    """The null vectors of one component."""

    def __init__(
        self,
        problem: SparseProblem,
        kinds: _Kinds,
        number: int,
        states: NDArray[Any],
        vectors: Array,
        scale: Array,
    ) -> None:
        self.problem, self.kinds, self.number = problem, kinds, number
        self.states, self.vectors, self.scale = states, vectors, scale[states]
        self.block = problem.block_of[states]
        self.blocks = np.unique(self.block)

    def combinations(self) -> list[tuple[NullCombination, tuple[NDArray[Any], Array]]]:
        """Return each with its vector: states and values in their units."""
        known = self._gauges(np.arange(len(self.states)))
        named, coefficients = self._independent(known)
        answer = []
        for name, kind, vector in named:
            text = self._moved(name, kind, self.blocks)
            answer.append(self._made(kind, text, name, vector))
        k = self.vectors.shape[1]
        if len(named) < k:
            rest = self._rest(coefficients, [vector / self.scale for _, _, vector in named])
            answer += [self._described(column * self.scale) for column in rest.T]
        return answer

    def _gauges(self, where: NDArray[Any]) -> list[tuple[str, str, Array]]:
        """Return directions to try, on some of the states: name, kind and vector in their units."""
        states = self.states[where]
        tried = [
            (name, "gauge", vector[states])
            for name, vector in self.problem.gauges.items()
            if vector[states].any()
        ]
        kind = self.kinds.of[states]
        for number in np.unique(kind):
            alike = kind == number
            if alike.sum() > 1:
                tried.append((self.kinds.names[number], "shift", alike.astype(float)))
        return tried

    def _independent(
        self, tried: list[tuple[str, str, Array]]
    ) -> tuple[list[tuple[str, str, Array]], Array]:
        """Return those that lie in the null space, none a combination of those before."""
        accepted: list[tuple[str, str, Array]] = []
        q = np.zeros((self.vectors.shape[1], 0))
        for name, kind, vector in tried:
            scaled = vector / self.scale
            scaled = scaled / np.linalg.norm(scaled)
            inside = self.vectors.T @ scaled
            if np.linalg.norm(scaled - self.vectors @ inside) > _ROUNDING:
                continue
            new = inside - q @ (q.T @ inside)
            if np.linalg.norm(new) > 1e-4:
                accepted.append((name, kind, vector))
                q = np.column_stack([q, new / np.linalg.norm(new)])
        return accepted, q

    def _rest(self, coefficients: Array, gauges: list[Array]) -> Array:
        """Return what the gauges do not explain, zero on as many blocks as can be."""
        k = self.vectors.shape[1]
        full, _ = np.linalg.qr(np.column_stack([coefficients, np.eye(k)]))
        rest = self.vectors @ full[:, coefficients.shape[1] : k]
        if gauges:
            rest = self._off_the_rest(rest, np.column_stack(gauges))
        return _echelon(rest)

    def _off_the_rest(self, rest: Array, gauges: Array) -> Array:
        """Subtract the gauge that most blocks move by, so that these stand still."""
        gauges = gauges / np.linalg.norm(gauges, axis=0)
        size = np.abs(rest).max()
        votes: dict[tuple[float, ...], list[Any]] = {}
        order = np.argsort(self.block, kind="stable")
        starts = np.searchsorted(self.block[order], self.blocks)
        owned = np.split(order, starts[1:])
        # One measure for all blocks: their own differ with the accuracy of what sees them.
        typical = np.median([np.linalg.norm(gauges[own]) for own in owned])
        for own in owned:
            g = gauges[own]
            level = np.linalg.norm(g, axis=0)
            used = level > 1e-12
            # Only blocks that show every gauge can say by how much it moves them.
            if not used.all() or np.linalg.matrix_rank(g / level) < g.shape[1]:
                continue
            amount, *_ = np.linalg.lstsq(g, rest[own], rcond=None)
            if np.abs(g @ amount - rest[own]).max() > 1e-7 * size:
                continue
            key = tuple(np.round(amount.ravel() * typical / size, 5) + 0.0)
            votes.setdefault(key, []).append(amount)
        if not votes:
            return rest
        amount = np.mean(max(votes.values(), key=len), axis=0)
        cleaned: Array = rest - gauges @ amount
        cleaned[np.abs(cleaned) < 1e-8 * size] = 0
        return cleaned

    def _described(self, vector: Array) -> tuple[NullCombination, tuple[NDArray[Any], Array]]:
        scaled = np.abs(vector / self.scale)
        vector = np.where(scaled > _ROUNDING * scaled.max(), vector, 0.0)
        where = np.flatnonzero(vector)
        vector = vector / vector[where[0]]
        moved = np.unique(self.block[where])
        states = self.states[where]
        direction = vector[where] / self.scale[where]
        direction /= np.linalg.norm(direction)
        if len(where) > 1:
            for name, kind, given in self._gauges(np.flatnonzero(np.isin(self.block, moved))):
                # On all states of the blocks that move, or this is another direction.
                whole = np.zeros(len(self.states))
                whole[np.isin(self.block, moved)] = given
                scaled = whole / self.scale
                length = np.linalg.norm(scaled)
                rest = scaled / length
                cosine = rest[where] @ direction
                if abs(abs(cosine) - 1) < 1e-9:
                    vector = whole
                    return self._made(kind, self._moved(name, kind, moved), name, vector)
        if len(where) <= _LISTED:
            values = vector[where]
            text = describe_direction(values, [self.problem.names[j] for j in states])
        else:
            order = np.argsort(-scaled[where], kind="stable")[:_LISTED]
            text = describe_direction(
                vector[where][order], [self.problem.names[j] for j in states[order]]
            )
            text += f" and {len(where) - _LISTED} more states"
        return self._made("combination", text, "", vector)

    def _moved(self, name: str, kind: str, moved: NDArray[Any]) -> str:
        every = len(moved) == len(self.problem.blocks)
        names = [self.problem.blocks[b] for b in moved]
        if every:
            of = f"{len(moved)} blocks"
        elif len(moved) == len(self.blocks):
            of = f"the {_count(len(moved))} that nothing joins with the others ({_few(names)})"
        else:
            of = some_of(names, "blocks")
        if kind == "gauge":
            return f"{name} of all {of}" if every else f"{name} of {of}"
        return f"all {name} of {of} shift alike"

    def _made(
        self, kind: Any, text: str, gauge: str, vector: Array
    ) -> tuple[NullCombination, tuple[NDArray[Any], Array]]:
        where = np.flatnonzero(vector)
        moved = np.unique(self.block[where])
        combination = NullCombination(
            kind,
            text,
            gauge,
            tuple(self.problem.blocks[b] for b in moved),
            len(moved) == len(self.blocks),
            self.number,
        )
        return combination, (self.states[where], vector[where])


def _echelon(vectors: Array) -> Array:
    """Reduced row echelon form: each vector is 1 at a state where the others are 0."""
    from scipy.linalg import qr, solve

    k = vectors.shape[1]
    _, _, pivots = qr(vectors.T, mode="economic", pivoting=True)
    reduced: Array = solve(vectors[pivots[:k]].T, vectors.T).T
    reduced[np.abs(reduced) < _ROUNDING] = 0
    return reduced


def some_of(names: Sequence[str], what: str) -> str:
    """Return "x3", "x3 and x4", or "12 blocks (x3, x4, x5, ...)"."""
    if len(names) <= 2:
        return " and ".join(names)
    return f"{len(names)} {what} ({_few(names)})"


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


def _count(number: int) -> str:
    return "block" if number == 1 else f"{number} blocks"
