"""Registration: where biases cannot be told, and what is said then."""

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg

D = 60e3
SENSORS = {"A": (0.0, 0.0), "B": (D, 0.0)}
SIGMA = (50.0, np.radians(0.1))
BIASES = {"A.range": 300.0, "A.azimuth": 0.5 * np.pi / 180, "B.range": -200.0}
T = np.linspace(0.05, 0.95, 60)

FAMILIES = {
    ("between", "both"): np.stack([D * T, 0 * T], axis=1),
    ("outside", "both"): np.stack([D * (1.1 + T), 0 * T], axis=1),
    ("abeam A", "left"): np.stack([0 * T, D * T], axis=1),
    ("abeam A", "right"): np.stack([0 * T, -D * T], axis=1),
    ("abeam B", "left"): np.stack([D + 0 * T, D * T], axis=1),
    ("abeam B", "right"): np.stack([D + 0 * T, -D * T], axis=1),
}
TRACKS = {track.name: track for track in reg.singular_tracks(SENSORS)}


@pytest.mark.parametrize(("name", "side"), FAMILIES)
@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5])
def test_each_family_has_nullity_one_and_the_stated_null_vector(name, side, turn):
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    sensors = {k: rotation @ v + [3e3, -8e3] for k, v in SENSORS.items()}
    track = FAMILIES[name, side] @ rotation.T + [3e3, -8e3]
    answer = gm.analyze(reg.problem(track, sensors, SIGMA))
    assert answer.nullity == 1
    stated = TRACKS[name].null_vectors[side]
    found = answer.null_space[:, 0]
    scale = stated[np.abs(stated).argmax()] / found[np.abs(stated).argmax()]
    assert found * scale == pytest.approx(stated, rel=1e-7, abs=1e-7)
    touched = stated != 0
    assert np.isinf(answer.crlb_std[touched]).all()
    assert np.isfinite(answer.crlb_std[~touched]).all()
    check = reg.check_track(track, sensors, 1e-6)
    assert check.singular
    assert (check.track.name, check.side) == (name, side)


@pytest.mark.parametrize(("name", "side"), FAMILIES)
@pytest.mark.parametrize("size", [1e-4, 1.0, 8.0])
@pytest.mark.parametrize("sigma", [(1000.0, 1e-5), (0.1, 0.1), ((700.0, 2e-5), (0.3, 0.08))])
def test_families_stay_singular_at_any_size_place_and_noise(name, side, size, sigma):
    """Whitening by unequal deviations, and coordinates of 1000 km, enlarge rounding."""
    turn = 1.1
    rotation = size * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    for origin in ([0.0, 0.0], [4.1e5, 5.6e6]):
        sensors = {k: rotation @ v + origin for k, v in SENSORS.items()}
        track = FAMILIES[name, side] @ rotation.T + origin
        assert gm.analyze(reg.problem(track, sensors, sigma)).rank == 3


def test_the_union_of_any_two_families_is_observable():
    keys = list(FAMILIES)
    for i, one in enumerate(keys):
        for other in keys[:i]:
            both = np.vstack([FAMILIES[one], FAMILIES[other]])
            assert gm.analyze(reg.problem(both, SENSORS, SIGMA)).rank == 4, (one, other)


def test_other_special_tracks_are_observable():
    angle = np.linspace(0.3, 2.8, 40)
    circle = [D / 2, 0] + D / np.sqrt(2) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for track in (
        np.stack([D / 2 + 0 * T, D * T], axis=1),  # the bisector
        np.stack([D * T, 0.8 * D * T], axis=1),  # radial from A
        np.add(circle, [0, D / 2]),  # through A and B
    ):
        assert gm.analyze(reg.problem(track, SENSORS, SIGMA)).rank == 4
        check = reg.check_track(track, SENSORS)
        assert not check.singular
        assert check.distance > 1e3


@pytest.mark.parametrize(("name", "side"), FAMILIES)
def test_a_third_sensor_off_the_baseline_removes_every_family(name, side):
    sensors = SENSORS | {"C": (20e3, -30e3)}
    answer = gm.analyze(reg.problem(FAMILIES[name, side], sensors, SIGMA))
    assert answer.rank == 6
    pairs = reg.problem(FAMILIES[name, side], SENSORS, SIGMA)
    assert gm.analyze(pairs).rank == 3
    assert (answer.crlb_std[:4] < 5e3).all()


def test_a_third_sensor_on_the_baseline_does_not():
    answer = gm.analyze(
        reg.problem(FAMILIES["between", "both"], SENSORS | {"C": (90e3, 0.0)}, SIGMA)
    )
    assert answer.nullity == 1


def test_a_range_gain_costs_radial_tracks_and_one_more_on_the_baseline():
    def nullity(track):
        return gm.analyze(reg.problem(track, SENSORS, SIGMA, extras=["gain"])).nullity

    assert nullity(FAMILIES["between", "both"]) == 2
    assert nullity(np.stack([30e3 + D * T, D * T], axis=1)) == 0
    radial = np.stack([0.6 * D * T, D * T], axis=1)
    assert nullity(radial) == 1
    assert gm.analyze(reg.problem(radial, SENSORS, SIGMA)).nullity == 0


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    "extras", [("position",), ("attitude",), ("gain", "position"), ("gain", "position", "attitude")]
)
def test_gauge_freedoms_are_all_that_a_crowd_cannot_tell(d, extras):
    random = np.random.default_rng(3)
    sensors = np.array([[0, 0, 20], [60e3, 5e3, 300], [20e3, -40e3, 90]])[:, :d]
    crowd = random.uniform([-50e3, -50e3, 3e3], [90e3, 70e3, 12e3], (400, 3))[:, :d]
    sigma = (50.0, 2e-3, 2e-3)[:d]
    problem = reg.problem(crowd, sensors, sigma, extras=extras)
    answer = gm.analyze(problem)
    gauges = reg.gauges(sensors, extras)
    size = np.linalg.norm(problem.rows, axis=0)
    for name, vector in gauges.items():
        assert np.abs(problem.rows @ vector).max() < 1e-8 * (size @ np.abs(vector)), name
    independent = np.linalg.matrix_rank(np.array([v * size for v in gauges.values()]), rtol=1e-10)
    assert answer.nullity == independent
    for vector in answer.null_space.T:
        rest = np.linalg.lstsq(
            (np.array(list(gauges.values())) * size).T, vector * size, rcond=1e-12
        )[1]
        assert rest.size == 0 or rest[0] < 1e-10 * ((vector * size) ** 2).sum()


def test_elevation_is_determined_in_space():
    random = np.random.default_rng(2)
    sensors = {"A": (0, 0, 0), "B": (60e3, 0, 100)}
    crowd = random.uniform([0, 10e3, 3e3], [60e3, 60e3, 12e3], (50, 3))
    answer = gm.analyze(reg.problem(crowd, sensors, (50.0, 2e-3, 2e-3)))
    assert answer.rank == 6
    assert answer.names[2] == "A.elevation"


def reports_of(key, trials, seed=3):
    return reg.simulate(FAMILIES[key], SENSORS, SIGMA, BIASES, seed=seed, trials=trials)


@pytest.mark.parametrize("method", ["ml", "gls", "ls"])
@pytest.mark.parametrize("key", FAMILIES)
def test_estimates_of_singular_tracks_are_refused(key, method):
    trials = 60
    answer = reg.estimate(
        reports_of(key, trials), SENSORS, SIGMA, method=method, on_failure="report"
    )
    # Abeam, noise sometimes makes another track that fits as well and is not singular.
    refused = (answer.status != "determined").mean()
    assert refused >= (0.85 if "abeam" in key[0] else 1.0)
    stated = TRACKS[key[0]].null_vectors[key[1]] != 0
    unobservable = answer.status == "unobservable"
    assert np.isinf(answer.std[unobservable][:, stated]).all()


def test_a_refusal_names_the_combination_and_the_track():
    reports = reports_of(("between", "both"), None)
    pattern = r"A\.range \+1, B\.range -1 .*between A and B"
    with pytest.raises(gm.UnobservableError, match=pattern) as caught:
        reg.estimate(reports, SENSORS, SIGMA)
    assert caught.value.null_combinations == ("A.range +1, B.range -1",)


def test_a_prior_gives_an_answer_that_says_what_it_rests_on():
    reports = reports_of(("between", "both"), None)
    prior = {"A.range": 500.0, "B.range": 500.0}
    answer = reg.estimate(reports, SENSORS, SIGMA, prior=prior)
    assert answer.status == "determined"
    assert answer.held_by_prior == ("A.range +1, B.range -1",)
    # The sum is measured, the difference only believed: 500 / sqrt(2) each.
    assert answer.std[[0, 2]] == pytest.approx(500 / np.sqrt(2), rel=0.02)
    assert "held by the prior alone" in answer.summary()
    with pytest.raises((gm.UnobservableError, gm.ConvergenceError)):
        reg.estimate(reports, SENSORS, SIGMA, prior={"A.azimuth": 0.01})


def test_priors_that_data_outweigh_hold_nothing():
    track = np.stack([np.linspace(-20e3, 60e3, 200), np.full(200, 25e3)], axis=1)
    reports = reg.simulate(track, SENSORS, SIGMA, BIASES, seed=1)
    free = reg.estimate(reports, SENSORS, SIGMA)
    held = reg.estimate(reports, SENSORS, SIGMA, prior={"A.range": 1e5})
    assert held.held_by_prior == ()
    assert held.biases == pytest.approx(free.biases, rel=1e-4)


def test_gauge_freedoms_are_refused_by_name_and_settled_by_priors():
    random = np.random.default_rng(4)
    sensors = {"A": (0, 0), "B": (60e3, 5e3), "C": (20e3, -40e3)}
    crowd = random.uniform([-50e3, -50e3], [90e3, 70e3], (150, 2))
    truth = {"A.east": 30.0, "B.north": -40.0, "C.range": 100.0}
    reports = reg.simulate(crowd, sensors, SIGMA, truth, seed=1, extras=["position"])
    with pytest.raises(gm.UnobservableError, match="shift east") as caught:
        reg.estimate(reports, sensors, SIGMA, extras=["position"])
    assert len(caught.value.null_combinations) == 3
    assert caught.value.null_combinations[2].startswith("turn (")
    prior = {f"{s}.{axis}": 50.0 for s in sensors for axis in ("east", "north")}
    answer = reg.estimate(
        reports, sensors, SIGMA, extras=["position"], prior=prior | {"A.azimuth": 0.01}
    )
    assert answer.status == "determined"
    assert len(answer.held_by_prior) == 3
    true = np.array([truth.get(name, 0.0) for name in answer.names])
    assert (np.abs(answer.biases - true) < 4 * answer.std).all()
    # Where everything stands together is only believed: 50 m / sqrt(3).
    assert answer.std[answer.names.index("A.east")] > 28.0
