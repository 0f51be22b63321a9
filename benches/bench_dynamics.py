"""Sliding windows along a nonlinear trajectory, beside pybounds: its own two examples."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pybounds_examples as examples
from harness import OURS, Case, Contest, Contestant, main


def data_of(example: str, windows: int) -> tuple[str, Any, Any, int]:
    """Name, times, inputs and the samples of a window."""
    *_, inputs, _, _, _, span = examples.EXAMPLES[example]
    width = round(span / examples.DT) // 5
    t = examples.DT * np.arange(windows + width - 1)
    return example, t, inputs(t), width


def ours(data: Any) -> Callable[[], Any]:
    return lambda: examples.ours(*data)[1].std


def pybounds(data: Any) -> Callable[[], Any]:
    """Central differences of simulations; its simulator is made beforehand and not timed."""
    from pybounds import Simulator

    example, t, u, width = data
    f, h, _, names, _, sigma, _ = examples.EXAMPLES[example]
    states = examples.ours(*data)[0].states
    simulator = Simulator(
        f, h, dt=examples.DT, state_names=names,
        input_names=[f"u{k}" for k in range(u.shape[1])],
        measurement_names=[f"y{k}" for k in range(len(sigma))],
        params_simulator={
            "integration_tool": "idas", "abstol": 1e-12, "reltol": 1e-12, "t_step": examples.DT,
        },
    )  # fmt: skip

    def work() -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return examples.theirs(simulator, t, states, u, names, width, 1e-5, sigma, 1e-12)

    return work


def camera_bounds(t: Any, u: Any, width: int) -> Any:
    """The camera's bounds with 40 digits: g(t) = g0 + the sum of held inputs, y = g / d."""
    import mpmath as mp

    with mp.workdps(40):
        dt, sigma = mp.mpf(examples.DT), mp.mpf(examples.EXAMPLES["camera"][5][0])
        speed, height = (mp.mpf(x) for x in examples.EXAMPLES["camera"][4])
        speeds = [speed]
        for value in u[:-1, 0]:
            speeds.append(speeds[-1] + dt * mp.mpf(float(value)))
        out = []
        for first in range(len(t) - width + 1):
            information = mp.zeros(2)
            for g in speeds[first : first + width]:
                row = [1 / height / sigma, -g / height**2 / sigma]
                for i in range(2):
                    for j in range(2):
                        information[i, j] += row[i] * row[j]
            bound = information**-1
            out.append([float(mp.sqrt(bound[i, i])) for i in range(2)])
        return np.array(out)


def contest(example: str, windows: int) -> Contest:
    """Deviations of all states in every window."""
    small = data_of("camera", 4)

    def error(found: Any) -> float:
        wanted = camera_bounds(*small[1:])
        return float(np.abs(np.asarray(found)[: len(wanted)] / wanted - 1).max())

    return Contest(
        f"windows along a trajectory: {example}",
        "window",
        float(windows),
        data_of(example, windows),
        [
            Contestant(OURS, ours),
            Contestant("pybounds, sliding windows", pybounds, part=float(windows)),
        ],
        cases={"well": Case(small, error)},
        note="The trajectory is integrated in the time of ours. Error: the camera's bounds against "
        "arithmetic of 40 digits.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    for example in examples.EXAMPLES:
        yield contest(example, 4 if quick else 20)


if __name__ == "__main__":
    main(contests)
