"""Sparse problems: ratios within one run, and growth with the size of a graph.

    python benches/sparse_graphs.py [--data ../shared/data/graphs] [--largest 100000] [--gtsam]

The recorded graph: `analyze` beside SciPy's `splu` of the normal equations of the same
rows (first pose fixed, its default ordering), and all bounds beside GTSAM's `Marginals`
of all poses where that is installed (--gtsam). Then graphs made here, from 10^2 poses
up. All times are those of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse.linalg as sl

import gramian as gm
from gramian.io.g2o import PoseGraph, read_graph


def timed(work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Return the least processor time of a few runs, s, and the last answer."""
    best = np.inf
    answer = None
    for _ in range(repeats):
        start = time.process_time()
        answer = work()
        best = min(best, time.process_time() - start)
    return best, answer


def grid_graph(poses: int, seed: int = 1) -> PoseGraph:
    """A robot that sweeps a square grid, and closures to neighbours within five cells."""
    rng = np.random.default_rng(seed)
    side = int(np.sqrt(poses))
    count = side * side
    row, column = np.divmod(np.arange(count), side)
    # Every other line backwards.
    column = np.where(row % 2 == 0, column, side - 1 - column)
    at = np.zeros((side, side), dtype=np.int64)
    at[row, column] = np.arange(count)
    path = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    step = rng.integers(-5, 6, (count, 2))
    other = np.clip(np.column_stack([row, column]) + step, 0, side - 1)
    closure = np.column_stack([np.arange(count), at[other[:, 0], other[:, 1]]])
    closure = closure[closure[:, 0] != closure[:, 1]]
    edges = np.concatenate([path, closure])
    angle = rng.uniform(-np.pi, np.pi, count)
    c, s = np.cos(angle), np.sin(angle)
    rotations = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    positions = np.column_stack([column, row]) + rng.normal(0, 0.1, (count, 2))
    first, second = edges.T
    turn = np.swapaxes(rotations, 1, 2)
    moves = (
        turn[first] @ rotations[second],
        np.einsum("eij,ej->ei", turn[first], positions[second] - positions[first]),
    )
    information = np.broadcast_to(np.diag([400.0, 400.0, 2500.0]), (len(edges), 3, 3)).copy()
    names = tuple(f"x{k}" for k in range(count))
    return PoseGraph(2, names, rotations, positions, edges, moves, information)


def recorded(folder: Path, gtsam_too: bool) -> None:
    graph = read_graph(folder / "sphere2500.g2o")
    problem = graph.problem
    fixed = problem.fix("x0")
    normal = (fixed.rows.T @ fixed.rows).tocsc()
    splu, _ = timed(lambda: sl.splu(normal))
    free, answer = timed(lambda: gm.analyze(problem))

    def bounds() -> Any:
        return gm.analyze(fixed).crlb_std

    both, std = timed(bounds)
    print("sphere2500: 15 000 states, 29 694 rows")
    print(f"  splu of the normal equations        {splu:7.3f} s")
    print(f"  analyze                             {free:7.3f} s   {free / splu:.2f} of splu")
    print(f"  analyze and all bounds, pose fixed  {both:7.3f} s   {both / splu:.2f} of splu")
    print(
        f"  nullity {answer.nullity}, gap {answer.gap:.2g}, "
        f"next value {answer.singular_values[-7]:.6f}"
    )
    reference = np.load(folder / "sphere2500.npz")["std_first_pose_fixed"][6:]
    print(f"  bounds against the reference        {np.abs(std / reference - 1).max():.1e}")
    if gtsam_too:
        import gtsam

        factors, values = gtsam.readG2o(str(folder / "sphere2500.g2o"), True)
        sigmas = gtsam.noiseModel.Diagonal.Sigmas(np.full(6, 1e-6))
        factors.add(gtsam.PriorFactorPose3(0, values.atPose3(0), sigmas))

        def marginals() -> Any:
            of = gtsam.Marginals(factors, values)
            return [of.marginalCovariance(k) for k in range(2500)]

        slow, _ = timed(marginals, 1)
        print(f"  GTSAM Marginals of all poses        {slow:7.3f} s   {slow / both:.1f} times ours")


def growth(largest: int) -> None:
    print("grid graphs in the plane, one closure a pose within five cells; seconds of one core")
    print("  poses   states    rows    analyze   + bounds  factor      peak memory  gap")
    poses = 100
    while poses <= largest:
        graph = grid_graph(poses)
        problem = graph.problem
        start = time.process_time()
        answer = gm.analyze(problem)
        seconds = time.process_time() - start
        gap, nullity, entries = answer.gap, answer.nullity, answer._sparse.factor_entries
        del answer
        start = time.process_time()
        fixed = gm.analyze(problem.fix("x0"))
        std = fixed.crlb_std
        bounds = time.process_time() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        assert nullity == 3
        assert np.isfinite(std).all()
        print(
            f"  {len(graph.names):6d}  {problem.n:7d}  {problem.rows.shape[0]:7d}  {seconds:7.2f} s"
            f"  {bounds:7.2f} s  {entries / 1e6:7.2f} M  {peak:7.2f} GB   {gap:.1g}",
            flush=True,
        )
        poses *= 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/graphs"))
    parser.add_argument("--largest", type=int, default=100_000)
    parser.add_argument("--gtsam", action="store_true")
    options = parser.parse_args()
    gm.set_threads(1)
    if (options.data / "sphere2500.g2o").exists():
        recorded(options.data, options.gtsam)
    growth(options.largest)


if __name__ == "__main__":
    main()
