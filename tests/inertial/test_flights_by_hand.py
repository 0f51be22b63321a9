"""What flights do not determine, derived by hand, beside a navigator that nothing is linearised of.

Each flight has its null combinations written down: what leads them, for small terms follow
(a metre of height weighs 3e-6 m/s^2 less). The rows of `segments` are those of a
strapdown navigator in Earth-fixed axes, and what neither sees is the same.
"""

from dataclasses import dataclass

import numpy as np
import pytest

import strapdown
from gramian.models.inertial import EARTH_RATE, Leg, gravity, rotation, segments

LATITUDE = np.radians(34.0)
G = gravity(LATITUDE)
NORTHWARD, UPWARD = EARTH_RATE * np.cos(LATITUDE), EARTH_RATE * np.sin(LATITUDE)
MERIDIAN = 6378137.0 * (1 - strapdown.E2) / (1 - strapdown.E2 * np.sin(LATITUDE) ** 2) ** 1.5
PARALLEL = 6378137.0 / np.sqrt(1 - strapdown.E2 * np.sin(LATITUDE) ** 2) * np.cos(LATITUDE)
GNSS = ("velocity", "position")

# At rest, level, head north: V' = f x phi + C Delta = 0 and phi' = -w x phi - C eps = 0.
TILTS = (
    {"phi_N": 1, "Delta_W": -G, "eps_W": -UPWARD},
    {"phi_W": 1, "Delta_N": G, "eps_N": UPWARD, "eps_U": -NORTHWARD},
    {"phi_U": 1, "eps_W": NORTHWARD},
)
# An antenna that is elsewhere is a navigator that is elsewhere.
ARM_F = {"l_F": 1, "dL": -1 / MERIDIAN}
ARM_L = {"l_L": 1, "dlambda": 1 / PARALLEL}
ARM_U = {"l_U": 1, "dh": -1}


def along(heading, nulls):
    """The combinations of a level vehicle with another heading: biases turn with the body."""
    c = rotation(heading)
    out = []
    for null in nulls:
        changed = dict(null)
        for kind in ("eps", "Delta"):
            part = [null.get(f"{kind}_{axis}", 0.0) for axis in "NWU"]
            changed |= dict(zip([f"{kind}_{a}" for a in "NWU"], c.T @ part, strict=True))
        out.append(changed)
    return tuple(out)


@dataclass
class Case:
    """A flight, what is estimated and measured, and what it does not determine."""

    legs: list
    nulls: tuple
    speed: float = 0.0
    heading: float = 0.0
    estimated: tuple = ()
    outputs: tuple = GNSS
    #: As large as any part of the combination that was left out, in deviations.
    small: float = 1e-3
    #: What the navigator may see of it, beside the noise of all samples together.
    unseen: float = 1e-5
    #: How far rows may be off that follow a turn in segments.
    off: float = 2e-3


SPOT = 0.1  # rad/s, clockwise: -U
CIRCLE, FAST = 0.05, 10.0
CASES = {
    "rest, lever arm": Case(
        [(60.0, 0, 0)], (*TILTS, ARM_F, ARM_L, ARM_U), estimated=("lever_arm",)
    ),
    # Without a turn no arm is seen, however fast: the antenna's place moves as the navigator's.
    # The meridians converge by 8e-6 /s, which coefficients that are held do not know.
    "straight, lever arm": Case(
        [(60.0, 0, 0)],
        (*TILTS, ARM_F, ARM_L, ARM_U),
        speed=50.0,
        estimated=("lever_arm",),
        small=0.2,
        unseen=1e-3,
    ),
    # The arm along the axis of the turn is not seen; biases turn and tilts do not.
    "turn on the spot, lever arm": Case(
        [(120.0, SPOT * 120, 0)], (ARM_U,), estimated=("lever_arm",)
    ),
    # Biases of all gyros and accelerometers but along combinations that tilts imitate: no
    # velocity or rate that is known to be zero tells more than the receiver's, and no place.
    "rest, zero velocity and rate": Case(
        [(60.0, 0, 0)],
        (
            *TILTS,
            {"dL": 1, "eps_N": -UPWARD, "eps_U": NORTHWARD},
            {"dlambda": 1},
            # A navigator that takes itself to be higher takes gravity to be less.
            {"dh": 1, "Delta_U": -2 * G / 6378137.0},
        ),
        outputs=("zero_velocity", "zero_angular_rate"),
    ),
    # The scale from the receiver's speed; the mounting looks like tilts.
    "straight, odometer": Case(
        [(60.0, 0, 0)],
        (TILTS[0], TILTS[1] | {"odo_pitch": 1}, TILTS[2] | {"odo_yaw": 1}),
        speed=20.0,
        estimated=("odometer_scale", "odometer_mounting"),
        outputs=(*GNSS, "odometer", "side_slip"),
        small=0.1,
    ),
    # In a steady circle the arms of the wheels look like scale and mounting; that along the
    # axis is not seen at all.
    "circle, odometer": Case(
        [(2 * np.pi / CIRCLE, 2 * np.pi, 0)],
        (
            {"odo_scale": CIRCLE / FAST, "odo_l_L": -1},
            {"odo_yaw": CIRCLE / FAST, "odo_l_F": -1},
            {"odo_l_U": 1},
        ),
        speed=FAST,
        estimated=("odometer_scale", "odometer_mounting", "odometer_arm"),
        outputs=(*GNSS, "odometer", "side_slip"),
    ),
    # A constant rate about one axis: what it makes of that column of the gyros' matrix is a
    # bias; and gyros turned about the axis are a heading, of which gravity alone tells nothing.
    "turn on the spot, gyros": Case(
        [(120.0, SPOT * 120, 0)],
        (
            {"gyro_scale_U": 1, "eps_U": SPOT},
            {"gyro_FU": 1, "eps_N": SPOT},
            {"gyro_LU": 1, "eps_W": SPOT},
            {"gyro_LF": 1, "gyro_FL": -1, "phi_U": 1},
        ),
        estimated=("gyro_scale", "gyro_misalignment"),
        small=0.05,
    ),
    # At rest each reading is constant: scale factors are biases, or nothing at all.
    "rest, scale factors": Case(
        [(60.0, 0, 0)],
        (
            *TILTS,
            {"gyro_scale_F": 1, "eps_N": -NORTHWARD},
            {"gyro_scale_L": 1},
            {"gyro_scale_U": 1, "eps_U": -UPWARD},
            {"accel_scale_F": 1},
            {"accel_scale_L": 1},
            {"accel_scale_U": 1, "Delta_U": -G},
        ),
        estimated=("gyro_scale", "accelerometer_scale"),
    ),
}

# Of the errors, for differences: as large as what is not linear stays small.
STEPS = {
    "phi": 1e-4, "dV": 0.1, "dL": 1e-6, "dlambda": 1e-6, "dh": 10.0, "eps": 1e-6, "Delta": 1e-3,
    "l": 0.1, "gyro": 1e-4, "accel": 1e-4, "odo_scale": 1e-3, "odo_pitch": 1e-4, "odo_yaw": 1e-4,
    "odo_l": 0.1,
}  # fmt: skip


def step(name):
    return next(value for key, value in reversed(STEPS.items()) if name.startswith(key))


def flown(case):
    legs = [Leg(duration, turn=turn, speed_change=change) for duration, turn, change in case.legs]
    return segments(
        legs, LATITUDE, speed=case.speed, heading=case.heading, estimated=case.estimated,
        outputs=case.outputs, step=0.5, largest_turn=0.02,
    )  # fmt: skip


def simulated(case, system, every=2.0, step_of=0.25):
    start = (LATITUDE, 0.0, 0.0, case.heading, case.speed)
    flight = strapdown.Flight(case.legs, start, step_of)
    steps = np.array([step(name) for name in system.names])
    found = strapdown.rows(flight, system.names, steps, case.outputs, round(every / step_of))
    return (found / system.noise[:, None]).reshape(-1, system.n)


def in_deviations(nulls, system):
    """Orthonormal directions, in units of what is known beforehand."""
    unit = [[null.get(name, 0.0) for name in system.names] for null in nulls]
    return np.linalg.qr((np.array(unit) / system.prior).T)[0]


@pytest.mark.parametrize("name", CASES)
def test_null_spaces_are_those_derived_by_hand(name):
    case = CASES[name]
    flight = flown(case)
    system = flight.system
    found = flight.piecewise()
    assert len(system.names) - found.rank == len(case.nulls), found.null_combinations
    ours = np.linalg.qr(found.null_space / system.prior[:, None])[0]
    hand = in_deviations(along(case.heading, case.nulls), system)
    assert np.linalg.norm(hand - ours @ (ours.T @ hand), axis=0).max() < case.small
    # The navigator of which nothing is linearised does not see it either.
    seen = simulated(case, system) * system.prior
    assert np.linalg.norm(seen @ ours, axis=0).max() < case.unseen


@pytest.mark.parametrize("name", CASES)
def test_rows_are_those_of_a_navigator_that_begins_and_measures_wrong(name):
    case = CASES[name]
    flight = flown(case)
    expected = simulated(case, flight.system) * flight.system.prior
    rows = flight.rows(dt=2.0)[: len(expected)] * flight.system.prior
    size = np.linalg.norm(expected, axis=0)
    off = np.linalg.norm(rows - expected, axis=0)
    # Beside the noise of all samples; differences of the navigator are rounded to a part of it.
    wrong = off > case.off * size + 1e-6
    assert not wrong.any(), [flight.system.names[i] for i in np.flatnonzero(wrong)]
