"""From measurements to states, and whether the answer may be believed.

`estimate` finds the most likely state of a model; its answer, an `Estimate`, says how
well the model fits, which other states fit as well, and how large the region of likely
states is. `other_solutions` asks the same of a state without measurements.
"""

from gramian._handle import EstimationModel
from gramian.estimation._channels import Channel, channel_faults
from gramian.estimation._estimate import Estimate, estimate, other_solutions
from gramian.estimation._parts import (
    STATUSES,
    Alternative,
    Fit,
    Interval,
    Region,
    Solution,
)
from gramian.estimation._trials import Trials, estimate_trials

__all__ = [
    "STATUSES",
    "Alternative",
    "Channel",
    "Estimate",
    "EstimationModel",
    "Fit",
    "Interval",
    "Region",
    "Solution",
    "Trials",
    "channel_faults",
    "estimate",
    "estimate_trials",
    "other_solutions",
]


def __dir__() -> list[str]:
    return sorted(__all__)
