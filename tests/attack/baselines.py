"""A call that works for every public function: what the attack starts from.

Each entry gives the arguments by name; `*` holds positional ones that have none.
"""

from __future__ import annotations

from collections.abc import Callable
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


def _ranges(x: Any) -> Any:
    return np.array([np.hypot(x[0], x[1]), np.hypot(x[0] - 100.0, x[1])])


def _linear() -> Any:
    return gm.Problem(ROWS, ["x", "y", "z"])


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
    "monte_carlo.Registration": {"positions": PLACES, "sensors": SENSORS, "sigma": SIGMA2},
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
    "bearings.localize": {
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
    "dipole.rows": {**PASS, "times": PASS_TIMES, "sigma": 1e-9, "sensors": np.zeros((1, 3))},
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
    "registration.degree": {
        "positions": PLACES,
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "method": "eta",
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
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
        "seed": 1,
        "trials": 2,
        "first": 0,
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
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
    },
    "registration.gauges": {"sensors": SENSORS, "extras": ()},
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
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "scale": {"A.range": 10.0},
    },
    "registration.rows": {
        "positions": PLACES,
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
    },
    "registration.select": {
        "tracks": {"one": PLACES, "two": PLACES + 3e3},
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "budget": 1,
        "prior": np.full(4, 100.0),
    },
    "registration.simulate": {
        "positions": PLACES,
        "sensors": SENSORS,
        "sigma": SIGMA2,
        "biases": np.zeros(4),
        "seed": 1,
        "trials": 2,
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
    "maneuver.Sensing": {"kind": "bearing", "sigma": 0.01, "detection": 0.9},
    "maneuver.problem": {"path": PATH, "target": STATE[:2], "sigma": 0.01},
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
}

#: Not attacked by themselves, with the reason.
WITHOUT = {
    "load": "reads a file that `save` wrote: tests/answers",
    "io.joined": "takes recordings, which `io.read` makes",
    "io.read": "reads files: tests/io",
    "io.table": "reads files: tests/io",
    "monte_carlo.Experiment": "a base class",
    **dict.fromkeys(
        (
            "bearings.estimate",
            "bounds.barankin",
            "bounds.threshold",
            "bounds.weiss_weinstein",
            "estimate",
            "estimate_trials",
            "maneuver.two_legs",
            "other_solutions",
            "linear.distance",
            "linear.unobservable",
            "tracks.choose_legs",
            "tracks.estimate",
            "tracks.leg_penalty",
            "tracks.problem",
            "tracks.rows",
            "tracks.simulate",
            "choose.select",
            "dipole.check_record",
            "dynamics.empirical_gramian",
            "dynamics.from_map",
            "dynamics.from_ode",
            "dynamics.unit_norm",
            "large.analyze_sparse",
            "large.similarity_gauges",
            "linear.gramian_factor",
            "linear.hankel",
            "linear.split_gramian",
        ),
        "newer than this list: a call is missing",
    ),
    "bearings.Monitor": "its methods: METHODS",
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
