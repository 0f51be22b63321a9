"""Problems of thousands to millions of states with few entries in each row.

Nothing here has to be called: `gramian.Problem` and `gramian.analyze` take
``scipy.sparse`` rows (and triplets), and answer with the classes of this module.

- `SparseProblem`: sparse rows with names, blocks of states and named gauges.
- `analyze_sparse` answers with a `SparseObservability`: the attributes of
  `gramian.Observability`, which combinations are missing as `NullCombination` objects,
  and `SparseSuggestion` objects.
- `similarity_gauges`: translations, rotations and scale as directions of the states.
"""

from gramian.large._analysis import SparseObservability, SparseSuggestion, analyze_sparse
from gramian.large._problem import SparseProblem, similarity_gauges
from gramian.large._words import NullCombination

__all__ = [
    "NullCombination",
    "SparseObservability",
    "SparseProblem",
    "SparseSuggestion",
    "analyze_sparse",
    "similarity_gauges",
]


def __dir__() -> list[str]:
    return sorted(__all__)
