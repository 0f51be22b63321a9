"""Bounds on what an estimator can reach: of rows, and of a state that moves.

- `crlb`, `crlb_std`: the Cramer-Rao bound of rows or of a `gramian.Problem`.
- `gram`: the Fisher information of rows.
- `posterior`: the posterior bound of a filter over time, a `PosteriorBound`.
- `Posterior`: the same one instant at a time, with `predict` and `update`.
- `barankin`, `weiss_weinstein`: bounds that know of other solutions, the second as a
  `WeissWeinstein`; `threshold`: the noise at which the local bound fails, a `Threshold`.
- `expected_rows`, `expected_transition`, `cubature_points`: rows and transitions of
  random states, for `posterior`.
"""

from gramian.bounds._posterior import (
    Posterior,
    PosteriorBound,
    cubature_points,
    expected_rows,
    expected_transition,
    posterior,
)
from gramian.bounds._rows import crlb, crlb_std, gram
from gramian.bounds._threshold import (
    Threshold,
    WeissWeinstein,
    barankin,
    threshold,
    weiss_weinstein,
)

__all__ = [
    "Posterior",
    "PosteriorBound",
    "Threshold",
    "WeissWeinstein",
    "barankin",
    "crlb",
    "crlb_std",
    "cubature_points",
    "expected_rows",
    "expected_transition",
    "gram",
    "posterior",
    "threshold",
    "weiss_weinstein",
]


def __dir__() -> list[str]:
    return sorted(__all__)
