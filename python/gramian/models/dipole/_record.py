"""What is wrong with a record, before anything is fitted to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array
from gramian._text import brief
from gramian.exceptions import InputError

__all__ = ["Finding", "RecordCheck", "check_record"]

Array = NDArray[np.float64]

#: Kinds of findings that leave nothing of a channel.
_UNUSABLE = ("constant", "copy", "axes")


@dataclass(frozen=True, repr=False)
class Finding(Answer):
    """Something in a record that a fit would suffer from.

    Attributes
    ----------
    kind : str
        "constant", "stuck", "saturated", "copy", "axes", "coarse", "noisy", "missing",
        "spikes", "hum", "step", "drift" or "clock".
    channel : str or None
        The channel; None for the clock.
    text : str
        In words, with the figures.
    figures : mapping
        The figures by name: the value a channel is stuck at, the sample, the frequency.
    """

    kind: str
    channel: str | None
    text: str
    figures: Mapping[str, Any]

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False, repr=False)
class RecordCheck(Answer):
    """The answer of `check_record`.

    Attributes
    ----------
    findings : tuple of Finding
        Worst kinds first; empty for a sound record.
    channels : tuple of str, length C
    sigma : ndarray, shape (C,)
        Standard deviation of the noise of each channel, T.
    correlation : ndarray, shape (C,)
        Correlation of the noise of neighbouring samples: 0 for white noise.
    step : ndarray, shape (C,)
        The step of the recorder, T; 0 where none is to be seen.
    """

    findings: tuple[Finding, ...]
    channels: tuple[str, ...]
    sigma: Array
    correlation: Array
    step: Array

    @property
    def sound(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    @property
    def usable(self) -> tuple[bool, ...]:
        """Which channels measure the field: neither dead nor a copy, axes as they should be."""
        bad = {f.channel for f in self.findings if f.kind in _UNUSABLE}
        bad |= {f.channel for f in self.findings if f.kind == "missing" and f.figures["all"]}
        return tuple(name not in bad for name in self.channels)

    def summary(self) -> str:
        """Return the findings and the noise of each channel as text."""
        lines = ["SOUND: nothing found" if self.sound else f"{len(self.findings)} findings"]
        lines += [f"  {finding.text}" for finding in self.findings]
        for name, sigma, correlation, step in zip(
            self.channels, self.sigma, self.correlation, self.step, strict=True
        ):
            rounded = f", steps of {brief(step)} T" if step else ""
            lines.append(
                f"  {name}: noise {brief(sigma)} T, correlation {correlation:.2f}{rounded}"
            )
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values = {"sigma": self.sigma, "correlation": self.correlation, "step": self.step}
        return Columns("channel", self.channels, values, {"sigma": "T", "step": "T"})


def check_record(
    times: ArrayLike,
    field: ArrayLike,
    *,
    channels: Sequence[str] | None = None,
    components: Literal[1, 3] = 3,
) -> RecordCheck:
    """Look through a record for what a fit would suffer from.

    Parameters
    ----------
    times : array_like, shape (K,)
        Seconds.
    field : array_like, shape (K, 3), or (K, S, 3) for S sensors
        Tesla; NaN for a missing sample. With ``components=1`` (K,), or (K, S).
    channels : sequence of str, optional
        Names of the channels; "x", "y", "z", or "1x" .. by default.
    components : {3, 1}
        Numbers of a sample of a sensor: 1 of the total field, whose channels are "F", or
        "1F" ..

    Returns
    -------
    RecordCheck

    Raises
    ------
    InputError
        Shapes that do not fit, times that are not finite.

    Notes
    -----
    Found are: channels that are constant, stuck for a run that noise does not allow, cut
    off at a limit, or copies of another channel (scaled, shifted, inverted or up to 5 samples
    late) noise included, throughout or for a quarter of the record; axes of a second sensor
    that follow another axis of the first, or its own with the opposite sign; channels that
    are rounded to more than 10 times, or have more than 8 times, the noise of the others;
    spikes of up to four samples beyond 8 standard deviations; mains hum (50, 60, 16 2/3 Hz,
    or its alias); a level that steps, or moves from the first to the last tenth; steps and
    rates of the clock; missing samples. Copies need noise that tells them from a channel that
    sees the same pass: rounded to steps far above it, they may go unseen. The noise is that
    of neighbouring samples in the quiet parts of the record.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(400) * 0.01
    >>> y = gm.dipole.simulate([-2, 1, 0.5], [1, 0, 0], [9, 5, 7], t, 1e-9, seed=1)
    >>> gm.dipole.check_record(t, y).sound
    True
    >>> y[:, 2] = -y[:, 0]
    >>> print(gm.dipole.check_record(t, y).findings[0])
    z repeats x with the opposite sign, noise included
    """
    t, y = as_float_array(times, "times"), as_float_array(field, "field")
    if components not in (1, 3):
        raise InputError(f"components = {options.given(components)}: must be 3 or 1")
    if components == 1:
        y = y[..., None]
    if t.ndim != 1 or y.ndim not in (2, 3) or y.shape[0] != t.size or y.shape[-1] != components:
        given = y.shape if components == 3 else y.shape[:-1]
        wanted = "(K, 3) or (K, S, 3)" if components == 3 else "(K,) or (K, S)"
        raise InputError(f"times has shape {t.shape} and field {given}: must be (K,) and {wanted}")
    flat = np.ascontiguousarray(y.reshape(t.size, -1))
    largest = np.fmax.reduce(np.abs(flat), axis=None, initial=0.0)
    if not largest < 1e100:
        raise InputError(f"field has a reading of {largest:g} T: must be below 1e100 T")
    count = flat.shape[1]
    names = _names(channels, count, "xyz" if components == 3 else "F")
    found, noise = _core.dipole_check(t, flat)
    findings = tuple(
        _finding(kind, figures, names, t)
        for kind, figures in found
        # Readings of the total field have no axes to confuse.
        if components == 3 or kind != "axes"
    )
    sigma, correlation, step = np.array(noise).reshape(count, 3).T
    return RecordCheck(findings, names, sigma, correlation, step)


def _names(channels: Sequence[str] | None, count: int, axes: str) -> tuple[str, ...]:
    if channels is None:
        size = len(axes)
        return tuple(
            axes[c] if count == size else f"{c // size + 1}{axes[c % size]}" for c in range(count)
        )
    names = options.names(channels, "channels", "names of the channels")
    if len(names) != count or len(set(names)) != count:
        raise InputError(f"channels = {channels!r}: must be {count} different names")
    return names


def _finding(kind: str, figures: dict[str, Any], names: tuple[str, ...], times: Array) -> Finding:
    channel = names[figures["channel"]] if "channel" in figures else None
    for key in ("of", "follows"):
        if key in figures:
            figures[key] = names[figures[key]]
    if kind == "missing":
        figures["all"] = figures["samples"] == times.size
    return Finding(kind, channel, _text(kind, channel, figures, times), figures)


def _text(kind: str, channel: str | None, figures: Mapping[str, Any], times: Array) -> str:
    said: dict[str, Callable[[], str]] = {
        "constant": lambda: f"is {brief(figures['value'], 4)} T throughout: it does not measure",
        "stuck": lambda: (
            f"is stuck at {brief(figures['value'], 4)} T from {times[figures['first']]:.6g} s to "
            f"{times[figures['first'] + figures['samples'] - 1]:.6g} s"
        ),
        "saturated": lambda: (
            f"is cut off at {brief(figures['value'], 4)} T, in {figures['samples']} samples"
        ),
        "copy": lambda: (
            f"repeats {figures['of']}{_scaled(figures)}{_late(figures['late'])}, noise included"
            + _during(figures, times)
        ),
        "coarse": lambda: (
            f"is rounded to {brief(figures['step'])} T, where the others have noise of "
            f"{brief(figures['usual'])} T"
        ),
        "noisy": lambda: (
            f"has noise of {brief(figures['sigma'])} T, the others of {brief(figures['usual'])} T"
        ),
        "step": lambda: (
            f"steps by {brief(figures['change'])} T at {times[figures['sample']]:.6g} s and stays"
        ),
        "axes": lambda: (
            f"follows {figures['follows']}{' with the opposite sign' * figures['inverted']} "
            f"(correlation {figures['correlation']:.3f}): are its axes as the first sensor's?"
        ),
        "spikes": lambda: (
            f"has {len(figures['samples'])} spike{'s' * (len(figures['samples']) > 1)}, the first "
            f"at {times[figures['samples'][0]]:.6g} s"
        ),
        "hum": lambda: (
            f"has hum of {brief(figures['frequency'], 4)} Hz, amplitude "
            f"{brief(figures['amplitude'])} T"
        ),
        "drift": lambda: f"drifts by {brief(figures['change'])} T over the record",
        "clock": lambda: (
            f"steps by {brief(figures['step'], 4)} s to {times[figures['sample']]:.6g} s, "
            f"usually by {brief(figures['usual'], 4)} s"
            + f", {figures['count']} times"
            * (figures["count"] > 1)
        ),
        "missing": lambda: (
            "has no samples" if figures["all"] else f"has {figures['samples']} missing samples"
        ),
    }
    return f"{channel or 'the clock'} {said[kind]()}"


def _scaled(figures: Mapping[str, Any]) -> str:
    factor = figures["factor"]
    if abs(factor - 1) < 1e-9:
        return ""
    if abs(factor + 1) < 1e-9:
        return " with the opposite sign"
    return f" times {brief(factor, 4)}"


def _late(late: int) -> str:
    if late == 0:
        return ""
    return f" {abs(late)} sample{'s' * (abs(late) > 1)} {'later' if late > 0 else 'earlier'}"


def _during(figures: Mapping[str, Any], times: Array) -> str:
    if figures["samples"] == times.size:
        return ""
    last = figures["first"] + figures["samples"] - 1
    return f", from {times[figures['first']]:.6g} s to {times[last]:.6g} s"
