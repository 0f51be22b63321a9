"""pybounds' own example systems beside ours: values as its step goes to zero, and times.

    python benches/pybounds_examples.py [--windows 100]

The two examples of its documentation, on trajectories with given inputs: a camera that
looks down from an unknown height, and a fly in an unknown wind (parameters of its body
known). Both are given the same functions in plain Python, which take one state or many.
pybounds: central differences of whole simulations, sliding windows, the inverse of the
regularised Fisher information. Ours: `dynamics.from_ode` and `Trajectory.windows`.
Seconds of the processor, one thread; its simulator is made beforehand, and not timed.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gramian as gm

Array = NDArray[np.float64]
DT = 0.01


def camera(x: Any, u: Any) -> list[Any]:
    """Ground speed and height: van Breugel, Morgansen & Dickinson 2014."""
    return [u[0] + 0 * x[0], 0 * x[0]]


def flow(x: Any, _: Any) -> list[Any]:
    return [x[0] / x[1]]


MASS, INERTIA, DRAG, SPIN = 0.25, 0.52, 0.25 / 0.170, 27.36


def air(x: Any) -> tuple[Any, Any]:
    _, along, across, heading, _, wind, source = x
    return along - wind * np.cos(heading - source), across + wind * np.sin(heading - source)


def fly(x: Any, u: Any) -> list[Any]:
    """Height, velocity in its axes, heading, its rate, wind speed and direction."""
    _, along, across, _, rate, _, _ = x
    a, b = air(x)
    return [
        0 * along,
        (u[0] - DRAG * a) / MASS + across * rate,
        (u[1] - DRAG * b) / MASS - along * rate,
        rate,
        (u[2] - SPIN * rate) / INERTIA,
        0 * along,
        0 * along,
    ]


def senses(x: Any, _: Any) -> list[Any]:
    """Heading, course, direction of the air's flow, optic flow."""
    height, along, across, heading, *_ = x
    a, b = air(x)
    speed = np.sqrt(along**2 + across**2)
    return [heading, np.arctan2(across, along), np.arctan2(b, a), speed / height]


def inputs_of_camera(t: Array) -> Array:
    return (0.6 * np.pi * np.cos(0.6 * np.pi * t))[:, None]


def inputs_of_fly(t: Array) -> Array:
    turn = np.where((t > 0.15) & (t < 0.25), -27.36 * 12.0, 0.0)
    return np.column_stack([0.9 + 0.3 * np.sin(9 * t), 0.2 * np.cos(7 * t), turn])


EXAMPLES = {
    "camera": (camera, flow, inputs_of_camera, ["g", "d"], [0.1, 0.5], [0.1], 1.5),
    "fly in wind": (
        fly,
        senses,
        inputs_of_fly,
        ["z", "v_para", "v_perp", "phi", "phi_dot", "w", "zeta"],
        [0.2, 0.3, 0.05, np.pi / 4, 0.0, 0.4, np.pi],
        [0.1, 0.1, 0.1, 0.1],
        0.5,
    ),
}


def timed(work: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    best, answer = np.inf, None
    for _ in range(repeats):
        start = time.process_time()
        answer = work()
        best = min(best, time.process_time() - start)
    return best, answer


def ours(
    example: str, t: Array, u: Array, width: int, vectorized: bool | None = None
) -> tuple[Any, Any]:
    f, h, _, names, x0, sigma, _ = EXAMPLES[example]

    def held(when: Array) -> Array:
        # An input holds from one sample to the next, as there.
        return u[np.clip((np.asarray(when) / DT + 1e-9).astype(int), 0, len(u) - 1)].T

    path = gm.dynamics.from_ode(
        lambda when, x: np.array(f(x, held(when))),
        lambda when, x: np.array(h(x, held(when))),
        x0,
        t,
        names,
        sigma=sigma,
        vectorized=vectorized,
    )
    return path, path.windows((width - 1) * DT)


def theirs(simulator: Any, t: Array, x: Array, u: Array, names: Any, width: int, eps: float,
           sigma: Any, part: float) -> Array:  # fmt: skip
    from pybounds import SlidingEmpiricalObservabilityMatrix, SlidingFisherObservability

    sliding = SlidingEmpiricalObservabilityMatrix(
        simulator, t[:, None], dict(zip(names, x.T, strict=True)), u, w=width, eps=eps
    )
    noise = dict(zip(simulator.measurement_names, np.square(sigma).tolist(), strict=True))
    fisher = SlidingFisherObservability(
        sliding.O_df_sliding, R=noise, lam=part, time=t[: len(sliding.O_df_sliding)]
    )
    return np.sqrt(np.array([f.error_variance.to_numpy()[0] for f in fisher.FO]))


def compare(example: str, windows: int) -> None:
    from pybounds import Simulator

    f, h, inputs, names, _, sigma, span = EXAMPLES[example]
    width = round(span / DT) // 5
    t = DT * np.arange(windows + width - 1)
    u = inputs(t)
    seconds, (path, found) = timed(lambda: ours(example, t, u, width), 3)
    singly, _ = timed(lambda: ours(example, t, u, width, vectorized=False), 3)
    simulator = Simulator(
        f, h, dt=DT, state_names=names, input_names=[f"u{k}" for k in range(u.shape[1])],
        measurement_names=[f"y{k}" for k in range(len(sigma))],
        params_simulator={
            "integration_tool": "idas", "abstol": 1e-12, "reltol": 1e-12, "t_step": DT,
        },
    )  # fmt: skip
    print(f"{example}: {len(names)} states, {len(found.times)} windows of {width} samples")
    print(f"  gramian   {seconds * 1e3:9.1f} ms   ranks {sorted(set(found.rank.tolist()))}")

    def theirs_with(eps: float, part: float, count: int) -> Array:
        end = count + width - 1
        return theirs(
            simulator, t[:end], path.states[:end], u[:end], names, width, eps, sigma, part
        )

    slow, _ = timed(lambda: theirs_with(1e-5, 1e-12, len(found.times)), 1)
    print(f"  one by one{singly * 1e3:9.1f} ms   f and h are asked about one state at a time")
    print(
        f"  pybounds  {slow * 1e3:9.1f} ms   {slow / seconds:6.0f} times ours, "
        f"{slow / singly:.0f} times ours one by one",
        flush=True,
    )
    for eps, part in ((1e-2, 1e-3), (1e-3, 1e-6), (1e-4, 1e-9), (1e-5, 1e-12)):
        std = theirs_with(eps, part, min(6, len(found.times)))
        off = np.abs(std / found.std[: len(std)] - 1)
        print(
            f"    step {eps:g}, regularisation {part:g}: differs by {np.median(off):.1e} in the "
            f"middle, {off.max():.1e} at most",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=100)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    gm.set_threads(1)
    for example in EXAMPLES:
        compare(example, given.windows)


if __name__ == "__main__":
    main()
