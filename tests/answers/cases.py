"""One of every public answer and every other value, made by the public functions."""

from functools import cache
from pathlib import Path

import numpy as np

import gramian as gm
from gramian.io.fields import field_table
from gramian.io.g2o import read_graph

TIMES = np.arange(0.0, 600.0, 20.0)
PATH = np.array([[0.0, 0.0], [1500.0, 0.0], [1500.0, 1500.0]])
STATE = [9000.0, 4000.0, -3.0, 2.0]


def ranges(x):
    """Two ranges and their difference: what a user's own model looks like."""
    first, second = np.hypot(x[0], x[1]), np.hypot(x[0] - 100.0, x[1])
    return np.array([first, second, first - second])


def mean(measurements):
    return [measurements.mean()]


@cache
def observer():
    ship = gm.tracks.Carrier(PATH, [0.0, 300.0, 600.0])
    return ship.at(TIMES)[0]


@cache
def scene():
    ship = gm.tracks.Carrier(PATH, [0.0, 300.0, 600.0])
    sensor = gm.tracks.Sensor.bearing(ship, TIMES, sigma=0.002)
    return gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])


def spine():
    problem = gm.Problem(
        [[1.0, 2.0], [2.0, 4.0], [1.0, 0.0]],
        ["x", "v"],
        units=["m", "m/s"],
        scale=[10.0, np.nan],
        combinations={"sum": [1.0, 1.0]},
        row_error=np.full((3, 2), 1e-9),
    ).prior({"x": 5.0})
    answer = gm.analyze(problem)
    short = gm.analyze([[1.0, 2.0], [2.0, 4.0]], names=["x", "v"])
    model = gm.from_function(ranges, [30.0, 40.0], 1.0, ["east", "north"], units=["m", "m"])
    found = gm.estimate(model, ranges([31.0, 41.0]), start=[30.0, 40.0])
    yield gm.estimation.Channel("east", np.arange(3), np.arange(3.0))
    yield from (
        problem,
        problem.doubt(),
        answer,
        short,
        short.suggestions[0],
        model,
        model.accuracy,
        model.noise,
    )
    yield answer.critical(1.0)[0]
    yield answer.candidates([[0.0, 1.0]])[0]
    own = gm.bearings.BearingsModel(TIMES, observer(), np.full(TIMES.size, 0.002))
    z = own.h(STATE) + 0.002 * np.sin(TIMES)
    borne = gm.estimate(own, z, start=STATE)
    yield from (found, own, borne, borne.fit, borne.interval("x0"), borne.region(["x0", "y0"]))
    yield borne.test({"drift": TIMES / 600.0})[0]
    yield from gm.other_solutions(
        model, [30.0, 40.0], box={"east": (-200.0, 200.0), "north": (-200.0, 200.0)}
    )[:1]


def bounds():
    rows = np.array([[[1.0, 0.0]]] * 3)
    step = np.array([[[1.0, 1.0], [0.0, 1.0]]] * 2)
    bound = gm.bounds.posterior(rows, step, 0.01 * np.eye(2), np.eye(2), keep="all")
    yield from (bound, bound.last)


def thresholds():
    from gramian.bounds import Threshold, WeissWeinstein

    yield Threshold(np.array([1.0, 2.0]), np.ones((2, 2)), np.ones((2, 2)), np.array([1.5, np.inf]))
    yield WeissWeinstein(np.eye(2), np.full(2, 0.1), (0, 3))


def estimates():
    model = gm.from_function(ranges, [30.0, 40.0], 1.0, ["east", "north"])
    yield gm.estimate_trials(model, [30.0, 40.0], seed=1, trials=4)


def sparse():
    from scipy.sparse import csr_array

    problem = gm.Problem(csr_array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]]), lambda j: f"b{j}.height")
    answer = gm.analyze(problem)
    choice = gm.choose.select({f"row {i}": row[None] for i, row in enumerate(np.eye(3))}, 2)
    yield from (problem, answer, answer.suggestions[0], answer.missing[0], choice)


def bearings():
    exact = gm.bearings.BearingsModel(TIMES, observer(), np.full(TIMES.size, 0.002)).h(STATE)
    noisy = exact + 0.002 * np.sin(TIMES)
    yield gm.bearings.localize_many(TIMES, noisy, observer(), sigma=0.002)
    yield gm.bearings.localize_many(TIMES, np.stack([noisy, exact]), observer(), sigma=0.002)
    yield gm.bearings.localize_trials(TIMES, observer(), STATE, 0.002, trials=3, seed=1)
    yield gm.bearings.observability_test(TIMES, noisy, 0.002)
    yield gm.bearings.observable(TIMES, exact)
    yield gm.bearings.best_quadruple(TIMES, exact)
    monitor = gm.bearings.Monitor()
    for time, bearing in zip(TIMES, noisy, strict=True):
        answer = monitor.push(time, bearing, 0.002)
    yield from (monitor, answer)


def dipole():
    times = np.arange(-20.0, 20.0, 0.25)
    truth = ([5.0, 20.0, 3.0], [8.0, 0.0, 0.0], [100.0, 50.0, -80.0])
    field = gm.dipole.simulate(*truth, times, sigma=1e-10, seed=1)
    found = gm.dipole.localize(times, field, {"speed": 8.0})
    field[40:60, 1] = field[40, 1]
    yield gm.dipole.Description(sources=2)
    yield from (found, found.model, found.closest, gm.dipole.check_record(times, field))
    yield from gm.dipole.check_record(times, field).findings[:1]
    yield from [found.mirror] if found.mirror is not None else []
    yield gm.dipole.localize_many(times, field[None], {"speed": 8.0})
    start = dict(
        zip(
            ["x", "y", "z", "vx", "vy", "vz", "mx", "my", "mz"],
            np.c_[np.ravel(truth), np.ones(9)],
            strict=True,
        )
    )
    yield gm.dipole.track(times[:4], field[:4], start, sigma=1e-9)


def linear():
    A, C = np.array([[0.0, 1, 0], [0, 0, 0], [0, 0, -1]]), np.array([[1.0, 0, 0]])
    stable, seen = np.diag([-1.0, -2.0]), np.array([[1.0, 1.0]])
    names = ["x", "v", "b"]
    hidden = gm.linear.unobservable(A, C, names)
    yield from (gm.linear.levels(A, C, names=names), hidden, hidden.modes[0])
    yield gm.linear.batch_levels(np.zeros((4, 2, 2)), [[1.0, 1.0]])
    yield gm.linear.distance(stable, seen)
    yield gm.dynamics.lie_derivatives(
        lambda t, x: [x[1], -np.sin(x[0])], lambda t, x: [x[0]], [0.3, 0.1]
    )
    yield gm.linear.modes(np.diag([-1.0, -1.0, -3.0]), np.ones((1, 3)), near=-1.0, count=2)
    yield gm.linear.degree(stable, seen, "order", names=["a", "b"])
    yield gm.linear.information(stable, seen, names=["a", "b"], window=2.0, prior=[1, 1], dt=0.1)
    yield gm.linear.hankel(stable, np.ones((2, 1)), seen)
    yield gm.linear.split_gramian(np.diag([-1.0, 2.0]), seen)
    yield gm.linear.piecewise(np.stack([A, A]), np.stack([C, C]), [1.0, 2.0], names)


def inertial():
    leg = gm.inertial.Leg(60.0, turn=0.1)
    flight = gm.inertial.segments([leg, gm.inertial.Leg(60.0)], 0.8, speed=100.0)
    yield from (leg, flight, flight.system, gm.inertial.maneuvers(flight, dt=10.0))


def maneuver():
    target, start = [4000.0, 3000.0], [0.0, 0.0]
    path = gm.maneuver.trajectory(target, start, 10.0, 20.0, 8, sigma=0.01)
    plan = gm.maneuver.plan(target, start, 10.0, 20.0, 6, sigma=0.01, starts=2, restarts=2)
    loop = gm.maneuver.closed_loop(
        target, start, 10.0, 20.0, 6, sigma=0.01, first_range=(3000.0, 1000.0),
        methods=["max_det"], trials=2, seed=1,
    )  # fmt: skip
    yield gm.maneuver.two_legs(1e5, 10.0, 600.0, 60, sigma=0.01)
    yield gm.maneuver.Sensing("cone_angle", 0.02, blind=[(2.6, 3.7)], detection=0.9)
    yield gm.maneuver.Violation("keep_out", 1, 0, 12, 3.5)
    yield gm.maneuver.soonest(
        target, start, 10.0, 20.0, 8, accuracy=("range", 500.0), sigma=0.01, starts=2, restarts=2
    )
    yield gm.maneuver.shortest_interval(
        target, start, 10.0, 20.0, 8, sigma=0.01, starts=2, restarts=2, evaluations=4
    )
    yield from (path, plan, plan.laws[0], plan.starts[0], loop, loop.runs[0])


def registration():
    sensors, sigma = [[0.0, 0.0], [50_000.0, 0.0]], [50.0, 0.003]
    positions = np.stack([np.linspace(5e3, 40e3, 12), np.linspace(20e3, 45e3, 12)], axis=1)
    reports = gm.registration.simulate(positions, sensors, sigma, [100, 0.01, -50, 0.02], seed=1)
    found = gm.registration.estimate(reports, sensors, sigma)
    yield from (found, found.model)
    yield gm.registration.estimate(np.stack([reports.values] * 2), sensors, sigma)
    yield reports
    yield gm.registration.field(sensors, sigma, [0.0, 5e4, 1e4, 5e4], points=4)
    yield gm.registration.select({"one": positions}, sensors, sigma, budget=1)
    yield from gm.registration.singular_tracks(sensors)[:1]
    yield gm.registration.check_track(positions, sensors)
    ship = gm.registration.Platform([[0.0, 0.0], [9e3, 0.0]], [0.0, 11.0], azimuths="heading")
    moving, times = {"A": ship, "B": sensors[1]}, np.arange(12.0)
    seen = gm.registration.simulate(positions, moving, sigma, seed=1, times=times)
    yield from (ship, seen, gm.registration.estimate(seen, moving, sigma))


def tracks():
    z = gm.tracks.simulate(scene(), STATE, seed=1)
    found = gm.tracks.estimate(scene(), z)
    many = gm.tracks.estimate_many(scene(), z)
    choice = gm.tracks.choose_legs(scene(), z, most=2)
    sensor = scene().sensors[0]
    parts = (scene(), scene().motion, sensor, sensor.carrier, gm.tracks.TracksModel(scene()))
    yield from (*parts, found, many, choice)


def dynamics():
    way = gm.dynamics.from_map(
        lambda t, x: x + 0.1 * np.array([x[1], 0.0]), lambda t, x: x[:1], [1.0, 0.5],
        np.arange(12.0), ["x", "v"], sigma=0.1,
    )  # fmt: skip
    yield from (way, way.windows(5.0))


def monte_carlo():
    experiment = gm.monte_carlo.Linear(gm.Problem([[1.0, 0.0], [1.0, 1.0]], ["x", "v"]))
    result = gm.monte_carlo.run(
        experiment,
        64,
        1,
        "least_squares",
        table=True,
        quantities={"largest": np.max},
        progress=False,
    )
    yield from (result, result.nees, result.quantities["largest"])
    yield gm.monte_carlo.Failure("InputError", 2, 17, "too far")
    yield gm.monte_carlo.sweep(lambda s: experiment, {"s": [1.0, 2.0]}, 16, 1, progress=False)


def files(folder):
    path = Path(folder, "t.csv")
    lines = [f"{t},{10 * t},{5 * t}" for t in range(10)]
    path.write_text("time_s,east_m,north_m\n" + "\n".join(lines))
    recording = gm.io.read(path)
    yield from (recording, *recording.tracks.values())
    yield gm.io.table(path)
    yield gm.io.Detections("array", "t", TIMES, bearing=0.001 * TIMES)
    graph = Path(folder, "g.g2o")
    graph.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
    field = Path(folder, "field.csv")
    lines = "".join(f"{k / 10},{k},2,3\n" for k in range(30))
    field.write_text("t_s,s1_x_uT,s1_y_uT,s1_z_uT\n" + lines)
    yield field_table(field)
    poses = read_graph(graph)
    yield from (poses, poses.weak_places)


ALL = [spine, bounds, thresholds, estimates, sparse, bearings, dipole, linear, inertial, maneuver,
       registration, tracks, dynamics, monte_carlo]  # fmt: skip
