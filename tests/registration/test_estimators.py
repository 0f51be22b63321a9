"""Registration: estimators against the bound, and select, field, match."""

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg

SENSORS = {"A": (0.0, 0.0), "B": (60e3, 0.0)}
SIGMA = (50.0, np.radians(0.1))
K = np.arange(200.0)
A = np.stack([-20e3 + 400 * K, 25e3 + 0 * K], axis=1)
C = np.stack([90e3 + 50 * K, 100e3 + 200 * K], axis=1)
TRUTH = np.array([300.0, np.radians(0.5), -200.0, np.radians(-0.4)])
LARGE = np.array([1500.0, np.radians(3.0), -1500.0, np.radians(-3.0)])


def errors(track, truth, trials=1000, **options):
    answer = reg.estimate_trials(track, SENSORS, SIGMA, truth, seed=2013, trials=trials, **options)
    assert (answer.status == "determined").all()
    return answer.biases - truth, answer


def test_maximum_likelihood_reaches_the_bound():
    for track, tolerance in ((A, 0.06), (C, 0.10)):
        bound = gm.crlb_std(reg.problem(track, SENSORS, SIGMA))
        error, answer = errors(track, TRUTH)
        rmse = np.sqrt((error**2).mean(axis=0))
        assert np.abs(rmse / bound - 1).max() < tolerance
        assert abs(answer.chi_square.mean() / answer.dof - 1) < 0.01
        if track is A:
            # And says so itself. (On C the ellipsoid is a bent one, and long.)
            nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(answer.covariance), error)
            assert abs(nees.mean() / 4 - 1) < 0.12


def test_least_squares_is_worse_in_the_order_of_the_theory():
    for track in (A, C):
        rmse = {
            method: np.sqrt((errors(track, TRUTH, 300, method=method)[0] ** 2).mean(axis=0))
            for method in ("ls", "gls", "ml")
        }
        assert (rmse["ml"][[0, 2]] < rmse["gls"][[0, 2]]).all()
        assert (rmse["gls"][[0, 2]] < rmse["ls"][[0, 2]]).all()
    # Target C: linearisation and noise in H take least squares far off.
    assert rmse["ls"][0] > 3 * rmse["ml"][0]


def test_large_biases_want_linearising_again():
    standard_error = gm.crlb_std(reg.problem(A, SENSORS, SIGMA)) / np.sqrt(1000)
    ls, _ = errors(A, LARGE, 200, method="ls")
    assert np.abs(ls.mean(axis=0)[[0, 2]]).max() > 20.0
    ml, _ = errors(A, LARGE)
    assert (np.abs(ml.mean(axis=0)) < 4 * standard_error).all()
    gls, _ = errors(A, LARGE, 400, method="gls", iterations=10)
    assert (np.abs(gls.mean(axis=0)[[0, 2]]) < 3.0).all()
    assert (np.abs(gls.mean(axis=0)[[1, 3]]) < np.radians(0.005)).all()


def test_one_pass_is_simulate_and_estimate():
    track = A[::10]
    one = reg.estimate_trials(track, SENSORS, SIGMA, TRUTH, seed=4, trials=5, first=3)
    reports = reg.simulate(track, SENSORS, SIGMA, TRUTH, seed=4, trials=8)
    other = reg.estimate(reports, SENSORS, SIGMA)
    assert (one.biases == other.biases[3:]).all()
    assert (one.covariance == other.covariance[3:]).all()
    before = gm.set_threads(1)
    alone = reg.estimate_trials(track, SENSORS, SIGMA, TRUTH, seed=4, trials=5, first=3)
    gm.set_threads(before)
    assert (alone.biases == one.biases).all()


def test_the_covariance_of_least_squares_is_its_scatter():
    error, answer = errors(A, TRUTH * 0, 600, method="ls")
    assert answer.std.mean(axis=0) == pytest.approx(error.std(axis=0), rel=0.08)


def test_azimuths_wrap():
    north = np.stack([3e3 * np.sin(K / 9), 40e3 + 100 * K], axis=1)
    south = north * [1, -1]
    biases = {"A.azimuth": 0.02, "B.azimuth": -0.01, "A.range": 100.0}
    for track in (north, south, south - [30e3, 0]):
        quiet = reg.simulate(track, SENSORS, (1e-9, 1e-15), biases, seed=0)
        wrapped = quiet.values.copy()
        wrapped[..., 1] = np.angle(np.exp(1j * wrapped[..., 1]))
        answer = reg.estimate(wrapped, SENSORS, SIGMA)
        assert answer["A.azimuth"] == pytest.approx(0.02, abs=1e-9)
        assert answer["A.range"] == pytest.approx(100.0, abs=1e-5)


def test_three_sensors_in_space_with_gain_reach_the_bound():
    random = np.random.default_rng(7)
    sensors = {"A": (0, 0, 0), "B": (60e3, 0, 200), "C": (20e3, 50e3, 500)}
    sigma = (30.0, 1e-3, 1e-3)
    crowd = random.uniform([-30e3, -30e3, 2e3], [90e3, 90e3, 12e3], (120, 3))
    n = reg.problem(crowd, sensors, sigma, extras=["gain"]).n
    truth = np.tile([200.0, 0.01, -0.005, 0.002], 3) * np.repeat([1, -0.5, 0.7], 4)
    bound = gm.crlb_std(reg.problem(crowd, sensors, sigma, extras=["gain"], biases=truth))
    answer = reg.estimate_trials(crowd, sensors, sigma, truth, seed=1, trials=400, extras=["gain"])
    rmse = np.sqrt(((answer.biases - truth) ** 2).mean(axis=0))
    assert rmse.shape == (n,)
    assert np.abs(rmse / bound - 1).max() < 0.15


def test_select_is_greedy_and_its_bounds_are_those_of_the_chosen():
    random = np.random.default_rng(1)
    start = random.uniform(-60e3, 120e3, (15, 2))
    velocity = random.normal(0, 200, (15, 2))
    crowd = {f"T{i}": start[i] + velocity[i] * K[:60, None] for i in range(15)}
    chosen = reg.select(crowd, SENSORS, SIGMA, 4)
    joined = np.vstack([crowd[name] for name in chosen.chosen])
    bound = gm.crlb_std(reg.problem(joined, SENSORS, SIGMA))
    assert chosen.bounds[-1] == pytest.approx(bound, rel=1e-9)
    assert (np.diff(chosen.bounds, axis=0) <= 0).all()
    assert (chosen.bounds[-1] >= chosen.all_bounds).all()
    # The second choice beats every other by the marginal gain, worked out the long way.
    first = reg.fisher(crowd[chosen.chosen[0]], SENSORS, SIGMA)
    gains = {
        name: 0.5 * np.linalg.slogdet(first + reg.fisher(track, SENSORS, SIGMA))[1]
        for name, track in crowd.items()
        if name != chosen.chosen[0]
    }
    assert max(gains, key=gains.get) == chosen.chosen[1]
    assert chosen.gains[1] == pytest.approx(
        gains[chosen.chosen[1]] - 0.5 * np.linalg.slogdet(first)[1], rel=1e-6
    )
    pieces = reg.select(crowd, SENSORS, SIGMA, 3, piece=20, goal="A.range")
    track, looks = pieces.looks[pieces.chosen[0]]
    assert len(crowd[track][looks]) == 20


def test_select_prefers_rank_while_it_is_short():
    t = np.linspace(0.1, 0.9, 50)[:, None]
    crowd = {
        "on the baseline": t * [60e3, 0],
        "abeam": t * [0, 60e3],
        "free": [20e3, 80e3] + t * [40e3, 0],
    }
    assert reg.select(crowd, SENSORS, SIGMA, 1).chosen == ("free",)
    only = {name: crowd[name] for name in ("on the baseline", "abeam")}
    chosen = reg.select(only, SENSORS, SIGMA, 2)
    assert np.isinf(chosen.bounds[0]).any()
    assert np.isfinite(chosen.bounds[1]).all()
    assert np.isinf(chosen.gains).all()


def test_a_map_along_the_baseline_depends_on_the_heading():
    extent = (3e3, 57e3, -20e3, 20e3)
    east = reg.field(SENSORS, SIGMA, extent, heading=np.pi / 2, points=31, quantity="A.range")
    north = reg.field(SENSORS, SIGMA, extent, heading=0.0, points=31, quantity="A.range")
    assert east.values.shape == (23, 31)
    middle = 11
    assert east.north[middle] == pytest.approx(0, abs=1e-9)
    assert (east.values[middle] > 1e6).all()
    assert (north.values[middle] < 1e5).all()
    eta = reg.field(SENSORS, SIGMA, (-10e3, 70e3, -40e3, 40e3), points=40)
    assert ((eta.values >= 0) & (eta.values <= 1)).all()
    assert eta.values == pytest.approx(eta.values[::-1], rel=1e-6)


def test_match_pairs_or_interpolates_only_when_asked():
    t = np.arange(0.0, 100.0, 5.0)
    values = np.stack([1e4 + 100 * t, 3.1 + 0.002 * t], axis=1)
    same = reg.match({"A": (t, values), "B": (t, values + 1)})
    assert same.values.shape == (20, 2, 2)
    with pytest.raises(gm.InputError, match="do not match"):
        reg.match({"A": (t, values), "B": (t + 1, values)})
    with pytest.raises(gm.InputError, match="different length"):
        reg.match({"A": (t, values), "B": (t[1:], values[1:])})
    later = values + np.array([100.0, 0.002])
    wrapped = later.copy()
    wrapped[:, 1] = np.angle(np.exp(1j * wrapped[:, 1]))
    linear = reg.match({"A": (t, values), "B": (t + 1, wrapped)}, interpolate="linear")
    assert linear.times[0] == 5.0
    apart = linear.values[:, 1] - linear.values[:, 0]
    assert np.abs(np.angle(np.exp(1j * apart[:, 1]))).max() < 1e-12
    assert np.abs(apart[:, 0]).max() < 1e-9
    gap = np.delete(np.arange(20), [8, 9, 10, 11])
    recordings = {"A": (t, values), "B": (t[gap] + 1, wrapped[gap])}
    assert len(reg.match(recordings, interpolate="linear", max_gap=10.0).times) < 16


def test_degrees_of_raw_and_smoothed_reports():
    biases = {"A.azimuth": 0.008, "B.azimuth": -0.007}
    track = np.stack([6e3 + 100 * np.arange(400.0), np.zeros(400)], axis=1)
    noisy = reg.simulate(track, SENSORS, SIGMA, biases, seed=1)
    true = reg.degree(track, SENSORS, SIGMA, method="paper")
    raw = reg.degree(noisy, SENSORS, SIGMA, method="paper")
    better = reg.degree(noisy, SENSORS, SIGMA, method="paper", smoothing=101, biases=biases)
    assert true.max() < 1e-3
    assert np.median(raw) > 50 * np.median(better)
    eta = reg.degree(noisy, SENSORS, SIGMA, window=50)
    assert eta.shape == (400,)
    assert ((eta >= 0) & (eta <= 1)).all()
    some = reg.degree(track, SENSORS, SIGMA, method="pair", instants=[(0, 399), (5, 5)])
    assert some.shape == (2,)
    assert some[1] == 0
