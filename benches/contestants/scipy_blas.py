"""SciPy's BLAS, a rank-k update for each trial."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from harness import Contest, Contestant


def join(contest: Contest) -> list[Contestant]:
    """Take part in the Gram matrices of rows."""
    if not contest.name.startswith("gram of rows"):
        return []

    def prepare(rows: Any) -> Callable[[], Any]:
        from scipy.linalg.blas import dsyrk

        def work() -> Any:
            out = np.empty((len(rows), 4, 4))
            for matrix, of in zip(out, rows, strict=True):
                upper = dsyrk(1.0, of.T)
                matrix[:] = np.triu(upper) + np.triu(upper, 1).T
            return out

        return work

    return [Contestant("SciPy dsyrk in a loop", prepare)]
