"""Runs that are stopped: by a kill, by Ctrl-C, by a full disk."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

import gramian as gm
import monte_carlo_cases
from gramian.monte_carlo import resume as storage
from monte_carlo_cases import Level, mean, slow_mean

TRIALS, SEED = 640, 9


def parts(path):
    return sorted(path.glob("chunk-*.parquet"))


@pytest.fixture(scope="module")
def whole():
    return gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, table=True, chunk=16)


def same(a, b):
    assert a.to_dict() == b.to_dict()
    assert a.sample.tobytes() == b.sample.tobytes()


def start(path, workers=None, name="slow_mean"):
    """Start the run of `whole` in another process."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import gramian as gm\n"
        "import monte_carlo_cases as cases\n"
        "if __name__ == '__main__':\n"
        f"    gm.monte_carlo.run(cases.Level(10), {TRIALS}, {SEED}, cases.{name},\n"
        f"                       resume=sys.argv[2], workers={workers}, chunk=16)\n"
    )
    place = Path(monte_carlo_cases.__file__).parent
    return subprocess.Popen(
        [sys.executable, "-c", code, str(place), str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for_parts(path, count, process):
    end = time.monotonic() + 60
    while len(parts(path)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.mark.parametrize(("after", "workers"), [(0, None), (3, 2)])
def test_a_kill_loses_no_finished_chunk(tmp_path, whole, after, workers):
    path = tmp_path / "run"
    process = start(path, workers)
    wait_for_parts(path, after, process)
    process.kill()
    process.communicate()
    kept = len(parts(path))
    assert after <= kept < 40
    result = gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=path)
    same(result, whole)
    assert result.simulated == TRIALS - 16 * kept
    assert len(parts(path)) == 40


def test_kills_again_and_again_come_to_an_end(tmp_path, whole):
    for count in (5, 11, 18, 26):
        process = start(tmp_path)
        wait_for_parts(tmp_path, count, process)
        process.kill()
        process.communicate()
    kept = len(parts(tmp_path))
    result = gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path)
    same(result, whole)
    assert result.simulated == TRIALS - 16 * kept <= 14 * 16


def test_ctrl_c_returns_promptly_and_keeps_what_is_done(tmp_path, whole):
    for workers in (None, 2):
        path = tmp_path / f"run{workers}"
        process = start(path, workers)
        wait_for_parts(path, 3, process)
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=5)
        assert process.returncode != 0
        assert "KeyboardInterrupt" in complaint
        assert f"of {TRIALS} trials; kept in {path}" in complaint
        same(gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=path), whole)


def test_ctrl_c_is_heard_by_what_runs_in_rust(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import gramian as gm\n"
        "import monte_carlo_cases as cases\n"
        "gm.monte_carlo.run(cases.scene(), 10**9, 1, resume=sys.argv[2], chunk=4096)\n"
    )
    place = Path(monte_carlo_cases.__file__).parent
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(place), str(tmp_path)], stderr=subprocess.PIPE, text=True
    )
    wait_for_parts(tmp_path, 1, process)
    process.send_signal(signal.SIGINT)
    _, complaint = process.communicate(timeout=5)
    assert "KeyboardInterrupt" in complaint
    assert f"of 1000000000 trials; kept in {tmp_path}" in complaint
    kept = len(parts(tmp_path))
    again = gm.monte_carlo.run(monte_carlo_cases.scene(), 4096 * kept, 1, resume=tmp_path)
    assert again.simulated == 0


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("trials", [2**22, 2**29])
def test_ctrl_c_stops_a_long_chunk(trials, workers):
    """Few chunks that share the threads or many with a thread each.

    What is counted is the work of a process of its own, not the clock: less than half of
    the 10 s of one chunk.
    """
    code = (
        "import os, signal, sys, threading, time; sys.path.insert(0, sys.argv[1])\n"
        "import gramian as gm\n"
        "import monte_carlo_cases as cases\n"
        "scene, trials, workers = cases.scene(), int(sys.argv[2]), int(sys.argv[3])\n"
        # What a first run imports must not be what is stopped.
        "gm.monte_carlo.run(scene, 16, 1)\n"
        "started = time.process_time()\n"
        "try:\n"
        "    threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()\n"
        "    gm.monte_carlo.run(scene, trials, 1, workers=workers, chunk=2**21)\n"
        "except KeyboardInterrupt:\n"
        "    print(time.process_time() - started)\n"
    )
    place = Path(monte_carlo_cases.__file__).parent
    arguments = [sys.executable, "-c", code, str(place), str(trials), str(workers)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=120, check=True)
    assert float(done.stdout) < 5.0


def test_a_finished_run_is_read_and_a_longer_one_goes_on(tmp_path, whole):
    path = tmp_path / "deep" / "er"
    first = gm.monte_carlo.run(Level(10), 100, SEED, slow_mean, resume=path, chunk=16, table=True)
    assert first.simulated == 100
    again = gm.monte_carlo.run(Level(10), 100, SEED, slow_mean, resume=path, table=True)
    assert again.simulated == 0
    same(first, again)
    assert again.table.tobytes() == first.table.tobytes() == whole.table[:100].tobytes()
    # The chunk of the trials 96 to 99 is not whole: it is run again.
    longer = gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=path, table=True)
    assert longer.simulated == TRIALS - 96
    same(longer, whole)
    assert longer.table.tobytes() == whole.table.tobytes()


def test_failures_come_back_from_the_disk(tmp_path):
    def fails(z):
        if z[0] > 4:
            raise ValueError(f"z = {z[0]:.6f}")
        return [z.mean()]

    runs = [gm.monte_carlo.run(Level(10), 300, SEED, fails, resume=tmp_path) for _ in range(2)]
    assert runs[1].simulated == 0
    assert runs[0].failures == runs[1].failures
    assert "ValueError: z = " in runs[0].failures[0].message


def test_a_damaged_chunk_is_run_again(tmp_path, whole):
    gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path, chunk=16)
    content = parts(tmp_path)[5].read_bytes()
    parts(tmp_path)[5].write_bytes(content[: len(content) // 2])
    parts(tmp_path)[7].write_bytes(b"")
    parts(tmp_path)[9].write_bytes(parts(tmp_path)[8].read_bytes())
    result = gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path)
    assert result.simulated == 48
    same(result, whole)


def test_no_bit_of_a_chunk_goes_astray_unseen(tmp_path):
    """Parquet reads a number with a wrong bit as gladly as a right one."""
    wanted = gm.monte_carlo.run(Level(10), 64, SEED, mean, table=True, resume=tmp_path)
    content = parts(tmp_path)[2].read_bytes()
    runs = 0
    for place in range(40, len(content), 61):
        spoiled = bytearray(content)
        spoiled[place] ^= 1
        parts(tmp_path)[2].write_bytes(spoiled)
        found = gm.monte_carlo.run(Level(10), 64, SEED, mean, table=True, resume=tmp_path)
        assert found.table.tobytes() == wanted.table.tobytes(), place
        runs += found.simulated == 16
    assert runs > 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"problem": Level(11)}, "is of another scenario"),
        ({"problem": Level(10, 2.0)}, "is of another scenario"),
        ({"seed": 8}, r"is of another seed \(9 there, 8 here\)"),
        ({"estimator": slow_mean}, "is of another estimator"),
        ({"estimator": partial(mean)}, "is of another estimator"),
        ({"quantities": {"z": mean}}, "is of another set of quantities"),
        ({"chunk": 32}, r"is of another chunk size \(16 there, 32 here\)"),
    ],
)
def test_another_run_is_refused(tmp_path, change, message):
    given = {"problem": Level(10), "trials": 64, "seed": SEED, "estimator": mean}
    gm.monte_carlo.run(**given, resume=tmp_path, chunk=16)
    with pytest.raises(gm.InputError, match=message):
        gm.monte_carlo.run(**(given | change), resume=tmp_path)
    assert gm.monte_carlo.run(**given, resume=tmp_path).simulated == 0


@pytest.mark.parametrize("chunk", [17, True, 2**40])
def test_a_manifest_that_someone_has_edited_is_refused(tmp_path, chunk):
    gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)
    file = tmp_path / "manifest.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"chunk": chunk}))
    with pytest.raises(gm.InputError, match=rf"of another chunk size \({chunk} there, 16 here\)"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)


def test_another_version_is_refused(tmp_path, monkeypatch):
    gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)
    monkeypatch.setattr("gramian._core.__version__", "99.0")
    with pytest.raises(gm.InputError, match=r"another version of gramian .*99\.0 here"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)


def test_an_estimator_is_known_by_its_text_and_what_it_closes_over(tmp_path):
    def shifted(by):
        return lambda z: [z.mean() + by]

    gm.monte_carlo.run(Level(10), 64, SEED, shifted(1.0), resume=tmp_path)
    assert gm.monte_carlo.run(Level(10), 64, SEED, shifted(1.0), resume=tmp_path).simulated == 0
    with pytest.raises(gm.InputError, match="another estimator"):
        gm.monte_carlo.run(Level(10), 64, SEED, shifted(2.0), resume=tmp_path)


def test_a_path_that_cannot_be_used_is_named(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(gm.InputError, match=r"file' cannot be used: File exists"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path / "file")
    with pytest.raises(gm.InputError, match=r"cannot be used: Not a directory"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path / "file" / "run")
    with pytest.raises(gm.InputError, match=r"holds 'file' and no manifest"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)
    for path in ("", 5, True, b"run", "a\0b"):
        with pytest.raises(gm.InputError, match=r"resume = .*: must be the path of a directory"):
            gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "manifest.json").write_text("{")
    with pytest.raises(gm.InputError, match=r"manifest.json cannot be read"):
        gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path / "run")


@pytest.mark.skipif(os.name != "posix", reason="permissions of another kind")
def test_a_read_only_path_is_named(tmp_path):
    # Imports what it needs while everything can be read.
    gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path / "warm")
    tmp_path.chmod(0o500)
    user = os.geteuid()
    if user == 0:  # root may write anywhere, and so steps down
        os.seteuid(65534)
    try:
        with pytest.raises(gm.InputError, match="cannot be used: Permission denied"):
            gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path / "run")
    finally:
        if user == 0:
            os.seteuid(0)
        tmp_path.chmod(0o700)


def test_a_run_that_is_under_way_elsewhere_is_refused(tmp_path):
    process = start(tmp_path)
    wait_for_parts(tmp_path, 1, process)
    try:
        with pytest.raises(gm.InputError, match="is in use by another run"):
            gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path)
    finally:
        process.kill()
        process.communicate()


def test_a_full_disk_leaves_what_was_finished(tmp_path, monkeypatch, whole):
    real, written = os.fsync, []

    def full(descriptor):
        if len(parts(tmp_path)) >= 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(descriptor)
        real(descriptor)

    monkeypatch.setattr(storage.os, "fsync", full)
    message = r"No space left on device; the 4 chunks finished before are whole: make room"
    with pytest.raises(gm.StorageError, match=message):
        gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path, chunk=16)
    monkeypatch.undo()
    assert len(parts(tmp_path)) == 4
    assert not list(tmp_path.glob("*.part"))
    result = gm.monte_carlo.run(Level(10), TRIALS, SEED, slow_mean, resume=tmp_path)
    assert result.simulated == TRIALS - 64
    same(result, whole)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_device_without_room_is_a_clear_error(tmp_path, monkeypatch):
    """The same from the operating system itself."""
    first = gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path, chunk=16)
    parts(tmp_path)[2].unlink()
    opened = []

    def full(**_):
        opened.append(str(tmp_path / "never-there.part"))
        return os.open("/dev/full", os.O_WRONLY), opened[-1]

    with monkeypatch.context() as patch:
        patch.setattr("tempfile.mkstemp", full)
        with pytest.raises(gm.StorageError, match="No space left on device; the 3 chunks"):
            gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path)
    assert len(opened) == 1
    same(gm.monte_carlo.run(Level(10), 64, SEED, mean, resume=tmp_path), first)


def test_a_sweep_is_resumed_point_by_point(tmp_path):
    def swept():
        return gm.monte_carlo.sweep(
            Level, {"samples": [4, 9]}, 64, SEED, mean, resume=tmp_path
        ).results

    assert [result.simulated for result in swept()] == [64, 64]
    assert [result.simulated for result in swept()] == [0, 0]
