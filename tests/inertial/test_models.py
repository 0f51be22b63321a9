"""The inertial error model against differences of a nonlinear mechanisation, and maneuvers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm
from gramian.models.inertial import (
    EARTH_RATE,
    ESTIMATED,
    OUTPUTS,
    Leg,
    error_model,
    rotation,
    segments,
    static_base,
)

# All states: the lower triangle of the accelerometers is a part of their misalignments.
EVERYTHING = [name for name in ESTIMATED if name != "accelerometer_nonorthogonality"]
FULL = error_model(0.5, estimated=EVERYTHING)

# A mechanisation of its own: WGS 84 with Somigliana's gravity.
SEMI_MAJOR, INVERSE_FLATTENING = 6378137.0, 298.257223563
FLATTENING = 1 / INVERSE_FLATTENING
E2 = FLATTENING * (2 - FLATTENING)
RATIO = 0.00344978650684


def curvature(latitude):
    w = np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    return SEMI_MAJOR * (1 - E2) / w**3, SEMI_MAJOR / w


def somigliana(latitude, height):
    s = np.sin(latitude) ** 2
    ground = 9.7803253359 * (1 + 0.00193185265241 * s) / np.sqrt(1 - E2 * s)
    above = 1 - 2 / SEMI_MAJOR * (1 + FLATTENING + RATIO - 2 * FLATTENING * s) * height
    return ground * (above + 3 * height**2 / SEMI_MAJOR**2)


def earth_and_transport(velocity, place):
    latitude, _, height = place
    meridian, normal = curvature(latitude)
    north, west, _ = velocity
    earth = EARTH_RATE * np.array([np.cos(latitude), 0, np.sin(latitude)])
    transport = np.array(
        [
            -west / (normal + height),
            north / (meridian + height),
            -west * np.tan(latitude) / (normal + height),
        ]
    )
    return earth, transport


def rates(c, velocity, place, force_body, gyro_body, weight):
    """Return the rates of attitude (as a rotation vector), velocity and place."""
    earth, transport = earth_and_transport(velocity, place)
    turning = c @ gyro_body - (earth + transport)
    fall = np.array([0, 0, -weight(place[0], place[2])])
    acceleration = c @ force_body - np.cross(2 * earth + transport, velocity) + fall
    meridian, normal = curvature(place[0])
    moving = np.array(
        [
            velocity[0] / (meridian + place[2]),
            -velocity[1] / ((normal + place[2]) * np.cos(place[0])),
            velocity[2],
        ]
    )
    return turning, acceleration, moving


def small_rotation(phi):
    """Return exp(-[phi x]): the computed axes are turned by phi."""
    angle = np.linalg.norm(phi)
    k = np.cross(phi, np.eye(3)).T
    if angle == 0:
        return np.eye(3)
    return np.eye(3) - np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * k @ k


class Vehicle:
    """A true motion and, for an error state, what the navigator computes."""

    def __init__(self, rng, *, still=False):
        self.c = np.eye(3) if still else rotation(*rng.uniform(-1.0, 1.0, 3))
        self.v = np.zeros(3) if still else rng.uniform(-200, 200, 3)
        self.p = np.array([rng.uniform(-1.3, 1.3), 0.3, rng.uniform(0, 9000)])
        self.l, self.wheels = rng.uniform(-3, 3, (2, 3))
        self.w_nb = np.zeros(3) if still else rng.uniform(-0.5, 0.5, 3)
        earth, transport = earth_and_transport(self.v, self.p)
        self.gyro = self.w_nb + self.c.T @ (earth + transport)
        self.force = rng.uniform(-20, 20, 3)
        if still:
            self.force = np.array([0, 0, somigliana(self.p[0], self.p[2])])

    def weight(self, gradient):
        here = somigliana(self.p[0], self.p[2])
        return somigliana if gradient == "include" else lambda *_: here

    def computed(self, x):
        """Return what the navigator computes with and takes its sensors to say."""
        part = dict(zip(FULL.names, x, strict=True))
        accelerometer, gyro = np.zeros((2, 3, 3))
        g_sensitivity = np.array([part[f"g_sens_{i}{j}"] for i in "FLU" for j in "FLU"])
        for i, row in enumerate("FLU"):
            accelerometer[i, i] = part[f"accel_scale_{row}"]
            gyro[i, i] = part[f"gyro_scale_{row}"]
            for j, column in enumerate("FLU"):
                if i != j:
                    accelerometer[i, j] = part[f"accel_{row}{column}"]
                    gyro[i, j] = part[f"gyro_{row}{column}"]
        force = self.force + x[12:15] + accelerometer @ self.force
        turning = x[9:12] + gyro @ self.gyro + g_sensitivity.reshape(3, 3) @ self.force
        c = small_rotation(x[0:3]) @ self.c
        return c, self.v + x[3:6], self.p + x[6:9], force, self.gyro + turning

    def error_rates(self, x, gradient):
        """Rate of (phi, dV, dP). The tilt's is exact to first order in x."""
        c, v, p, force, gyro = self.computed(x)
        weight = self.weight(gradient)
        turning, acceleration, moving = rates(c, v, p, force, gyro, weight)
        true = rates(self.c, self.v, self.p, self.force, self.gyro, weight)
        # C^ = exp(-[phi x]) C with C^' = [w^ x] C^, C' = [w x] C.
        tilt = -(turning - small_rotation(x[0:3]) @ true[0])
        return np.concatenate([tilt, acceleration - true[1], moving - true[2]])

    def outputs(self, x):
        """Return all that can be measured, in the order of `OUTPUTS`."""
        part = dict(zip(FULL.names, x, strict=True))
        c, v, p, _, gyro = self.computed(x)
        arm = self.l + [part[f"l_{i}"] for i in "FLU"]
        earth, transport = earth_and_transport(v, p)
        w_nb = gyro - c.T @ (earth + transport)
        meridian, normal = curvature(p[0])
        per_metre = 1 / np.array([meridian + p[2], -(normal + p[2]) * np.cos(p[0]), 1.0])
        place = p + per_metre * (c @ arm)
        # Where the antenna is metres are others, for the same rates of latitude and longitude.
        meridian, normal = curvature(place[0])
        metres = np.array([meridian + place[2], -(normal + place[2]) * np.cos(place[0]), 1.0])
        speed = metres * per_metre * v + c @ np.cross(w_nb, arm)
        wheels = self.wheels + [part[f"odo_l_{i}"] for i in "FLU"]
        mounting = small_rotation(np.array([0.0, part["odo_pitch"], part["odo_yaw"]]))
        rolling = mounting @ (c.T @ v + np.cross(w_nb, wheels))
        rolling[0] *= 1 + part["odo_scale"]
        heading = np.arctan2(-c[1, 0], c[0, 0])
        return np.concatenate([speed, place, rolling, v, w_nb, [heading]])

    def model(self, **options):
        return error_model(
            self.p[0],
            self.p[2],
            specific_force=self.c @ self.force,
            velocity=self.v,
            attitude=self.c,
            angular_rate=self.w_nb,
            lever_arm=self.l,
            odometer_arm=self.wheels,
            estimated=EVERYTHING,
            outputs=OUTPUTS,
            **options,
        )


# Steps small enough for the products of errors, large enough for rounding.
STEPS = np.array(
    [1e-4] * 3
    + [1e-1] * 3
    + [1e-4, 1e-4, 10.0]
    + [1e-5] * 3
    + [1e-1] * 3
    + [0.1] * 3  # arm of the antenna
    + [1e-4] * 9  # gyros
    + [1e-3] * 9  # accelerometers
    + [1e-6] * 9  # sensitivity to acceleration
    + [1e-2]  # odometer
    + [1e-4] * 2
    + [0.1] * 3
)
# What an error in an entry must be small against: the natural size of the rates, and of
# the outputs.
SIZES = np.array([1e-4] * 3 + [10.0] * 3 + [1e-4, 1e-4, 100.0])
OUTPUT_SIZES = np.array([1, 1, 1, 1e-7, 1e-7, 1] + [1] * 6 + [1e-4] * 3 + [1e-3])


def differences(f, n):
    columns = []
    for i in range(n):

        def at(step, i=i):
            x = np.zeros(n)
            x[i] = step
            return (f(x) - f(-x)) / (2 * step)

        wide, narrow = at(STEPS[i]), at(STEPS[i] / 2)
        columns.append((4 * narrow - wide) / 3)
    return np.array(columns).T


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["include", "omit"]))
def test_every_entry_of_a_is_the_derivative_of_the_mechanisation(seed, gradient):
    vehicle = Vehicle(np.random.default_rng(seed))
    system = vehicle.model(gravity_gradient=gradient)
    expected = differences(lambda x: vehicle.error_rates(x, gradient), 51)
    # In units of each rate for a change of each state that matters.
    unit = SIZES[:, None] / (1e3 * STEPS)
    assert np.abs((system.A[:9] - expected) / unit).max() < 1e-6
    # Entries of size are right to seven digits each.
    large = np.abs(expected) > 1e-3 * unit
    assert np.allclose(system.A[:9][large], expected[large], rtol=1e-5, atol=0)
    assert not system.A[9:].any()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_every_entry_of_c_is_the_derivative_of_what_is_measured(seed):
    vehicle = Vehicle(np.random.default_rng(seed))
    system = vehicle.model()
    expected = differences(vehicle.outputs, 51)
    assert np.abs((system.C - expected) / OUTPUT_SIZES[:, None] * STEPS).max() < 1e-6
    assert np.allclose(system.C, expected, rtol=1e-5, atol=1e-8 * np.abs(expected).max())


def test_fewer_states_are_columns_of_the_full_model():
    vehicle = Vehicle(np.random.default_rng(5))
    full = vehicle.model()
    some = error_model(
        vehicle.p[0],
        vehicle.p[2],
        specific_force=vehicle.c @ vehicle.force,
        velocity=vehicle.v,
        attitude=vehicle.c,
        angular_rate=vehicle.w_nb,
        odometer_arm=vehicle.wheels,
        # In any order.
        estimated=("odometer_scale", "accelerometer_nonorthogonality", "gyro_scale"),
        outputs=("heading", "odometer"),
    )
    columns = [full.names.index(name) for name in some.names]
    rows = [full.outputs.index(name) for name in some.outputs]
    assert some.outputs == ("odometer", "heading")
    assert np.array_equal(some.A, full.A[np.ix_(columns, columns)])
    assert np.array_equal(some.C, full.C[np.ix_(rows, columns)])
    assert len(some.prior) == len(some.units) == some.n == 22
    assert len(some.noise) == 2


def test_a_model_at_rest_is_the_static_base():
    static = static_base(0.7, 120.0)
    moving = error_model(0.7, 120.0, gravity_gradient="omit")
    assert np.array_equal(static.A, moving.A)
    assert np.array_equal(static.C[:, 3:9], np.eye(6))
    assert static.names == gm.inertial.NAMES


def test_gravity_and_radii_of_the_ellipsoid():
    # NIMA TR8350.2, table 3.4: gravity at the equator and the poles.
    assert gm.inertial.gravity(0.0) == 9.7803253359
    assert abs(gm.inertial.gravity(math.pi / 2) - 9.8321849378) < 1e-9
    # Polar radius of curvature, ibid.
    assert abs(gm.inertial.radii(math.pi / 2)[0] - 6399593.6258) < 1e-3
    # Free air: about 3.086e-6 a metre.
    slope = (gm.inertial.gravity(0.8, 100.0) - gm.inertial.gravity(0.8)) / 100
    assert abs(slope + 3.083e-6) < 5e-9


def test_rotation_turns_clockwise_nose_up_and_right_side_down():
    east = rotation(math.pi / 2) @ [1, 0, 0]
    assert np.allclose(east, [0, -1, 0])
    assert np.allclose(rotation(0, math.pi / 2) @ [1, 0, 0], [0, 0, 1])
    # Left of the body rises when the right side goes down.
    assert np.allclose(rotation(0, 0, math.pi / 2) @ [0, 1, 0], [0, 0, 1])


STRAIGHT = Leg(60.0)


def test_a_straight_flight_leaves_three_combinations():
    for legs in ([STRAIGHT], [STRAIGHT, STRAIGHT]):
        found = segments(legs, 0.6, speed=0.0).piecewise()
        assert found.total_ranks[-1] == 12


def test_a_quarter_turn_with_acceleration_makes_all_three_observable():
    latitude = math.radians(28.15)
    legs = [
        STRAIGHT,
        Leg(30.0, turn=math.pi / 2, speed_change=10.0),
        Leg(20.0, speed_change=20.0),
    ]
    flight = segments(legs, latitude, speed=50.0)
    assert flight.upto(0).piecewise().rank == 12
    assert flight.upto(1).piecewise().rank == 15
    assert flight.piecewise().rank == 15
    # And by how much: the three combinations before and after, in prior units.
    root = np.diag(flight.system.prior)
    ratios = {}
    for name, path in (("straight", [Leg(110.0)]), ("maneuver", legs)):
        rows = segments(path, latitude, speed=50.0).rows(dt=1.0)
        found = gm.linear._degrees.posterior(
            rows @ root, root, flight.system.names, flight.system.units, 110.0
        )
        ratios[name] = dict(zip(found.names, found.ratio, strict=True))
    assert ratios["straight"]["phi_U"] > 0.99
    assert ratios["maneuver"]["phi_U"] < 0.3
    assert ratios["straight"]["Delta_N"] > 0.9
    assert ratios["maneuver"]["Delta_N"] < 0.6
    assert ratios["maneuver"]["phi_N"] < 0.7 * ratios["straight"]["phi_N"]


def test_lever_arm_needs_rotation():
    still = error_model(0.6, estimated=["lever_arm"])
    turning = error_model(0.6, estimated=["lever_arm"], angular_rate=(0.0, 0.1, 0.3))
    assert gm.linear.levels(still).nullity > gm.linear.levels(turning).nullity


POLE = math.pi / 2
BAD = [
    (lambda: static_base(1.6), "latitude = 1.6 rad: must be within"),
    (lambda: static_base(-90.0), "latitude = -90.0 rad: must be within"),
    (lambda: static_base(POLE), "is a pole: west and longitude do not exist there"),
    (lambda: static_base(-POLE), "is a pole"),
    (lambda: static_base(math.radians(90)), "is a pole"),
    (lambda: static_base(math.nan), "latitude = nan"),
    (lambda: static_base(0.5, math.inf), "height = inf"),
    (lambda: static_base(0.5, tilt=0.0), "tilt = 0"),
    (lambda: error_model(0.5, velocity=(1.0, 2.0)), "velocity = "),
    (lambda: error_model(0.5, attitude=2 * np.eye(3)), "attitude is not a rotation"),
    (lambda: error_model(0.5, gravity_gradient="some"), "gravity_gradient = 'some'"),
    (lambda: error_model(0.5, estimated="lever_arm"), "estimated = .*sequence of names"),
    (lambda: error_model(0.5, estimated=["lever"]), r"estimated\[0\] = 'lever': must be one of"),
    (lambda: error_model(0.5, estimated=["lever_arm"] * 2), "has 'lever_arm' twice"),
    (
        lambda: error_model(
            0.5, estimated=["accelerometer_misalignment", "accelerometer_nonorthogonality"]
        ),
        "give one",
    ),
    (lambda: error_model(0.5, outputs=[]), "outputs is empty"),
    (lambda: error_model(0.5, outputs=["speed"]), r"outputs\[0\] = 'speed'"),
    (lambda: error_model(0.5, heading_noise=0.0), "heading_noise = 0"),
    (
        lambda: error_model(0.5, attitude=rotation(0, POLE), outputs=["heading"]),
        "nose up or down: there is no heading",
    ),
    (lambda: segments([], 0.5), "legs is empty"),
    (lambda: segments([Leg(0.0)], 0.5), "duration = 0"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def test_a_latitude_next_to_the_pole_is_finite():
    system = static_base(math.radians(89.9999))
    assert np.isfinite(system.A).all()
    assert gm.linear.levels(system).rank in (11, 12)
