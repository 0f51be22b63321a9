"""From a scene of the user's own to what the explorer's page shows.

The page has three kinds of scene, its tabs: a target at constant velocity and one moving
observer, the pass of a dipole, two radars in the plane. What a scene has beyond these is
refused by name, not left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import finite, number
from gramian.exceptions import InputError
from gramian.models.tracks import Estimate, Scene
from gramian.problem import Problem
from gramian.scenario import Scenario, from_values, load

if TYPE_CHECKING:
    from gramian.models.bearings.scenario import BearingsScenario
    from gramian.models.dipole.scenario import DipoleScenario
    from gramian.models.registration.scenario import RegistrationScenario
    from gramian.models.tracks import Sensor
    from gramian.models.tracks.scenario import TracksScenario

__all__ = ["Opened", "opened"]

Array = NDArray[np.float64]

_STATES = ("x0", "y0", "vx", "vy")
_KINDS = ("bearing", "range", "frequency")
_KNOWN = {
    "speed": "its speed",
    "moment": "the size of its moment",
    "y0": "how far aside (y0)",
    "z0": "its height (z0)",
}


@dataclass(frozen=True)
class Opened:
    """A scene as the page has it.

    Attributes
    ----------
    tab : str
        "track", "dipole" or "radars".
    scene : dict
        What the page's own link carries.
    """

    tab: str
    scene: dict[str, Any]


def opened(
    scene: Any = None,
    state: ArrayLike | Mapping[str, float] | None = None,
    *,
    path: ArrayLike | None = None,
    times: ArrayLike | None = None,
    bearings: ArrayLike | None = None,
    sigma: float | None = None,
) -> Opened:
    """Return a scene of the user's own as the page has it; see `explore`."""
    arrays = {"path": path, "times": times, "bearings": bearings, "sigma": sigma}
    given = [name for name, value in arrays.items() if value is not None]
    if scene is None:
        if len(given) < len(arrays):
            missing = [name for name in arrays if name not in given]
            raise InputError(
                f"explore has no {', '.join(missing)}: give a scene, or path, times, bearings "
                "and sigma"
            )
        return _measured(path, times, bearings, sigma)
    if given:
        raise InputError(f"explore has a scene and {given[0]}: give one of them")
    if state is not None and not isinstance(scene, Scene):
        raise InputError(f"state goes with a gm.tracks.Scene: scene is {type(scene).__name__}")
    return _of(scene, state)


def _of(scene: Any, state: ArrayLike | Mapping[str, float] | None) -> Opened:
    if isinstance(scene, (str, Path)):
        scene = load(scene)
    elif isinstance(scene, Mapping):
        scene = from_values(scene)
    if isinstance(scene, Scenario):
        return _scenario(scene)
    if isinstance(scene, Scene):
        if state is None:
            raise InputError("state is missing: a gm.tracks.Scene is asked about at a state")
        return _track(scene, scene.state(state), {})
    if isinstance(scene, Estimate):
        return _estimate(scene)
    if isinstance(scene, Problem):
        return _problem(scene)
    if isinstance(scene, Opened):
        return scene
    raise InputError(
        f"scene is {type(scene).__name__}: must be a scenario (file or mapping), a "
        "gm.tracks.Scene with a state, an estimate of tracks, or a problem of tracks, dipole or "
        "registration"
    )


def _refused(what: str) -> InputError:
    return InputError(f"the explorer does not show {what}; gm.analyze answers for it")


def _scenario(scenario: Scenario) -> Opened:
    made: Any = {
        "tracks": _tracks_scenario,
        "bearings": _bearings_scenario,
        "dipole": _dipole_scenario,
        "registration": _registration_scenario,
    }.get(scenario.model)
    if made is None:
        raise _refused(f'model = "{scenario.model}"')
    found: Opened = made(scenario)
    return found


def _problem(problem: Problem) -> Opened:
    made_of = problem._made_of
    if made_of is None:
        raise InputError(
            "the problem does not say what it was made of: explore takes those of "
            "gm.tracks.problem, gm.dipole.problem and gm.registration.problem as they made them, "
            "with priors at most, or the scene itself"
        )
    kind, parts = made_of
    if len(problem.constraints):
        raise _refused("knowledge that is exact (`constrain`)")
    if len(problem.prior_rows):
        raise _refused("priors with a covariance")
    if kind == "tracks":
        scene, state = parts
        return _track(scene, state, problem.priors)
    if problem.priors:
        raise _refused(f"a prior of {next(iter(problem.priors))} in this tab")
    if kind == "dipole":
        r0, v, m, times, noise, sensors = parts
        return _dipole(r0, v, m, np.asarray(times, dtype=float), noise, sensors, None)
    return _radars(*parts)


# A target and one observer ----------------------------------------------------------------


def _tracks_scenario(scenario: TracksScenario) -> Opened:
    if scenario.known:
        raise _refused(f"a state that is known exactly ({', '.join(scenario.known)})")
    priors = {name: sigma for name, (_, sigma) in scenario.priors.items()}
    return _track(scenario.scene, scenario.scene.state(scenario.state), priors)


def _bearings_scenario(scenario: BearingsScenario) -> Opened:
    if scenario.known:
        raise _refused(f"a state that is known exactly ({', '.join(scenario.known)})")
    times = scenario.times
    if scenario.target is None and scenario.measured is not None:
        path = scenario.track(scenario.tracks.observer, times)
        return _measured(path, times, scenario.measured[1], scenario.sigma)
    geometry = scenario.geometry
    after = times - times[0]
    (x0, y0), (vx, vy) = np.linalg.lstsq(
        np.stack([np.ones_like(after), after], axis=1), geometry.target, rcond=None
    )[0]
    priors: dict[str, float] = {
        str(name): value if isinstance(value, float) else value.sigma
        for name, value in scenario.prior.items()
    }
    out = _plain(geometry.observer, times, times, [x0, y0, vx, vy], priors)
    out["sigma"]["bearing"] = float(np.degrees(geometry.sigma))
    return Opened("track", out)


def _estimate(found: Estimate) -> Opened:
    if found.prior or found.known or found._loss[0] != "squares":
        raise _refused("an estimate with a prior, known states or a robust loss")
    sensors = found.scene.sensors
    if len(sensors) != 1 or sensors[0].kind != "bearing" or np.isnan(found.measurements).any():
        raise _refused("measurements other than bearings of one sensor, none of them missing")
    _ = _track(found.scene, found.state, {})  # that it is a scene of the page
    (sensor,) = sensors
    assert sensor.carrier is not None
    path = sensor.carrier.at(sensor.times)[0]
    return _measured(path, sensor.times, found.measurements, _one(sensor))


def _measured(path: Any, times: Any, bearings: Any, sigma: Any) -> Opened:
    times, path = finite(times, "times"), finite(path, "path")
    bearings, sigma = finite(bearings, "bearings"), number(sigma, "sigma [rad]")
    count = len(bearings) if bearings.ndim == 1 else -1
    if times.shape != (count,) or path.shape != (count, 2):
        raise InputError(
            f"path {path.shape}, times {times.shape} and bearings {bearings.shape} do not fit: "
            "must be (m, 2), (m,) and (m,), the observer's place at each bearing"
        )
    if count < 4:
        raise InputError(f"{count} bearings: at least 4 are needed")
    if not (np.diff(times) > 0).all():
        k = int(np.argmin(np.diff(times) > 0)) + 1
        raise InputError(f"times[{k}] = {times[k]:g} s: must be later than {times[k - 1]:g} s")
    if not 0 < sigma < np.pi / 2:
        raise InputError(f"sigma = {sigma:g} rad: must be > 0 and below pi / 2")
    out = _plain(path, times, times, [*path[0], 0.0, 0.0], {})
    out["sigma"]["bearing"] = float(np.degrees(sigma))
    out["measured"] = {
        "times": times.tolist(),
        "path": path.tolist(),
        "values": bearings.tolist(),
        "status": "",
        "reason": "",
        "other": [],
    }
    return Opened("track", out)


def _track(scene: Scene, state: Array, priors: Mapping[str, float]) -> Opened:
    if scene.motion.names != _STATES:
        raise _refused(f"a target with the states {', '.join(scene.motion.names)}")
    if state.ndim != 1:
        raise InputError(f"state has shape {state.shape}: must be ({scene.n},), one state")
    seen = _seen(scene)
    first = scene.sensors[0]
    carrier, times = first.carrier, first.times
    for sensor in scene.sensors[1:]:
        if sensor.carrier != carrier or not np.array_equal(sensor.times, times):
            raise _refused(f"{sensor.name} on another carrier, or at other times")
    if carrier is None or carrier.velocity is not None or not (np.diff(times) > 0).all():
        raise _refused("samples out of order, or a carrier with velocities of its own")
    if len(times) < 2 or scene.origin != float(times[0]):
        raise _refused(f"a scene whose states count from {scene.origin:g} s")
    place = np.atleast_2d(np.asarray(carrier.path, dtype=float))[:, :2]
    at = None if carrier.times is None else np.asarray(carrier.times, dtype=float)
    out = _plain(place, at, times, state[:4].tolist(), priors)
    out["use"] = {kind: kind in seen for kind in _KINDS}
    for kind, sensor in seen.items():
        value = _one(sensor)
        out["sigma"][kind] = float(np.degrees(value)) if kind == "bearing" else value
    if "frequency" in seen:
        tonal, speed = seen["frequency"].parameters[0], seen["frequency"].speed
        if not isinstance(tonal, str):
            raise _refused("a tonal that is known")
        out["tonal"], out["wave"] = float(state[scene.index(tonal)]), float(speed or 0.0)
    return Opened("track", out)


def _seen(scene: Scene) -> dict[str, Sensor]:
    """Return the sensors by their kind."""
    seen: dict[str, Sensor] = {}
    for i, sensor in enumerate(scene.sensors):
        where = f"sensors[{i}] ({sensor.name})"
        if sensor.kind not in _KINDS or sensor.second is not None:
            raise _refused(f"{where}, a sensor of {sensor.kind.replace('_', ' ')}")
        if sensor.kind in seen:
            raise _refused(f"{where}, a second sensor of {sensor.kind}")
        for what in ("scale", "clock", "delay", "correlation_time", "covariance"):
            if getattr(sensor, what) is not None:
                raise _refused(f"{where}, with a {what.replace('_', ' ')}")
        if sensor.bias or (sensor.detection != 1).any():
            raise _refused(f"{where}, with a bias or a detection probability")
        seen[sensor.kind] = sensor
    return seen


def _one(sensor: Sensor) -> float:
    """Return the one deviation of a sensor."""
    sigma = np.atleast_1d(np.asarray(sensor.sigma, dtype=float))
    if not (sigma == sigma[0]).all():
        raise _refused(f"{sensor.name} with deviations that differ from sample to sample")
    return float(sigma[0])


def _plain(
    path: Array, at: Array | None, times: Array, target: list[float], priors: Mapping[str, float]
) -> dict[str, Any]:
    """Return a scene of the first tab with one bearing sensor."""
    steps = np.diff(times)
    count, step = len(times), float(steps[0])
    regular = times[0] == 0 and np.array_equal(times, step * np.arange(count))
    known, prior = {}, {"position": 1000.0, "speed": 2.0}
    for what, pair in (("position", ("x0", "y0")), ("speed", ("vx", "vy"))):
        found = [priors[name] for name in pair if name in priors]
        known[what] = bool(found)
        if found and (len(found) == 1 or found[0] != found[1]):
            raise _refused(f"a prior of {pair[0]} that is not one of {pair[1]} too")
        if found:
            prior[what] = float(found[0])
    for name in priors:
        if name not in _STATES:
            raise _refused(f"a prior of {name}")
    fixed = at is None or len(path) == 1
    return {
        "path": path[:1].tolist() if fixed else path.tolist(),
        "at": None if fixed or at is None else at.tolist(),
        "target": [float(x) for x in target],
        "count": count,
        "step": step,
        "times": None if regular else times.tolist(),
        "sigma": {"bearing": 0.5, "range": 25.0, "frequency": 0.02},
        "use": {"bearing": True, "range": False, "frequency": False},
        "tonal": 150.0,
        "wave": 1500.0,
        "prior": prior,
        "know": known,
        "measured": None,
    }


# A dipole that passes ---------------------------------------------------------------------


def _dipole_scenario(scenario: DipoleScenario) -> Opened:
    if scenario.assumed is None:
        raise _refused("a record named by a scenario: load its CSV in the page")
    if scenario.prior:
        raise _refused(f"a prior of {next(iter(scenario.prior))} in this tab")
    if len(scenario.known) > 1:
        raise _refused(f"{len(scenario.known)} facts that are known at once")
    if scenario.ambient_uT is not None or scenario.baselines is not None:
        raise _refused("sensors of the total field, or gradiometers")
    given, known = scenario.assumed, next(iter(scenario.known), None)
    noise = np.ravel(scenario._noise)
    return _dipole(given.r0, given.v, given.m, given.times, noise, scenario.sensors, known)


def _dipole(
    r0: Any, v: Any, m: Any, times: Array, noise: Any, sensors: Any, known: str | None
) -> Opened:
    places = np.zeros((1, 3)) if sensors is None else np.asarray(sensors, float).reshape(-1, 3)
    sigma = np.atleast_1d(np.asarray(noise, dtype=float))
    if len(places) > 2:
        raise _refused(f"{len(places)} sensors of the field")
    if not (sigma == sigma[0]).all():
        raise _refused("noise that differs from number to number")
    if known is not None and known not in _KNOWN:
        raise _refused(f"{known} as known exactly")
    step = float(times[1] - times[0]) if len(times) > 1 else 0.5
    regular = times[0] == 0 and np.array_equal(times, step * np.arange(len(times)))
    scene = {
        "r0": np.asarray(r0, float).tolist(),
        "v": np.asarray(v, float).tolist(),
        "m": np.asarray(m, float).tolist(),
        "count": len(times),
        "step": step,
        "noise": float(f"{1e9 * sigma[0]:.15g}"),  # nT, without the rounding of the factor
        "first": places[0].tolist(),
        "second": (places[1] if len(places) > 1 else places[0] + [4.0, -3.0, 0.0]).tolist(),
        "two": len(places) > 1,
        "know": _KNOWN.get(known or "", "nothing"),
        "size": 1.2,
        "times": None if regular else times.tolist(),
        "measured": None,
    }
    return Opened("dipole", scene)


# Two radars -------------------------------------------------------------------------------


def _registration_scenario(scenario: RegistrationScenario) -> Opened:
    if scenario.extras or scenario.truth or scenario.prior:
        raise _refused("biases beyond range and azimuth, or a prior of them")
    return _radars(scenario.all_positions, scenario.places, scenario.sigma)


def _radars(positions: Any, sensors: Any, sigma: Any) -> Opened:
    looks = np.asarray(positions, dtype=float)
    places = np.array([*sensors.values()] if isinstance(sensors, Mapping) else sensors, float)
    noise = np.asarray(sigma, dtype=float)
    if places.shape != (2, 2) or looks.ndim != 2:
        raise _refused(f"{len(places)} sensors in {places.shape[-1]} dimensions")
    noise = np.broadcast_to(noise, (2, 2))
    step = np.diff(looks, axis=0)
    straight = len(looks) > 1 and np.array_equal(
        looks, looks[0] + np.arange(len(looks))[:, None] * step[0]
    )
    degrees = np.degrees(noise[:, 1])
    scene = {
        "a": places[0].tolist(),
        "b": places[1].tolist(),
        "from": looks[0].tolist(),
        "to": looks[-1].tolist(),
        "count": max(2, len(looks)),
        "range": float(noise[0, 0]),
        "azimuth": float(degrees[0]),
        "range2": float(noise[1, 0]),
        "azimuth2": float(degrees[1]),
        "circle": 2000.0,
        "track": None if straight else looks.tolist(),
    }
    return Opened("radars", scene)
