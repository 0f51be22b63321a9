"""
Which derivative tells which state?
===================================

A mass on a spring, its position measured with an unknown offset that drifts: the output and its
derivatives determine one combination after the other.
"""

import gramian as gm

A = [[0.0, 1.0, 0.0, 0.0], [-0.25, -0.02, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]
C = [[1.0, 0.0, 1.0, 0.0]]
names = ["position", "velocity", "offset", "drift"]
found = gm.linear.levels(A, C, names, combinations={"reading": {"position": 1.0, "offset": 1.0}})
print(found.summary())
picture = found.plot()
