"""The built-in experiments run wholly in Rust and say what their parts say one by one."""

import concurrent.futures as cf
import json
import multiprocessing
import re
import signal
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest
from typer.testing import CliRunner

import gramian as gm
from gramian.cli import app
from monte_carlo_cases import Level, mean, scene

PRIOR = {"vx": 0.2, "y0": 100.0}


PASS = ([-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0], np.arange(21.0))
TARGETS = np.stack([np.linspace(-20e3, 60e3, 60), np.linspace(25e3, 35e3, 60)], axis=1)
RADARS = {"A": (0.0, 0.0), "B": (60e3, 0.0)}
BIASES = {"A.range": 300.0, "A.azimuth": 0.004, "B.range": -200.0, "B.azimuth": -0.007}
TRIALS = {"bearings": 4000, "bearings with a prior": 4000, "registration": 2000}


def experiments():
    few = scene()
    return {
        "bearings": few,
        "bearings with a prior": gm.monte_carlo.Bearings(
            few.times, few.observer, few.target, np.radians(0.5), PRIOR
        ),
        "dipole": gm.monte_carlo.Dipole(*PASS, 2e-10, known=["z0", "vz"]),
        "dipole with a known speed": gm.monte_carlo.Dipole(*PASS, 2e-10, known=["speed"]),
        "registration": gm.monte_carlo.Registration(TARGETS, RADARS, (50.0, 0.00175), BIASES),
    }


@pytest.mark.parametrize("name", experiments())
def test_the_built_in_estimator_reaches_the_bound_and_is_honest(name):
    trials = TRIALS.get(name, 1000)
    result = gm.monte_carlo.run(experiments()[name], trials, 7)
    assert (abs(result.efficiency - 1) < (0.05 if trials > 1000 else 0.07)).all(), result.summary()
    assert result.failed == 0
    if name == "dipole with a known speed":
        # Fewer degrees of freedom than states: no NEES rather than a wrong one.
        assert result.nees is None
    else:
        # Four standard deviations: the 95 % band is left by one run in twenty.
        n, count = len(result.names), result.nees.count
        assert abs(result.nees.mean - n) < 4 * np.sqrt(2 * n / count)


@pytest.mark.parametrize("name", experiments())
def test_threads_chunks_and_workers_do_not_change_a_bit(name, tmp_path):
    experiment, trials = experiments()[name], TRIALS.get(name, 400) // 2

    def run(**options):
        return gm.monte_carlo.run(experiment, trials, 5, table=True, **options)

    wanted = run()
    before = gm.set_threads(0)
    gm.set_threads(before)
    for options in (
        {"workers": 1},
        {"workers": 2},
        {"workers": 8},
        {"chunk": 64},
        {"chunk": 4096, "workers": 2},
        {"resume": tmp_path, "chunk": 512},
        {"resume": tmp_path},
    ):
        found = run(**options)
        assert found.to_dict() == wanted.to_dict(), options
        assert found.table.tobytes() == wanted.table.tobytes(), options
    assert gm.set_threads(before) == before
    for method in ("fork", "spawn"):
        with cf.ProcessPoolExecutor(2, multiprocessing.get_context(method)) as pool:
            assert run(executor=pool).to_dict() == wanted.to_dict()


def test_the_built_in_estimator_is_localize_on_the_simulated_bearings():
    experiment = scene()
    table = gm.monte_carlo.run(experiment, 300, 5, table=True).table

    def own(bearings):
        return gm.bearings.localize_many(
            experiment.times, bearings, experiment.observer, experiment.sigma
        )

    mine = gm.monte_carlo.run(experiment, 300, 5, own, table=True).table
    for column in table.dtype.names:
        np.testing.assert_allclose(mine[column], table[column], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", ["ml", "gls", "ls"])
def test_registration_in_one_pass_is_estimate_on_the_simulated_reports(method):
    experiment = experiments()["registration"]

    def own(reports):
        found = gm.registration.estimate(
            reports, RADARS, (50.0, 0.00175), method=method, on_failure="report"
        )
        return found.biases, found.covariance

    table = gm.monte_carlo.run(experiment, 100, 5, method, table=True).table
    mine = gm.monte_carlo.run(experiment, 100, 5, own, table=True).table
    for column in table.dtype.names:
        np.testing.assert_allclose(mine[column], table[column], rtol=1e-6, atol=1e-9)


def test_a_dipole_in_one_pass_is_localize_on_the_simulated_fields():
    experiment = experiments()["dipole"]

    def own(field):
        found = gm.dipole.localize(PASS[3], field, {"z0": 5.0, "vz": 0.0}, sigma=2e-10)
        state = np.concatenate([found.r0, found.v, found.m])
        free = [gm.dipole.NAMES.index(name) for name in experiment.names]
        return state[free]

    table = gm.monte_carlo.run(experiment, 50, 5, table=True).table
    mine = gm.monte_carlo.run(experiment, 50, 5, own, table=True).table
    for column in table.dtype.names:
        np.testing.assert_allclose(mine[column], table[column], rtol=1e-4, atol=1e-5)


def test_the_log_determinant_is_that_of_the_simulated_bearings():
    experiment = scene()
    result = gm.monte_carlo.run(experiment, 500, 5, quantities=["gram_logdet"], table=True)
    bearings = experiment.simulate(5, 0, 500)
    wanted = np.log(gm.bearings.discriminant_sum(experiment.times, bearings, method="qr"))
    np.testing.assert_allclose(result.table["gram_logdet"], wanted, rtol=0, atol=1e-7)
    assert result.estimator is None
    both = gm.monte_carlo.run(experiment, 500, 5, "ml", quantities=["gram_logdet"])
    assert both.quantities["gram_logdet"].mean == result.quantities["gram_logdet"].mean
    assert both.used == 500
    for options in ({"workers": 1}, {"workers": 8}, {"chunk": 16}):
        again = gm.monte_carlo.run(experiment, 500, 5, quantities=["gram_logdet"], **options)
        assert again.to_dict() == result.to_dict()


def test_memory_stays_flat():
    """Ten times the trials, the same peak: nothing is kept of a trial but its part in the sums."""
    experiment, peaks = scene(), {}
    gm.monte_carlo.run(experiment, 8192, 1, quantities=["gram_logdet"], chunk=4096)
    for trials, workers in ((40_000, 1), (400_000, 1), (400_000, 2)):
        tracemalloc.start()
        gm.monte_carlo.run(
            experiment, trials, 1, quantities=["gram_logdet"], chunk=4096, workers=workers
        )
        peaks[trials, workers] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peaks[400_000, 1] < 1.05 * peaks[40_000, 1] + 20_000, peaks
    # On several threads two chunks are under way and one is summed up.
    assert peaks[400_000, 2] < 3 * peaks[40_000, 1], peaks


def test_what_is_weak_is_said():
    far = gm.monte_carlo.Bearings(
        scene().times, scene().observer, [20000.0, 50000.0, -2.0, 1.0], np.radians(2.0)
    )
    result = gm.monte_carlo.run(far, 2000, 1)
    assert {failure.kind for failure in result.failures} >= {"likelihood grows to infinite range"}
    assert sum(failure.count for failure in result.failures) == result.failed > 0
    assert not result.nees.consistent


def test_a_straight_observer_is_refused_by_name():
    straight = np.stack([0 * scene().times, 5 * scene().times], axis=1)
    blind = gm.monte_carlo.Bearings(scene().times, straight, scene().target, 0.01)
    with pytest.raises(gm.UnobservableError, match="no estimator can find these states") as caught:
        gm.monte_carlo.run(blind, 10, 1)
    assert caught.value.null_combinations


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": [1.0, 2.0]}, r"target has shape \(2,\): must be \(4,\)"),
        ({"sigma": 0.0}, "must be > 0"),
        ({"times": [0.0] * 60}, "must be later"),
        ({"observer": np.zeros((3, 2))}, "observer has shape"),
        ({"prior": {"speed": 1.0}}, "prior has 'speed'"),
        ({"prior": {"vx": 0.0}}, "must be > 0"),
    ],
)
def test_bad_experiments_are_named(change, message):
    given = {
        "times": scene().times,
        "observer": scene().observer,
        "target": scene().target,
        "sigma": 0.01,
    }
    with pytest.raises(gm.InputError, match=message):
        gm.monte_carlo.Bearings(**(given | change))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: gm.monte_carlo.Dipole(*PASS, 1e-9, known=["z"]), "known has 'z'"),
        (lambda: gm.monte_carlo.Dipole(*PASS, -1e-9), "must be > 0"),
        (
            lambda: gm.monte_carlo.Registration(TARGETS, RADARS, (50.0, 0.01), {"C.range": 1.0}),
            "no bias is named 'C.range'",
        ),
        (lambda: gm.monte_carlo.Registration(TARGETS, RADARS, (50.0, 0.0)), "must be > 0"),
    ],
)
def test_bad_dipoles_and_registrations_are_named(make, message):
    with pytest.raises(gm.InputError, match=message):
        make()


def test_a_dipole_of_which_too_little_is_known_is_refused():
    with pytest.raises(gm.UnobservableError, match="no estimator can find these states"):
        gm.monte_carlo.run(gm.monte_carlo.Dipole(*PASS, 1e-9), 10, 1)


def test_what_is_given_is_copied():
    target = np.array([2000.0, 5000.0, -2.0, 1.0])
    experiment = gm.monte_carlo.Bearings(scene().times, scene().observer, target, 0.01)
    target[:] = 0
    assert experiment.truth[0] == 2000.0


SCENARIO = """
model = "bearings"
[tracks]
file = "boat.csv"
columns = { time = "t", east = "e", north = "n" }
[target]
x0 = 2000.0
y0 = 5000.0
vx = -2.0
vy = 1.0
[window]
start = 0.0
duration = 590.0
step = 10.0
[noise]
bearing_deg = 0.1
"""


@pytest.fixture
def file(tmp_path):
    lines = [f"{t},{e},{n}" for t, (e, n) in zip(scene().times, scene().observer, strict=True)]
    (tmp_path / "boat.csv").write_text("t,e,n\n" + "\n".join(lines) + "\n")
    (tmp_path / "scene.toml").write_text(SCENARIO)
    return tmp_path / "scene.toml"


def test_gramian_simulate_writes_its_report(file, tmp_path):
    out = tmp_path / "out"
    arguments = ["simulate", str(file), "--trials", "2000", "--seed", "3", "--out", str(out)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "REACHES THE BOUND" in done.output
    assert "RMSE / bound" in done.output
    # Nothing is cut off, also where the terminal has 80 columns.
    assert "…" not in done.output
    data = json.loads((out / "result.json").read_text())["monte_carlo"]
    wanted = gm.monte_carlo.run(scene(), 2000, 3)
    np.testing.assert_allclose(data["rmse"], wanted.rmse, rtol=1e-9)
    page = (out / "report.html").read_text()
    for title in ("Errors of x0 and y0", "RMSE against the bound", "Is the covariance consistent?"):
        assert title in page
    assert page.count("data:image/") >= 4


def test_gramian_simulate_is_resumed_and_refuses_nonsense(file, tmp_path):
    runner = CliRunner()
    kept = ["--resume", str(tmp_path / "kept"), "--json"]
    first = runner.invoke(app, ["simulate", str(file), "--trials", "500", *kept])
    again = runner.invoke(app, ["simulate", str(file), "--trials", "500", *kept])
    assert first.exit_code == again.exit_code == 0
    assert json.loads(first.stdout)["monte_carlo"] == json.loads(again.stdout)["monte_carlo"]
    bad = runner.invoke(app, ["simulate", str(file), "--trials", "0"])
    assert isinstance(bad.exception, gm.InputError)
    assert "trials = 0: must be >= 1" in str(bad.exception)
    other = runner.invoke(app, ["simulate", str(file), "--seed", "2", *kept])
    assert "is of another seed" in str(other.exception)
    text = file.read_text() + "\n[prior]\nspeed = 0.5\n"
    (tmp_path / "prior.toml").write_text(text)
    prior = runner.invoke(app, ["simulate", str(tmp_path / "prior.toml")])
    assert "prior.speed: simulate takes" in str(prior.exception)


def test_ctrl_c_ends_gramian_simulate_with_a_word_of_what_is_kept(file, tmp_path):
    kept = tmp_path / "kept"
    command = [sys.executable, "-m", "gramian", "simulate", str(file)]
    process = subprocess.Popen(
        [*command, "--trials", "2000000000", "--resume", str(kept)],
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + 60
    while not list(kept.glob("chunk-*.parquet")):
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=10)
    assert process.returncode == 130
    assert re.fullmatch(rf"stopped after \d+ of 2000000000 trials; kept in {kept}\n", said)


def test_a_report_of_a_run_with_failures_counts_them():
    from gramian.monte_carlo.report import report

    def fails(z):
        if z[0] > 4:
            raise ValueError("too large")
        return mean(z)

    shown = report(gm.monte_carlo.run(Level(10), 300, 1, fails), title="t", subtitle="s")
    assert shown.tone == "weak"
    assert shown.tables[1].title == "Trials that failed"
    assert shown.tables[1].rows[0][0] == "raised ValueError"
    dead = report(gm.monte_carlo.run(Level(10), 30, 1, lambda z: 1 / 0), title="t", subtitle="s")
    assert dead.tone == "bad"
    assert dead.headline == "NO ESTIMATE"
    dead.to_json()


def test_trials_of_correlated_noise_do_not_depend_on_their_company():
    random = np.random.default_rng(0)
    beacons, root = 100 * random.normal(size=(37, 2)), random.normal(size=(37, 37))
    model = gm.from_function(
        lambda p: np.hypot(*(beacons - p).T), [3.0, 4.0], root @ root.T, ["east", "north"]
    )
    together = model.simulate(seed=1, trials=50)
    for size in (1, 2, 7):
        parts = [model.simulate(None, 1, min(size, 50 - k), k) for k in range(0, 50, size)]
        assert np.concatenate(parts).tobytes() == together.tobytes()
