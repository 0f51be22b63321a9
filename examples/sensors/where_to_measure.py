"""
Which beacons to build
======================

Thirty places where a beacon could stand, four to be built: by greedy choice and exchange, and
within how much of the best possible the choice is.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

rng = np.random.default_rng(4)
places = rng.uniform(-100, 100, (30, 2))
users = np.array([[0.0, 0.0], [40.0, 20.0], [-30.0, 50.0]])


def rows(place):
    """Whitened rows of the ranges of three users from one place."""
    out = np.zeros((3, 6))
    for k, user in enumerate(users):
        line = user - place
        out[k, 2 * k : 2 * k + 2] = line / np.hypot(*line) / 0.5
    return out


choice = gm.choose.select({f"b{k}": rows(place) for k, place in enumerate(places)}, 4, "A")
print(choice.chosen, f"within {100 * choice.within:.1f} % of the best")

picture = figure(5.6, 5.2)
axes = picture.subplots()
axes.plot(*places.T, "^", color=COLORS["muted"], label="could be built")
chosen = places[[int(name[1:]) for name in choice.chosen]]
axes.plot(*chosen.T, "^", color=COLORS["good"], markersize=12, label="chosen")
axes.plot(*users.T, "o", color=COLORS["target"], label="users")
axes.set_aspect("equal")
axes.set_xlabel("east (m)")
axes.set_ylabel("north (m)")
axes.legend(frameon=False, fontsize="small")
