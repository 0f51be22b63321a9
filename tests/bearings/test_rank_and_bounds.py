"""Bearings-only problems against 50-digit values, and the case that cannot be observed."""

import numpy as np
import pytest

import gramian as gm
from geometry import reference, straight_track, two_leg_track

SIGMA = np.radians(0.5)


@pytest.mark.parametrize("case", ["B1", "B2"])
def test_reference_case(case):
    values = reference("bearings")[case]
    answer = gm.analyze(gm.bearings.problem(*two_leg_track(values["params"]), SIGMA))
    assert answer.rank == 4
    assert answer.status == "observable"
    assert answer.logdet == pytest.approx(float(values["logdet_fim_sigma_half_deg"]), rel=1e-9)
    expected = np.array(values["crlb_std"], dtype=float)
    np.testing.assert_allclose(answer.crlb_std, expected, rtol=1e-9)
    rows = gm.bearings.rows(*two_leg_track(values["params"]), SIGMA)
    np.testing.assert_allclose(gm.crlb_std(rows), expected, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(gm.crlb(rows))), expected, rtol=1e-9)


@pytest.mark.parametrize("case", ["B1", "B2"])
def test_gram_determinant_by_orthogonal_factorisation(case):
    """Rows scaled back by sigma and range are those of the pseudo-linear form: det G."""
    values = reference("bearings")[case]
    times, observer, state = two_leg_track(values["params"])
    positions = state[:2] + times[:, None] * state[2:]
    ranges = np.hypot(*(positions - observer).T)
    rows = gm.bearings.rows(times, observer, state, SIGMA) * (ranges * SIGMA)[:, None]
    det = np.exp(gm.analyze(rows).logdet)
    assert det == pytest.approx(float(values["det_gram"]), rel=1e-11)


@pytest.mark.parametrize("m", [4, 5, 7, 20, 300, 10_000])
@pytest.mark.parametrize("metre", [1.0, 1e-3])
@pytest.mark.parametrize("second", [1.0, 1 / 3600])
def test_straight_observer_is_unobservable_in_any_units(m, metre, second):
    times, observer, state = straight_track(m, metre=metre, second=second)
    answer = gm.analyze(gm.bearings.problem(times, observer, state, SIGMA))
    assert answer.rank == 3
    assert answer.status == "unobservable"
    speed = metre / second
    relative = state - np.array([0, 0, 0, 5 * speed])
    null = answer.null_space[:, 0]
    along = null @ relative / (relative @ relative)
    unit = np.array([metre, metre, speed, speed])
    np.testing.assert_allclose(
        null / unit, along * relative / unit, rtol=1e-6, atol=1e-9 * np.abs(null / unit).max()
    )
    # The relative position has no east component: x0 alone has a bound.
    assert np.isfinite(answer.crlb_std[0])
    assert np.isinf(answer.crlb_std[1:]).all()
    assert np.isinf(gm.crlb_std(gm.bearings.rows(times, observer, state, SIGMA))[1:]).all()


def test_straight_observer_far_from_the_origin_of_its_coordinates():
    """Map coordinates of millions of metres round the offsets; that is not information."""
    times, observer, state = straight_track(60)
    shift = np.array([612_345.678, 5_623_456.789])
    moved = gm.bearings.problem(times, observer + shift, state + np.array([*shift, 0, 0]), SIGMA)
    assert gm.analyze(moved).status == "unobservable"


@pytest.mark.parametrize("along", [0.0, np.pi / 2, np.pi, 1e-3, 1e-8, np.pi / 2 + 1e-12])
@pytest.mark.parametrize("origin", [0.0, 1e3, 1e6])
def test_target_dead_ahead_along_an_axis_stays_unobservable(along, origin):
    """Columns of nothing but rounding must not count when they are scaled to unit length."""
    ahead = np.array([np.sin(along), np.cos(along)])
    velocity = np.array([0.1, 0.03]) + 5 * ahead
    times = 1000.3 + np.arange(0.0, 600.0, 15.0)
    observer = origin * np.array([0.3, 0.7]) + times[:, None] * velocity
    target = np.array([*(observer[0] + 1e4 * ahead), *(velocity + 2 * ahead)])
    answer = gm.analyze(gm.bearings.problem(times, observer, target, SIGMA))
    assert answer.rank == 2
    far = np.abs(ahead) > 1e-5  # across the line of sight everything is known
    assert np.isinf(answer.crlb_std.reshape(2, 2)[:, far]).all()
    closing = observer[0] + (times - times[0])[:, None] * 5 * ahead
    assert gm.analyze(gm.maneuver.problem(closing, target[:2], SIGMA)).rank == 1


def test_bearing_that_never_changes_is_unobservable_whatever_its_weights():
    """Sigmas of unequal size over 10 000 bearings far from the origin."""
    rng = np.random.default_rng(4)
    times = np.sort(rng.uniform(0.0, 1.0, 10_000))
    velocity = np.array([0.3, 2.0])
    observer = np.array([1300.0, -700.0]) + times[:, None] * velocity
    offset = np.array([3e-4, 0.03])
    target = np.array([*(observer[0] + offset), *(velocity + 1.5 * offset)])
    sigma = 0.01 * np.exp(rng.normal(size=times.size))
    assert gm.analyze(gm.bearings.problem(times, observer, target, sigma)).rank == 2


def test_small_turns_keep_full_rank():
    """The bound grows as the turn shrinks: it is never cut off by a coarse tolerance."""
    params = reference("bearings")["B1"]["params"]
    bounds = []
    for turn in (1.0, 0.1, 0.01, 1e-3, 1e-4):
        answer = gm.analyze(gm.bearings.problem(*two_leg_track(params, turn_deg=turn), SIGMA))
        assert answer.rank == 4
        bounds.append(answer.crlb_std[1])
    np.testing.assert_allclose(np.divide(bounds[1:], bounds[:-1]), 10, rtol=0.01)


def test_crlb_refuses_what_does_not_exist():
    rows = gm.bearings.rows(*straight_track(30), SIGMA)
    with pytest.raises(gm.UnobservableError, match=r"rank 3 of 4.*x1") as caught:
        gm.crlb(rows)
    assert len(caught.value.null_combinations) == 1
    assert isinstance(caught.value, ArithmeticError)


def test_rows_are_the_derivatives_of_the_bearing():
    times, observer, state = two_leg_track(reference("bearings")["B1"]["params"])
    problem = gm.from_function(
        lambda x: np.arctan2(*(x[:2] + times[:, None] * x[2:] - observer).T),
        state,
        SIGMA,
        gm.bearings.NAMES,
        scale=[100.0, 100.0, 0.1, 0.1],
    )
    rows = gm.bearings.rows(times, observer, state, SIGMA)
    size = np.abs(rows).max(axis=0)
    np.testing.assert_allclose(problem.rows() / size, rows / size, atol=1e-8)


def test_positions_and_state_give_the_same_rows():
    times, observer, state = two_leg_track(reference("bearings")["B1"]["params"])
    positions = state[:2] + times[:, None] * state[2:]
    np.testing.assert_allclose(
        gm.bearings.rows(times, observer, positions, SIGMA),
        gm.bearings.rows(times, observer, state, SIGMA),
        rtol=1e-12,
        atol=1e-15,
    )


def test_batch_equals_one_by_one():
    times, observer, state = two_leg_track(reference("bearings")["B1"]["params"])
    rng = np.random.default_rng(1)
    states = state + rng.normal(size=(2, 3, 4)) * [300, 300, 1, 1]
    together = gm.bearings.rows(times, observer, states, SIGMA)
    assert together.shape == (2, 3, 20, 4)
    for i in np.ndindex(2, 3):
        np.testing.assert_array_equal(
            together[i], gm.bearings.rows(times, observer, states[i], SIGMA)
        )
    bounds = gm.crlb_std(together)
    np.testing.assert_array_equal(bounds[1, 2], gm.crlb_std(together[1, 2]))


def test_bound_is_the_spread_of_an_efficient_estimator():
    """Monte Carlo: the linearised maximum-likelihood error has the bound's covariance."""
    times, observer, state = two_leg_track(reference("bearings")["B1"]["params"])
    sigma = np.radians(0.01)
    trials = 4000
    noisy = gm.bearings.simulate(times, observer, state, sigma, seed=3, trials=trials)
    exact = np.arctan2(*(state[:2] + times[:, None] * state[2:] - observer).T)
    rows = gm.bearings.rows(times, observer, state, sigma)
    scale = 1 / np.linalg.norm(rows, axis=0)
    errors = scale * np.linalg.lstsq(rows * scale, ((noisy - exact) / sigma).T, rcond=None)[0].T
    # The spread of a standard deviation from N samples is 1 / sqrt(2 N).
    np.testing.assert_allclose(
        errors.std(axis=0) / gm.crlb_std(rows), 1, atol=4 / np.sqrt(2 * trials)
    )
