"""Intervals and spreads are as wide as they should be: priors, outliers, correlated noise."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

BENCH = runpy.run_path(str(Path(__file__).parents[2] / "benches" / "dipole_coverage.py"))
CASES = BENCH["CASES"]
R0, V, M = [-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0]
TIMES = np.arange(21.0)
KNOWN = {"z": 5.0, "vz": 0.0}


# The mean of N trials of n states has a deviation of sqrt(2 / (N n)): 0.09 to 0.13 here;
# more where the correlation, of some 15 degrees of freedom, is fitted too.
@pytest.mark.parametrize(
    ("name", "trials", "most"),
    [
        ("prior of 30 % on the moment", 30, 1.3),
        ("Huber, 20 % outliers", 24, 1.35),
        ("correlation 0.9 fitted", 16, 1.7),
        ("sigma estimated", 30, 1.35),
    ],
)
def test_chi2_rises_at_the_truth_as_it_should(name, trials, most):
    found = BENCH["measured"](CASES[name], trials, 1, intervals=False, samples=40)
    assert 0.7 < found["rise"] < most
    assert 0.6 < found["spread"][1] < most + 0.2


def test_correlated_noise_taken_for_white_is_told_and_too_sure():
    case = replace(CASES["correlation 0.9 given"], options={})
    found = BENCH["measured"](case, 6, 1, intervals=False, samples=40)
    assert found["rise"] > 3
    assert found["status"] == {"misfit": 6}


def test_the_intervals_hold_the_truth():
    found = BENCH["measured"](CASES["median, short record"], 12, 3, samples=40)
    # 12 trials: 9 or more with 99.8 % each.
    assert min(found["held"].values()) >= 75


def test_the_fast_search_and_the_model_whiten_alike():
    y = gm.dipole.simulate(R0, V, M, TIMES, 1e-9, seed=4)
    answer = gm.dipole.localize(TIMES, y, KNOWN, sigma=1e-9, correlation=0.6, background="fit")
    left, rows = answer._handle.linearize(answer.state)
    assert left @ left == pytest.approx(answer.cost, rel=1e-9)
    # At the least, the residuals are across the columns.
    along = rows.T @ left / np.linalg.norm(rows, axis=0)
    assert abs(along).max() < 1e-4
    assert answer.correlation == 0.6


def test_a_missing_number_is_left_out_alone():
    y = gm.dipole.simulate(R0, V, M, TIMES, 1e-9, seed=5)
    holed = y.copy()
    holed[4, 1] = np.nan
    dropped = gm.dipole.localize(TIMES, holed, KNOWN, sigma=1e-9, missing="drop")
    assert dropped.dropped == 1
    assert dropped.weights.sum() == 62
    assert np.isnan(dropped.residuals).sum() == 1
    use = np.ones(y.shape, dtype=bool)
    use[4, 1] = False
    masked = gm.dipole.localize(TIMES, holed, KNOWN, sigma=1e-9, use=use)
    assert masked.dropped == 0
    np.testing.assert_array_equal(masked.state, dropped.state)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_broken_channel_is_not_used(channel):
    times = np.arange(0.0, 20.0, 0.25)
    y = gm.dipole.simulate(R0, V, M, times, 1e-9, seed=6) + 3e-5
    y[:, channel] = 1.7e-5
    check = gm.dipole.check_record(times, y)
    assert list(check.usable) == [k != channel for k in range(3)]
    answer = gm.dipole.localize(times, y, KNOWN, sigma=1e-9, use=check.usable, background="fit")
    assert answer.status == "determined"
    assert len(answer.names) == 7 + 2
    truth = answer.model.coordinates([*R0, *V, *M])
    truth[7:] = 3e-5
    assert answer.contains(truth, 0.9999)


def test_bad_masks_and_correlations():
    y = gm.dipole.simulate(R0, V, M, TIMES, 1e-9, seed=5)
    with pytest.raises(gm.InputError, match=r"use has shape \(2,\): must be \(3,\), \(1, 3\)"):
        gm.dipole.localize(TIMES, y, KNOWN, use=[True, False])
    with pytest.raises(gm.InputError, match="must be True or False"):
        gm.dipole.localize(TIMES, y, KNOWN, use=[1.0, 0.5, 0.0])
    with pytest.raises(gm.InputError, match="21 samples give 0 numbers for 7 unknowns"):
        gm.dipole.localize(TIMES, y, KNOWN, use=[False, False, False])
    with pytest.raises(gm.InputError, match=r"correlation = 1\.0: must be from 0 to below 1"):
        gm.dipole.localize(TIMES, y, KNOWN, correlation=1)
    with pytest.raises(gm.InputError, match="finite"):
        gm.dipole.localize_many(TIMES, np.where(y > 0, np.nan, y), KNOWN)


def test_samples_follow_a_likelihood_that_bends():
    # z known to 20 %: the moment goes with its cube.
    y = gm.dipole.simulate(R0, V, M, TIMES, 1e-9, seed=7)
    answer = gm.dipole.localize(TIMES, y, prior={"z": (5.0, 1.0)}, sigma=1e-9)
    passes = answer.sample_passes(100, 1)
    assert passes.shape == (100, 9)
    np.testing.assert_array_equal(passes[:10], answer.sample_passes(10, 1))
    size = passes[:, 2] / answer.r0[2]
    assert size.std() == pytest.approx(0.2, rel=0.3)
    moments = np.linalg.norm(passes[:, 6:], axis=1)
    slope, _ = np.polyfit(np.log(size), np.log(moments), 1)
    assert slope == pytest.approx(3, abs=0.5)


@pytest.mark.parametrize("more", [{}, {"correlation": "fit"}])
def test_as_many_numbers_as_states_tell_nothing_of_the_noise(more):
    t = np.array([0.0, 8.0])
    known = {"z": 5.0, "vz": 0.0, "mx": 10.0}
    y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-12, seed=1)
    found = gm.dipole.localize(t, y, known, **more)
    assert found.fit.dof == 0
    assert (found.status, found.freedom) == ("weak", 0)
    assert "the noise level cannot be estimated" in found.reason
    assert "give sigma" in found.reason
    assert np.isinf(found.std).all()
    assert np.isinf(found.covariance).all()
    free = np.array([name not in ("z0", "vz", "mx") for name in gm.dipole.NAMES])
    np.testing.assert_array_equal(found.pass_std, np.where(free, np.inf, 0.0))
    deviations = (found.speed[1], found.moment[1], found.closest.range_std, found.closest.time_std)
    assert deviations == (np.inf,) * 4
    assert found.interval("range").pieces == ((None, None),)
    assert found.contains(found.state + 1.0)
    assert "inf" in found.summary()
    assert found.widened() is found
    for ask in (lambda: found.region(("x0", "y0")), found.sample):
        with pytest.raises(gm.InputError, match="give sigma"):
            ask()
    assert gm.dipole.localize_many(t, y, known).status == "weak"
    # More dipoles than numbers can tell of are not tried.
    both = gm.dipole.localize(t, y, known, sources=(1, 2))
    assert [about.sources for about, _ in both.candidates] == [1]
    assert both.status != "determined"
    assert np.isinf(both.std).all()
    # With one number more there is a deviation, and with a given noise.
    longer = gm.dipole.simulate(
        [-10, -10, 5], [1, 1, 0], [10, 20, 10], np.array([0.0, 8.0, 16.0]), 1e-12, seed=1
    )
    assert np.isfinite(gm.dipole.localize([0.0, 8.0, 16.0], longer, known).std).all()
    assert np.isfinite(gm.dipole.localize(t, y, known, sigma=1e-12).std).all()
