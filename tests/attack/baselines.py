"""A call that works for every public function: what the attack starts from.

Each entry gives the arguments by name; `*` holds positional ones that have none.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import gramian as gm

T = np.arange(0.0, 200.0, 20.0)
PATH = np.stack([np.where(T < 100, 0.0, 4 * (T - 100)), 5 * np.minimum(T, 100.0)], axis=1)
STATE = np.array([2000.0, 6000.0, 3.0, -1.0])
SEEN = np.arctan2(*(STATE[:2] + T[:, None] * STATE[2:] - PATH).T)
ROWS = np.random.default_rng(1).normal(size=(6, 3))
PASS = {
    "r0": np.array([-10.0, -10.0, 5.0]),
    "v": np.array([1.0, 1.0, 0.0]),
    "m": np.array([10.0, 20.0, 10.0]),
}
PASS_TIMES = np.linspace(0.0, 20.0, 41)
FIELD = gm.dipole.measure(*PASS.values(), PASS_TIMES)
A2 = np.array([[0.0, 1.0], [0.0, 0.0]])
C2 = np.array([[1.0, 0.0]])
SENSORS = np.array([[0.0, 0.0], [60e3, 0.0]])
SIGMA2 = np.array([[50.0, 0.002], [50.0, 0.002]])
PLACES = np.stack([np.linspace(10e3, 50e3, 8), np.linspace(80e3, 60e3, 8)], axis=1)
REPORTS = gm.registration.simulate(PLACES, SENSORS, SIGMA2, seed=1)
LOOKS = np.arange(8.0)
FLEET = {
    "A": SENSORS[0],
    "B": gm.registration.Platform(SENSORS + 500.0, [0.0, 7.0], azimuths="heading"),
}


def _ranges(x: Any) -> Any:
    return np.array([np.hypot(x[0], x[1]), np.hypot(x[0] - 100.0, x[1])])


def _linear() -> Any:
    return gm.Problem(ROWS, ["x", "y", "z"])


MODEL = gm.from_function(
    _ranges, [30.0, 40.0], [1.0, 2.0], ["east", "north"], units=["m", "m"], scale=[100.0, 100.0]
)
MODEL_PRIOR = {"east": (30.0, 20.0), "north": (40.0, 20.0)}
SHIP = gm.tracks.Carrier(PATH, T)
SCENE = gm.tracks.Scene(
    gm.tracks.Motion.constant_velocity(), [gm.tracks.Sensor.bearing(SHIP, T, sigma=0.01)]
)
BAY = Path(gm.__file__).parent / "demo" / "bay.csv"
_FOLDER = tempfile.TemporaryDirectory(prefix="attack-")
SAVED = Path(_FOLDER.name) / "answer.json"
gm.analyze(ROWS).save(SAVED)


def _decay(t: Any, x: Any) -> Any:
    return np.array([x[1], -0.5 * x[0]])


def _seen(t: Any, x: Any) -> Any:
    return np.array([x[0] ** 2 + x[1]])


def _sparse() -> Any:
    triplets = ([1.0, -1.0, 1.0, -1.0, 0.5], ([0, 0, 1, 1, 2], [0, 1, 1, 2, 0]))
    return gm.large.SparseProblem(triplets, ["a", "b", "c"])


def _answer() -> Any:
    return gm.bearings.localize(T, SEEN, PATH, 0.01)


def _path() -> Any:
    return gm.dynamics.from_map(_decay, _seen, [1.0, 2.0], np.arange(4.0), ["a", "b"])


#: What both estimators of tracks take.
TRACK_ESTIMATE = {
    "scene": SCENE,
    "measurements": [SEEN],
    "prior": {"x0": (2000.0, 500.0)},
    "known": {},
    "loss": "huber",
    "constant": 1.5,
    "start": STATE,
    "alpha": 0.001,
    "weak_ratio": 0.25,
    "max_iterations": 20,
    "polish": 1,
    "rtol": 1e-9,
}

#: By the name under `gramian`: what is called, and its arguments.
CALLS: dict[str, dict[str, Any]] = {
    "Problem": {
        "rows": ROWS,
        "names": ["x", "y", "z"],
        "units": ["m", "m", "s"],
        "scale": np.array([1.0, 2.0, np.nan]),
        "rtol": 1e-9,
        "combinations": {"sum": np.array([1.0, 1.0, 0.0])},
    },
    "analyze": {
        "problem_or_rows": ROWS,
        "names": ["x", "y", "z"],
        "scale": np.array([1.0, 2.0, 3.0]),
        "prior": {"x": 0.5},
        "weak_ratio": 1.0,
        "weak_condition": 1e8,
        "rtol": 1e-9,
    },
    "crlb": {"rows_or_problem": ROWS, "prior": np.array([1.0, 2.0, 3.0])},
    "crlb_std": {"rows_or_problem": ROWS, "prior": np.array([1.0, 2.0, np.inf])},
    "from_function": {
        "h": _ranges,
        "x": np.array([30.0, 40.0]),
        "sigma": np.array([1.0, 2.0]),
        "names": ["east", "north"],
        "method": "central",
        "units": ["m", "m"],
        "scale": np.array([10.0, 10.0]),
        "combinations": {"sum": np.array([1.0, 1.0])},
    },
    "gram": {"rows": ROWS, "weights": np.ones(6)},
    "set_threads": {"threads": 0},
    "bounds.cubature_points": {"mean": np.zeros(2), "covariance": np.eye(2)},
    "bounds.expected_rows": {"rows": np.ones((3, 4, 2)), "weights": np.ones(3) / 3},
    "bounds.expected_transition": {
        "transitions": np.stack([np.eye(2), 2 * np.eye(2)]),
        "process_noise": np.eye(2),
        "weights": np.ones(2) / 2,
    },
    "bounds.posterior": {
        "rows": np.ones((4, 1, 2)) + np.arange(8.0).reshape(4, 1, 2),
        "transition": np.array([[1.0, 1.0], [0.0, 1.0]]),
        "process_noise": 0.01 * np.eye(2),
        "prior": np.eye(2),
        "detection": 0.9,
        "keep": "std",
    },
    "io.unix_seconds": {"date": "2020-01-01T00:00:00"},
    "io.utc": {"seconds": 1.5e9},
    "monte_carlo.normals": {"seed": 1, "first": 0, "trials": 3, "count": 4},
    "monte_carlo.Linear": {"of": _linear()},
    "monte_carlo.Measurements": {
        "of": gm.from_function(_ranges, [30.0, 40.0], 1.0, ["east", "north"], units=["m", "m"]),
    },
    "monte_carlo.Bearings": {
        "times": T,
        "observer": PATH,
        "target": STATE,
        "sigma": 0.01,
        "prior": {"x0": 1000.0},
    },
    "monte_carlo.Dipole": {**PASS, "times": PASS_TIMES, "sigma": 1e-9, "known": ("vz",)},
    "monte_carlo.Registration": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "times": LOOKS,
    },
    "monte_carlo.run": {"problem": _linear(), "trials": 20, "seed": 1, "progress": False},
    "monte_carlo.sweep": {
        "scenario": lambda size: gm.Problem(ROWS * size, ["x", "y", "z"]),
        "parameters": {"size": np.array([1.0, 2.0])},
        "trials": 10,
        "seed": 1,
        "progress": False,
    },
    "bearings.best_quadruple": {"times": T, "bearings": SEEN},
    "bearings.discriminant": {"times": T[:4], "bearings": SEEN[:4], "form": "15"},
    "bearings.discriminant_sum": {
        "times": T,
        "bearings": SEEN,
        "weights": np.ones(T.size),
        "method": "direct",
        "order": 1,
    },
    "bearings.gram": {"times": T, "bearings": SEEN, "weights": np.ones(T.size)},
    "bearings.gram_det": {"times": T, "bearings": SEEN, "weights": np.ones(T.size)},
    "bearings.localize_many": {
        "times": T,
        "bearings": SEEN,
        "observer": PATH,
        "sigma": 0.01,
        "prior": {"x0": (2000.0, 500.0)},
        "order": 1,
        "observer_index": np.zeros(T.size, dtype=int),
        "weak_ratio": 0.25,
        "max_iterations": 30,
        "rtol": 1e-9,
    },
    "bearings.localize_trials": {
        "times": T,
        "observer": PATH,
        "target": STATE,
        "sigma": 0.01,
        "trials": 3,
        "seed": 1,
        "first": 0,
        "prior": {"x0": (2000.0, 500.0)},
    },
    "bearings.merge": {"*": ([T, PATH], [T + 5.0, PATH])},
    "bearings.observability_test": {"times": T, "bearings": SEEN, "sigma": 0.01, "level": 0.05},
    "bearings.observable": {"times": T, "bearings": SEEN, "accuracy": 1e-6},
    "bearings.problem": {"times": T, "observer": PATH, "target": STATE, "sigma": 0.01, "order": 1},
    "bearings.residuals": {"times": T, "bearings": SEEN, "observer": PATH, "state": STATE},
    "bearings.rows": {
        "times": T,
        "observer": np.column_stack([PATH, np.zeros(T.size)]),
        "target": np.array([2000.0, 6000.0, 300.0, 3.0, -1.0, 0.5]),
        "sigma": np.full(T.size, 0.01),
        "order": 1,
        "observer_index": np.zeros(T.size, dtype=int),
        "sigma_elevation": np.full(T.size, 0.01),
        "detection": 0.9,
    },
    "bearings.simulate": {
        "times": T,
        "observer": PATH,
        "target": STATE,
        "sigma": 0.01,
        "seed": 1,
        "trials": 3,
    },
    "bearings.state_names": {"order": 1, "dimensions": 2},
    "dipole.equivalents": {**PASS, "scale": 2.0},
    "dipole.field": {"position": np.array([1.0, 2.0, 3.0]), "moment": np.array([1.0, 0.0, 0.0])},
    "dipole.fisher": {**PASS, "times": PASS_TIMES, "sigma": 1e-9},
    "dipole.jacobian": {"position": np.array([1.0, 2.0, 3.0]), "moment": np.ones(3)},
    "dipole.track": {
        "times": PASS_TIMES,
        "field": FIELD,
        "start": {
            name: (value, sigma)
            for name, value, sigma in zip(
                ("x", "y", "z", "vx", "vy", "vz", "mx", "my", "mz"),
                (*PASS["r0"], *PASS["v"], *PASS["m"]),
                (*[0.5] * 3, *[0.1] * 3, *[0.5] * 3),
                strict=True,
            )
        },
        "sigma": 1e-9,
        "acceleration": 1e-4,
    },
    "dipole.localize": {
        "times": PASS_TIMES,
        "field": FIELD,
        "known": {"vz": 0.0},
        "prior": {"z0": (5.0, 1.0)},
        "loss": "gaussian",
        "sigma": 1e-9,
        "missing": "raise",
        "use": np.ones((1, 3), dtype=bool),
        "correlation": 0.2,
        "starts": 2,
    },
    "dipole.localize_many": {
        "times": PASS_TIMES,
        "field": FIELD[None],
        "known": {"vz": 0.0},
        "sigma": 1e-9,
        "starts": 2,
    },
    "dipole.localize_trials": {
        **PASS,
        "baselines": np.array([0.0, 0.0, 1.0]),
        "times": PASS_TIMES,
        "sigma": 1e-9,
        "seed": 1,
        "trials": 2,
        "known": {"vz": 0.0},
        "first": 0,
        "starts": 2,
    },
    "dipole.measure": {**PASS, "times": PASS_TIMES, "ambient": np.array([2e-5, 0.0, 4e-5])},
    "dipole.moment": {
        "permanent": np.ones(3),
        "attitude": np.eye(3),
        "induced_volume": 2.0,
        "earth_field": np.array([2e-5, 0.0, 4e-5]),
    },
    "dipole.problem": {**PASS, "times": PASS_TIMES, "sigma": 1e-9, "scale": np.ones(9)},
    "dipole.rows": {
        **PASS,
        "times": PASS_TIMES,
        "sigma": 1e-9,
        "sensors": np.zeros((1, 3)),
        "baselines": np.ones((1, 3)),
    },
    "dipole.simulate": {**PASS, "times": PASS_TIMES, "sigma": 1e-9, "seed": 1, "trials": 2},
    "inertial.Leg": {"duration": 60.0, "turn": 0.5, "speed_change": 1.0, "bank": 0.1},
    "inertial.error_model": {
        "latitude": 0.7,
        "height": 100.0,
        "specific_force": np.array([0.0, 0.0, 9.8]),
        "velocity": np.array([10.0, 0.0, 0.0]),
        "attitude": np.eye(3),
        "lever_arm": np.zeros(3),
        "estimated": ("lever_arm", "gyro_scale"),
        "outputs": ("velocity", "heading"),
    },
    "inertial.gravity": {"latitude": 0.7, "height": 100.0},
    "inertial.maneuvers": {
        "flight": gm.inertial.segments([gm.inertial.Leg(20.0)], 0.7, speed=50.0),
        "legs": ["straight"],
        "dt": 5.0,
    },
    "inertial.radii": {"latitude": 0.7},
    "inertial.recorded": {
        "times": np.arange(5.0),
        "velocity": np.tile([50.0, 0.0, 0.0], (5, 1)),
        "attitude": np.zeros((5, 3)),
        "latitude": 0.7,
        "height": 100.0,
        "legs": [2.0],
        "longitude": 0.1,
        "step": 1.0,
    },
    "inertial.sway": {
        "duration": 5.0,
        "latitude": 0.7,
        "height": 100.0,
        "amplitude": np.array([0.01, 0.02, 0.03]),
        "period": np.array([9.0, 7.0, 8.0]),
        "phase": np.zeros(3),
        "heading": 0.5,
        "velocity": np.zeros(3),
        "step": 1.0,
    },
    "inertial.rotation": {"heading": 0.5, "pitch": 0.1, "roll": 0.1},
    "inertial.segments": {
        "legs": (gm.inertial.Leg(60.0), gm.inertial.Leg(60.0, turn=0.5)),
        "latitude": 0.7,
        "height": 100.0,
        "speed": 50.0,
        "heading": 0.5,
        "longitude": 0.1,
        "step": 30.0,
    },
    "inertial.visual_inertial": {
        "times": np.linspace(0.0, 0.4, 5),
        "gyro": np.full((5, 3), 0.1),
        "accel": np.tile([0.3, 0.2, 9.9], (5, 1)),
        "landmarks": np.array([[9.0, 1.0, 2.0], [8.0, -2.0, 1.0]]),
        "velocity": np.array([0.1, 0.2, 0.0]),
        "position": np.zeros(3),
        "attitude": np.array([1.0, 0.0, 0.0, 0.0]),
        "camera": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
        "arm": np.array([0.1, 0.0, 0.0]),
        "gravity": np.array([0.0, 0.0, -9.8]),
        "unknown": ("camera_arm", "landmarks"),
        "sigma": 1e-3,
        "rtol": 1e-9,
        "max_steps": 1000,
    },
    "inertial.static_base": {"latitude": 0.7, "height": 100.0},
    "linear.System": {
        "A": A2,
        "C": C2,
        "names": ("x", "v"),
        "units": ("m", "m/s"),
        "prior": np.ones(2),
        "outputs": ("place",),
        "noise": np.ones(1),
    },
    "linear.batch_levels": {"A": A2, "C": C2, "rtol": 1e-9},
    "linear.degree": {
        "A": A2,
        "C": C2,
        "method": "information",
        "names": ["x", "v"],
        "window": 2.0,
        "dt": 0.5,
        "R": np.eye(1),
        "prior": np.ones(2),
    },
    "linear.gramian": {"A": A2, "C": C2, "window": 2.0, "R": np.eye(1)},
    "linear.information": {
        "A": A2,
        "C": C2,
        "window": 2.0,
        "dt": 0.5,
        "R": np.eye(1),
        "prior": np.ones(2),
        "names": ["x", "v"],
    },
    "linear.levels": {
        "A": A2,
        "C": C2,
        "names": ["x", "v"],
        "combinations": {"sum": np.ones(2)},
        "rtol": 1e-9,
    },
    "linear.observability_matrix": {"A": A2, "C": C2, "order": 2},
    "linear.piecewise": {
        "A": np.stack([A2, 2 * A2]),
        "C": np.stack([C2, C2]),
        "durations": np.array([1.0, 2.0]),
        "names": ["x", "v"],
        "rtol": 1e-9,
    },
    "linear.problem": {
        "A": A2,
        "C": C2,
        "window": 2.0,
        "dt": 0.5,
        "R": np.eye(1),
        "names": ["x", "v"],
        "units": ["m", "m/s"],
    },
    "linear.rows": {"A": A2, "C": C2, "window": 2.0, "dt": 0.5, "R": np.eye(1)},
    "linear.transition": {"A": A2, "duration": 2.0},
    "registration.check_track": {"positions": PLACES, "sensors": SENSORS, "tolerance": 1.0},
    "registration.Platform": {
        "path": PATH,
        "times": T,
        "heading": np.zeros(T.size),
        "azimuths": "heading",
    },
    "registration.degree": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "method": "eta",
        "times": LOOKS,
    },
    "registration.estimate": {
        "reports": REPORTS.values,
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "method": "ml",
        "prior": np.full(4, 100.0),
        "iterations": 5,
        "tolerance": 1e-6,
        "on_failure": "report",
    },
    "registration.estimate_trials": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
        "seed": 1,
        "trials": 2,
        "first": 0,
        "times": LOOKS,
    },
    "registration.eta": {"positions": PLACES, "sensors": SENSORS, "sigma": SIGMA2},
    "registration.field": {
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "extent": np.array([0.0, 60e3, 10e3, 90e3]),
        "radius": 2000.0,
        "quantity": "eta",
        "points": 3,
    },
    "registration.fisher": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
        "times": LOOKS,
    },
    "registration.gauges": {"sensors": FLEET, "extras": (), "times": LOOKS},
    "registration.match": {
        "recordings": {
            "A": (np.arange(8.0), REPORTS.values[:, 0]),
            "B": (np.arange(8.0), REPORTS.values[:, 1]),
        },
        "interpolate": "linear",
        "tolerance": 0.1,
        "max_gap": 5.0,
    },
    "registration.problem": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "scale": {"A.range": 10.0},
        "times": LOOKS,
    },
    "registration.rows": {
        "positions": PLACES,
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
    },
    "registration.select": {
        "tracks": {"one": PLACES, "two": PLACES + 3e3},
        "sensors": FLEET,
        "sigma": SIGMA2,
        "budget": 1,
        "prior": np.full(4, 100.0),
        "times": {"one": LOOKS, "two": LOOKS},
    },
    "registration.simulate": {
        "positions": PLACES,
        "sensors": FLEET,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
        "seed": 1,
        "trials": 2,
        "times": LOOKS,
    },
    "registration.singular_tracks": {"sensors": SENSORS},
    "maneuver.closed_loop": {
        "target": np.array([0.0, 2000.0]),
        "start": np.zeros(2),
        "speed": 5.0,
        "dt": 20.0,
        "samples": 6,
        "sigma": 0.01,
        "first_range": (1500.0, 500.0),
        "methods": ("max_det",),
        "trials": 2,
        "seed": 1,
    },
    "maneuver.fisher": {"path": PATH, "target": STATE, "sigma": 0.01, "times": T},
    "maneuver.fisher_and_det": {"path": PATH, "target": STATE, "sigma": 0.01, "times": T},
    "maneuver.fisher_det": {"path": PATH, "target": STATE, "sigma": 0.01, "times": T},
    "maneuver.heading": {"bearing": 0.3, "range_": 1000.0, "step": 10.0, "law": "max_det"},
    "maneuver.plan": {
        "target": np.array([0.0, 2000.0]),
        "start": np.zeros(2),
        "speed": 5.0,
        "dt": 20.0,
        "samples": 5,
        "sigma": 0.01,
        "criterion": "D",
        "legs": 2,
        "starts": 1,
        "restarts": 0,
        "bound": False,
    },
    "maneuver.scene": {"path": PATH, "sensors": 0.01, "times": T, "order": 1},
    "maneuver.soonest": {
        "target": np.array([0.0, 2000.0]),
        "start": np.zeros(2),
        "speed": 5.0,
        "dt": 20.0,
        "samples": 6,
        "accuracy": ("range", 300.0),
        "sigma": 0.01,
        "starts": 1,
        "restarts": 0,
        "bound": False,
    },
    "maneuver.shortest_interval": {
        "target": np.array([0.0, 2000.0]),
        "start": np.zeros(2),
        "speed": 5.0,
        "dt": 20.0,
        "samples": 6,
        "name": "range",
        "sigma": 0.01,
        "evaluations": 4,
        "starts": 1,
        "restarts": 0,
    },
    "maneuver.Sensing": {"kind": "bearing", "sigma": 0.01, "detection": 0.9},
    "maneuver.problem": {"path": PATH, "target": STATE, "sigma": 0.01, "times": T},
    "maneuver.trajectory": {
        "target": np.array([0.0, 2000.0]),
        "start": np.zeros(2),
        "speed": 5.0,
        "dt": 20.0,
        "samples": 6,
        "law": "max_det",
        "side": 1,
        "sigma": 0.01,
        "standoff": 100.0,
    },
    "estimate": {
        "model": MODEL,
        "measurements": np.array([49.5, 81.0]),
        "start": np.array([25.0, 45.0]),
        "prior": {"east": (30.0, 20.0)},
        "known": {},
        "box": {"north": (0.0, 200.0)},
        "search": True,
        "starts": 2,
        "seed": 0,
        "loss": "squares",
        "alpha": 0.001,
        "chance": 0.01,
        "weak_ratio": 0.25,
        "max_iterations": 50,
    },
    "estimate_trials": {
        "model": MODEL,
        "truth": np.array([30.0, 40.0]),
        "seed": 1,
        "trials": 3,
        "first": 0,
        "level": 0.95,
        "function": None,
        "alternatives": {"offset": np.ones(2)},
        "shift": np.zeros(2),
        "start": np.array([25.0, 45.0]),
        "prior": {"east": (30.0, 20.0)},
        "box": {"north": (0.0, 200.0)},
        "starts": 1,
        "alpha": 0.001,
        "chance": 0.01,
        "weak_ratio": 0.25,
    },
    "other_solutions": {
        "model": MODEL,
        "x": np.array([30.0, 40.0]),
        "prior": {"east": (30.0, 20.0)},
        "box": {"north": (-200.0, 200.0)},
        "starts": 4,
        "seed": 0,
    },
    "load": {"path": str(SAVED)},
    "choose.select": {
        "candidates": {f"look {i}": row[None] for i, row in enumerate(ROWS)},
        "budget": 4,
        "goal": "A",
        "problem": _linear(),
        "exchange": True,
        "relax": True,
    },
    "io.read": {
        "*": (str(BAY),),
        "columns": {"time": "t_s"},
        "units": {"t_s": "s"},
        "separator": ",",
        "decimal": ".",
        "trust": (),
        "size_limit": 1 << 20,
    },
    "io.table": {"path": str(BAY), "separator": ",", "decimal": "."},
    "io.joined": {"recordings": [gm.io.read(BAY)], "trust": ()},
    "bounds.barankin": {
        "model": MODEL,
        "x": np.array([30.0, 40.0]),
        "points": np.array([[30.0, -40.0], [31.0, 40.0]]),
    },
    "bounds.weiss_weinstein": {
        "model": MODEL,
        "prior": MODEL_PRIOR,
        "vectors": np.eye(2),
        "samples": 8,
    },
    "bounds.threshold": {
        "model": MODEL,
        "prior": MODEL_PRIOR,
        "vectors": np.array([[0.0, 80.0]]),
        "noise": np.array([1.0, 10.0]),
        "samples": 8,
    },
    "bearings.localize": {
        "times": T,
        "bearings": SEEN,
        "observer": PATH,
        "sigma": 0.01,
        "prior": {"x0": (2000.0, 500.0)},
        "order": 1,
        "observer_index": np.zeros(T.size, dtype=int),
    },
    "dipole.check_record": {"times": PASS_TIMES, "field": FIELD, "channels": ("x", "y", "z")},
    "dynamics.empirical_gramian": {
        "f": _decay,
        "h": _seen,
        "x0": np.array([1.0, 2.0]),
        "times": np.arange(4.0),
        "step": np.array([0.1, 0.1]),
        "sigma": np.array([1.0]),
        "discrete": False,
        "vectorized": False,
        "rtol": 1e-6,
    },
    "dynamics.lie_derivatives": {
        "f": _decay,
        "h": _seen,
        "x0": np.array([1.0, 2.0]),
        "names": ["a", "b"],
        "order": 1,
        "time": 0.0,
        "sigma": np.array([1.0]),
        "units": ["m", "s"],
        "scale": np.ones(2),
        "rtol": 1e-9,
    },
    "dynamics.from_map": {
        "f": _decay,
        "h": _seen,
        "x0": np.array([1.0, 2.0]),
        "times": np.arange(4.0),
        "names": ["a", "b"],
        "sigma": np.array([1.0]),
        "units": ["m", "s"],
        "scale": np.ones(2),
        "jacobian": "auto",
        "vectorized": False,
    },
    "dynamics.from_ode": {
        "f": _decay,
        "h": _seen,
        "x0": np.array([1.0, 2.0]),
        "times": np.arange(4.0),
        "names": ["a", "b"],
        "sigma": np.array([1.0]),
        "units": ["m", "s"],
        "scale": np.ones(2),
        "jacobian": "auto",
        "vectorized": False,
        "rtol": 1e-6,
    },
    "dynamics.unit_norm": {"*": ([0, 1], [2, 3])},
    "large.SparseProblem": {
        "rows": ([1.0, -1.0, 1.0, -1.0], ([0, 0, 1, 1], [0, 1, 1, 2])),
        "names": ["a", "b", "c"],
        "units": ["m", "m", "m"],
        "scale": np.ones(3),
        "rtol": 1e-9,
        "combinations": {"sum": np.ones(3)},
        "gauges": {"shift": np.ones(3)},
        "shape": (2, 3),
    },
    "large.analyze_sparse": {
        "problem": _sparse(),
        "weak_ratio": 1.0,
        "weak_condition": 1e8,
        "rtol": 1e-9,
    },
    "large.similarity_gauges": {
        "positions": [np.array([1.0, 2.0]), None],
        "states": [["x", "y", "theta"], ["bias"]],
        "axes": ("x", "y", "z"),
        "scale": True,
    },
    "linear.distance": {
        "A": A2,
        "C": C2,
        "scaling": "balanced",
        "certify": True,
        "slack": 0.05,
        "most": 1000,
        "names": ["x", "v"],
        "prior": np.ones(2),
        "R": np.eye(1),
    },
    "linear.modes": {
        "A": np.diag(-np.arange(1.0, 9.0)),
        "C": np.ones((1, 8)),
        "near": 0.5,
        "count": 3,
        "names": [f"x{i}" for i in range(8)],
        "rtol": 1e-9,
        "time": "continuous",
    },
    "linear.unobservable": {"A": A2, "C": C2, "names": ["x", "v"], "rtol": 1e-9},
    "linear.gramian_factor": {
        "A": A2 - np.eye(2),
        "C": C2,
        "R": np.eye(1),
        "discount": 0.1,
        "time": "continuous",
    },
    "linear.hankel": {"A": A2 - np.eye(2), "B": np.ones((2, 1)), "C": C2, "time": "continuous"},
    "linear.split_gramian": {"A": np.diag([-1.0, 2.0]), "C": np.ones((1, 2)), "R": np.eye(1)},
    "maneuver.two_legs": {
        "range_": 50e3,
        "speed": 5.0,
        "duration": 600.0,
        "samples": 61,
        "sigma": 0.01,
        "cross_speed": 1.0,
        "turn": 0.4,
        "goal": "determinant",
    },
    "monte_carlo.Tracks": {"scene": SCENE, "state": STATE, "prior": {"x0": (2000.0, 500.0)}},
    "tracks.Carrier": {
        "path": PATH,
        "times": T,
        "velocity": np.ones((T.size, 2)),
        "heading": np.zeros(T.size),
        "name": "ship",
    },
    "tracks.Scene": {
        "motion": gm.tracks.Motion.constant_velocity(),
        "sensors": SCENE.sensors,
        "reference": 0.0,
    },
    "tracks.choose_legs": {"scene": SCENE, "measurements": [SEEN], "most": 1, "penalty": 5.0},
    "tracks.estimate": TRACK_ESTIMATE,
    "tracks.estimate_many": TRACK_ESTIMATE,
    "tracks.leg_penalty": {
        "scene": SCENE.with_motion(gm.tracks.Motion.legs(count=1)),
        "state": STATE,
        "level": 0.1,
        "trials": 20,
        "seed": 0,
    },
    "tracks.problem": {"scene": SCENE, "state": STATE},
    "tracks.rows": {"scene": SCENE, "state": {"x0": 2000.0, "y0": 6000.0, "vx": 3.0, "vy": -1.0}},
    "tracks.simulate": {"scene": SCENE, "state": STATE, "trials": 2, "seed": 0, "first": 0},
}

#: Not attacked by themselves, with the reason.
WITHOUT = {
    "monte_carlo.Experiment": "a base class",
    "bearings.Monitor": "its methods: METHODS",
    "explore": "opens a widget: tests/explorer/test_widget.py",
}


#: Methods of what the calls return: what is made, the method, its arguments.
METHODS: dict[str, tuple[Callable[[], Any], dict[str, Any]]] = {
    "Problem.fix": (_linear, {"*": ("x",)}),
    "Problem.prior": (_linear, {"sigmas": {"x": 1.0}}),
    "Problem.marginalize": (_linear, {"names": ["x"]}),
    "Problem.with_rows": (_linear, {"rows": ROWS}),
    "Problem.with_scale": (_linear, {"scale": np.ones(3)}),
    "Problem.index": (_linear, {"name": "x"}),
    "Problem.direction": (_linear, {"name": "x"}),
    "Observability.std_of": (lambda: gm.analyze(ROWS), {"combination": np.ones(3)}),
    "Observability.knowing": (
        lambda: gm.analyze(ROWS),
        {"combination": np.ones(3), "sigma": 1.0},
    ),
    "Problem.constrain": (_linear, {"rows": np.ones((1, 3))}),
    "Problem.keep_rows": (_linear, {"kept": np.array([True, True, True, True, False, True])}),
    "Problem.factor": (_linear, {"prior": True, "rtol": 1e-9}),
    "Observability.critical": (
        lambda: gm.analyze(_linear()),
        {"factor": 2.0, "groups": {"a": [0]}},
    ),
    "Observability.candidates": (
        lambda: gm.analyze(_linear()),
        {"rows_or_problem": ROWS[:2], "groups": {"a": [0]}},
    ),
    "Observability.covariance": (lambda: gm.analyze(_linear()), {"names": ["x"]}),
    "Observability.save": (lambda: gm.analyze(_linear()), {"path": str(SAVED)}),
    "SparseProblem.fix": (_sparse, {"*": ("a",)}),
    "SparseProblem.prior": (_sparse, {"sigmas": {"a": 1.0}}),
    "SparseProblem.with_rows": (_sparse, {"rows": _sparse().rows}),
    "SparseObservability.covariance_of": (
        lambda: gm.analyze(_sparse()),
        {"combinations": ["a", np.ones(3), {"a": 1.0, "b": -1.0}]},
    ),
    "SparseObservability.differences": (lambda: gm.analyze(_sparse()), {"pairs": [("a", "b")]}),
    "SparseObservability.rank_gain": (lambda: gm.analyze(_sparse()), {"rows": _sparse().rows}),
    "SparseObservability.weakest": (lambda: gm.analyze(_sparse()), {"count": 1}),
    "Model.at": (lambda: MODEL, {"x": np.array([30.0, 40.0])}),
    "Model.residuals": (
        lambda: MODEL,
        {"x": np.array([30.0, 40.0]), "z": np.array([49.5, 81.0])},
    ),
    "Model.rows": (lambda: MODEL, {"x": np.array([30.0, 40.0])}),
    "Model.simulate": (
        lambda: MODEL,
        {"x": np.array([30.0, 40.0]), "seed": 0, "trials": 2, "first": 0},
    ),
    "Estimate.contains": (_answer, {"state": STATE, "level": 0.9}),
    "Estimate.interval": (_answer, {"what": "x0", "level": 0.9}),
    "Estimate.region": (_answer, {"pair": ("x0", "y0"), "level": 0.9}),
    "Estimate.sample": (_answer, {"count": 8, "seed": 0}),
    "Estimate.summary": (_answer, {"level": 0.9}),
    "Estimate.test": (_answer, {"alternatives": {"offset": np.ones(T.size)}}),
    "Posterior.of_prior": (
        lambda: gm.bounds.Posterior,
        {"prior": {"a": (0.0, 1.0), "b": (1.0, 2.0)}, "form": "covariance", "names": ["a", "b"]},
    ),
    "Posterior.predict": (
        lambda: gm.bounds.Posterior.of_prior(np.eye(2)),
        {"transition": np.eye(2), "process_noise": np.eye(2)},
    ),
    "Posterior.update": (
        lambda: gm.bounds.Posterior.of_prior(np.eye(2)),
        {"rows": np.ones((1, 2)), "detection": 0.9},
    ),
    "Trajectory.windows": (_path, {"width": 2.0, "rtol": 1e-9}),
    "Trajectory.rows": (_path, {"about": 0.0, "until": 2.0}),
    "Trajectory.rows_and_errors": (_path, {"about": 0.0, "until": 2.0}),
    "Trajectory.posterior": (_path, {"Q": np.eye(2), "prior": np.eye(2)}),
    "Track.at": (
        lambda: next(iter(gm.io.read(BAY).tracks.values())),
        {"times": np.array([1.0, 2.0]), "max_gap": 60.0},
    ),
    "Levels.level_of": (lambda: gm.linear.levels(A2, C2), {"combination": np.ones(2)}),
    "Hankel.order": (
        lambda: gm.linear.hankel(A2 - np.eye(2), np.ones((2, 1)), C2),
        {"error": 0.01},
    ),
    "Unobservable.left_by": (
        lambda: gm.linear.unobservable(A2, C2),
        {"outputs": {"place": np.array([1.0, 0.0])}},
    ),
    "Unobservable.project": (lambda: gm.linear.unobservable(A2, C2), {"rows": C2}),
    "Piecewise.rows": (
        lambda: gm.linear.piecewise([A2, 2 * A2], [C2, C2], np.ones(2)),
        {"dt": 0.5, "R": np.eye(1)},
    ),
    "Reports.positions": (lambda: REPORTS, {"sensors": SENSORS, "sigma": SIGMA2}),
    "Flight.rows": (
        lambda: gm.inertial.segments([gm.inertial.Leg(20.0)], 0.7, speed=50.0),
        {"dt": 5.0},
    ),
    "Carrier.at": (lambda: SHIP, {"times": np.array([1.0, 2.0])}),
    "Motion.legs": (
        lambda: gm.tracks.Motion,
        {"turns": np.array([100.0]), "constant_speed": True, "dimension": 2},
    ),
    "Motion.polynomial": (lambda: gm.tracks.Motion, {"order": 2, "dimension": 2}),
    "Scene.track": (lambda: SCENE, {"state": STATE, "times": np.array([1.0, 2.0])}),
    "Scene.values": (lambda: SCENE, {"state": STATE}),
    "Sensor.bearing": (
        lambda: gm.tracks.Sensor,
        {"carrier": SHIP, "times": T, "sigma": 0.01, "bias": "compass"},
    ),
    "Sensor.frequency": (
        lambda: gm.tracks.Sensor,
        {"carrier": SHIP, "times": T, "speed": 1500.0, "tonal": "tonal", "sigma": 0.1},
    ),
    "Sensor.time_difference": (
        lambda: gm.tracks.Sensor,
        {
            "carrier": SHIP,
            "second": gm.tracks.Carrier([0.0, 9.0]),
            "times": T,
            "speed": 1500.0,
            "sigma": 0.1,
        },
    ),
    "Sensor.signal_strength": (
        lambda: gm.tracks.Sensor,
        {"carrier": SHIP, "times": T, "power": 60.0, "exponent": 2.0, "sigma": 1.0},
    ),
    "Estimate.track": (
        lambda: gm.tracks.estimate(SCENE, [SEEN]),
        {"times": np.array([1.0, 2.0])},
    ),
    "Localization.sample_passes": (
        lambda: gm.dipole.localize(PASS_TIMES, FIELD, {"vz": 0.0, "z0": 5.0}, sigma=1e-9, starts=2),
        {"count": 4, "seed": 0},
    ),
    "SingularTrack.distances": (
        lambda: gm.registration.singular_tracks(SENSORS)[0],
        {"positions": PLACES},
    ),
    "SweepResult.values": (
        lambda: gm.monte_carlo.sweep(
            lambda size: gm.Problem(ROWS * size, ["x", "y", "z"]),
            {"size": np.array([1.0, 2.0])},
            10,
            1,
            progress=False,
        ),
        {"what": "rmse", "state": "x"},
    ),
    "Monitor.push": (
        gm.bearings.Monitor,
        {"time": 1.0, "bearing": 0.3, "sigma": 0.01, "distance": 100.0},
    ),
}


def public() -> dict[str, Callable[..., Any]]:
    """Every public callable by its name under `gramian`, found by introspection.

    Classes that only hold what a function returns are left out: their constructors take
    what the function made.
    """
    found: dict[str, Callable[..., Any]] = {}
    modules: list[tuple[str, ModuleType]] = [("", gm)]
    modules += [
        (f"{name}.", value)
        for name in gm.__all__
        if isinstance(value := getattr(gm, name), ModuleType)
    ]
    for prefix, module in modules:
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, ModuleType) or not callable(value) or value in found.values():
                continue
            if not getattr(value, "__module__", "").startswith(("gramian", "builtins")):
                continue  # a type hint
            if isinstance(value, type) and prefix + name not in (*CALLS, *WITHOUT):
                continue
            found[prefix + name] = value
    return found
