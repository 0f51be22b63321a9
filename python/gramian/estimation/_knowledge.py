"""What an estimate is asked with: measurements, prior knowledge, and where to start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import finite, real
from gramian._handle import handle_of
from gramian._noise import Knowledge, as_knowledge, negligible
from gramian.exceptions import InputError

__all__ = [
    "columns_of",
    "critical_at",
    "informed",
    "knowledge_of",
    "levels",
    "measured",
    "spread_of",
    "starts_of",
]

Array = NDArray[np.float64]


def levels(alpha: float, chance: float, weak_ratio: float) -> tuple[float, float, float]:
    """Return the levels of a status, checked."""
    alpha, chance = options.fraction(alpha, "alpha"), options.fraction(chance, "chance")
    weak_ratio = real(weak_ratio, "weak_ratio")
    if not weak_ratio > 0:
        raise InputError(f"weak_ratio = {weak_ratio}: must be > 0")
    return alpha, chance, weak_ratio


def columns_of(alternatives: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Return the columns (m, parameters) of alternatives by name."""
    columns = {}
    of = "name to derivatives of the measurements"
    for name, given in options.mapping(alternatives, "alternatives", of).items():
        column = finite(given, f"alternatives[{name!r}]")
        if column.ndim not in (1, 2) or column.size == 0:
            raise InputError(
                f"alternatives[{name!r}] has shape {column.shape}: must be (m,) or (m, parameters)"
            )
        columns[name] = column[:, None] if column.ndim == 1 else column
    return columns


def measured(model: Any, measurements: ArrayLike) -> Array:
    """Return measurements as the model takes them: of some, NaN is one that is missing."""
    checked = getattr(model, "measured", None)
    if checked is not None:
        own: Array = checked(measurements)
        return own
    return finite(measurements, "measurements")


def knowledge_of(
    model: Any, prior: Any, known: Mapping[str, float]
) -> tuple[Knowledge, dict[str, float]]:
    """Return the priors with their means, and what is known exactly, by name.

    The mean of a deviation without one is where the model is asked, its `x`.
    """
    names = tuple(model.names)
    combinations = getattr(model, "combinations", {})
    found = as_knowledge(prior, names, combinations, units=tuple(model.units))
    mean, at = found.mean.copy(), getattr(model, "x", None)
    if (lacking := np.isnan(mean)).any():
        if at is None:
            name = found.names[int(np.argmax(lacking))]
            what = f"prior of {name}" if name is not None else "prior"
            raise InputError(f"{what} has no mean, and the model no x: must be (mean, sigma)")
        mean[lacking] = found.rows[lacking] @ np.asarray(at, dtype=float)
    values = dict(known)
    open_ones = []
    for k, name in enumerate(found.names):
        if found.sigma[k] == 0 and name in names:
            values[str(name)] = float(mean[k])
        else:
            open_ones.append(k)
    centre = found.state_mean
    if at is not None:
        centre = np.where(np.isnan(centre), np.asarray(at, dtype=float), centre)
    left = Knowledge(
        tuple(found.names[k] for k in open_ones),
        found.rows[open_ones],
        mean[open_ones],
        found.sigma[open_ones],
        centre,
        found.state_sigma,
    )
    return left, values


def informed(
    model: Any, z: Array, prior: Knowledge | None, known: Mapping[str, float]
) -> _core.Model:
    """Return the extension's model of measurements, with what is known beside them."""
    handle = handle_of(model, z)
    if prior is not None and len(prior.rows):
        sigma = prior.sigma
        if (exact := sigma == 0).any():
            # As exact as rows of the measurements and arithmetic let it be.
            sigma = np.where(exact, negligible_beside(model, prior.rows), sigma)
        handle = handle.with_prior(prior.rows, prior.mean, sigma)
    if known:
        handle = handle.with_known([known.get(name) for name in model.names])
    return handle


def negligible_beside(model: Any, rows: Array) -> Array:
    """Return deviations of combinations (q, n) far below what the measurements tell."""
    at = getattr(model, "x", None)
    if at is None:
        raise InputError("prior of sigma 0 of a combination: the model needs an x for its size")
    return negligible(np.asarray(model.rows(at)), rows)


def spread_of(
    names: tuple[str, ...],
    prior: Knowledge,
    box: Mapping[str, tuple[float, float]],
    states: tuple[str, ...],
) -> tuple[str, list[float], list[float]] | None:
    """Return where the states may be; None where one of them may be anywhere."""
    known = prior_of_states(prior, names, states)
    if any(name not in known and name not in box for name in names):
        return None
    if not any(name in box for name in names):
        pairs = [known[name] for name in names]
        return "normal", [float(p[0]) for p in pairs], [float(p[1]) for p in pairs]
    ends = [
        box[name]
        if name in box
        else (known[name][0] - 4 * known[name][1], known[name][0] + 4 * known[name][1])
        for name in names
    ]
    return "box", [float(end[0]) for end in ends], [float(end[1]) for end in ends]


def prior_of_states(
    prior: Knowledge, names: tuple[str, ...], states: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Return mean and deviation of each state of which a prior says something."""
    pairs = zip(states, prior.state_mean.tolist(), prior.state_sigma.tolist(), strict=True)
    return {name: (m, s) for name, m, s in pairs if name in names and 0 < s < np.inf}


def starts_of(
    model: Any,
    z: Array,
    start: ArrayLike | None,
    free: list[int],
    spread: tuple[str, list[float], list[float]] | None,
    prior: Knowledge,
    names: tuple[str, ...],
) -> Array:
    n = len(model.names)
    if start is not None:
        given = np.atleast_2d(finite(start, "start"))
        if given.ndim != 2 or given.shape[1] not in (n, len(free)):
            raise InputError(f"start has shape {np.shape(start)}: must be ({n},) or (k, {n})")
        return given[:, free] if given.shape[1] == n else given
    made = getattr(model, "starts", None)
    if made is not None:
        return np.asarray(made(z), dtype=float)[:, free]
    at = getattr(model, "x", None)
    if at is not None:
        return np.asarray(at, dtype=float)[None, free]
    if spread is not None:
        first, second = np.array(spread[1]), np.array(spread[2])
        normal = spread[0] == "normal"
        middle = first if normal else 0.5 * (first + second)
        # And a step off it along each state: the middle itself may be a singular place.
        steps = np.diag(second if normal else 0.25 * (second - first))
        return np.vstack([middle, middle + steps, middle - steps])
    known = prior_of_states(prior, names, tuple(model.names))
    missing = [name for name in names if name not in known]
    raise InputError(
        f"nowhere to start: give start, or a prior or box for {', '.join(missing) or 'the states'}"
    )


def critical_at(level: float, dof: int) -> float:
    return _core.chi_square_critical(1 - options.fraction(level, "level"), dof)
