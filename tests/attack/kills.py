"""Kill a run at random moments and spoil its files; resumed, it gives the same bits.

    python tests/attack/kills.py [--kills 50] [--corruptions 200] [--seed 0]

A kill is SIGKILL at a random moment of the run, workers included. A corruption changes, cuts,
empties, doubles, swaps or removes a random file of the finished run, or a random byte of it;
a run resumed from it either gives the same bits or is refused in words (a manifest that is
spoiled is no run).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

import gramian as gm
from monte_carlo_cases import Level, mean, slow_mean

TRIALS, CHUNK, SEED = 640, 16, 9


def resumed(path: Path) -> bytes:
    """Return the table of the run in a folder, its missing chunks simulated."""
    found = gm.monte_carlo.run(
        Level(10), TRIALS, SEED, slow_mean, resume=path, table=True, chunk=CHUNK, progress=False
    )
    table: bytes = found.table.tobytes()
    return table


def start(path: Path, workers: int | None) -> subprocess.Popen[str]:
    """Start the same run in a process group of its own."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import gramian as gm\n"
        "import monte_carlo_cases as cases\n"
        "if __name__ == '__main__':\n"
        f"    gm.monte_carlo.run(cases.Level(10), {TRIALS}, {SEED}, cases.slow_mean,\n"
        f"        resume=sys.argv[2], workers={workers}, chunk={CHUNK}, progress=False)\n"
    )
    place = str(Path(__file__).parents[1])
    return subprocess.Popen(
        [sys.executable, "-c", code, place, str(path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def kills(count: int, rng: random.Random, wanted: bytes, folder: Path) -> tuple[int, int]:
    """Return how many kills met a run at work, and how often the bits were others."""
    hit = wrong = 0
    path = folder / "killed"
    while hit < count:
        if len(list(path.glob("chunk-*"))) * CHUNK >= TRIALS or rng.random() < 0.05:
            wrong += resumed(path) != wanted
            shutil.rmtree(path, ignore_errors=True)
        before = len(list(path.glob("*")))
        process = start(path, rng.choice((None, None, 2)))
        # From its first file on: what comes before is the start of Python.
        end = time.monotonic() + 60
        while process.poll() is None and len(list(path.glob("*"))) <= before:
            if time.monotonic() > end:
                break
            time.sleep(0.002)
        time.sleep(rng.uniform(0.0, 0.4))
        hit += process.poll() is None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    wrong += resumed(path) != wanted
    return hit, wrong


def spoil(path: Path, rng: random.Random) -> str:
    """Change something in a folder, and return what."""
    files = sorted(file for file in path.iterdir() if file.is_file() and file.name != "lock")
    file = rng.choice(files)
    content = file.read_bytes()
    how = rng.choice(("bit", "bit", "bytes", "cut", "empty", "remove", "swap", "longer", "part"))
    if how == "bit" and content:
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        file.write_bytes(changed)
    elif how == "bytes" and content:
        changed = bytearray(content)
        at = rng.randrange(len(changed))
        changed[at : at + 16] = rng.randbytes(16)
        file.write_bytes(changed)
    elif how == "cut":
        file.write_bytes(content[: rng.randrange(len(content) + 1)])
    elif how == "empty":
        file.write_bytes(b"")
    elif how == "remove":
        file.unlink()
    elif how == "swap":
        file.write_bytes(rng.choice(files).read_bytes())
    elif how == "longer":
        file.write_bytes(content + rng.randbytes(rng.randrange(1, 100)))
    else:
        (path / "chunk-left.part").write_bytes(content[: len(content) // 2])
    return f"{how} of {file.name}"


def corruptions(
    count: int, rng: random.Random, wanted: bytes, folder: Path
) -> tuple[int, list[str]]:
    """Return how many were refused in words, and those that gave other bits or errors."""
    whole = folder / "whole"
    refused, wrong = 0, []
    # Fast: the estimator without a pause.
    run = {"trials": TRIALS, "seed": SEED, "estimator": mean, "table": True, "chunk": CHUNK}
    exact = gm.monte_carlo.run(Level(10), **run, resume=whole, progress=False).table.tobytes()
    assert exact == wanted
    for _ in range(count):
        path = folder / "spoiled"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(whole, path)
        what = " and ".join(spoil(path, rng) for _ in range(rng.choice((1, 1, 2, 3))))
        try:
            table = gm.monte_carlo.run(Level(10), **run, resume=path, progress=False).table
        except gm.GramianError:
            refused += 1
            if "manifest" not in what:
                wrong.append(f"{what}: refused")
        except Exception as error:
            wrong.append(f"{what}: {type(error).__name__}: {error}")
        else:
            if table.tobytes() != wanted:
                wrong.append(f"{what}: other bits")
    return refused, wrong


def main() -> int:
    """Run as a command: exit status 1 where a bit differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--corruptions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    wanted = gm.monte_carlo.run(
        Level(10), TRIALS, SEED, mean, table=True, chunk=CHUNK, progress=False
    ).table.tobytes()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        refused, wrong = corruptions(options.corruptions, rng, wanted, folder)
        print(
            f"{options.corruptions} corruptions: {options.corruptions - refused - len(wrong)} with "
            f"the same bits, {refused} refused (their manifest is spoiled), {len(wrong)} wrong",
            flush=True,
        )
        for line in wrong:
            print(f"  {line}")
        hit, others = kills(options.kills, rng, wanted, folder)
        print(f"{hit} kills of a run at work: {others} with other bits")
    return int(bool(wrong) or others > 0)


if __name__ == "__main__":
    sys.exit(main())
