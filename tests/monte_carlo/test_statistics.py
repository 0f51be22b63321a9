"""The sums of a Monte Carlo run: right, and the same bits for any chunks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm
from gramian.monte_carlo.result import _states
from gramian.monte_carlo.statistics import LEAF, Tree, moments
from monte_carlo_cases import Level, mean


def tree(values, ok, chunk):
    total = Tree()
    for first in range(0, len(values), chunk):
        total.add(moments(values[first : first + chunk], ok[first : first + chunk]))
    return total.total()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 700), st.integers(1, 3), st.integers(0, 2**32), st.floats(0, 1))
def test_moments_do_not_depend_on_chunks_and_agree_with_numpy(trials, d, seed, share):
    random = np.random.default_rng(seed)
    values = random.normal(3.0, 2.0, (trials, d))
    ok = random.random(trials) < share
    values[~ok] = np.nan
    whole = tree(values, ok, 1024)
    for chunk in (LEAF, 4 * LEAF, 256):
        other = tree(values, ok, chunk)
        np.testing.assert_array_equal(whole.node, other.node)
    good = values[ok]
    assert whole.count == len(good)
    if len(good):
        np.testing.assert_allclose(whole.mean, good.mean(axis=0), rtol=1e-12)
        deviation = good - good.mean(axis=0)
        np.testing.assert_allclose(whole.scatter, deviation.T @ deviation, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(whole.fourth, (good**4).sum(axis=0), rtol=1e-12)
        np.testing.assert_array_equal(whole.low, good.min(axis=0))
        np.testing.assert_array_equal(whole.high, good.max(axis=0))


def test_a_large_offset_does_not_spoil_the_variance():
    random = np.random.default_rng(1)
    values = 1e9 + random.normal(size=(5000, 1))
    found = tree(values, np.ones(5000, dtype=bool), 64)
    np.testing.assert_allclose(found.scatter[0, 0], 5000 * np.var(values), rtol=1e-9)


@pytest.mark.parametrize("tails", ["normal", "long"])
def test_intervals_hold_what_they_promise(tails):
    """Of 400 runs, the 95 % intervals miss the true value in about 5 %."""
    random = np.random.default_rng(5)
    misses = {"bias": 0, "rmse": 0, "std": 0}
    runs, trials = 400, 300
    for _ in range(runs):
        draws = random.standard_t(8, trials) if tails == "long" else random.normal(size=trials)
        spread = np.sqrt(8 / 6) if tails == "long" else 1.0
        found = _states(moments(0.3 + draws[:, None], np.ones(trials, dtype=bool)), 1)
        true = {"bias": 0.3, "rmse": np.hypot(0.3, spread), "std": spread}
        for name, value in true.items():
            low, high = found[f"{name}_interval"][0]
            misses[name] += not low <= value <= high
    for name, count in misses.items():
        # 5 %, give or take three standard deviations of a count of 400; long
        # tails are estimated from the trials themselves, which costs a little.
        assert 7 <= count <= (33 if tails == "normal" else 40), (name, count)


def test_nees_of_a_consistent_estimator_has_its_band_and_a_bold_one_has_not():
    def honest(z):
        return [z.mean()], [[1 / z.size]]

    def bold(z):
        return [z.mean()], [[0.5 / z.size]]

    good = gm.monte_carlo.run(Level(10), 4000, 3, honest)
    assert good.nees.consistent
    assert good.nees.dof == 1
    assert good.nees.count == 4000 == good.nees.histogram.sum()
    assert abs(good.nees.inside - 0.95) < 0.012
    bad = gm.monte_carlo.run(Level(10), 4000, 3, bold)
    assert not bad.nees.consistent
    np.testing.assert_allclose(bad.nees.mean, 2 * good.nees.mean, rtol=1e-12)
    # Without a covariance of its own, an estimator is held to the bound.
    held = gm.monte_carlo.run(Level(10), 4000, 3, mean)
    np.testing.assert_allclose(held.nees.mean, good.nees.mean, rtol=1e-12)


def test_a_few_trials_promise_little():
    one = gm.monte_carlo.run(Level(10), 1, 1, mean)
    assert one.used == 1
    assert one.bias_interval[0].tolist() == [-np.inf, np.inf]
    assert np.isfinite(one.rmse[0])
    assert not np.isnan(one.rmse_interval).any()
    assert not np.isnan(one.std_interval).any()
    two = gm.monte_carlo.run(Level(10), 2, 1, mean)
    assert np.ptp(two.rmse_interval) > two.rmse[0]


def test_errors_of_zero_and_bounds_of_infinity_give_no_nonsense():
    class Plain(gm.monte_carlo.Experiment):
        names = ("a", "b")
        truth = np.zeros(2)

        def simulate(self, seed, first, trials):
            return np.zeros((trials, 2))

        def problem(self):
            return gm.Problem([[1.0, 0.0]], self.names)

    exact = gm.monte_carlo.run(Plain(), 100, 1, lambda z: z)
    assert exact.rmse.tolist() == [0.0, 0.0]
    assert exact.verdict.startswith("BELOW THE BOUND")
    assert "nan" not in exact.summary()
    off = gm.monte_carlo.run(Plain(), 100, 1, lambda z: z + 2.0)
    assert off.verdict == "ABOVE THE BOUND: RMSE / bound of a is 2.000"
    assert off.summary().count("not observable") == 1
    exact.plot()
