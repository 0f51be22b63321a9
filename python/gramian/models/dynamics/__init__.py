"""Nonlinear systems x' = f(t, x), y = h(t, x) or x[k+1] = f(t[k], x[k]), given as functions.

A trajectory carries its transitions; from them come rows about the state anywhere on it,
what windows of outputs tell as they slide along it, and the bound of every filter.
`lie_derivatives` says what a point shows in the derivatives of the outputs.
"""

from gramian.models.dynamics._lie import LieDerivatives, lie_derivatives
from gramian.models.dynamics._trajectory import (
    Trajectory,
    empirical_gramian,
    from_map,
    from_ode,
    unit_norm,
)
from gramian.models.dynamics._windows import Windows

__all__ = [
    "LieDerivatives",
    "Trajectory",
    "Windows",
    "empirical_gramian",
    "from_map",
    "from_ode",
    "lie_derivatives",
    "unit_norm",
]
