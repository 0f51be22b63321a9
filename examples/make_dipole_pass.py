"""Make the field of a car-like dipole that passes two sensors: dipole_pass.csv.

Noise of 50 nT in steps of 100 nT over a background, with spikes, as cheap
recorders write. Run it in this folder; the file is the same each time.
"""

import csv
from pathlib import Path

import numpy as np

import gramian as gm

SENSORS = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]
BACKGROUND = np.array([[-1.2e-6, -0.2e-6, 5.8e-6], [-1.9e-6, 0.4e-6, 7.4e-6]])


def main() -> None:
    times = np.arange(0, 6, 0.01)
    r0, v, m = [0.3, -21.0, -1.3], [0.2, 7.0, 0.0], [-60.0, 25.0, 70.0]
    field = gm.dipole.simulate(r0, v, m, times, 5e-8, seed=20, sensors=SENSORS)
    field = np.round((field + BACKGROUND) / 1e-7) * 0.1  # uT
    rng = np.random.default_rng(3)
    hit = rng.choice(times.size, 5, replace=False)
    field[hit, rng.integers(0, 2, 5)] += rng.normal(size=(5, 3)) * 500
    with Path(__file__).with_name("dipole_pass.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t_s", *(f"s{s}_{axis}_uT" for s in (1, 2) for axis in "xyz")])
        for t, values in zip(times, field.reshape(len(times), 6), strict=True):
            writer.writerow([f"{t:.2f}", *(f"{x:.1f}" for x in values)])


if __name__ == "__main__":
    main()
