"""Pose graphs from g2o files (SE2 and SE3), and what their edges determine.

- `read_graph`: a file; `PoseGraph`: its poses and edges.
- `PoseGraph.problem`: the whitened rows of the edges at the poses of the file.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian._answers import Answer
from gramian._files import read_text
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.large import SparseProblem

__all__ = ["PoseGraph", "WeakPlaces", "read_graph"]

Array = NDArray[np.float64]

#: Words of a line after its tag.
_WORDS = {
    "VERTEX_SE2": 4,
    "VERTEX_SE3:QUAT": 8,
    "EDGE_SE2": 11,
    "EDGE_SE3:QUAT": 30,
    "FIX": 1,
}
_STATES = {2: ("x", "y", "theta"), 3: ("rx", "ry", "rz", "x", "y", "z")}
_GAUGES = {
    2: ("translation along x", "translation along y", "rotation about z"),
    3: (
        "rotation about x",
        "rotation about y",
        "rotation about z",
        "translation along x",
        "translation along y",
        "translation along z",
    ),
}


@dataclass(frozen=True, eq=False, repr=False)
class WeakPlaces(Answer):
    """Where a graph hangs together at one place only.

    Attributes
    ----------
    bridges : tuple of (str, str, int)
        Edges without which the graph falls apart, by the names of their poses, and how
        many poses are on the smaller side; the most first.
    cut_poses : tuple of str
        Poses without which it falls apart.
    """

    bridges: tuple[tuple[str, str, int], ...]
    cut_poses: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PoseGraph(Value):
    """Poses and the measured moves between them.

    Attributes
    ----------
    dimensions : int
        2 or 3.
    names : tuple of str
        "x" and the number of each vertex in the file.
    rotations : ndarray, shape (poses, d, d)
        Axes of each pose in those of the world.
    positions : ndarray, shape (poses, d), metres
    edges : ndarray, shape (edges, 2)
        The poses that each edge joins, by their places in `names`.
    moves : tuple of ndarray
        The measured rotation (edges, d, d) and translation (edges, d) of the second pose
        seen from the first.
    information : ndarray, shape (edges, p, p)
        Of the measured moves, in the order of the states: x, y, theta in the plane;
        rotation before translation in space.
    fixed : tuple of str
        Poses that the file fixes.
    """

    dimensions: int
    names: tuple[str, ...]
    rotations: Array
    positions: Array
    edges: NDArray[np.int64]
    moves: tuple[Array, Array]
    information: Array
    fixed: tuple[str, ...] = ()

    @property
    def states(self) -> tuple[str, ...]:
        """The states of one pose: small moves in its own axes."""
        return _STATES[self.dimensions]

    @cached_property
    def errors(self) -> Array:
        """What log(Z^-1 T1^-1 T2) is at the poses of the file, (edges, p), states' order."""
        first, second = self.edges.T
        z, shift = self.moves
        turn = np.swapaxes(self.rotations, 1, 2)
        r = turn[first] @ self.rotations[second]
        t = np.einsum("eij,ej->ei", turn[first], self.positions[second] - self.positions[first])
        back = np.swapaxes(z, 1, 2)
        return _log(back @ r, np.einsum("eij,ej->ei", back, t - shift))

    def rows_of(
        self, edges: NDArray[np.int64], information: Array, errors: Array | None = None
    ) -> Any:
        """Return the whitened rows (csr_array) of edges at the poses as they are.

        Parameters
        ----------
        edges : ndarray, shape (m, 2)
        information : ndarray, shape (m, p, p)
        errors : ndarray, shape (m, p), optional
            Where the derivative of the logarithm is taken; 0 by default, for moves that
            are as the poses have them.
        """
        from scipy.sparse import coo_array

        p = len(self.states)
        count = len(edges)
        first, second = edges.T
        turn = np.swapaxes(self.rotations, 1, 2)
        # The first pose seen from the second.
        r = turn[second] @ self.rotations[first]
        t = np.einsum("eij,ej->ei", turn[second], self.positions[first] - self.positions[second])
        factor = np.swapaxes(np.linalg.cholesky(information), 1, 2)
        if errors is not None:
            factor = factor @ _log_derivative(errors, self.dimensions)
        blocks = np.concatenate([-factor @ _adjoint(r, t), factor], axis=2)
        i = np.arange(count * p).reshape(count, p, 1)
        j = np.concatenate(
            [p * first[:, None] + np.arange(p), p * second[:, None] + np.arange(p)], axis=1
        )[:, None, :]
        i, j = np.broadcast_to(i, blocks.shape), np.broadcast_to(j, blocks.shape)
        keep = blocks != 0
        shape = (count * p, p * len(self.names))
        return coo_array((blocks[keep], (i[keep], j[keep])), shape=shape).tocsr()

    @cached_property
    def problem(self) -> SparseProblem:
        """The whitened rows of all edges, with names, units, blocks and gauges.

        The state of a pose is a small move in its own axes, T exp(xi), rotation before
        translation in space, and a row the whitened derivative of log(Z^-1 T1^-1 T2): the
        conventions of GTSAM's BetweenFactor (4.3), so that the numbers agree. Poses that
        the file fixes are fixed.
        """
        d = self.dimensions
        turn = np.swapaxes(self.rotations, 1, 2)
        place = -np.einsum("nij,nj->ni", turn, self.positions)
        # A small move of the world, in the axes of each pose.
        moves = _adjoint(turn, place)
        problem = SparseProblem(
            self.rows_of(self.edges, self.information, self.errors),
            [f"{name}.{state}" for name in self.names for state in self.states],
            units=[
                "rad" if state.startswith(("r", "t")) else "m"
                for _ in self.names
                for state in self.states
            ],
            blocks=[name for name in self.names for _ in self.states],
            gauges={name: moves[:, :, k].ravel() for k, name in enumerate(_GAUGES[d])},
        )
        return problem.fix(*self.fixed) if self.fixed else problem

    @cached_property
    def parts(self) -> NDArray[np.int64]:
        """The part of the graph that each pose is in, (poses,): poses that edges join."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        n = len(self.names)
        joined = coo_array((np.ones(len(self.edges)), tuple(self.edges.T)), shape=(n, n))
        _, part = connected_components(joined, directed=False)
        return np.asarray(part, dtype=np.int64)

    @cached_property
    def weak_places(self) -> WeakPlaces:
        """Bridges and cut poses: where one more measurement helps most."""
        first, second = (np.ascontiguousarray(e, dtype=np.int64) for e in self.edges.T)
        bridges, hanging, cut = _core.weak_places(len(self.names), first, second)
        order = np.argsort(-hanging.astype(np.int64), kind="stable")
        return WeakPlaces(
            tuple(
                (self.names[first[bridges[k]]], self.names[second[bridges[k]]], int(hanging[k]))
                for k in order
            ),
            tuple(self.names[v] for v in cut),
        )

    def position_std(self, crlb_std: Array, names: Sequence[str]) -> Array:
        """Return the bound on each pose's position, root of the summed squares, metres.

        Parameters
        ----------
        crlb_std : ndarray, shape (n,)
        names : sequence of str
            The states it is of; 0 for poses that are not among them.
        """
        square = np.zeros(len(self.names))
        place = {name: k for k, name in enumerate(self.names)}
        for name, std in zip(names, crlb_std.tolist(), strict=True):
            block, _, state = name.rpartition(".")
            if state in "xyz":
                square[place[block]] += std**2
        return np.sqrt(square)


def _adjoint(r: Array, t: Array) -> Array:
    """Return (m, p, p): small moves in the axes of (r, t) to those outside."""
    m, d = t.shape
    if d == 2:
        result = np.zeros((m, 3, 3))
        result[:, :2, :2] = r
        result[:, 0, 2] = t[:, 1]
        result[:, 1, 2] = -t[:, 0]
        result[:, 2, 2] = 1
        return result
    result = np.zeros((m, 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = r
    result[:, 3:, :3] = _cross(t) @ r
    return result


def _log(r: Array, t: Array) -> Array:
    """Return the logarithm (m, p) of rigid moves, in the order of the states."""
    m, d = t.shape
    if d == 2:
        angle = np.arctan2(r[:, 1, 0], r[:, 0, 0])
        omega = np.zeros((m, 2, 2))
        omega[:, 0, 1], omega[:, 1, 0] = -angle, angle
    else:
        from scipy.spatial.transform import Rotation

        vector = Rotation.from_matrix(r).as_rotvec()
        angle = np.linalg.norm(vector, axis=1)
        omega = _cross(vector)
    half = angle / 2
    small = np.abs(angle) < 1e-3
    with np.errstate(divide="ignore", invalid="ignore"):
        quadratic = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / angle**2)
    inverse = np.eye(d) - omega / 2 + quadratic[:, None, None] * (omega @ omega)
    v = np.einsum("eij,ej->ei", inverse, t)
    if d == 2:
        return np.column_stack([v, angle])
    return np.column_stack([vector, v])


def _log_derivative(xi: Array, d: int) -> Array:
    """Return d log(T exp(x)) / dx at x = 0 where log T = xi, (m, p, p).

    A series in the matrix of brackets with xi that ends, by its minimal polynomial
    (Selig, Geometrical Methods in Robotics, section 7.6).
    """
    m, p = xi.shape
    bracket = np.zeros((m, p, p))
    if d == 2:
        bracket[:, 0, 1], bracket[:, 1, 0] = -xi[:, 2], xi[:, 2]
        bracket[:, 0, 2], bracket[:, 1, 2] = xi[:, 1], -xi[:, 0]
        angle = np.abs(xi[:, 2])
    else:
        bracket[:, :3, :3] = bracket[:, 3:, 3:] = _cross(xi[:, :3])
        bracket[:, 3:, :3] = _cross(xi[:, 3:])
        angle = np.linalg.norm(xi[:, :3], axis=1)
    square = bracket @ bracket
    small = angle < 0.3
    a = np.where(small, 1.0, angle)
    c = 4 * (np.cos(a) - 1)
    second = 2 / a**2 + (a + 3 * np.sin(a)) / (a * c)
    fourth = 1 / a**4 + (a + np.sin(a)) / (a**3 * c)
    # Where these cancel, by Bernoulli numbers.
    second = np.where(small, 1 / 12, second)
    fourth = np.where(small, -1 / 720, fourth)
    power = square @ square
    result: Array = (
        np.eye(p) + bracket / 2 + second[:, None, None] * square + fourth[:, None, None] * power
    )
    for coefficient in (1 / 30240, -1 / 1209600, 1 / 47900160):
        power = power @ square
        result += np.where(small, coefficient, 0.0)[:, None, None] * power
    return result


def _cross(v: Array) -> Array:
    matrix = np.zeros((len(v), 3, 3))
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    crossed: Array = matrix - np.swapaxes(matrix, 1, 2)
    return crossed


def read_graph(path: str | os.PathLike[str]) -> PoseGraph:
    r"""Read a pose graph from a g2o file.

    Parameters
    ----------
    path : str or path
        Lines VERTEX_SE2, EDGE_SE2, or VERTEX_SE3:QUAT, EDGE_SE3:QUAT; FIX; comments after
        "#".

    Returns
    -------
    PoseGraph

    Raises
    ------
    InputError
        A line that is broken, of another kind, or names a vertex that is not there: with
        its number.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "two.g2o"
    >>> _ = file.write_text(
    ...     "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    ... )
    >>> graph = read_graph(file)
    >>> graph.names, graph.problem.n
    (('x0', 'x1'), 6)
    """
    file = Path(path)
    try:
        text = read_text(file)
    except OSError as error:
        raise InputError(f"{file}: cannot be read as text: {error}") from error
    reader = _Reader(file)
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if words:
            reader.take(number, words)
    return reader.graph()


class _Reader:
    def __init__(self, file: Path) -> None:
        self.file = file
        self.dimensions = 0
        self.vertices: dict[int, tuple[int, list[float]]] = {}
        self.edges: list[tuple[int, int, int, list[float]]] = []
        self.fixed: list[tuple[int, int]] = []

    def error(self, number: int, what: str) -> InputError:
        return InputError(f"{self.file}, line {number}: {what}")

    def take(self, number: int, words: list[str]) -> None:
        tag, rest = words[0], words[1:]
        if tag not in _WORDS:
            known = ", ".join(_WORDS)
            raise self.error(number, f"{tag} is not read: must be one of {known}")
        if tag == "FIX":
            self.fixed += [(number, self.vertex(number, word)) for word in rest]
            return
        if len(rest) != _WORDS[tag]:
            raise self.error(
                number, f"{tag} has {len(rest)} values: must have {_WORDS[tag]}; is the line cut?"
            )
        dimensions = 2 if "SE2" in tag else 3
        if self.dimensions not in (0, dimensions):
            raise self.error(number, f"{tag} in a graph of the other dimension")
        self.dimensions = dimensions
        ends = 1 if tag.startswith("VERTEX") else 2
        ids = [self.vertex(number, word) for word in rest[:ends]]
        values = [self.value(number, word) for word in rest[ends:]]
        quaternion = values[3:7] if dimensions == 3 else [1.0]
        length = float(np.hypot.reduce(quaternion))
        if not 1e-6 < length < 1e6:
            what = "zero" if length == 0 else f"of length {length:.3g}: must be about 1"
            raise self.error(number, f"the quaternion of {tag} is {what}")
        if ends == 2:
            if ids[0] == ids[1]:
                raise self.error(number, f"an edge from vertex {ids[0]} to itself")
            self.edges.append((number, ids[0], ids[1], values))
        elif ids[0] in self.vertices:
            before = self.vertices[ids[0]][0]
            raise self.error(number, f"vertex {ids[0]} was given in line {before} already")
        else:
            self.vertices[ids[0]] = number, values

    def vertex(self, number: int, word: str) -> int:
        try:
            return int(word)
        except ValueError:
            raise self.error(number, f"{word!r}: must be the number of a vertex") from None

    def value(self, number: int, word: str) -> float:
        try:
            value = float(word)
        except ValueError:
            raise self.error(number, f"{word!r} is not a number") from None
        if not np.isfinite(value):
            raise self.error(number, f"{word[:60]}: must be finite")
        return value

    def graph(self) -> PoseGraph:
        if not self.edges:
            raise InputError(f"{self.file}: has no edge, so nothing is measured")
        place = {vertex: k for k, vertex in enumerate(self.vertices)}
        for number, *ends, _ in self.edges:
            for vertex in ends:
                if vertex not in place:
                    raise self.error(number, f"vertex {vertex} is not in the file")
        for number, vertex in self.fixed:
            if vertex not in place:
                raise self.error(number, f"vertex {vertex} is not in the file")
        d = self.dimensions
        width = 3 if d == 2 else 7
        poses = np.array([values for _, values in self.vertices.values()])
        measured = np.array([values for *_, values in self.edges])
        rotations, positions = _pose(poses, d)
        information = _symmetric(measured[:, width:], 3 * d - 3, d)
        least = np.linalg.eigvalsh(information)[:, 0]
        if (least <= 0).any():
            number = self.edges[int(np.argmin(least))][0]
            raise self.error(number, "the information matrix is not positive definite")
        return PoseGraph(
            dimensions=d,
            names=tuple(f"x{vertex}" for vertex in self.vertices),
            rotations=rotations,
            positions=positions,
            edges=np.array([[place[a], place[b]] for _, a, b, _ in self.edges], dtype=np.int64),
            moves=_pose(measured[:, :width], d),
            information=information,
            fixed=tuple(dict.fromkeys(f"x{vertex}" for _, vertex in self.fixed)),
        )


def _pose(values: Array, d: int) -> tuple[Array, Array]:
    if d == 2:
        c, s = np.cos(values[:, 2]), np.sin(values[:, 2])
        return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1), values[
            :, :2
        ]
    q = values[:, 3:7] / np.linalg.norm(values[:, 3:7], axis=1, keepdims=True)
    x, y, z, w = q.T
    rotation = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )
    return rotation, values[:, :3]


def _symmetric(upper: Array, p: int, d: int) -> Array:
    matrix = np.zeros((len(upper), p, p))
    i, j = np.triu_indices(p)
    matrix[:, i, j] = upper
    matrix[:, j, i] = upper
    if d == 3:
        # The file has translation before rotation.
        order = [3, 4, 5, 0, 1, 2]
        matrix = matrix[:, order][:, :, order]
    return matrix
