"""Files of tracks and measurements, as people have them.

- `read`: one or more files, as a `Recording` of `Track` objects and `Detections` of sensors,
  on one clock and in one plane.
- `joined`: several recordings as one; `unix_seconds`: dates as seconds, `utc`: seconds as dates.
- `table`: the cells of a table, a `Table`, with a method for columns of numbers and of times.
- `FORMATS`: what is read.
"""

from gramian.io._read import FORMATS, joined, read, table, unix_seconds
from gramian.io._recording import Detections, Recording, Track
from gramian.io._table import Table
from gramian.io._times import utc

__all__ = [
    "FORMATS",
    "Detections",
    "Recording",
    "Table",
    "Track",
    "joined",
    "read",
    "table",
    "unix_seconds",
    "utc",
]


def __dir__() -> list[str]:
    return sorted(__all__)
