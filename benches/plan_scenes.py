"""Ten scenes: the planner against a brute-force search by another optimiser.

    python benches/plan_scenes.py              # 20 s of brute force a scene
    python benches/plan_scenes.py --minutes 20 # as long as it takes to believe it
    python benches/plan_scenes.py --scene 3

The brute force is SciPy's SLSQP on numpy from random paths of one to six legs, the speed of
each step free where a range is given; with legs, the steps of the turns are random too. It
shares no code with the planner but the definition of the criterion, which it has again.
The gap is that of the planner to the best of both, in det^(1/n): positive where the brute
force found more. `bound` is how far above the plan any path can be.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gramian as gm

Array = NDArray[np.float64]

#: target, start, speed, dt, samples; options. All criteria are log det.
SCENES: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "open water": (([0, 1000], [0, 0], 20.0, 1.0, 40), {"standoff": 500.0}),
    "far target": (([0, 20_000], [0, 0], 20.0, 1.0, 40), {}),
    "two circles": (
        ([0, 1000], [0, 0], 20.0, 1.0, 60),
        {"standoff": 400.0, "keep_out": [[-120, 420, 110], [160, 330, 120]]},
    ),
    "three possible targets": (
        ([[0, 700], [0, 1000], [150, 1300]], [0, 0], 20.0, 1.0, 40),
        {"standoff": 350.0, "weights": [1, 2, 1]},
    ),
    "speed range": (([0, 900], [0, 0], (8.0, 20.0), 1.0, 30), {"standoff": 450.0}),
    "moving": (([0, 2000, 5, -3], [0, 0], 12.0, 10.0, 60), {"standoff": 400.0}),
    "moving, prior": (
        ([0, 3000, -6, 2], [0, 0], 10.0, 10.0, 50),
        {"standoff": 800.0, "prior": [1e4, 1e4, 5.0, 5.0]},
    ),
    "two legs": (([0, 600, 4, 6], [0, 0], 15.0, 2.0, 50), {"standoff": 250.0, "legs": 2}),
    "three legs": (([0, 400, -5, 5], [0, 0], 20.0, 1.0, 60), {"standoff": 320.0, "legs": 3}),
    "four legs": (
        ([0, 1500, 8, 0], [0, 0], 16.0, 5.0, 60),
        {"standoff": 500.0, "legs": 4, "keep_out": [[300, 400, 200]]},
    ),
}
SIGMA = 0.01


class Numpy:
    """Cost and constraints of a scene with their derivatives, in numpy."""

    def __init__(self, given: tuple[Any, ...], options: dict[str, Any]) -> None:
        target, start, speed, self.dt, samples = given
        self.states = np.atleast_2d(np.asarray(target, dtype=float))
        self.n = self.states.shape[1]
        self.start = np.asarray(start, dtype=float)
        self.slow, self.fast = speed if isinstance(speed, tuple) else (speed, speed)
        self.moves = samples - 1
        weights = np.asarray(options.get("weights", np.ones(len(self.states))), dtype=float)
        self.weights = weights / weights.sum()
        nearest = np.hypot(*(self.states[:, :2] - self.start).T).min()
        self.standoff = options.get("standoff", min(self.fast * self.dt, nearest / 2))
        self.discs = np.reshape(options.get("keep_out", []), (-1, 3))
        prior = options.get("prior")
        self.prior = np.zeros((self.n,) * 2) if prior is None else np.diag(1 / np.square(prior))
        self.times = self.dt * np.arange(samples)
        self.legs = options.get("legs")

    def path(self, headings: Array, speeds: Array) -> Array:
        moves = self.dt * speeds[:, None] * np.stack([np.sin(headings), np.cos(headings)], axis=1)
        return np.concatenate([self.start[None], self.start + np.cumsum(moves, axis=0)])

    def track(self, state: Array) -> Array:
        velocity = state[2:] if self.n == 4 else np.zeros(2)
        return state[:2] + self.times[:, None] * velocity

    def cost(self, path: Array) -> tuple[float, Array]:
        """Return minus the expected log det, and its derivatives by the places."""
        total, pull = 0.0, np.zeros_like(path)
        for state, weight in zip(self.states, self.weights, strict=True):
            x, y = (self.track(state) - path).T
            squared = x * x + y * y
            place = np.stack([y, -x], axis=1) / (SIGMA * squared[:, None])
            rows = place if self.n == 2 else np.hstack([place, self.times[:, None] * place])
            information = rows.T @ rows + self.prior
            sign, value = np.linalg.slogdet(information)
            if sign <= 0:
                return 1e6, pull
            through = rows @ np.linalg.inv(information)
            a = through[:, 0] + (self.times * through[:, 2] if self.n == 4 else 0)
            b = through[:, 1] + (self.times * through[:, 3] if self.n == 4 else 0)
            both = 2 * (a * y - b * x) / squared
            one = np.stack([b + both * x, both * y - a], axis=1)
            pull -= weight * 2 * one / (SIGMA * squared[:, None])
            total -= weight * float(value)
        return total, pull

    def limits(self, path: Array) -> tuple[Array, list[tuple[int, float, Array]]]:
        """Return clearances, and for each the step, its share and the derivative there."""
        values, slopes = [], []
        for state in self.states:
            away = path[1:] - self.track(state)[1:]
            values.append((away**2).sum(axis=1) / self.standoff**2 - 1)
            slopes += [(k, 1.0, 2 * a / self.standoff**2) for k, a in enumerate(away)]
        for east, north, radius in self.discs:
            step = path[1:] - path[:-1]
            start = path[:-1] - [east, north]
            part = -(start * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-300)
            part = np.clip(part, 0, 1)
            away = start + part[:, None] * step
            values.append((away**2).sum(axis=1) / radius**2 - 1)
            slopes += [
                (k, p, 2 * a / radius**2) for k, (p, a) in enumerate(zip(part, away, strict=True))
            ]
        return np.concatenate(values), slopes


def brute(scene: Numpy, seconds: float, seed: int) -> tuple[float, int]:
    """Return the best log det of a search from random paths, and the starts it took."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(seed)
    ends = time.process_time() + seconds  # no less when other work is on the machine
    best, starts = -np.inf, 0
    free_speed = scene.slow < scene.fast
    while time.process_time() < ends:
        starts += 1
        legs = scene.legs or int(rng.integers(1, 7))
        cuts = np.sort(rng.choice(np.arange(1, scene.moves), legs - 1, replace=False))
        counts = np.diff(np.concatenate([[0], cuts, [scene.moves]]))
        leg = np.repeat(np.arange(legs), counts)
        first = rng.uniform(-np.pi, np.pi, legs)
        if scene.legs is None:
            first, leg = first[leg], np.arange(scene.moves)
        k = len(first)
        x0 = np.concatenate([first, np.full(k, 1.0)]) if free_speed else first

        def unpack(x: Array, k: int = k, leg: NDArray[np.intp] = leg) -> tuple[Array, Array]:
            speeds = scene.fast * (x[k:] if free_speed else np.ones(k))
            return x[:k][leg], speeds[leg]

        def back(x: Array, step_pull: Array, leg: Any = leg, k: int = k) -> Array:
            headings, speeds = unpack(x)
            sin, cos = np.sin(headings), np.cos(headings)
            turn = scene.dt * speeds * (step_pull[:, 0] * cos - step_pull[:, 1] * sin)
            out = np.bincount(leg, turn, k)
            if free_speed:
                length = scene.dt * scene.fast * (step_pull[:, 0] * sin + step_pull[:, 1] * cos)
                out = np.concatenate([out, np.bincount(leg, length, k)])
            return out

        def cost(x: Array) -> tuple[float, Array]:
            value, pull = scene.cost(scene.path(*unpack(x)))
            return value, back(x, np.cumsum(pull[::-1], axis=0)[::-1][1:])

        def clear(x: Array) -> Array:
            return scene.limits(scene.path(*unpack(x)))[0] - 1e-8

        def clear_slope(x: Array) -> Array:
            _, slopes = scene.limits(scene.path(*unpack(x)))
            rows = []
            for step, part, slope in slopes:
                pull = np.zeros((scene.moves, 2))
                pull[:step] = slope
                pull[step] = part * slope
                rows.append(back(x, pull))
            return np.array(rows)

        bounds = [(None, None)] * k + [(scene.slow / scene.fast, 1.0)] * (k if free_speed else 0)
        done = minimize(
            cost, x0, jac=True, method="SLSQP", bounds=bounds if free_speed else None,
            constraints=[{"type": "ineq", "fun": clear, "jac": clear_slope}],
            options={"maxiter": 300, "ftol": 1e-8},
        )  # fmt: skip
        if clear(done.x).min() > -2e-8 and -done.fun > best and done.fun < 1e5:
            best = -float(done.fun)
    return best, starts


def main() -> None:
    """Print a line for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--minutes", type=float, default=1 / 3, help="processor time of the brute force a scene"
    )
    parser.add_argument("--scene", type=int, nargs="+", help="only these, from 1 on")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    gm.set_threads(1)
    head = f"{'scene':<24} {'plan':>10} {'s':>6} {'brute':>10} {'starts':>7}"
    print(f"{head} {'gap %':>8} {'bound %':>8}")
    for number, (name, (given, options)) in enumerate(SCENES.items(), 1):
        if asked.scene and number not in asked.scene:
            continue
        began = time.monotonic()
        plan = gm.maneuver.plan(*given, sigma=SIGMA, seed=asked.seed, bound=False, **options)
        took = time.monotonic() - began
        full = gm.maneuver.plan(*given, sigma=SIGMA, seed=asked.seed, **options)
        best, starts = brute(Numpy(given, options), 60 * asked.minutes, asked.seed)
        n = len(plan.names)
        gap = 100 * (1 - np.exp((plan.value - max(best, plan.value)) / n))
        if best < plan.value:
            gap = -100 * (1 - np.exp((best - plan.value) / n))
        print(
            f"{name:<24} {plan.value:10.5f} {took:6.2f} {best:10.5f} {starts:7d} {gap:8.3f} "
            f"{100 * (full.gap - 1):8.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
