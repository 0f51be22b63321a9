"""What every picture is drawn with."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import GramianError

try:
    from matplotlib.figure import Figure
except ImportError as error:  # pragma: no cover - without the extra
    raise GramianError("pictures need matplotlib: pip install 'gramian[plot]'") from error

__all__ = ["COLORS", "Figure", "ellipse", "ellipsoid", "equal_space", "figure"]

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


class Picture(Figure):
    """A figure that a notebook shows by itself, whether or not pyplot was imported."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=self.dpi)
        return buffer.getvalue()


def figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """Return an empty figure in the house style."""
    return Picture(figsize=(width, height), layout="constrained", dpi=110)


def ellipse(covariance: Array, probability: float) -> Array:
    """Return the outline (200, 2) of the region that holds a normal error with this probability."""
    values, vectors = np.linalg.eigh(covariance)
    # Two degrees of freedom: the chi-square quantile has a closed form.
    radius = np.sqrt(-2 * np.log1p(-probability))
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline: Array = (vectors @ (radius * np.sqrt(np.maximum(values, 0))[:, None] * circle)).T
    return outline


#: Chi-square of three degrees of freedom at 95 %, root.
_RADIUS_95 = 2.7954834829151074


def ellipsoid(covariance: Array) -> list[Array]:
    """Return the three principal outlines (100, 3) of the region that holds 95 % of errors."""
    values, vectors = np.linalg.eigh(covariance)
    axes = _RADIUS_95 * np.sqrt(np.maximum(values, 0)) * vectors
    angle = np.linspace(0, 2 * np.pi, 100)
    return [
        np.outer(np.cos(angle), axes[:, i]) + np.outer(np.sin(angle), axes[:, j])
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]


def equal_space(axes: Any, points: Array) -> None:
    """Show all points (k, 3) with one scale on the three axes, but none flatter than 1 : 2."""
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.maximum(high - low, (high - low).max() / 2)
    span = np.where(span > 0, span, 1.0) * 1.1
    middle = (low + high) / 2
    axes.set(
        xlim=(middle[0] - span[0] / 2, middle[0] + span[0] / 2),
        ylim=(middle[1] - span[1] / 2, middle[1] + span[1] / 2),
        zlim=(middle[2] - span[2] / 2, middle[2] + span[2] / 2),
    )
    axes.set_box_aspect(span, zoom=0.92)
    for axis, width in zip("xyz", span, strict=True):
        axes.locator_params(axis=axis, nbins=6 if width > 0.7 * span.max() else 4)
    axes.tick_params(labelsize="small")
