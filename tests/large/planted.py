"""Sparse problems with one known failure each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

import gramian as gm
from gramian.large import similarity_gauges


@dataclass
class Planted:
    """A problem, and what must be said of it: (kind, gauge, blocks) of each combination."""

    problem: gm.Problem
    wanted: set[tuple[str, str, frozenset[str]]]


class Rows:
    """Collects rows by names of states."""

    def __init__(self, blocks: dict[str, tuple[str, ...]]) -> None:
        self.names = [f"{block}.{state}" for block, states in blocks.items() for state in states]
        self.column = {name: j for j, name in enumerate(self.names)}
        self.entries: list[tuple[int, int, float]] = []
        self.count = 0

    def add(self, row: dict[str, float]) -> None:
        self.entries += [(self.count, self.column[name], value) for name, value in row.items()]
        self.count += 1

    def problem(self, **options: object) -> gm.Problem:
        i, j, value = np.array(self.entries).T
        shape = (self.count, len(self.names))
        rows = coo_array((value, (i.astype(int), j.astype(int))), shape=shape)
        return gm.Problem(rows, self.names, **options)


POSE = ("x", "y", "theta")


def graph(rng: np.random.Generator, poses: int, first: str = "p") -> tuple[list, list]:
    """Random places, and edges that hold all poses together in more than one way."""
    places = [rng.uniform(-50, 50, 2) for _ in range(poses)]
    edges = [(k, k + 1) for k in range(poses - 1)]
    for _ in range(poses):
        a, b = sorted(rng.choice(poses, 2, replace=False))
        edges.append((int(a), int(b)))
    return places, edges


def relative(rows: Rows, a: str, b: str, pa: np.ndarray, pb: np.ndarray, rng, axes="xy") -> None:
    """The position and attitude of b seen from a, attitudes about the world's axis."""
    d = pb - pa
    # In the world's axes; turning a by theta turns d.
    turned = {"x": d[1], "y": -d[0]}
    sigma = rng.uniform(0.01, 0.1, 3)
    for k, axis in enumerate(axes):
        row = {f"{b}.{axis}": 1.0, f"{a}.{axis}": -1.0, f"{a}.theta": turned[axis]}
        rows.add({name: value / sigma[k] for name, value in row.items()})
    rows.add({f"{b}.theta": 1 / sigma[2], f"{a}.theta": -1 / sigma[2]})


def anchor(rows: Rows, block: str, states=POSE) -> None:
    for state in states:
        rows.add({f"{block}.{state}": 10.0})


def gauges(names: list[str], places: list) -> dict[str, np.ndarray]:
    return similarity_gauges(places, [POSE] * len(names))


PLANE = ("translation along x", "translation along y", "rotation about z")


def missing_prior(rng: np.random.Generator) -> Planted:
    n = int(rng.integers(3, 40))
    places, edges = graph(rng, n)
    names = [f"p{k}" for k in range(n)]
    rows = Rows(dict.fromkeys(names, POSE))
    for a, b in edges:
        relative(rows, names[a], names[b], places[a], places[b], rng)
    return Planted(
        rows.problem(gauges=gauges(names, places)),
        {("gauge", gauge, frozenset(names)) for gauge in PLANE},
    )


def floating_component(rng: np.random.Generator) -> Planted:
    n, m = int(rng.integers(3, 30)), int(rng.integers(2, 12))
    names = [f"p{k}" for k in rng.permutation(n + m)]
    rows = Rows(dict.fromkeys(sorted(names), POSE))
    all_places = {}
    for own in (names[:n], names[n:]):
        places, edges = graph(rng, len(own))
        all_places |= dict(zip(own, places, strict=True))
        for a, b in edges:
            relative(rows, own[a], own[b], places[a], places[b], rng)
    anchor(rows, names[0])
    listed = sorted(names)
    return Planted(
        rows.problem(gauges=gauges(listed, [all_places[name] for name in listed])),
        {("gauge", gauge, frozenset(names[n:])) for gauge in PLANE},
    )


def untouched_pose(rng: np.random.Generator) -> Planted:
    n = int(rng.integers(3, 40))
    places, edges = graph(rng, n)
    names = [f"p{k}" for k in range(n)]
    rows = Rows(dict.fromkeys([*names, "lonely"], POSE))
    for a, b in edges:
        relative(rows, names[a], names[b], places[a], places[b], rng)
    anchor(rows, "p0")
    return Planted(
        rows.problem(gauges=gauges([*names, "lonely"], [*places, np.zeros(2)])),
        {("untouched", "", frozenset(["lonely"]))},
    )


def sliding_chain(rng: np.random.Generator) -> Planted:
    n, m = int(rng.integers(3, 30)), int(rng.integers(1, 10))
    places, edges = graph(rng, n)
    names = [f"p{k}" for k in range(n)]
    chain = [f"c{k}" for k in range(m)]
    rows = Rows(dict.fromkeys([*names, *chain], POSE))
    for a, b in edges:
        relative(rows, names[a], names[b], places[a], places[b], rng)
    anchor(rows, "p0")
    # Along x, nothing ties the chain to the rest; between its poses all is measured.
    chain_places = [rng.uniform(-50, 50, 2) for _ in chain]
    a = int(rng.integers(n))
    relative(rows, names[a], chain[0], places[a], chain_places[0], rng, axes="y")
    for k in range(m - 1):
        relative(rows, chain[k], chain[k + 1], chain_places[k], chain_places[k + 1], rng)
    anchored = bool(rng.integers(2)) or m == 1
    wanted = {("gauge", "translation along x", frozenset(chain))}
    if m == 1:
        wanted = {("untouched", "", frozenset(chain))}
    problem = rows.problem(gauges=gauges([*names, *chain], [*places, *chain_places]))
    if not anchored:
        problem = problem.prior({"p1.x": 1.0})
    return Planted(problem, wanted)


def sliding_and_floating(rng: np.random.Generator) -> Planted:
    """The same with no anchor at all: the whole, and the chain."""
    n, m = int(rng.integers(4, 30)), int(rng.integers(2, 10))
    places, edges = graph(rng, n)
    names = [f"p{k}" for k in range(n)]
    chain = [f"c{k}" for k in range(m)]
    rows = Rows(dict.fromkeys([*names, *chain], POSE))
    for a, b in edges:
        relative(rows, names[a], names[b], places[a], places[b], rng)
    chain_places = [rng.uniform(-50, 50, 2) for _ in chain]
    # The chain floats along x with its own attitude tied and y tied in the world's axes.
    relative(rows, names[0], chain[0], places[0], chain_places[0], rng, axes="y")
    for k in range(m - 1):
        relative(rows, chain[k], chain[k + 1], chain_places[k], chain_places[k + 1], rng)
    every = frozenset([*names, *chain])
    # Either slides along the other: the one of fewer poses is named.
    slides = chain if m <= n else names
    return Planted(
        rows.problem(gauges=gauges([*names, *chain], [*places, *chain_places])),
        {("gauge", gauge, every) for gauge in PLANE}
        | {("gauge", "translation along x", frozenset(slides))},
    )


def island_without_reference(rng: np.random.Generator) -> Planted:
    n, m = int(rng.integers(4, 60)), int(rng.integers(2, 20))
    names = [f"bus{k}" for k in range(n + m)]
    main, island = names[:n], names[n:]
    rows = Rows(dict.fromkeys(names, ("angle", "voltage")))
    for own in (main, island):
        _, edges = graph(rng, len(own))
        for a, b in edges:
            flow = rng.uniform(5, 20)
            rows.add({f"{own[a]}.angle": flow, f"{own[b]}.angle": -flow})
            rows.add({f"{own[a]}.voltage": flow, f"{own[b]}.voltage": -0.9 * flow})
        rows.add({f"{own[0]}.voltage": 100.0})
    rows.add({f"{main[0]}.angle": 100.0})
    return Planted(rows.problem(), {("shift", "angle", frozenset(island))})


def bundle_without_scale(rng: np.random.Generator) -> Planted:
    cameras, points = int(rng.integers(2, 6)), int(rng.integers(8, 30))
    camera_names = [f"cam{k}" for k in range(cameras)]
    point_names = [f"pt{k}" for k in range(points)]
    states = dict.fromkeys(camera_names, ("x", "y", "z", "rx", "ry", "rz"))
    states |= dict.fromkeys(point_names, ("x", "y", "z"))
    rows = Rows(states)
    where = {name: rng.uniform(-1, 1, 3) * [4, 4, 1] for name in camera_names}
    where |= {name: rng.uniform(-4, 4, 3) + np.array([0.0, 0.0, 12.0]) for name in point_names}
    for camera in camera_names:
        for point in point_names:
            d = where[point] - where[camera]
            u = d / np.linalg.norm(d)
            across = np.linalg.svd(u[None])[2][1:]
            for e in across:
                # The direction in the camera's axes: turned by -r.
                row = dict(zip([f"{point}.{s}" for s in "xyz"], e / np.linalg.norm(d), strict=True))
                row |= dict(
                    zip([f"{camera}.{s}" for s in "xyz"], -e / np.linalg.norm(d), strict=True)
                )
                row |= dict(zip([f"{camera}.r{s}" for s in "xyz"], -np.cross(u, e), strict=True))
                rows.add({name: 1000 * value for name, value in row.items()})
    names = [*camera_names, *point_names]
    made = similarity_gauges([where[n] for n in names], [states[n] for n in names], scale=True)
    problem = rows.problem(gauges=made)
    if rng.integers(2):
        return Planted(problem, {("gauge", gauge, frozenset(names)) for gauge in made})
    # One camera known; the scale about it is left, which is no scale about the origin.
    shifted = [where[n] - where["cam0"] for n in names]
    made = similarity_gauges(shifted, [states[n] for n in names], scale=True)
    return Planted(
        rows.problem(gauges=made).fix("cam0"), {("gauge", "scale", frozenset(names[1:]))}
    )


def confounded_biases(rng: np.random.Generator) -> Planted:
    n = int(rng.integers(3, 30))
    names = [f"t{k}" for k in range(n)]
    rows = Rows(dict.fromkeys(names, ("level",)) | {"sensor": ("offset",), "clock": ("offset",)})
    for name in names:
        rows.add({f"{name}.level": 10.0})
        # Both biases enter every measurement by the same factor.
        sigma = rng.uniform(0.05, 0.2)
        row = {f"{name}.level": 1.0, "sensor.offset": 2.0, "clock.offset": -3.0}
        rows.add({key: value / sigma for key, value in row.items()})
    return Planted(rows.problem(), {("combination", "", frozenset(["sensor", "clock"]))})


KINDS = (
    missing_prior,
    floating_component,
    untouched_pose,
    sliding_chain,
    sliding_and_floating,
    island_without_reference,
    bundle_without_scale,
    confounded_biases,
)
