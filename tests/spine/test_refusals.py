"""What cannot be used is refused: the error names what was given, what is wanted and where."""

import numpy as np
import pytest

import gramian as gm

TIMES = np.arange(0.0, 300.0, 15.0)
PATH = np.stack([np.maximum(0, 5 * (TIMES - 150)), np.minimum(5 * TIMES, 750)], axis=1)
STATE = np.array([2000.0, 6000.0, 3.0, -1.0])
SEEN = gm.bearings.simulate(TIMES, PATH, STATE, 1e-3, seed=1)
HIDDEN = np.ma.masked_array(SEEN, mask=TIMES == 45.0)
PASS = ([-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0])
SENSORS = [[0.0, 0.0], [60e3, 0.0]]


FOUR_TIMES = [0.0, 10.0, 20.0, 30.0]
FOUR_PLACES = [[0.0, 0.0], [0.0, 50.0], [30.0, 90.0], [60.0, 120.0]]
NORTH = [0.0, 1000.0, 3.0, -1.0]


def changed(array, index, value):
    array = np.array(array, dtype=float)
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: gm.gram(changed(np.ones((2, 3, 4)), (1, 2, 3), np.nan)), r"rows\[1, 2, 3\] = nan"),
        (lambda: gm.gram(changed(np.ones((3, 4)), (0, 1), -np.inf)), r"rows\[0, 1\] = -inf"),
        (lambda: gm.gram([1.0, 2.0]), r"rows has shape \(2,\): must have at least 2 axes"),
        (lambda: gm.gram(np.ones((0, 4))), r"rows has shape \(0, 4\): must not be empty"),
        (lambda: gm.gram([["a", "b"]]), "rows cannot be read as an array of numbers"),
        (lambda: gm.gram([[1.0, 2.0], [3.0]]), "rows cannot be read as an array of numbers"),
        (lambda: gm.gram([[1.0 + 1j]]), "rows cannot be read.*complex"),
        (lambda: gm.gram(np.ones((3, 4)), [1.0, 2.0]), r"weights has shape \(2,\): must be"),
        (lambda: gm.gram(np.ones((2, 4)), [1.0, -2.0]), r"weights\[1\] = -2: must be >= 0"),
        (lambda: gm.crlb_std(np.ones((3, 0))), "must not be empty"),
        (lambda: gm.crlb_std(np.ones((3, 2)), prior=[1.0, -1.0]), r"prior\[1\] = -1"),
        (lambda: gm.crlb_std(np.ones((3, 2)), prior={"x": 1.0}), "there are x0, x1"),
        (lambda: gm.analyze(np.ones(3)), r"rows has shape \(3,\)"),
        (lambda: gm.analyze([[1.0, np.nan]]), r"rows\[0, 1\] = nan"),
        (lambda: gm.analyze([[1.0, 2.0]], names=["x"]), r"rows has shape \(1, 2\)"),
        (lambda: gm.analyze([[1.0, 2.0]], names=["x", "x"]), "taken by another state"),
        (lambda: gm.analyze([[1.0, 2.0]], names="xy"), "must be a sequence"),
        (lambda: gm.analyze([[1.0, 2.0]], scale=[1.0, 0.0]), "scale of x1 = 0.0: must be > 0"),
        (lambda: gm.analyze([[1.0, 2.0]], scale={"z": 1.0}), "no state is named 'z'"),
        (lambda: gm.analyze([[1.0, 2.0]], prior={"z": 1.0}), "prior of 'z': no state has that name"),
        (lambda: gm.analyze([[1.0, 2.0]], prior={"x0": -1.0}), "prior of x0 = -1.0: must be >= 0"),
        (lambda: gm.analyze([[1.0, 2.0]], weak_ratio=0), r"weak_ratio = 0\.0: must be > 0"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"]).fix("c"), "the states are a, b"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"]).fix("a", "b"), "at least one must be left"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"], units=["m"]), "units has 1 entries"),
        (lambda: gm.Problem([[1.0]], ["a"], rtol=2.0), "rtol = 2.0"),
        (
            lambda: gm.Problem([[1.0, 2.0]], ["a", "b"], combinations={"a": [1, 0]}),
            "that is a state's name",
        ),
        (
            lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES, NORTH, 0.0),
            r"sigma\[0\] = 0 rad: must be > 0",
        ),
        (
            lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES, NORTH, [0.1, 0.1, -0.1, 0.1]),
            r"sigma\[2\] = -0.1 rad: must be > 0",
        ),
        (lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES, NORTH, [0.1, 0.1]), r"sigma has shape \(2,\)"),
        (
            lambda: gm.bearings.rows([0.0, 10.0, 10.0, 30.0], FOUR_PLACES, NORTH, 0.1),
            r"times\[2\] = 10 s: must be later than the one before, 10 s",
        ),
        (lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES[:3], NORTH, 0.1), r"observer has shape \(3, 2\)"),
        (lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES, [1.0, 2.0, 3.0], 0.1), "target has shape"),
        (
            lambda: gm.bearings.rows(FOUR_TIMES, FOUR_PLACES, [0.0, 50.0, 0.0, 0.0], 0.1),
            r"observer\[1\] is at the target",
        ),
        (
            lambda: gm.bearings.rows(
                FOUR_TIMES, FOUR_PLACES, [NORTH, NORTH, [30.0, 90.0, 0.0, 0.0]], 0.1
            ),
            r"at batch index \[2\]: observer\[2\]",
        ),
        (
            lambda: gm.bearings.rows(FOUR_TIMES, np.ones((3, 4, 2)), np.ones((2, 4)), 0.1),
            "leading axes do not match",
        ),
        (
            lambda: gm.bearings.rows(changed(FOUR_TIMES, 1, np.inf), FOUR_PLACES, NORTH, 0.1),
            r"times\[1\] = inf: must be finite",
        ),
        (lambda: gm.bearings.rows([], np.ones((0, 2)), NORTH, 0.1), "must not be empty"),
        (lambda: gm.bearings.simulate(FOUR_TIMES, FOUR_PLACES, NORTH, 0.1, seed=-1), "seed = -1"),
        (lambda: gm.bearings.simulate(FOUR_TIMES, FOUR_PLACES, NORTH, 0.1, 1, trials=0), "trials = 0"),
        (
            lambda: gm.from_function(lambda x: [np.nan], [1.0], 1.0, ["x"]),
            r"h\(x\)\[0\] = nan: must be finite",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0], -1.0, ["x"]),
            "sigma = -1.0: must be > 0",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0, 2.0], -np.eye(2), ["x", "y"]),
            r"sigma\[0, 0\] = -1.0: a variance must be >= 0",
        ),
        (
            lambda: gm.from_function(abs, [1.0], 1.0, ["x"], method="complex"),
            "returns real numbers",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0], 1.0, ["x"], method="given"),
            "jacobian missing",
        ),
        (lambda: gm.bearings.localize_many(TIMES, SEEN + 0j, PATH, 1e-3), "bearings cannot be read.*co"),
        (
            lambda: gm.bounds.expected_transition(np.ones((3, 2, 2)), np.eye(3)),
            r"process_noise has shape \(3, 3\).*must be \(2, 2\)",
        ),
        (lambda: gm.io.read("x.csv", columns={"time": 3}), "columns of time = 3: must be a string"),
        (
            lambda: gm.dipole.localize(TIMES, np.ones((TIMES.size, 3)), correlation=np.ones(2)),
            r"correlation has shape \(2,\)",
        ),
        (
            lambda: gm.estimate(gm.from_function(lambda x: x, [1.0], 1.0, ["x"]), [np.nan]),
            r"measurements: all are NaN \(missing\)",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0], [[1.0], [1.0, 2.0]], ["x"]),
            "sigma.*inhomogeneous",
        ),
        (lambda: gm.bearings.rows(TIMES, PATH + 1j, STATE, 1e-3), "observer cannot be read.*compl"),
        (lambda: gm.bearings.rows(TIMES, PATH, STATE, "big"), "sigma cannot be read"),
        (lambda: gm.bearings.residuals(TIMES, [None] * 20, PATH, STATE), "bearings.*None"),
        (
            lambda: gm.bearings.residuals(TIMES, SEEN[:-1], PATH, STATE),
            r"bearings \(19,\).*must be \(\.\.\., m\)",
        ),
        (lambda: gm.bearings.residuals(TIMES, SEEN, PATH, np.nan), "state = nan: must be finite"),
        (lambda: gm.bearings.simulate(TIMES, PATH, STATE, 1e-3, seed=2**64), "seed = .*<= 1844674"),
        (lambda: gm.bearings.simulate(TIMES, PATH, STATE, 1e-3, seed=1.5), "seed = 1.5.*whole"),
        (lambda: gm.maneuver.plan([0, 500], [0, 0], 40.0, 1.0, 5, seed=-1), "seed = -1: must be"),
        (
            lambda: gm.maneuver.closed_loop(
                [0, 500], [0, 0], 4.0, 1.0, 5, sigma=0.1, first_range=(500, 9), replan=np.nan
            ),
            "replan = nan: must be a whole",
        ),
        (lambda: gm.dipole.equivalents([np.nan, 1, 2], *PASS[1:], 2.0), r"r0\[0\] = nan"),
        (lambda: gm.dipole.equivalents(*PASS[:2], 3.0, 2.0), r"m has shape \(\): must be"),
        (
            lambda: gm.dipole.moment(PASS[2], np.eye(3), np.nan, PASS[0]),
            "induced_volume = nan: must be finite",
        ),
        (lambda: gm.inertial.gravity(np.nan), "latitude = nan: must be finite"),
        (lambda: gm.inertial.radii(np.inf), "latitude = inf: must be finite"),
        (lambda: gm.inertial.rotation(0.1, np.nan), "pitch = nan: must be finite"),
        (lambda: gm.inertial.static_base(0.5, earth_rate=np.nan), "earth_rate = nan"),
        (lambda: gm.bounds.cubature_points([0.0, np.nan], np.eye(2)), r"mean\[1\] = nan"),
        (lambda: gm.bounds.expected_rows(np.full((2, 1, 2), np.nan)), r"rows\[0, 0, 0\] = nan"),
        (
            lambda: gm.bounds.expected_transition(np.full((2, 2, 2), np.inf), np.eye(2)),
            r"transitions\[0, 0, 0\] = inf",
        ),
        (
            lambda: gm.linear.piecewise(np.zeros((2, 2, 2)), np.ones((2, 1, 2)), np.ones((0, 2))),
            "durations",
        ),
        (
            lambda: gm.linear.rows([[0, 1], [0, 0]], [[1, 0]], window=1e308, dt=1.0),
            "more samples than can be counted",
        ),
        (
            lambda: gm.linear.rows([[0, 1], [0, 0]], [[1, 0]], window=1e9, dt=1.0),
            "1000000001 samples, more than 10000000: sample less",
        ),
        (
            lambda: gm.dipole.localize(
                np.arange(21.0),
                1e180 * gm.dipole.simulate(*PASS, np.arange(21.0), 1e-9, 1),
                {"z": 5.0, "vz": 0.0},
                sigma=1e-9,
            ),
            "the field reaches .* T: must be in tesla",
        ),
        (
            lambda: gm.registration.singular_tracks([[0.0, np.nan], [6e4, 0.0]]),
            r"sensors\[0, 1\] = nan",
        ),
        (
            lambda: gm.registration.check_track([[0.0, 1e4]], SENSORS, tolerance=np.nan),
            "tolerance = nan",
        ),
        (
            lambda: gm.registration.match(
                {"A": ([0.0], [[1e3, 0.1]]), "B": ([9.0], [[1e3, 0.1]])}, tolerance=np.nan
            ),
            "tolerance = nan",
        ),
        (
            lambda: gm.registration.degree(1.0, SENSORS, (50.0, 1e-3), method="paper"),
            "lag = 1",
        ),
        (lambda: gm.dipole.localize_many(np.arange(9.0), 1.0, {"z": 1.0}), r"field has shape \(\)"),
        (lambda: gm.monte_carlo.normals(-1, 0, 1, 1), "seed = -1: must be >= 0"),
        (
            lambda: gm.monte_carlo.Bearings(TIMES, PATH + 1j, STATE, 1e-3),
            "observer cannot be read.*complex",
        ),
        (lambda: gm.inertial.gravity(0.5, 1e308), "height = 1e\\+308"),
        (
            lambda: gm.inertial.segments([gm.inertial.Leg(10.0, 1e20)], 0.5),
            r"legs\[0\] makes 1.91e\+21 segments",
        ),
        (lambda: gm.inertial.segments([gm.inertial.Leg(1e20, 1.0)], 0.5), "more than 10000"),
        (
            lambda: gm.linear.information(
                np.eye(2), np.eye(2), window=2.0, dt=1.0, prior=[1.0, 1e200]
            ),
            "prior goes from 1 to 1e",
        ),
        (
            lambda: gm.linear.gramian(
                np.eye(2), np.eye(2), window=2.0, dt=1.0, Q=np.diag([1.0, np.inf])
            ),
            r"Q\[1, 1\] = inf",
        ),
    ],
)  # fmt: skip
def test_an_error_names_the_fault(call, message):
    with pytest.raises(gm.InputError, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "call",
    [
        lambda: gm.bearings.localize_many(TIMES, HIDDEN, PATH, 1e-3),
        lambda: gm.bearings.observability_test(TIMES, HIDDEN, 1e-3),
        lambda: gm.bearings.discriminant_sum(TIMES, HIDDEN),
        lambda: gm.bearings.gram(TIMES, HIDDEN),
        lambda: gm.bearings.residuals(TIMES, HIDDEN, PATH, STATE),
        lambda: gm.bearings.rows(TIMES, PATH, STATE, 1e-3, detection=0.5 + 0 * HIDDEN),
        lambda: gm.gram(np.ma.masked_equal(np.eye(3), 1.0)),
        lambda: gm.analyze(np.ma.masked_equal(np.eye(3), 1.0)),
        lambda: gm.linear.levels(np.ma.masked_equal(np.eye(3), 1.0), np.eye(3)),
        lambda: gm.bounds.expected_rows(np.ma.masked_equal(np.ones((2, 1, 3)), 1.0)),
        lambda: gm.registration.fisher(
            np.ma.masked_equal([[1e3, 2e4], [3e3, 2e4]], 1e3), SENSORS, (50.0, 1e-3)
        ),
    ],
)
def test_masked_entries_are_refused(call):
    with pytest.raises(gm.InputError, match=r"has \d+ masked entr.*: drop or fill"):
        call()


def packed(array):
    """A view at an odd address, as the fields of packed records are."""
    return np.frombuffer(b"\0" + np.asarray(array, dtype=float).tobytes(), offset=1).reshape(
        np.shape(array)
    )


@pytest.mark.parametrize("kept", [packed, np.asfortranarray, lambda a: a.astype(">f8")])
def test_how_memory_is_laid_out_changes_nothing(kept):
    one = gm.bearings.rows(kept(TIMES), kept(PATH), kept(STATE), 1e-3)
    assert np.array_equal(one, gm.bearings.rows(TIMES, PATH, STATE, 1e-3))
    assert gm.bearings.gram(kept(TIMES), kept(SEEN)).sum() == gm.bearings.gram(TIMES, SEEN).sum()
    assert np.array_equal(gm.gram(kept(one)), gm.gram(one))


def test_a_mask_that_hides_nothing_is_fine():
    open_ = np.ma.masked_array(SEEN, mask=False)
    one = gm.bearings.localize_many(TIMES, open_, PATH, 1e-3)
    assert np.array_equal(one.state, gm.bearings.localize_many(TIMES, SEEN, PATH, 1e-3).state)


@pytest.mark.parametrize("step", [0.1, 1.0, 15.3])
def test_times_counted_from_1970_do_not_make_a_track_observable(step):
    """Their rounding, 2e-7 s, looks like a maneuver far above that of the rows."""
    since = step * np.arange(100)
    path = np.stack([0 * since, 5 * since], axis=1)
    target, sigma = [2000.0, 8000.0, 3.0, -1.0], np.radians(0.5)
    seen = np.arctan2(2000 + 3 * since, 8000 - 6 * since)
    monitor = gm.bearings.Monitor()
    for t, b in zip(1.7e9 + since, seen, strict=True):
        said = monitor.push(t, b, sigma, 8000.0)
    assert said.rank == 3
    assert np.isinf(said.crlb_std).all()
    answer = gm.analyze(gm.bearings.problem(1.7e9 + since, path, target, sigma))
    assert answer.status == "unobservable"
    assert np.isinf(answer.crlb_std).all()
    for localize in (gm.bearings.localize, gm.bearings.localize_many):
        assert localize(1.7e9 + since, seen, path, sigma).status == "unobservable"


def test_times_counted_from_1970_leave_a_maneuver_as_it_is():
    early = gm.analyze(gm.bearings.problem(TIMES, PATH, STATE, 1e-3))
    late = gm.analyze(gm.bearings.problem(1.7e9 + TIMES, PATH, STATE, 1e-3))
    assert late.status == early.status == "observable"
    np.testing.assert_allclose(late.crlb_std, early.crlb_std, rtol=1e-12)


@pytest.mark.parametrize("size", [1e-300, 1e-170, 1e160, 1e200])
def test_rows_whose_squares_cannot_be_held_are_refused(size):
    """At 1e-170 the squares vanish: the bound would be 0, the rank 0; at 1e160 they overflow."""
    rows = size * (np.eye(3) + np.ones((3, 3)))
    for call in (gm.crlb_std, gm.crlb, gm.analyze):
        with pytest.raises(gm.InputError, match="choose other units"):
            call(rows)
    with pytest.raises(gm.InputError, match="choose other units"):
        gm.linear.degree([[0, 1], [0, 0]], [[size, 0]], method="eigenvalue")


def test_rank_tolerances_outside_0_and_1_are_refused():
    for rtol in (np.nan, 0.0, 1.0, -1.0):
        with pytest.raises(gm.InputError, match=r"rtol = .*must be between 0 and 1"):
            gm.analyze(np.eye(2), rtol=rtol)


def test_a_batch_of_no_trials_has_an_empty_answer():
    positions = np.stack([np.linspace(-2e4, 6e4, 30), np.full(30, 2.5e4)], axis=1)
    sigma = (50.0, 1e-3)
    none = np.zeros((0, 30, 2))
    assert gm.registration.fisher(none, SENSORS, sigma).shape == (0, 4, 4)
    assert gm.registration.rows(none, SENSORS, sigma).shape == (0, 60, 4)
    assert gm.registration.eta(none, SENSORS, sigma).shape == (0,)
    reports = np.zeros((0, 30, 2, 2))
    found = gm.registration.estimate(reports, SENSORS, sigma, on_failure="report")
    assert found.biases.shape == (0, 4)
    assert gm.registration.fisher(positions, SENSORS, sigma).shape == (4, 4)
    bound = gm.bounds.posterior(np.zeros((0, 6, 2, 3)), np.eye(3), np.eye(3), np.eye(3))
    assert bound.std.shape == (0, 6, 3)
    many = gm.dipole.localize_many(
        np.arange(21.0), np.zeros((0, 21, 3)), {"z": 5.0, "vz": 0.0}, sigma=1e-9
    )
    assert many.states.shape == (0, 9)


def test_results_beyond_double_precision_are_refused():
    times, bearings = np.arange(6) * 1e80, np.array([0, 0.1, 0.3, 0.4, 0.2, 0.6])
    both = np.stack([times * 1e-80, times])
    b = gm.bearings
    for call in (
        lambda: b.discriminant(both[:, :4] * 1e80, bearings[:4]),
        lambda: b.discriminant_sum(both, bearings),
        lambda: b.gram(both * 1e80, bearings),
        lambda: b.gram_det(both, bearings),
    ):
        with pytest.raises(gm.InputError, match=r"overflows.*choose other units"):
            call()
    # The determinant of this one overflows, the matrix does not.
    assert np.isfinite(b.gram(both, bearings)).all()
    with pytest.raises(gm.InputError, match=r"\[1\]: the sum of squares"):
        b.discriminant_sum(both, bearings)
    assert b.discriminant_sum(both[0], bearings) > 0


@pytest.mark.parametrize(
    "call",
    [
        lambda: gm.gram(np.full((3, 2), 1e200)),
        lambda: gm.gram(np.ones((3, 2)), np.full(3, 1e308)),
        lambda: gm.bearings.rows(TIMES, PATH, [1e308, 1e308, 1e308, 1.0], 1e-3),
        lambda: gm.bearings.problem(TIMES, PATH, STATE, 1e-320),
        lambda: gm.maneuver.fisher(PATH, STATE[:2], 1e-308),
        lambda: gm.maneuver.fisher(PATH, [*STATE[:2], 1e308, 1e308], 1e-3, TIMES),
        lambda: gm.maneuver.fisher_det(PATH, STATE[:2], 1e-200),
        lambda: gm.dipole.fisher([1, 2, 3], [1e200, 0, 0], [1, 1, 1], np.arange(9.0), 1e-9),
        lambda: gm.dipole.fisher([1, 2, 3], [1, 0, 0], [1, 1, 1], np.arange(9.0), 1e-200),
        lambda: gm.registration.fisher([[1e3, 2e4]], SENSORS, (1e-200, 1e-200)),
        lambda: gm.registration.fisher([[1e3, 2e4]], [*SENSORS, [0, 5e4]], (1e-200, 1e-3)),
        lambda: gm.bounds.posterior(np.full((5, 2, 2), 1e200), np.eye(2), np.eye(2), np.eye(2)),
        lambda: gm.bounds.posterior(
            np.ones((5, 1, 2)), 1e200 * np.eye(2), np.eye(2), np.eye(2)
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_held_is_refused_never_inf_or_nan(call):
    with np.errstate(all="ignore"), pytest.raises(gm.InputError, match="choose other units"):
        call()


@pytest.mark.parametrize("given", ["1", None, [1.0], [1.0, 2.0], np.array([1.0]), 1j])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("window", lambda x: gm.linear.gramian(np.eye(2), np.eye(2), window=x)),
        ("dt", lambda x: gm.linear.rows(np.eye(2), np.eye(2), window=2.0, dt=x)),
        ("latitude", gm.inertial.static_base),
        ("tilt", lambda x: gm.inertial.static_base(0.5, tilt=x)),
        ("turn", lambda x: gm.inertial.segments([gm.inertial.Leg(10.0, x)], 0.5)),
        ("weak_ratio", lambda x: gm.analyze(np.eye(2), weak_ratio=x)),
        ("dt", lambda x: gm.maneuver.plan([0, 1e3], [0, 0], 20.0, x, 5)),
        ("sigma", lambda x: gm.dipole.simulate([1, 2, 3], [1, 0, 0], [1, 1, 1], TIMES, x, 1)),
    ],
)
def test_one_number_is_one_number(name, call, given):
    with pytest.raises(gm.InputError, match=name):
        call(given)


def test_interrupt_stops_a_long_call():
    """A kernel of many seconds hears Ctrl-C between its pieces."""
    import subprocess
    import sys
    import textwrap

    code = """
        import signal, threading, time, os
        import numpy as np, gramian as gm
        gm.set_threads(1)
        rows = np.broadcast_to(np.ones((500, 12)), (200, 500, 12))
        rows = np.repeat(rows, 20, axis=0)
        threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        try:
            for _ in range(10_000):
                gm.crlb_std(rows)
        except KeyboardInterrupt:
            print("stopped")
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,  # of an hour without
    )
    assert done.stdout.strip() == "stopped", done.stderr
