"""Random smooth functions with their exact derivatives, for tests and benches/bench_rows.py."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass
class Case:
    h: Any
    x: np.ndarray
    sigma: np.ndarray
    names: list[str]
    jacobian: np.ndarray
    noise: float


def smooth_function(rng, states=None, noise=None):
    """Polynomials, trigonometric and exponential parts at random scales and offsets.

    Of so many states near 0, with such a noise, where these are given.
    """
    n = int(rng.integers(1, 5)) if states is None else states
    m = int(rng.integers(n, n + 4))
    length = 10.0 ** rng.uniform(-12, 12, n)
    far = rng.choice([1, 1e3, 1e6, 1e9], n) * rng.standard_normal(n)
    origin = np.where(rng.random(n) < (0.5 if states is None else 1), 0, far) * length
    x = origin + rng.standard_normal(n) * length
    # As far as the numbers hold it.
    at = (x - origin) / length
    parts = [
        [
            (
                int(rng.integers(0, 4)),
                rng.standard_normal(n) * (rng.random(n) < 0.8),
                *rng.standard_normal(2),
            )
            for _ in range(rng.integers(1, 4))
        ]
        for _ in range(m)
    ]
    sizes = 10.0 ** rng.uniform(-6, 6, m)
    constants = np.where(
        rng.random(m) < 0.6, 0, rng.standard_normal(m) * 10.0 ** rng.uniform(0, 3, m)
    )
    noise = float(rng.choice([0, 1e-12, 1e-7, 1e-4])) if noise is None else noise
    seed = int(rng.integers(1 << 30))

    def value(u, i):
        total, slope = constants[i], np.zeros(n)
        for kind, weights, shift, factor in parts[i]:
            z = weights @ u + shift
            if kind == 0:
                f, d = np.sin(z), np.cos(z)
            elif kind == 1:
                f, d = z**2 + 0.3 * z**3, 2 * z + 0.9 * z**2
            elif kind == 2:
                f, d = np.exp(0.5 * z), 0.5 * np.exp(0.5 * z)
            else:
                wave, grow = np.sin(z), np.exp(0.3 * z)
                f, d = wave * grow, np.cos(z) * grow + 0.3 * wave * grow
            total, slope = total + factor * f, slope + factor * d * weights
        return sizes[i] * total, sizes[i] * slope / length

    def h(state):
        u = (state - origin) / length
        values = np.array([value(u, i)[0] for i in range(m)])
        if noise:
            bits = np.frombuffer(np.asarray(state).tobytes(), np.uint32)
            drawn = np.random.default_rng([seed, *bits]).standard_normal(m)
            values = values + noise * sizes * drawn
        return values

    jacobian = np.array([value(at, i)[1] for i in range(m)])
    return Case(h, x, sizes, [f"x{i}" for i in range(n)], jacobian, noise)
