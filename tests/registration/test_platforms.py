"""Registration: sensors that move, and azimuths that count from a heading."""

import pickle

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg

SIGMA = (50.0, np.radians(0.1))
T = np.linspace(0.0, 900.0, 60)
TARGET = np.stack([200 * T - 40e3, 30e3 + 0 * T], axis=1)
STILL = {"A": (0.0, 0.0), "B": (60e3, 500.0)}
#: Two ships on opposite courses, which pass each other 4 km apart.
EAST = reg.Platform([[-9e3, 0.0], [9e3, 500.0]], [0.0, 900.0], azimuths="heading")
WEST = reg.Platform([[9e3, 4e3], [0.0, 4e3], [-9e3, 5e3]], [0.0, 450.0, 900.0])
SHIPS = {"east": EAST, "west": WEST}
TRUTH = {"east.range": 120.0, "east.azimuth": 0.02, "west.range": -80.0, "west.azimuth": -0.01}


def places(platform, times=T):
    """Where a platform is, by numpy's interpolation."""
    return np.stack([np.interp(times, platform.times, x) for x in platform.path.T], axis=1)


def by_differences(function, x, steps):
    """Derivatives by five-point differences."""
    columns = []
    for i, step in enumerate(steps):
        at = [function(x + k * step * np.eye(len(x))[i]) for k in (-2, -1, 1, 2)]
        columns.append((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("extras", [(), ("gain",), ("position",), ("gain", "position", "attitude")])
def test_rows_are_those_of_differences(extras):
    """Reports by the formula, differentiated, the positions eliminated by an SVD."""
    sensors = {
        "still": (3e3, -8e3),
        "west": WEST,
        "north": reg.Platform([[0, 0], [0, 9e3]], [0, 900]),
    }
    names = reg.problem(TARGET, sensors, SIGMA, times=T, extras=extras).names
    kinds = [name.split(".")[1] for name in names[: len(names) // 3]]
    about = dict.fromkeys(names, 0.0) | {"west.range": 150.0, "west.azimuth": 0.01}
    if extras == ("gain", "position", "attitude"):
        about |= {"west.gain": 1e-3, "west.east": 40.0, "north.north": -30.0}
    biases = np.array(list(about.values()))
    at = [np.tile([3e3, -8e3], (60, 1)), places(WEST), places(sensors["north"])]

    def reports(k, x):
        out = []
        for s in range(3):
            bias = dict(zip(kinds, x[2 + s * len(kinds) :][: len(kinds)], strict=False))
            d = x[:2] - at[s][k] - [bias.get("east", 0.0), bias.get("north", 0.0)]
            out.append((1 + bias.get("gain", 0.0)) * np.hypot(*d) + bias["range"])
            out.append(np.arctan2(*d) + bias["azimuth"] + bias.get("heading", 0.0))
        return np.array(out) / np.tile(SIGMA, 3)

    step = {"azimuth": 1e-2, "heading": 1e-2, "gain": 1e-2}
    steps = [100.0, 100.0] + [step.get(kind, 30.0) for kind in kinds] * 3
    information = np.zeros((len(names), len(names)))
    for k in range(0, 60, 7):
        lines = by_differences(lambda x, k=k: reports(k, x), np.r_[TARGET[k], biases], steps)
        free = np.linalg.svd(lines[:, :2])[0][:, 2:]
        information += lines[:, 2:].T @ free @ free.T @ lines[:, 2:]
    chosen = slice(0, 60, 7)
    rows = reg.rows(TARGET[chosen], sensors, SIGMA, extras=extras, biases=about, times=T[chosen])
    size = np.sqrt(np.diag(information))
    assert np.abs((rows.T @ rows - information) / np.outer(size, size)).max() < 1e-8
    fisher = reg.fisher(
        TARGET[chosen], sensors, SIGMA, extras=extras, biases=about, times=T[chosen]
    )
    assert np.abs((fisher - information) / np.outer(size, size)).max() < 1e-8


@pytest.mark.parametrize("count", [1, 3, 8, 33, 60])
def test_information_of_two_ships_is_that_of_their_rows(count):
    """The closed form in vectors, with looks left over or not."""
    rows = reg.rows(TARGET[:count], SHIPS, SIGMA, times=T[:count])
    fisher = reg.fisher(TARGET[:count], SHIPS, SIGMA, times=T[:count])
    size = np.tile(SIGMA, 2)
    assert np.abs((fisher - rows.T @ rows) * np.outer(size, size)).max() < 1e-13 * count


def test_a_platform_that_stands_still_is_a_fixed_sensor():
    """To the last bit, in everything."""
    moving = STILL | {"B": reg.Platform([STILL["B"]] * 2, [0.0, 900.0])}
    for function in (reg.rows, reg.fisher, reg.eta, reg.degree):
        assert np.array_equal(
            function(TARGET, STILL, SIGMA), function(TARGET, moving, SIGMA, times=T)
        )
    for method in ("pair", "paper"):
        assert np.array_equal(
            reg.degree(TARGET, STILL, SIGMA, method=method),
            reg.degree(TARGET, moving, SIGMA, method=method, times=T),
        )
    truth = {"A.range": 300.0, "B.azimuth": 0.01}
    fixed, moved = (
        reg.simulate(TARGET, sensors, SIGMA, truth, seed=3, times=T) for sensors in (STILL, moving)
    )
    assert np.array_equal(fixed.values, moved.values)
    assert np.array_equal(fixed.positions(STILL, SIGMA), moved.positions(moving, SIGMA))
    for options in ({"method": "ls"}, {"method": "gls"}, {}, {"loss": "huber"}, {"clocks": True}):
        one, other = (reg.estimate(fixed, sensors, SIGMA, **options) for sensors in (STILL, moving))
        assert np.array_equal(one.state, other.state)
        assert np.array_equal(one.std, other.std)
        assert np.array_equal(one.positions, other.positions)
        assert (one.status, one.fit.chi2) == (other.status, other.fit.chi2)
    trials = [
        reg.estimate_trials(TARGET, sensors, SIGMA, truth, seed=3, trials=5, times=T)
        for sensors in (STILL, moving)
    ]
    assert np.array_equal(trials[0].biases, trials[1].biases)
    space = np.c_[TARGET, np.full(60, 9e3)]
    high = {"A": (0, 0, 10), "B": reg.Platform([[6e4, 0, 20]] * 2, [0.0, 900.0])}
    for extras in ((), ("gain", "position", "attitude")):
        one = reg.rows(space, high | {"B": (6e4, 0, 20)}, (*SIGMA, 2e-3), extras=extras)
        assert np.array_equal(one, reg.rows(space, high, (*SIGMA, 2e-3), extras=extras, times=T))


def test_azimuths_count_from_the_heading():
    exact = reg.simulate(TARGET, SHIPS, (1e-9, 1e-15), seed=1, times=T).values
    offset = TARGET - places(EAST)
    heading = np.arctan2(18e3, 500.0)
    relative = np.arctan2(*offset.T) - heading
    assert np.abs(np.angle(np.exp(1j * (exact[:, 0, 1] - relative)))).max() < 1e-12
    assert np.abs(exact[:, 1, 1] - np.arctan2(*(TARGET - places(WEST)).T)).max() < 1e-12
    # One that stands, with axes of its own, and a heading that is given.
    turned = {"A": reg.Platform((0.0, 0.0), heading=1.0, azimuths="heading"), "B": STILL["B"]}
    seen = reg.simulate(TARGET, turned, SIGMA, seed=1).values
    north = reg.simulate(TARGET, STILL, SIGMA, seed=1).values
    assert np.abs(np.angle(np.exp(1j * (seen[:, 0, 1] + 1.0 - north[:, 0, 1])))).max() < 1e-12
    found, plain = reg.estimate(seen, turned, SIGMA), reg.estimate(north, STILL, SIGMA)
    assert np.allclose(found.state, plain.state, rtol=1e-6)


def test_headings_turn_through_south():
    """Headings of 170 and 190 degrees have 180 between them."""
    ship = reg.Platform([[0, 0], [0, -900]], [0, 900], np.radians([170.0, -170.0]), "heading")
    assert np.allclose(np.cos(ship.carrier.headings([450.0])), -1.0)
    at = reg.simulate(
        [[9e3, -450.0]], {"A": ship, "B": STILL["B"]}, (1e-9, 1e-15), seed=1, times=[450.0]
    )
    assert abs(at.values[0, 0, 1] + np.pi / 2) < 1e-12


def test_a_wrong_heading_is_an_azimuth_bias():
    """The same reports, whichever of the two is wrong: one state, named as a sum of two."""
    off = 0.03
    wrong = reg.Platform(EAST.path, EAST.times, EAST.carrier.headings(EAST.times) + off, "heading")
    reports = reg.simulate(TARGET, SHIPS, SIGMA, seed=5, times=T)
    found = reg.estimate(reports, SHIPS | {"east": wrong}, SIGMA)
    right = reg.estimate(reports, SHIPS, SIGMA)
    assert abs(found["east.azimuth"] - right["east.azimuth"] - off) < 1e-7
    both = reg.problem(TARGET, SHIPS, SIGMA, times=T, extras=["attitude"])
    assert gm.analyze(both).null_combinations == (
        "east.azimuth +1, east.heading -1",
        "west.azimuth +1, west.heading -1",
    )
    names = reg.gauges(SHIPS, ["attitude"], times=T)
    assert list(names) == ["east.heading = east.azimuth", "west.heading = west.azimuth"]
    # A prior of the one gives the other.
    told = gm.crlb_std(both.prior({"east.azimuth": 1e-3, "west.azimuth": 1e-3}))
    alone = gm.crlb_std(reg.problem(TARGET, SHIPS, SIGMA, times=T))
    assert np.isclose(told[2], np.hypot(1e-3, alone[1]), rtol=1e-3)


def test_two_ships_that_pass_each_other_reach_the_bound():
    run = reg.estimate_trials(TARGET, SHIPS, SIGMA, TRUTH, seed=1, trials=300, times=T)
    assert (run.status == "determined").all()
    error = run.biases - np.array(list(TRUTH.values()))
    covered = (np.abs(error) < 1.96 * run.std).mean()
    assert 0.93 < covered < 0.97
    bound = gm.crlb_std(reg.problem(TARGET, SHIPS, SIGMA, times=T, biases=TRUTH))
    rmse = np.sqrt((error**2).mean(axis=0))
    assert np.abs(rmse / bound - 1).max() < 0.1  # 300 trials: 0.04 is one deviation
    scene = gm.monte_carlo.Registration(TARGET, SHIPS, SIGMA, TRUTH, times=T)
    assert np.array_equal(scene.simulate(1, 0, 2)[1],
                          reg.simulate(TARGET, SHIPS, SIGMA, TRUTH, seed=1, trials=2, times=T).values[1])  # fmt: skip
    result = gm.monte_carlo.run(scene, 300, seed=1)
    assert (np.abs(result.efficiency - 1) < 0.25).all()


def test_what_fixed_sensors_cannot_tell_a_passing_ship_can():
    """A target between two sensors tells nothing of the difference of their ranges, unless one moves."""
    between = np.stack([np.linspace(6e3, 54e3, 60), np.zeros(60)], axis=1)
    fixed = {"A": (0, 0), "B": (60e3, 0)}
    assert gm.analyze(reg.problem(between, fixed, SIGMA)).nullity == 1
    ship = fixed | {"B": reg.Platform([[60e3, 0], [60e3, 9e3]], [0, 900])}
    assert gm.analyze(reg.problem(between, ship, SIGMA, times=T)).nullity == 0


def test_gauges_of_sensors_that_move():
    """What all share: a formation may be turned about its first ship, ships apart may not."""
    formation = {
        name: reg.Platform(EAST.path + np.array(offset), EAST.times)
        for name, offset in (("A", (0, 0)), ("B", (3e3, 9e3)))
    }
    for sensors, free in ((formation, 3), (SHIPS, 2), ({"A": WEST, "B": (0, 0)}, 2)):
        found = reg.gauges(sensors, ["position"], times=T)
        assert len(found) == free
        rows = reg.rows(TARGET, sensors, SIGMA, extras=["position"], times=T)
        for vector in found.values():
            assert np.abs(rows @ vector).max() < 1e-9 * np.linalg.norm(rows * vector)
        made = reg.problem(TARGET, sensors, SIGMA, extras=["position"], times=T)
        assert gm.analyze(made).nullity == free


def test_missing_reports_robust_loss_and_truth():
    reports = reg.simulate(TARGET, SHIPS, SIGMA, TRUTH, seed=2, times=T)
    values = reports.values.copy()
    values[5, 0], values[9, 1, 1], values[20] = np.nan, np.nan, np.nan
    values[30, 1, 0] += 20e3
    found = reg.estimate(reg.Reports(values, T), SHIPS, SIGMA, loss="huber")
    assert (np.abs(found.state - list(TRUTH.values())) < 4 * found.std).all()
    model = found.model
    left = model.measured(found.measurements) - model.h(found.state)
    # Azimuths are compared as they are measured, and missing ones stay missing.
    assert np.isnan(left).sum() == np.isnan(model.reports).sum()
    given = TARGET + np.random.default_rng(1).normal(0, 30, TARGET.shape)
    one = reg.estimate(
        reg.Reports(reports.values[:, :1], T), {"east": EAST}, SIGMA, truth=given, truth_sigma=30.0
    )
    assert (np.abs(one.state - [120.0, 0.02]) < 4 * one.std).all()


def test_a_clock_that_is_off():
    """Stamps that are late: of a target that was elsewhere, on a path by the sensor's own clock."""
    turn = np.c_[30e3 * np.sin(T / 150), 20e3 + 15e3 * np.cos(T / 150)]
    late = np.c_[30e3 * np.sin((T - 0.8) / 150), 20e3 + 15e3 * np.cos((T - 0.8) / 150)]
    exact = reg.simulate(turn, SHIPS, SIGMA, seed=4, times=T).values
    exact[:, 1] = reg.simulate(late, SHIPS, SIGMA, seed=4, times=T).values[:, 1]
    found = reg.estimate(reg.Reports(exact, T), SHIPS, SIGMA, clocks=True)
    assert abs(found["west.clock"] - 0.8) < 4 * found.std[-1]


def test_targets_of_a_crowd():
    crowd = {"along": TARGET, "late": TARGET[::2] + np.array([0, 9e3]), "near": 0.3 * TARGET}
    times = {"along": T, "late": T[::2], "near": T}
    chosen = reg.select(crowd, SHIPS, SIGMA, 2, times=times)
    stack = [reg.rows(crowd[name], SHIPS, SIGMA, times=times[name]) for name in chosen.chosen]
    assert np.allclose(chosen.bounds[-1], gm.crlb_std(np.concatenate(stack)))
    with pytest.raises(gm.InputError, match="times is of along, late: must be of the tracks"):
        reg.select(crowd, SHIPS, SIGMA, 2, times={"along": T, "late": T[::2]})
    with pytest.raises(
        gm.InputError, match=r"times of track 'late' has shape \(60,\): must be \(30,\)"
    ):
        reg.select(crowd, SHIPS, SIGMA, 2, times=times | {"late": T})


def test_answers_pickle():
    reports = reg.simulate(TARGET, SHIPS, SIGMA, TRUTH, seed=2, times=T)
    found = reg.estimate(reports, SHIPS, SIGMA)
    assert pickle.loads(pickle.dumps(found)) == found
    assert pickle.loads(pickle.dumps(EAST)) == EAST


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: reg.Platform([[0, 0]], [0.0]), "path has 1 place: a platform that moves needs 2"),
        (lambda: reg.Platform([[0, 0], [1, 1]]), r"path of platform has shape \(2, 2\): must be \(2,\)"),
        (lambda: reg.Platform([0, 0], [0.0]), r"path of platform has shape \(2,\)"),
        (lambda: reg.Platform([[0, 0], [1, np.nan]], [0, 1]), r"path\[1, 1\] = nan: must be finite"),
        (lambda: reg.Platform([[0, 0], [1, 1]], [0, 0]), r"times\[1\] = 0 s: must be later"),
        (lambda: reg.Platform([[0, 0], [1, 1]], [0, 1], [0.0]), "heading"),
        (lambda: reg.Platform([[0, 0], [1, 1]], [0, 1], azimuths="south"), "azimuths = 'south'"),
        (lambda: reg.Platform([0, 0], azimuths="heading"), "without a heading"),
    ],
)  # fmt: skip
def test_platforms_that_are_none(made, message):
    with pytest.raises(gm.InputError, match=message):
        made()


@pytest.mark.parametrize(
    ("sensors", "times", "message"),
    [
        (SHIPS, None, r"sensors\['east'\] moves: the times of the looks are missing"),
        (SHIPS, T[:5], r"times has shape \(5,\): must be \(60,\), one for each look"),
        (SHIPS, T + 1.0, r"sensors\['east'\]: .*times\[59\] = 901 s: outside the carrier's path"),
        (SHIPS, np.where(T > 500, np.nan, T), r"times\[\d+\] = nan: must be finite"),
        (SHIPS, T[None], r"times has shape \(1, 60\): must be \(K,\)"),
        ({"A": EAST, "B": EAST}, T, r"sensors\[1\] is at the place of sensors\[0\]"),
        ({"A": EAST, "B": (0, 0, 0)}, T, "places of different length"),
        ({"A": EAST, "B": [[0, 0]]}, T, r"sensors\['B'\] has shape \(1, 2\)"),
        ([EAST], T, "2 or more"),
        (
            {"A": (0, 0), "B": reg.Platform([[0, 9], [0, 9]], [0, 900], azimuths="heading")},
            T,
            r"sensors\['B'\]: .*no heading",
        ),
        (np.zeros((60, 2, 2)), T, r"sensors has shape \(60, 2, 2\): must be \(N, 2\)"),
    ],
)
def test_what_is_wrong_with_sensors_that_move(sensors, times, message):
    for function in (reg.rows, reg.fisher, reg.eta, reg.problem):
        with pytest.raises(gm.InputError, match=message):
            function(TARGET, sensors, SIGMA, times=times)


def test_what_needs_sensors_that_stand():
    for function in (
        lambda: reg.singular_tracks(SHIPS),
        lambda: reg.check_track(TARGET, SHIPS),
        lambda: reg.field(SHIPS, SIGMA, (0, 1e4, 0, 1e4)),
    ):
        with pytest.raises(
            gm.InputError, match=r"is for sensors that stand: sensors\['east'\] moves"
        ):
            function()
    reports = reg.simulate(TARGET, SHIPS, SIGMA, seed=1, times=T)
    with pytest.raises(gm.InputError, match=r"give times, or Reports\(values, times\)"):
        reg.estimate(reports.values, SHIPS, SIGMA)
    high = {"A": (0, 0, 0), "B": reg.Platform([[0, 9, 0], [9, 9, 0]], [0, 900], azimuths="heading")}
    with pytest.raises(gm.InputError, match="tilts are about east and north"):
        reg.rows(np.c_[TARGET, TARGET[:, :1]], high, (50, 1e-3, 1e-3), extras=["attitude"], times=T)
