"""Pictures of results; needs matplotlib (``pip install gramian[plot]``).

Every function returns a `matplotlib.figure.Figure` of its own, never touches
pyplot's state, and so works in a notebook, a script and a server alike.

- `observability`, `singular_values`, `null_space`: the result of `gramian.analyze`.
- `figure`, `ellipse`, `COLORS`: what the pictures of the models are drawn with.
"""

from gramian.plot._observability import null_space, observability, singular_values
from gramian.plot._style import COLORS, Figure, ellipse, figure

__all__ = [
    "COLORS",
    "Figure",
    "ellipse",
    "figure",
    "null_space",
    "observability",
    "singular_values",
]


def __dir__() -> list[str]:
    return sorted(__all__)
