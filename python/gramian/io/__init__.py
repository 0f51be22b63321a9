"""Files of tracks and measurements, as people have them.

`read` takes one or more files and returns a `Recording`: `Track` objects and
`Detections` of sensors, on one clock and in one plane. `FORMATS` lists what is read.
"""

from gramian.io._read import FORMATS, joined, read, unix_seconds
from gramian.io._recording import Detections, Recording, Track

__all__ = ["FORMATS", "Detections", "Recording", "Track", "joined", "read", "unix_seconds"]


def __dir__() -> list[str]:
    return sorted(__all__)
