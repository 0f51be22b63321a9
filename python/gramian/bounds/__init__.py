"""Bounds on what an estimator can reach: of rows, and of a state that moves.

`crlb`, `crlb_std` and `gram` take rows; `posterior` follows a state in time, with
`Posterior` step by step, `expected_rows` and `expected_transition` for random states.
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

__all__ = [
    "Posterior",
    "PosteriorBound",
    "crlb",
    "crlb_std",
    "cubature_points",
    "expected_rows",
    "expected_transition",
    "gram",
    "posterior",
]
