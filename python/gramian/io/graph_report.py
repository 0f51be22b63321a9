"""The report of a pose graph: `gramian analyze graph.g2o`."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, count, number
from gramian.analysis import analyze
from gramian.io.g2o import PoseGraph, read_graph
from gramian.report import Picture, Report, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.large import SparseObservability

__all__ = ["closures", "report"]

Array = NDArray[np.float64]

#: So many pairs of near poses are tried as one more closure.
_TRIED = 40
#: So many of a table are shown.
_SHOWN = 8


def closures(
    graph: PoseGraph, answer: SparseObservability, std: Array
) -> list[tuple[str, str, float, float]]:
    """Return what one more loop closure would give, the best first.

    Parameters
    ----------
    graph : PoseGraph
    answer : SparseObservability
        Of the graph with what fixes its gauge, or without: relative poses are determined
        either way.
    std : ndarray, shape (poses,)
        Bound on each pose's position.

    Returns
    -------
    list of (str, str, float, float)
        The two poses, the gain in half the log determinant (nats), and by how much the
        position of the second seen from the first is uncertain now, metres.

    Notes
    -----
    The candidates are pairs of poses near each other that no edge joins; the closure is
    taken as accurate as the median edge. The gain is 1/2 log det(I + A C A^T).
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(graph.positions)
    _, near = tree.query(graph.positions, k=min(8, len(graph.names)))
    joined = {tuple(sorted(edge)) for edge in graph.edges.tolist()}
    pairs = {
        (min(a, int(b)), max(a, int(b)))
        for a, line in enumerate(near)
        for b in line
        if a != b and abs(a - int(b)) > 1
    } - joined
    ranked = sorted(pairs, key=lambda pair: (-std[list(pair)].max(), pair))
    information = np.median(graph.information, axis=0)
    present = {name: j for j, name in enumerate(answer.names)}
    found = []
    for a, b in ranked[:_TRIED]:
        rows = graph.rows_of(np.array([[a, b]]), information[None]).tocoo()
        names = [f"{name}.{state}" for name in graph.names for state in graph.states]
        combinations = []
        for i in range(rows.shape[0]):
            own = rows.row == i
            combinations.append(
                {
                    names[j]: value
                    for j, value in zip(
                        rows.col[own].tolist(), rows.data[own].tolist(), strict=True
                    )
                    if names[j] in present
                }
            )
        covariance = answer.covariance_of(combinations)
        if not np.isfinite(covariance).all():
            found.append((graph.names[a], graph.names[b], np.inf, np.inf))
            continue
        gain = np.linalg.slogdet(np.eye(len(covariance)) + covariance)[1] / 2
        root = np.linalg.inv(np.linalg.cholesky(information).T)
        relative = root @ covariance @ root.T
        place = [k for k, state in enumerate(graph.states) if state in ("x", "y", "z")]
        spread = float(np.sqrt(np.trace(relative[np.ix_(place, place)])))
        found.append((graph.names[a], graph.names[b], float(gain), spread))
    return sorted(found, key=lambda item: -item[2])


def _size(graph: PoseGraph) -> str:
    parts = len(set(graph.parts.tolist()))
    return (
        f"{count(len(graph.names), 'pose')}, {count(len(graph.edges), 'edge')}, "
        f"{count(parts, 'part')}"
    )


def _gauge(graph: PoseGraph, free: SparseObservability) -> list[str]:
    """Return the first pose of each part, where its gauge is all that is missing."""
    short: dict[int, int] = {}
    p = len(graph.states)
    places = {name: k for k, name in enumerate(graph.names)}
    for missing in free.missing:
        part = int(graph.parts[places[missing.blocks[0]]])
        short[part] = short.get(part, 0) + 1
    if any(number != p for number in short.values()):
        return []
    parts = graph.parts.tolist()
    return [graph.names[parts.index(part)] for part in sorted(short)]


def report(path: str | os.PathLike[str]) -> Report:
    """Return the report of a g2o file."""
    graph = read_graph(path)
    free: SparseObservability = analyze(graph.problem)  # type: ignore[assignment]
    held = _gauge(graph, free)
    fixed: SparseObservability = free
    if held:
        fixed = analyze(graph.problem.fix(*held))  # type: ignore[assignment]
    bounded = fixed.nullity == 0
    std = np.full(len(graph.names), np.inf)
    if bounded:
        std = graph.position_std(fixed.crlb_std, fixed.names)
    weak = graph.weak_places
    more = closures(graph, fixed, std)
    tables = []
    facts = [
        ("graph", _size(graph)),
        ("gap", f"{brief(free.gap, 2)}: how clear the rank is"),
    ]
    facts += [("not observable", text) for text in free.grouped()]
    if free.suggestions:
        facts.append(("what would help", free.describe(free.suggestions[0])))
    facts.append(
        ("bridges", f"{count(len(weak.bridges), 'edge')} without which the graph falls apart")
        if weak.bridges
        else ("bridges", "none: every edge could be lost")
    )
    facts.append(("cut poses", f"{len(weak.cut_poses)}"))
    if bounded:
        values, _ = fixed.weakest(1)
        facts.append(("weakest direction", f"singular value {brief(values[0])} on unit columns"))
        order = np.argsort(-std, kind="stable")[:_SHOWN]
        known = "as the file fixes it"
        if held:
            known = "with " + ", ".join(held[:_SHOWN]) + (", ..." if len(held) > _SHOWN else "")
            known += " fixed"
        tables.append(
            Table(
                f"Largest bounds on positions, {known}",
                ("pose", "bound (m)"),
                [(graph.names[k], number(std[k])) for k in order],
            )
        )
    if weak.bridges:
        tables.append(
            Table(
                "Bridges",
                ("from", "to", "poses beyond"),
                [(a, b, str(count)) for a, b, count in weak.bridges[:_SHOWN]],
                note="One more measurement across a bridge helps most.",
            )
        )
    if more:
        tables.append(
            Table(
                "One more loop closure",
                ("from", "to", "gain (nats)", "relative position now (m)"),
                [
                    (
                        a,
                        b,
                        "joins two parts" if np.isinf(gain) else f"{brief(gain)}",
                        number(spread),
                    )
                    for a, b, gain, spread in more[:_SHOWN]
                ],
                note="Between near poses without an edge, as accurate as the median edge.",
            )
        )
    pictures = (
        [
            Picture(
                "The graph",
                "Left: poses coloured by the bound on their position. Right: how far they move "
                "along the weakest direction that is still observable, at one standard deviation. "
                "Bridges are red.",
                partial(picture, graph, fixed, std),
            )
        ]
        if bounded
        else []
    )
    return Report(
        title=Path(path).name,
        subtitle=f"pose graph, {graph.dimensions}D",
        tone="good" if free.status == "observable" else "bad",
        headline=free.status.upper(),
        verdict=free.reason,
        facts=facts,
        tables=tables,
        pictures=pictures,
        data={
            "status": free.status,
            "rank": free.rank,
            "nullity": free.nullity,
            "gap": free.gap if np.isfinite(free.gap) else "inf",
            "null_combinations": list(free.null_combinations),
            "bridges": [list(bridge) for bridge in weak.bridges],
            "cut_poses": list(weak.cut_poses),
            "poses": list(graph.names),
            "position_std": [value if np.isfinite(value) else "inf" for value in std.tolist()],
            "closures": [
                [a, b, gain if np.isfinite(gain) else "inf"] for a, b, gain, _ in more[:_SHOWN]
            ],
        },
    )


def picture(graph: PoseGraph, answer: SparseObservability, std: Array) -> Figure:
    """Draw the graph coloured by its bound, and by its weakest direction."""
    from matplotlib.collections import LineCollection

    from gramian.plot import figure

    _, directions = answer.weakest(1)
    moved = np.zeros((len(graph.names), graph.dimensions))
    place = {name: k for k, name in enumerate(graph.names)}
    for name, value in zip(answer.names, directions.toarray()[:, 0].tolist(), strict=True):
        block, _, state = name.rpartition(".")
        if state in "xyz"[: graph.dimensions]:
            moved[place[block], "xyz".index(state)] = value
    # From the axes of each pose to those of the world.
    moved = np.einsum("nij,nj->ni", graph.rotations, moved)
    # Seen along the axis in which the graph is flattest.
    axes = np.sort(np.argsort(-np.ptp(graph.positions, axis=0), kind="stable")[:2])
    flat = graph.positions[:, axes]
    bridges = np.array([[place[a], place[b]] for a, b, _ in graph.weak_places.bridges], int)
    bridges = bridges.reshape(-1, 2)
    fig = figure(10.0, 4.4)
    left, right = fig.subplots(1, 2)
    for panel, colour, label in (
        (left, std, "bound on the position (m)"),
        (right, np.linalg.norm(moved, axis=1), "move along the weakest direction (m)"),
    ):
        panel.add_collection(LineCollection(list(flat[graph.edges]), colors="0.8", linewidths=0.4))
        panel.add_collection(LineCollection(list(flat[bridges]), colors="C3", linewidths=1.2))
        dots = panel.scatter(*flat.T, c=colour, s=6, cmap="viridis", zorder=2)
        fig.colorbar(dots, ax=panel, label=label)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel(f"{'xyz'[axes[0]]} (m)")
        panel.set_ylabel(f"{'xyz'[axes[1]]} (m)")
    step = max(1, len(flat) // 60)
    right.quiver(*flat[::step].T, *moved[::step][:, axes].T, angles="xy", width=0.003)
    return fig
