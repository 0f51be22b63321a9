"""The machine's limit, measured in the same run: one thread."""

from __future__ import annotations

import ctypes
import time

import numpy as np
from harness import c_library, pointer


def measure(seconds: float = 0.3) -> dict[str, float]:
    """Return the best rates seen: multiply-add lanes, sine and cosine pairs, bytes a second."""
    library = c_library("limits.c", "-ffast-math", "-lmvec")
    library.fma_rate.restype = ctypes.c_double
    library.fma_rate.argtypes = [ctypes.c_long, ctypes.c_void_p]
    out = np.zeros(1)
    angles = np.random.default_rng(0).uniform(-3, 3, 4096)
    s, c = np.empty_like(angles), np.empty_like(angles)
    big = 8_000_000
    a, b, d = np.zeros(big), np.ones(big), np.ones(big)
    size = ctypes.c_size_t

    def sincos() -> float:
        for _ in range(50):
            library.sincos_rate(pointer(angles), pointer(s), pointer(c), size(angles.size))
        return 50.0 * angles.size

    def memory() -> float:
        library.triad(pointer(a), pointer(b), pointer(d), size(big))
        return 24.0 * big

    def fma() -> float:
        done: float = library.fma_rate(2_000_000, pointer(out))
        return done

    rates = {}
    for kind, work in (("fma", fma), ("sincos", sincos), ("memory", memory)):
        best, end = 0.0, time.perf_counter() + seconds
        work()
        while time.perf_counter() < end:
            start = time.perf_counter()
            done = work()
            best = max(best, done / (time.perf_counter() - start))
        rates[kind] = best
    return rates


if __name__ == "__main__":
    for kind, rate in measure().items():
        print(f"{kind:8} {rate / 1e9:8.2f} G/s")
