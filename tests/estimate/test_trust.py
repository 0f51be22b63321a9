"""Estimates, other solutions, intervals and bounds against the values of trust.json.

Source of tests/reference/trust.json: bounded scalar minimisation over the free states in
extended steps, and quadrature of the posterior; see its fields.
"""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import chi2

import gramian as gm
from gramian._handle import handle_of
from gramian.estimation import STATUSES
from gramian.estimation._parts import not_white

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "reference" / "trust.json").read_text(encoding="utf-8")
)
REGIONS = REFERENCE["regions"]
TIMES, PATH = np.array(REGIONS["times_s"]), np.array(REGIONS["observer_m"])


@dataclass
class Beacons:
    """Ranges to beacons in the plane: a model of the user's own."""

    places: np.ndarray
    sigma: float = 0.5
    names: tuple[str, ...] = ("east", "north")
    units: tuple[str, ...] = ("m", "m")

    def h(self, x):
        return np.linalg.norm(np.asarray(x) - self.places, axis=1)

    def residuals(self, x, z):
        return (z - self.h(x)) / self.sigma

    def rows(self, x):
        with np.errstate(invalid="ignore"):
            return (x - self.places) / self.h(x)[:, None] / self.sigma


@dataclass
class Ring:
    """z = (cos 8x, sin 8x, x) + noise."""

    sigma: float
    names: tuple[str, ...] = ("x",)
    units: tuple[str, ...] = ("",)

    def h(self, x):
        return np.array([np.cos(8 * x[0]), np.sin(8 * x[0]), x[0]])

    def residuals(self, x, z):
        return (z - self.h(x)) / self.sigma

    def rows(self, x):
        return np.array([[-8 * np.sin(8 * x[0])], [8 * np.cos(8 * x[0])], [1.0]]) / self.sigma


BOX = {"east": (-200.0, 200.0), "north": (-200.0, 200.0)}


def recorded(name, **options):
    case = REGIONS[name]
    sigma = np.deg2rad(case["sigma_deg"])
    return gm.bearings.localize(TIMES, case["bearings_rad"], PATH, sigma, **options)


@pytest.mark.parametrize("name", ["easy", "skewed", "wide", "open"])
def test_recorded_bearings_reach_the_reference(name):
    case, answer = REGIONS[name], recorded(name)
    assert answer.converged
    assert answer.fit.chi2 == pytest.approx(case["chi2"], abs=1e-6)
    assert answer.state == pytest.approx(case["estimate"], rel=1e-4)
    assert answer.contains(case["truth"])
    interval = answer.interval("range")
    assert interval.local / 1.959964 == pytest.approx(case["range_std_from_covariance_m"], rel=1e-4)
    assert len(interval.pieces) == 1
    for found, wanted in zip(interval.pieces[0], case["range_interval_95_m"], strict=True):
        assert found is None if wanted is None else found == pytest.approx(wanted, rel=1e-4)
    expected = {"easy": "determined", "wide": "weak", "open": "weak", "skewed": "determined"}
    assert answer.status == expected[name]


def test_an_open_interval_is_told_in_words():
    assert str(recorded("open").interval("range")) == "range no limit either way"
    assert "no limit either way" in recorded("open").reason


@dataclass
class Differences(Beacons):
    """Differences of the distances to the first beacon and to the others."""

    sigma: float = 1.0

    def h(self, x):
        distance = super().h(x)
        return distance[1:] - distance[0]

    def rows(self, x):
        unit = (x - self.places) / super().h(x)[:, None]
        return (unit[1:] - unit[0]) / self.sigma


@pytest.mark.parametrize(
    ("places", "truth", "other"),
    [
        (
            [
                [-66.9734124, -16.77968006],
                [-87.35330629, -94.84389394],
                [-33.46865214, 98.28441631],
                [45.41123831, -14.45387267],
            ],
            [-90.18461521, -113.53525696],
            [-98.13948222, -125.36103002],
        ),
        (
            [
                [57.87271745, 26.30011351],
                [97.0220874, 39.6089343],
                [-75.3687192, 9.09470732],
                [-84.24138489, 4.83341965],
            ],
            [-114.83109684, -4.35073402],
            [-85.19618248, 3.88712705],
        ),
    ],
)
def test_a_minimum_within_the_region_of_another_one_is_found(places, truth, other):
    # In a bent valley, and less than a deviation apart.
    model = Differences(np.array(places))
    found = gm.other_solutions(model, truth, box=BOX)
    gradient = model.rows(np.array(other)).T @ model.residuals(np.array(other), model.h(truth))
    assert np.abs(gradient).max() < 1e-6
    assert min(np.linalg.norm(one.state - np.array(other)) for one in found) < 1e-5


def test_other_solutions_of_beacons():
    for name in ("two beacons", "three beacons nearly in line"):
        case = REFERENCE["ghosts"][name]
        model = Beacons(np.array(case["beacons"]))
        found = gm.other_solutions(model, case["truth"], box=BOX)
        assert len(found) == 1
        assert found[0].state == pytest.approx(np.array(case["others"][0]), abs=1e-6)
    assert found[0].chi2 == pytest.approx(case["chi2"][0], rel=1e-6)
    chance = case["chance_that_noise_prefers_it"][0]
    assert found[0].chance == pytest.approx(chance, rel=1e-6)
    answer = gm.estimate(model, model.h(case["truth"]), box=BOX)
    assert answer.status == "ambiguous"
    assert answer.unseen == pytest.approx(3 / 16, rel=0.5)


def test_four_satellites_have_one_solution():
    case = REFERENCE["ghosts"]["four satellites"]
    places = np.array(case["satellites_m"])

    class Satellites(Beacons):
        def h(self, x):
            return np.linalg.norm(np.asarray(x)[:3] - self.places, axis=1) + x[3]

        def rows(self, x):
            offset = x[:3] - self.places
            unit = offset / np.linalg.norm(offset, axis=1)[:, None]
            return np.hstack([unit, np.ones((4, 1))]) / self.sigma

    names = ("x", "y", "z", "clock")
    model = Satellites(places, 5.0, names, ("m",) * 4)
    wide = dict.fromkeys(names, (-4e7, 4e7))
    answer = gm.estimate(model, np.array(case["pseudoranges_m"]), box=wide)
    assert answer.state == pytest.approx(np.array(case["truth"]), abs=1e-5)
    assert not [other for other in answer.others if other.chance > 0.01]


@pytest.mark.parametrize("row", REFERENCE["barankin"]["rows"], ids=lambda r: str(r["sigma_m"]))
def test_barankin(row):
    places = np.array(REFERENCE["ghosts"]["three beacons nearly in line"]["beacons"])
    model = Beacons(places, row["sigma_m"])
    local = gm.bounds.barankin(model, [40, 30], np.zeros((0, 2)))
    assert np.sqrt(np.diag(local)) == pytest.approx(row["crlb_std"], rel=1e-6)
    bound = gm.bounds.barankin(model, [40, 30], [row["test_point"]])
    assert np.sqrt(np.diag(bound)) == pytest.approx(row["barankin_std"], rel=1e-6)


def test_barankin_does_not_overflow():
    model = Beacons(np.array([[0.0, 0], [50, 1], [100, 0]]), 1e-3)
    local = gm.bounds.barankin(model, [40, 30], np.zeros((0, 2)))
    far = gm.bounds.barankin(model, [40, 30], [[40.2, -28.8], [4000, 30]])
    assert far == pytest.approx(local, rel=1e-12)


@pytest.mark.parametrize("row", REFERENCE["threshold"]["rows"], ids=lambda r: str(r["sigma"]))
def test_weiss_weinstein(row):
    vectors = np.array(row["weiss_weinstein_points"])[:, None]
    found = gm.bounds.weiss_weinstein(Ring(row["sigma"]), {"x": (0.0, 1.0)}, vectors)
    assert found.bound[0, 0] == pytest.approx(row["weiss_weinstein"], rel=1e-3)
    assert found.bound[0, 0] < row["mmse"] + 3 * row["mmse_standard_error"]


def test_the_threshold_is_where_the_bounds_part():
    noise = np.geomspace(0.05, 1, 30)
    found = gm.bounds.threshold(Ring(1.0), {"x": (0.0, 1.0)}, [[np.pi / 4]], noise)
    assert 0.1 < found.factor[0] < 0.2
    ratio = found.bound[:, 0] / found.local[:, 0]
    assert (ratio[noise < 0.9 * found.factor[0]] < 2).all()
    assert (ratio[noise > 1.1 * found.factor[0]] > 2).all()


def turning():
    """Return noisy bearings of a target that turns at 292.5 s."""
    truth = np.array([1500.0, 2500.0, 3.0, -1.0])
    place = truth[:2] + TIMES[:, None] * truth[2:]
    place += np.maximum(TIMES - 292.5, 0)[:, None] * [-4.0, 3.0]
    off = place - PATH
    return np.arctan2(off[:, 0], off[:, 1]) + 0.0035 * np.random.default_rng(1).normal(size=40)


def test_a_target_that_turns_is_a_misfit_and_the_turn_is_named():
    answer = gm.bearings.localize(TIMES, turning(), PATH, 0.0035)
    assert answer.status == "misfit"
    assert answer.fit.p_value < 1e-6
    assert answer.fit.lag1[3] < 1e-3
    assert answer.fit.alternatives[0].name == "turn at 292.5 s"


@pytest.mark.parametrize("places", [[12], [12, 33]])
def test_outliers_are_named_and_it_is_said_that_without_them_it_would_fit(places):
    seen = gm.bearings.simulate(TIMES, PATH, [1500.0, 2500.0, 3.0, -1.0], 0.0035, seed=3)
    seen[places] += 10 * 0.0035
    answer = gm.bearings.localize(TIMES, seen, PATH, 0.0035)
    assert answer.status == "misfit"
    assert answer.fit.outliers.tolist() == places
    assert f"without residual{'s' * (len(places) > 1)} 12 (off by " in answer.reason
    assert "it would fit" in answer.reason
    # What a turn leaves is no matter of a few bearings.
    turned = gm.bearings.localize(TIMES, turning(), PATH, 0.0035)
    assert "without residual" not in turned.reason


def test_noise_that_is_not_white_is_a_misfit_though_its_chi2_is_right():
    # Slow noise, most of which the fit takes up: what is left has the variance that is stated.
    rng = np.random.default_rng(2)
    noise = np.zeros(40)
    for k in range(1, 40):
        noise[k] = 0.9 * noise[k - 1] + rng.normal() * np.sqrt(1 - 0.81)
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([0.0035]))
    answer = gm.estimate(model, model.h([1500.0, 2500.0, 3.0, -1.0]) + 2 * 0.0035 * noise)
    assert 0.01 < answer.fit.p_value < 0.99
    assert answer.fit.lag1[3] < 1e-4
    assert answer.status == "misfit"
    assert "the noise is not white" in answer.reason


def test_an_error_far_beyond_what_is_proportional_is_told_by_how_little_it_takes():
    seen = gm.bearings.simulate(TIMES, PATH, [1500.0, 2500.0, 3.0, -1.0], 0.0035, seed=3)
    answer = gm.bearings.localize(TIMES, seen, PATH, 0.0035)
    std = answer.std
    for text in answer.unseen_errors:
        name = next(a for a in answer.fit.alternatives if text.startswith(a.name))
        worst = float((np.abs(name.effect) / std).max())
        assert ("by a standard deviation" in text) == (worst > 10)
        assert "would go unseen" in text
    assert answer.unseen_errors


def test_residuals_that_are_too_small_are_told():
    case = REGIONS["easy"]
    answer = gm.bearings.localize(TIMES, case["bearings_rad"], PATH, 0.2)
    assert answer.fit.p_value > 0.999
    assert "sigma or a unit is wrong" in answer.fit.warning
    assert not recorded("easy").fit.warning


def test_honest_trials_are_rarely_misfits_and_their_lag_is_calibrated():
    truth = [1500.0, 2500.0, 3.0, -1.0]
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([0.0035]))
    normals = np.random.default_rng(5).normal(size=(400, 40))
    exact = model.h(truth)
    fits, inside = [], 0
    for noise in normals:
        z = exact + 0.0035 * noise
        answer = gm.estimate(model, z, start=truth, starts=0)
        fits.append(answer.fit)
        inside += answer.contains(truth)
    p, late = np.array([f.p_value for f in fits]), np.array([f.lag1[3] for f in fits])
    # Five deviations of a binomial count.
    for values in (p, late):
        assert abs((values < 0.05).sum() - 20) < 5 * np.sqrt(400 * 0.05 * 0.95)
    assert abs(inside - 380) < 5 * np.sqrt(400 * 0.05 * 0.95)
    scores = [f.alternatives for f in fits]
    bias = np.array([next(a.p_value for a in s if a.name == "bias") for s in scores])
    assert abs((bias < 0.05).sum() - 20) < 5 * np.sqrt(400 * 0.05 * 0.95)


def test_the_undetected_bias_moves_the_answer_as_the_reliability_says():
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([1e-4]))
    truth = np.array([1500.0, 2500.0, 3.0, -1.0])
    clean = gm.estimate(model, model.h(truth), start=truth)
    bias = next(a for a in clean.fit.alternatives if a.name == "bias")
    # A tenth of it, where the model is linear to 3 %.
    moved = gm.estimate(model, model.h(truth) + 0.1 * bias.detectable, start=truth)
    assert moved.state - truth == pytest.approx(0.1 * bias.effect, rel=0.03)
    # Seen with a power of 80 % where all alternatives together are tested at alpha = 0.001.
    share = 0.001 / len(clean.fit.alternatives)
    wanted = (-ndtri(share / 2) + ndtri(0.8)) ** 2
    assert moved.fit.chi2 == pytest.approx(0.01 * wanted, rel=0.02)


def test_prior_and_known():
    model = Beacons(np.array([[0.0, 0.0]]))
    answer = gm.estimate(model, [50.0], prior={"east": (40.0, 1.0)}, start=[40, 20])
    assert answer.state == pytest.approx([40, 30])
    held = gm.estimate(model, [50.0], known={"east": 40.0}, start=[40, 20])
    assert held.names == ("north",)
    assert held["north"] == pytest.approx(30)
    assert held["east"] == 40
    lost = gm.estimate(model, [50.0], start=[40, 20])
    assert lost.status == "unobservable"
    assert np.isinf(lost.std).all()


def test_a_region_closes_and_holds_the_truth():
    model = Beacons(np.array([[0.0, 0.0], [100, 0], [0, 100]]))
    answer = gm.estimate(model, model.h([40.0, 30.0]), start=[45, 25])
    region = answer.region(("east", "north"))
    assert region.closed == (True,)
    chi2 = [(model.residuals(p, answer.measurements) ** 2).sum() for p in region.contours[0]]
    assert np.array(chi2) == pytest.approx(5.991465, abs=1e-4)
    assert str(answer.interval({"east": 1.0, "north": -1.0})).startswith("1 east - 1 north")


def test_the_answer_pickles_and_compares():
    answer = recorded("easy")
    again = pickle.loads(pickle.dumps(answer))
    assert again.to_dict() == answer.to_dict()
    assert json.dumps(answer.to_dict())
    assert copy.deepcopy(answer) == answer
    assert answer.status in STATUSES
    assert answer.summary().startswith("DETERMINED")
    page = answer._repr_html_()
    assert "<table" in page
    assert "determined" in page


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prior": {"up": (0, 1)}}, "prior of 'up': no state has that name; there are east, north"),
        ({"prior": {"east": (0, -1)}}, "must be >= 0"),
        ({"known": {"east": np.inf}}, "known of east = inf"),
        ({"known": {"east": 1.0, "north": 2.0}}, "every state is known"),
        ({"box": {"east": (1, 0)}}, "box of east"),
        ({"alpha": 2}, "alpha = 2.0: must be between 0 and 1"),
        ({"start": [1, 2, 3]}, "start has shape"),
        ({"start": None}, "nowhere to start"),
        ({"loss": "cubes"}, "loss = 'cubes'"),
    ],
)
def test_bad_input_is_named(options, message):
    model = Beacons(np.array([[0.0, 0.0], [100, 0]]))
    with pytest.raises(gm.InputError, match=message):
        gm.estimate(model, [50.0, 60.0], **({"start": [40, 20]} | options))


def test_ctrl_c_in_the_users_function_comes_out():
    class Rude(Beacons):
        def residuals(self, x, z):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gm.estimate(Rude(np.array([[0.0, 0.0], [100, 0]])), [50.0, 60.0], start=[40, 20])


def test_a_missed_minimum_is_found():
    # Of 40 bearings at 2 deg; a start near the observer ends at chi2 = 29.06.
    seen = gm.bearings.simulate(
        TIMES, PATH, [4000, 15000, 3, -1], np.deg2rad(2.0), seed=7, trials=53
    )[52]
    answer = gm.bearings.localize(TIMES, seen, PATH, np.deg2rad(2.0))
    assert answer.fit.chi2 == pytest.approx(27.55, abs=0.01)
    assert all(other.chi2 > answer.fit.chi2 for other in answer.others)


def test_the_best_alternative_can_be_refitted():
    answer = gm.bearings.localize(TIMES, turning(), PATH, 0.0035)
    better = answer.refit()
    name = answer.fit.alternatives[0].name
    assert better.names[-2:] == (f"{name} 1", f"{name} 2")
    # The columns at the wrong state are not those at the right one: most of it, not all.
    assert better.fit.chi2 < 0.5 * answer.fit.chi2
    assert better.fit.dof == answer.fit.dof - 2
    with pytest.raises(gm.InputError, match="no alternative 'ghost': there are bias"):
        answer.refit("ghost")


SCENES = {
    "3 km / 0.1 deg": ([1543.5, 2572.5, 3.0, -1.0], 0.1),
    "8 km / 1 deg": ([4116.0, 6860.0, 3.0, -1.0], 1.0),
    "15 km / 2 deg": ([4000.0, 15000.0, 3.0, -1.0], 2.0),
}


@pytest.mark.parametrize("name", SCENES)
def test_regions_hold_the_truth_as_often_as_they_say(name):
    truth, sigma = SCENES[name]
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([np.deg2rad(sigma)]))
    found = gm.estimate_trials(model, truth, seed=11, trials=60)
    # Four deviations of a binomial count below 95 %.
    least = 0.95 - 4 * np.sqrt(0.95 * 0.05 / 60)
    assert found.inside.mean() > least
    assert found.covered.mean() > least
    assert found.wrong < 0.055 + 4 * np.sqrt(0.05 / 60)
    if name.startswith("3 km"):
        assert found.shares["determined"] > 0.9
    again = gm.estimate_trials(model, truth, seed=11, trials=2, first=3)
    np.testing.assert_array_equal(again.states, found.states[3:5])


def test_trials_agree_with_single_answers():
    truth = np.array([1500.0, 2500.0, 3.0, -1.0])
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([0.0035]))
    found = gm.estimate_trials(model, truth, seed=2, trials=3)
    for k in range(3):
        z = gm.bearings.simulate(TIMES, PATH, truth, 0.0035, seed=2, trials=3)[k]
        one = gm.estimate(model, z)
        assert one.state == pytest.approx(found.states[k], rel=1e-6)
        assert one.fit.chi2 == pytest.approx(found.chi2[k], rel=1e-8)
        low, high = one.interval("range").pieces[0]
        assert found.intervals[k] == pytest.approx([low, high], rel=1e-6)
        assert one.status == found.status[k]


def test_a_shift_at_a_noncentrality_of_25_is_named():
    truth = np.array([1500.0, 2500.0, 3.0, -1.0])
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([np.deg2rad(0.1)]))
    column = model.alternatives(truth, model.h(truth))["bias"]
    rows = model.rows(truth)
    basis = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))[0]
    trace = np.linalg.norm(column - basis @ (basis.T @ column))
    found = gm.estimate_trials(model, truth, seed=5, trials=60, shift=5 / trace * column)
    assert (found.alternatives["bias"] < 0.001).mean() > 0.8


def two_tests(columns, residuals):
    """p of the score test of several parameters, and of the one for parameters of one size."""
    axes, lengths, _ = np.linalg.svd(columns, full_matrices=False)
    parts = (axes.T @ residuals) ** 2
    weights = lengths**2 / (lengths**2 + np.mean(lengths**2))
    return chi2.sf(parts.sum(), parts.size), (weights * parts).sum(), weights


class Mean:
    """The mean of twelve numbers."""

    names, units = ("mean",), ("",)

    def h(self, x):
        return np.full(12, x[0])

    def residuals(self, x, z):
        return z - x[0]

    def rows(self, x):
        return np.ones((12, 1))


def test_several_parameters_of_one_size_are_looked_for_along_their_larger_traces():
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(12, 3)) * [4.0, 1.0, 0.3]
    columns -= columns.mean(axis=0)
    strong = columns @ np.linalg.svd(columns)[2][0]
    z = 5 * strong / np.linalg.norm(strong) + rng.normal(size=12)
    found = gm.estimate(Mean(), z, start=[0.0])
    (test,) = found.test({"three": columns})
    even, statistic, weights = two_tests(columns, z - z.mean())
    drawn = rng.chisquare(1, size=(2_000_000, 3)) @ weights
    uneven = 2.0 / test.p_value - 1.0 / even
    assert test.p_value < even
    # Drawn where there is something to count: at a tenth of the statistic as well.
    assert 1 / uneven < 1.1 * max((drawn > statistic).mean(), 1e-5)
    weaker = z.mean() + 0.5 * (z - z.mean())
    (less,) = gm.estimate(Mean(), weaker, start=[0.0]).test({"three": columns})
    even, statistic, weights = two_tests(columns, weaker - weaker.mean())
    share = (drawn > statistic).mean()
    assert 1 / (2 / less.p_value - 1 / even) == pytest.approx(share, rel=4 / np.sqrt(2e6 * share))
    # Traces of one size: the score test alone; turned about, and in other units, the same.
    equal = np.linalg.qr(columns)[0]
    (plain,) = found.test({"equal": equal})
    assert plain.p_value == pytest.approx(two_tests(equal, z - z.mean())[0], rel=1e-8)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    (turned,) = found.test({"three": 1e-7 * columns @ turn})
    assert turned.p_value == pytest.approx(test.p_value, rel=1e-8)


def test_p_of_several_parameters_is_uniform_where_it_is_small():
    rng = np.random.default_rng(8)
    columns = rng.normal(size=(12, 3)) * [4.0, 1.0, 0.3]
    model = Mean()
    found = gm.estimate_trials(
        model, [0.0], seed=3, trials=40_000, start=[0.0], alternatives={"three": columns}
    )
    for level in (0.1, 0.01, 0.001):
        share = (found.alternatives["three"] < level).mean()
        # The harmonic mean of two p is below a level a little more often than that.
        assert share < 1.15 * level + 3 * np.sqrt(level / 40_000)
        assert share > level - 3 * np.sqrt(level / 40_000)


def test_a_search_recalls_what_an_exhaustive_one_finds():
    rng = np.random.default_rng(3)
    count = seen = 0
    for trial in range(8):
        model = Beacons(rng.uniform(-100, 100, (3, 2)), 1.0)
        handle = handle_of(model, model.h(x := rng.uniform(-150, 150, 2)))
        box = ("box", [-200.0] * 2, [200.0] * 2)
        minima, found, level = handle.recall(x, box, 64, trial, 600, 5000.0)
        count, seen = count + minima, seen + found
        assert level == 0
    assert count > 5
    assert seen == count


def test_places_along_a_level_valley_are_no_minima():
    def product(x):
        return np.array([x[0] * x[1], x[0] * x[1] + 1e-13 * x[0]])

    model = gm.from_function(product, [1.0, 1.0], 1.0, ["a", "b"])
    handle = handle_of(model, [1.0, 1.0])
    minima, _, level = handle.recall([1.0, 1.0], ("box", [0.5] * 2, [30.0] * 2), 0, 0, 20, 50.0)
    assert minima == 0
    assert level > 2


def test_pictures_are_drawn():
    pytest.importorskip("matplotlib")
    fig = recorded("skewed").plot_region()
    labels = [text.get_text() for text in fig.axes[1].get_legend().get_texts()]
    assert "95 % region" in labels
    assert "local ellipse" in labels
    easy = recorded("easy").plot_region(("x0", "y0"))
    assert "local ellipse" not in [t.get_text() for t in easy.axes[1].get_legend().get_texts()]


def bearings_of_a_pass(seed):
    t = np.arange(0.0, 600.0, 15.0)
    path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    sigma = np.radians(0.3)
    seen = gm.bearings.simulate(t, path, [2000.0, 6000.0, 3.0, -1.0], sigma, seed=seed)
    return t, seen, path, sigma


def test_bearings_that_are_stuck_are_a_misfit():
    t, seen, path, sigma = bearings_of_a_pass(1)
    honest = gm.bearings.localize(t, seen, path, sigma)
    assert honest.fit.faults == ()
    assert honest.status == "determined"
    # A constant bearing fits a target that closes in: chi2 alone does not show it.
    stuck = np.where(t > t[20], seen[20], seen)
    found = gm.bearings.localize(t, stuck, path, sigma)
    assert found.fit.p_value > 0.5
    assert found.status == "misfit"
    assert "bearing is stuck at one value from 300 s to 585 s" in found.reason


def test_coarse_readings_of_a_poor_fit_are_not_stuck():
    """What a poor fit leaves over is not the noise that would end a run of one value."""
    signal = 3.0 * np.sin(np.arange(400) / 60)
    noise = np.random.default_rng(2).normal(0, 0.02, 400)
    coarse = (0.2 * np.round((signal + noise) / 0.2))[:, None]
    one = [gm.estimation.Channel("channel", np.arange(400), np.arange(400.0))]
    assert gm.estimation.channel_faults(coarse[:, 0], 2.0, one) == ()
    # The same where the readings scatter is.
    stuck = signal[:, None] + np.random.default_rng(2).normal(0, 2.0, (400, 1))
    stuck[100:160] = stuck[100]
    (told,) = gm.estimation.channel_faults(stuck[:, 0], 2.0, one)
    assert told.startswith("channel is stuck at one value from 100 s to 159 s")
    # Samples that do not count are none of its run, but of its places.
    stuck[120:130] = np.nan
    (told,) = gm.estimation.channel_faults(stuck[:, 0], 2.0, one)
    assert "from 100 s to 159 s" in told


@pytest.mark.parametrize("step_deg", [0.01, 0.1, 1.0, 3.0])
def test_coarse_readings_are_not_stuck(step_deg):
    for seed in range(40):
        t, seen, path, sigma = bearings_of_a_pass(seed)
        model = gm.bearings.BearingsModel(t, path, np.array([sigma]))
        step = np.radians(step_deg)
        assert model.faults(step * np.round(seen / step)) == ()


def test_a_batch_of_bearings_is_looked_through():
    t, seen, path, sigma = bearings_of_a_pass(1)
    stuck = np.where(t > t[20], seen[20], seen)
    for step_deg in (0.0, 0.1, 1.0):
        step = np.radians(step_deg)
        batch = np.array([bearings_of_a_pass(seed)[1] for seed in range(6)])
        batch = step * np.round(batch / step) if step else batch
        assert gm.bearings.localize_many(t, batch, path, sigma, alpha=1e-9).faults == ()
    batch[2] = stuck
    found = gm.bearings.localize_many(t, batch, path, sigma, alpha=1e-9)
    assert (found.status == "misfit").tolist() == [False, False, True, False, False, False]
    (told,) = found.faults
    assert told.startswith("record 2: bearing is stuck at one value from 300 s to 585 s")
    one = gm.bearings.localize_many(t, stuck, path, sigma)
    assert (one.status, one.p_value > 0.5) == ("misfit", True)
    assert "stuck" in one.summary()
    # Two observers that report the same: one copies the other.
    twice = np.repeat(t, 2)
    index = np.tile([0, 1], t.size)
    both = np.repeat(path, 2, axis=0) + np.outer(index, [1.0, 0.0])
    copied = gm.bearings.localize_many(
        twice, np.repeat(seen, 2), both, sigma, observer_index=index, alpha=1e-9
    )
    assert copied.faults == ("bearing of observer 1 is a copy of bearing of observer 0",)
    # Exact data repeat themselves, and are no fault.
    exact = np.full(t.size, 0.5)
    away = gm.bearings.localize_many(t, exact, path, sigma, {"vx": (0.0, 1.0), "vy": (0.0, 1.0)})
    assert away.faults == ()


def test_an_interval_is_told_where_chi2_has_no_least_value():
    """Of trials that run out to an infinite range too, and cheaply."""
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([np.radians(2.0)]))
    found = gm.estimate_trials(model, [4000.0, 15000.0, 3.0, -1.0], seed=11, trials=70)
    lost = found.status == "not_converged"
    assert lost.any()
    assert np.isfinite(found.solves).all()
    assert (found.solves < 200).all()
    # Trial 65 grows likelier for ever: at least so far away, no upper limit.
    low, high = found.intervals[65]
    assert 1e3 < low < 2e4
    assert high == np.inf
    assert found.covered.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 70)


def test_the_summary_says_which_states_are_not_observable():
    model = gm.from_function(
        lambda x: [x[0] + x[1], x[0] + x[1] + x[2], x[2]], [1.0, 2.0, 3.0], 0.1, ["a", "b", "e"]
    )
    lines = gm.estimate(model, [3.1, 6.1, 3.0]).summary().splitlines()
    assert lines[0].startswith("UNOBSERVABLE")
    assert all(line.endswith("not observable: one of many values") for line in lines[1:3])
    assert lines[3] == "  e  3 +- 0.0816"


@pytest.mark.parametrize(
    ("dof", "p_value", "lag", "said"),
    [
        (36, 0.5, 9e-5, True),
        (36, 0.5, 2e-4, False),
        # Too few residuals for the tail; residuals that are too small; no p at all.
        (9, 0.5, 1e-9, False),
        (36, 0.9995, 1e-9, False),
        (36, np.nan, 1e-9, True),
        (36, 0.5, np.nan, False),
    ],
)
def test_when_residuals_are_taken_for_correlated(dof, p_value, lag, said):
    assert not_white(dof, p_value, lag, 1e-3) == said


def test_trials_and_estimates_agree_on_what_is_a_misfit():
    # A slow drift of the compass that chi2 hardly shows.
    model = gm.bearings.BearingsModel(TIMES, PATH, np.array([0.0035]))
    truth = [1500.0, 2500.0, 3.0, -1.0]
    phase = np.linspace(0, 8 * np.pi, TIMES.size)
    drift = 1.2 * np.sin(phase)
    found = gm.estimate_trials(model, truth, seed=1, trials=200, shift=drift, function=None)
    correlated = found.lag_p_values < 1e-4
    others = (found.p_values < 1e-3) | (
        len(found.alternatives) * np.min(list(found.alternatives.values()), axis=0) < 1e-3
    )
    assert (correlated & ~others).any()
    assert (found.status[correlated] == "misfit").all()


def test_an_error_that_leaves_no_trace_is_told_before_those_that_leave_one():
    # A bias of all bearings turns the track about a carrier that stands still.
    times = np.arange(0.0, 600.0, 15.0)
    site = gm.tracks.Carrier([0.0, 0.0])
    sensors = [
        gm.tracks.Sensor.range(site, times, sigma=20.0),
        gm.tracks.Sensor.bearing(site, times, sigma=np.radians(0.5)),
    ]
    scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)
    truth = np.array([3000.0, 4000.0, -4.0, 2.0])
    z = gm.tracks.simulate(scene, truth, seed=1)
    clean, biased = gm.tracks.estimate(scene, z), z.copy()
    biased[times.size :] += 1e-5
    shift = gm.tracks.estimate(scene, biased).state - clean.state
    (bias,) = (a for a in clean.fit.alternatives if a.name == "bias of bearing")
    assert bias.dof == 0
    assert bias.per_unit * 1e-5 == pytest.approx(shift, rel=1e-3)
    told = clean.unseen_errors
    size = 1 / np.abs(bias.per_unit / clean.std).max()
    (text,) = (text for text in told if text.startswith("bias of bearing leaves no trace"))
    assert f"{size:.3g} rad" in text
    assert "would go unseen" not in "".join(told[: told.index(text)])
    assert text in clean.summary()


def test_an_error_that_is_another_name_of_a_state_is_not_told():
    # A constant of all heights is the height.
    times = np.arange(0.0, 100.0, 5.0)
    sensor = gm.tracks.Sensor.position(times, sigma=10.0)
    scene = gm.tracks.Scene(gm.tracks.Motion.fixed(), [sensor])
    answer = gm.tracks.estimate(scene, gm.tracks.simulate(scene, [1.0, 2.0], seed=1))
    assert not any("no trace" in text for text in answer.unseen_errors)


@pytest.mark.parametrize("wrong", ["sign", "factor", "order", "shape", "sigma"])
def test_rows_that_are_not_the_derivatives_of_the_residuals_are_refused(wrong):
    @dataclass
    class Wrong(Beacons):
        def rows(self, x):
            rows = super().rows(x)
            if wrong == "order":
                return rows[:, ::-1]
            return (
                rows.T if wrong == "shape" else rows * {"sign": -1.0, "factor": 2.0}.get(wrong, 1)
            )

        def residuals(self, x, z):
            return super().residuals(x, z) * (self.sigma if wrong == "sigma" else 1.0)

    places = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [90.0, 80.0]])
    model = Wrong(places)
    z = model.h([40.0, 20.0]) + 0.3
    for ask in (
        lambda: gm.estimate(model, z, start=[50.0, 50.0]),
        lambda: gm.other_solutions(model, [40.0, 20.0]),
        lambda: gm.estimate_trials(model, [40.0, 20.0], trials=2, seed=1, start=[50.0, 50.0]),
    ):
        with pytest.raises(gm.InputError, match="rows of the model"):
            ask()
    assert gm.estimate(Beacons(places), z, start=[50.0, 50.0]).status == "determined"


@pytest.mark.parametrize("start", [[0.0, 0.0], [100.0, -50.0]])
def test_a_redescending_loss_does_not_end_where_it_counts_nothing(start):
    # From far away every residual is beyond the reach of Tukey's loss: it has no slope there.
    @dataclass
    class Line:
        names: tuple[str, ...] = ("level", "slope")
        units: tuple[str, ...] = ("", "")

        def h(self, x):
            return x[0] + x[1] * np.arange(30) / 3

        def residuals(self, x, z):
            return (z - self.h(x)) / 0.1

        def rows(self, x):
            return np.stack([np.ones(30), np.arange(30) / 3], axis=1) / 0.1

    model = Line()
    for seed in range(8):
        rng = np.random.default_rng(seed)
        z = model.h([3.0, 2.0]) + 0.1 * rng.normal(size=30)
        z[rng.choice(30, 4)] += 50 * rng.normal(size=4)
        answer = gm.estimate(model, z, start=start, loss="tukey")
        assert answer.status == "determined"
        assert np.abs((answer.state - [3.0, 2.0]) / answer.std).max() < 4
    # Of what lies anywhere most counts nothing.
    scattered = gm.estimate(model, 50 * rng.normal(size=30), start=start, loss="tukey")
    assert scattered.status == "misfit"
    assert "count nothing" in scattered.reason
