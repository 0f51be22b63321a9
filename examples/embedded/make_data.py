"""Make the samples that the embedded examples read: python examples/embedded/make_data.py."""

from pathlib import Path

import numpy as np

import gramian as gm

DATA = Path(__file__).parent / "data"


def main():
    # An observer that goes straight for 300 s and then turns by 60 degrees.
    t = np.arange(0.0, 600.0, 10.0)
    turn, angle = 300.0, np.radians(60)
    leg = np.stack([0 * t, 5 * np.minimum(t, turn)], axis=1)
    after = 5 * np.maximum(t - turn, 0)
    observer = leg + after[:, None] * [np.sin(angle), np.cos(angle)]
    sigma = np.radians(0.5)
    target = [1000.0, 3000.0, 3.0, -1.0]
    bearings = gm.bearings.simulate(t, observer, target, sigma, seed=4)
    lines = [f"{a:.0f} {b:.6f} {sigma:.6f}" for a, b in zip(t, bearings, strict=True)]
    (DATA / "bearings.txt").write_text("\n".join(lines) + "\n")

    # A car that passes at 10 m/s, crossing at 4 s.
    t = np.arange(0.0, 8.0, 0.05)
    r = np.stack([10 * (t - 4.0), 0 * t + 2.5, 0 * t - 0.3], axis=1)
    moment = np.array([60.0, 15.0, -170.0])
    size = np.linalg.norm(r, axis=1)[:, None]
    field = 1e-7 * (3 * (r @ moment)[:, None] * r / size**5 - moment / size**3)
    field += 5e-8 * np.random.default_rng(1).normal(size=field.shape)
    lines = [f"{a:.2f} {x:.4e} {y:.4e} {z:.4e}" for a, (x, y, z) in zip(t, field, strict=True)]
    (DATA / "field.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
