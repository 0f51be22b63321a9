"""Rows of the user's own function and of many states: accuracy, and speed beside numpy's SVD.

Run as `python benches/bench_rows.py`; `--quick` takes a tenth of the cases.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import gramian as gm

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from random_functions import smooth_function


def best(call, repeats):
    """Return the shortest of several times, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def derivatives(count):
    """Share of entries whose true error is above three times the stated one; wrong verdicts."""
    rng = np.random.default_rng(1)
    wrong = total = verdicts = undecided = 0
    evaluations = []
    for _ in range(count):
        case = smooth_function(rng)
        with np.errstate(all="ignore"):
            model = gm.from_function(case.h, case.x, case.sigma, case.names)
            off = np.abs(model.jacobian() - case.jacobian)
            wrong += int((off > 3 * model.accuracy.error).sum())
            total += off.size
            # Without the value at x.
            evaluations.append((model.accuracy.evaluations - 1) / len(case.x))
            answer = gm.analyze(model)
            true = gm.analyze(case.jacobian / case.sigma[:, None])
        undecided += answer.status == "undecided"
        verdicts += answer.status != "undecided" and answer.rank != true.rank
    print(f"{count} functions, {total} entries: {wrong / total:.3%} above three times their error")
    print(f"wrong ranks {verdicts}, undecided {undecided}")
    print(f"evaluations a state: median {np.median(evaluations):.1f}, most {max(evaluations):.1f}")


def additions(count):
    """How often a further row cost rank or raised a bound."""
    rng = np.random.default_rng(2)
    rank = bound = 0
    for _ in range(count):
        n, rows = int(rng.integers(1, 6)), int(rng.integers(2, 8))
        a = rng.standard_normal((rows, n)) * 10.0 ** rng.uniform(-15, 15, (rows, 1))
        before, after = gm.analyze(a[:-1]), gm.analyze(a)
        rank += after.rank < before.rank
        bound += bool((after.crlb_std > before.crlb_std * (1 + 1e-6)).any())
    print(f"{count} rows added: {rank} cost rank, {bound} raised a bound")


def speed():
    """Times beside numpy's SVD of the same rows, in this run."""
    rng = np.random.default_rng(3)
    for what, shape, call, repeats in (
        ("analyze", (600, 300), gm.analyze, 5),
        ("analyze", (300, 100), gm.analyze, 5),
        ("crlb_std", (1600, 800), gm.crlb_std, 3),
        ("crlb_std", (21248, 245), gm.crlb_std, 3),
    ):
        rows = rng.standard_normal(shape)
        ours = best(lambda call=call, rows=rows: call(rows), repeats)
        theirs = best(lambda rows=rows: np.linalg.svd(rows, full_matrices=False), repeats)
        print(f"{what} {shape}: {ours:.3f} s, numpy svd {theirs:.3f} s: ratio {ours / theirs:.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    few = 10 if parser.parse_args().quick else 1
    speed()
    derivatives(2000 // few)
    additions(100_000 // few)
