"""Two observers against one with twice the bearings: the table of docs/models/maneuver.md.

    python benches/two_observers.py

Bearings of 0.5 degrees, observers at 20 m/s. One observer takes 119 bearings in the time in
which each of two takes 60. The criterion is log det of the information; the two keep 100 m
between them. About half a minute on one core.
"""

from __future__ import annotations

import numpy as np

import gramian as gm

SIGMA = np.radians(0.5)
#: Name, target, seconds between 60 samples, stand-off range in metres.
SCENES = (
    ("fixed, 1000 m", [0.0, 1000.0], 1.0, 500.0),
    ("moving, 400 m", [0.0, 400.0, -5.0, 5.0], 1.0, 320.0),
    ("moving, 4000 m", [0.0, 4000.0, 4.0, -2.0], 10.0, 1000.0),
)


def main() -> None:
    """Print a line for each scene and number of observers."""
    print("scene           observers           log det  deviations at the bound (m, m/s)")
    for name, target, dt, standoff in SCENES:
        cases = [("one", [0.0, 0.0], dt / 2, 119, SIGMA)]
        cases += [("one of sigma / sqrt 2", [0.0, 0.0], dt, 60, SIGMA / np.sqrt(2))]
        cases += [
            (f"two, {apart:g} m apart", [[-apart / 2, 0.0], [apart / 2, 0.0]], dt, 60, SIGMA)
            for apart in (100.0, 500.0)
        ]
        for who, start, step, samples, sigma in cases:
            separation = 100.0 if np.ndim(start) == 2 else None
            plan = gm.maneuver.plan(
                target, start, 20.0, step, samples,
                sigma=sigma, standoff=standoff, separation=separation, bound=False,
            )  # fmt: skip
            bounds = "  ".join(f"{std:.2g}" for std in np.ravel(plan.crlb_std))
            note = "" if plan.converged else f"  ({plan.message})"
            print(f"{name:15} {who:22} {plan.value:6.2f}  {bounds}{note}", flush=True)


if __name__ == "__main__":
    main()
