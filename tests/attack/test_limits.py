"""What is short, locked, endless or hostile is refused in words."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gramian as gm
from gramian._files import read_whole, write_whole
from gramian._text import visible

LARGE = 2**50


@pytest.mark.parametrize(
    "call",
    [
        lambda: gm.monte_carlo.normals(1, 0, LARGE, 1),
        lambda: gm.bearings.simulate([0, 10], [[0, 0], [0, 50]], [0, 1e3, 3, -1], 0.01, 1, trials=LARGE),
        lambda: gm.linear.observability_matrix(np.eye(2), np.eye(2), 10**15),
        lambda: gm.maneuver.trajectory([0, 1e3], [0, 0], 5.0, 1.0, 10**15),
    ],
)  # fmt: skip
def test_what_would_not_fit_the_memory_says_how_much_it_would_take(call):
    with pytest.raises(MemoryError, match=r"would take .*(TiB|PiB|EiB|counted)"):
        call()


@pytest.mark.parametrize("threads", [-1, 1025, 2**63, 1.5, "2", None, True])
def test_threads_are_bounded(threads):
    with pytest.raises(gm.InputError, match=r"threads = .*: must be a whole number from 0 to 1024"):
        gm.set_threads(threads)


def test_a_small_array_may_be_written_to_by_another_thread():
    rows = np.random.default_rng(1).normal(size=(100, 4))
    stop = threading.Event()

    def spoil():
        while not stop.is_set():
            rows[3, 2] = np.nan
            rows[3, 2] = 1.0

    thread = threading.Thread(target=spoil)
    thread.start()
    try:
        for _ in range(2000):
            try:
                assert np.isfinite(gm.gram(rows)).all()
            except gm.InputError as error:
                assert "rows[3, 2] = nan" in str(error)  # noqa: PT017
    finally:
        stop.set()
        thread.join()


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    file = tmp_path / "page.html"
    write_whole(file, b"good")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_whole(file, b"half")
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
    assert file.read_bytes() == b"good"


@pytest.mark.parametrize("name", ["/dev/zero", "a\0b", "fifo", "large"])
def test_what_has_no_end_is_not_read(tmp_path, name):
    path = tmp_path / name
    if name == "fifo":
        os.mkfifo(path)
    elif name == "large":
        with open(path, "wb") as stream:
            stream.truncate(1 << 21)
    with pytest.raises(OSError, match=r"regular file|null|more than the limit"):
        read_whole(path, limit=1 << 20)


@given(st.text())
def test_nothing_from_a_file_commands_the_terminal(text):
    shown = visible(text)
    assert not any(ord(sign) < 32 and sign not in "\n\t" for sign in shown)
    assert not any(0x7F <= ord(sign) <= 0x9F for sign in shown)


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * 900 + "]" * 900, "[" + ".".join("a" * 5000) + "]", "model = " + "9" * 5000, "\x1b]0;x\x07"],
)  # fmt: skip
def test_a_command_answers_with_one_line(tmp_path, text):
    file = tmp_path / "scenario.toml"
    file.write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "gramian", "analyze", str(file)], check=False, capture_output=True, text=True, timeout=60
    )  # fmt: skip
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "\x1b]" not in done.stderr


def test_a_folder_of_a_run_is_locked_between_threads(tmp_path):
    pytest.importorskip("pyarrow")
    from gramian.monte_carlo.resume import Manifest, Store

    manifest = Manifest("s", "e", "q", 1, 1024, "v")
    first = Store(tmp_path / "run", manifest)
    found = []

    def second():
        try:
            Store(tmp_path / "run", manifest)
        except gm.InputError as error:
            found.append(str(error))

    thread = threading.Thread(target=second)
    thread.start()
    thread.join()
    assert len(found) == 1
    assert "in use by another run" in found[0]
    # A descriptor that closes elsewhere does not let the lock fall.
    open(tmp_path / "run" / "lock").close()
    with pytest.raises(gm.InputError, match="in use by another run"):
        Store(tmp_path / "run", manifest)
    first.close()
    Store(tmp_path / "run", manifest).close()


rows = st.integers(1, 4).flatmap(
    lambda n: st.lists(
        st.lists(st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-6), min_size=n, max_size=n),
        min_size=1, max_size=6,
    )
)  # fmt: skip


@given(rows, st.data())
def test_rank_and_bounds_follow_units_and_permutations(given_rows, data):
    a = np.array(given_rows)
    n = a.shape[1]
    order = data.draw(st.permutations(range(n)))
    units = 2.0 ** np.array(data.draw(st.lists(st.integers(-20, 20), min_size=n, max_size=n)))
    std = gm.crlb_std(a)
    # Powers of two round nothing: the bound follows to the last bit of the scaling.
    assert np.array_equal(np.isinf(gm.crlb_std(a / units)), np.isinf(std))
    known = np.isfinite(std)
    assert gm.crlb_std(a / units)[known] == pytest.approx((std * units)[known], rel=1e-6)
    moved = gm.crlb_std(a[:, order])
    assert np.array_equal(np.isinf(moved), np.isinf(std[order]))


@given(rows)
def test_information_adds_up_and_twice_the_rows_halve_the_variance(given_rows):
    a = np.array(given_rows)
    twice = np.vstack([a, a])
    assert gm.gram(twice) == pytest.approx(2 * gm.gram(a), rel=1e-12, abs=1e-12)
    std = gm.crlb_std(a)
    known = np.isfinite(std)
    assert gm.crlb_std(twice)[known] == pytest.approx(std[known] / np.sqrt(2), rel=1e-5)
