"""Locate a car that passes two three-axis magnetometers: python car_passes.py FILE.csv

The file has the columns pass, speed_kmh, t_s and s1_x_uT ... s2_z_uT: one or more
passes, each with its recorded speed, at two sensors 0.5 m apart along y. (A made
file of one sensor pair, without the first two columns, is dipole_pass.csv.)

First what needs no model: whatever passes both sensors, the second sees what the first
saw, later by their distance over the speed. Then each sensor alone, the speed
known: how far and how strong, with standard deviations, and the mirror image that one
sensor cannot exclude. Then both sensors together, the speed unknown: what they say the
speed was, by one dipole and by as many as explain the field.
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
    times: np.ndarray,
    field: np.ndarray,
    sensor: int,
    speed: float,
    use: np.ndarray | None = None,
) -> gm.dipole.Localization:
    """Locate from one sensor, the speed known, by the channels (2, 3) in `use`."""
    return gm.dipole.localize(
        times,
        field[:, sensor],
        {"speed": speed},
        background="fit",
        loss="huber",
        window="pass",
        missing="drop",
        use=None if use is None else use[sensor],
    )


def together(
    times: np.ndarray,
    field: np.ndarray,
    use: np.ndarray | None = None,
    sources: int | str | tuple[int | str, ...] = 1,
) -> gm.dipole.Localization:
    """Locate from both sensors, nothing known: the time between them gives the speed."""
    return gm.dipole.localize(
        times,
        field,
        sensors=SENSORS,
        sources=sources,
        background="fit",
        loss="huber",
        window="pass",
        missing="drop",
        use=use,
    )


def delays(times: np.ndarray, field: np.ndarray, use: np.ndarray) -> dict[str, float]:
    """Return how much later the second sensor sees what the first saw, s, for each axis.

    Where the correlation is largest, by a parabola through three lags.
    """
    step = float(np.median(np.diff(times)))
    even = np.arange(times[0], times[-1], step)
    found = {}
    for i, axis in enumerate("xyz"):
        if not use[:, i].all() or len(even) < 100:
            continue
        each = []
        for s in (0, 1):
            there = np.isfinite(field[:, s, i])
            samples = np.interp(even, times[there], field[there, s, i])
            # The median of seven takes out spikes.
            windows = np.lib.stride_tricks.sliding_window_view(samples, 7)
            smooth = np.median(windows, axis=1)
            each.append(smooth - np.median(smooth))
        most = min(len(each[0]) // 4, round(0.5 / step))
        lags = np.arange(-most, most + 1)
        inner = slice(most, len(each[0]) - most)
        alike = [each[0][inner] @ np.roll(each[1], -lag)[inner] for lag in lags]
        k = int(np.argmax(alike))
        if 0 < k < len(lags) - 1:
            before, here, after = alike[k - 1 : k + 2]
            bend = before - 2 * here + after
            found[axis] = step * (lags[k] + (0.5 * (before - after) / bend if bend else 0.0))
    return found


def angle(a: gm.dipole.Localization, b: gm.dipole.Localization) -> float:
    """Return the angle between two directions of travel, degrees, up to the mirror image."""
    return float(np.degrees(np.arccos(min(1.0, abs(a.direction @ b.direction)))))


def look(times: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Print what is wrong with a record; give the channels (2, 3) that measure the field."""
    try:
        check = gm.dipole.check_record(times, field)
    except gm.InputError as error:
        print(f"  the record could not be checked: {error}")
        return np.ones((2, 3), dtype=bool)
    for finding in check.findings:
        print(f"  in the record: {finding.text}")
    return np.reshape(check.usable, (2, 3))


def tell(found: gm.dipole.Localization, recorded: float | None) -> None:
    """Print an answer, its verdict first."""
    near = found.closest
    print(f"    {found.status}: {found.reason}")
    print(
        f"    {near.range:.2f} m (+- {near.range_std:.2f}) at {near.time:.2f} s, moment "
        f"{found.moment[0]:.0f} A m^2 (+- {found.moment[1]:.0f}), explains "
        f"{100 * found.explained:.1f} %, {found.spikes} spikes"
    )
    if recorded is not None:
        low, high = (3.6 * x for x in found.widened().interval("speed").pieces[0])
        print(
            f"    {3.6 * found.speed[0]:.1f} km/h (+- {3.6 * found.speed[1]:.1f}), "
            f"{100 * (found.speed[0] / recorded - 1):+.0f} % off the record; {low:.1f} to "
            f"{high:.1f} km/h if the residuals count as noise (95 %)"
        )
    if found.mirror is not None:
        print(f"    its mirror image costs {found.mirror.cost:.6g}, itself {found.cost:.6g}")


def main(path: Path, most: int = 4) -> None:
    """Tell what each pass of the record is, with up to `most` dipoles for the car."""
    for name, speed, times, field in passes(path):
        print(f"\n{name}: recorded at {3.6 * speed:.0f} km/h")
        use = look(times, field)
        late = delays(times, field, use)
        if late and all(value != 0 for value in late.values()):
            speeds = {axis: 3.6 * SENSORS[1, 1] / value for axis, value in late.items()}
            print(
                "  by the time between the sensors, for any body: "
                + ", ".join(f"{speed:.1f} km/h ({axis})" for axis, speed in speeds.items())
            )
        each = []
        for s in (0, 1):
            print(f"  sensor {s + 1} alone, the speed known")
            try:
                each.append(alone(times, field, s, speed, use))
            except gm.GramianError as error:
                print(f"    no answer: {error}")
            else:
                tell(each[-1], None)
        if len(each) == 2:
            print(f"  the two directions differ by {angle(*each):.1f} deg")
        for sources, text in (
            (1, "one dipole"),
            ((1, "quadrupole", *range(2, most + 1)), "what explains it best"),
        ):
            print(f"  both sensors, the speed unknown, {text}")
            try:
                both = together(times, field, use, sources)
            except gm.GramianError as error:
                print(f"    no answer: {error}")
            else:
                tell(both, speed)
    print(
        "\nThe standard deviations are bounds for a true dipole in independent noise. A car is"
        "\nseveral dipoles, and what one leaves over is far above the recorder's steps of 0.1 uT,"
        "\nso the model is a misfit, and sensors and speeds differ by more than these. Where the"
        "\ntime between the sensors agrees with the dipoles and not with the record, it is the"
        "\nrecorded speed, the distance of the sensors or the clock that is off."
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
