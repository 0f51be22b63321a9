"""What a plan is asked for, checked and in arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, number, whole
from gramian.exceptions import InputError
from gramian.models.maneuver._sensing import Sensing

__all__ = [
    "Criterion",
    "Over",
    "Task",
    "check_outside",
    "checked_discs",
    "finite",
    "moved",
    "positive",
]

Array = NDArray[np.float64]
Criterion = Literal["D", "A", "E"] | Mapping[str, Any]
Over = Literal["expectation", "worst"] | Mapping[str, float]

FIXED = ("x", "y")
MOVING = ("x0", "y0", "vx", "vy")


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that was asked, checked and in arrays."""

    #: Of each observer, (observers, 2).
    starts: Array
    #: Whether one observer was given by its place alone.
    single: bool
    slow: float
    fast: float
    dt: float
    moves: int
    kind: str
    over: str
    #: With over = "chance": the probability.
    chance: float
    sensors: tuple[Sensing, ...]
    standoff: float
    keep_out: Array
    polygons: list[Array]
    max_turn: float
    heading: float | None
    legs: int | None
    home: tuple[Array, float] | None
    distance: float
    separation: float
    current: Array
    #: (beliefs, targets, 4).
    targets: Array
    weights: Array
    #: States of one target.
    dimension: int
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
        sensors: Sequence[Sensing] | None,
        belief: ArrayLike | None,
        over: Over,
        standoff: float | None,
        keep_out: ArrayLike | None,
        polygons: Sequence[ArrayLike] | None,
        max_turn_rate: float | None,
        heading: float | None,
        legs: int | None,
        return_to: ArrayLike | None,
        max_distance: float | None,
        separation: float | None,
        current: ArrayLike | None,
        prior: Mapping[str, float] | ArrayLike | None,
        weights: ArrayLike | None,
        scale: ArrayLike | None,
    ) -> Task:
        states = _states(target)
        how, chance = _over(over)
        count, n = states.shape[1:]
        if belief is not None:
            states, weights = _sigma_points(states, belief, weights)
        full = np.zeros((*states.shape[:2], 4))
        full[..., :n] = states
        origins, single = _starts(start)
        slow, fast = _speeds(speed)
        positive(dt, "dt", "s")
        dt = number(dt, "dt")
        samples = whole(samples, "samples", 2, 1_000_000)
        moves = int(samples) - 1
        if not fast * dt < 1e150:
            raise InputError(f"a step of {fast * dt:.3g} m: its square overflows float64")
        if legs is not None and not 1 <= whole(legs, "legs", 1) <= moves:
            raise InputError(f"legs = {legs}: must be from 1 to the number of moves, {moves}")
        if max_turn_rate is not None:
            positive(max_turn_rate, "max_turn_rate", "rad/s")
        sensors = _sensors(sensors, sigma, prior)
        names = _names(count, n, sensors)
        if len(names) > _core.PLAN_STATES:
            raise InputError(
                f"{len(names)} states, {', '.join(names)}: at most {_core.PLAN_STATES} are possible"
            )
        standoff = None if standoff is None else number(standoff, "standoff")
        discs = checked_discs(keep_out)
        everything = full.reshape(-1, 4)
        for i, origin in enumerate(origins):
            who = "start" if single else f"start[{i}]"
            check_outside(origin, everything, standoff, discs, who)
        outlines = _polygons(polygons, origins)
        ranges = np.hypot(*(everything[:, None, :2] - origins).reshape(-1, 2).T)
        # Its square must not overflow.
        if standoff is not None and 0 < standoff < 1e-100:
            raise InputError(f"standoff = {standoff} m: must be 0 or >= 1e-100")
        if standoff is None:
            standoff = float(min(fast * dt, 0.5 * ranges.min()))
        apart = _separation(separation, origins)
        if max_distance is not None:
            _check_distance(max_distance, slow * dt * moves)
        drift = np.zeros(2) if current is None else finite(current, "current")
        if drift.shape != (2,):
            raise InputError(f"current has shape {drift.shape}: must be (2,), east and north, m/s")
        longest = fast * dt * moves
        if max_distance is not None:
            longest = min(longest, number(max_distance, "max_distance"))
        home = _home(
            return_to,
            origins,
            step=fast * dt,
            longest=longest,
            drift=drift * dt * moves,
            apart=apart,
        )
        ends = everything[:, :2] + dt * moves * everything[:, 2:]
        _check_home(home, discs, 0.0 if standoff is None else standoff, ends)
        origin = origins.mean(axis=0)
        kind, combinations = _combinations(criterion, full, origin, names, n)
        return cls(
            starts=origins,
            single=single,
            slow=slow,
            fast=fast,
            dt=dt,
            moves=moves,
            kind=kind,
            over=how,
            chance=chance,
            sensors=sensors,
            standoff=float(standoff),
            keep_out=discs,
            polygons=outlines,
            max_turn=np.inf
            if max_turn_rate is None
            else number(max_turn_rate, "max_turn_rate") * dt,
            heading=None if heading is None else float(finite(heading, "heading")),
            legs=legs,
            home=home,
            distance=np.inf if max_distance is None else number(max_distance, "max_distance"),
            separation=apart,
            current=drift,
            targets=full,
            weights=_weights(weights, full.shape[0]),
            dimension=n,
            names=names,
            prior=_prior(prior, full, origin, names, n),
            scale=_scale(scale, count, n, len(names), moves * dt),
            combinations=combinations,
            known=prior is not None,
        )

    def problem(self) -> dict[str, Any]:
        """Return it for the extension."""
        own = self.names[self.dimension * self.targets.shape[1] :]
        index = {name: k for k, name in enumerate(own)}
        sensors = [sensor.given(index) for sensor in self.sensors]
        home = None if self.home is None else (self.home[0].tolist(), self.home[1])
        return {
            "dt": self.dt,
            "moves": self.moves,
            "observers": [
                {
                    "start": start.tolist(),
                    "speed": [self.slow, self.fast],
                    "heading": self.heading,
                    "max_turn": self.max_turn,
                    "home": home,
                    "distance": self.distance,
                    "sensors": sensors,
                }
                for start in self.starts
            ],
            "beliefs": [
                {
                    "targets": targets.tolist(),
                    "weight": float(weight),
                    "prior": prior.ravel().tolist(),
                    "combination": combination.tolist(),
                }
                for targets, weight, prior, combination in zip(
                    self.targets, self.weights, self.prior, self.combinations, strict=True
                )
            ],
            "dimension": self.dimension,
            "nuisances": len(own),
            "scale": self.scale.tolist(),
            "criterion": self.kind,
            "over": self.over,
            "chance": self.chance,
            "standoff": self.standoff,
            "discs": self.keep_out.tolist(),
            "polygons": [outline.tolist() for outline in self.polygons],
            "separation": self.separation,
            "current": self.current.tolist(),
            "legs": self.legs,
        }

    def cost(self, value: float) -> float:
        """Return what the search makes small."""
        if self.kind == "D":
            return -value
        # Nothing is determined: an eigenvalue of 0, a bound of infinity.
        log = math.log(value) if value > 0 else -math.inf if value == 0 else math.nan
        return -log if self.kind == "E" else log

    def law(self, law: str, side: int, start: Array) -> Array:
        """Return the headings of a law that keep the limits from a start on."""
        aim = np.tensordot(self.weights, self.targets, 1).mean(axis=0)
        return _core.plan_steered(
            start,
            self.dt,
            np.full(self.moves, self.fast * self.dt),
            self.heading,
            self.standoff,
            self.targets.reshape(-1, 4),
            self.keep_out,
            self.max_turn,
            law,
            float(side),
            aim,
        )[:-1]


def _over(over: Over) -> tuple[str, float]:
    """Return what is made of beliefs, and the probability of a chance."""
    if isinstance(over, Mapping):
        if set(over) != {"chance"}:
            raise InputError(f'over = {dict(over)!r}: must be {{"chance": probability}}')
        chance = number(over["chance"], "over['chance']")
        if not 0 < chance < 1:
            raise InputError(f"over['chance'] = {chance}: must be above 0 and below 1")
        return "chance", chance
    return options.choice(over, "over", ("expectation", "worst")), 0.5


def _states(target: ArrayLike) -> Array:
    """Return the states (beliefs, targets, 2 or 4)."""
    states = finite(target, "target")
    if states.ndim < 3:
        states = np.atleast_2d(states)[:, None, :]
    if states.ndim != 3 or states.shape[-1] not in (2, 4) or not states.size:
        raise InputError(
            f"target has shape {np.shape(target)}: must be (2,), (4,), (beliefs, 2), "
            "(beliefs, 4) or, for several targets at once, (beliefs, targets, 2 or 4)"
        )
    return states


def _starts(start: ArrayLike) -> tuple[Array, bool]:
    """Return the starts (observers, 2), and whether one was given by itself."""
    origins = finite(start, "start [m]")
    single = origins.ndim == 1
    origins = np.atleast_2d(origins)
    if origins.ndim != 2 or origins.shape[1] != 2 or not origins.size:
        raise InputError(
            f"start has shape {np.shape(start)}: must be (2,), east and north, or (observers, 2)"
        )
    return origins, single


def _sensors(
    sensors: Sequence[Sensing] | None,
    sigma: float | None,
    prior: Mapping[str, float] | ArrayLike | None,
) -> tuple[Sensing, ...]:
    if sensors is not None and sigma is not None:
        raise InputError("sigma and sensors: give sigma for bearings alone, or sensors")
    if sensors is None:
        if sigma is None and prior is not None:
            raise InputError("prior without sigma: what it is worth depends on the bearings")
        sigma = 1.0 if sigma is None else sigma
        positive(sigma, "sigma", "rad")
        sensors = (Sensing("bearing", sigma),)
    sensors = (sensors,) if isinstance(sensors, Sensing) else tuple(sensors)
    if not sensors:
        raise InputError("sensors is empty: one at least must see the target")
    for i, sensor in enumerate(sensors):
        if not isinstance(sensor, Sensing):
            raise InputError(f"sensors[{i}] = {sensor!r}: must be a Sensing")
    return sensors


def _separation(separation: float | None, origins: Array) -> float:
    apart = 0.0 if separation is None else number(separation, "separation")
    if apart < 0:
        raise InputError(f"separation = {separation} m: must be >= 0")
    gaps = [float(np.hypot(*(a - b))) for i, a in enumerate(origins) for b in origins[i + 1 :]]
    if gaps and min(gaps) < apart:
        raise InputError(
            f"the observers start {min(gaps):.6g} m apart, nearer than separation = "
            f"{apart:.6g} m: no paths from there keep it"
        )
    return apart


def _home(
    return_to: ArrayLike | None,
    origins: Array,
    *,
    step: float,
    longest: float,
    drift: Array,
    apart: float,
) -> tuple[Array, float] | None:
    """Return the place and the radius; `longest` of a path through the water."""
    if return_to is None:
        return None
    home = finite(return_to, "return_to")
    if home.shape not in ((2,), (3,)) or (home.shape == (3,) and not home[2] > 0):
        raise InputError(
            f"return_to = {return_to!r}: must be (east, north) or (east, north, radius)"
        )
    within = float(home[2]) if home.shape == (3,) else step
    for i, origin in enumerate(origins):
        away = float(np.hypot(*(home[:2] - origin - drift)))
        if away - within > longest * (1 + 1e-12):
            who = "start" if len(origins) == 1 else f"start[{i}]"
            less = f" that the current leaves, {away:.6g} m" if drift.any() else ""
            raise InputError(
                f"return_to is {np.hypot(*(home[:2] - origin)):.6g} m from {who}{less}: "
                f"a path of {longest:.6g} m does not reach it within {within:.6g} m"
            )
    if len(origins) > 1 and apart > 2 * within:
        raise InputError(
            f"return_to within {within:.6g} m and separation = {apart:.6g} m: observers there "
            f"are at most {2 * within:.6g} m apart"
        )
    return home[:2], within


def _check_home(
    home: tuple[Array, float] | None, discs: Array, standoff: float, ends: Array
) -> None:
    """Refuse a place to return to that no path may enter."""
    if home is None:
        return
    (east, north), within = home
    for i, (x, y, radius) in enumerate(discs):
        if np.hypot(x - east, y - north) + within < radius:
            raise InputError(f"return_to is inside keep_out[{i}]: no path may end there")
    for i, (x, y) in enumerate(ends):
        if np.hypot(x - east, y - north) + within < standoff:
            which = "target" if len(ends) == 1 else f"target[{i}]"
            raise InputError(
                f"return_to is inside standoff = {standoff:.6g} m of {which} at the end: "
                "no path may end there"
            )


def _check_distance(max_distance: float, least: float) -> None:
    positive(max_distance, "max_distance", "m")
    if max_distance < least * (1 - 1e-12):
        raise InputError(
            f"max_distance = {max_distance} m: at the least speed the path takes {least:.6g} m"
        )


def _names(count: int, n: int, sensors: Sequence[Sensing]) -> tuple[str, ...]:
    own = FIXED if n == 2 else MOVING
    names = [name if count == 1 else f"{name}_{i + 1}" for i in range(count) for name in own]
    for sensor in sensors:
        for name in sensor.states():
            if name in names[: count * n]:
                raise InputError(f"{name!r} is a state of the target: choose another name")
            if name not in names:
                names.append(name)
    return tuple(names)


def _sigma_points(
    states: Array, belief: ArrayLike, weights: ArrayLike | None
) -> tuple[Array, Array]:
    """Return the points with the mean and the covariance of a Gaussian belief."""
    _, count, n = states.shape
    size = count * n
    covariance = finite(belief, "belief")
    if len(states) != 1 or weights is not None:
        raise InputError("belief is the covariance of one target state: give one, without weights")
    if covariance.shape != (size, size):
        raise InputError(f"belief has shape {covariance.shape}: must be ({size}, {size})")
    values, vectors = np.linalg.eigh(covariance)
    if not np.allclose(covariance, covariance.T) or values.min() < -1e-10 * max(values.max(), 0.0):
        raise InputError("belief is not symmetric and positive semidefinite: a covariance must be")
    # As far out as keeps the fourth moment of a Gaussian in one dimension.
    spread = np.sqrt(3.0 * np.maximum(values, 0.0)) * vectors
    use = values > 1e-12 * max(values.max(), 1e-300)
    spread = spread[:, use].T
    middle = states.reshape(size)
    points = np.concatenate([[middle], middle + spread, middle - spread])
    rank = len(spread)
    if rank <= 2:
        shares = np.concatenate([[1 - rank / 3], np.full(2 * rank, 1 / 6)])
    else:
        scale = np.sqrt(rank / 3)
        points = np.concatenate([middle + scale * spread, middle - scale * spread])
        shares = np.full(2 * rank, 1 / (2 * rank))
    return points.reshape(-1, count, n), shares


def _polygons(polygons: Sequence[ArrayLike] | None, origins: Array) -> list[Array]:
    out = []
    for i, given in enumerate(() if polygons is None else polygons):
        outline = finite(given, f"polygons[{i}]")
        if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
            raise InputError(
                f"polygons[{i}] has shape {outline.shape}: must be (corners, 2), 3 or more"
            )
        a, b = outline, np.roll(outline, -1, axis=0)
        if not np.abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) > 0:
            raise InputError(f"polygons[{i}] has no area")
        for k, (x, y) in enumerate(origins):
            over = (a[:, 1] > y) != (b[:, 1] > y)
            with np.errstate(divide="ignore", invalid="ignore"):
                cross = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
            if np.count_nonzero(over & (x < cross)) % 2:
                who = "start" if len(origins) == 1 else f"start[{k}]"
                raise InputError(f"{who} is inside polygons[{i}]: no path from there keeps out")
        out.append(outline)
    return out


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


def check_outside(
    origin: Array, targets: Array, standoff: float | None, discs: Array, who: str = "start"
) -> None:
    """Refuse a start from which the limits cannot be kept."""
    if standoff is not None and not number(standoff, "standoff") >= 0:
        raise InputError(f"standoff = {standoff} m: must be >= 0 and finite")
    for i, target in enumerate(targets):
        distance = float(np.hypot(*(target[:2] - origin)))
        which = "target" if len(targets) == 1 else f"target[{i}]"
        if distance == 0:
            raise InputError(f"{who} is on {which}: a bearing needs a range > 0")
        if standoff is not None and distance < standoff:
            raise InputError(
                f"{who} is {distance:.6g} m from {which}, inside standoff = {standoff:.6g} m: "
                "no path from there keeps it"
            )
    for i, (x, y, radius) in enumerate(discs):
        if not radius > 0:
            raise InputError(f"keep_out[{i}]: its radius = {radius} m must be > 0")
        distance = float(np.hypot(x - origin[0], y - origin[1]))
        if distance < radius:
            raise InputError(
                f"{who} is {distance:.6g} m from the centre of keep_out[{i}], inside its radius "
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


def _scale(scale: ArrayLike | None, count: int, n: int, states: int, duration: float) -> Array:
    if scale is None:
        own = np.array([1.0, 1.0, 1 / duration, 1 / duration])[:n]
        return np.concatenate([np.tile(own, count), np.ones(states - count * n)])
    given = finite(scale, "scale")
    if given.shape != (states,):
        raise InputError(f"scale has shape {given.shape}: must be ({states},), one for each state")
    if (bad := np.flatnonzero(given <= 0)).size:
        raise InputError(f"scale[{bad[0]}] = {given[bad[0]]}: must be > 0")
    return given


def _directions(targets: Array, origin: Array, names: tuple[str, ...], n: int) -> dict[str, Array]:
    """Return the named combinations, (beliefs, states) each; NaN where one does not exist."""
    size = len(names)
    directions = {name: np.tile(np.eye(size)[i], (len(targets), 1)) for i, name in enumerate(names)}
    if targets.shape[1] > 1:
        return directions
    target = targets[:, 0]
    offset = target[:, :2] - origin
    ranges = np.hypot(*offset.T)[:, None]
    sight = offset / ranges
    for name, pair in (("range", sight), ("bearing", sight[:, ::-1] * (1, -1) / ranges)):
        directions[name] = np.zeros((len(targets), size))
        directions[name][:, :2] = pair
    if n == 4:
        velocity = target[:, 2:]
        speed = np.hypot(*velocity.T)[:, None]
        along = velocity / np.where(speed > 0, speed, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            across = along[:, ::-1] * (1, -1) / speed
        for name, pair in (("speed", along), ("course", across)):
            directions[name] = np.zeros((len(targets), size))
            directions[name][:, 2:4] = pair
    return directions


def _direction(name: str, directions: Mapping[str, Array], what: str) -> Array:
    if name not in directions:
        raise InputError(f"{what} = {name!r}: must be one of {', '.join(directions)}")
    if np.isnan(directions[name]).any():
        raise InputError(f"{what} = {name!r}: a target at rest has none")
    return directions[name]


def _combinations(
    criterion: Criterion, targets: Array, origin: Array, names: tuple[str, ...], dimension: int
) -> tuple[str, Array]:
    none = np.zeros((len(targets), len(names)))
    if isinstance(criterion, str):
        if criterion in ("D", "A", "E"):
            return criterion, none
    elif isinstance(criterion, Mapping) and set(criterion) == {"combination"}:
        wanted = criterion["combination"]
        if isinstance(wanted, str):
            directions = _directions(targets, origin, names, dimension)
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
    dimension: int,
) -> Array:
    """Return rows of what is known beforehand, (targets, rows, states)."""
    n, count = len(names), len(targets)
    if prior is None:
        return np.zeros((count, 0, n))
    if isinstance(prior, Mapping):
        directions = _directions(targets, origin, names, dimension)
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
