"""Linear systems x' = A x, y = C x: what their outputs tell of the state, and how well.

Every function takes A and C as arrays, or in place of A a state-space object of
SciPy or python-control (anything with attributes ``A`` and ``C``), or a `System`.

- `levels`, `batch_levels`: what the output and each derivative determine, as `Levels` and
  `BatchLevels`; `observability_matrix`.
- `degree`, `information`: how well, as `Degree` and `Information`.
- `problem`, `rows`: the whitened rows of a window of samples, for `gramian.analyze`;
  `gramian`, their information; `transition`.
- `distance`: how far the nearest unobservable system is, a `Distance`; `unobservable`: what
  is not seen, as an `Unobservable` with its `Mode` objects; `modes`: whether chosen modes of
  a sparse system of up to 10^5 states are seen, as `Modes`.
- `gramian_factor`, `split_gramian`, `hankel`: Gramians over all time, as `SplitGramian` and
  `Hankel`.
- `piecewise`: systems that are constant by segments, as `Piecewise`.
"""

from gramian.models.linear._degrees import Degree, Information, degree, information
from gramian.models.linear._infinite import (
    Hankel,
    SplitGramian,
    gramian_factor,
    hankel,
    split_gramian,
)
from gramian.models.linear._levels import (
    BatchLevels,
    Levels,
    batch_levels,
    levels,
    observability_matrix,
)
from gramian.models.linear._pencil import Distance, Mode, Unobservable, distance, unobservable
from gramian.models.linear._sparse import Modes, modes
from gramian.models.linear._systems import System
from gramian.models.linear._windows import Piecewise, gramian, piecewise, problem, rows, transition

__all__ = [
    "BatchLevels",
    "Degree",
    "Distance",
    "Hankel",
    "Information",
    "Levels",
    "Mode",
    "Modes",
    "Piecewise",
    "SplitGramian",
    "System",
    "Unobservable",
    "batch_levels",
    "degree",
    "distance",
    "gramian",
    "gramian_factor",
    "hankel",
    "information",
    "levels",
    "modes",
    "observability_matrix",
    "piecewise",
    "problem",
    "rows",
    "split_gramian",
    "transition",
    "unobservable",
]


def __dir__() -> list[str]:
    return sorted(__all__)
