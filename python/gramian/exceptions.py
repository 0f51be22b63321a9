"""The errors of gramian: each says what was given, what is wanted and where."""

from __future__ import annotations

__all__ = [
    "ConvergenceError",
    "GramianError",
    "InputError",
    "ScenarioError",
    "StorageError",
    "UnobservableError",
    "WorkerError",
]


class GramianError(Exception):
    """Base of all errors of this package."""


class InputError(GramianError, ValueError):
    """Something that was given cannot be used: its value, shape or name."""


class ScenarioError(InputError):
    """An error in a scenario file or in a file that it names."""


class StorageError(GramianError, OSError):
    """A result could not be written: a full disk, for one."""


class UnobservableError(GramianError, ArithmeticError):
    """The result does not exist, because the measurements do not determine it.

    Attributes
    ----------
    null_combinations : tuple of str
        The combinations of states that no measurement sees.
    """

    def __init__(self, message: str, null_combinations: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.null_combinations = null_combinations


class ConvergenceError(GramianError, ArithmeticError):
    """An iteration did not reach its answer."""


class WorkerError(GramianError, RuntimeError):
    """The workers of a run died or cannot be reached."""
