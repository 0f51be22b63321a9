"""
Locating a passing car
======================

One magnetometer, the speed known, steps of 0.1 uT and spikes in the record: where did it pass? The
mirror image fits as well and is given beside the answer.
"""

import numpy as np

import gramian as gm

times = np.arange(0, 6, 0.01)
r0, v, m = [0.3, -21.0, -1.3], [0.2, 7.0, 0.0], [-60.0, 25.0, 70.0]
background = np.array([-1.2e-6, -0.2e-6, 5.8e-6])
field = gm.dipole.simulate(r0, v, m, times, 5e-8, seed=20) + background
field = np.round(field / 1e-7) * 1e-7  # steps of the recorder
field[[50, 211, 402]] += 4e-4  # spikes

found = gm.dipole.localize(
    times, field, {"speed": 7.003}, background="median", loss="huber", window="pass"
)
print(found.summary())
picture = found.plot()
