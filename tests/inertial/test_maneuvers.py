"""Flights, and which of their legs makes which state observable."""

import math

import numpy as np
import pytest

import gramian as gm
from gramian.models.inertial import (
    Leg,
    error_model,
    gravity,
    maneuvers,
    recorded,
    rotation,
    segments,
    sway,
)

LATITUDE = math.radians(34.0)
LEVEL = (0.0, 0.0, gravity(LATITUDE))


def rank(*motions, **options):
    """Return the total rank of places that are held for 60 s each."""
    systems = [error_model(LATITUDE, **{**options, **motion}) for motion in motions]
    found = gm.linear.piecewise(
        [system.A for system in systems],
        [system.C for system in systems],
        [60.0] * len(systems),
        systems[0].names,
    )
    return found.rank


def test_ranks_of_the_literature():
    # Goshen-Meskin & Bar-Itzhack 1992, part II: a change of the specific force D leaves the
    # tilt along D, two changes that are not parallel leave nothing.
    north = {"specific_force": np.add(LEVEL, [2.0, 0, 0])}
    west = {"specific_force": np.add(LEVEL, [0, 2.0, 0])}
    turned = {"attitude": rotation(math.pi / 2)}
    assert rank({}) == 12
    assert rank({}, {}) == 12
    assert rank({}, north) == 14
    assert rank({}, west) == 14
    assert rank({}, north, west) == 15
    assert rank({}, turned) == 15


@pytest.mark.parametrize("turn", [-90.0, 30.0, 45.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("parts", [1, 7])
def test_a_straight_leg_tells_the_same_at_any_heading(turn, parts):
    legs = [Leg(60.0)] + [Leg(30.0 / parts, turn=math.radians(turn) / parts)] * parts
    found = maneuvers(segments([*legs, Leg(60.0)], LATITUDE, speed=50.0))
    assert found.rank_alone[0] == found.rank_alone[-1] == 12
    assert found.rank[-1] == 15


def test_aids_of_a_vehicle_that_stands():
    # Rate and velocity are known to be zero: all that the receiver's velocity tells too.
    standing = {"outputs": ["zero_velocity", "zero_angular_rate"]}
    # No position: three states less.
    assert rank({}, outputs=["velocity"]) == 9
    assert rank({}, **standing) == 9
    assert rank({}, outputs=["velocity", "position", "zero_velocity", "zero_angular_rate"]) == 12
    # A heading parts the azimuth from the west gyro.
    assert rank({}, outputs=["velocity", "position", "heading"]) == 13


def test_an_odometer_sees_its_scale_from_two_speeds_and_the_mounting_from_a_run():
    extra = {"estimated": ["odometer_scale", "odometer_mounting"]}
    seen = {"outputs": ["velocity", "position", "odometer", "side_slip"]}
    still = rank({}, **extra, **seen)
    moving = rank({"velocity": (20.0, 0.0, 0.0)}, **extra, **seen)
    assert still == 12
    assert moving > still
    turns = [
        {"velocity": (20.0, 0.0, 0.0)},
        {"velocity": (0.0, -20.0, 0.0), "attitude": rotation(math.pi / 2)},
        {"velocity": (0.0, -30.0, 0.0), "attitude": rotation(math.pi / 2)},
    ]
    assert rank(*turns, **extra, **seen) == 18


def test_a_recorded_turn_is_the_turn_of_legs():
    legs = segments(
        [Leg(60.0, turn=1.5)], LATITUDE, speed=50.0, step=1.0, largest_turn=1.0, heading=0.2
    )
    times = np.arange(0.0, 60.5)
    course = 0.2 + 1.5 * times / 60
    velocity = 50 * np.stack([np.cos(course), -np.sin(course), 0 * times], axis=1)
    attitude = np.stack([course, 0 * times, 0 * times], axis=1)
    own = recorded(times, velocity, attitude, LATITUDE, step=1.0, largest_turn=1.0)
    assert np.allclose(own.durations, legs.durations)
    assert np.allclose(own.heading, legs.heading)
    assert np.allclose(own.latitude, legs.latitude, atol=1e-8)
    # Over a chord the velocity is that of its ends, to second order in the turn.
    assert np.allclose(own.A, legs.A, atol=1e-3)


def test_sensors_that_turn_together_are_a_tilt():
    # Both triads turned by theta are a body turned by it: phi = C theta, M = [theta x].
    theta = np.array([1e-4, -2e-4, 3e-4])
    cross = np.array([[0, -theta[2], theta[1]], [theta[2], 0, -theta[0]], [-theta[1], theta[0], 0]])
    moved = {}
    for states in ("accelerometer_misalignment", "accelerometer_nonorthogonality"):
        for step in (0.4, 0.2):
            flight = sway(
                40.0, LATITUDE, amplitude=(0.6, 0.5, 0.4), period=(15.0, 11.0, 8.0), step=step,
                phase=(0.3, 1.0, 2.0), estimated=["gyro_misalignment", states],
            )  # fmt: skip
            x = dict.fromkeys(flight.system.names, 0.0)
            start = np.array([0.6, 0.5, 0.4]) * np.sin([0.3, 1.0, 2.0])
            for name, tilt in zip(
                ("phi_N", "phi_W", "phi_U"), rotation(*start) @ theta, strict=True
            ):
                x[name] = tilt
            for i, row in enumerate("FLU"):
                for j, column in enumerate("FLU"):
                    for sensor in ("gyro", "accel"):
                        if f"{sensor}_{row}{column}" in x:
                            x[f"{sensor}_{row}{column}"] = cross[i, j]
            moved[states, step] = np.abs(flight.rows(dt=1.0) @ list(x.values())).max()
    together = "accelerometer_misalignment"
    # Nothing is seen of it but what segments of constant attitude add, to second order.
    assert moved[together, 0.2] < moved[together, 0.4] / 3
    assert moved[together, 0.2] < 0.02 * moved["accelerometer_nonorthogonality", 0.2]


def test_maneuvers_of_a_flight():
    legs = [Leg(60.0), Leg(30.0, turn=math.pi / 2), Leg(20.0, speed_change=20.0)]
    flight = segments(legs, LATITUDE, speed=50.0)
    found = maneuvers(flight, legs=["straight", "turn", "faster"])
    assert found.rank.tolist() == [12, 15, 15]
    assert found.rank_alone[0] == 12
    assert set(found.gained(0)) == {"dV_N", "dV_W", "dV_U", "dL", "dlambda", "dh"}
    assert set(found.gained(1)) >= {"phi_N", "phi_W", "phi_U", "Delta_N", "Delta_W", "eps_W"}
    assert found.gained(2) == ()
    # More measurements never know less, and the first leg is the first leg alone.
    assert (np.diff(found.ratio, axis=0) <= 1e-9).all()
    assert np.allclose(found.ratio[0], found.ratio_alone[0])
    assert (found.known[0] == found.known_alone[0]).all()
    assert found.status == "weak"
    assert "straight, 60 s: 12, 12;" in found.summary()
    assert found.to_pandas().shape == (15, 13)  # with the units
    assert found.plot().axes


def test_straight_legs_northward_have_full_rank_and_tell_no_more():
    # The Earth's rate in local axes, the transport rate and gravity change with the latitude:
    # the null spaces of two legs have nothing in common. Along a parallel nothing changes.
    legs = [Leg(60.0), Leg(60.0)]
    north, east = (
        maneuvers(segments(legs, 0.6, speed=50.0, heading=heading))
        for heading in (0.0, math.pi / 2)
    )
    assert (north.rank.tolist(), east.rank.tolist()) == ([12, 15], [12, 12])
    assert np.abs(north.ratio[-1] / east.ratio[-1] - 1).max() < 0.01
    still = maneuvers(segments(legs, 0.6))
    assert still.rank.tolist() == [12, 12]


def test_scale_factors_need_their_own_motion():
    options = {
        "estimated": ["gyro_scale", "accelerometer_scale"],
        "speed": 50.0,
        "gyro_scale_error": 1e-3,
        "accelerometer_scale_error": 1e-3,
    }
    straight = maneuvers(segments([Leg(60.0)], LATITUDE, **options))
    turns = maneuvers(
        segments([Leg(60.0), Leg(60.0, turn=6.0), Leg(60.0, turn=-6.0)], LATITUDE, **options)
    )
    names = list(straight.names)
    scale = names.index("gyro_scale_U")
    assert not straight.known[-1][scale]
    assert straight.ratio[-1, scale] > 0.999
    assert turns.known[-1][scale]
    # 12 rad of turn: phi_U moves by 1e-3 of them, which is seen.
    assert turns.ratio[-1, scale] < 0.2
    # About the roll axis only the Earth turns: 1e-3 of it is as much as the prior of the bias.
    assert turns.ratio[-1, names.index("gyro_scale_F")] > 0.9


def test_a_swaying_base_parts_biases_and_tilts():
    assert gm.linear.levels(error_model(LATITUDE)).rank == 12
    # A small sway has full rank, and yet tells no more than rest; half a radian does.
    ratios = {}
    for size in (0.1, 0.5):
        found = maneuvers(
            sway(60.0, LATITUDE, amplitude=(0.05, size, size), period=(9.0, 7.0, 8.0))
        )
        assert found.rank[-1] == 15
        ratios[size] = found.ratio[-1, list(found.names).index("Delta_W")]
    resting = maneuvers(segments([Leg(60.0)], LATITUDE))
    still = resting.ratio[-1, list(resting.names).index("Delta_W")]
    assert abs(ratios[0.1] / still - 1) < 0.01
    assert ratios[0.5] < 0.95 * still
    # On a base that moves, too.
    moving = sway(
        60.0, LATITUDE, amplitude=(0.05, 0.1, 0.1), period=(9.0, 7.0, 8.0), velocity=(5.0, 3.0, 0.0)
    )
    assert moving.piecewise().rank == 15


def test_zero_velocity_is_known_only_while_the_vehicle_stands():
    legs = [Leg(20.0), Leg(10.0, speed_change=10.0), Leg(20.0)]
    flight = segments(legs, LATITUDE, outputs=["position", "zero_velocity", "zero_angular_rate"])
    zero = flight.C[:, 3:]
    assert np.abs(zero[flight.leg == 0]).max() == 1.0
    assert not zero[flight.leg > 0].any()


TIMES = np.arange(10.0)
STILL = np.zeros((10, 3))
BAD = [
    (lambda: recorded(TIMES[::-1], STILL, STILL, 0.5), r"times\[1\] = 8.0 s: must be later"),
    (lambda: recorded([0.0], [[0, 0, 0]], [[0, 0, 0]], 0.5), "times has shape"),
    (lambda: recorded(TIMES, STILL[:5], STILL, 0.5), r"velocity has shape \(5, 3\)"),
    (lambda: recorded(TIMES, STILL, STILL, 0.5, legs=[20.0]), r"legs\[0\] = 20.0 s"),
    (lambda: recorded(TIMES, STILL, STILL, 0.5, legs=[5.0, 3.0]), r"legs\[1\] = 3.0 s"),
    (lambda: recorded(TIMES, STILL, STILL, 0.5, step=0.0), "step = 0"),
    (lambda: recorded(TIMES, STILL, STILL, math.pi / 2), "is a pole"),
    (
        lambda: recorded(TIMES, STILL, STILL + np.outer(TIMES, [3.1, 0, 0]), 0.5),
        r"turns by 3.100e\+00 rad between samples 0 and 1",
    ),
    (lambda: sway(10.0, 0.5, amplitude=(0, 0, 0), period=(1.0, 0.0, 1.0)), "period = 0"),
    (lambda: maneuvers(None), "must be a Flight"),
    (lambda: maneuvers(segments([Leg(1.0)], 0.5), legs=["a", "b"]), "legs has 2 names"),
    (lambda: maneuvers(segments([Leg(1.0)], 0.5), dt=0.0), "dt = 0"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def weaving():
    times = np.arange(0.0, 200.0)
    heading = math.radians(45) + 0.3 * np.sin(times / 30)
    velocity = 50 * np.stack([np.cos(heading), -np.sin(heading), 0 * times], axis=1)
    return times, velocity, np.stack([heading, 0 * times, 0 * times], axis=1)


def failed_sample(times, velocity, attitude):
    return times, velocity, np.where((times == 50)[:, None], 0.0, attitude)


MIXED = [
    (lambda t, v, a: (t, v, np.degrees(a)), "they would agree with attitude in degrees"),
    (lambda t, v, a: (t, v * [1, -1, -1], a), "they would agree with velocity in north, east"),
    (lambda t, v, a: (t, v[:, [1, 0, 2]] * [-1, 1, 1], a), "agree with velocity in east, north"),
    (
        lambda t, v, a: (t, v * [1, -1, -1], np.degrees(a)),
        "velocity in north, east and attitude in degrees",
    ),
    (lambda t, v, a: (np.where(t > 100, t + 600, t), v, a), "nothing from 100 to 701 s"),
    (failed_sample, r"attitude\[50\] at 50 s jumps by .* deg and back"),
]


@pytest.mark.parametrize(("change", "message"), MIXED)
def test_a_flight_in_other_axes_or_units_or_with_holes_is_told(change, message):
    recorded(*weaving(), LATITUDE)
    with pytest.warns(UserWarning, match=message):
        recorded(*change(*weaving()), LATITUDE)


def test_an_attitude_in_degrees_is_refused_where_no_vehicle_has_it():
    times, velocity, attitude = weaving()
    with pytest.raises(gm.InputError, match=r"pitch = 3 rad: must be within .* is it in degrees"):
        recorded(times, velocity, np.add(attitude, [0, 3.0, 0]), LATITUDE)
    with pytest.raises(gm.InputError, match="roll = 20 rad: must be within"):
        recorded(times, velocity, np.add(attitude, [0, 0, 20.0]), LATITUDE)
