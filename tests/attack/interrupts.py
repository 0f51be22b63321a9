"""Every public function that may run long, at a size at which it does, and how soon Ctrl-C ends it.

python tests/attack/interrupts.py [NAME ...] prints the seconds from the signal to the end.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import gramian as gm

#: From the start of a call to the signal, in seconds: it is at its work by then.
BEFORE = 0.3


def _rng() -> np.random.Generator:
    return np.random.default_rng(1)


def _system(n: int, p: int = 4) -> tuple[Any, Any]:
    rng = _rng()
    return rng.normal(size=(n, n)) / np.sqrt(n) - np.eye(n), rng.normal(size=(p, n))


def _bearings(samples: int) -> dict[str, Any]:
    times = np.linspace(0.0, 200.0, samples)
    late = np.maximum(times - 100.0, 0.0)
    path = np.stack([4.0 * late, 5.0 * np.minimum(times, 100.0)], axis=1)
    return {"times": times, "observer": path, "target": [2000.0, 6000.0, 3.0, -1.0], "sigma": 0.01}


def _dipole(samples: int) -> dict[str, Any]:
    return {
        "r0": np.array([-10.0, -10.0, 5.0]),
        "v": np.array([1.0, 1.0, 0.0]),
        "m": np.array([10.0, 20.0, 10.0]),
        "times": np.linspace(0.0, 20.0, samples),
        "sigma": 1e-9,
    }


def _transition() -> Callable[[], Any]:
    A, _ = _system(1500)
    return lambda: gm.linear.transition(A, 3.0)


def _gramian() -> Callable[[], Any]:
    A, C = _system(400)
    return lambda: gm.linear.gramian(A, C, window=30.0)


def _levels() -> Callable[[], Any]:
    A, C = _system(300, 1)
    return lambda: gm.linear.levels(A, C)


def _piecewise() -> Callable[[], Any]:
    rng = _rng()
    A = rng.normal(size=(60, 150, 150)) / 12.0
    C = rng.normal(size=(60, 2, 150))
    return lambda: gm.linear.piecewise(A, C, np.ones(60))


def _analyze() -> Callable[[], Any]:
    rows = _rng().normal(size=(1500, 800))
    return lambda: gm.analyze(rows, scale=np.ones(800)).suggestions


def _sparse() -> Callable[[], Any]:
    import scipy.sparse as sp

    side = 160
    n = side * side
    at = np.arange(n).reshape(side, side)
    ends = np.concatenate(
        [
            np.stack([at[:, :-1].ravel(), at[:, 1:].ravel()], axis=1),
            np.stack([at[:-1].ravel(), at[1:].ravel()], axis=1),
        ]
    )
    rows = np.repeat(np.arange(len(ends)), 2)
    values = np.tile([1.0, -1.0], len(ends)) * np.repeat(_rng().uniform(0.5, 2.0, len(ends)), 2)
    matrix = sp.csr_matrix((values, (rows, ends.ravel())), shape=(len(ends), n))
    matrix = sp.kron(matrix, np.triu(np.ones((3, 3)))).tocsr()
    names = [f"x{i}" for i in range(3 * n)]
    return lambda: gm.analyze(gm.large.SparseProblem(matrix, names)).summary()


def _pairs() -> Callable[[], Any]:
    path = np.cumsum(_rng().normal(size=(200_000, 2)), axis=0)
    return lambda: gm.maneuver.fisher_det(path, [5e4, 5e4], 0.01, method="pairs")


def _gram(shape: tuple[int, int]) -> Callable[[], Any]:
    rows = np.ones(shape)
    return lambda: gm.gram(rows)


def _crlb_std() -> Callable[[], Any]:
    rows = _rng().normal(size=(1600, 1200))
    return lambda: gm.crlb_std(rows)


def _ranges(state: Any) -> Any:
    posts = np.stack([np.linspace(0.0, 100.0, 2000), np.sin(np.arange(2000.0))], axis=1)
    return np.hypot(*(state[:2] - posts).T)


def _estimate_trials() -> Callable[[], Any]:
    model = gm.from_function(_ranges, [30.0, 40.0], 1.0, ["east", "north"])
    return lambda: gm.estimate_trials(model, [30.0, 40.0], trials=100_000, seed=1)


def _other_solutions() -> Callable[[], Any]:
    model = gm.from_function(_slow, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    return lambda: [gm.other_solutions(model, np.zeros(6)) for _ in range(100)]


def _estimate() -> Callable[[], Any]:
    model = gm.from_function(_slow, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    return lambda: [gm.estimate(model, _slow(np.full(6, 0.3))) for _ in range(100)]


def _slow(state: Any) -> Any:
    time.sleep(1e-4)
    return np.concatenate([np.sin(3.0 * state), np.cos(2.0 * state + np.roll(state, 1)), state**2])


def _bearings_trials() -> Callable[[], Any]:
    return lambda: gm.bearings.localize_trials(**_bearings(100), trials=300_000, seed=1)


def _quadruples() -> Callable[[], Any]:
    times = np.linspace(0.0, 100.0, 1000)
    seen = np.arctan2(times, 50.0 + times**1.5)
    return lambda: gm.bearings.discriminant_sum(times, seen, method="direct")


def _dipole_trials() -> Callable[[], Any]:
    known = {"vz": 0.0}
    return lambda: gm.dipole.localize_trials(**_dipole(100), known=known, trials=20_000, seed=1)


def _dipole_localize() -> Callable[[], Any]:
    given = _dipole(100_000)
    sigma = given.pop("sigma")
    field = gm.dipole.measure(**given)
    field += sigma * _rng().normal(size=field.shape)
    known = {"vz": 0.0}
    return lambda: gm.dipole.localize(given["times"], field, known, sigma=sigma, starts=100)


def _registration_trials() -> Callable[[], Any]:
    return lambda: gm.registration.estimate_trials(
        np.stack([np.linspace(10e3, 50e3, 100), np.linspace(80e3, 60e3, 100)], axis=1),
        [[0.0, 0.0], [60e3, 0.0]],
        [[50.0, 0.002], [50.0, 0.002]],
        np.zeros(4),
        seed=1,
        trials=100_000,
    )


def _planned(function: Callable[..., Any], **options: Any) -> Callable[[], Any]:
    """Plan for long, and raise what ended it: the best path so far is the answer."""

    def work() -> None:
        with warnings.catch_warnings():
            # That it was interrupted is said in a warning.
            warnings.simplefilter("ignore")
            found = function(
                [0.0, 2000.0, 1.0, 1.0],
                np.zeros(2),
                speed=5.0,
                dt=5.0,
                samples=400,
                sigma=0.01,
                legs=8,
                **options,
            )
        if found.stopped == "interrupted":
            raise KeyboardInterrupt

    return work


def _plan() -> Callable[[], Any]:
    return _planned(gm.maneuver.plan, criterion="D", starts=200)


def _shortest_interval() -> Callable[[], Any]:
    return _planned(gm.maneuver.shortest_interval, starts=2, restarts=0, evaluations=100_000)


def _soonest() -> Callable[[], Any]:
    return _planned(gm.maneuver.soonest, accuracy=("range", 5.0), starts=200)


def _closed_loop() -> Callable[[], Any]:
    return lambda: gm.maneuver.closed_loop(
        [0.0, 2000.0],
        np.zeros(2),
        speed=5.0,
        dt=20.0,
        samples=2000,
        sigma=0.01,
        first_range=(1500.0, 500.0),
        methods=("max_det",),
        trials=5_000,
        seed=1,
    )


def _interval() -> Callable[[], Any]:
    model = gm.from_function(_slow, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    found = gm.estimate(model, _slow(np.full(6, 0.3)), starts=2)
    return lambda: [found.interval("x0", level) for level in np.linspace(0.5, 0.99, 100)]


def _region() -> Callable[[], Any]:
    given = _bearings(2000)
    seen = gm.bearings.simulate(**given, seed=1)
    found = gm.bearings.localize(given["times"], seen, given["observer"], 0.01)
    return lambda: [found.region(("x0", "y0"), level) for level in np.linspace(0.5, 0.99, 1000)]


def _scene() -> tuple[Any, Any]:
    given = _bearings(400)
    ship = gm.tracks.Carrier(given["observer"], given["times"])
    sensor = gm.tracks.Sensor.bearing(ship, given["times"], sigma=0.002)
    scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    return scene, gm.tracks.simulate(scene, given["target"], seed=1)


def _choose_legs() -> Callable[[], Any]:
    scene, seen = _scene()
    return lambda: [gm.tracks.choose_legs(scene, [seen], most=4) for _ in range(30)]


def _leg_penalty() -> Callable[[], Any]:
    scene, _ = _scene()
    legs = scene.with_motion(gm.tracks.Motion.legs(count=1))
    return lambda: gm.tracks.leg_penalty(legs, [2000.0, 6000.0, 3.0, -1.0], trials=20_000)


def _track_estimate() -> Callable[[], Any]:
    scene, seen = _scene()
    legs = scene.with_motion(gm.tracks.Motion.legs(count=3))
    return lambda: [gm.tracks.estimate(legs, [seen], polish=64, search=False) for _ in range(300)]


_PRIOR = {f"x{i}": (0.3, 1.0) for i in range(6)}


def _threshold(function: Callable[[Any], Any], samples: int) -> Callable[[], Any]:
    model = gm.from_function(function, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    noise = np.geomspace(0.1, 10.0, 20)
    return lambda: gm.bounds.threshold(model, _PRIOR, np.eye(6), noise, samples=samples)


def _weiss_weinstein(function: Callable[[Any], Any], samples: int) -> Callable[[], Any]:
    model = gm.from_function(function, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    vectors = _rng().normal(size=(40, 6))
    return lambda: gm.bounds.weiss_weinstein(model, _PRIOR, vectors, samples=samples)


def _barankin() -> Callable[[], Any]:
    model = gm.from_function(_slow, np.zeros(6), 1.0, [f"x{i}" for i in range(6)])
    points = 0.1 * _rng().normal(size=(3000, 6))
    return lambda: gm.bounds.barankin(model, np.full(6, 0.3), points)


def _native() -> Any:
    given = _bearings(2000)
    return gm.bearings.BearingsModel(given["times"], given["observer"], np.array([0.01]))


_WHERE = {"x0": (2e3, 5e2), "y0": (6e3, 5e2), "vx": (3.0, 1.0), "vy": (-1.0, 1.0)}


def _threshold_native() -> Callable[[], Any]:
    model, noise, vectors = _native(), np.geomspace(0.1, 10.0, 20), 100.0 * np.eye(4)
    return lambda: gm.bounds.threshold(model, _WHERE, vectors, noise, samples=20_000)


def _weiss_weinstein_native() -> Callable[[], Any]:
    model, vectors = _native(), _rng().normal(size=(40, 4)) * [1e3, 1e3, 1.0, 1.0]
    return lambda: gm.bounds.weiss_weinstein(model, _WHERE, vectors, samples=20_000)


def _barankin_native() -> Callable[[], Any]:
    model, truth = _native(), np.array([2e3, 6e3, 3.0, -1.0])
    points = truth + _rng().normal(size=(2500, 4))
    return lambda: gm.bounds.barankin(model, truth, points)


def _registration_estimate(samples: int, method: Any) -> Callable[[], Any]:
    places = np.linspace([10e3, 80e3], [50e3, 60e3], samples)
    sensors, sigma = [[0.0, 0.0], [60e3, 0.0]], [[50.0, 0.002], [50.0, 0.002]]
    reports = gm.registration.simulate(places, sensors, sigma, seed=1).values
    prior = np.array([1e3, 0.1, 1e3, 0.1])
    return lambda: [
        gm.registration.estimate(reports, sensors, sigma, method=method, prior=prior)
        for _ in range(100)
    ]


def _dipole_sources() -> Callable[[], Any]:
    given = _dipole(2000)
    sigma = given.pop("sigma")
    other = given | {"r0": given["r0"] + [1.5, -1.0, 0.0], "m": np.array([5.0, -9.0, 20.0])}
    field = gm.dipole.measure(**given) + gm.dipole.measure(**other)
    field += sigma * _rng().normal(size=field.shape)
    known = {"vz": 0.0}
    return lambda: [
        gm.dipole.localize(given["times"], field, known, sigma=sigma, sources=3) for _ in range(5)
    ]


def _dipole_motion() -> Callable[[], Any]:
    given = _dipole(4000)
    sigma = given.pop("sigma")
    field = gm.dipole.measure(**given)
    field += sigma * _rng().normal(size=field.shape)
    known = {"vz": 0.0}
    return lambda: [
        gm.dipole.localize(given["times"], field, known, sigma=sigma, motion="turning")
        for _ in range(20)
    ]


def _distance() -> Callable[[], Any]:
    A, C = _system(60, 1)
    return lambda: gm.linear.distance(A, C, certify=True)


def _unobservable() -> Callable[[], Any]:
    A, C = _system(500, 1)
    return lambda: gm.linear.unobservable(A, C)


def _hankel() -> Callable[[], Any]:
    A, C = _system(500, 1)
    return lambda: gm.linear.hankel(A - np.eye(500), C.T, C)


def _gramian_factor() -> Callable[[], Any]:
    A, C = _system(700, 1)
    return lambda: gm.linear.gramian_factor(A - np.eye(700), C)


def _decay(t: Any, x: Any) -> Any:
    time.sleep(1e-5)
    return np.array([x[1], -x[0]])


def _from_ode() -> Callable[[], Any]:
    return lambda: gm.dynamics.from_ode(
        _decay, lambda t, x: x[:1] ** 2, [1.0, 0.5], np.arange(20_000.0), ["a", "b"]
    )


def _empirical() -> Callable[[], Any]:
    return lambda: gm.dynamics.empirical_gramian(
        _decay, lambda t, x: x[:1] ** 2, [1.0, 0.5], np.arange(20_000.0), step=0.1
    )


def _from_map() -> Callable[[], Any]:
    return lambda: gm.dynamics.from_map(
        lambda t, x: _decay(t, x) * 0.99,
        lambda t, x: x[:1] ** 2,
        [1.0, 0.5],
        np.arange(200_000.0),
        ["a", "b"],
    )


def _from_function() -> Callable[[], Any]:
    def h(x: Any) -> Any:
        time.sleep(1e-4)
        return np.sin(np.outer(np.arange(300.0), np.ones(300)) @ x)

    return lambda: gm.from_function(h, np.ones(300), 1.0, [f"x{i}" for i in range(300)]).rows()


def _two_legs() -> Callable[[], Any]:
    return lambda: [
        gm.maneuver.two_legs(50e3, 5.0, 600.0, 100_000, sigma=0.01) for _ in range(10_000)
    ]


def _check_record() -> Callable[[], Any]:
    given = _dipole(500_000)
    field = gm.dipole.simulate(**given, seed=1)
    return lambda: gm.dipole.check_record(given["times"], field)


def _field() -> Callable[[], Any]:
    return lambda: gm.registration.field(
        [[0.0, 0.0], [60e3, 0.0]],
        [[50.0, 0.002], [50.0, 0.002]],
        [0.0, 60e3, 10e3, 90e3],
        2000.0,
        points=3000,
    )


def _maneuvers() -> Callable[[], Any]:
    flight = gm.inertial.segments([gm.inertial.Leg(600.0)] * 80, 0.7, speed=50.0, step=2.0)
    return lambda: gm.inertial.maneuvers(flight, dt=1.0)


def _monte_carlo() -> Callable[[], Any]:
    problem = gm.Problem(_rng().normal(size=(60, 30)), [f"x{i}" for i in range(30)])
    return lambda: gm.monte_carlo.run(problem, trials=20_000_000, seed=1, progress=False)


def _normals() -> Callable[[], Any]:
    return lambda: [gm.monte_carlo.normals(1, 0, 1_000_000, 60) for _ in range(40)]


def _select() -> Callable[[], Any]:
    rows = _rng().normal(size=(20_000, 2, 40))
    return lambda: gm.choose.select(list(rows), 60, "A")


def _posterior() -> Callable[[], Any]:
    rows = _rng().normal(size=(20_000, 2, 40))
    return lambda: gm.bounds.posterior(rows, np.eye(40), np.eye(40), np.eye(40), keep="std")


#: By the name of what runs: makes its inputs and returns the call.
CASES: dict[str, Callable[[], Callable[[], Any]]] = {
    "linear.transition": _transition,
    "linear.gramian": _gramian,
    "linear.levels": _levels,
    "linear.piecewise": _piecewise,
    "analyze": _analyze,
    "large.analyze_sparse": _sparse,
    "maneuver.fisher_det": _pairs,
    "maneuver.plan": _plan,
    "maneuver.soonest": _soonest,
    "maneuver.shortest_interval": _shortest_interval,
    "maneuver.closed_loop": _closed_loop,
    "gram of many rows": lambda: _gram((5_000_000, 30)),
    "gram of many states": lambda: _gram((4000, 4000)),
    "crlb_std": _crlb_std,
    "estimate": _estimate,
    "estimate_trials": _estimate_trials,
    "other_solutions": _other_solutions,
    "Estimate.interval": _interval,
    "Estimate.region": _region,
    "tracks.choose_legs": _choose_legs,
    "tracks.leg_penalty": _leg_penalty,
    "tracks.estimate": _track_estimate,
    "bounds.threshold": _threshold_native,
    "bounds.threshold of a Python h": lambda: _threshold(_slow, 4096),
    "bounds.weiss_weinstein": _weiss_weinstein_native,
    "bounds.weiss_weinstein of a Python h": lambda: _weiss_weinstein(_slow, 4096),
    "bounds.barankin": _barankin_native,
    "bounds.barankin of a Python h": _barankin,
    "registration.estimate": lambda: _registration_estimate(20_000, "ml"),
    "registration.estimate, gls": lambda: _registration_estimate(20_000, "gls"),
    "registration.field": _field,
    "dipole.localize of several sources": _dipole_sources,
    "dipole.localize with a turn": _dipole_motion,
    "dipole.check_record": _check_record,
    "linear.distance": _distance,
    "linear.unobservable": _unobservable,
    "linear.hankel": _hankel,
    "linear.gramian_factor": _gramian_factor,
    "dynamics.from_ode": _from_ode,
    "dynamics.from_map": _from_map,
    "dynamics.empirical_gramian": _empirical,
    "from_function": _from_function,
    "inertial.maneuvers": _maneuvers,
    "bearings.localize_trials": _bearings_trials,
    "bearings.discriminant_sum": _quadruples,
    "dipole.localize": _dipole_localize,
    "dipole.localize_trials": _dipole_trials,
    "registration.estimate_trials": _registration_trials,
    "monte_carlo.run": _monte_carlo,
    "monte_carlo.normals": _normals,
    "choose.select": _select,
    "bounds.posterior": _posterior,
}


class Interrupted:
    """A process that calls what it is told, and is interrupted."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Interrupted:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def seconds(self, name: str, patience: float = 30.0) -> float:
        """Return how long a call takes to end after the signal; raise where it ends otherwise."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, __file__, "--serve"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
            )
        process = self._process
        assert process.stdin is not None
        print(name, file=process.stdin, flush=True)
        self._expect("begins", 120.0)
        time.sleep(BEFORE)
        sent = time.monotonic()
        os.kill(process.pid, signal.SIGINT)
        self._expect("interrupted", patience)
        return time.monotonic() - sent

    def _expect(self, word: str, patience: float) -> None:
        assert self._process is not None
        stdout = self._process.stdout
        assert stdout is not None
        ready, _, _ = select.select([stdout], [], [], patience)
        line = stdout.readline().strip() if ready else f"silence for {patience} s"
        if line != word:
            self.__exit__()
            raise AssertionError(f"{word!r} is expected, there is {line!r}")


def _serve() -> None:
    # A shell that starts this in the background has the signal ignored, and children inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for line in sys.stdin:
        call = CASES[line.strip()]()
        try:
            print("begins", flush=True)
            call()
            print("ended before the signal: make it longer", flush=True)
            time.sleep(2 * BEFORE)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        except Exception as error:
            print(f"{type(error).__name__}: {error}".replace("\n", " "), flush=True)
            os._exit(1)


def main() -> None:
    """Print a line for each."""
    with Interrupted() as child:
        for name in sys.argv[1:] or CASES:
            try:
                print(f"{name:32s} {child.seconds(name):6.2f} s", flush=True)
            except AssertionError as error:
                print(f"{name:32s} {error}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["--serve"]:
        _serve()
    else:
        main()
