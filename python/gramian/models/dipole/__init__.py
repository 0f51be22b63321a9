"""A moving magnetic dipole: what the field at one or more sensors tells of it.

A dipole of constant moment m (A m^2) passes at constant velocity v (m/s); it is
at r0 (m) at the first time. The state is (r0, v, m), nine numbers. Axes are those
of the sensor, fields in tesla.

- `problem`, `rows`, `fisher`: the whitened rows, for `gramian.analyze`, and their
  information; `NAMES` and `UNITS` of the states.
- `field`, `jacobian` with `Jacobian`, `moment`: the dipole itself; `MU0` is the vacuum
  permeability.
- `measure`, `simulate`: the fields of a pass, exact and noisy.
- `localize`, `localize_many`: the dipole from a record, as `Localization` (a
  `gramian.Estimate` of a `DipoleModel` with its `Description`) and `Localizations` with
  `Solution`, `Pass` and `ClosestPoint`; `localize_trials` of simulated records.
- `track`: a dipole that maneuvers, sample by sample, as a `Track`.
- `check_record`: what is wrong with a record, as a `RecordCheck` of `Finding`.
- `equivalents`: the passes that one sensor cannot tell apart.
"""

from gramian.models.dipole._estimate import Description, DipoleModel
from gramian.models.dipole._localize import localize, localize_many
from gramian.models.dipole._model import (
    MU0,
    NAMES,
    UNITS,
    Jacobian,
    Pass,
    equivalents,
    field,
    fisher,
    jacobian,
    measure,
    moment,
    problem,
    rows,
    simulate,
)
from gramian.models.dipole._record import Finding, RecordCheck, check_record
from gramian.models.dipole._result import ClosestPoint, Localization, Localizations, Solution
from gramian.models.dipole._track import Track, track
from gramian.models.dipole._trials import localize_trials

__all__ = [
    "MU0",
    "NAMES",
    "UNITS",
    "ClosestPoint",
    "Description",
    "DipoleModel",
    "Finding",
    "Jacobian",
    "Localization",
    "Localizations",
    "Pass",
    "RecordCheck",
    "Solution",
    "Track",
    "check_record",
    "equivalents",
    "field",
    "fisher",
    "jacobian",
    "localize",
    "localize_many",
    "localize_trials",
    "measure",
    "moment",
    "problem",
    "rows",
    "simulate",
    "track",
]


def __dir__() -> list[str]:
    return sorted(__all__)
