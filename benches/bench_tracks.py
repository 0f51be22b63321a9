"""Rates of `gm.tracks`, as ratios within one run, and the large statistical proofs.

    python benches/bench_tracks.py [--quick] [--proofs]

Estimates of two legs (7 states, 60 bearings) against SciPy's `least_squares` with the same
Jacobian and start; rows of a mixed scene against numpy over all states at once; bearings
alone against `gm.bearings.localize_many`. With --proofs the RMSE over the bound, the coverage and
the choice of legs over 1000 trials, and no contest.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any

import exact
import numpy as np
from harness import ALL, OURS, Case, Contest, Contestant, main
from limits import Limit, writing
from numpy.typing import NDArray

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor

Array = NDArray[np.float64]

TIMES = np.linspace(0.0, 1200.0, 60)
SIGMA = np.radians(0.3)


def zigzag() -> Carrier:
    course = np.radians([45.0, 135.0, 45.0, 135.0])
    steps = 1500.0 * np.stack([np.sin(course), np.cos(course)], axis=1)
    return Carrier(np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), 300.0 * np.arange(5))


TWO_LEGS = np.array([1500.0, 3700.0, 3.0, -4.0, -1.96410162, -4.59807621, 610.0])


#: SciPy's fastest for few states, to the last digit.
MINPACK = {"method": "lm", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}


def least_squares_of(
    scene: Scene, sigma: float, z: Array, start: Array, options: dict[str, Any] = MINPACK
) -> Array:
    """Maximum likelihood by SciPy, with our rows as its Jacobian."""
    from scipy.optimize import least_squares

    def off(x: Array) -> Array:
        return np.angle(np.exp(1j * (scene.values(x) - z))) / sigma

    found = least_squares(off, start, jac=lambda x: gm.tracks.rows(scene, x), **options)
    state: Array = found.x
    return state


def chi2(scene: Scene, sigma: float, z: Array, x: Array) -> float:
    """Sum of the squared residuals over the noise."""
    off = np.angle(np.exp(1j * (z - scene.values(x)))) / sigma
    return float(off @ off)


def two_legs_contest(trials: int, few: int) -> Contest:
    """Seven states from sixty bearings."""
    motion = Motion.legs(count=2)
    start = TWO_LEGS * np.array([1.05, 0.95, 0.8, 1.2, 1.2, 0.9, 1.05])

    def scene(sigma: float) -> Scene:
        return Scene(motion, [Sensor.bearing(zigzag(), TIMES, sigma=sigma)])

    def data(sigma: float, trials: int) -> tuple[Scene, Array]:
        made = scene(sigma)
        return made, gm.tracks.simulate(made, TWO_LEGS, trials=trials, seed=1)

    def ours(given: tuple[Scene, Array]) -> Callable[[], Array]:
        made, z = given
        return lambda: gm.tracks.estimate_many(made, z, start=start).state

    def searched(given: tuple[Scene, Array]) -> Callable[[], Array]:
        made, z = given
        return lambda: gm.tracks.estimate_many(made, z[:few]).state

    def scipy(options: dict[str, Any]) -> Callable[[tuple[Scene, Array]], Callable[[], Array]]:
        def made(given: tuple[Scene, Array]) -> Callable[[], Array]:
            scene, z = given
            sigma = float(np.ravel(scene.sensors[0].sigma)[0])
            return lambda: np.array(
                [least_squares_of(scene, sigma, one, start, options) for one in z[:few]]
            )

        return made

    def case(sigma: float) -> Case:
        made, z = data(sigma, 3)
        wanted = exact.lazily(
            lambda: [
                chi2(made, sigma, one, least_squares_of(made, sigma, one, TWO_LEGS)) for one in z
            ]
        )

        def error(found: Array) -> float:
            above = [
                chi2(made, sigma, one, x) - least
                for one, x, least in zip(z, found, wanted(), strict=False)
            ]
            return float(np.sqrt(np.max([0.0, *above])))  # NaN stays NaN

        return Case((made, z), error)

    return Contest(
        f"two legs from bearings, 7 states, m = {TIMES.size}",
        "estimate",
        float(trials),
        data(SIGMA, trials),
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant("gramian, starts found from the bearings", searched, part=float(few)),
            Contestant("SciPy MINPACK with the same Jacobian", scipy(MINPACK), part=float(few)),
            Contestant("SciPy least_squares, its defaults", scipy({}), part=float(few)),
        ],
        cases={"well": case(SIGMA / 10), "ill": case(SIGMA)},
        target="20 000 a second, 100 times SciPy least_squares with the same Jacobian",
        note="All from one start, SciPy with our rows as its Jacobian. Error: the root of what "
        "chi2 is above that of MINPACK started at the truth, which is a distance in deviations; "
        "well: a tenth of the noise.",
    )


def reused(work: Callable[[Array, Array], Array]) -> Callable[[Array], Callable[[], Array]]:
    """Return a contestant that writes mixed rows into memory that has been in use."""

    def prepare(states: Array) -> Callable[[], Array]:
        out = np.zeros((len(states), 3 * TIMES.size, 5))
        return lambda: work(states, out)

    return prepare


def mixed_rows_contest(trials: int) -> Contest:
    """Bearings, ranges and frequencies of a moving target."""
    carrier = zigzag()
    kinds = [
        Sensor.bearing(carrier, TIMES, sigma=SIGMA),
        Sensor.range(carrier, TIMES, sigma=10.0),
        Sensor.frequency(carrier, TIMES, speed=1500.0, sigma=0.02),
    ]
    scene = Scene(Motion.constant_velocity(), kinds)
    at = np.array([1500.0, 3700.0, 3.0, -4.0, 300.0])
    place, velocity = carrier.at(TIMES)

    def plain(states: Array, out: Array | None = None) -> Array:
        u = TIMES - TIMES[0]
        d = states[:, None, :2] + u[:, None] * states[:, None, 2:4] - place
        r2 = (d**2).sum(axis=-1)
        r = np.sqrt(r2)
        if out is None:
            out = np.zeros((len(states), 180, 5))
        g = np.stack([d[..., 1], -d[..., 0]], axis=-1) / r2[..., None] / SIGMA
        out[:, :60, :2], out[:, :60, 2:4] = g, g * u[:, None]
        n = d / r[..., None]
        out[:, 60:120, :2], out[:, 60:120, 2:4] = n / 10.0, n * u[:, None] / 10.0
        above = 1500.0 + (n * velocity).sum(axis=-1)
        below = 1500.0 + (n * states[:, None, 2:4]).sum(axis=-1)
        ratio = above / below
        pull = velocity - ratio[..., None] * states[:, None, 2:4]
        across = pull - (pull * n).sum(axis=-1)[..., None] * n
        gain = (states[:, None, 4] / below)[..., None]
        by_place = gain * across / r[..., None]
        by_velocity = -gain * ratio[..., None] * n
        out[:, 120:, :2] = by_place / 0.02
        out[:, 120:, 2:4] = (by_place * u[:, None] + by_velocity) / 0.02
        out[:, 120:, 4] = ratio / 0.02
        return out

    def exact_rows(state: Array) -> Array:
        """With 30 digits, by differences of 60: the three measurements as they are."""
        import mpmath as mp

        def seen(k: int, x: Any) -> list[Any]:
            u = mp.mpf(float(TIMES[k])) - mp.mpf(float(TIMES[0]))
            d = [x[i] + u * x[2 + i] - mp.mpf(float(place[k, i])) for i in range(2)]
            r = mp.sqrt(d[0] ** 2 + d[1] ** 2)
            own = sum(d[i] / r * mp.mpf(float(velocity[k, i])) for i in range(2))
            its = sum(d[i] / r * x[2 + i] for i in range(2))
            bearing = mp.atan2(d[0], d[1]) / mp.mpf(SIGMA)
            return [bearing, r / 10, x[4] * (1500 + own) / (1500 + its) / mp.mpf("0.02")]

        with mp.workdps(60):
            x = [mp.mpf(float(v)) for v in state]
            step, out = mp.mpf(10) ** -20, np.zeros((180, 5))
            for k in range(60):
                for j in range(5):
                    up, down = list(x), list(x)
                    up[j], down[j] = x[j] + step, x[j] - step
                    for i, (a, b) in enumerate(zip(seen(k, up), seen(k, down), strict=True)):
                        out[60 * i + k, j] = float((a - b) / (2 * step))
        return out

    def case(state: Array) -> Case:
        wanted = exact.lazily(lambda: exact_rows(state))

        def error(found: Array) -> float:
            scale = np.abs(wanted()).max(axis=0)
            return float((np.abs(found[0] - wanted()) / scale).max())

        return Case(state[None], error)

    ours = reused(lambda states, out: gm.tracks.rows(scene, states, out=out))

    return Contest(
        f"rows of a mixed scene, {trials} x 3 x {TIMES.size}",
        "scene",
        float(trials),
        at + np.random.default_rng(1).normal(size=(trials, 5)),
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant(
                "gramian, a new array", lambda states: lambda: gm.tracks.rows(scene, states)
            ),
            Contestant("numpy, all states at once", reused(plain)),
            Contestant("numpy, a new array", lambda states: lambda: plain(states)),
        ],
        limit=Limit(
            {
                writing(trials * 7200.0): 7200.0,
                "divide": 120.0,
                "root": 60.0,
                "fma": 60.0 * 40.0,
            },
            "180 rows of 5 numbers are written; of each sample one root, 1 / range and the "
            "quotient of the frequencies",
        ),
        cases={"well": case(at), "ill": case(at + np.array([1e7, 0, 0, 0, 0]))},
        target="30 times numpy",
        note="Bearings, ranges and frequencies, into memory that has been in use. Error over the "
        "largest entry of the column; ill: 10 000 km away. "
        "One pass from the samples to the rows takes 0.4 of the time of three over memory, and "
        "one division for a frequency 8 % less than three. Tried beside it: two vectors at once "
        "as one number, so that two chains of operations overlap (3 %). Of the time (AVX2) half "
        "is the frequencies: 105 instructions for four of them.",
    )


def bearings_contest(trials: int) -> Contest:
    """The engine for any scene, beside the estimator for bearings alone."""
    carrier = zigzag()
    scene = Scene(Motion.constant_velocity(), [Sensor.bearing(carrier, TIMES, sigma=SIGMA)])
    truth, path = TWO_LEGS[:4], carrier.at(TIMES)[0]
    few = trials // 8

    def ours(z: Array) -> Callable[[], Array]:
        return lambda: gm.tracks.estimate_many(scene, z, start=truth * 1.1).state

    def searched(z: Array) -> Callable[[], Array]:
        return lambda: gm.tracks.estimate_many(scene, z[:few]).state

    def special(z: Array) -> Callable[[], Array]:
        return lambda: gm.bearings.localize_many(TIMES, z, path, SIGMA).state

    return Contest(
        f"bearings alone by the engine of tracks, m = {TIMES.size}",
        "estimate",
        float(trials),
        gm.tracks.simulate(scene, truth, trials=trials, seed=1),
        [
            Contestant(OURS, ours),
            Contestant("gramian, starts found from the bearings", searched, part=float(few)),
            Contestant("gramian.bearings.localize_many", special),
        ],
        note="From one start; localize_many finds its own.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield two_legs_contest(*((500, 5) if quick else (2000, 20)))
    yield mixed_rows_contest(500 if quick else 2000)
    yield bearings_contest(800 if quick else 4000)


def proofs() -> None:
    scene = Scene(Motion.legs(count=2), [Sensor.bearing(zigzag(), TIMES, sigma=SIGMA)])
    z = gm.tracks.simulate(scene, TWO_LEGS, trials=1000, seed=1)
    found = gm.tracks.estimate_many(scene, z)
    error = found.state - TWO_LEGS
    bound = gm.analyze(gm.tracks.problem(scene, TWO_LEGS)).crlb_std
    print(found)
    print("RMSE / bound (0.93 to 1.07)", np.round(np.sqrt((error**2).mean(axis=0)) / bound, 3))
    print("coverage of 95 % (0.93 to 0.97)", (np.abs(error) < 1.959964 * found.std).mean(axis=0))
    two = gm.tracks.choose_legs(scene, z).count
    line = scene.with_motion(Motion.constant_velocity())
    one = gm.tracks.choose_legs(
        line, gm.tracks.simulate(line, TWO_LEGS[:4], trials=1000, seed=2)
    ).count
    print(f"two legs chosen in {(two == 2).mean():.1%}, one leg in {(one == 1).mean():.1%} (95 %)")
    fall = gm.tracks.leg_penalty(line.with_motion(Motion.legs(count=1)), TWO_LEGS[:4], trials=1000)
    print(f"chi-square falls by {fall:.1f} at most in 95 % of straight tracks")


if __name__ == "__main__":
    if "--proofs" in sys.argv:
        proofs()
    else:
        main(contests)
