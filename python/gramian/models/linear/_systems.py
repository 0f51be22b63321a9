"""What a linear system is given as."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._arrays import as_float_array, finite
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = [
    "StateSpace",
    "System",
    "SystemLike",
    "Time",
    "dense",
    "matrices",
    "sampled",
    "system_of",
    "time_of",
    "whitener",
]

Array = NDArray[np.float64]

Time = Literal["continuous", "discrete"]

#: States of a system that is worked out densely.
_MOST_DENSE = 3000


class StateSpace(Protocol):
    """What SciPy's and python-control's state-space objects have in common."""

    A: Any
    C: Any


@dataclass(frozen=True, eq=False)
class System(Value):
    """A linear system with names: what `gramian.inertial` makes.

    Attributes
    ----------
    A : ndarray, shape (n, n)
    C : ndarray, shape (p, n)
    names, units : tuple of str, length n
        Of the states.
    prior : ndarray, shape (n,)
        What each state is known to beforehand, standard deviation; NaN for not at all.
    outputs : tuple of str, length p
    noise : ndarray, shape (p,)
        Standard deviation of each output; NaN where it is not known.
    combinations : mapping of str to ndarray, shape (n,)
        Named linear combinations of the states.
    """

    A: Array
    C: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    prior: Array
    outputs: tuple[str, ...]
    noise: Array
    combinations: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        finite(self.A, "A")
        finite(self.C, "C")
        for name in ("names", "units", "outputs"):
            object.__setattr__(self, name, options.names(getattr(self, name), name, "strings"))

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)


SystemLike = ArrayLike | StateSpace | System


def matrices(A: SystemLike, C: ArrayLike | None) -> tuple[Any, Any]:
    """Return A and C of whatever a system is given as."""
    if hasattr(A, "A") and hasattr(A, "C") and not isinstance(A, np.ndarray):
        if C is not None:
            raise InputError("C was given beside a state-space object, which has its own")
        return A.A, A.C
    if C is None:
        raise InputError(
            "C is missing: give A and C, or an object with both, "
            "as scipy.signal.StateSpace and control.StateSpace have"
        )
    return A, C


def time_of(A: Any, time: str = "continuous") -> Time:
    """Return whether a system is continuous or discrete: a state-space object knows."""
    chosen = options.choice(time, "time", ("continuous", "discrete"))
    return "discrete" if chosen == "discrete" or _step(A) is not None else "continuous"


def _step(A: Any) -> Any:
    """Return the attribute ``dt`` of a discrete state-space object, None of others."""
    if isinstance(A, (System, np.ndarray)) or not (hasattr(A, "A") and hasattr(A, "C")):
        return None
    dt = getattr(A, "dt", None)
    return None if dt is None or dt is False or (dt is not True and dt == 0) else dt


def sampled(A: Any, dt: float | None) -> float | None:
    """Return the time between samples: that of a discrete state-space object by default."""
    own = _step(A)
    if own is None:
        return dt
    own = 1.0 if own is True else float(own)
    if dt is None:
        return own
    # An object that is discrete at unknown times (dt = True) takes any.
    if getattr(A, "dt", None) is not True and not np.isclose(dt, own, rtol=1e-9, atol=0.0):
        raise InputError(f"dt = {dt}: the system is sampled every {own}")
    return dt


def system_of(
    A: SystemLike,
    C: ArrayLike | None,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    prior: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | None = None,
) -> System:
    """Return one system with its matrices checked and its names filled in."""
    a, c = matrices(A, C)
    a, c = _numbers(dense(a, "A"), "A"), _numbers(dense(c, "C"), "C")
    if a.ndim != 2 or a.shape[0] != a.shape[1] or a.size == 0:
        raise InputError(f"A has shape {a.shape}: must be square, a row and a column a state")
    n = len(a)
    if c.ndim != 2 or c.shape[1] != n or c.size == 0:
        raise InputError(f"C has shape {c.shape}: must be (outputs, {n}), a column a state of A")
    known = A if isinstance(A, System) else None
    checked = _names(names if names is not None else (known.names if known else None), n)
    if units is None:
        units = known.units if known else ("",) * n
    units = options.names(units, "units", "strings")
    if len(units) != n:
        raise InputError(f"units has {len(units)} entries: must have {n}, one for each state")
    std = known.prior if known else np.full(n, np.nan)
    if isinstance(prior, Mapping):
        std = std.copy()
        for name, value in options.deviations(prior, "prior").items():
            if name not in checked:
                raise InputError(f"no state is named {name!r}: the states are {', '.join(checked)}")
            std[checked.index(name)] = value
    elif prior is not None:
        std = _numbers(prior, "prior")
        if std.shape != (n,):
            raise InputError(f"prior has shape {std.shape}: must be ({n},), one for each state")
    for name, value in zip(checked, std, strict=True):
        if not (np.isnan(value) or 0 < value < np.inf):
            raise InputError(f"prior of {name} = {value}: must be > 0 and finite")
    noise = known.noise if known and R is None else np.full(len(c), np.nan)
    return System(
        A=a,
        C=c,
        names=checked,
        units=tuple(units),
        prior=std,
        outputs=known.outputs if known else tuple(f"y{i}" for i in range(len(c))),
        noise=noise,
        combinations=MappingProxyType(dict(known.combinations if known else {})),
    )


def whitener(R: ArrayLike | None, p: int, noise: Array | None = None) -> Array:
    """Return the matrix that makes outputs of covariance R white, R^-1/2.

    Without R the known deviations of the outputs count, or each is 1.
    """
    if R is None:
        if noise is None or np.isnan(noise).any():
            return np.eye(p)
        return np.diag(1 / noise)
    r = _numbers(R, "R")
    if r.ndim == 0:
        r = np.full(p, float(r))
    if r.ndim == 1:
        if r.shape != (p,):
            raise InputError(f"R has shape {r.shape}: must be ({p},) variances or ({p}, {p})")
        if (bad := np.flatnonzero(~(r > 0))).size:
            raise InputError(f"R[{bad[0]}] = {r[bad[0]]}: a variance must be > 0")
        return np.diag(1 / np.sqrt(r))
    if r.shape != (p, p) or not np.allclose(r, r.T, rtol=1e-10, atol=0):
        raise InputError(f"R has shape {r.shape}: must be a symmetric ({p}, {p}) covariance")
    if not r.size:
        raise InputError(f"R has shape {r.shape}: must not be empty")
    try:
        factor = np.linalg.cholesky(r)
    except np.linalg.LinAlgError:
        raise InputError("R is not positive definite: a covariance must be") from None
    inverse: Array = np.linalg.inv(factor)
    return inverse


def _names(names: Sequence[str] | None, n: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"x{i}" for i in range(n))
    checked = options.names(names, "names")
    if len(checked) != n:
        raise InputError(f"names has {len(checked)} entries: must have {n}, one for each state")
    if len(set(checked)) < n:
        raise InputError("names has an entry twice: each state needs its own")
    return checked


def dense(value: Any, name: str) -> Any:
    """Return a sparse matrix as an array where that is small."""
    if not hasattr(value, "tocsr"):
        return value
    if value.shape[-1] > _MOST_DENSE:
        raise InputError(
            f"{name} is sparse with {value.shape[-1]} columns, and this answer is worked out on "
            f"at most {_MOST_DENSE}, densely: `gramian.linear.modes` answers for chosen modes"
        )
    return value.toarray()


def _numbers(value: Any, name: str) -> Array:
    # A prior may be NaN for a state that has none.
    return (as_float_array if name == "prior" else finite)(value, name).copy()
