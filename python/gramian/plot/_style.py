"""What every picture is drawn with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import GramianError

try:
    from matplotlib.figure import Figure
except ImportError as error:  # pragma: no cover - without the extra
    raise GramianError("pictures need matplotlib: pip install 'gramian[plot]'") from error

__all__ = ["COLORS", "Figure", "ellipse", "figure"]

Array = NDArray[np.float64]

#: Colours that colour-blind readers can distinguish (Okabe & Ito).
COLORS = {
    "observer": "#0072B2",
    "target": "#D55E00",
    "good": "#009E73",
    "weak": "#E69F00",
    "bad": "#CC3311",
    "muted": "#999999",
}


def figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """Return an empty figure in the house style."""
    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def ellipse(covariance: Array, probability: float) -> Array:
    """Return the outline (200, 2) of the region that holds a normal error with this probability."""
    values, vectors = np.linalg.eigh(covariance)
    # Two degrees of freedom: the chi-square quantile has a closed form.
    radius = np.sqrt(-2 * np.log1p(-probability))
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline: Array = (vectors @ (radius * np.sqrt(np.maximum(values, 0))[:, None] * circle)).T
    return outline
