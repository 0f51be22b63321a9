"""Does `dipole.localize` end at the least minimum of bodies of several dipoles?

    python benches/dipole_minima.py [--dipoles 3] [--apart 3] [--bodies 40] [--first 0]

Random bodies pass three vector sensors, 0.5 m apart, at 10 m; each is located, and fitted from
the truth too. Told are those that end at a higher minimum than this, by chi2, how many of them
are no "misfit", and the seconds of a fit (the first of one thread; an idle machine is needed).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

import gramian as gm
from gramian.models.dipole import Description, DipoleModel

TIMES = np.arange(0.0, 20.0, 0.5)
SENSORS = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]])
KNOWN = {"z": 10.0, "vz": 0.0}
#: Tesla; the field of a body is some nT.
SIGMA = 1e-12
#: A fit that is worse than that from the truth by less is the same minimum.
SAME = 0.01


@dataclass
class Case:
    """A body: what was recorded of it, and the fit that begins at the truth."""

    field: np.ndarray
    truth: np.ndarray
    chi2: float


def body(dipoles: int, apart: float, seed: int) -> Case:
    """Return a body of dipoles of 8 to 25 A m^2, each at a distance (m) from the first."""
    draw = np.random.default_rng(1000 + seed)

    def direction() -> np.ndarray:
        step = draw.normal(size=3)
        return step / np.linalg.norm(step)

    near = np.concatenate([[-10.0, -10.0, 10.0, 1.0, 1.0, 0.0], 15 * direction()])
    more = [
        part
        for _ in range(dipoles - 1)
        for part in (apart * direction(), draw.uniform(8, 25) * direction())
    ]
    model = DipoleModel(
        TIMES,
        SENSORS,
        np.full((TIMES.size, len(SENSORS), 3), 1 / SIGMA),
        near,
        {"z0": 10.0, "vz": 0.0},
        {},
        description=Description(sources=dipoles),
    )
    truth = np.concatenate([near[[0, 1, 3, 4, 6, 7, 8]], *more])
    noise = SIGMA * np.random.default_rng(seed).normal(size=(TIMES.size, len(SENSORS), 3))
    field = model.h(truth).reshape(noise.shape) + noise
    best = model.handle(field).minimize(truth[None], ("squares", 0.0), 500)
    return Case(field, truth, float(best[0]["chi2"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dipoles", type=int, default=3)
    parser.add_argument("--apart", type=float, default=3.0, help="m")
    parser.add_argument("--bodies", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    higher, unnoticed, lasted = [], [], []
    for seed in range(options.first, options.first + options.bodies):
        case = body(options.dipoles, options.apart, seed)
        begun = time.perf_counter()
        found = gm.dipole.localize(
            TIMES, case.field, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=options.dipoles
        )
        lasted.append(time.perf_counter() - begun)
        if found.cost > case.chi2 + SAME:
            higher.append(seed)
            status = found.status
            unnoticed += [seed] if status != "misfit" else []
            print(
                f"body {seed}: chi2 {found.cost:.2f}, {case.chi2:.2f} there: {status}", flush=True
            )
    print(
        f"{options.dipoles} dipoles, {options.apart:g} m apart: {len(higher)} of {options.bodies} "
        f"end higher, {len(unnoticed)} of these no misfit; {np.median(lasted):.2f} s a fit "
        f"(median), {np.max(lasted):.2f} s at most"
    )


if __name__ == "__main__":
    main()
