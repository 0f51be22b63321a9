"""How often runs of an honest estimator are flagged: at most one in a hundred.

    python benches/monte_carlo_flags.py [--seeds 200] [--trials 300]

The estimator is the maximum likelihood of linear problems of 1, 4 and 9 states, drawn without
a call per trial, and the library's own on the easy scene of `gramian demo`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import gramian as gm
from gramian.monte_carlo.report import report


@dataclass(frozen=True)
class Linear(gm.monte_carlo.Experiment):
    """Normal errors with the covariance of the bound."""

    states: int = 4

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(f"x{i}" for i in range(self.states))

    @property
    def truth(self) -> Any:
        """True states."""
        return np.zeros(self.states)

    def simulate(self, seed: int, first: int, trials: int) -> Any:
        """Return measurements that are the states with noise of 1."""
        return gm.monte_carlo.normals(seed, first, trials, self.states)

    def problem(self) -> gm.Problem:
        """Return the problem of one measurement of each state."""
        return gm.Problem(np.eye(self.states), self.names)


def flagged(result: Any) -> bool:
    """Return whether a report says anything but that all is well."""
    page = report(result, title="", subtitle="")
    unfair = "NO" in dict(page.facts)["is it unbiased?"]
    return page.headline != "REACHES THE BOUND" or unfair or not result.nees.consistent


def main() -> None:
    """Count flagged runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--trials", type=int, default=300)
    given = parser.parse_args()
    for states in (1, 4, 9):
        found = sum(
            flagged(
                gm.monte_carlo.run(
                    Linear(states), given.trials, seed, lambda z: (z, np.eye(len(z)))
                )
            )
            for seed in range(given.seeds)
        )
        print(f"linear, {states} states: {found} of {given.seeds} runs flagged")
    from gramian.scenario import load

    scene = load(Path(gm.__file__).parent / "demo" / "1_easy.toml")
    heads = [scene.simulate(given.trials, seed, progress=False) for seed in range(given.seeds)]
    found = sum(
        page.headline != "REACHES THE BOUND" or any(text.startswith("NO") for _, text in page.facts)
        for page in heads
    )
    print(f"demo/1_easy.toml: {found} of {given.seeds} runs flagged")


if __name__ == "__main__":
    main()
