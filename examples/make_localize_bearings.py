"""Make the example of `gramian localize`: python examples/make_localize_bearings.py

A made-up launch sails two legs and takes a bearing of a freighter every 20 s, with
0.5 deg of noise. It does not know where the freighter is; the scenario finds it.
"""

import csv
from pathlib import Path

import numpy as np

from gramian import bearings

OUT = Path(__file__).parent / "localize"
TRUTH = (2500.0, 4200.0, -3.4, -1.2)


def main():
    times = np.arange(0.0, 901.0, 20.0)
    course = np.radians(np.where(times[:-1] < 450, 20.0, 110.0))
    steps = 7.0 * 20.0 * np.stack([np.sin(course), np.cos(course)], axis=1)
    launch = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    seen = bearings.simulate(times, launch, TRUTH, np.radians(0.5), seed=11)
    OUT.mkdir(exist_ok=True)
    files = {
        "launch.csv": (["t_s", "east_m", "north_m"], np.column_stack([times, launch]), "%.1f"),
        "bearings.csv": (
            ["t_s", "bearing_deg"],
            np.column_stack([times, np.degrees(seen) % 360]),
            "%.2f",
        ),
    }
    for name, (header, rows, form) in files.items():
        with (OUT / name).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            writer.writerows([form % value for value in row] for row in rows)


if __name__ == "__main__":
    main()
