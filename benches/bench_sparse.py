"""Sparse problems: pose graphs in the plane, beside SciPy's splu and GTSAM."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Case, Contest, Contestant, main
from sparse_graphs import grid_graph

import gramian as gm


def fixed_problem(poses: int, seed: int = 1) -> Any:
    """A grid graph with the first pose fixed."""
    return grid_graph(poses, seed).problem.fix("x0")


def dense(problem: Any) -> Any:
    """The bounds by a dense factor of the rows."""
    rows = problem.rows.toarray()
    r = np.linalg.qr(rows, mode="r")
    return np.sqrt((np.linalg.inv(r) ** 2).sum(axis=1))


def splu(problem: Any) -> Callable[[], Any]:
    import scipy.sparse.linalg as sl

    return lambda: sl.splu((problem.rows.T @ problem.rows).tocsc())


def splu_bounds(problem: Any) -> Callable[[], Any]:
    """All columns of the inverse, a block at a time."""
    import scipy.sparse.linalg as sl

    def work() -> Any:
        factor = sl.splu((problem.rows.T @ problem.rows).tocsc())
        n, out = problem.n, np.empty(problem.n)
        for first in range(0, n, 256):
            last = min(n, first + 256)
            block = np.zeros((n, last - first))
            block[np.arange(first, last), np.arange(last - first)] = 1
            out[first:last] = factor.solve(block)[np.arange(first, last), np.arange(last - first)]
        return np.sqrt(out)

    return work


def gtsam_marginals(problem: Any) -> Callable[[], Any]:
    """Its marginals of all poses, of the same rows as Jacobian factors."""
    import gtsam

    rows = problem.rows.tocsr()
    graph = gtsam.GaussianFactorGraph()
    poses = problem.n // 3
    of = np.concatenate([[0], np.cumsum(np.diff(rows.indptr))])
    # Three rows an edge, each of the states of one or two poses.
    for first in range(0, rows.shape[0], 3):
        part = rows[first : first + 3].tocoo()
        keys = sorted(set((part.col // 3).tolist()))
        full = part.toarray()
        blocks = [(key, np.asfortranarray(full[:, 3 * key : 3 * key + 3])) for key in keys]
        unit = gtsam.noiseModel.Unit.Create(len(full))
        arguments = [item for block in blocks for item in block]
        graph.add(gtsam.JacobianFactor(*arguments, np.zeros(len(full)), unit))
    del of

    def work() -> Any:
        marginals = gtsam.Marginals(graph, gtsam.VectorValues())
        return np.concatenate(
            [np.sqrt(np.diag(marginals.marginalCovariance(k))) for k in range(poses)]
        )

    return work


def bounds_contest(poses: int) -> Contest:
    """The bound of every state."""

    def case(seed: int, scale: float) -> Case:
        problem = fixed_problem(100, seed)
        if scale != 1.0:
            problem = problem._replaced(rows=problem.rows * scale)
        wanted = dense(problem)
        return Case(problem, lambda found: float(np.abs(found / wanted - 1).max()))

    return Contest(
        f"all bounds of a graph of {poses} poses",
        "graph",
        1.0,
        fixed_problem(poses),
        [
            Contestant(OURS, lambda data: lambda: gm.analyze(data).crlb_std),
            Contestant("SciPy splu of the normal equations, solved for all columns", splu_bounds),
            Contestant("GTSAM, marginals of all poses", gtsam_marginals),
        ],
        cases={"well": case(1, 1.0)},
        note="Ours decides the rank first. Error against a dense factor of the rows.",
    )


def rank_contest(poses: int) -> Contest:
    """Rank, nullity and gap, beside the factorisation alone."""
    return Contest(
        f"rank and gap of a graph of {poses} poses",
        "graph",
        1.0,
        fixed_problem(poses),
        [
            Contestant(OURS, lambda data: lambda: gm.analyze(data)),
            Contestant("SciPy splu of the normal equations: no rank", splu),
        ],
        note="splu factors the normal equations, which have half the digits, and tells no rank.",
        why="splu answers less: it factors the normal equations, whose pivots of half the digits "
        "decide no rank. Ours reduces the rows themselves, twice the multiplications.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield rank_contest(400 if quick else 900)
    yield bounds_contest(400 if quick else 900)


if __name__ == "__main__":
    main(contests)
