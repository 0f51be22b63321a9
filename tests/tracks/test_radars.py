"""Radars with biases: against reported truth, with late clocks, missing and gross reports."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import (
    Carrier,
    Motion,
    Scene,
    Sensor,
    estimate,
    estimate_many,
    problem,
    simulate,
)

TIMES = np.arange(0.0, 200.0, 1.0)
STATE = {
    "x0": -20000.0,
    "y0": 25000.0,
    "vx": 240.0,
    "vy": 60.0,
    "range_bias": 300.0,
    "azimuth_bias": 0.008,
    "late": 0.5,
}


def radar(carrier, clock="late"):
    return [
        Sensor.range(carrier, TIMES, sigma=50.0, bias="range_bias", clock=clock),
        Sensor.bearing(carrier, TIMES, sigma=0.00175, bias="azimuth_bias", clock=clock),
    ]


def scene(carrier, clock="late"):
    reports = Sensor.position(TIMES[::5], sigma=30.0, name="ads-b")
    return Scene(Motion.constant_velocity(), [*radar(carrier, clock), reports])


SITE = Carrier([0.0, 0.0], name="radar")


def test_one_radar_against_reported_truth():
    seen = scene(SITE)
    bound = gm.analyze(problem(seen, STATE)).crlb_std
    assert np.isfinite(bound).all()
    truth = seen.state(STATE)
    found = estimate_many(seen, simulate(seen, STATE, trials=300, seed=1))
    ratio = np.sqrt(((found.state - truth) ** 2).mean(axis=0)) / bound
    assert (np.abs(ratio - 1) < 0.13).all(), ratio


def test_a_clock_that_is_not_asked_for_moves_the_answer():
    """And a bias of the clock that is a state does not."""
    seen, blind = scene(SITE), scene(SITE, clock=None)
    z = simulate(seen, STATE, seed=2)
    for one, names in ((seen, ("range_bias", "azimuth_bias", "late")), (blind, ("range_bias",))):
        found = estimate(one, z)
        off = [abs(found[name] - STATE[name]) / found.std[one.index(name)] for name in names]
        assert max(off) < 4 if one is seen else max(off) > 4, off


def test_a_gross_report_does_not_move_a_robust_answer():
    seen = scene(SITE)
    z = simulate(seen, STATE, seed=3)
    clean = estimate(seen, z)
    z[77] += 20000.0
    assert estimate(seen, z).status == "misfit"
    robust = estimate(seen, z, loss="tukey")
    moved = np.abs(robust.state - clean.state) / clean.std
    assert (moved < 0.5).all(), moved
    assert 77 in robust.fit.outliers


def test_missing_reports_are_missing():
    seen = scene(SITE)
    z = simulate(seen, STATE, seed=4)
    z[[3, 8, 210, 300]] = np.nan
    found = estimate(seen, z)
    assert found.fit.dof == seen.m - 4 - seen.n
    assert (np.abs(found.state - seen.state(STATE)) < 5 * found.std).all()


def test_a_moving_platform_with_an_error_of_its_heading():
    """A ship that turns tells its heading error by itself; on one course reports are needed."""
    straight = Carrier([[0, 0], [0, 2000]], [0.0, 200.0])
    bent = Carrier([[0, 0], [0, 1000], [1000, 1000]], [0.0, 100.0, 200.0])
    state = {name: value for name, value in STATE.items() if name != "late"}
    for carrier, nullity in ((straight, 1), (bent, 0)):
        alone = Scene(Motion.constant_velocity(), radar(carrier, clock=None))
        assert gm.analyze(problem(alone, state)).nullity == nullity
        with_reports = scene(carrier, clock=None)
        assert gm.analyze(problem(with_reports, state)).nullity == 0


@pytest.mark.parametrize("true_path", [False, True])
def test_stamps_of_a_moving_platform(true_path):
    """On the same stamps the carrier drops out of a late clock; on true time it does not."""
    ship = Carrier([[0, 0], [3000, 0]], [0.0, 200.0])
    sensor = Sensor.range(ship, TIMES, sigma=1.0, clock="late", true_path=true_path)
    seen = Scene(Motion.constant_velocity(), [sensor])
    state = np.array([5000.0, 4000.0, -20.0, 10.0, 2.0])
    u = TIMES - 2.0
    target = state[:2] + u[:, None] * state[2:4]
    place = np.stack([15.0 * (u if true_path else TIMES), 0 * u], axis=1)
    wanted = np.hypot(*(target - place).T)
    np.testing.assert_allclose(seen.values(state), wanted, rtol=1e-12)
