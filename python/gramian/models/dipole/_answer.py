"""From the pass that fits a record to the answer: its bound, its closest point, what is lacking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian._text import describe_null_space
from gramian.analysis import analyze
from gramian.estimation import Solution as Other
from gramian.exceptions import UnobservableError
from gramian.models.dipole._estimate import KNOWABLE, PLAIN, Description, DipoleModel
from gramian.models.dipole._model import NAMES, Pass, problem
from gramian.models.dipole._result import (
    ClosestPoint,
    Localization,
    Solution,
    deviation,
    information,
)
from gramian.models.dipole._setup import Record, Setup

__all__ = ["Found", "localization", "plain_answer", "states_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """What a fit found: the part of an answer that follows from nothing else."""

    model: DipoleModel
    state: Array
    found: Array
    cost: float
    mirror: Solution | None
    others: tuple[Other, ...]
    sigma: float
    weights: Array
    residuals: Array
    fitted: Array
    converged: bool
    iterations: int


def plain_answer(raw: _core._DipoleLocalized, record: Record) -> Localization:
    """Return the answer of one dipole on a straight pass, with its mirror image."""
    mirror, sigma = raw["mirror"], float(raw["sigma"])
    mirror_cost = float(raw["mirror_cost"])
    model = record.model(raw, np.sqrt(raw["weights"] * raw["efficiency"]) / sigma)
    state = states_of(model, raw)
    others: tuple[Other, ...] = ()
    if np.isfinite(mirror_cost):
        constants = int(model.used.sum()) if model.background else 0
        image = model.coordinates(mirror)
        image[len(state) - constants :] = state[len(state) - constants :]
        # Priors tell the two apart too.
        handle = model.handle(record.filled)
        apart = handle.linearize(image)[0] - handle.linearize(state)[0]
        distance = float(np.linalg.norm(apart))
        half = 0.5 * math.erfc(distance / math.sqrt(8.0))
        others = (Other(image, mirror_cost, distance, half, 1),)
    return localization(
        Found(
            model=model,
            state=state,
            found=raw["state"],
            cost=float(raw["cost"]),
            mirror=Solution(mirror[:3], mirror[3:6], mirror[6:], mirror_cost)
            if np.isfinite(mirror_cost)
            else None,
            others=others,
            sigma=sigma,
            weights=raw["weights"],
            residuals=raw["residuals"],
            fitted=raw["background"],
            converged=bool(raw["converged"]),
            iterations=int(raw["rounds"]),
        ),
        record,
    )


def localization(
    fit: Found, record: Record, candidates: tuple[tuple[Description, float], ...] = ()
) -> Localization:
    """Return the answer that follows from a fit."""
    model, state, found, weights = fit.model, fit.state, fit.found, fit.weights
    t, y, setup, origin = record.times, record.filled, record.setup, record.origin
    absent = np.isnan(record.field)
    sigmas = setup.deviations(fit.sigma, y.shape)
    handle = model.handle(y)
    freedom = _freedom(float(handle.fit(state)["dof"]), record)
    covariance = _covariance(model, handle, state, freedom, t, sigmas, setup)
    signal = y - setup.heads.quiet - fit.fitted
    residuals = fit.residuals
    # What does not count explains nothing.
    share = np.where(weights > 0, fit.sigma / sigmas, 0.0)
    return Localization(
        model=model,
        measurements=y.ravel(),
        names=model.names,
        units=model.units,
        state=state,
        converged=fit.converged,
        iterations=fit.iterations,
        prior=setup.prior,
        known=setup.known,
        others=fit.others,
        unseen=1.0,
        alpha=record.limits[0],
        chance=record.limits[1],
        weak_ratio=record.limits[2],
        _loss=("squares", 0.0) if setup.loss == "gaussian" else ("huber", 1.345),
        r0=found[:3],
        v=found[3:6],
        m=found[6:],
        pass_std=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        pass_covariance=covariance,
        cost=fit.cost,
        mirror=fit.mirror,
        origin=origin,
        times=t,
        residuals=np.where(absent, np.nan, residuals),
        predicted=signal - residuals,
        background=record.offsets + fit.fitted,
        weights=weights,
        sigma=fit.sigma,
        sigmas=sigmas,
        sigma_given=setup.sigma is not None,
        explained=float(1 - ((share * residuals) ** 2).sum() / ((share * signal) ** 2).sum()),
        spikes=int((~(weights > 0) & ~absent).any(axis=-1).sum()),
        dropped=record.dropped,
        closest=_closest(found, covariance, origin, setup.sensors[0])
        if model.description.motion == "straight" and model.description.sources == 1
        else _nearest(model, handle, state, freedom, origin),
        sensors=setup.sensors,
        correlation=record.options.correlation,
        correlation_given=not record.correlated,
        freedom=freedom,
        candidates=candidates,
    )


def states_of(model: DipoleModel, raw: _core._DipoleLocalized) -> Array:
    """Return the states of a model for a pass that was found, with the constants."""
    state = model.coordinates(raw["state"])
    if model.background:
        levels = raw["background"].ravel()[model.used]
        first = len(state) - len(levels) * (2 if model.description.drift else 1)
        state[first : first + len(levels)] = levels
    return state


def _freedom(dof: float, record: Record) -> float:
    """Return the degrees of freedom of Student's t, `inf` where the noise is known.

    They are 0 where it is to be estimated from as many numbers as states. Of a noise that was
    estimated they are those of the fit. What a fitted correlation leaves open is the power of
    the slow part of the noise, sigma^2 (1 + r) / (1 - r), of variance
    4 (1 + r) / (1 - r) / dof beside that of its level.
    """
    if record.setup.sigma is not None and not record.correlated:
        return math.inf
    if dof < 1:
        return 0.0
    if record.correlated:
        r = record.options.correlation
        dof /= 1 + 2 * (1 + r) / (1 - r)
    return dof


def _covariance(
    model: DipoleModel,
    handle: _core.Model,
    state: Array,
    freedom: float,
    t: Array,
    sigma: Array,
    setup: Setup,
) -> Array:
    """Return the bound (9, 9) at an answer, on what knowledge leaves free."""
    if not len(state):
        return np.zeros((9, 9))
    found, columns = model.expand(state)
    analysis = information(model, handle, state, freedom)
    bound = analysis.crlb()
    if bound is None and model.description != PLAIN:
        directions = describe_null_space(analysis.null_space(), model.names)
        raise UnobservableError(
            f"what is known does not suffice for {model.description}: "
            f"{'; '.join(directions)} is not determined",
            directions,
        )
    if bound is None:
        null = columns @ analysis.null_space()
        # What rounding left in a state that has no part in it.
        lines = handle.linearize(state)[1]
        size = np.linalg.norm(lines @ np.linalg.pinv(columns), axis=0)
        part = np.abs(null) * size[:, None]
        null[part < 1e-9 * part.max(axis=0)] = 0.0
        directions = describe_null_space(null, NAMES)
        here = Pass(found[:3] + model.times[0] * found[3:6], found[3:6], found[6:])
        raise UnobservableError(_refusal(here, t, sigma, setup, directions), directions)
    spread: Array = columns @ bound @ columns.T
    if freedom == 0:
        free = (columns != 0).any(axis=1)
        spread[np.ix_(free, free)] = np.inf
    return spread


def _refusal(here: Pass, t: Array, sigma: Array, setup: Setup, directions: Sequence[str]) -> str:
    given = ", ".join(f"{name} = {value:g}" for name, value in setup.known.items())
    given += ", ".join(f"prior of {name}" for name in setup.prior)
    scene = problem(
        *here,
        t,
        sigma,
        sensors=setup.sensors,
        ambient=setup.ambient,
        baselines=setup.baselines,
    )
    answer = analyze(scene)
    told = setup.known.keys() | setup.prior.keys()
    repairs = [
        s.name
        for s in answer.suggestions
        if s.repairs and s.name in KNOWABLE and s.name not in told
    ]
    text = (
        f"what is known ({given or 'nothing'}) does not suffice: "
        f"{'; '.join(directions)} is not determined"
    )
    if repairs:
        text += f"; any one of these would do: {', '.join(repairs)}"
    return text


def _closest(state: Array, covariance: Array, origin: float, sensor: Array) -> ClosestPoint:
    r, v = state[:3] - sensor, state[3:6]
    squared = float(v @ v)
    if squared == 0:
        position, time, by_time = r, 0.0, np.zeros(9)
    else:
        time = float(-(r @ v) / squared)
        position = r + time * v
        by_time = np.concatenate([-v, -r - 2 * time * v, np.zeros(3)]) / squared
    distance = float(np.linalg.norm(position))
    # At the closest point a change of its time changes nothing.
    unit = position / distance
    by_range = np.concatenate([unit, time * unit, np.zeros(3)])
    return ClosestPoint(
        time=origin + time,
        time_std=deviation(by_time, covariance),
        position=(float(position[0]), float(position[1]), float(position[2])),
        range=distance,
        range_std=deviation(by_range, covariance),
    )


def _nearest(
    model: DipoleModel, handle: _core.Model, state: Array, freedom: float, origin: float
) -> ClosestPoint:
    """Return the closest approach of a body that does not pass straight, or of its centre."""
    time, by_time, place, by = model.nearest(state)
    covariance = information(model, handle, state, freedom).crlb()
    distance = float(np.linalg.norm(place))
    by_range = place / (distance or 1.0) @ by
    if covariance is None or freedom == 0:
        covariance = np.full((state.size, state.size), np.inf)
    x, y, z = place.tolist()
    return ClosestPoint(
        time=origin + time,
        time_std=deviation(by_time, covariance),
        position=(x, y, z),
        range=distance,
        range_std=deviation(by_range, covariance),
    )
