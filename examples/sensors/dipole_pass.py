"""
Passes that one magnetometer cannot tell apart
==============================================

A small, slow, near magnet and a large, fast, far one make the same field at one sensor, and so does
the mirror image. A second sensor half a metre away sees the difference.
"""

import numpy as np

import gramian as gm
from gramian.models.dipole.plot import fields

t = np.arange(0.0, 21.0, 0.1)
r0, v, m = [-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0]
twice = gm.dipole.equivalents(r0, v, m, 2.0)
passes = {
    "the pass": (r0, v, m),
    "twice as far, as fast": (twice["same"].r0, twice["same"].v, twice["same"].m),
    "mirror image": (-np.array(r0), -np.array(v), m),
}


def seen(r0, v, m, at):
    places = np.asarray(r0) + t[:, None] * np.asarray(v) - at
    return gm.dipole.field(places, np.broadcast_to(m, places.shape))


first = {name: seen(*one, [0, 0, 0]) for name, one in passes.items()}
second = {name: seen(*one, [0, 2.0, 0]) for name, one in passes.items()}
for name in passes:
    print(f"{name}: differs by {abs(first[name] - first['the pass']).max():.0e} T at one sensor,",
          f"{abs(second[name] - second['the pass']).max():.0e} T at the other")  # fmt: skip
picture = fields(t, first)
other = fields(t, second)
