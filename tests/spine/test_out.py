"""`out`: results go into the caller's array, with the same bits, and nothing else is written."""

import threading
import tracemalloc

import numpy as np
import pytest

import gramian as gm

TRIALS = 400
RNG = np.random.default_rng(3)
T = np.arange(30.0) * 10.0
BEARINGS = np.linspace(0.0, 1.0, 30) + 0.1 * RNG.normal(size=(TRIALS, 30))
PATHS = np.cumsum(RNG.normal(0.0, 40.0, (TRIALS, 30, 2)), axis=1)
FIXED, MOVING = [2000.0, 6000.0], [2000.0, 6000.0, 3.0, -1.0]
PLACES = RNG.normal(0.0, 5.0, (TRIALS, 3)) + np.array([0.0, 0.0, 30.0])
MOMENTS = RNG.normal(0.0, 50.0, (TRIALS, 3))
PASSES = (PLACES, RNG.normal(0.0, 1.0, (TRIALS, 3)), MOMENTS)
LOOKS = RNG.uniform(10e3, 50e3, (TRIALS, 12, 2)) + np.array([0.0, 1e3])
RADARS = ([[0.0, 0.0], [60e3, 0.0]], (50.0, 0.00175))
ROWS = RNG.normal(size=(TRIALS, 30, 4))
SYSTEMS = (RNG.normal(size=(TRIALS, 4, 4)), RNG.normal(size=(TRIALS, 2, 4)))
MANY = RNG.normal(size=(TRIALS, 30, 6))
SHIP = gm.tracks.Carrier([[0.0, 0.0], [900.0, 0.0], [900.0, 900.0]], [0.0, 150.0, 300.0])
SCENE = gm.tracks.Scene(
    gm.tracks.Motion.constant_velocity(),
    [
        gm.tracks.Sensor.bearing(SHIP, T, sigma=0.01),
        gm.tracks.Sensor.frequency(SHIP, T[::3], speed=1500.0, sigma=0.02),
    ],
)
STATES = np.array([*MOVING, 300.0]) + RNG.normal(size=(TRIALS, 5))

#: Each public function of batches that gives one array.
CALLS = {
    "gram": lambda **k: gm.gram(ROWS, **k),
    "gram with weights": lambda **k: gm.gram(MANY, np.arange(30.0), **k),
    "crlb_std": lambda **k: gm.crlb_std(ROWS, **k),
    "crlb_std of a prior": lambda **k: gm.crlb_std(ROWS, [1.0, 1.0, np.inf, 0.1], **k),
    "discriminant": lambda **k: gm.bearings.discriminant(T[:4], BEARINGS[:, :4], **k),
    "discriminant_sum": lambda **k: gm.bearings.discriminant_sum(T, BEARINGS, **k),
    "discriminant_sum qr": lambda **k: gm.bearings.discriminant_sum(T, BEARINGS, method="qr", **k),
    "bearings.gram": lambda **k: gm.bearings.gram(T, BEARINGS, **k),
    "bearings.rows": lambda **k: gm.bearings.rows(T, PATHS, MOVING, 0.01, **k),
    "bearings.rows of order 2": lambda **k: gm.bearings.rows(
        T, PATHS, [*MOVING, 0.0, 0.01], 0.01, **k
    ),
    "maneuver.fisher": lambda **k: gm.maneuver.fisher(PATHS, FIXED, 0.01, **k),
    "maneuver.fisher, moving": lambda **k: gm.maneuver.fisher(PATHS, MOVING, 0.01, T, **k),
    "maneuver.fisher_det": lambda **k: gm.maneuver.fisher_det(PATHS, MOVING, 0.01, T, **k),
    "maneuver.heading": lambda **k: gm.maneuver.heading(BEARINGS, 1000.0, 10.0, **k),
    "dipole.field": lambda **k: gm.dipole.field(PLACES, MOMENTS, **k),
    "dipole.rows": lambda **k: gm.dipole.rows(*PASSES, T, 1e-9, **k),
    "dipole.measure": lambda **k: gm.dipole.measure(*PASSES, T, **k),
    "dipole.measure, total field": lambda **k: gm.dipole.measure(
        *PASSES, T, sensors=[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ambient=[0.0, 2e-5, -4e-5], **k
    ),
    "dipole.fisher": lambda **k: gm.dipole.fisher(*PASSES, T, 1e-9, **k),
    "linear.observability_matrix": lambda **k: gm.linear.observability_matrix(*SYSTEMS, **k),
    "linear.gramian": lambda **k: gm.linear.gramian(*SYSTEMS, window=2.0, **k),
    "linear.gramian, discrete": lambda **k: gm.linear.gramian(*SYSTEMS, window=2.0, dt=0.5, **k),
    "linear.gramian with noise": lambda **k: gm.linear.gramian(
        *SYSTEMS, window=2.0, Q=np.eye(4), **k
    ),
    "tracks.rows": lambda **k: gm.tracks.rows(SCENE, STATES, **k),
    "registration.rows": lambda **k: gm.registration.rows(LOOKS, *RADARS, **k),
    "registration.fisher": lambda **k: gm.registration.fisher(LOOKS, *RADARS, **k),
    "registration.eta": lambda **k: gm.registration.eta(LOOKS, *RADARS, **k),
    "registration.degree": lambda **k: gm.registration.degree(LOOKS, *RADARS, **k),
    "registration.degree of pairs": lambda **k: gm.registration.degree(
        LOOKS, *RADARS, method="pair", **k
    ),
}
#: Those that give several, as views of one.
VIEWS = {
    "bearings.gram_det": (lambda **k: gm.bearings.gram_det(T, BEARINGS, **k), (17,)),
    "maneuver.fisher_and_det": (
        lambda **k: gm.maneuver.fisher_and_det(PATHS, FIXED, 0.01, **k),
        (5,),
    ),
    "maneuver.fisher_and_det, moving": (
        lambda **k: gm.maneuver.fisher_and_det(PATHS, MOVING, 0.01, T, **k),
        (17,),
    ),
    "dipole.jacobian": (lambda **k: gm.dipole.jacobian(PLACES, MOMENTS, **k), (2, 3, 3)),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_the_array_itself_is_returned_with_the_same_bits(call):
    wanted = call()
    out = np.full(wanted.shape, 7.0)
    assert call(out=out) is out
    assert out.tobytes() == wanted.tobytes()


@pytest.mark.parametrize(("call", "core"), VIEWS.values(), ids=VIEWS)
def test_several_results_are_views_of_the_array(call, core):
    wanted = call()
    out = np.full((TRIALS, *core), np.nan)
    for found, one in zip(call(out=out), wanted, strict=True):
        assert np.shares_memory(found, out)
        assert found.tobytes() == one.tobytes()
    assert np.isfinite(out).all()


def test_one_trial_goes_into_an_array_without_axes():
    out = np.zeros(())
    assert gm.bearings.discriminant(T[:4], BEARINGS[0, :4], out=out) is out
    assert out == gm.bearings.discriminant(T[:4], BEARINGS[0, :4])
    assert gm.maneuver.heading(0.3, 1000.0, 10.0, out=out) is out
    assert out == gm.maneuver.heading(0.3, 1000.0, 10.0)
    out = np.zeros((4, 4))
    assert gm.gram(ROWS[0], out=out) is out
    assert (out == gm.gram(ROWS[0])).all()


def test_a_long_sum_and_a_large_gram_matrix_go_there_too():
    """The ways that take one trial in pieces."""
    t = np.arange(200.0)
    b = np.linspace(0.0, 1.0, 200) ** 2
    out = np.zeros(())
    assert gm.bearings.discriminant_sum(t, b, out=out) is out
    assert out == gm.bearings.discriminant_sum(t, b)
    rows = RNG.normal(size=(300, 620))
    out = np.empty((620, 620))
    assert gm.gram(rows, out=out) is out
    assert out.tobytes() == gm.gram(rows).tobytes()
    std = np.empty(620)
    wide = RNG.normal(size=(640, 620))
    assert gm.crlb_std(wide, out=std) is std
    assert std.tobytes() == gm.crlb_std(wide).tobytes()


def read_only():
    array = np.zeros((TRIALS, 4, 4))
    array.flags.writeable = False
    return array


def misaligned():
    return np.zeros(TRIALS * 128 + 1, np.uint8)[1:].view(np.float64).reshape(TRIALS, 4, 4)


class Own(np.ndarray):
    pass


@pytest.mark.parametrize(
    ("out", "given"),
    [
        (np.zeros((TRIALS, 4, 5)), rf"out is of float64, shape \({TRIALS}, 4, 5\), C-contiguous: "),
        (np.zeros((4, 4)), r"out is of float64, shape \(4, 4\), C-contiguous: "),
        (np.zeros((1, TRIALS, 4, 4)), rf"shape \(1, {TRIALS}, 4, 4\), C-contiguous: "),
        (np.zeros((TRIALS, 4, 4), np.float32), "out is of float32, .*: "),
        (np.zeros((TRIALS, 4, 4), np.int64), "out is of int64, .*: "),
        (np.zeros((TRIALS, 4, 4), ">f8"), "out is of >f8, .*: "),
        (np.zeros((4, 4, TRIALS)).T, "not C-contiguous: "),
        (np.zeros((2 * TRIALS, 4, 4))[::2], "not C-contiguous: "),
        (np.broadcast_to(0.0, (TRIALS, 4, 4)), "not C-contiguous, read-only: "),
        (read_only(), "C-contiguous, read-only: "),
        (misaligned(), "not aligned: "),
        (np.ma.zeros((TRIALS, 4, 4)), r"out is a numpy\.ma\.MaskedArray: "),
        (np.zeros((TRIALS, 4, 4)).view(Own), r"out is a .*Own: "),
        ([[0.0] * 4] * 4, "out is a list: "),
        (1.0, "out is a float: "),
    ],
)
def test_what_cannot_take_the_results_is_refused(out, given):
    wanted = (
        rf"must be a numpy\.ndarray of float64, shape \({TRIALS}, 4, 4\), C-contiguous and writable"
    )
    before = np.array(out)
    with pytest.raises(gm.InputError, match=given + wanted):
        gm.gram(ROWS, out=out)
    assert (np.asarray(out) == before).all()


def test_a_single_result_refuses_an_array_with_axes():
    with pytest.raises(gm.InputError, match=r"shape \(1,\), C-contiguous: .* shape \(\), "):
        gm.maneuver.heading(0.3, 1000.0, 10.0, out=np.zeros(1))


def test_what_cannot_go_into_an_array_says_so():
    out = np.zeros(4)
    with pytest.raises(gm.InputError, match="out goes with plain rows"):
        gm.crlb_std(gm.Problem(ROWS[0], ["x", "y", "vx", "vy"]), out=out)
    with pytest.raises(gm.InputError, match="out goes without exact knowledge"):
        gm.crlb_std(ROWS[0], [0.0, 1.0, 1.0, 1.0], out=out)
    with pytest.raises(gm.InputError, match="out goes without detection"):
        gm.bearings.rows(T, PATHS, MOVING, 0.01, detection=0.5, out=np.zeros((TRIALS, 30, 4)))


@pytest.mark.parametrize("trials", [3, 4000])
@pytest.mark.parametrize("shift", [-5, 0, 2])
def test_an_array_that_shares_memory_with_an_argument(trials, shift):
    """Few numbers are copied anyway, many are read in place otherwise."""
    memory = np.random.default_rng(5).normal(10.0, 1.0, 3 * trials + 10)
    place = memory[5 : 5 + 3 * trials].reshape(trials, 3)
    out = memory[5 + shift : 5 + shift + 3 * trials].reshape(trials, 3)
    wanted = gm.dipole.field(place.copy(), MOMENTS[0])
    assert gm.dipole.field(place, MOMENTS[0], out=out) is out
    assert out.tobytes() == wanted.tobytes()


def test_memory_is_shared_by_arrays_that_numpy_does_not_connect():
    memory = bytearray(24 * 4001)
    place = np.frombuffer(memory)[:-3].reshape(4000, 3)
    out = np.frombuffer(memory)[3:].reshape(4000, 3)
    place[:] = np.random.default_rng(6).normal(10.0, 1.0, place.shape)
    wanted = gm.dipole.field(place.copy(), MOMENTS[0])
    assert gm.dipole.field(place, MOMENTS[0], out=out).tobytes() == wanted.tobytes()


def test_no_memory_of_the_size_of_the_result_is_asked_for():
    path = np.cumsum(np.random.default_rng(7).normal(0.0, 40.0, (10_000, 10, 2)), axis=1)
    out = np.empty((10_000, 2, 2))

    def peak(**more):
        tracemalloc.start()
        try:
            gm.maneuver.fisher(path, FIXED, 0.01, **more)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak() > out.nbytes
    assert peak(out=out) < out.nbytes / 20


def test_results_in_it_do_not_depend_on_threads():
    path = np.cumsum(np.random.default_rng(8).normal(0.0, 40.0, (20_000, 30, 2)), axis=1)
    found = []
    before = gm.set_threads(1)
    try:
        for threads in (1, 2, 5):
            gm.set_threads(threads)
            out = np.zeros((20_000, 2, 2))
            found.append(gm.maneuver.fisher(path, FIXED, 0.01, out=out).tobytes())
    finally:
        gm.set_threads(before)
    assert len(set(found)) == 1


def test_threads_of_the_caller_have_an_array_each():
    outs = [np.zeros((TRIALS, 4, 4)) for _ in range(4)]
    wanted = gm.gram(ROWS)

    def work(out):
        for _ in range(50):
            gm.gram(ROWS, out=out)

    threads = [threading.Thread(target=work, args=(out,)) for out in outs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(out.tobytes() == wanted.tobytes() for out in outs)


def test_an_error_is_that_of_the_call_without_it():
    bad = PATHS.copy()
    bad[7, 3, 1] = np.nan
    with pytest.raises(gm.InputError) as without:
        gm.maneuver.fisher(bad, FIXED, 0.01)
    with pytest.raises(gm.InputError) as within:
        gm.maneuver.fisher(bad, FIXED, 0.01, out=np.zeros((TRIALS, 2, 2)))
    assert str(within.value) == str(without.value)
    assert "[7, 3, 1]" in str(within.value)
