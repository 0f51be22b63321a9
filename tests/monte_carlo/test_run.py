"""A Monte Carlo run: the same everywhere, and clear about all that can go wrong."""

import concurrent.futures as cf
import multiprocessing
import sys

import numpy as np
import pytest

import gramian as gm
from monte_carlo_cases import (
    COVARIANCE,
    SIGMA,
    Level,
    always_dies,
    dies_once,
    linear_estimate,
    mean,
    scene,
    sometimes_fails,
    with_covariance,
)

TRIALS = 700


def same(a, b):
    assert a.to_dict() == b.to_dict()
    assert a.sample.tobytes() == b.sample.tobytes()


@pytest.fixture(scope="module")
def plain():
    return gm.monte_carlo.run(scene(), TRIALS, 11, sometimes_fails)


def test_an_efficient_estimator_reaches_the_bound():
    result = gm.monte_carlo.run(scene(), 4000, 1, with_covariance, table=True)
    assert (abs(result.efficiency - 1) < 0.05).all()
    assert ((result.bias_interval[:, 0] <= 0) & (result.bias_interval[:, 1] >= 0)).all()
    assert result.nees.consistent
    assert result.verdict.startswith("REACHES THE BOUND")
    np.testing.assert_allclose(result.bound, np.sqrt(np.diag(COVARIANCE)), rtol=1e-6)
    errors = np.stack([result.table[f"error_{name}"] for name in result.names], axis=1)
    np.testing.assert_allclose(result.rmse, np.sqrt((errors**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(result.covariance, np.cov(errors.T), rtol=1e-10)
    low, high = np.moveaxis(result.covariance_interval, -1, 0)
    assert (low < result.covariance).all()
    assert (result.covariance < high).all()


def test_a_poor_estimator_does_not():
    result = gm.monte_carlo.run(Level(10), 4000, 1, lambda z: [z[:5].mean()])
    np.testing.assert_allclose(result.efficiency, np.sqrt(2), rtol=0.05)
    assert result.verdict.startswith("ABOVE THE BOUND")
    shrunk = gm.monte_carlo.run(Level(10), 4000, 1, lambda z: [3 + 0.1 * (z.mean() - 3)])
    assert shrunk.verdict.startswith("BELOW THE BOUND")


def test_trial_i_depends_on_the_seed_and_i_alone():
    short = gm.monte_carlo.run(scene(), 100, 4, linear_estimate, table=True)
    long = gm.monte_carlo.run(scene(), 300, 4, linear_estimate, table=True)
    np.testing.assert_array_equal(short.table, long.table[:100])
    other = gm.monte_carlo.run(scene(), 100, 5, linear_estimate, table=True)
    assert not (short.table["error_x0"] == other.table["error_x0"]).any()
    simulated = gm.bearings.simulate(
        scene().times, scene().observer, scene().target, SIGMA, seed=4, trials=3
    )
    np.testing.assert_array_equal(scene().simulate(4, 1, 2), simulated[1:])


@pytest.mark.parametrize("chunk", [16, 64, 1024])
def test_chunks_do_not_change_a_bit(plain, chunk):
    same(plain, gm.monte_carlo.run(scene(), TRIALS, 11, sometimes_fails, chunk=chunk))


@pytest.mark.parametrize("threads", [1, 2, 8])
def test_threads_do_not_change_a_bit(threads):
    line = gm.Problem([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], ["level", "slope"])
    once = gm.monte_carlo.run(line, 5000, 3)
    same(once, gm.monte_carlo.run(line, 5000, 3, workers=threads))
    same(once, gm.monte_carlo.run(line, 5000, 3, workers=threads, chunk=64))


@pytest.mark.parametrize(("rows", "states"), [(3, 1), (60, 4), (61, 9), (400, 20)])
def test_a_linear_experiment_rounds_alike_in_any_chunk(rows, states):
    """Also in the last chunk, of one trial."""
    random = np.random.default_rng(rows)
    problem = gm.Problem(random.normal(size=(rows, states)), [f"s{i}" for i in range(states)])
    once = gm.monte_carlo.run(problem, 2049, 3, table=True)
    for options in ({"chunk": 16}, {"chunk": 64, "workers": 2}, {"chunk": 4096}):
        found = gm.monte_carlo.run(problem, 2049, 3, table=True, **options)
        assert found.table.tobytes() == once.table.tobytes()
        same(once, found)
    noise = gm.monte_carlo.normals(3, 0, 2049, rows)
    wanted = np.linalg.lstsq(problem.rows, noise.T, rcond=None)[0].T
    found = np.stack([once.table[f"error_s{i}"] for i in range(states)], axis=1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_process_pool_does_not_change_a_bit(plain, method):
    with cf.ProcessPoolExecutor(2, multiprocessing.get_context(method)) as pool:
        same(plain, gm.monte_carlo.run(scene(), TRIALS, 11, sometimes_fails, executor=pool))


def test_own_workers_and_threads_do_not_change_a_bit(plain):
    same(plain, gm.monte_carlo.run(scene(), TRIALS, 11, sometimes_fails, workers=2))
    with cf.ThreadPoolExecutor(3) as pool:
        same(plain, gm.monte_carlo.run(scene(), TRIALS, 11, sometimes_fails, executor=pool))
        line = gm.Problem([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], ["level", "slope"])
        same(
            gm.monte_carlo.run(line, 5000, 3),
            gm.monte_carlo.run(line, 5000, 3, executor=pool, chunk=256),
        )


def test_a_killed_worker_of_our_own_loses_nothing(tmp_path):
    wanted = gm.monte_carlo.run(scene(), TRIALS, 11, linear_estimate).to_dict()
    estimator = dies_once(tmp_path / "flag")
    found = gm.monte_carlo.run(scene(), TRIALS, 11, estimator, workers=2).to_dict()
    assert (tmp_path / "flag").exists()
    assert found == wanted | {"estimator": "partial"}


def test_a_killed_worker_of_a_given_pool_loses_nothing(tmp_path):
    wanted = gm.monte_carlo.run(scene(), TRIALS, 11, linear_estimate).to_dict()
    estimator = dies_once(tmp_path / "flag")
    with (
        cf.ProcessPoolExecutor(2) as pool,
        pytest.warns(RuntimeWarning, match="run again on a new pool of 2"),
    ):
        found = gm.monte_carlo.run(scene(), TRIALS, 11, estimator, executor=pool).to_dict()
    assert found == wanted | {"estimator": "partial"}


def test_workers_that_keep_dying_are_given_up():
    with pytest.raises(gm.WorkerError, match="died 3 times while running trials 0 to"):
        gm.monte_carlo.run(scene(), 64, 11, always_dies, workers=1)


def test_failures_are_counted_and_named(plain):
    kinds = {failure.kind: failure for failure in plain.failures}
    assert set(kinds) == {"raised ValueError", "not finite", "wrong shape"}
    raised = kinds["raised ValueError"]
    assert "Traceback" in raised.message
    assert "ValueError: too far" in raised.message
    assert "must be (4,)" in kinds["wrong shape"].message
    assert "(3,)" in kinds["wrong shape"].message
    assert "nan" in kinds["not finite"].message
    assert sum(failure.count for failure in plain.failures) == plain.failed
    assert plain.used + plain.failed == TRIALS
    for failure in plain.failures:
        assert failure.kind in plain.summary()
    first = min(kinds.values(), key=lambda failure: failure.first_trial).first_trial
    assert plain.sample["status"][first] != 0
    assert (plain.sample["status"][:first] == 0).all()
    assert np.isfinite(plain.rmse).all()


def test_when_all_trials_fail_the_answer_says_so():
    result = gm.monte_carlo.run(scene(), 40, 1, lambda z: 1 / 0)
    assert result.verdict == "NO ESTIMATE: all 40 trials failed"
    assert result.failures[0].kind == "raised ZeroDivisionError"
    assert result.used == 0
    assert "nan" not in result.summary()
    result.plot()


def wrong(kind):
    """Return what estimators return that is no estimate of one state."""
    return {
        "scalar": 3.0,
        "column": [[3.0]],
        "two": [1.0, 2.0],
        "nothing": None,
        "text": "three",
        "imaginary": np.array([3 + 1j]),
        "generator": (x for x in [3.0]),
        "table": {"level": 3.0},
        "ragged": [[1.0], [2.0, 3.0]],
        "infinite": [np.inf],
        "masked": np.ma.masked_array([3.0], [True]),
        "covariance of two": ([3.0], np.eye(2)),
        "covariance of text": ([3.0], [["a"]]),
    }[kind]


@pytest.mark.parametrize(
    ("returned", "kind"),
    [
        ("scalar", "wrong shape"),
        ("column", "wrong shape"),
        ("two", "wrong shape"),
        ("nothing", "not numbers"),
        ("text", "not numbers"),
        ("imaginary", "not numbers"),
        ("generator", "not numbers"),
        ("table", "not numbers"),
        ("ragged", "not numbers"),
        ("infinite", "not finite"),
        ("masked", "not finite"),
        ("covariance of two", "wrong shape"),
        ("covariance of text", "not numbers"),
    ],
)
def test_what_is_no_estimate_is_counted(returned, kind):
    result = gm.monte_carlo.run(Level(10), 20, 1, lambda z: wrong(returned))
    (failure,) = result.failures
    assert (failure.kind, failure.count, result.used) == (kind, 20, 0)
    assert result.verdict == "NO ESTIMATE: all 20 trials failed"


def test_covariances_of_some_trials_are_judged_trial_by_trial():
    """Claims and none, good and bad, in one chunk: each counts for its own trial."""

    def moody(z):
        state, place = [z.mean()], int(abs(z[0]) * 1e6) % 4
        claims = [[[0.1]], [[np.inf]], [[-1.0]], None]
        return state if claims[place] is None else (state, claims[place])

    result = gm.monte_carlo.run(Level(10), 400, 1, moody, table=True)
    places = (np.abs(Level(10).simulate(1, 0, 400)[:, 0]) * 1e6).astype(int) % 4
    (failure,) = result.failures
    assert failure.kind == "covariance not positive definite (no NEES)"
    none = (places == 1) | (places == 2)
    assert (failure.count, failure.first_trial) == (none.sum(), np.flatnonzero(none)[0])
    wanted = np.where(none, np.nan, result.table["error_level"] ** 2 / 0.1)
    np.testing.assert_allclose(result.table["nees"], wanted, rtol=1e-12)
    assert result.used == 400


def test_what_is_an_estimate_is_not_written_out():
    """The text of an answer costs more than most estimators: it is for complaints alone."""

    class Mute(list):
        def __repr__(self):
            raise AssertionError

    assert gm.monte_carlo.run(Level(10), 50, 1, lambda z: Mute([z.mean()])).used == 50


def test_a_list_will_do_for_a_pair():
    found = gm.monte_carlo.run(Level(10), 50, 1, lambda z: [[z.mean()], [[0.1]]])
    same(found, gm.monte_carlo.run(Level(10), 50, 1, lambda z: (np.array([z.mean()]), [[0.1]])))


def test_an_estimator_that_ends_the_program_is_counted():
    def quits(z):
        sys.exit("no\nlicence")

    (failure,) = gm.monte_carlo.run(Level(10), 20, 1, quits).failures
    assert (failure.kind, failure.count) == ("raised SystemExit", 20)
    assert failure.gist == "SystemExit: no licence"


def test_the_verdict_says_what_failed_and_what_too_few_trials_cannot_tell():
    def moody(z):
        if z[0] > 3.5:
            raise ValueError("too far")
        return [z.mean()]

    partly = gm.monte_carlo.run(Level(10), 2000, 1, moody)
    # Those that fail are the high ones: the others are no fair sample.
    assert partly.verdict.startswith(
        f"BIASED SURVIVORS: {partly.failed} of 2000 trials failed, and the mean error of level"
    )
    for trials in (1, 2, 10):
        few = gm.monte_carlo.run(scene(), trials, 1)
        assert few.verdict.startswith("TOO FEW TRIALS: RMSE / bound of ")
    assert gm.monte_carlo.run(scene(), 100, 1).verdict.startswith("REACHES THE BOUND")


def test_a_covariance_that_is_none_is_counted():
    result = gm.monte_carlo.run(Level(4), 50, 1, lambda z: ([z.mean()], [[-1.0]]))
    (failure,) = result.failures
    assert failure.kind == "covariance not positive definite (no NEES)"
    assert failure.count == 50
    assert result.used == 50
    assert result.nees is None
    two = gm.Problem(np.eye(2), ["a", "b"])
    slanted = gm.monte_carlo.run(two, 50, 1, lambda z: (z, [[1.0, 0.5], [0.0, 1.0]]))
    (failure,) = slanted.failures
    assert failure.kind == "covariance not symmetric (no NEES)"
    assert (failure.count, slanted.used, slanted.nees) == (50, 50, None)


def test_quantities_are_averaged_and_checked():
    wanted = {"first": lambda z: z[0], "odd": lambda z: 1.0 if z[0] > 3 else np.inf}
    result = gm.monte_carlo.run(Level(10), 500, 1, mean, quantities=wanted, table=True)
    first = result.quantities["first"]
    np.testing.assert_allclose(first.mean, result.table["first"].mean(), rtol=1e-12)
    np.testing.assert_allclose(first.std, result.table["first"].std(ddof=1), rtol=1e-10)
    assert (first.low, first.high) == (result.table["first"].min(), result.table["first"].max())
    assert first.mean_interval[0] < 3 < first.mean_interval[1]
    (failure,) = result.failures
    assert failure.kind == "odd: not finite"
    assert failure.count + result.quantities["odd"].count == 500
    alone = gm.monte_carlo.run(Level(10), 500, 1, quantities={"first": lambda z: z[0]})
    assert alone.quantities["first"].mean == first.mean
    assert alone.estimator is None
    assert alone.failed == 0
    alone.plot()


def test_tables_go_to_pandas_arrow_and_parquet(tmp_path):
    import pyarrow.parquet as pq

    result = gm.monte_carlo.run(scene(), 100, 1, sometimes_fails, table=True)
    frame = result.to_pandas()
    assert list(frame.columns)[:3] == ["trial", "status", "error_x0"]
    assert len(frame) == 100
    result.to_parquet(tmp_path / "t.parquet")
    back = pq.read_table(tmp_path / "t.parquet")
    np.testing.assert_array_equal(back["error_vx"].to_numpy(), result.table["error_vx"])
    states = result.to_pandas("states")
    np.testing.assert_array_equal(states["rmse"], result.rmse)
    assert result.to_arrow("states").num_rows == 4
    lean = gm.monte_carlo.run(scene(), 100, 1, sometimes_fails)
    with pytest.raises(gm.InputError, match="run with table = True"):
        lean.to_pandas()


def test_an_unobservable_scene_has_no_built_in_estimate():
    flat = gm.Problem([[1.0, 1.0], [2.0, 2.0]], ["a", "b"])
    with pytest.raises(gm.UnobservableError, match=r"a \+1, b -1"):
        gm.monte_carlo.run(flat, 10, 1)
    own = gm.monte_carlo.run(flat, 10, 1, lambda z: [0.0, 0.0])
    assert np.isinf(own.bound).all()
    assert own.verdict.startswith("NOT OBSERVABLE")
    assert "not observable" in own.summary()
    own.plot()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trials": 0}, "trials = 0: must be >= 1"),
        ({"trials": -5}, "trials = -5: must be >= 1"),
        ({"trials": 2.5}, "trials = 2.5: must be a whole number"),
        ({"seed": -1}, "seed = -1: must be >= 0"),
        ({"seed": 2**64}, "must be <="),
        ({"workers": 0}, "workers = 0: must be >= 1"),
        ({"chunk": 48}, "chunk = 48: must be a power of two, 16 or more"),
        ({"estimator": "ml?"}, "estimator = 'ml\\?': the experiment's own are"),
        ({"estimator": 3}, "estimator is a int: must be a name or a function"),
        ({"estimator": None}, "estimator is missing: a Level has no built-in one"),
        ({"executor": "pool"}, "executor is a str: must be a concurrent.futures.Executor"),
        ({"quantities": ["no"]}, "quantities has 'no': the experiment's own are none"),
        ({"quantities": 5}, "quantities = 5: must be names"),
        ({"quantities": {5: len}}, "quantities has the name 5: must be a text"),
        ({"trials": True}, "trials = True: must be a whole number"),
        ({"quantities": {"q": 1}}, "quantities\\['q'\\] = 1: must be a function"),
        ({"quantities": {"nees": len}}, "quantities has 'nees': that is a column"),
        ({"problem": 3}, "problem is a int: must be a gramian.Problem, a"),
        ({"estimator": lambda z: [1.0], "workers": 2}, "cannot be sent to a worker process"),
    ],
)
def test_bad_input_is_named(change, message):
    given = {"problem": Level(10), "trials": 10, "seed": 1, "estimator": mean} | change
    with pytest.raises(gm.InputError, match=message):
        gm.monte_carlo.run(**given)


def test_an_executor_that_returns_something_else_is_named():
    class Idle(cf.Executor):
        def submit(self, function, /, *given, **named):
            done = cf.Future()
            done.set_result(None)
            return done

    with pytest.raises(gm.WorkerError, match="returned a NoneType for trials 0 to 15"):
        gm.monte_carlo.run(Level(10), 64, 1, mean, executor=Idle())


def test_an_executor_that_is_shut_down_is_refused():
    for pool in (cf.ThreadPoolExecutor(1), cf.ProcessPoolExecutor(1)):
        pool.shutdown()
        with pytest.raises(gm.InputError, match=r"executor takes no work .*shutdown"):
            gm.monte_carlo.run(Level(10), 10, 1, mean, executor=pool)
    with cf.ThreadPoolExecutor(1) as pool, pytest.raises(gm.InputError, match="both given"):
        gm.monte_carlo.run(Level(10), 10, 1, mean, executor=pool, workers=1)


def test_an_experiment_that_is_wrong_is_named():
    class Short(Level):
        def simulate(self, seed, first, trials):
            return super().simulate(seed, first, trials)[1:]

    with pytest.raises(gm.InputError, match="simulate returned 9 trials: must be 10"):
        gm.monte_carlo.run(Short(3), 10, 1, mean)

    class Crooked(Level):
        truth = np.zeros(2)

    with pytest.raises(gm.InputError, match=r"truth has shape \(2,\): must be \(1,\)"):
        gm.monte_carlo.run(Crooked(3), 10, 1, mean)

    class Broken(Level):
        def simulate(self, seed, first, trials):
            raise RuntimeError("no measurements today")

    with pytest.raises(RuntimeError, match="no measurements today"):
        gm.monte_carlo.run(Broken(3), 10, 1, mean)


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (None, "estimate returned a NoneType: must be Estimates"),
        (([[0.0, 0.0]] * 10, None, [0] * 10), r"errors \(10, 2\): must be \(10, 1\)"),
        (([[0.0]] * 10, [1.0], [0] * 10), r"nees \(1,\): must be \(10,\)"),
        (([[0.0]] * 10, None, [0]), r"status \(1,\): must be \(10,\)"),
        (([[0.0]] * 10, None, [70_000] * 10), "a status of 32768 or more"),
    ],
)
def test_an_estimator_of_ones_own_experiment_that_is_wrong_is_named(found, message):
    class Odd(Level):
        estimators = ("odd",)

        def estimate(self, name, seed, first, trials):
            return found and gm.monte_carlo.Estimates(*found, {})

    with pytest.raises(gm.InputError, match=message):
        gm.monte_carlo.run(Odd(3), 10, 1)


def test_a_function_of_ones_own_is_an_experiment():
    beacons = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
    model = gm.from_function(
        lambda p: np.hypot(*(beacons - p).T), [30.0, 40.0], 0.01, ["east", "north"]
    )
    experiment = gm.monte_carlo.Measurements(model)
    rows = experiment.problem().rows * 0.01
    exact = np.hypot(*(beacons - [30.0, 40.0]).T)
    gain = np.linalg.pinv(rows)
    result = gm.monte_carlo.run(experiment, 3000, 2, lambda z: [30, 40] + gain @ (z - exact))
    assert (abs(result.efficiency - 1) < 0.05).all()
    own = gm.monte_carlo.run(model, 300, 2)
    assert (abs(own.efficiency - 1) < 0.15).all()
    assert own.nees.consistent
    with pytest.raises(gm.InputError, match=r"of is a int: must be a model"):
        gm.monte_carlo.Measurements(5)
    with pytest.raises(gm.InputError, match="no x to be the truth"):
        gm.monte_carlo.run(gm.from_function(lambda p: p, None, 1.0, ["x"]), 10, 1)


def test_sweeps_set_the_bound_beside():
    swept = gm.monte_carlo.sweep(Level, {"samples": [4, 16], "sigma": [0.5, 1, 2]}, 2000, 1, mean)
    assert swept.values("bound", "level").shape == (2, 3)
    np.testing.assert_allclose(swept.values("bound", "level")[:, 1], [0.5, 0.25], rtol=1e-12)
    np.testing.assert_allclose(swept.values("efficiency"), 1, atol=0.06)
    assert len(swept.to_pandas()) == 6
    assert len(swept.summary().splitlines()) == 7
    swept.plot()
    line = gm.monte_carlo.sweep(Level(4), {"sigma": [0.5, 1.0]}, 500, 1, mean)
    np.testing.assert_allclose(np.diff(line.values("rmse", "level")), line.values("rmse")[0])
    line.plot()
    line.plot("efficiency")
    for call, message in [
        (lambda: gm.monte_carlo.sweep(Level(4), {"x": [1]}, 9, 1, mean), "fields are samples"),
        (lambda: gm.monte_carlo.sweep(Level, {}, 9, 1, mean), "must have one or two"),
        (lambda: gm.monte_carlo.sweep(Level, ["x"], 9, 1, mean), "is a list: must be a mapping"),
        (lambda: gm.monte_carlo.sweep(Level, {"sigma": []}, 9, 1, mean), "not empty"),
        (lambda: line.values("speed"), "the runs have no 'speed'"),
        (lambda: line.values("rmse", "x"), "no state is named 'x'"),
    ]:
        with pytest.raises(gm.InputError, match=message):
            call()


def test_a_run_on_a_terminal_shows_its_rate(monkeypatch):
    import io
    import sys

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    gm.monte_carlo.run(Level(10), 5000, 1, mean)
    assert "Monte Carlo" in shown.getvalue()
    assert "trials/s" in shown.getvalue()
    monkeypatch.setattr(sys, "stderr", quiet := io.StringIO())
    gm.monte_carlo.run(Level(10), 100, 1, mean)
    assert quiet.getvalue() == ""


def test_a_sweep_goes_through_a_point_where_nothing_is_observable():
    def turned(degrees):
        way = np.where(
            scene().times[:, None] < 300,
            [0.0, 1.0],
            [np.sin(np.radians(degrees)), np.cos(np.radians(degrees))],
        )
        path = 50 * np.vstack([[0, 0], np.cumsum(way[:-1], axis=0)])
        return gm.monte_carlo.Bearings(scene().times, path, scene().target, SIGMA)

    swept = gm.monte_carlo.sweep(turned, {"degrees": [0.0, 90.0]}, 500, 1)
    assert np.isinf(swept.values("bound")[0]).all()
    assert swept.values("failed").tolist() == [500, 0]
    assert swept.results[0].failures[0].kind == "unobservable"
    assert np.isnan(swept.values("rmse")[0]).all()
    assert "nan" not in swept.summary()
    swept.plot()
    swept.plot("bound")
    swept.plot("nees")
