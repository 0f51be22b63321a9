"""Registration of sensors: the constant biases of radars that see the same targets.

Each of N sensors at known places measures range and azimuth, in space also
elevation, of a target: truth + constant bias + noise. The targets' positions are
not known and not needed: they are eliminated look by look.

- `problem`, `rows`, `fisher`: what a set of looks can tell; `gauges`, what none can.
- `estimate`: the biases, as an `Estimate` (of many sets of reports as `Estimates`), or why
  there are none; `estimate_trials` of simulated reports; `RegistrationModel`, what they fit.
- `degree`, `eta`, `field` with `Field`: where the biases are determined well.
- `singular_tracks` with `SingularTrack`, `check_track` with `TrackCheck`: where not at all.
- `select`, with `Selection`: which targets of a crowd tell most.
- `Reports`: the measurements; `simulate` makes them, `match` pairs recordings.
- `Platform`: a sensor that moves, or whose azimuths count from its heading.

Metres and radians; x is east, y is north; azimuths clockwise from north.
"""

from gramian.models.registration._degree import degree, eta
from gramian.models.registration._estimate import (
    Estimate,
    Estimates,
    RegistrationModel,
    estimate,
    estimate_trials,
)
from gramian.models.registration._field import Field, field
from gramian.models.registration._model import fisher, gauges, problem, rows
from gramian.models.registration._reports import Reports, match, simulate
from gramian.models.registration._select import Selection, select
from gramian.models.registration._setup import Platform
from gramian.models.registration._tracks import (
    SingularTrack,
    TrackCheck,
    check_track,
    singular_tracks,
)

__all__ = [
    "Estimate",
    "Estimates",
    "Field",
    "Platform",
    "RegistrationModel",
    "Reports",
    "Selection",
    "SingularTrack",
    "TrackCheck",
    "check_track",
    "degree",
    "estimate",
    "estimate_trials",
    "eta",
    "field",
    "fisher",
    "gauges",
    "match",
    "problem",
    "rows",
    "select",
    "simulate",
    "singular_tracks",
]


def __dir__() -> list[str]:
    return sorted(__all__)
