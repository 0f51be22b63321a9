"""A body that is more than one dipole on a straight pass, as it is assumed: its model and truth."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian._arrays import as_float_array, finite, number
from gramian._text import describe_null_space
from gramian._values import Value
from gramian.exceptions import InputError, UnobservableError
from gramian.models.dipole import _localize, _model
from gramian.models.dipole._described import Motion, Sources
from gramian.models.dipole._estimate import PLACED, Description, DipoleModel
from gramian.models.dipole._result import Localization
from gramian.monte_carlo.experiment import Estimates
from gramian.problem import Problem

__all__ = ["Body", "Passing", "as_body"]

Array = NDArray[np.float64]

#: Deviations of the sensors' errors that are states.
_SENSORS = ("attitude", "scale")


@dataclass(frozen=True, eq=False)
class Body(Value):
    """What passes beside one dipole on a straight line, true values and all.

    Parameters
    ----------
    quadrupole : array_like, shape (3, 3), optional
        At the place of the dipole, A m^3.
    dipoles : array_like, shape (n, 6), optional
        The dipoles after the first: offset from it (m) and moment (A m^2), at the first time.
    acceleration : float or array_like, shape (3,), optional
        Along the track, or in any direction, m/s^2.
    turn_rate : float, optional
        About z, clockwise seen from above, rad/s.
    induced_volume : float, optional
        Of the moment that `earth_field` induces, m^3.
    earth_field : array_like, shape (3,), optional
        Tesla.
    attitude, scale : float, optional
        Deviations of the errors of each sensor, rad and 1.
    """

    quadrupole: Array | None = None
    dipoles: Array | None = None
    acceleration: float | Array | None = None
    turn_rate: float | None = None
    induced_volume: float | None = None
    earth_field: tuple[float, float, float] | None = None
    attitude: float | None = None
    scale: float | None = None

    def __init__(self, **given: Any) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        _model._entries(given["quadrupole"])
        for name in ("quadrupole", "dipoles"):
            value = given[name]
            put(name, None if value is None else finite(value, name).copy())
        if self.dipoles is not None and (
            self.dipoles.ndim != 2 or self.dipoles.shape[1] != 6 or not 0 < len(self.dipoles) < 4
        ):
            raise InputError(
                f"dipoles has shape {self.dipoles.shape}: must be (n, 6), offset and moment of up "
                "to 3 after the first"
            )
        if self.dipoles is not None and self.quadrupole is not None:
            raise InputError("quadrupole is of one dipole: leave it or dipoles out")
        force = _as_acceleration(given["acceleration"])
        put("acceleration", force)
        for name, unit in (("turn_rate", " [rad/s]"), ("induced_volume", " [m^3]")):
            value = given[name]
            put(name, None if value is None else number(value, name + unit))
        if self.turn_rate is not None and force is not None:
            raise InputError("acceleration and turn_rate are two motions: give one of them")
        earth = given["earth_field"]
        if (earth is None) != (self.induced_volume is None):
            raise InputError("earth_field and induced_volume belong together: give both")
        if earth is not None and self.quadrupole is not None:
            raise InputError(
                "earth_field induces a quadrupole too, which is not modelled: leave it or "
                "quadrupole out"
            )
        earth = None if earth is None else _as_earth(earth)
        put("earth_field", earth)
        put("attitude", _as_deviation(given["attitude"], "attitude"))
        put("scale", _as_deviation(given["scale"], "scale"))

    @property
    def plain(self) -> bool:
        """Whether it is one dipole on a straight pass, seen by exact sensors."""
        return self.description == Description()

    @property
    def sources(self) -> Sources:
        """As `localize` takes it."""
        extra = 0 if self.dipoles is None else len(self.dipoles)
        return "quadrupole" if self.quadrupole is not None else 1 + extra

    @property
    def motion(self) -> Motion:
        """As `localize` takes it."""
        if self.turn_rate is not None:
            return "turning"
        if self.acceleration is None:
            return "straight"
        return "accelerated" if np.ndim(self.acceleration) else "along"

    @property
    def description(self) -> Description:
        """The description that `localize` finds it by."""
        return Description(
            motion=self.motion,
            sources=1 if self.dipoles is None else 1 + len(self.dipoles),
            quadrupole=self.quadrupole is not None,
            attitude=self.attitude,
            scale=self.scale,
            earth_field=self.earth_field,
        )

    def values(self) -> dict[str, float]:
        """Return the true values of the states beside the pass, by their names."""
        found: dict[str, float] = {}
        if self.acceleration is not None:
            each = np.ravel(self.acceleration).tolist()
            names: tuple[str, ...] = ("acceleration along",)
            names = ("ax", "ay", "az") if len(each) == 3 else names
            found |= dict(zip(names, each, strict=True))
        if self.turn_rate is not None:
            found["turn rate"] = self.turn_rate
        for k, line in enumerate([] if self.dipoles is None else self.dipoles.tolist()):
            names = tuple(f"{part} of dipole {k + 2}" for part in PLACED)
            found |= dict(zip(names, line, strict=True))
        entries = _model._entries(self.quadrupole)
        if entries is not None:
            found |= dict(zip(_model.ENTRIES, entries.tolist(), strict=True))
        if self.induced_volume is not None:
            found["induced volume"] = self.induced_volume
        return found


@dataclass(frozen=True, eq=False)
class Passing(Value):
    """A body that passes sensors: its model at the true states.

    `known` are the names of what the estimator is told exactly, `prior` what it is told to a
    deviation, as (mean, deviation).
    """

    body: Body
    state: Array
    times: Array
    sigma: float | Array
    known: tuple[str, ...]
    sensors: Array | None
    ambient: tuple[float, float, float] | None
    baselines: Array | None
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def model(self) -> DipoleModel:
        """The model, with the states of `known` at their true values; sizes are free."""
        places = np.zeros((1, 3)) if self.sensors is None else self.sensors
        shape = len(self.times), len(places), 3 if self.ambient is None else 1
        level = _model.as_deviations(as_float_array(self.sigma, "sigma [T]"), shape)
        return DipoleModel(
            self.times - self.times[0],
            places,
            1.0 / level,
            self.state,
            {n: float(self.state[k]) for k, n in enumerate(_model.NAMES) if n in self.known},
            self.prior,
            spacing=float(np.median(np.diff(self.times))) if len(self.times) > 1 else 1.0,
            description=self.body.description,
            baselines=self.baselines,
            ambient=self.ambient,
        )

    @cached_property
    def truth(self) -> Array:
        """The true states of the model; errors of the sensors are 0."""
        model, values = self.model, self.body.values()
        x = model.coordinates(self.state)
        for k, name in enumerate(model.names):
            if name not in _model.NAMES:
                x[k] = values.get(name, 0.0)
        given = self.body.quadrupole
        if given is not None:
            off = np.abs(model.quadrupole(x)[0] - given).max()
            if not off <= 1e-6 * np.abs(given).max():
                raise InputError(
                    "quadrupole must be about the centre, Q m = 0 in the components of r0 that are "
                    "not known: no measurement tells the rest of it from a move"
                )
        return x

    def read(self, x: Array) -> Array:
        """Return the exact readings (K, S, components) at states."""
        return self.model.h(x).reshape(self.model.weights.shape)

    @cached_property
    def problem(self) -> Problem:
        """The rows at the true states, with those of the sensors' errors."""
        model, x = self.model, self.truth
        rows = model.handle(np.zeros(model.weights.shape)).linearize(x)[1]
        gradients = {k: model.functions[k][0](x)[1] for k in ("range", "speed", "moment")}
        functions = {k: along for k, along in gradients.items() if along.any()}
        r0, v, m = np.split(self.state, 3)
        pass_scales = _model._scales(r0, v, m, self.times, self.sensors)
        scales = dict(zip(_model.NAMES, pass_scales, strict=True))
        scale = np.array([scales.get(name, np.nan) for name in model.names])
        return Problem(rows, model.names, units=model.units, scale=scale, combinations=functions)

    def bound(self, known: Mapping[str, float]) -> Array:
        """Return the least deviations (9,) of the pass, with what is known and the prior."""
        model = replace(self.model, known=known)
        x = self.model.carry(self.truth, model)
        analysis = _core.Analysis(model.handle(np.zeros(model.weights.shape)).linearize(x)[1], None)
        covariance = analysis.crlb()
        if covariance is None:
            directions = describe_null_space(analysis.null_space(), model.names)
            raise UnobservableError(
                f"what is known does not suffice for {model.description}: "
                f"{'; '.join(directions)} is not determined",
                directions,
            )
        columns = model.expand(x)[1]
        variance: Array = ((columns @ covariance) * columns).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _drawn(self, seed: int, first: int, trials: int) -> tuple[Array, Array]:
        """Return true states (trials, n) and noise (trials, K, S, components) of trials."""
        model, truth = self.model, self.truth
        own = [k for k, name in enumerate(model.names) if name.startswith(_SENSORS)]
        normals = _core.normals(seed, first, trials, model.weights.size + len(own))
        states = np.tile(truth, (trials, 1))
        for j, k in enumerate(own):
            level = self.body.attitude if model.names[k].startswith("attitude") else self.body.scale
            states[:, k] = (level or 0.0) * normals[:, model.weights.size + j]
        noise = normals[:, : model.weights.size].reshape(-1, *model.weights.shape)
        return states, noise

    def simulate(self, seed: int, first: int, trials: int) -> tuple[Array, Array]:
        """Return fields (trials, K, ...), as `measure` gives them, and true states (trials, n)."""
        states, noise = self._drawn(seed, first, trials)
        level = np.where(self.model.weights > 0, 1.0 / self.model.weights, np.nan)
        still = [self.read(x) for x in states] if trials else np.zeros(noise.shape)
        fields = np.array(still) + level * noise
        if self.ambient is not None:
            fields = fields[..., 0]
        if self.sensors is None:
            fields = fields[:, :, 0]
        return fields, states

    def located(
        self,
        seen: Array,
        known: Mapping[str, float],
        prior: Mapping[str, tuple[float, float]],
        starts: int = 12,
    ) -> Localization:
        """Return what `localize` finds by the description of the body."""
        body = self.body
        return _localize.localize(
            self.times,
            seen,
            known,
            prior=prior,
            sensors=self.sensors,
            ambient=self.ambient,
            baselines=self.baselines,
            sources=body.sources,
            motion=body.motion,
            attitude=body.attitude,
            scale=body.scale,
            earth_field=body.earth_field,
            sigma=self.sigma,
            missing="drop",
            starts=starts,
        )

    def estimate(
        self,
        seed: int,
        first: int,
        trials: int,
        known: Mapping[str, float],
        priors: Sequence[Mapping[str, tuple[float, float]]],
    ) -> Estimates:
        """Return the errors of `localize` with the description of the body, a prior a trial."""
        fields, states = self.simulate(seed, first, trials)
        errors = np.full(states.shape, np.nan)
        status = np.zeros(trials, dtype=np.int16)
        for k, (seen, x) in enumerate(zip(fields, states, strict=True)):
            try:
                found = self.located(seen, known, priors[k])
            except (InputError, UnobservableError) as error:
                status[k] = 2 if isinstance(error, UnobservableError) else 3
                continue
            errors[k] = self._nearest(found, x) - x
            status[k] = 0 if found.converged else 1
        kinds = {1: "not converged", 2: "unobservable", 3: "no description fits"}
        return Estimates(errors, None, status, kinds)

    def pass_of(self, found: Localization, x: Array) -> Array:
        """Return the pass (9,) of an answer to a record of true states."""
        nearest: Array = self.model.expand(self._nearest(found, x))[0]
        # What the estimator was told need not be true.
        for k, name in enumerate(_model.NAMES):
            nearest[k] = found.known.get(name, nearest[k])
        return nearest

    def _nearest(self, found: Localization, x: Array) -> Array:
        """Return the states of an answer.

        Of answers that fit the same, and orders of the dipoles, those nearest to true states:
        only what is told of r0 and m says which dipole is the first.
        """
        tied = [np.asarray(found.state)]
        tied += [o.state for o in found.others if o.chi2 <= found.fit.chi2 * (1 + 1e-6) + 1e-9]
        each = [self._named(found.model, y) for one in tied for y in self._orders(found, one)]
        rows = self.model.rows(self.truth)
        return min(each, key=lambda y: float(np.linalg.norm(rows @ (y - x))))

    def _named(self, other: DipoleModel, state: Array) -> Array:
        """Return states of a model at another pass as those of the model here.

        Which numbers of a quadrupole are states depends on the moment, and a vector of known
        size is told by angles there.
        """
        there = dict(zip(other.names, state, strict=True))
        there |= dict(zip(_model.NAMES, other.expand(state)[0].tolist(), strict=True))
        entries = _model._entries(other.quadrupole(state)[0])
        there |= {} if entries is None else dict(zip(_model.ENTRIES, entries, strict=True))
        return np.array([there[name] for name in self.model.names])

    def _orders(self, found: Localization, state: Array) -> list[Array]:
        """Return an answer's states with another of its dipoles called the first.

        Where r0 or m is told, these are refitted, and left out where they cost 9 more.
        """
        model, count = found.model, self.model.description.sources
        orders = [list(order) for order in itertools.permutations(range(count))]
        each = [model.reordered(state, order) for order in orders[1:]]
        if {"x0", "y0", "z0", "mx", "my", "mz", "moment"} & {*self.known, *self.prior}:
            handle = model.handle(found.measurements)
            fits = [handle.minimize(x[None], ("squares", 0.0), 100) for x in each]
            each = [fit[0]["x"] for fit in fits if fit and fit[0]["chi2"] < found.fit.chi2 + 9.0]
        return [state, *each]


def _as_acceleration(given: Any) -> float | Array | None:
    if given is None or not np.ndim(given):
        return None if given is None else number(given, "acceleration [m/s^2]")
    force = finite(given, "acceleration [m/s^2]").copy()
    if force.shape != (3,):
        raise InputError(
            f"acceleration has shape {force.shape}: must be one number, along the track, or three"
        )
    return force


def _as_earth(given: Any) -> tuple[float, ...]:
    values = finite(given, "earth_field [T]")
    if values.shape != (3,) or not values.any():
        raise InputError(f"earth_field = {values.tolist()}: must be three numbers, not all 0")
    return tuple(values.tolist())


def _as_deviation(given: Any, name: str) -> float | None:
    value = None if given is None else number(given, name)
    if value is not None and not value > 0:
        raise InputError(f"{name} = {value}: must be > 0")
    return value


def as_body(**given: Any) -> Body | None:
    """Return the body of the arguments of `Body`, None for one dipole on a straight pass."""
    body = Body(**given)
    return None if body.plain else body
