"""Maximum-likelihood estimates from bearings: ours beside SciPy's least_squares in a loop.

One thread, m = 60 bearings of 0.5 deg, an observer that turns by 60 deg halfway.
"""

import time

import numpy as np

import gramian as gm
from gramian import bearings

M, SIGMA, TRUTH = 60, np.radians(0.5), np.array([2000.0, 6000.0, 3.0, -2.0])
REPEATS = 7


def geometry():
    times = 15.0 * np.arange(M)
    heading = np.where(np.arange(M - 1) < M // 2, 0.0, np.radians(60.0))
    steps = 75.0 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    return times, np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def scipy_loop(times, noisy, observer, starts):
    """One call of least_squares for each trial, with the analytic Jacobian."""
    from scipy.optimize import least_squares

    since = times - times[0]

    def offset(x):
        return x[:2] + since[:, None] * x[2:] - observer

    def jacobian(x):
        d = offset(x)
        g = np.stack([-d[:, 1], d[:, 0]], axis=1) / (d**2).sum(axis=1)[:, None] / SIGMA
        return np.hstack([g, since[:, None] * g])

    found = []
    for z, start in zip(noisy, starts, strict=True):

        def residual(x, z=z):
            left = z - np.arctan2(*offset(x).T)
            return ((left + np.pi) % (2 * np.pi) - np.pi) / SIGMA

        found.append(least_squares(residual, start, jacobian, x_scale=[1e3, 1e3, 1, 1]).x)
    return np.array(found)


def pseudo_linear(times, noisy, observer):
    """The start that a SciPy user would write: one lstsq for each trial."""
    since = times - times[0]
    c, s = np.cos(noisy), np.sin(noisy)
    rows = np.stack([c, -s, since * c, -since * s], axis=-1)
    z = observer[:, 0] * c - observer[:, 1] * s
    return np.array([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(rows, z, strict=True)])


def main():
    times, observer = geometry()
    many, few = 20_000, 100
    noisy = bearings.simulate(times, observer, TRUTH, SIGMA, seed=1, trials=many)
    ours = bearings.localize(times, noisy, observer, SIGMA)
    theirs = scipy_loop(times, noisy[:few], observer, pseudo_linear(times, noisy[:few], observer))
    apart = np.abs((ours.state[:few] - theirs) / ours.std[:few]).max(axis=1)
    jobs = {
        "gramian localize": (many, lambda: bearings.localize(times, noisy, observer, SIGMA)),
        "gramian localize_trials (with simulation)": (
            many,
            lambda: bearings.localize_trials(times, observer, TRUTH, SIGMA, trials=many, seed=1),
        ),
        "scipy least_squares, pseudo-linear start": (
            few,
            lambda: scipy_loop(
                times, noisy[:few], observer, pseudo_linear(times, noisy[:few], observer)
            ),
        ),
        "scipy least_squares, started at the truth": (
            few,
            lambda: scipy_loop(times, noisy[:few], observer, np.tile(TRUTH, (few, 1))),
        ),
    }
    seconds = {name: [] for name in jobs}
    before = gm.set_threads(1)
    try:
        for _ in range(REPEATS):
            for name, (count, job) in jobs.items():
                start = time.perf_counter()
                job()
                seconds[name].append((time.perf_counter() - start) / count)
    finally:
        gm.set_threads(before)
    reference = min(seconds["scipy least_squares, pseudo-linear start"])
    print(f"{'':44} {'min us':>9} {'median us':>10} {'a second':>10} {'ratio':>7}")
    for name, spent in seconds.items():
        low, middle = min(spent), float(np.median(spent))
        print(
            f"{name:44} {low * 1e6:9.2f} {middle * 1e6:10.2f} {1 / low:10.0f} "
            f"{reference / low:7.0f}"
        )
    print(
        f"agreement on {few} trials: median {np.median(apart):.1e}, largest {apart.max():.1e} "
        "standard deviations"
    )


if __name__ == "__main__":
    main()
