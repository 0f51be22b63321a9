"""The closed loop finds the target as well as the bound allows, on the same noise for all."""

import numpy as np
import pytest

import gramian as gm

TARGET, START, SPEED, DT, STEPS = [0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 60
OPTIONS = {"sigma": 0.01, "first_range": (1500.0, 500.0)}


def loop(**changes):
    options = {"trials": 300, "seed": 3, **OPTIONS, **changes}
    target = options.pop("target", TARGET)
    return gm.maneuver.closed_loop(target, START, SPEED, DT, STEPS, **options)


@pytest.fixture(scope="module")
def result():
    return loop()


def test_the_error_is_what_the_bound_of_the_path_allows(result):
    for run in result.runs:
        # The bound of each trial's own path, with the prior of the range at its true value.
        offset = np.array(TARGET) - run.paths
        squared = (offset**2).sum(axis=-1)[..., None]
        rows = offset[..., ::-1] * [1, -1] / (OPTIONS["sigma"] * squared)
        information = np.swapaxes(rows, 1, 2) @ rows
        information[:, 1, 1] += 1 / OPTIONS["first_range"][1] ** 2
        bound = np.trace(np.linalg.inv(information), axis1=1, axis2=2)
        ratio = run.final_rms / np.sqrt(bound.mean())
        assert 1 - 4 * run.uncertainty / run.final_rms < ratio
        assert ratio < 1 + 4 * run.uncertainty / run.final_rms + 0.02
        believed = np.sqrt((run.believed[:, -1] ** 2).mean())
        assert believed == pytest.approx(np.sqrt(bound.mean()), rel=0.05)


def test_laws_are_ranked_by_their_final_error(result):
    errors = [run.final_rms for run in result.runs]
    assert errors == sorted(errors)
    assert result.runs[0].method == "max_det"
    assert result["perpendicular"].final_rms == errors[-1]
    assert "max_det" in result.summary()
    assert [line["method"] for line in result.table()] == [run.method for run in result.runs]
    assert result.to_dict()["methods"][0]["rms_m"][-1] == errors[0]


def test_a_trial_depends_on_its_seed_and_number_alone(result):
    fewer = loop(trials=20, methods=["max_det"])
    np.testing.assert_array_equal(fewer["max_det"].paths, result["max_det"].paths[:20])
    before = gm.set_threads(1)
    alone = loop(methods=["max_det"])
    gm.set_threads(before)
    np.testing.assert_array_equal(alone["max_det"].estimates, result["max_det"].estimates)
    other = loop(trials=20, methods=["max_det"], seed=4)
    assert not np.array_equal(other["max_det"].paths, fewer["max_det"].paths)


def test_lost_bearings_cost_and_are_handled_either_way():
    full = loop(methods=["max_det"])["max_det"]
    predicted = loop(methods=["max_det"], lost=0.5)["max_det"]
    held = loop(methods=["max_det"], lost=0.5, when_lost="hold")["max_det"]
    for run in (predicted, held):
        # Half of the bearings: about the root of two in the error.
        assert 1.2 < run.final_rms / full.final_rms < 1.8
    turns = np.diff(np.unwrap(np.arctan2(*np.moveaxis(np.diff(held.paths, axis=1), 2, 0))), axis=1)
    assert 0.4 < (np.abs(turns) < 1e-9).mean() < 0.6
    turns = np.diff(
        np.unwrap(np.arctan2(*np.moveaxis(np.diff(predicted.paths, axis=1), 2, 0))), axis=1
    )
    assert (np.abs(turns) < 1e-9).mean() < 0.01


def test_an_opening_along_the_line_of_sight_teaches_nothing_of_the_range():
    run = loop(methods=["max_det"], opening=20, sigma=1e-4)["max_det"]
    # The range error that was there before is still there after 20 bearings.
    assert run.rms[20] > 0.5 * run.rms[0]
    assert run.rms[-1] < 0.01 * run.rms[0]


def test_a_plan_ends_with_a_smaller_error_than_the_laws():
    result = loop(trials=6, methods=["plan", "max_det"], standoff=500.0, replan=20)
    assert result.runs[0].method == "plan"
    assert result["plan"].final_rms < 0.8 * result["max_det"].final_rms
    # The stand-off holds for the estimated target; the true one is near it.
    assert result["plan"].nearest.min() > 500.0 - 60.0


def test_limits_hold_in_the_loop():
    disc = [[300.0, 100.0, 80.0]]
    run = loop(methods=["bearing_rate"], keep_out=disc, trials=50)["bearing_rate"]
    away = np.hypot(*np.moveaxis(run.paths - [300.0, 100.0], 2, 0))
    assert away.min() >= 80.0 * (1 - 1e-9)
    run = loop(methods=["bearing_rate"], max_turn_rate=0.1, sigma=0.1, trials=50)["bearing_rate"]
    headings = np.arctan2(*np.moveaxis(np.diff(run.paths, axis=1), 2, 0))
    turns = np.abs(np.diff(np.unwrap(headings), axis=1))
    assert turns.max() == pytest.approx(0.1, abs=1e-9)


# 20 steps away, its speed and course unknown.
MOVING = ([0.0, 400.0, -5.0, 5.0], [0.0, 0.0], 20.0, 1.0, 60)
UNKNOWN = {"sigma": np.radians(0.5), "first_range": (500.0, 150.0), "first_speed": 7.0}


def moving(**changes):
    options = {"methods": ["max_det"], "trials": 400, "seed": 5, "standoff": 200.0, **UNKNOWN}
    return gm.maneuver.closed_loop(*MOVING, **{**options, **changes})


@pytest.fixture(scope="module")
def flown():
    return moving(methods=["max_det", "circle"])


def test_regions_of_a_moving_target_hold_the_truth(flown):
    for run in flown.runs:
        assert run.estimates.shape == (400, 60, 4)
        # Three standard errors of 400 trials.
        assert abs(run.coverage(0.95)[-1] - 0.95) < 0.033
        assert abs(run.coverage(0.5)[-1] - 0.5) < 0.075
        believed = np.sqrt((run.believed[:, -1] ** 2).mean())
        assert abs(run.final_rms / believed - 1) < 3 * run.uncertainty / run.final_rms + 0.02


def test_regions_are_right_over_the_truths_that_are_thought_of():
    rng = np.random.default_rng(3)
    trials = 1000
    truths = np.zeros((trials, 4))
    truths[:, 1] = rng.normal(400.0, 80.0, trials).clip(150.0)
    truths[:, 2:] = rng.normal(0.0, 7.0, (trials, 2))
    result = gm.maneuver.closed_loop(
        truths, *MOVING[1:], sigma=np.radians(0.5), first_range=(400.0, 80.0), first_speed=7.0,
        standoff=100.0, methods=["max_det", "perpendicular"], trials=trials, seed=2,
    )  # fmt: skip
    assert result.target.shape == (trials, 4)
    for run in result.runs:
        for sample in (5, 15, 30, 59):
            # Chi-square of four degrees: mean 4, variance 8. Three standard errors.
            assert abs(run.surprise[:, sample].mean() - 4) < 3 * (8 / trials) ** 0.5
            assert abs(run.coverage(0.95)[sample] - 0.95) < 3 * (0.95 * 0.05 / trials) ** 0.5
            assert abs(run.coverage(0.5)[sample] - 0.5) < 3 * 0.5 / trials**0.5


def test_each_trial_has_its_own_truth():
    truths = np.array([[0.0, 400.0, -5.0, 5.0], [50.0, 450.0, 3.0, 0.0]])
    both = moving_at(truths, 2)
    for trial, truth in enumerate(truths):
        # The noise of a trial is its own, whatever the truth.
        alone = moving_at(np.array([truth, truth]), 2)
        np.testing.assert_array_equal(both.estimates[trial], alone.estimates[trial])
        np.testing.assert_array_equal(both.errors[trial], alone.errors[trial])
        same = moving_at(truth, 2)
        np.testing.assert_array_equal(both.errors[trial], same.errors[trial])


def moving_at(target, trials):
    return gm.maneuver.closed_loop(
        target, *MOVING[1:], methods=["max_det"], trials=trials, standoff=200.0, **UNKNOWN
    )["max_det"]


def test_the_error_of_a_moving_target_is_what_the_bound_of_the_path_allows(flown):
    run = flown["max_det"]
    times = np.arange(60.0)
    truth = np.array(MOVING[0])
    bounds = []
    for path in run.paths:
        offset = truth[:2] + times[:, None] * truth[2:] - path
        place = offset[:, ::-1] * [1, -1] / (UNKNOWN["sigma"] * (offset**2).sum(axis=1)[:, None])
        rows = np.hstack([place, times[:, None] * place])
        # What was known before is not centred on the truth: it tells little in the end.
        covariance = np.linalg.inv(rows.T @ rows)
        last = np.hstack([np.eye(2), 59.0 * np.eye(2)])
        bounds.append(np.trace(last @ covariance @ last.T))
    bound = np.sqrt(np.mean(bounds))
    assert abs(run.final_rms / bound - 1) < 3 * run.uncertainty / run.final_rms + 0.03


def test_false_alarms_and_missed_detections_cost_little(flown):
    clean = flown["max_det"]
    missed = moving(lost=0.3)["max_det"]
    false = moving(lost=0.3, false_alarms=0.3)["max_det"]
    assert 1.05 < missed.final_rms / clean.final_rms < 1.5
    # In the gate of four standard deviations few false bearings come to lie.
    assert np.median(false.errors[:, -1]) < 1.5 * np.median(missed.errors[:, -1])
    assert not np.array_equal(false.estimates, missed.estimates)
    np.testing.assert_array_equal(moving(false_alarms=0.0)["max_det"].errors, clean.errors)


def test_time_to_an_accuracy(flown):
    run = flown["max_det"]
    times = run.time_to(0.1)
    assert run.time_to(0.05).mean() > times.mean()
    for trial in range(5):
        below = run.errors[trial] <= 0.1 * run.ranges[trial]
        first = int(times[trial])
        assert below[first:].all()
        assert first == 0 or not below[first - 1]
    assert np.isinf(run.time_to(1e-9)).all()
    with pytest.raises(gm.InputError, match="share = 0"):
        run.time_to(0.0)
    with pytest.raises(gm.InputError, match="level = 1"):
        run.coverage(1.0)


def test_plans_turn_for_a_moving_target():
    result = moving(
        trials=6, methods=["plan", "plan_estimate", "perpendicular"], replan=15, horizon=40
    )
    for method in ("plan", "plan_estimate"):
        assert result[method].final_rms < result["perpendicular"].final_rms
        # The estimate and the true range are near in the end.
        assert result[method].ranges[:, -1].min() > 150.0
    assert not np.array_equal(result["plan"].paths, result["plan_estimate"].paths)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"methods": ["best"]}, r"methods\[0\] = 'best'"),
        ({"methods": []}, "methods is empty"),
        ({"methods": 5}, "methods = 5: must be a sequence of names"),
        ({"methods": "plan"}, "methods = 'plan': must be a sequence"),
        ({"lost": 1.0}, "lost = 1.0"),
        ({"lost": np.nan}, "lost = nan"),
        ({"false_alarms": 1.0}, "false_alarms = 1.0"),
        ({"horizon": 1}, "horizon = 1"),
        ({"first_speed": 3.0}, "first_speed is for a moving target"),
        ({"first_range": (0.0, 1.0)}, r"first_range\[0\] = 0.0 m: must be > 0"),
        ({"first_range": (1.0, np.inf)}, r"first_range\[1\] = inf: must be finite"),
        ({"sigma": 0.0}, "sigma = 0.0 rad"),
        ({"standoff": 2000.0}, "inside standoff"),
        ({"keep_out": [[0.0, 10.0, 20.0]]}, r"keep_out\[0\], inside its radius"),
        ({"trials": 0}, "trials = 0"),
        ({"target": [[0.0, 900.0]] * 3, "trials": 4}, "for each of the 4 trials"),
        ({"seed": -1}, "seed = -1"),
        ({"opening": 60}, "opening = 60"),
        ({"side": 0}, "side = 0"),
        ({"when_lost": "wait"}, 'when_lost = "wait"'),
        ({"replan": 0}, "replan = 0"),
    ],
)
def test_bad_input_is_named(change, words):
    with pytest.raises(gm.InputError, match=words):
        loop(**change)
