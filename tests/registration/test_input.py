"""Registration: what is wrong is said, where it is, and nothing is answered."""

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg

SENSORS = [[0.0, 0.0], [60e3, 0.0]]
SIGMA = (50.0, 0.002)
TRACK = np.stack([np.linspace(0, 50e3, 30), np.full(30, 20e3)], axis=1)


@pytest.mark.parametrize(
    ("positions", "sensors", "sigma", "message"),
    [
        (TRACK, [[0, 0], [0, 0]], SIGMA, r"sensors\[1\] is at the place of sensors\[0\]"),
        (TRACK, [[0, 0]], SIGMA, "2 or more"),
        ([[60e3, 0]], SENSORS, SIGMA, r"look 0 is on sensors\[1\]"),
        ([[1, 2], [np.nan, 0]], SENSORS, SIGMA, r"positions\[1, 0\] = nan: must be finite"),
        (TRACK, SENSORS, (50.0, 0.0), r"sigma\[0, 1\] \(azimuth\) = 0 rad: must be > 0"),
        (TRACK, SENSORS, (50.0, -1.0), "must be > 0"),
        (TRACK, SENSORS, 50.0, r"sigma has shape \(\)"),
        (TRACK[:, :1], SENSORS, SIGMA, "positions has shape"),
        (TRACK, [[0, 0, 0, 0], [1, 1, 1, 1]], SIGMA, "sensors has shape"),
        (np.zeros((0, 2)), SENSORS, SIGMA, "must not be empty"),
    ],
)
def test_scenes(positions, sensors, sigma, message):
    for function in (reg.rows, reg.fisher, reg.eta):
        with pytest.raises(gm.InputError, match=message):
            function(positions, sensors, sigma)


def test_overhead():
    sensors = [[0, 0, 0], [60e3, 0, 0]]
    with pytest.raises(gm.InputError, match="straight above"):
        reg.rows([[0.0, 0.0, 9e3]], sensors, (50.0, 0.002, 0.002))


def test_names():
    with pytest.raises(gm.InputError, match=r"no bias is named 'C\.range': there are A\.range"):
        reg.simulate(TRACK, SENSORS, SIGMA, {"C.range": 1.0}, seed=1)
    with pytest.raises(gm.InputError, match="extras has 'scale'"):
        reg.rows(TRACK, SENSORS, SIGMA, extras=["scale"])
    with pytest.raises(gm.InputError, match="must be a sequence"):
        reg.rows(TRACK, SENSORS, SIGMA, extras="gain")


def test_reports():
    reports = reg.simulate(TRACK, SENSORS, SIGMA, seed=1).values
    degrees = reports.copy()
    degrees[..., 1] = np.degrees(degrees[..., 1])
    with pytest.warns(UserWarning, match="are they in degrees"):
        reg.Reports(degrees)
    with (
        pytest.warns(UserWarning, match="are they in degrees"),
        pytest.raises((gm.UnobservableError, gm.ConvergenceError)),
    ):
        reg.estimate(np.tile([[[2e4, 40.0], [5e4, 50.0]]], (9, 1, 1)), SENSORS, SIGMA)
    with pytest.raises(gm.InputError, match="different length"):
        reg.estimate([reports[:, 0], reports[:-1, 1]], SENSORS, SIGMA)
    with pytest.raises(gm.InputError, match=r"must be \(\.\.\., any, 3, 2\)"):
        reg.estimate(reports, [*SENSORS, [0, 50e3]], SIGMA)
    reports[3, 1, 0] = np.inf
    with pytest.raises(gm.InputError, match=r"reports\[3, 1, 0\] = inf: must be finite"):
        reg.estimate(reports, SENSORS, SIGMA)


def test_options():
    reports = reg.simulate(TRACK, SENSORS, SIGMA, seed=1)
    with pytest.raises(gm.InputError, match="method"):
        reg.estimate(reports, SENSORS, SIGMA, method="kalman")
    with pytest.raises(gm.InputError, match="prior needs"):
        reg.estimate(reports, SENSORS, SIGMA, method="ls", prior={"A.range": 1.0})
    with pytest.raises(gm.InputError, match=r"prior of A\.range = -1"):
        reg.estimate(reports, SENSORS, SIGMA, prior={"A.range": -1.0})
    with pytest.raises(gm.InputError, match=r"instants\[0\]"):
        reg.degree(TRACK, SENSORS, SIGMA, method="pair", instants=[(0, 30)])
    with pytest.raises(gm.InputError, match="two sensors in the plane"):
        reg.degree(TRACK, [*SENSORS, [0, 50e3]], SIGMA, method="paper")
    with pytest.raises(gm.InputError, match="smoothing"):
        reg.degree(TRACK, SENSORS, SIGMA, smoothing=4)
    with pytest.raises(gm.InputError, match="lag"):
        reg.degree(TRACK, SENSORS, SIGMA, method="pair", lag=30)
    with pytest.raises(gm.InputError, match="budget"):
        reg.select({"a": TRACK}, SENSORS, SIGMA, 2)
    with pytest.raises(gm.InputError, match="extent"):
        reg.field(SENSORS, SIGMA, (1, 0, 0, 1))
    with pytest.raises(gm.InputError, match="two sensors"):
        reg.singular_tracks([*SENSORS, [0, 50e3]])


def test_one_look_is_not_enough_and_says_so():
    answer = gm.analyze(reg.problem(TRACK[:1], SENSORS, SIGMA))
    assert answer.rank == 2
    assert np.isinf(answer.crlb_std).all()
    with pytest.raises(gm.UnobservableError):
        reg.estimate(reg.simulate(TRACK[:1], SENSORS, SIGMA, seed=1), SENSORS, SIGMA)


def test_recordings_to_match():
    t = np.arange(4.0)
    good = np.stack([np.full(4, 1e3), 0.1 * t], axis=1)
    with pytest.raises(gm.InputError, match=r"'B': times \(4,\) and reports \(4, 1\)"):
        reg.match({"A": (t, good), "B": (t, good[:, :1])})
    with pytest.raises(gm.InputError, match="different numbers of columns: 'A' 2, 'B' 3"):
        reg.match({"A": (t, good), "B": (t, np.column_stack([good, t]))}, interpolate="linear")
    lacking = good.copy()
    lacking[2, 0] = np.nan
    with pytest.raises(gm.InputError, match="different length: 'A' has 4, 'B' 3"):
        reg.match({"A": (t, good), "B": (t, lacking)})
    dropped = reg.match({"A": (t, good), "B": (t, lacking)}, missing="drop")
    assert dropped.times.tolist() == [0.0, 1.0, 3.0]
    kept = reg.match({"A": (t, good), "B": (t, lacking)}, missing="keep").values
    assert np.isnan(kept[2, 1]).all()
    assert np.isfinite(kept[2, 0]).all()


def test_noise_beyond_the_numbers_is_refused():
    track = np.stack([np.linspace(5e3, 5e4, 20), np.full(20, 2e4)], axis=1)
    sigma = [[50.0, 1e308], [50.0, 2e-3]]
    with pytest.raises(gm.InputError, match=r"sigma reaches 1e\+308"):
        gm.registration.simulate(track, {"A": (0, 0), "B": (6e4, 0)}, sigma, seed=1)
