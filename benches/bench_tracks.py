"""Rates of `gm.tracks`, as ratios within one run, and the large statistical proofs.

    python benches/bench_tracks.py [--proofs]

Estimates of two legs (7 states, 60 bearings) against SciPy's `least_squares` with the same
Jacobian and start; rows of a mixed scene against numpy over all states at once; bearings
alone against `gm.bearings.localize_many`. With --proofs the RMSE over the bound, the coverage and
the choice of legs over 1000 trials. The target of each number stands in brackets behind it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor

TIMES = np.linspace(0.0, 1200.0, 60)
SIGMA = np.radians(0.3)


def zigzag() -> Carrier:
    course = np.radians([45.0, 135.0, 45.0, 135.0])
    steps = 1500.0 * np.stack([np.sin(course), np.cos(course)], axis=1)
    return Carrier(np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), 300.0 * np.arange(5))


TWO_LEGS = np.array([1500.0, 3700.0, 3.0, -4.0, -1.96410162, -4.59807621, 610.0])


def seconds(call: Callable[[], object], least: float = 0.5) -> float:
    """Return the least time of a call over several."""
    best, spent = np.inf, 0.0
    while spent < least:
        start = time.perf_counter()
        call()
        took = time.perf_counter() - start
        best, spent = min(best, took), spent + took
    return best


def two_legs() -> None:
    scene = Scene(Motion.legs(count=2), [Sensor.bearing(zigzag(), TIMES, sigma=SIGMA)])
    trials = 2000
    z = gm.tracks.simulate(scene, TWO_LEGS, trials=trials, seed=1)
    start = TWO_LEGS * np.array([1.05, 0.95, 0.8, 1.2, 1.2, 0.9, 1.05])
    ours = seconds(lambda: gm.tracks.estimate(scene, z, start=start)) / trials
    found = seconds(lambda: gm.tracks.estimate(scene, z[:200])) / 200

    def theirs() -> None:
        for one in z[:10]:

            def off(x: np.ndarray, one: np.ndarray = one) -> np.ndarray:
                return np.angle(np.exp(1j * (scene.values(x) - one))) / SIGMA

            least_squares(off, start, jac=lambda x: gm.tracks.rows(scene, x), method="lm")

    other = seconds(theirs) / 10
    print(f"two legs, 7 states, m = 60: {1 / ours:.0f} estimates a second from one start (20000)")
    print(f"  with starts found from the bearings: {1 / found:.0f} a second (no target)")
    print(f"  SciPy least_squares with the same Jacobian: {other / ours:.0f} times slower (100)")


def bearings_alone() -> None:
    carrier = zigzag()
    scene = Scene(Motion.constant_velocity(), [Sensor.bearing(carrier, TIMES, sigma=SIGMA)])
    truth = TWO_LEGS[:4]
    z = gm.tracks.simulate(scene, truth, trials=4000, seed=1)
    path = carrier.at(TIMES)[0]
    old = seconds(lambda: gm.bearings.localize_many(TIMES, z, path, SIGMA)) / 4000
    new = seconds(lambda: gm.tracks.estimate(scene, z, start=truth * 1.1)) / 4000
    found = seconds(lambda: gm.tracks.estimate(scene, z[:500])) / 500
    print(f"bearings alone, m = 60: specialised {old * 1e6:.1f} us, generic {new * 1e6:.1f} us")
    print(f"  rate of the generic over the specialised {old / new:.2f} from one start (1)")
    print(f"  {old / found:.3f} with starts found from the bearings, as the specialised does (1)")


def mixed_rows() -> None:
    carrier = zigzag()
    kinds = [
        Sensor.bearing(carrier, TIMES, sigma=SIGMA),
        Sensor.range(carrier, TIMES, sigma=10.0),
        Sensor.frequency(carrier, TIMES, speed=1500.0, sigma=0.02),
    ]
    scene = Scene(Motion.constant_velocity(), kinds)
    rng = np.random.default_rng(1)
    states = np.array([1500.0, 3700.0, 3.0, -4.0, 300.0]) + rng.normal(size=(2000, 5))
    place, velocity = carrier.at(TIMES)

    def plain() -> np.ndarray:
        u = TIMES - TIMES[0]
        d = states[:, None, :2] + u[:, None] * states[:, None, 2:4] - place
        r2 = (d**2).sum(axis=-1)
        r = np.sqrt(r2)
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

    np.testing.assert_allclose(gm.tracks.rows(scene, states), plain(), rtol=1e-8, atol=1e-8)
    ours, theirs = seconds(lambda: gm.tracks.rows(scene, states)), seconds(plain)
    each = ours / 2000 * 1e6
    print(f"rows of a mixed scene, 3 x 60: {each:.2f} us, numpy {theirs / ours:.1f} x (30)")


def proofs() -> None:
    scene = Scene(Motion.legs(count=2), [Sensor.bearing(zigzag(), TIMES, sigma=SIGMA)])
    z = gm.tracks.simulate(scene, TWO_LEGS, trials=1000, seed=1)
    found = gm.tracks.estimate(scene, z)
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
    print(Path(__file__).name, f"on {gm.set_threads(1) or 'all'} threads before, one now")
    two_legs()
    bearings_alone()
    mixed_rows()
    if "--proofs" in sys.argv:
        proofs()
