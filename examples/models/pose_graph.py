"""
Pose graph
==========

Odometry and one closure: a hundred poses move together until one is known.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure


def model(poses=34):
    names = [f"{axis}{k}" for axis in ("x", "y", "yaw") for k in range(poses)]
    turn = np.linspace(0, 2 * np.pi, poses, endpoint=False)
    x = np.concatenate([np.cos(turn), np.sin(turn), turn])
    edges = [(k, k + 1) for k in range(poses - 1)] + [(poses - 1, 0)]
    first, second = np.array(edges).T

    def relative(state):
        east, north, yaw = state.reshape(3, poses)
        de, dn = east[second] - east[first], north[second] - north[first]
        c, s = np.cos(yaw[first]), np.sin(yaw[first])
        return np.concatenate([c * de + s * dn, -s * de + c * dn, yaw[second] - yaw[first]])

    count = len(edges)
    periods = np.concatenate([np.zeros(2 * count), np.full(count, 2 * np.pi)])
    return gm.from_function(relative, x, 0.05, names, periods=periods, sparsity="find")


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.reason)
    for text in answer.null_combinations:
        print(text)
    # The loop, and the three ways in which all of it moves.
    picture = figure(7.5, 3.0)
    turn = np.linspace(0, 2 * np.pi, 34, endpoint=False)
    east, north = np.cos(turn), np.sin(turn)
    # Of a hundred states or more the null space is sparse.
    ways = answer.null_space.toarray().T
    for axes, change in zip(picture.subplots(1, 3), ways, strict=True):
        along, up, _ = 0.4 * change.reshape(3, -1) / np.abs(change).max()
        axes.plot(*np.c_[[east, north], [east[:1], north[:1]]], ".-", color=COLORS["observer"])
        axes.plot(east + along, north + up, ".", color=COLORS["bad"])
        axes.quiver(east, north, along, up, color=COLORS["bad"], units="xy", scale=1, width=0.015)
        axes.set(aspect="equal", xlabel="east (m)", ylabel="north (m)")
        axes.margins(0.15)
