"""Bad input: each error names what was given, what is wanted and where."""

import numpy as np
import pytest

import gramian as gm

TIMES = [0.0, 10.0, 20.0, 30.0]
PATH = [[0.0, 0.0], [0.0, 50.0], [30.0, 90.0], [60.0, 120.0]]
STATE = [0.0, 1000.0, 3.0, -1.0]


def changed(array, index, value):
    array = np.array(array, dtype=float)
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: gm.gram(changed(np.ones((2, 3, 4)), (1, 2, 3), np.nan)), r"rows\[1, 2, 3\] = NaN"),
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
        (lambda: gm.crlb_std(np.ones((3, 2)), prior={"x": 1.0}), "as an array"),
        (lambda: gm.analyze(np.ones(3)), r"rows has shape \(3,\)"),
        (lambda: gm.analyze([[1.0, np.nan]]), r"rows\[0, 1\] = nan"),
        (lambda: gm.analyze([[1.0, 2.0]], names=["x"]), r"rows has shape \(1, 2\)"),
        (lambda: gm.analyze([[1.0, 2.0]], names=["x", "x"]), "taken by another state"),
        (lambda: gm.analyze([[1.0, 2.0]], names="xy"), "must be a sequence"),
        (lambda: gm.analyze([[1.0, 2.0]], scale=[1.0, 0.0]), "scale of x1 = 0.0: must be > 0"),
        (lambda: gm.analyze([[1.0, 2.0]], scale={"z": 1.0}), "no state is named 'z'"),
        (lambda: gm.analyze([[1.0, 2.0]], prior={"z": 1.0}), "no state is named 'z'"),
        (lambda: gm.analyze([[1.0, 2.0]], prior={"x0": 0.0}), "prior of x0 = 0.0: must be > 0"),
        (lambda: gm.analyze([[1.0, 2.0]], weak_ratio=0), "weak_ratio = 0: must be > 0"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"]).fix("c"), "the states are a, b"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"]).fix("a", "b"), "at least one must be left"),
        (lambda: gm.Problem([[1.0, 2.0]], ["a", "b"], units=["m"]), "units has 1 entries"),
        (lambda: gm.Problem([[1.0]], ["a"], rtol=2.0), "rtol = 2.0"),
        (
            lambda: gm.Problem([[1.0, 2.0]], ["a", "b"], combinations={"a": [1, 0]}),
            "that is a state's name",
        ),
        (
            lambda: gm.bearings.rows(TIMES, PATH, STATE, 0.0),
            r"sigma\[0\] = 0 rad: must be > 0",
        ),
        (
            lambda: gm.bearings.rows(TIMES, PATH, STATE, [0.1, 0.1, -0.1, 0.1]),
            r"sigma\[2\] = -0.1 rad: must be > 0",
        ),
        (lambda: gm.bearings.rows(TIMES, PATH, STATE, [0.1, 0.1]), r"sigma has shape \(2,\)"),
        (
            lambda: gm.bearings.rows([0.0, 10.0, 10.0, 30.0], PATH, STATE, 0.1),
            r"times\[2\] = 10 s: must be later than the one before, 10 s",
        ),
        (lambda: gm.bearings.rows(TIMES, PATH[:3], STATE, 0.1), r"observer has shape \(3, 2\)"),
        (lambda: gm.bearings.rows(TIMES, PATH, [1.0, 2.0, 3.0], 0.1), "target has shape"),
        (
            lambda: gm.bearings.rows(TIMES, PATH, [0.0, 50.0, 0.0, 0.0], 0.1),
            r"observer\[1\] is at the target",
        ),
        (
            lambda: gm.bearings.rows(
                TIMES, PATH, [STATE, STATE, [30.0, 90.0, 0.0, 0.0]], 0.1
            ),
            r"at batch index \[2\]: observer\[2\]",
        ),
        (
            lambda: gm.bearings.rows(TIMES, np.ones((3, 4, 2)), np.ones((2, 4)), 0.1),
            "leading axes do not match",
        ),
        (
            lambda: gm.bearings.rows(changed(TIMES, 1, np.inf), PATH, STATE, 0.1),
            r"times\[1\] = inf: must be finite",
        ),
        (lambda: gm.bearings.rows([], np.ones((0, 2)), STATE, 0.1), "must not be empty"),
        (lambda: gm.bearings.simulate(TIMES, PATH, STATE, 0.1, seed=-1), "seed = -1"),
        (lambda: gm.bearings.simulate(TIMES, PATH, STATE, 0.1, 1, trials=0), "trials = 0"),
        (
            lambda: gm.from_function(lambda x: [np.nan], [1.0], 1.0, ["x"]),
            r"h\(x\)\[0\] = nan: must be finite",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0], 0.0, ["x"]),
            r"sigma\[0\] = 0.0: must be > 0",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0, 2.0], -np.eye(2), ["x", "y"]),
            "not positive definite",
        ),
        (
            lambda: gm.from_function(abs, [1.0], 1.0, ["x"], method="complex"),
            "returns real numbers",
        ),
        (
            lambda: gm.from_function(lambda x: x, [1.0], 1.0, ["x"], method="given"),
            "jacobian missing",
        ),
    ],
)  # fmt: skip
def test_error_names_the_fault(call, message):
    with pytest.raises(gm.InputError, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError)


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
