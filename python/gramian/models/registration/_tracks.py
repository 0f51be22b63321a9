"""The tracks on which two sensors' biases cannot be determined: a closed list."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gramian._answers import Answer
from gramian._arrays import finite, number
from gramian._text import describe_direction
from gramian.exceptions import InputError
from gramian.models.registration._setup import Array, SensorsLike, Setup, setup

Family = Literal["between", "outside", "abeam A", "abeam B"]


@dataclass(frozen=True, eq=False, repr=False)
class SingularTrack(Answer):
    """One family of singular tracks.

    Attributes
    ----------
    name : {"between", "outside", "abeam A", "abeam B"}
        A and B are the first and the second sensor.
    where : str
        The same in words, with the sensors' names.
    null_vectors : mapping of str to ndarray, shape (4,)
        What is not determined on it, by side: "both" for the baseline; "left"
        and "right" of the way from A to B for a half-line abeam a sensor.
    combinations : mapping of str to str
        The same, readable.
    """

    name: Family
    where: str
    null_vectors: Mapping[str, Array]
    combinations: Mapping[str, str]
    _setup: Setup

    def distances(self, positions: ArrayLike) -> dict[str, Array]:
        """Return how far positions (..., 2) are from the track, m, for each side."""
        along, left, baseline = _frame(self._setup, positions)
        if self.name == "between":
            beyond = np.maximum(np.maximum(-along, along - baseline), 0)
            return {"both": np.hypot(beyond, left)}
        if self.name == "outside":
            inside = np.maximum(np.minimum(along, baseline - along), 0)
            return {"both": np.hypot(inside, left)}
        x = along if self.name == "abeam A" else along - baseline
        return {
            side: np.hypot(x, np.minimum(sign * left, 0))
            for side, sign in (("left", 1.0), ("right", -1.0))
        }


@dataclass(frozen=True, eq=False, repr=False)
class TrackCheck(Answer):
    """The singular track that a given track is nearest to.

    Attributes
    ----------
    singular : bool
        Whether all positions are on it within the tolerance.
    track : SingularTrack
    side : str
    distance : float
        Of the position that is farthest from it, m.
    null_vector : ndarray, shape (4,)
    combination : str
    """

    singular: bool
    track: SingularTrack
    side: str
    distance: float
    null_vector: Array
    combination: str


def singular_tracks(sensors: SensorsLike) -> tuple[SingularTrack, ...]:
    """Return every kind of track on which two sensors' biases cannot be determined.

    Parameters
    ----------
    sensors : array_like, shape (2, 2), or mapping of str to array_like, shape (2,)
        Two sensors in the plane.

    Returns
    -------
    tuple of SingularTrack
        The baseline between the sensors, the baseline line outside them, and the
        half-lines abeam each sensor.

    Raises
    ------
    InputError
        For other than two sensors: a third one off the baseline leaves no
        singular track, which `problem` shows.

    Notes
    -----
    The list is complete for a range and an azimuth bias of each sensor: looks at
    four distinct places that do not all lie within one of these give rank 4.
    Zhu, Tang & He 2013 name the first only. A look on the baseline does not see
    the two ranges' common error; abeam A, a common azimuth bias moves both
    reports along the line of sight from A, where a range bias of A does the same.

    Examples
    --------
    >>> for track in singular_tracks({"A": (0, 0), "B": (60e3, 0)}):
    ...     print(track.name, dict(track.combinations))
    between {'both': 'A.range +1, B.range -1'}
    outside {'both': 'A.range +1, B.range +1'}
    abeam A {'left': 'A.range +60000, A.azimuth +1, B.azimuth +1', 'right': 'A.range -60000, A.azimuth +1, B.azimuth +1'}
    abeam B {'left': 'A.azimuth +1, B.range -60000, B.azimuth +1', 'right': 'A.azimuth +1, B.range +60000, B.azimuth +1'}
    """  # noqa: E501
    known = setup(sensors, None, still="singular_tracks")
    if known.places.shape != (2, 2):
        raise InputError(
            f"singular_tracks is for two sensors in the plane, here are {len(known.labels)} with "
            f"{known.d} coordinates: gm.analyze(problem(...)) finds what any others cannot tell"
        )
    baseline = float(np.hypot(*(known.places[1] - known.places[0])))
    if baseline == 0:
        raise InputError(
            "sensors[1] is at the place of sensors[0]: sensors must be at different places"
        )
    a, b = known.labels

    def made(name: Family, where: str, vectors: dict[str, list[float]]) -> SingularTrack:
        arrays = {side: np.array(vector) for side, vector in vectors.items()}
        words = {side: describe_direction(v, known.names) for side, v in arrays.items()}
        return SingularTrack(name, where, arrays, words, known)

    d = baseline
    return (
        made("between", f"on the baseline between {a} and {b}", {"both": [1, 0, -1, 0]}),
        made("outside", f"on the baseline beyond {a} or {b}", {"both": [1, 0, 1, 0]}),
        made("abeam A", f"abeam {a}", {"left": [d, 1, 0, 1], "right": [-d, 1, 0, 1]}),
        made("abeam B", f"abeam {b}", {"left": [0, 1, -d, 1], "right": [0, 1, d, 1]}),
    )


def check_track(
    positions: ArrayLike, sensors: SensorsLike, tolerance: float | None = None
) -> TrackCheck:
    """Say whether a track is singular for two sensors, and which kind it is nearest to.

    Parameters
    ----------
    positions : array_like, shape (K, 2)
        Metres east and north.
    sensors
        As for `singular_tracks`.
    tolerance : float, optional
        Metres by which positions may be off; 1e-9 of the baseline by default.
        For recorded tracks give the noise of the positions.

    Returns
    -------
    TrackCheck

    Examples
    --------
    >>> check = check_track([[0, 1e4], [0, 2e4]], [[0, 0], [60e3, 0]])
    >>> check.singular, check.track.where, check.side
    (True, 'abeam A', 'left')
    """
    places = finite(positions, "positions")
    if places.ndim != 2 or places.shape[1] != 2 or not len(places):
        raise InputError(f"positions has shape {places.shape}: must be (K, 2)")
    tracks = singular_tracks(sensors)
    if tolerance is None:
        tolerance = 1e-9 * float(np.hypot(*np.ptp(tracks[0]._setup.places, axis=0)))
    else:
        tolerance = number(tolerance, "tolerance [m]")
        if tolerance < 0:
            raise InputError(f"tolerance = {tolerance} m: must be >= 0")
    found = [
        (float(distance.max()), track, side)
        for track in tracks
        for side, distance in track.distances(places).items()
    ]
    distance, track, side = min(found, key=lambda item: item[0])
    return TrackCheck(
        distance <= tolerance, track, side, distance,
        track.null_vectors[side], track.combinations[side],
    )  # fmt: skip


def _frame(known: Setup, positions: ArrayLike) -> tuple[Array, Array, float]:
    """Coordinates along the baseline from A and to its left, and its length."""
    span = known.places[1] - known.places[0]
    length = float(np.hypot(*span))
    given = finite(positions, "positions")
    if given.shape[-1:] != (2,):
        raise InputError(f"positions has shape {given.shape}: must be (..., 2)")
    offset = given - known.places[0]
    along = (offset @ span) / length
    left = (offset[..., 1] * span[0] - offset[..., 0] * span[1]) / length
    return along, left, length
