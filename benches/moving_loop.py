"""The closed loop on moving targets: coverage of the regions, and plans against laws.

    python benches/moving_loop.py                  # coverage: 1000 trials of each law
    python benches/moving_loop.py --plans 40       # and 40 trials of plans on the far scene

Coverage: a target 20 steps away whose speed and course are unknown, drawn anew in each trial as
they are thought beforehand: 95 % likelihood regions of its four states must hold the truth in
93-97 % of the trials. For comparison the same for one truth, which is nearer to what is thought
than most: the regions, which count that as a measurement, then hold it more often.

The far scene: a target at (0, 4000) m that moves at (4, -2) m/s, an observer at 20 m/s, 60
bearings of 0.5 degrees every 10 s. Final errors and the time until the error stays below 10 % of
the range, on the same noise for all, with standard errors; the plan's over the best law's.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import gramian as gm

NEAR = ([0.0, 0.0], 20.0, 1.0, 60)
ONE = [0.0, 400.0, -5.0, 5.0]
#: Mean and deviation of the range, m, and of each component of the velocity, m/s, as thought.
RANGE, SPEED = (400.0, 80.0), 7.0
FAR = ([0.0, 4000.0, 4.0, -2.0], [0.0, 0.0], 20.0, 10.0, 60)
LAWS = ("max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular")


def interval(values: np.ndarray, seed: int = 0) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the median."""
    draws = np.random.default_rng(seed).choice(values, (2000, len(values)))
    low, high = np.quantile(np.median(draws, axis=1), [0.025, 0.975])
    return float(low), float(high)


def truths(trials: int, seed: int) -> np.ndarray:
    """Return targets (trials, 4) as they are thought beforehand, due north of the start."""
    rng = np.random.default_rng(seed)
    ranges = rng.normal(*RANGE, trials)
    while (near := ranges < 110.0).any():  # outside of the stand-off range
        ranges[near] = rng.normal(*RANGE, near.sum())
    velocities = rng.normal(0.0, SPEED, (trials, 2))
    return np.column_stack([np.zeros(trials), ranges, velocities])


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--plans", type=int, default=0, help="trials of plans on the far scene")
    parser.add_argument("--replan", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, target in (("as thought", truths(asked.trials, asked.seed)), ("one truth", ONE)):
        began = time.monotonic()
        near = gm.maneuver.closed_loop(
            target, *NEAR, sigma=np.radians(0.5), first_range=RANGE, first_speed=SPEED,
            standoff=100.0, methods=LAWS, trials=asked.trials, seed=asked.seed,
        )  # fmt: skip
        took = time.monotonic() - began
        print(f"20 steps away, {name}, {asked.trials} trials, {took:.1f} s")
        for run in near.runs:
            share = run.coverage()
            print(
                f"{run.method:>14}  in 95 %: {100 * share[-1]:.1f} at the end, "
                f"{100 * share[29]:.1f} after 30   final rms {run.final_rms:.3g} m, "
                f"believed {np.sqrt((run.believed[:, -1] ** 2).mean()):.3g} m"
            )
    if not asked.plans:
        return
    began = time.monotonic()
    far = gm.maneuver.closed_loop(
        *FAR, sigma=np.radians(0.5), first_range=(4000.0, 1500.0), first_speed=5.0,
        standoff=400.0, methods=("plan", "plan_estimate", *LAWS), trials=asked.plans,
        replan=asked.replan, seed=asked.seed,
    )  # fmt: skip
    print(f"far scene, {asked.plans} trials, {time.monotonic() - began:.0f} s")
    for run in far.runs:
        times = run.time_to(0.1)
        low, high = interval(times)
        print(
            f"{run.method:>14}  final rms {run.final_rms:7.3g} +- {run.uncertainty:.2g} m   "
            f"median {run.final_median:6.3g} m   to 10 %: {np.median(times):.0f} s "
            f"({low:.0f}-{high:.0f})   in 95 %: {100 * run.coverage()[-1]:.0f}"
        )
    best = min((run for run in far.runs if run.method in LAWS), key=lambda run: run.final_rms)
    ratio = far["plan"].final_rms / best.final_rms
    print(f"plan over {best.method}: {ratio:.2f} in the final error")


if __name__ == "__main__":
    main()
