"""What a set of measurements can and cannot determine, how accurately, and what to do about it.

Every question is asked of one array, the whitened Jacobian rows (d h / d x) / sigma,
shape (K, n). A model makes rows; `analyze` says what they determine.

- `analyze` answers with an `Observability`: rank, null space, bounds, and a `Suggestion`
  for each piece of knowledge that would help; it ranks each `Candidate` for a further
  measurement, and names each `Critical` one.
- `estimate` finds the most likely state and says whether it may be believed, in an
  `Estimate`; `estimate_trials` whether such answers hold; `other_solutions` the states that
  fit as well.
- `Problem` is rows with names and units; `from_function` makes a `Model` of your own
  h(x), with rows of known `Accuracy`.
- `crlb`, `crlb_std` and `gram` are the bounds and the information of plain rows;
  `bounds` has those of filters too.
- The models are `bearings`, `dipole`, `inertial`, `linear`, `registration`,
  `maneuver` and `tracks`; `dynamics` makes rows along a trajectory of your own system.
- `large` has what `analyze` answers for sparse rows; `choose` says which measurements to
  add.
- `io` reads files of tracks and measurements, and pose graphs.
- `explore` opens a scene in a notebook, to drag it and see what changes.
- `monte_carlo` simulates and sets an estimator's errors beside the bound.
- `load` reads an answer that its `save` wrote.
- `set_threads` limits the threads of the kernels.

Every error is a `GramianError`: `InputError`, `UnobservableError`, `ConvergenceError`,
`ScenarioError`, `StorageError`, `WorkerError`.
"""

import typing as _typing

from gramian._core import __version__, set_threads
from gramian._registry import REGISTRY as _REGISTRY
from gramian._registry import load as _load
from gramian.exceptions import (
    ConvergenceError,
    GramianError,
    InputError,
    ScenarioError,
    StorageError,
    UnobservableError,
    WorkerError,
)

if _typing.TYPE_CHECKING:
    from gramian import bounds as bounds
    from gramian import choose as choose
    from gramian import io as io
    from gramian import large as large
    from gramian import monte_carlo as monte_carlo
    from gramian._answers import load
    from gramian.analysis import Candidate, Critical, Observability, Suggestion, analyze
    from gramian.bounds import crlb, crlb_std, gram
    from gramian.estimation import Estimate, estimate, estimate_trials, other_solutions
    from gramian.explorer import explore
    from gramian.model import Model, from_function
    from gramian.models import bearings as bearings
    from gramian.models import dipole as dipole
    from gramian.models import dynamics as dynamics
    from gramian.models import inertial as inertial
    from gramian.models import linear as linear
    from gramian.models import maneuver as maneuver
    from gramian.models import registration as registration
    from gramian.models import tracks as tracks
    from gramian.problem import Accuracy, Problem

__all__ = [
    "Accuracy",
    "Candidate",
    "ConvergenceError",
    "Critical",
    "Estimate",
    "GramianError",
    "InputError",
    "Model",
    "Observability",
    "Problem",
    "ScenarioError",
    "StorageError",
    "Suggestion",
    "UnobservableError",
    "WorkerError",
    "__version__",
    "analyze",
    "bounds",
    "choose",
    "crlb",
    "crlb_std",
    "dynamics",
    "estimate",
    "estimate_trials",
    "explore",
    "from_function",
    "gram",
    "io",
    "large",
    "load",
    "monte_carlo",
    "other_solutions",
    "set_threads",
]
__all__.extend(_REGISTRY)


# Where each name is that is imported when it is first used: numpy and the classes of the
# answers take most of the time of an import, and no program uses all of them.
_MODULES = {name: f"models.{name}" for name in (*_REGISTRY, "dynamics")}
_MODULES |= {name: name for name in ("bounds", "choose", "io", "large", "monte_carlo")}
_NAMES = {
    "_answers": ("load",),
    "analysis": ("Candidate", "Critical", "Observability", "Suggestion", "analyze"),
    "bounds": ("crlb", "crlb_std", "gram"),
    "explorer": ("explore",),
    "estimation": ("Estimate", "estimate", "estimate_trials", "other_solutions"),
    "model": ("Model", "from_function"),
    "problem": ("Accuracy", "Problem"),
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> _typing.Any:
    if name in _MODULES:
        value: _typing.Any = _load(_MODULES[name])
    elif name in _HOMES:
        value = getattr(_load(_HOMES[name]), name)
    else:
        raise AttributeError(f"module 'gramian' has no attribute {name!r}")
    # Found at once from now on: this function takes longer than a small call.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
