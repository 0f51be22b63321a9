"""Locate a car that passes two three-axis magnetometers: python car_passes.py FILE.csv

The file has the columns pass, speed_kmh, t_s and s1_x_uT ... s2_z_uT: one or more
passes, each with its recorded speed, at two sensors 0.5 m apart along y. (A made
file of one sensor pair, without the first two columns, is dipole_pass.csv.)

First each sensor alone, the speed known: how far and how strong, with standard
deviations, and the mirror image that one sensor cannot exclude. Then both sensors
together, the speed unknown: what they say the speed was.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import gramian as gm

SENSORS = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])


def passes(path: Path) -> Iterator[tuple[str, float, np.ndarray, np.ndarray]]:
    """Give each pass: its name, speed (m/s), times and field (K, 2, 3) in tesla."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in dict.fromkeys(row["pass"] for row in rows):
        part = [row for row in rows if row["pass"] == name]
        times = np.array([float(row["t_s"]) for row in part])
        field = [[float(row[f"s{s}_{axis}_uT"]) for s in (1, 2) for axis in "xyz"] for row in part]
        yield name, float(part[0]["speed_kmh"]) / 3.6, times, 1e-6 * np.reshape(field, (-1, 2, 3))


def alone(
    times: np.ndarray, field: np.ndarray, sensor: int, speed: float
) -> gm.dipole.Localization:
    """Locate from one sensor, the speed known. Spikes are rejected."""
    return gm.dipole.localize(
        times,
        field[:, sensor],
        {"speed": speed},
        background="fit",
        loss="huber",
        window="pass",
    )


def together(times: np.ndarray, field: np.ndarray) -> gm.dipole.Localization:
    """Locate from both sensors, nothing known: the time between them gives the speed."""
    return gm.dipole.localize(
        times, field, sensors=SENSORS, background="fit", loss="huber", window="pass"
    )


def angle(a: gm.dipole.Localization, b: gm.dipole.Localization) -> float:
    """Return the angle between two directions of travel, degrees, up to the mirror image."""
    return float(np.degrees(np.arccos(min(1.0, abs(a.direction @ b.direction)))))


def main(path: Path) -> None:
    for name, speed, times, field in passes(path):
        print(f"\n{name}: recorded at {3.6 * speed:.0f} km/h")
        each = [alone(times, field, s, speed) for s in (0, 1)]
        for s, found in enumerate(each):
            near = found.closest
            print(
                f"  sensor {s + 1} alone: {near.range:.2f} m (+- {near.range_std:.2f}) at "
                f"{near.time:.2f} s, moment {found.moment[0]:.0f} A m^2 "
                f"(+- {found.moment[1]:.0f}), explains {100 * found.explained:.1f} %, "
                f"{found.spikes} spikes"
            )
            print(
                f"    direction {found.direction.round(2)}, closest at {np.round(near.position, 2)}"
            )
            if found.mirror is not None:
                print(
                    f"    or its mirror image, costs {found.cost:.6g} and {found.mirror.cost:.6g}"
                )
        print(f"  the two directions differ by {angle(*each):.1f} deg")
        both = together(times, field)
        print(
            f"  both sensors, speed unknown: {3.6 * both.speed[0]:.1f} km/h "
            f"(+- {3.6 * both.speed[1]:.1f}), {100 * (both.speed[0] / speed - 1):+.0f} % off the "
            f"record; {both.closest.range:.2f} m, explains {100 * both.explained:.1f} %"
        )
        if both.mirror is not None:
            print(
                f"    the mirror image fits worse: {both.mirror.cost:.0f} against {both.cost:.0f}"
            )
    print(
        "\nThe standard deviations are bounds for a true dipole in independent noise. A car is"
        "\nseveral dipoles, and what one leaves over is far above the recorder's steps of 0.1 uT,"
        "\nso sensors and speeds differ by more than these."
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
