"""
A levelling network of 400 points
=================================

Height differences between neighbours, two benchmarks: bounds of all heights at once, without the
inverse of anything. The farther from the benchmarks, the larger.
"""

import numpy as np
from scipy.sparse import csr_array

import gramian as gm
from gramian.plot import figure

n = 20
index = np.arange(n * n).reshape(n, n)
pairs = np.concatenate(
    [
        np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1),
        np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1),
    ]
)
count = len(pairs)
lines = np.repeat(np.arange(count), 2)
values = np.tile([-1.0, 1.0], count) / 0.002
rows = csr_array((values, (lines, pairs.ravel())), shape=(count, n * n))
network = gm.Problem(rows, [f"p{k}.height" for k in range(n * n)], units=["m"] * n * n)
print(gm.analyze(network).null_combinations)
fixed = network.fix("p0", "p399")
answer = gm.analyze(fixed)
print(answer.status, f"largest bound {1000 * answer.crlb_std.max():.2f} mm")

bounds = np.zeros(n * n)
bounds[[int(name[1:].split(".")[0]) for name in answer.names]] = 1000 * answer.crlb_std
picture = figure(5.4, 4.4)
axes = picture.subplots()
shown = axes.imshow(bounds.reshape(n, n), origin="lower")
picture.colorbar(shown, label="bound on the height (mm)")
axes.set_xlabel("column")
axes.set_ylabel("row")
