"""The most informative targets of a crowd."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core, choose
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, whole
from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models.registration._model import rows
from gramian.models.registration._setup import Array, Extra, SensorsLike, setup
from gramian.problem import Problem


@dataclass(frozen=True, eq=False, repr=False)
class Selection(Answer):
    """What `select` chose, best first.

    Attributes
    ----------
    chosen : tuple of str
        Names of tracks, or of pieces "name[first:end]" of looks.
    gains : ndarray, shape (budget,)
        1/2 log det of the information, gained by each, in nats; `inf` while the
        rank is still short.
    bounds : ndarray, shape (budget, n)
        Standard deviation of each bias at the bound after each.
    all_bounds : ndarray, shape (n,)
        The same with every track.
    names, units : tuple of str, length n
    looks : mapping of str to (str, slice)
        The track and the looks of each choice.
    """

    chosen: tuple[str, ...]
    gains: Array
    bounds: Array
    all_bounds: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    looks: Mapping[str, tuple[str, slice]]

    _not_in_dict = frozenset({"looks"})

    def summary(self) -> str:
        """Return the choice as text."""
        lines = [f"{'':24}" + "".join(f"{name:>14}" for name in self.names)]
        for name, bound in [*zip(self.chosen, self.bounds, strict=True), ("all", self.all_bounds)]:
            label = f"+ {name}" if name != "all" else "all tracks"
            cells = [
                "not observ." if np.isinf(b) else f"{brief(np.degrees(b))} deg" if unit == "rad"
                else f"{brief(b)} {unit}"
                for b, unit in zip(bound, self.units, strict=True)
            ]  # fmt: skip
            lines.append(f"{label:<24}" + "".join(f"{cell:>14}" for cell in cells))
        return "\n".join(lines)

    def _verdict_line(self) -> str:
        return f"chosen: {', '.join(self.chosen)}"

    def _as_table(self) -> Columns:
        values = {"gain": self.gains} | dict(zip(self.names, self.bounds.T, strict=True))
        return Columns("track", self.chosen, values, dict(zip(self.names, self.units, strict=True)))


def select(
    tracks: Mapping[str, ArrayLike] | Sequence[ArrayLike],
    sensors: SensorsLike,
    sigma: ArrayLike,
    budget: int,
    *,
    piece: int | None = None,
    goal: str = "information",
    extras: Sequence[Extra] = (),
    prior: ArrayLike | Mapping[str, float] | None = None,
    times: Mapping[str, ArrayLike] | Sequence[ArrayLike] | None = None,
) -> Selection:
    """Choose the targets of a crowd that tell most about the biases.

    Parameters
    ----------
    tracks : mapping of str to array_like, shape (K_i, d), or sequence of those
        Positions of each target, in metres; smoothed is better than raw.
    sensors, sigma, extras
        As for `rows`.
    budget : int
        How many to choose; at most the number of tracks or pieces.
    piece : int, optional
        Cut tracks into pieces of so many looks and choose pieces.
    goal : str
        "information": the gain 1/2 log det(I + R^-1 H J0^-1 H^T) in what is known
        already; or the name of a bias, whose bound is to fall.
    prior : mapping of str to float, or array_like, shape (n,), optional
        Deviations of biases known beforehand.
    times : mapping of str to array_like, shape (K_i,), or sequence of those, optional
        Of the looks of each track, seconds, for platforms that move.

    Returns
    -------
    Selection

    Notes
    -----
    Greedy, by `gramian.choose.select`: each choice is the best addition to those before.
    While the rank is short, more rank comes first, then the larger product of the singular values
    that count. With a prior the gain is submodular, and the greedy choice is
    worth at least 1 - 1/e of the best there is.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(0, 60e3, 50)
    >>> crowd = {
    ...     "along the baseline": np.stack([x, 0 * x + 1.0], axis=1),
    ...     "across it": np.stack([0 * x + 30e3, x], axis=1),
    ...     "far away": np.stack([x, 0 * x + 200e3], axis=1),
    ... }
    >>> select(crowd, [[0, 0], [60e3, 0]], (50.0, 0.00175), 2).chosen
    ('across it', 'along the baseline')
    """
    named = _named(tracks, "tracks", "positions")
    when = None if times is None else _named(times, "times", "times")
    if when is not None and list(when) != list(named):
        raise InputError(
            f"times is of {', '.join(when)}: must be of the tracks, {', '.join(named)}"
        )
    known = setup(sensors, sigma, extras, times=None if when is None else next(iter(when.values())))
    looks: dict[str, tuple[str, slice]] = {}
    pieces: dict[str, tuple[Array, Array | None]] = {}
    if piece is not None:
        piece = whole(piece, "piece", 1)
    for name, track in named.items():
        places = finite(track, f"track {name!r}")
        if places.ndim != 2 or places.shape[1] != known.d or not len(places):
            raise InputError(f"track {name!r} has shape {places.shape}: must be (K, {known.d})")
        at = None if when is None else finite(when[name], f"times of track {name!r}")
        if at is not None and at.shape != places.shape[:1]:
            raise InputError(
                f"times of track {name!r} has shape {at.shape}: must be ({len(places)},), one "
                "for each look"
            )
        step = piece or len(places)
        for start in range(0, len(places), step):
            end = min(start + step, len(places))
            key = name if piece is None else f"{name}[{start}:{end}]"
            looks[key] = (name, slice(start, end))
            pieces[key] = places[start:end], None if at is None else at[start:end]
    budget = whole(budget, "budget", 1)
    if budget > len(pieces):
        raise InputError(f"budget = {budget}: must be from 1 to {len(pieces)}, the number there is")
    keys = list(pieces)
    factors = [
        _factor(rows(places, sensors, sigma, extras=extras, times=at))
        for places, at in pieces.values()
    ]
    beforehand = np.full(known.n, np.inf) if prior is None else known.biases(prior, "prior")
    if isinstance(prior, Mapping):
        beforehand = np.where(beforehand == 0, np.inf, beforehand)
    if not (beforehand > 0).all():
        raise InputError("prior: every deviation must be > 0, or inf for none")
    have = np.diag(1 / beforehand)
    base = Problem(have, known.names)
    choice = choose.select(
        dict(zip(keys, factors, strict=True)),
        budget,
        "D" if goal == "information" else known.names[known.index(goal)],
        problem=base,
        exchange=False,
        relax=False,
    )
    chosen = [keys.index(name) for name in choice.chosen]
    stacks = [np.concatenate([have, *(factors[i] for i in chosen[: k + 1])]) for k in range(budget)]
    bounds = [_core.crlb_std(stack, None) for stack in stacks]
    everything = np.concatenate([np.diag(1 / beforehand), *factors])
    return Selection(
        chosen=tuple(keys[i] for i in chosen),
        gains=choice.gains if goal == "information" else _information_gains(stacks, have),
        bounds=np.array(bounds),
        all_bounds=_core.crlb_std(everything, None),
        names=known.names,
        units=known.units,
        looks={keys[i]: looks[keys[i]] for i in chosen},
    )


def _named(
    given: Mapping[str, ArrayLike] | Sequence[ArrayLike], what: str, values: str
) -> dict[str, ArrayLike]:
    """Return what is given for each track, by its name."""
    if isinstance(given, Mapping):
        return {str(name): one for name, one in given.items()}
    if isinstance(given, (list, tuple)) or (isinstance(given, np.ndarray) and given.ndim):
        return {f"track {i}": one for i, one in enumerate(given)}
    raise InputError(
        f"{what} = {options.given(given)}: must be a mapping of name to {values}, "
        f"or a sequence of {values}"
    )


def _factor(array: Array) -> Array:
    """Return the triangular factor (n, n) of rows."""
    n = array.shape[1]
    padded = np.vstack([array, np.zeros((max(n - len(array), 0), n))])
    factor: Array = np.asarray(np.linalg.qr(padded, mode="r"))
    # Rounding of the columns must not pass for light rows.
    rounding = 64 * np.finfo(float).eps * np.linalg.norm(array, axis=0)
    return np.where(np.abs(factor) > rounding, factor, 0.0)


def _information_gains(stacks: Sequence[Array], have: Array) -> Array:
    """Half the log determinant that each stack adds to the one before."""
    levels = []
    for stack in (have, *stacks):
        found = _core.Analysis(stack, None)
        levels.append(found.log_det / 2)
    with np.errstate(invalid="ignore"):
        gains = np.diff(levels)
    return np.where(np.isnan(gains), np.inf, gains)
