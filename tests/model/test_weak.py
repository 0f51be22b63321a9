"""Weak means weak: models know by what to measure the bounds of their states."""

import numpy as np
import pytest

import gramian as gm

TIMES = np.arange(0.0, 601.0, 30.0)


def observer(bow):
    """Along the x axis at 5 m/s, out of the line by `bow` in the middle."""
    s = TIMES / TIMES[-1]
    return np.c_[5 * TIMES, 4 * bow * s * (1 - s)]


def bearings(target, bow=1.0, sigma=0.01):
    return gm.bearings.problem(TIMES, observer(bow), target, sigma)


def test_an_observer_that_bows_by_a_metre_learns_nothing_of_the_range():
    found = gm.analyze(bearings([3000.0, 8000.0, 2.0, -3.0]))
    assert found.status == "weak"
    assert "its scale 8544 m" in found.reason
    found = gm.analyze(bearings([3000.0, 8000.0, 2.0, -3.0], bow=1500.0, sigma=1e-4))
    assert found.status == "observable"


def test_a_target_out_of_reach_is_weak():
    assert gm.analyze(bearings([0.0, 1e9, 2.0, -3.0], bow=500.0)).status == "weak"


def test_scales_go_by_the_range_and_the_time():
    problem = gm.bearings.problem(
        TIMES, observer(10.0), [600.0, 800.0, 1.0, 0, 0, 0], 0.01, order=2
    )
    np.testing.assert_allclose(problem.scale, np.repeat([1e3, 1e3 / 600, 1e3 / 600**2], 2))
    # A place that is fixed has no other.
    assert (
        gm.bearings.problem(TIMES, observer(1.0), [0.0, 500.0], 0.01, order=0).scale.tolist()
        == [500] * 2
    )


def test_a_track_of_any_sensors_is_measured_by_its_range():
    carrier = gm.tracks.Carrier(observer(1.0), TIMES)
    scene = gm.tracks.Scene(
        gm.tracks.Motion.constant_velocity(), [gm.tracks.Sensor.bearing(carrier, TIMES, sigma=0.01)]
    )
    state = [3000.0, 8000.0, 2.0, -3.0]
    problem = gm.tracks.problem(scene, state)
    np.testing.assert_allclose(problem.scale, bearings(state).scale)
    assert gm.analyze(problem).status == "weak"


def test_magnetometers_a_tenth_of_a_millimetre_apart_are_one():
    times = np.linspace(-10, 10, 41)
    r0, v, m = [-30.0, 15, 2], [3.0, 0, 0], [200.0, -100, 300]
    sensors = [[0.0, 0, 0], [0, 1e-4, 0]]
    found = gm.analyze(gm.dipole.problem(r0, v, m, times, 3e-10, sensors=sensors))
    assert found.status == "weak"
    apart = gm.analyze(gm.dipole.problem(r0, v, m, times, 1e-12, sensors=[[0.0, 0, 0], [0, 20, 0]]))
    assert apart.status == "observable"


def test_scales_of_ones_own_outrank():
    problem = bearings([3000.0, 8000.0, 2.0, -3.0]).with_scale([1e9] * 4)
    assert gm.analyze(problem).status == "observable"


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_the_verdict_does_not_depend_on_the_unit_of_length(factor):
    plain = gm.analyze(bearings([3000.0, 8000.0, 2.0, -3.0]))
    other = gm.analyze(
        gm.bearings.problem(
            TIMES, observer(1.0) * factor, np.array([3000.0, 8000.0, 2.0, -3.0]) * factor, 0.01
        )
    )
    assert (plain.status, other.status) == ("weak", "weak")
