"""The verdict of a run holds as a whole: honest estimators are rarely flagged, others are."""

import numpy as np
import pytest

import gramian as gm
from gramian.monte_carlo.report import report
from monte_carlo_cases import COVARIANCE, STATE, linear_estimate, scene, with_covariance


def flagged(result):
    """Whether the reader is told of anything but an estimator that reaches its bound."""
    page = report(result, title="", subtitle="")
    facts = dict(page.facts)
    return (
        page.headline not in ("REACHES THE BOUND", "TOO FEW TRIALS")
        or "NO" in facts["is it unbiased?"]
        or not result.nees.consistent
    )


def test_honest_runs_are_flagged_once_in_a_hundred_or_less():
    # Many seeds, and more trials, in benches/monte_carlo_flags.py.
    runs = (gm.monte_carlo.run(scene(), 80, seed, with_covariance) for seed in range(60))
    # With one in a hundred each, more than 3 of 60 come three times in a thousand.
    assert sum(flagged(result) for result in runs) <= 3


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_wrong_covariances_and_errors_are_flagged(factor):
    def boastful(bearings):
        return linear_estimate(bearings), factor**2 * COVARIANCE

    def off(bearings):
        truth = scene().target
        return truth + factor * (linear_estimate(bearings) - truth), COVARIANCE

    for seed in range(2):
        assert not gm.monte_carlo.run(scene(), 1000, seed, boastful).nees.consistent
        verdict = gm.monte_carlo.run(scene(), 1000, seed, off).verdict
        assert verdict.startswith("ABOVE" if factor > 1 else "BELOW")


def picky(bearings):
    """Raise where the answer is too far to one side: no fair sample is left."""
    estimate, covariance = with_covariance(bearings)
    if estimate[0] - STATE[0] > 0.9 * np.sqrt(covariance[0, 0]):
        raise ValueError("too far")
    return estimate, covariance


def unlucky(bearings):
    """Raise as often, for a reason that has nothing to do with the error."""
    if np.sin(1e9 * bearings[0]) > 0.8:
        raise ValueError("unlucky")
    return with_covariance(bearings)


def test_selective_failures_are_in_the_headline():
    result = gm.monte_carlo.run(scene(), 1000, 3, picky)
    assert result.failed > 100
    assert result.biased
    page = report(result, title="", subtitle="")
    assert page.headline == "BIASED SURVIVORS"
    assert page.tone == "weak"
    assert f"{result.failed} of 1000 trials failed" in page.verdict
    fair = gm.monte_carlo.run(scene(), 1000, 3, unlucky)
    assert fair.failed > 100
    assert not fair.biased
    assert report(fair, title="", subtitle="").headline == "REACHES THE BOUND"


def test_a_bias_too_small_to_matter_is_not_told():
    def shifted(bearings):
        return linear_estimate(bearings) + 0.035 * np.sqrt(np.diag(COVARIANCE)), COVARIANCE

    result = gm.monte_carlo.run(scene(), 20_000, 1, shifted)
    assert (np.abs(result.bias) > np.ptp(result.bias_interval, axis=1)).any()
    assert result.biased == ()
