"""
Where must a target fly to reveal the biases?
=============================================

Two radars 60 km apart with a range and an azimuth bias each. Bright: looks around this place tell
much; dark: nothing, as on the line between the two.
"""

import numpy as np

import gramian as gm

sensors = {"A": (0.0, 0.0), "B": (60e3, 0.0)}
chart = gm.registration.field(
    sensors, (50.0, np.radians(0.1)), (-40e3, 100e3, -60e3, 60e3), points=60
)
print("largest", chart.values.max().round(3), "smallest", chart.values.min().round(6))
picture = chart.plot()
