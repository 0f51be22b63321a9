"""Registration answers with an `Estimate`: fit, intervals, and what reports that do not fit say."""

import pickle

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg
from gramian import scenario

SENSORS = {"A": (0.0, 0.0), "B": (60e3, 0.0)}
SIGMA = (50.0, np.radians(0.1))
TRUE = {"A.range": 300.0, "B.azimuth": -0.007}
TRACK = np.stack([np.linspace(-20e3, 60e3, 60), np.full(60, 25e3)], axis=1)


def test_the_answer_is_an_estimate_of_the_biases():
    reports = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=3)
    answer = reg.estimate(reports, SENSORS, SIGMA)
    assert isinstance(answer, gm.Estimate)
    assert answer.status == "determined"
    assert answer.fit.dof == 60 * 2 - 4
    # The least chi2 over biases is that over biases and positions together.
    known = answer.model.handle(answer.measurements)
    best = known.minimize(answer.state[None], ("squares", 0.0), 50)[0]
    assert best["chi2"] == pytest.approx(answer.fit.chi2, rel=1e-9)
    assert best["x"] == pytest.approx(answer.state, abs=1e-4)
    near = answer.interval("A.range")
    assert near.local == pytest.approx(1.959964 * answer.std[0], rel=1e-3)
    assert 300.0 in answer.interval("A.range", 0.9999)
    assert pickle.loads(pickle.dumps(answer)) == answer


def test_a_bias_that_drifts_is_a_misfit_and_named():
    reports = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=3).values.copy()
    reports[:, 0, 0] += np.linspace(-200, 200, 60)
    answer = reg.estimate(reports, SENSORS, SIGMA)
    assert answer.status == "misfit"
    assert any("range" in a.name for a in answer.fit.alternatives[:2])
    assert "MISFIT" in answer.summary()


def test_honest_reports_fit():
    trials = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=9, trials=60).values
    answers = [reg.estimate(values, SENSORS, SIGMA) for values in trials]
    assert sum(answer.status == "misfit" for answer in answers) <= 1
    p = np.array([answer.fit.p_value for answer in answers])
    assert abs((p < 0.5).mean() - 0.5) < 4 * 0.5 / np.sqrt(60)
    many = reg.estimate(trials, SENSORS, SIGMA)
    assert isinstance(many, reg.Estimates)
    assert many.biases == pytest.approx(np.array([a.biases for a in answers]), rel=1e-9, abs=1e-9)
    assert many.p_value == pytest.approx(p, rel=1e-6)


TIMES = np.arange(0.0, 600.0, 10.0)


def turning():
    """A target that turns a circle of 20 km beside the baseline, at 209 m/s."""
    angle = TIMES * 2 * np.pi / 600
    return np.c_[30e3 + 20e3 * np.cos(angle), 40e3 + 20e3 * np.sin(angle)]


def reported(path, velocity, seed, late=0.0, biases=TRUE):
    """Reports of both sensors; the stamps of B are `late` seconds."""
    a = reg.simulate(path, SENSORS, SIGMA, biases, seed=seed).values
    b = reg.simulate(path - late * velocity, SENSORS, SIGMA, biases, seed=seed).values
    return reg.Reports(np.stack([a[:, 0], b[:, 1]], axis=1), TIMES)


def circling():
    angle = TIMES * 2 * np.pi / 600
    return 20e3 * 2 * np.pi / 600 * np.c_[-np.sin(angle), np.cos(angle)]


def test_a_clock_that_is_off_is_named_and_then_estimated():
    late = reported(turning(), circling(), 5, late=1.0)
    plain = reg.estimate(late, SENSORS, SIGMA)
    assert plain.status == "misfit"
    assert plain.fit.alternatives[0].name == "clock of B"
    assert abs(plain["A.range"] - 300) > 4 * plain.std[0]
    found = reg.estimate(late, SENSORS, SIGMA, clocks=True)
    assert found.status == "determined"
    assert found.names[-1] == "B.clock"
    assert (np.abs(found.state - [300.0, 0, 0, -0.007, 1.0]) < 4 * found.std).all()
    assert found.std[-1] < 0.2
    # Half of it is at the limit of what shows, and then the answer says what it could do.
    half = reg.estimate(reported(turning(), circling(), 5, late=0.5), SENSORS, SIGMA)
    assert "clock of B up to 0.487 s would go unseen and move A.range by 3.5" in half.summary()


def test_clocks_are_estimated_at_their_bound():
    path, velocity = turning(), circling()
    answers = [
        reg.estimate(reported(path, velocity, seed, late=0.5), SENSORS, SIGMA, clocks=True)
        for seed in range(60)
    ]
    error = np.array([a.state for a in answers]) - [300.0, 0, 0, -0.007, 0.5]
    nees = [e @ np.linalg.solve(a.covariance, e) for e, a in zip(error, answers, strict=True)]
    assert abs(np.mean(nees) / 5 - 1) < 4 * np.sqrt(2 / 5 / 60)


def test_reports_that_are_missing_are_left_out():
    sensors = {**SENSORS, "C": (20e3, -30e3)}
    path = turning()
    values = reg.simulate(path, sensors, SIGMA, TRUE, seed=2).values
    whole = reg.estimate(values, sensors, SIGMA)
    holes = values.copy()
    holes[::3, 0] = np.nan
    holes[1::3, 2, 1] = np.nan
    holes[5, :2] = np.nan  # nothing is left to compare
    found = reg.estimate(holes, sensors, SIGMA)
    assert found.fit.dof == int(np.isfinite(np.delete(holes, 5, 0)).sum()) - 59 * 2 - 6
    truth = np.zeros(6)
    truth[[0, 3]] = 300.0, -0.007
    assert (np.abs(found.state - truth) < 4 * found.std).all()
    assert (found.std > whole.std).all()
    # Of two sensors, a look with one report is no look.
    pair = holes[:, :2]
    kept = np.isfinite(pair).all(axis=(1, 2))
    found = reg.estimate(pair, SENSORS, SIGMA)
    np.testing.assert_allclose(
        found.state, reg.estimate(pair[kept], SENSORS, SIGMA).state, rtol=1e-5
    )


def test_a_gross_report_hardly_moves_a_robust_estimate():
    values = reg.simulate(turning(), SENSORS, SIGMA, TRUE, seed=4).values
    clean = reg.estimate(values, SENSORS, SIGMA)
    gross = values.copy()
    gross[17, 0, 0] += 20e3
    moved = {
        loss: reg.estimate(gross, SENSORS, SIGMA, loss=loss, on_failure="report").state[0]
        - clean.state[0]
        for loss in ("squares", "huber", "tukey")
    }
    assert abs(moved["squares"]) > 3 * clean.std[0]
    assert abs(moved["huber"]) < clean.std[0]
    assert abs(moved["tukey"]) < clean.std[0]
    assert reg.estimate(gross, SENSORS, SIGMA).status == "misfit"


def test_one_radar_against_reported_positions():
    path = turning()
    answers = []
    for seed in range(40):
        values = reg.simulate(path, SENSORS, SIGMA, TRUE, seed=seed).values[:, :1]
        given = path + np.random.default_rng(seed).normal(0, 30.0, path.shape)
        given[::7] = np.nan
        one = {"A": SENSORS["A"]}
        answers.append(reg.estimate(values, one, SIGMA, truth=given, truth_sigma=30.0))
    assert {answer.status for answer in answers} <= {"determined", "misfit"}
    error = np.array([a.state for a in answers]) - [300.0, 0.0]
    nees = [e @ np.linalg.solve(a.covariance, e) for e, a in zip(error, answers, strict=True)]
    assert abs(np.mean(nees) / 2 - 1) < 4 / np.sqrt(40)
    # On a track that two radars cannot resolve, a truth can.
    line = np.c_[np.linspace(5e3, 55e3, 60), np.zeros(60)]
    values = reg.simulate(line, SENSORS, SIGMA, TRUE, seed=1).values
    with pytest.raises(gm.UnobservableError):
        reg.estimate(values, SENSORS, SIGMA)
    found = reg.estimate(values, SENSORS, SIGMA, truth=line, truth_sigma=30.0)
    assert (np.abs(found.state - [300.0, 0, 0, -0.007]) < 4 * found.std).all()


def test_an_extra_of_one_sensor_alone():
    biases = {**TRUE, "A.gain": 1e-3}
    values = reg.simulate(turning(), SENSORS, SIGMA, biases, seed=8, extras=("gain",)).values
    found = reg.estimate(values, SENSORS, SIGMA, extras=("gain",), fixed={"B.gain": 0.0})
    assert "B.gain" not in found.names
    truth = [300.0, 0, 1e-3, 0, -0.007]
    assert (np.abs(found.state - truth) < 4 * found.std).all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"clocks": True}, "clocks need the times"),
        ({"truth": TRACK}, "truth needs truth_sigma"),
        ({"truth": TRACK[:5], "truth_sigma": 1.0}, "truth has shape .5, 2."),
        ({"truth": TRACK, "truth_sigma": 0.0}, "truth_sigma = 0"),
        ({"truth_sigma": 3.0}, "without truth"),
        ({"loss": "huber", "method": "gls"}, 'method "ml"'),
        ({"loss": "cauchy"}, "loss"),
        ({"fixed": {"C.range": 0.0}}, "C.range"),
    ],
)
def test_what_does_not_fit_is_named(arguments, said):
    values = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=3).values
    with pytest.raises(gm.InputError, match=said):
        reg.estimate(values, SENSORS, SIGMA, **arguments)


def test_reports_without_a_pair_are_refused():
    values = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=3).values.copy()
    values[:, 1] = np.nan
    with pytest.raises(gm.InputError, match="no look has whole reports of two sensors"):
        reg.estimate(values, SENSORS, SIGMA)
    values[0, 0, 0] = np.inf
    with pytest.raises(gm.InputError, match=r"reports\[0, 0, 0\] = inf"):
        reg.estimate(values, SENSORS, SIGMA, loss="huber")


def test_recordings_with_holes_are_paired():
    t = np.arange(0.0, 50.0, 10.0)
    values = np.c_[1000 + t, 0.01 * t]
    a, b = (t, values), (t[[0, 2, 3, 4]] + 1e-4, values[[0, 2, 3, 4]])
    with pytest.raises(gm.InputError, match='missing="drop"'):
        reg.match({"A": a, "B": b})
    dropped = reg.match({"A": a, "B": b}, missing="drop")
    assert dropped.times.tolist() == [0, 20, 30, 40]
    kept = reg.match({"A": a, "B": b}, missing="keep")
    assert kept.times.tolist() == t.tolist()
    assert np.isnan(kept.values[1, 1]).all()
    np.testing.assert_array_equal(kept.values[:, 0], values)
    with pytest.raises(gm.InputError, match="no common time"):
        reg.match({"A": a, "B": (t + 5.0, values)}, missing="drop")
    with pytest.raises(gm.InputError, match="must be smaller"):
        reg.match({"A": a, "B": b}, missing="keep", tolerance=20.0)


def test_a_file_with_holes_and_a_late_clock(tmp_path):
    late = reported(turning(), circling(), 5, late=1.0)
    lines = ["target,t,radar,r,az"]
    for k, (time, look) in enumerate(zip(TIMES, late.values, strict=True)):
        for name, (r, azimuth) in zip("AB", look, strict=True):
            if (k, name) != (30, "B"):
                lines.append(f"T,{time},{name},{r},{np.degrees(azimuth)}")
    (tmp_path / "r.csv").write_text("\n".join(lines), encoding="utf-8")
    text = """model = "registration"
[sensors]
A = { east = 0.0, north = 0.0, sigma_range = 50.0, sigma_azimuth_deg = 0.1 }
B = { east = 60e3, north = 0.0, sigma_range = 50.0, sigma_azimuth_deg = 0.1 }
[estimate]
clocks = CLOCKS
[reports]
file = "r.csv"
columns = { target = "target", time = "t", sensor = "radar", range = "r", azimuth_deg = "az" }
"""
    (tmp_path / "s.toml").write_text(text.replace("CLOCKS", "true"), encoding="utf-8")
    report = scenario.load(tmp_path / "s.toml").localize()
    assert report.headline == "ESTIMATED"
    found = report.data["estimates"]["all targets"]
    assert abs(found["state"][-1] - 1.0) < 4 * found["std"][-1]
    assert dict(report.facts)["left out"] == "1 report of looks of one sensor"
    (tmp_path / "s.toml").write_text(text.replace("CLOCKS", "false"), encoding="utf-8")
    report = scenario.load(tmp_path / "s.toml").localize()
    assert report.headline == "THE REPORTS DO NOT FIT"
    assert "clock of B" in report.verdict


def test_without_a_search_there_are_no_other_solutions():
    values = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=3).values
    model = reg.estimate(values, SENSORS, SIGMA).model
    answer = gm.estimate(model, values, search=False)
    assert answer.others == ()
    assert answer.unseen == 1.0
    with pytest.raises(gm.InputError, match="search"):
        gm.estimate(model, values, search="no")


def test_a_radar_whose_azimuth_is_stuck_is_a_misfit():
    reports = reg.simulate(TRACK, SENSORS, SIGMA, TRUE, seed=1).values.copy()
    assert reg.estimate(reports, SENSORS, SIGMA).fit.faults == ()
    reports[20:30, 1, 1] = reports[20, 1, 1]
    found = reg.estimate(reports, SENSORS, SIGMA, on_failure="report")
    assert found.status == "misfit"
    assert "B.azimuth is stuck at one value from look 21 to look 30" in found.reason
