"""Noisy bearings: the size and power of the observability test, and its streaming form."""

import numpy as np
import pytest
from scipy import optimize, stats

import gramian as gm
from gramian import _core

B = gm.bearings
SIGMA = np.radians(0.5)
TIMES = 20.0 * np.arange(60)


def straight(x=0.0, y=1e4, vx=3.0, vy=-6.0, times=TIMES):
    """Bearings of one relative motion: an unobservable track."""
    t = times - times[0]
    return np.arctan2(x + vx * t, y + vy * t)


def turned(turn, times=TIMES):
    t = times - times[0]
    before = np.minimum(t, t[t.size // 2])
    after = t - before
    east, north = 5 * after * np.sin(turn), 5 * (before + after * np.cos(turn))
    return np.arctan2(3 * t - east, 1e4 - t - north)


def noisy(exact, trials, seed, sigma=SIGMA):
    return exact + sigma * _core.normals(seed, 0, trials, exact.size)


# Each is a family of its own: crossing, passing through +-pi, approaching, far away.
MOTIONS = {
    "crossing": {},
    "passing south": {"x": -3000.0, "y": -2000.0, "vx": 5.0, "vy": 0.0},
    "approaching": {"x": 50.0, "y": 9000.0, "vx": 0.3, "vy": -3.0},
    "far": {"y": 5e4},
}


@pytest.mark.parametrize("name", MOTIONS)
def test_the_size_is_the_level(name):
    bearings = noisy(straight(**MOTIONS[name]), 20_000, 11)
    wrapped = bearings - 2 * np.pi * np.round(bearings / (2 * np.pi))
    found = B.observability_test(TIMES, wrapped, SIGMA)
    for level in (0.005, 0.01, 0.05, 0.10):
        deviation = np.sqrt(level * (1 - level) / 20_000)
        rate = (found.p_value < level).mean()
        assert abs(rate - level) < 4 * deviation, (level, rate)
    # The whole distribution, not only its tail.
    assert stats.kstest(found.p_value, "uniform").pvalue > 1e-4


def test_few_bearings_and_unequal_noise():
    times = np.array([0.0, 5.0, 11.0, 30.0, 31.0])
    sigma = np.radians([0.1, 0.5, 0.2, 0.1, 0.4])
    exact = straight(x=-200.0, y=1000.0, vx=20.0, vy=3.0, times=times)
    bearings = exact + sigma * _core.normals(2, 0, 20_000, 5)
    found = B.observability_test(times, bearings, sigma)
    assert found.dof == 2
    assert abs((found.p_value < 0.05).mean() - 0.05) < 0.008


def test_power_grows_with_the_turn():
    power = [
        B.observability_test(TIMES, noisy(turned(np.radians(a)), 2000, 5), SIGMA).rejected.mean()
        for a in (0, 5, 10, 20, 60)
    ]
    assert abs(power[0] - 0.05) < 0.02
    assert power == sorted(power)
    assert 0.07 < power[1] < 0.15
    assert power[3] > 0.9
    assert power[4] == 1.0


def test_the_statistic_is_the_least_squares_minimum():
    for seed in range(6):
        bearings = noisy(turned(0.02 * seed), 1, seed)[0]
        found = B.observability_test(TIMES, bearings, SIGMA)
        t = TIMES / TIMES[-1]
        center = bearings.mean()

        def residuals(c, t=t, b=bearings - center):
            return (b - np.arctan2(c[0] + c[1] * t, 1 + c[2] * t)) / SIGMA

        fits = [
            optimize.least_squares(residuals, [0.0, 0.0, slope], xtol=1e-12, ftol=1e-12, gtol=1e-12)
            for slope in (-0.5, 0.0, 0.5)
        ]
        wanted = min(2 * fit.cost for fit in fits)
        assert found.statistic == pytest.approx(wanted, rel=1e-6, abs=1e-4)
        assert found.p_value == pytest.approx(stats.chi2.sf(wanted, 57), rel=1e-4)


def test_the_p_value_is_scipys():
    for m in (4, 5, 10, 61, 400):
        times = np.arange(float(m))
        rng = np.random.default_rng(m)
        bearings = 0.01 * rng.normal(size=(50, m)) * rng.uniform(0.5, 1.5, (50, 1))
        found = B.observability_test(times, bearings, 0.01)
        wanted = stats.chi2.sf(found.statistic, m - 3)
        assert found.p_value == pytest.approx(wanted, rel=1e-9, abs=1e-14)


def test_exact_bearings_of_a_straight_motion_fit_and_give_the_motion_back():
    found = B.observability_test(TIMES, straight(x=-3000, y=-2000, vx=5, vy=1), SIGMA)
    assert found.statistic < 1e-4
    assert found.verdict == "not shown observable"
    motion = np.array([-3000, -2000, 5, 1]) / np.hypot(3000, 2000)
    assert found.relative_motion == pytest.approx(motion, rel=1e-4)
    assert found.course == pytest.approx(np.arctan2(5, 1), rel=1e-4)
    assert "course" in found.summary()
    assert found.to_dict()["dof"] == 57


def test_wrapping_turning_and_units_change_nothing():
    bearings = noisy(turned(0.1), 1, 4)[0]
    one = B.observability_test(TIMES, bearings, SIGMA)
    whole_turns = bearings + 2 * np.pi * (np.arange(60) % 3 - 1)
    for other in (
        B.observability_test(TIMES, whole_turns, SIGMA),
        B.observability_test(TIMES, bearings + 2.0, SIGMA),
        B.observability_test(TIMES * 1e-3 + 1e3, bearings, SIGMA),
        B.observability_test(TIMES, bearings, np.full(60, SIGMA)),
    ):
        assert other.statistic == pytest.approx(one.statistic, rel=1e-6)
    turned_by_2 = B.observability_test(TIMES, bearings + 2.0, SIGMA)
    assert np.sin(turned_by_2.course - one.course - 2.0) == pytest.approx(0, abs=1e-3)


def test_batches_equal_single_calls():
    bearings = noisy(turned(0.1), 6, 9).reshape(2, 3, 60)
    many = B.observability_test(TIMES, bearings, SIGMA, level=0.1)
    assert many.statistic.shape == (2, 3)
    assert many.relative_motion.shape == (2, 3, 4)
    assert many.verdict.shape == (2, 3)
    assert many.statistic[1, 2] == B.observability_test(TIMES, bearings[1, 2], SIGMA).statistic
    assert "% of 6 tracks" in many.summary()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: B.observability_test([0, 1, 2], [0, 0, 0], 0.1), "3 bearings: at least 4"),
        (
            lambda: B.observability_test(range(5), [0.0] * 5, 0.0),
            r"sigma\[0\] = 0 rad: must be > 0",
        ),
        (lambda: B.observability_test(range(5), [0.0] * 5, [0.1] * 4), "sigma has shape"),
        (lambda: B.observability_test([0, 1, 1, 2], [0.0] * 4, 0.1), "must be later"),
        (lambda: B.observability_test(range(4), [0, 0, np.nan, 0], 0.1), r"bearings\[2\] = nan"),
        (lambda: B.observability_test(range(4), [0.0] * 4, 0.1, level=1.0), "level = 1"),
        (lambda: B.Monitor().push(0.0, np.inf, 0.1), "bearing = inf"),
        (lambda: B.Monitor().push(0.0, 0.1, -1.0), r"sigma\[0\] = -1 rad"),
        (lambda: B.Monitor().push(0.0, 0.1, 0.1, 0.0), r"distance\[0\] = 0 m"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def test_the_monitor_agrees_with_the_batch_answers():
    target = np.array([0.0, 1e4, 3.0, -1.0])
    before = np.minimum(TIMES, 600.0)
    path = np.stack([5 * (TIMES - before), 5 * before], axis=1)
    offsets = target[:2] + TIMES[:, None] * target[2:] - path
    ranges = np.hypot(*offsets.T)
    bearings = np.arctan2(*offsets.T)
    monitor = B.Monitor()
    for i in range(60):
        answer = monitor.push(TIMES[i], bearings[i], SIGMA, ranges[i])
        assert answer.count == i + 1
        rows = B.rows(TIMES[: i + 1], path[: i + 1], target, SIGMA)
        batch = gm.analyze(rows, names=B.NAMES)
        assert answer.rank == batch.rank
        assert answer.crlb_std == pytest.approx(batch.crlb_std, rel=1e-6)
        if i >= 4:
            assert answer.singular_value == pytest.approx(
                batch.singular_values[-1], rel=1e-6, abs=1e-14
            )
        if answer.rank == 4:
            assert answer.logdet == pytest.approx(batch.logdet, abs=1e-6)
            weights = 1 / (SIGMA * ranges[: i + 1]) ** 2
            det = B.discriminant_sum(TIMES[: i + 1], bearings[: i + 1], weights)
            assert answer.det == pytest.approx(det, rel=1e-7)


def test_the_streaming_statistic_has_its_size_where_the_range_changes():
    # The target comes from 10 km to 4 km; the batch test and the monitor side by side.
    exact = straight(x=-1000.0, y=1e4, vx=4.0, vy=-5.5)
    bearings = noisy(exact, 1500, 21)
    batch = B.observability_test(TIMES, bearings, SIGMA)
    stream = []
    for row in bearings:
        monitor = _core.BearingMonitor()
        for t, b in zip(TIMES, row, strict=True):
            monitor.push(t, b, SIGMA, None)
        answer = monitor.answer()
        stream.append((answer.statistic, answer.dof, answer.p_value))
    statistic, dof, p_value = np.array(stream).T
    assert statistic.mean() == pytest.approx(dof.mean(), rel=0.02)
    assert abs((p_value < 0.05).mean() - 0.05) < 0.02
    assert np.corrcoef(p_value, batch.p_value)[0, 1] > 0.8


def test_a_monitor_refuses_and_goes_on():
    monitor = B.Monitor()
    monitor.push(0.0, 0.1, 0.01)
    for bad in ((0.0, 0.1, 0.01, None), (1.0, 0.1, 0.01, 5.0)):
        with pytest.raises(gm.InputError):
            monitor.push(*bad)
    assert monitor.push(1.0, 0.1, 0.01).count == 2
