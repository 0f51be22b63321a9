"""What an observer measures while it follows a plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gramian import _options as options
from gramian._arrays import number
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = ["Sensing"]

#: Kinds, with the unit of their sigma.
KINDS = {
    "bearing": "rad",
    "range": "m",
    "range_rate": "m/s",
    "frequency": "Hz",
    "cone_angle": "rad",
    "signal_strength": "dB",
}


@dataclass(frozen=True, eq=False)
class Sensing(Value):
    """A sensor that every observer of a plan carries, read at every sample.

    Parameters
    ----------
    kind : {"bearing", "range", "range_rate", "frequency", "cone_angle", "signal_strength"}
        What it measures of every target, as `gm.tracks.Sensor`. A cone angle is that of a
        towed array along the heading: its side is not told.
    sigma : float
        Standard deviation of a reading, > 0: rad, m, m/s, Hz, rad, dB.
    detection : float
        Probability of a reading, above 0 and at most 1: lost readings count as expected.
    bias : str, optional
        Name of an unknown bias, a state that is found too. Sensors may share a name.
    blind : sequence of (float, float)
        Arcs (from, to), clockwise from the heading, in which nothing is seen, radians.
    reach : float, optional
        Range beyond which nothing is seen, metres.
    parameters : mapping
        Of "frequency": "tonal" (Hz) and "wave" (speed of the wave, m/s, 1500 by default);
        of "signal_strength": "power" (dB at 1 m) and "exponent" (2 by default).
    unknown : mapping of str to str
        Which parameters are states too, and their names: ``{"tonal": "f0"}``.

    Raises
    ------
    InputError
        Values that cannot be used.

    Examples
    --------
    >>> import gramian as gm
    >>> array = gm.maneuver.Sensing("cone_angle", 0.02, blind=[(2.6, 3.7)], detection=0.9)
    >>> array.kind
    'cone_angle'
    """

    kind: str
    sigma: float
    detection: float = 1.0
    bias: str | None = None
    blind: Sequence[tuple[float, float]] = ()
    reach: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    unknown: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        options.choice(self.kind, "kind", tuple(KINDS))
        sigma, detection = number(self.sigma, "sigma"), number(self.detection, "detection")
        if not sigma > 0:
            raise InputError(f"sigma = {sigma} {KINDS[self.kind]}: must be > 0")
        if KINDS[self.kind] == "rad" and sigma > 3.15:
            raise InputError(f"sigma = {sigma} rad: must be at most pi; are these degrees?")
        if not 0 < detection <= 1:
            raise InputError(f"detection = {detection}: must be above 0 and at most 1")
        arcs = []
        for i, arc in enumerate(self.blind):
            if len(tuple(arc)) != 2:
                raise InputError(f"blind[{i}] = {arc!r}: must be (from, to)")
            arcs.append(tuple(number(angle, f"blind[{i}]") for angle in arc))
        if self.reach is not None and not number(self.reach, "reach") > 0:
            raise InputError(f"reach = {self.reach} m: must be > 0")
        known = {"frequency": ("tonal", "wave"), "signal_strength": ("power", "exponent")}
        allowed = known.get(self.kind, ())
        for name, value in options.mapping(self.parameters, "parameters").items():
            options.choice(name, "parameters", allowed or ("none for this kind",))
            number(value, f"parameters[{name!r}]")
        for name in options.mapping(self.unknown, "unknown"):
            options.choice(name, "unknown", [one for one in allowed if one != "wave"] or ("none",))
        if self.kind == "frequency" and "tonal" not in self.parameters:
            raise InputError('parameters has no "tonal": the frequency that is emitted, Hz')
        object.__setattr__(self, "sigma", sigma)
        object.__setattr__(self, "detection", detection)
        object.__setattr__(self, "blind", tuple(arcs))

    def states(self) -> list[str]:
        """Return the names of the states it adds."""
        return [*([self.bias] if self.bias else []), *self.unknown.values()]

    def given(self, index: Mapping[str, int]) -> dict[str, object]:
        """Return it for the extension, with the places of its states."""
        names = ("tonal", "tonal2") if self.kind == "frequency" else ("power", "exponent")
        values = [float(self.parameters.get(name, 2.0 * i)) for i, name in enumerate(names)]
        return {
            "kind": self.kind,
            "sigma": self.sigma,
            "detection": self.detection,
            "wave": float(self.parameters.get("wave", 1500.0)),
            "parameters": values,
            "parameter_states": [
                index[self.unknown[name]] if name in self.unknown else None for name in names
            ],
            "bias": index[self.bias] if self.bias else None,
            "blind": [tuple(arc) for arc in self.blind],
            "reach": float("inf") if self.reach is None else float(self.reach),
        }
