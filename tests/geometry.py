"""Made-up geometries that several tests share."""

import json
from pathlib import Path

import numpy as np

REFERENCE = Path(__file__).parent / "reference"


def reference(name):
    """Values computed in 40 to 50 digits; the file says what of."""
    return json.loads((REFERENCE / f"{name}.json").read_text())


def two_leg_track(params, *, turn_deg=None):
    """Times, observer positions and target state of a reference case."""
    turn = np.radians(params["turn_deg"] if turn_deg is None else turn_deg)
    m, dt = params["m"], float(params["dt_s"])
    leg = params["observer_speed_mps"] * dt
    heading = np.where(np.arange(m - 1) < params["first_leg_steps"], 0.0, turn)
    steps = leg * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    observer = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    state = np.array([*params["target0_m"], *params["target_v_mps"]], dtype=float)
    return np.arange(m) * dt, observer, state


def straight_track(m, *, metre=1.0, second=1.0):
    """An observer and a target that both keep their course, in other units of length and time."""
    times = 20.0 * second * np.arange(m)
    speed = metre / second
    observer = np.stack([0 * times, 5 * speed * times], axis=1)
    return times, observer, np.array([0, 10_000 * metre, 3 * speed, -speed])
