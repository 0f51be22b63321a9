"""The most likely state from bearings: efficient, equal to an independent optimiser, honest."""

import numpy as np
import pytest

import gramian as gm
from geometry import reference, straight_track, two_leg_track
from gramian.models.bearings import (
    STATUSES,
    localize,
    localize_many,
    localize_trials,
    residuals,
    simulate,
)

CONVERGED, WEAK, UNOBSERVABLE, UNBOUNDED, NOT_CONVERGED, MISFIT = range(6)


@pytest.fixture(params=["B1", "B2"])
def track(request):
    return two_leg_track(reference("bearings")[request.param]["params"])


def circling(m=60, *, turn=1.0):
    times = 15.0 * np.arange(m)
    heading = np.where(np.arange(m - 1) < m // 2, 0.0, turn)
    steps = 75.0 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    return times, np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


@pytest.mark.parametrize("sigma_deg", [1e-4, 1e-2])
def test_the_estimate_reaches_the_bound(track, sigma_deg):
    times, observer, state = track
    sigma = np.radians(sigma_deg)
    run = localize_trials(times, observer, state, sigma, trials=2000, seed=3)
    assert (run.code == CONVERGED).all()
    bound = gm.crlb_std(gm.bearings.rows(times, observer, state, sigma))
    rmse = np.sqrt((run.error**2).mean(axis=0))
    assert rmse / bound == pytest.approx(np.ones(4), abs=0.05)
    # The stated covariance is true: error^T C^-1 error is chi-square, and so are residuals.
    assert run.nees.mean() == pytest.approx(4, abs=4 * np.sqrt(8 / 2000))
    dof = times.size - 4
    assert run.chi2.mean() == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / 2000))


@pytest.mark.parametrize("sigma_deg", [0.05, 0.5, 1.0])
def test_no_other_optimiser_finds_a_better_state(sigma_deg):
    from scipy.optimize import least_squares

    times, observer = circling()
    truth, sigma = np.array([2000, 7000, 3, -2.0]), np.radians(sigma_deg)
    noisy = simulate(times, observer, truth, sigma, seed=8, trials=60)
    answer = localize_many(times, noisy, observer, sigma)
    assert (answer.code <= WEAK).all()
    for i, z in enumerate(noisy):
        found = least_squares(
            lambda x, z=z: residuals(times, z, observer, x) / sigma,
            truth, x_scale=answer.std[i], xtol=1e-12, ftol=1e-12, gtol=1e-12,
        )  # fmt: skip
        assert answer.chi2[i] <= 2 * found.cost * (1 + 1e-8)
        if abs(2 * found.cost - answer.chi2[i]) < 1e-7:
            assert np.abs(answer.state[i] - found.x).max() <= 2e-3 * answer.std[i].max()


def test_the_covariance_is_the_bound_at_the_estimate(track):
    times, observer, state = track
    sigma = np.radians(0.05)
    answer = localize_many(times, simulate(times, observer, state, sigma, seed=1), observer, sigma)
    rows = gm.bearings.rows(times, observer, answer.state, sigma)
    assert answer.std == pytest.approx(gm.crlb_std(rows), rel=1e-7)
    assert answer.covariance == pytest.approx(gm.crlb(rows), rel=1e-6)
    assert answer.chi2 == pytest.approx(
        ((residuals(times, simulate(times, observer, state, sigma, seed=1), observer,
                    answer.state) / sigma) ** 2).sum(), rel=1e-9)  # fmt: skip


def test_trials_are_those_of_simulate_and_do_not_depend_on_threads_or_pieces():
    times, observer = circling(41)
    truth, sigma = np.array([2000, 7000, 3, -2.0]), np.full(41, 2e-3)
    run = localize_trials(times, observer, truth, sigma, trials=300, seed=4)
    noisy = simulate(times, observer, truth, sigma, seed=4, trials=300)
    alone = localize_many(times, noisy, observer, sigma)
    assert np.abs((alone.state - truth - run.error) / run.std).max() < 1e-6
    threads = gm.set_threads(1)
    try:
        one = localize_trials(times, observer, truth, sigma, trials=300, seed=4)
        tail = localize_trials(times, observer, truth, sigma, trials=100, seed=4, first=200)
    finally:
        gm.set_threads(threads)
    for name in ("error", "std", "nees", "chi2", "code", "iterations"):
        assert np.array_equal(getattr(one, name), getattr(run, name))
        assert np.array_equal(getattr(tail, name), getattr(run, name)[200:])


@pytest.mark.parametrize(("metre", "second"), [(1, 1), (1e-3, 1), (1, 1 / 3600), (1e3, 1e3)])
@pytest.mark.parametrize("m", [4, 5, 60, 1000])
def test_a_straight_observer_is_unobservable_whatever_the_noise_and_units(metre, second, m):
    times, observer, state = straight_track(m, metre=metre, second=second)
    for seed in range(5):
        noisy = simulate(times, observer, state, 0.01, seed=seed)
        answer = localize(times, noisy, observer, 0.01)
        assert answer.status == "unobservable"
        assert len(answer.null_combinations) == 1
    exact = simulate(times, observer, state, 1e-12, seed=0, trials=1)
    answer = localize_many(times, exact, observer, 1e-12)
    assert answer.status.tolist() == ["unobservable"]
    assert answer.nullity.tolist() == [1]
    assert np.isnan(answer.state).all()
    assert np.isinf(answer.std).all()
    # Relative position and velocity, per metre of position.
    relative = np.array([*(state[:2]), state[2], state[3] - 5 * metre / second])
    expected = relative / np.hypot(*relative[:2])
    found = answer.null_direction[0]
    assert found * np.sign(found @ expected) == pytest.approx(
        expected, rel=1e-6, abs=1e-6 * np.abs(expected).max()
    )


def test_large_coordinates_do_not_hide_a_straight_observer():
    times, observer, state = straight_track(40)
    shift = np.array([612_345.678, 5_623_456.789])
    noisy = simulate(times, observer, state, 0.01, seed=1)
    slanted = observer @ np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]]) + shift
    assert localize_many(times, noisy, slanted, 0.01).status == "unobservable"
    assert localize(times, noisy, slanted, 0.01).status == "unobservable"


def test_a_prior_makes_it_observable_again():
    times, observer, state = straight_track(60)
    noisy = simulate(times, observer, state, 1e-3, seed=2)
    known = localize_many(times, noisy, observer, 1e-3, prior={"vx": (3.0, 0.05)})
    assert known.status == "determined"
    assert (np.abs(known.state - state) < 4 * known.std).all()
    rows = np.vstack([gm.bearings.rows(times, observer, known.state, 1e-3), [0, 0, 1 / 0.05, 0]])
    assert known.std == pytest.approx(gm.crlb_std(rows), rel=1e-6)
    # Fewer bearings than states, with as many priors.
    two = localize_many(
        times[:2], noisy[:2], observer[:2], 1e-3, prior={"vx": (3.0, 0.1), "y0": (1e4, 100.0)}
    )
    assert two.status == "determined"
    assert two.std[1] == pytest.approx(100.0, rel=1e-3)


def test_a_prior_is_weighed_like_a_measurement():
    times, observer = circling()
    truth, sigma, spread = np.array([2000, 7000, 3, -2.0]), 2e-3, np.array([150, 400, 0.4, 1.0])
    means = truth + spread * np.array([1.0, -1.0, 0.5, 0.7])
    prior = dict(zip(gm.bearings.NAMES, zip(means, spread, strict=True), strict=True))
    noisy = simulate(times, observer, truth, sigma, seed=6)
    free, known = localize_many(times, noisy, observer, sigma), localize_many(
        times, noisy, observer, sigma, prior=prior
    )  # fmt: skip
    information = np.linalg.inv(free.covariance) + np.diag(spread**-2)
    joint = np.linalg.solve(
        information, np.linalg.solve(free.covariance, free.state) + means / spread**2
    )
    assert np.abs((known.state - joint) / known.std).max() < 0.1
    assert known.dof == free.dof + 4


def test_nothing_depends_on_the_frame():
    times, observer = circling()
    truth, sigma = np.array([2000, 7000, 3, -2.0]), 2e-3
    noisy = simulate(times, observer, truth, sigma, seed=6)
    here = localize_many(times, noisy, observer, sigma)
    # Clockwise, as bearings turn; to where they cross +-pi.
    angle = 2.9
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    there = localize_many(
        times + 1e4, noisy + angle - 4 * np.pi, observer @ turn.T + [5e3, -2e4], sigma
    )
    whole = np.kron(np.eye(2), turn)
    assert there.state - [5e3, -2e4, 0, 0] == pytest.approx(whole @ here.state, rel=1e-7)
    assert there.covariance == pytest.approx(whole @ here.covariance @ whole.T, rel=1e-5)
    # Kilometres and minutes.
    units = np.array([1e-3, 1e-3, 0.06, 0.06])
    other = localize_many(times / 60, noisy, observer / 1e3, sigma)
    assert other.state == pytest.approx(here.state * units, rel=1e-7)
    assert other.std == pytest.approx(here.std * units, rel=1e-6)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_every_order_of_motion(order):
    times = np.linspace(0, 600, 80)
    angle = times / 60
    observer = np.stack([800 * np.sin(angle), 500 * np.cos(1.7 * angle)], axis=1)
    truth = np.array([3000, 4000, -4, 3, 0.01, -0.02, 2e-5, 3e-5])[: 2 * order + 2]
    run = localize_trials(times, observer, truth, 1e-4, trials=1000, seed=9)
    assert (run.code == CONVERGED).all()
    assert run.nees.mean() == pytest.approx(truth.size, abs=4 * np.sqrt(2 * truth.size / 1000))
    exact = truth[:2] + sum(
        times[:, None] ** k * truth[2 * k : 2 * k + 2] / [1, 1, 2, 6][k]
        for k in range(1, order + 1)
    )
    z = np.arctan2(*(exact - observer).T)
    answer = localize_many(times, z, observer, 1e-3, order=order)
    assert answer.state == pytest.approx(truth, rel=1e-7)
    assert answer.names == ("x0", "y0", "vx", "vy", "ax", "ay", "jx", "jy")[: truth.size]


def test_several_observers_at_the_same_instants():
    times = np.repeat(10.0 * np.arange(20), 2)
    observer = np.tile([[0.0, 0.0], [4000.0, 0.0]], (20, 1))
    truth = np.array([1000, 5000, 4, -3.0])
    place = truth[:2] + times[:, None] * truth[2:]
    z = np.arctan2(*(place - observer).T)
    answer = localize_many(times, z, observer, 1e-3, observer_index=np.tile([0, 1], 20))
    assert answer.status == "determined"
    assert answer.state == pytest.approx(truth, rel=1e-9)
    with pytest.raises(gm.InputError, match=r"times\[2\].*same observer, 0"):
        localize_many(times * 0, z, observer, 1e-3, observer_index=np.tile([0, 1], 20))
    with pytest.raises(gm.InputError, match=r"times\[1\] = 0 s: must be later"):
        localize_many(times, z, observer, 1e-3)
    one = localize(times, z, observer, 1e-3, observer_index=np.tile([0, 1], 20))
    assert one.state == pytest.approx(truth, rel=1e-9)
    assert one.std == pytest.approx(answer.std, rel=1e-6)
    # The compass of each is an alternative; a copy of another's readings is named.
    names = {alternative.name for alternative in one.fit.alternatives}
    assert {f"bias of observer {k}" for k in range(2)} <= names
    assert "clock offset of the path" not in names
    copied = np.repeat(z[::2], 2)
    twice = localize(times, copied, observer, 1e-3, observer_index=np.tile([0, 1], 20))
    assert twice.fit.faults == ("bearing of observer 1 is a copy of bearing of observer 0",)
    with pytest.raises(gm.InputError, match=r"times\[2\] = 0 s.*same observer, 0"):
        localize(times * 0, z, observer, 1e-3, observer_index=np.tile([0, 1], 20))
    with pytest.raises(gm.InputError, match=r"times\[1\] = 0 s: must be later"):
        localize(times, z, observer, 1e-3)


def test_what_is_hardly_determined_is_called_so():
    times, observer, state = two_leg_track(reference("bearings")["B2"]["params"])
    run = localize_trials(times, observer, state, np.radians(0.5), trials=2000, seed=5)
    counts = np.bincount(run.code, minlength=5) / 2000
    # The bound of the range is 65 % of it: mostly weak, and where the noise bends the
    # bearings the other way the likelihood has no maximum at all.
    assert counts[WEAK] > 0.4
    assert 0.02 < counts[UNBOUNDED] < 0.25
    assert counts[NOT_CONVERGED] < 0.005
    assert np.isnan(run.error[run.code == UNBOUNDED]).all()
    assert np.isinf(run.std[run.code == UNBOUNDED]).all()
    assert np.isfinite(run.error[run.code <= WEAK]).all()
    assert STATUSES[UNBOUNDED] == "unbounded"


def test_wild_bearings_give_a_status_and_no_exception():
    times, observer = circling(24)
    wild = np.random.default_rng(1).uniform(-np.pi, np.pi, (500, 24))
    answer = localize_many(times, wild, observer, 1e-3)
    # No target moves like that, and every answer says so.
    assert set(answer.code) <= {MISFIT, UNOBSERVABLE}
    finite = np.isfinite(answer.state)
    assert (finite.all(axis=1) == finite.any(axis=1)).all()
    assert not finite[answer.code == UNOBSERVABLE].any()
    assert np.isfinite(answer.chi2).all()


def test_a_turning_target_shows_in_the_residuals():
    times, observer = circling()
    path = np.stack([2000 + 3 * times, 7000 - 2 * times - 2e-3 * times**2], axis=1)
    noisy = simulate(times, observer, path, 1e-3, seed=1)
    answer = localize_many(times, noisy, observer, 1e-3)
    assert answer.p_value < 1e-6
    assert answer.status == "misfit"
    assert "residuals: chi2" in answer.summary()
    assert answer.to_dict()["names"] == ["x0", "y0", "vx", "vy"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bearings": np.zeros(3)}, r"3 bearings: a target of order 1 has 4 states.*at least 4"),
        ({"bearings": np.zeros(7), "order": 3}, r"order 3 has 8 states and needs at least 8"),
        ({"bearings": np.zeros(19)}, r"bearings has shape \(19,\): must be \(..., 20\)"),
        ({"times": np.zeros(20)}, r"times\[1\] = 0 s: must be later"),
        ({"sigma": np.full(19, 0.1)}, r"sigma has shape \(19,\): must be \(..., 20\)"),
        ({"sigma": -0.1}, r"sigma\[0\] = -0.1 rad: must be > 0"),
        ({"bearings": [*np.zeros(19), np.nan]}, r"bearings\[19\] = nan: must be finite"),
        ({"observer": np.zeros((20, 3))}, r"observer has shape \(20, 3\)"),
        ({"order": 4}, r"order = 4: must be 0, 1, 2 or 3"),
        ({"prior": {"speed": (1, 2)}}, r"prior of 'speed': the states are x0, y0, vx, vy"),
        ({"prior": {"vx": (1, 0)}}, r"prior of vx = \(1.0, 0.0\)"),
        ({"prior": {"vx": 3}}, r"prior of vx = 3: must be \(mean, sigma\)"),
        ({"observer_index": [0.5] * 20}, r"observer_index has shape \(20,\) and type float64"),
        ({"weak_ratio": 0}, r"weak_ratio = 0: must be > 0"),
        ({"max_iterations": 0}, r"max_iterations = 0: must be >= 1"),
    ],
)
def test_bad_input(change, message):
    times, observer = circling(20)
    given = {"times": times, "bearings": np.zeros(20), "observer": observer, "sigma": 0.1} | change
    with pytest.raises(gm.InputError, match=message):
        localize_many(**given)


def test_bad_input_of_trials():
    times, observer = circling(20)
    with pytest.raises(gm.InputError, match="seed = -1"):
        localize_trials(times, observer, [0, 1, 0, 0], 0.1, trials=1, seed=-1)
    with pytest.raises(gm.InputError, match=r"observer\[0\] is at the target's position"):
        localize_trials(times, observer, [0, 0, 0, 0], 0.1, trials=1, seed=1)
    with pytest.raises(gm.InputError, match="a state of 2, 4, 6 or 8"):
        localize_trials(times, observer, [0, 0, 0], 0.1, trials=1, seed=1)
    with pytest.raises(gm.InputError, match="must have none, or one for each of 5 trials"):
        localize_trials(times, observer, np.ones((3, 4)), 0.1, trials=5, seed=1)


def test_bearings_in_degrees_are_a_misfit_that_says_what_it_may_be(recwarn):
    times, observer = circling()
    z = simulate(times, observer, [2000.0, 6000.0, 3.0, -1.0], 1e-3, seed=2)
    with pytest.warns(UserWarning, match=r"bearings reach .* rad and do not fit.*degrees\?"):
        answer = localize(times, np.degrees(z), observer, 1e-3)
    assert answer.status == "misfit"
    # Whole turns are bearings all the same.
    recwarn.clear()
    plain, turned = (localize(times, z + turns, observer, 1e-3) for turns in (0.0, 4 * np.pi))
    assert plain.status == turned.status == "determined"
    assert not recwarn.list


def test_a_target_that_turned_is_a_misfit_and_not_a_position():
    """The kind that began this: a confident position of a track that turned once."""
    t = np.arange(0.0, 1200.0, 30.0)
    path = np.stack([np.minimum(5 * t, 3000.0), np.maximum(0.0, 5 * t - 3000.0)], axis=1)
    turned = np.array([3000.0, 6000.0]) + t[:, None] * [-2.0, 1.0]
    turned += np.maximum(t - 500.0, 0.0)[:, None] * [8.0, -6.0]
    sigma = np.radians(0.5)
    seen = np.arctan2(*(turned - path).T) + np.random.default_rng(5).normal(0, sigma, t.size)
    answer = localize_many(t, seen, path, sigma)
    assert answer.status == "misfit"
    assert answer.p_value < 1e-6
    straight = np.array([3000.0, 6000.0]) + t[:, None] * [-2.0, 1.0]
    noise = np.random.default_rng(6).normal(0, sigma, (400, t.size))
    honest = localize_many(t, np.arctan2(*(straight - path).T) + noise, path, sigma)
    assert (honest.status == "misfit").mean() <= 0.01
    with pytest.raises(gm.InputError, match=r"alpha = 2"):
        localize_many(t, seen, path, sigma, alpha=2.0)


def test_an_observer_and_times_of_each_record_and_one_set_of_readings():
    times, observer = circling(20)
    readings = simulate(times, observer, np.array([2000, 7000, 3, -2.0]), 1e-4, seed=2)
    paths = np.stack([observer, observer + np.array([0.0, 5.0])])
    together = localize_many(np.stack([times, times]), readings, paths, 1e-4)
    for k in range(2):
        alone = localize_many(times, readings, paths[k], 1e-4)
        assert (together.state[k] == alone.state).all()
        assert together.status[k] == alone.status
    # A record whose readings repeat a value is named by its place among the records.
    stuck = readings.copy()
    stuck[6:16] = stuck[6]
    bad = localize_many(np.stack([times, times]), stuck, paths, 1e-4)
    assert [words.split(":")[0] for words in bad.faults] == ["record 0", "record 1"]


def test_a_channel_that_gives_zero_is_named_though_something_fits_it():
    times, observer = circling(30)
    dead = localize(times, np.zeros(times.size), observer, 1e-2)
    assert dead.status != "determined"
    assert "bearing is constant over the record: dead or stuck" in dead.summary()


def neighbours(noise, rho):
    """Noise of which neighbours are correlated."""
    out = noise.copy()
    for k in range(1, noise.shape[1]):
        out[:, k] = rho * out[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    return out


@pytest.mark.parametrize("prior", [None, {"vx": (3.0, 1.0)}])
@pytest.mark.parametrize("count", [14, 40, 60])
def test_correlated_residuals_are_a_misfit_of_a_batch_as_of_one_record(count, prior):
    """By the same test as of one record; chi2 does not see them."""
    times, observer = circling(count)
    exact = simulate(times, observer, np.array([2000, 7000, 3, -2.0]), 1e-12, seed=2)
    noise = np.random.default_rng(count).normal(size=(24, count))
    seen = np.concatenate([exact + 5e-3 * neighbours(noise, rho) for rho in (0.0, 0.4, 0.8)])
    together = localize_many(times, seen, observer, 5e-3, prior)
    ship = gm.tracks.Carrier(observer, times)
    sensor = gm.tracks.Sensor.bearing(ship, times, sigma=5e-3)
    scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    tracked = gm.tracks.estimate_many(scene, seen, prior=prior)
    for k, record in enumerate(seen):
        one = localize(times, record, observer, 5e-3, prior)
        expected = one.fit.dof >= 10 and one.fit.lag1[3] < 1e-4 and one.fit.p_value <= 0.999
        assert together.correlated[k] == tracked.correlated[k] == expected
        if expected:
            assert one.status == together.status[k] == tracked.status[k] == "misfit"
    assert (together.correlated.sum() > 5) == (count > 14)
    assert not together.correlated[:24].any()
    # A stricter level lets some pass, and a robust loss is not tested, as of one record.
    strict = localize_many(times, seen, observer, 5e-3, prior, alpha=1e-6).correlated
    assert (strict <= together.correlated).all()
    assert not gm.tracks.estimate_many(scene, seen, prior=prior, loss="huber").correlated.any()
