"""Pictures of results; needs matplotlib (``pip install gramian[plot]``).

Every function returns a `matplotlib.figure.Figure` of its own, never touches
pyplot's state, and so works in a notebook, a script and a server alike.

- `corner`: the bound, or an estimate, of chosen states in pairs.
- `estimate`, `threshold`: residuals and region of an estimate; local and global bound.
- `observability`, `singular_values`, `null_space`: the result of `gramian.analyze`.
- `figure`, `ellipse`, `ellipsoid`, `equal_space`, `COLORS`: for the pictures of the models.
"""

from gramian.plot._corner import corner
from gramian.plot._estimate import estimate, threshold
from gramian.plot._observability import null_space, observability, singular_values
from gramian.plot._style import COLORS, Figure, ellipse, ellipsoid, equal_space, figure

__all__ = [
    "COLORS",
    "Figure",
    "corner",
    "ellipse",
    "ellipsoid",
    "equal_space",
    "estimate",
    "figure",
    "null_space",
    "observability",
    "singular_values",
    "threshold",
]


def __dir__() -> list[str]:
    return sorted(__all__)
