"""The built-in experiments: what is simulated and estimated wholly in Rust."""

from gramian.monte_carlo.models.bearings import Bearings
from gramian.monte_carlo.models.dipole import Dipole
from gramian.monte_carlo.models.registration import Registration

__all__ = ["Bearings", "Dipole", "Registration"]
