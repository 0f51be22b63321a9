"""
Left or right of a towed array
==============================

A towed array gives the angle from the ship's heading and does not know left from right. On one leg
there are two tracks, mirror images; after a turn there is one.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

times = np.arange(5.0, 1200.0, 20.0)
truth = {"x0": 2500.0, "y0": 3500.0, "vx": -3.0, "vy": -1.0, "tonal": 300.0}
paths = {
    "one leg": ([[0.0, 0.0], [6000.0, 0.0]], [0.0, 1200.0]),
    "a turn": ([[0.0, 0.0], [3000.0, 0.0], [4500.0, 2598.0]], [0.0, 600.0, 1200.0]),
}
picture = figure(9.5, 4.4)
for axes, (name, (path, at)) in zip(picture.subplots(1, 2), paths.items(), strict=True):
    ship = gm.tracks.Carrier(path, at)
    sensors = [
        gm.tracks.Sensor.cone_angle(ship, times, sigma=np.radians(0.5)),
        gm.tracks.Sensor.frequency(ship, times, sigma=0.01, speed=1500.0, tonal="tonal"),
    ]
    scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)
    found = gm.tracks.estimate(scene, gm.tracks.simulate(scene, truth, seed=2))
    print(name, found.status, np.round(found.state, 1))
    axes.plot(*np.array(path).T / 1000, ".-", color=COLORS["observer"], label="ship")
    for state, style in ((found.state, "-"), *((o.state, "--") for o in found.others[:1])):
        track = scene.track(state, times)[:, :2] / 1000
        axes.plot(*track.T, style, color=COLORS["target"], label="a track that fits")
    axes.set_title(f"{name}: {found.status}")
    axes.set_aspect("equal")
    axes.set_xlabel("east (km)")
    axes.legend(frameon=False, fontsize="small")
picture.axes[0].set_ylabel("north (km)")
