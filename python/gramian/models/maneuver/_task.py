"""What a plan is asked for, checked and in arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, number, whole
from gramian.exceptions import InputError

__all__ = [
    "Criterion",
    "Task",
    "check_outside",
    "checked_discs",
    "finite",
    "moved",
    "positive",
]

Array = NDArray[np.float64]
Criterion = Literal["D", "A", "E"] | Mapping[str, Any]

FIXED = ("x", "y")
MOVING = ("x0", "y0", "vx", "vy")


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that was asked, checked and in arrays."""

    start: Array
    slow: float
    fast: float
    dt: float
    moves: int
    kind: str
    sigma: float
    standoff: float
    keep_out: Array
    max_turn: float
    heading: float | None
    legs: int | None
    targets: Array
    weights: Array
    names: tuple[str, ...]
    prior: Array
    scale: Array
    combinations: Array
    #: Whether there is any information beforehand.
    known: bool

    @classmethod
    def checked(
        cls,
        *,
        target: ArrayLike,
        start: ArrayLike,
        speed: float | tuple[float, float],
        dt: float,
        samples: int,
        criterion: Criterion,
        sigma: float | None,
        standoff: float | None,
        keep_out: ArrayLike | None,
        max_turn_rate: float | None,
        heading: float | None,
        legs: int | None,
        prior: Mapping[str, float] | ArrayLike | None,
        weights: ArrayLike | None,
        scale: ArrayLike | None,
    ) -> Task:
        states = np.atleast_2d(finite(target, "target"))
        if states.ndim != 2 or states.shape[1] not in (2, 4) or not states.size:
            raise InputError(
                f"target has shape {np.shape(target)}: must be (2,), (4,), (targets, 2) "
                "or (targets, 4)"
            )
        n = states.shape[1]
        names = FIXED if n == 2 else MOVING
        full = np.zeros((states.shape[0], 4))
        full[:, :n] = states
        origin = finite(start, "start [m]")
        if origin.shape != (2,):
            raise InputError(f"start has shape {origin.shape}: must be (2,), east and north")
        slow, fast = _speeds(speed)
        positive(dt, "dt", "s")
        dt = number(dt, "dt")
        samples = whole(samples, "samples", 2)
        moves = int(samples) - 1
        if legs is not None and not 1 <= whole(legs, "legs", 1) <= moves:
            raise InputError(f"legs = {legs}: must be from 1 to the number of moves, {moves}")
        if max_turn_rate is not None:
            positive(max_turn_rate, "max_turn_rate", "rad/s")
        if sigma is None:
            if prior is not None:
                raise InputError("prior without sigma: what it is worth depends on the bearings")
            sigma = 1.0
        positive(sigma, "sigma", "rad")
        standoff = None if standoff is None else number(standoff, "standoff")
        discs = checked_discs(keep_out)
        check_outside(origin, full, standoff, discs)
        ranges = np.hypot(*(full[:, :2] - origin).T)
        # Its square must not overflow.
        if standoff is not None and 0 < standoff < 1e-100:
            raise InputError(f"standoff = {standoff} m: must be 0 or >= 1e-100")
        if standoff is None:
            standoff = float(min(fast * dt, 0.5 * ranges.min()))
        kind, combinations = _combinations(criterion, full, origin, names)
        return cls(
            start=origin,
            slow=slow,
            fast=fast,
            dt=dt,
            moves=moves,
            kind=kind,
            sigma=number(sigma, "sigma [rad]"),
            standoff=float(standoff),
            keep_out=discs,
            max_turn=np.inf
            if max_turn_rate is None
            else number(max_turn_rate, "max_turn_rate") * dt,
            heading=None if heading is None else float(finite(heading, "heading")),
            legs=legs,
            targets=full,
            weights=_weights(weights, full.shape[0]),
            names=names,
            prior=_prior(prior, full, origin, names),
            scale=_scale(scale, n, moves * dt),
            combinations=combinations,
            known=prior is not None,
        )

    def objective(self, counts: NDArray[np.intp], sharpness: float = np.inf) -> _core.PlanObjective:
        return _core.PlanObjective(
            self.start,
            self.dt,
            [int(count) for count in counts],
            self.targets,
            self.weights,
            self.sigma,
            self.scale,
            self.prior,
            self.kind,
            sharpness,
            self.combinations,
        )

    def cost(self, value: float) -> float:
        """Return what the optimiser makes small."""
        if self.kind == "D":
            return -value
        # Nothing is determined: an eigenvalue of 0, a bound of infinity.
        log = math.log(value) if value > 0 else -math.inf if value == 0 else math.nan
        return -log if self.kind == "E" else log

    def slope(self, value: float) -> float:
        """Return the derivative of the cost by the value."""
        if self.kind == "D":
            return -1.0
        return -1.0 / value if self.kind == "E" else 1.0 / value

    def steered(
        self, wish: str, wanted: ArrayLike, margin: float
    ) -> tuple[Array, NDArray[np.bool]]:
        """Return headings that keep the limits, and whether each path does."""
        discs = self.keep_out.copy()
        discs[:, 2] *= 1 + margin
        out = _core.plan_steered(
            self.start,
            self.dt,
            np.full(self.moves, self.fast * self.dt),
            self.heading,
            self.standoff * (1 + margin),
            self.targets,
            discs,
            self.max_turn,
            wish,
            wanted,
            self.weights @ self.targets,
        )
        return out[..., :-1], out[..., -1] == 0


def _speeds(speed: float | tuple[float, float]) -> tuple[float, float]:
    given = finite(speed, "speed")
    if given.shape not in ((), (2,)):
        raise InputError(f"speed has shape {given.shape}: must be one number, or least and largest")
    slow, fast = (float(given), float(given)) if given.shape == () else map(float, given)
    positive(slow, "speed", "m/s")
    if fast < slow:
        raise InputError(f"speed = ({slow}, {fast}) m/s: the least must not exceed the largest")
    return slow, fast


def checked_discs(keep_out: ArrayLike | None) -> Array:
    """Return circles to keep out of as an array (circles, 3)."""
    discs = np.zeros((0, 3)) if keep_out is None else np.atleast_2d(finite(keep_out, "keep_out"))
    if discs.ndim != 2 or discs.shape[1] != 3:
        raise InputError(
            f"keep_out has shape {discs.shape}: must be (circles, 3): east, north, radius"
        )
    return discs


def check_outside(origin: Array, targets: Array, standoff: float | None, discs: Array) -> None:
    """Refuse a start from which the limits cannot be kept."""
    if standoff is not None and not number(standoff, "standoff") >= 0:
        raise InputError(f"standoff = {standoff} m: must be >= 0 and finite")
    for i, target in enumerate(targets):
        distance = float(np.hypot(*(target[:2] - origin)))
        which = "target" if len(targets) == 1 else f"target[{i}]"
        if distance == 0:
            raise InputError(f"start is on {which}: a bearing needs a range > 0")
        if standoff is not None and distance < standoff:
            raise InputError(
                f"start is {distance:.6g} m from {which}, inside standoff = {standoff:.6g} m: "
                "no path from there keeps it"
            )
    for i, (x, y, radius) in enumerate(discs):
        if not radius > 0:
            raise InputError(f"keep_out[{i}]: its radius = {radius} m must be > 0")
        distance = float(np.hypot(x - origin[0], y - origin[1]))
        if distance < radius:
            raise InputError(
                f"start is {distance:.6g} m from the centre of keep_out[{i}], inside its radius "
                f"{radius:.6g} m: no path from there keeps it"
            )


def _weights(weights: ArrayLike | None, count: int) -> Array:
    if weights is None:
        return np.full(count, 1 / count)
    given = np.atleast_1d(finite(weights, "weights"))
    if given.shape != (count,):
        raise InputError(
            f"weights has shape {given.shape}: must be ({count},), one for each target"
        )
    if (bad := np.flatnonzero(given < 0)).size:
        raise InputError(f"weights[{bad[0]}] = {given[bad[0]]}: must be >= 0")
    if not given.sum() > 0:
        raise InputError("weights are all zero: one at least must be > 0")
    shares: Array = given / given.sum()
    return shares


def _scale(scale: ArrayLike | None, n: int, duration: float) -> Array:
    if scale is None:
        return np.array([1.0, 1.0, 1 / duration, 1 / duration])[:n]
    given = finite(scale, "scale")
    if given.shape != (n,):
        raise InputError(f"scale has shape {given.shape}: must be ({n},), one for each state")
    if (bad := np.flatnonzero(given <= 0)).size:
        raise InputError(f"scale[{bad[0]}] = {given[bad[0]]}: must be > 0")
    return given


def _directions(targets: Array, origin: Array, names: tuple[str, ...]) -> dict[str, Array]:
    """Return the named combinations, (targets, states) each; NaN where one does not exist."""
    n = len(names)
    directions = {name: np.tile(np.eye(n)[i], (len(targets), 1)) for i, name in enumerate(names)}
    offset = targets[:, :2] - origin
    ranges = np.hypot(*offset.T)[:, None]
    sight = offset / ranges
    for name, pair in (("range", sight), ("bearing", sight[:, ::-1] * (1, -1) / ranges)):
        directions[name] = np.zeros((len(targets), n))
        directions[name][:, :2] = pair
    if n == 4:
        velocity = targets[:, 2:]
        speed = np.hypot(*velocity.T)[:, None]
        along = velocity / np.where(speed > 0, speed, np.nan)
        for name, pair in (("speed", along), ("course", along[:, ::-1] * (1, -1) / speed)):
            directions[name] = np.zeros((len(targets), n))
            directions[name][:, 2:] = pair
    return directions


def _direction(name: str, directions: Mapping[str, Array], what: str) -> Array:
    if name not in directions:
        raise InputError(f"{what} = {name!r}: must be one of {', '.join(directions)}")
    if np.isnan(directions[name]).any():
        raise InputError(f"{what} = {name!r}: a target at rest has none")
    return directions[name]


def _combinations(
    criterion: Criterion, targets: Array, origin: Array, names: tuple[str, ...]
) -> tuple[str, Array]:
    none = np.zeros((len(targets), len(names)))
    if isinstance(criterion, str):
        if criterion in ("D", "A", "E"):
            return criterion, none
    elif isinstance(criterion, Mapping) and set(criterion) == {"combination"}:
        wanted = criterion["combination"]
        if isinstance(wanted, str):
            directions = _directions(targets, origin, names)
            return "combination", _direction(wanted, directions, "combination")
        vector = finite(wanted, "combination")
        if vector.shape != (len(names),) or not vector.any():
            raise InputError(
                f"combination = {wanted!r}: must be a name or {len(names)} numbers, not all zero"
            )
        return "combination", none + vector
    raise InputError(
        f'criterion = {criterion!r}: must be "D", "A", "E" or {{"combination": name or numbers}}'
    )


def _prior(
    prior: Mapping[str, float] | ArrayLike | None,
    targets: Array,
    origin: Array,
    names: tuple[str, ...],
) -> Array:
    """Return rows of what is known beforehand, (targets, rows, states)."""
    n, count = len(names), len(targets)
    if prior is None:
        return np.zeros((count, 0, n))
    if isinstance(prior, Mapping):
        directions = _directions(targets, origin, names)
        rows = []
        for name, deviation in options.mapping(prior, "prior").items():
            positive(deviation, f"prior of {name}", "")
            rows.append(_direction(name, directions, "prior") / deviation)
        return np.stack(rows, axis=1) if rows else np.zeros((count, 0, n))
    given = as_float_array(prior, "prior")
    if given.shape == (n,):
        if (bad := np.flatnonzero(~(given > 0))).size:
            raise InputError(f"prior[{bad[0]}] = {given[bad[0]]}: must be > 0, or inf for none")
        return np.tile(np.diag(1 / given), (count, 1, 1))
    if given.shape != (n, n):
        raise InputError(
            f"prior has shape {given.shape}: must be ({n},), deviations, or ({n}, {n}), information"
        )
    finite(given, "prior")
    unit = np.sqrt(np.maximum(np.diag(given), 0.0))
    unit = np.where(unit > 0, unit, 1.0)
    values, vectors = np.linalg.eigh(given / np.outer(unit, unit))
    symmetric = np.allclose(given, given.T, rtol=1e-10, atol=0)
    if not symmetric or values.min() < -1e-10 * max(values.max(), 0.0):
        raise InputError("prior is not symmetric and positive semidefinite: an information must be")
    rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * unit
    return np.tile(rows, (count, 1, 1))


def moved(targets: Array, times: NDArray[Any]) -> Array:
    positions: Array = targets[:, None, :2] + times[:, None] * targets[:, None, 2:]
    return positions


def finite(value: ArrayLike, name: str) -> Array:
    """Return an array of finite numbers, or say which is not."""
    array = as_float_array(value, name).copy()
    if len(bad := np.argwhere(~np.isfinite(array))):
        index = "".join(f"[{i}]" for i in bad[0])
        raise InputError(f"{name}{index} = {array[tuple(bad[0])]}: must be finite")
    return array


def positive(value: float, name: str, unit: str) -> None:
    """Refuse a number that is not above zero and finite."""
    if not number(value, name) > 0:
        raise InputError(f"{name} = {value} {unit}: must be > 0".replace(" :", ":"))
