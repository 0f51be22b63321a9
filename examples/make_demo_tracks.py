"""Make the tracks of the demo: python examples/make_demo_tracks.py

Four made-up vessels in a bay, reporting as ships do: at irregular times, with
positions to a tenth of a metre. One of them, the ferry on its schedule, steers so
straight and reports so exactly that its reports lie on one line.
"""

import csv
from pathlib import Path

import numpy as np

OUT = Path(__file__).parent.parent / "python" / "gramian" / "demo" / "bay.csv"


def sailed(rng, start, legs, speed, *, wander_deg=1.5):
    """Reports (time, east, north) of a vessel along legs of (duration s, course deg)."""
    position, time, reports = np.array(start, dtype=float), 0.0, []
    for duration, course in legs:
        end = time + duration
        while time < end:
            reports.append((time, *position))
            step = rng.uniform(4.0, 12.0)
            heading = np.radians(course + rng.normal(0, wander_deg))
            position = position + speed * step * np.array([np.sin(heading), np.cos(heading)])
            time += step
    return [(round(t, 1), round(e, 1), round(n, 1)) for t, e, n in reports]


def main():
    rng = np.random.default_rng(20)
    tracks = {
        # The pilot boat turns twice: its bearings fix the freighter.
        "pilot_boat": sailed(rng, (0, 0), [(420, 30), (420, 110), (420, 20)], 7.0),
        "freighter": sailed(rng, (2600, 3400), [(1300, 250)], 4.0, wander_deg=0.5),
        # The yacht goes all but straight, and the tanker is far.
        "yacht": sailed(rng, (-3000, -2000), [(650, 75), (650, 83)], 3.0),
        "tanker": sailed(rng, (5000, 16000), [(1300, 160)], 6.0, wander_deg=0.5),
        "ferry": [(float(t), 6.0 * t, -2500.0) for t in range(0, 1300, 10)],
    }
    OUT.parent.mkdir(parents=True, exist_ok=True)
    with OUT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["vessel", "t_s", "east_m", "north_m"])
        for vessel, reports in tracks.items():
            writer.writerows((vessel, *report) for report in reports)


if __name__ == "__main__":
    main()
