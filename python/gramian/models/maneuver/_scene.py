"""A path as a scene of `gramian.tracks`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import finite
from gramian._options import given as shown
from gramian.exceptions import InputError
from gramian.models.maneuver._sensing import Sensing
from gramian.models.tracks import Carrier, Motion, Scene, Sensor

__all__ = ["scene"]

Array = NDArray[np.float64]


def scene(
    path: ArrayLike,
    sensors: Sensing | Sequence[Sensing] | ArrayLike,
    times: ArrayLike | None = None,
    *,
    order: int = 0,
) -> Scene:
    """Return what is measured along a path as a scene of `gramian.tracks`.

    Parameters
    ----------
    path : array_like, shape (m, 2) or (observers, m, 2)
        East and north of each observer at each sample, metres; `Plan.path`.
    sensors : Sensing or sequence of Sensing, or array_like, shape () or (m,)
        What every observer measures at each sample; a number, or one for each sample, is the
        standard deviation of a bearing, radians, > 0.
    times : array_like, shape (m,), optional
        Increasing, seconds; 0, 1, .. by default, which serves for a fixed target.
    order : {0, 1}
        A fixed target, or one at constant velocity, whose state is that at the first time.

    Returns
    -------
    gramian.tracks.Scene
        With it a plan has whatever scenes have: rows, simulation, estimates, reports. Blind
        arcs and the reach of a sensor are the planner's alone: all its readings are there.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, a sigma that is not positive.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> best = gm.maneuver.plan([0.0, 5e3], [0.0, 0.0], speed=5.0, dt=20.0, samples=20, starts=1)
    >>> seen = scene(best.path, 0.01, 20.0 * np.arange(20))
    >>> seen.names, seen.m
    (('x0', 'y0'), 20)
    """
    places = finite(path, "path")
    if places.ndim not in (2, 3) or places.shape[-1] != 2 or not places.size:
        raise InputError(
            f"path has shape {places.shape}: must be (m, 2), or (observers, m, 2), east and north"
        )
    if not isinstance(order, int) or order not in (0, 1):
        raise InputError(f"order = {shown(order)}: must be 0, a fixed target, or 1")
    samples = places.shape[-2]
    when = np.arange(float(samples)) if times is None else finite(times, "times")
    if when.shape != (samples,):
        raise InputError(f"times has shape {when.shape}: must be ({samples},), as the path has")
    what = _measured(sensors)
    made = []
    for one in places.reshape(-1, samples, 2):
        carrier = Carrier(one, when, name="observer")
        made += [_sensor(sensing, carrier, when) for sensing in what]
    motion = Motion.constant_velocity() if order else Motion.fixed()
    return Scene(motion, made, reference=float(when[0]))


def _measured(
    sensors: Sensing | Sequence[Sensing] | ArrayLike,
) -> Sequence[Sensing | Array]:
    if isinstance(sensors, Sensing):
        return [sensors]
    if not isinstance(sensors, (list, tuple)) or not any(isinstance(s, Sensing) for s in sensors):
        return [finite(sensors, "sigma [rad]")]  # type: ignore[arg-type]
    for i, one in enumerate(sensors):
        if not isinstance(one, Sensing):
            raise InputError(f"sensors[{i}] = {shown(one)}: must be a Sensing")
    return sensors


def _sensor(sensing: Sensing | Array, carrier: Carrier, times: Array) -> Sensor:
    """Return a sensor of a scene as an observer of a plan has it."""
    if isinstance(sensing, np.ndarray):
        return Sensor.bearing(carrier, times, sigma=sensing)
    noise: dict[str, Any] = {"sigma": sensing.sigma, "detection": sensing.detection}
    if sensing.bias:
        noise["bias"] = sensing.bias
    chosen = {**sensing.parameters, **sensing.unknown}
    if sensing.kind == "frequency":
        noise |= {"speed": chosen.get("wave", 1500.0), "tonal": chosen["tonal"]}
    if sensing.kind == "signal_strength":
        noise |= {"power": chosen.get("power", 0.0), "exponent": chosen.get("exponent", 2.0)}
    made: Sensor = getattr(Sensor, sensing.kind)(carrier, times, **noise)
    return made
