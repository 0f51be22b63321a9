"""Do the intervals of `dipole.localize` hold the truth as often as they say?

    python benches/dipole_coverage.py [--trials 60] [--only TEXT] [--seed 0]

One line a case: how often the 95 % intervals of range, speed, moment, x0 and mx hold the
truth, and the likelihood region of all states; the normalized squared error (NEES) over the
number of states, in the metric of the local covariance, and in that of the states spread as
the likelihood is (`Estimate.sample`); the rise of chi2 at the truth over the number of
states. Where there is a prior the truth is drawn from it. The claims are those of 500 trials.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import gramian as gm

R0, V, M = np.array([-10.0, -10.0, 5.0]), np.array([1.0, 1.0, 0.0]), np.array([10.0, 20.0, 10.0])
STATE = np.concatenate([R0, V, M])
KNOWN = {"z": 5.0, "vz": 0.0}
FUNCTIONS = ("range", "speed", "moment", "x0", "mx")
NAMES = gm.dipole.NAMES
SIGMA = 1e-9


@dataclass
class Case:
    """What is simulated and what is told to `localize`."""

    samples: int = 21
    step: float = 1.0
    known: dict[str, float] = field(default_factory=dict)
    #: Name of a size or component, and its deviation over its value.
    prior: tuple[str, float] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    outliers: float = 0.0
    correlation: float = 0.0
    background: bool = False
    sigma: float | None = SIGMA

    @property
    def times(self) -> np.ndarray:
        """Instants of the samples, centred as those of the paper's Table 1."""
        return 10.0 + self.step * (np.arange(self.samples) - (self.samples - 1) / 2)


def drawn(case: Case, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, Any]]:
    """Return a true state and the prior that it is drawn from."""
    state = STATE.copy()
    # The state is that of the first time.
    state[:3] += case.times[0] * V
    if case.prior is None:
        return state, {}
    name, share = case.prior
    factor = 1 + share * rng.normal()
    part = {"moment": slice(6, 9), "speed": slice(3, 6)}.get(name)
    if part is None:
        part = slice(NAMES.index(f"{name}0"), NAMES.index(f"{name}0") + 1)
        mean = float(state[part][0])
    else:
        mean = float(np.linalg.norm(state[part]))
    state[part] *= factor
    return state, {name: (mean, share * abs(mean))}


def recorded(case: Case, state: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the fields (K, 3) of a state with the case's noise."""
    y = gm.dipole.measure(state[:3], state[3:6], state[6:], case.times)
    noise = rng.normal(size=y.shape)
    for k in range(1, len(noise)):
        noise[k] *= np.sqrt(1 - case.correlation**2)
        noise[k] += case.correlation * noise[k - 1]
    wild = rng.random(y.shape) < case.outliers
    noise[wild] += rng.normal(size=wild.sum()) * 15
    if case.background:
        y = y + np.array([2e-5, -1e-6, 4.5e-5])
    return y + SIGMA * noise


def truth(name: str, state: np.ndarray) -> float:
    """Return the true value of a function."""
    if name == "speed":
        return float(np.linalg.norm(state[3:6]))
    if name == "moment":
        return float(np.linalg.norm(state[6:]))
    if name == "range":
        r, v = state[:3], state[3:6]
        return float(np.linalg.norm(r - (r @ v) / (v @ v) * v))
    return float(state[NAMES.index(name)])


CASES: dict[str, Case] = {
    "z and vz known": Case(known=KNOWN),
    "speed known": Case(known={"speed": float(np.sqrt(2))}),
    "prior of 3 % on the moment": Case(prior=("moment", 0.03)),
    "prior of 10 % on the moment": Case(prior=("moment", 0.1)),
    "prior of 30 % on the moment": Case(prior=("moment", 0.3)),
    "prior of 4 % on z": Case(prior=("z", 0.04)),
    "prior of 3.5 % on the speed": Case(prior=("speed", 0.035)),
    "median, short record": Case(known=KNOWN, background=True, options={"background": "median"}),
    "fit, short record": Case(known=KNOWN, background=True, options={"background": "fit"}),
    "sigma estimated": Case(known=KNOWN, sigma=None),
    "sigma estimated, 7 samples": Case(samples=7, step=3.0, known=KNOWN, sigma=None),
    "Huber, 5 % outliers": Case(
        samples=101, step=0.2, known=KNOWN, outliers=0.05, options={"loss": "huber"}
    ),
    "Huber, 20 % outliers": Case(
        samples=101, step=0.2, known=KNOWN, outliers=0.2, options={"loss": "huber"}
    ),
    "Huber, 20 % outliers, sigma estimated": Case(
        samples=101, step=0.2, known=KNOWN, outliers=0.2, options={"loss": "huber"}, sigma=None
    ),
    "correlation 0.9 given": Case(
        samples=201, step=0.1, known=KNOWN, correlation=0.9, options={"correlation": 0.9}
    ),
    "correlation 0.9 fitted": Case(
        samples=201,
        step=0.1,
        known=KNOWN,
        correlation=0.9,
        options={"correlation": "fit"},
        sigma=None,
    ),
    "correlation 0.9 fitted, background": Case(
        samples=401,
        step=0.1,
        known=KNOWN,
        correlation=0.9,
        background=True,
        options={"correlation": "fit", "background": "fit"},
        sigma=None,
    ),
}


def measured(
    case: Case, trials: int, seed: int, intervals: bool = True, samples: int = 200
) -> dict[str, Any]:
    """Return what is told of a case."""
    names = [name for name in FUNCTIONS if name not in case.known]
    held: Counter[str] = Counter()
    status: Counter[str] = Counter()
    local, spread, rise = [], [], []
    for trial in range(trials):
        rng = np.random.default_rng((seed, trial))
        state, prior = drawn(case, rng)
        y = recorded(case, state, rng)
        answer = gm.dipole.localize(
            case.times, y, case.known, prior=prior, sigma=case.sigma, **case.options
        )
        status[answer.status] += 1
        for name in names if intervals else ():
            held[name] += truth(name, state) in answer.interval(name)
        here, image = answer, answer.mirror
        passes = [np.concatenate([here.r0, here.v, here.m])]
        if image is not None:
            passes.append(np.concatenate([image.r0, image.v, image.m]))
        free = [k for k, name in enumerate(NAMES) if answer.pass_std[k] > 0]
        # Of two images that fit the same, the one that is meant.
        side = int(np.argmin([np.linalg.norm(p[:3] - state[:3]) for p in passes]))
        sign = np.array([1.0] * 9 if side == 0 else [-1.0] * 6 + [1.0] * 3)
        rank = len(answer.model.coordinates(state)) - (3 if answer.model.background else 0)
        off = sign * (state - passes[side])
        inverse = np.linalg.pinv(answer.pass_covariance[np.ix_(free, free)], 1e-13, True)
        local.append(off[free] @ inverse @ off[free] / rank)
        cloud = answer.sample_passes(samples, trial)
        middle, covariance = cloud.mean(axis=0), np.cov(cloud.T)
        off = sign * state - middle
        inverse = np.linalg.pinv(covariance[np.ix_(free, free)], 1e-13, True)
        # The inverse of a sampled covariance is too large by this.
        shrink = (samples - rank - 2) / (samples - 1)
        spread.append(shrink * off[free] @ inverse @ off[free] / rank)
        if not answer.model.background:
            at_truth = answer.model.coordinates(state)
            left = answer._handle.linearize(at_truth)[0]
            at_best = answer._handle.linearize(answer.state)[0]
            rise.append((left @ left - at_best @ at_best) / rank)
    return {
        "held": {name: 100 * held[name] / trials for name in names if intervals},
        "local": (float(np.median(local)), float(np.mean(local))),
        "spread": (float(np.median(spread)), float(np.mean(spread))),
        "rise": float(np.mean(rise)) if rise else np.nan,
        "status": dict(status),
    }


def line(name: str, found: dict[str, Any], inside: Callable[[float], bool]) -> str:
    """Return a case as text, what is outside the limits marked."""
    held = "  ".join(
        f"{what} {share:.1f}{'' if inside(share) else ' !'}"
        for what, share in found["held"].items()
    )
    return (
        f"{name}: {held} %; NEES/n local {found['local'][0]:.2f} (median) "
        f"{found['local'][1]:.2f} (mean), spread {found['spread'][1]:.2f}, rise "
        f"{found['rise']:.2f}; {found['status']}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    # Two deviations of the count beside the limits of the claim.
    slack = 200 * np.sqrt(0.95 * 0.05 / options.trials) if options.trials < 500 else 0.0
    for name, case in CASES.items():
        if options.only in name:
            found = measured(case, options.trials, options.seed)
            print(line(name, found, lambda x: 93 - slack <= x <= 97 + slack), flush=True)


if __name__ == "__main__":
    main()
