"""The field of a passing dipole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, number
from gramian.exceptions import InputError
from gramian.models.dipole import _model, _trials
from gramian.models.dipole._body import Body, Passing, as_body
from gramian.models.dipole._estimate import PARTS
from gramian.models.dipole._setup import require_components
from gramian.monte_carlo.experiment import Estimates, Experiment
from gramian.problem import Problem

__all__ = ["Dipole"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Dipole(Experiment):
    """The field of a passing dipole, as `gramian.dipole`.

    A trial's measurements are the field (K, 3), or (K, S, 3) with `sensors`, tesla; of the
    total field (K,) or (K, S).

    Parameters
    ----------
    r0, v, m : array_like, shape (3,)
        True position at the first time (m), velocity (m/s), moment (A m^2).
    times : array_like, shape (K,)
        Increasing, seconds.
    sigma : array_like
        Standard deviation of the noise, tesla, > 0: of all, or as for `gramian.dipole.rows`.
    known : sequence of str
        What the estimator is given: states ("z0", "vz"), "speed", "moment".
    sensors : array_like, shape (S, 3), optional
        Metres; one at the origin by default.
    ambient, baselines : array_like, optional
        Of sensors of the total field and of gradiometers, as for `gramian.dipole.rows`.
    quadrupole : array_like, shape (3, 3), optional
        Of the body, A m^3; about its centre (Q m = 0) where r0 is not known.
    dipoles : array_like, shape (n, 6), optional
        Dipoles of the body after the first, up to 3: offset from it (m) and moment (A m^2).
    acceleration : float or array_like, shape (3,), optional
        Along the track, or in any direction, m/s^2.
    turn_rate : float, optional
        About z, clockwise seen from above, rad/s.
    induced_volume : float, optional
        Of the moment that `earth_field` induces, m^3.
    earth_field : array_like, shape (3,), optional
        Tesla.
    attitude, scale : float, optional
        Deviations of the attitude (rad) and scale of each sensor: every trial has errors of its
        own. They are states, the truth of which is 0.
    prior : mapping of str to float, optional
        Standard deviations of what the estimator is told besides, by the names of `known`; in
        every trial the mean is drawn about the truth.

    Notes
    -----
    Estimator "ml": `dipole.localize_trials`, of an answer and its mirror image
    the one nearer to the truth. For a body that is more than one dipole on a straight pass, or
    sensors with errors, it is `dipole.localize` with this description, some tenths of a second
    for each trial; of the orders of its dipoles the one nearest to the truth. The states are
    those that are not known; the NEES is by the bound, and there is none where a speed or
    moment is known, which leaves fewer degrees of freedom than states. What is known of r0 and m
    is of the first dipole: these have no other order then.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> scene = gm.monte_carlo.Dipole(
    ...     [-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9, known=["z0", "vz"]
    ... )
    >>> result = gm.monte_carlo.run(scene, 500, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.15).all())
    True
    """

    r0: Array
    v: Array
    m: Array
    times: Array
    sigma: float | Array
    known: tuple[str, ...] = ()
    sensors: Array | None = None
    ambient: tuple[float, float, float] | None = None
    baselines: Array | None = None
    body: Body | None = None
    prior: Mapping[str, float] = field(default_factory=dict)
    estimators: ClassVar[tuple[str, ...]] = ("ml",)

    def __init__(
        self,
        r0: ArrayLike,
        v: ArrayLike,
        m: ArrayLike,
        times: ArrayLike,
        sigma: ArrayLike,
        known: Sequence[str] = (),
        sensors: ArrayLike | None = None,
        ambient: ArrayLike | None = None,
        baselines: ArrayLike | None = None,
        *,
        quadrupole: ArrayLike | None = None,
        dipoles: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        turn_rate: float | None = None,
        induced_volume: float | None = None,
        earth_field: ArrayLike | None = None,
        attitude: float | None = None,
        scale: float | None = None,
        prior: Mapping[str, float] | None = None,
    ) -> None:
        for name, value in {"r0": r0, "v": v, "m": m, "times": times}.items():
            object.__setattr__(self, name, as_float_array(value, name).copy())
        given = as_float_array(sigma, "sigma [T]").copy()
        level = given if given.ndim else number(sigma, "sigma [T]")
        object.__setattr__(self, "sigma", level)
        object.__setattr__(self, "known", options.names(known, "known"))
        places = None if sensors is None else as_float_array(sensors, "sensors").copy()
        object.__setattr__(self, "sensors", places)
        object.__setattr__(self, "ambient", _model.as_ambient(ambient))
        heads = None
        if baselines is not None:
            heads = _model.as_baselines(baselines, (1, 3) if places is None else places.shape)
        object.__setattr__(self, "baselines", heads)
        knowable = (*_model.NAMES, "speed", "moment")
        for name in self.known:
            if name not in knowable:
                raise InputError(
                    f"known has {name!r}: there are {', '.join(knowable)}, by their true values"
                )
        object.__setattr__(self, "prior", options.deviations(prior, "prior"))
        for name in self.prior:
            if name not in knowable:
                raise InputError(f"prior has {name!r}: there are {', '.join(knowable)}")
            if name in self.known:
                raise InputError(f"{name} is known exactly and has a prior: give one of them")
        body = as_body(
            quadrupole=quadrupole,
            dipoles=dipoles,
            acceleration=acceleration,
            turn_rate=turn_rate,
            induced_volume=induced_volume,
            earth_field=earth_field,
            attitude=attitude,
            scale=scale,
        )
        object.__setattr__(self, "body", body)
        require_components(ambient, attitude, scale)
        # Checks everything else.
        self.problem()

    @property
    def _kind(self) -> dict[str, Any]:
        """The sensors, as arguments."""
        return {"sensors": self.sensors, "ambient": self.ambient, "baselines": self.baselines}

    @property
    def _state(self) -> Array:
        return np.concatenate([self.r0, self.v, self.m])

    @property
    def _passing(self) -> Passing | None:
        """The body, where it is more than one dipole on a straight pass."""
        return None if self.body is None else self._passing_of(self.body)

    def _passing_of(self, body: Body) -> Passing:
        return Passing(
            body,
            self._state,
            self.times,
            self.sigma,
            self.known,
            self.sensors,
            self.ambient,
            self.baselines,
            {name: (self._true(name), sigma) for name, sigma in self.prior.items()},
        )

    def _true(self, name: str) -> float:
        """Return the true value of what may be known."""
        if name in PARTS:
            return float(np.linalg.norm(self._state[PARTS[name]]))
        return float(self._state[_model.NAMES.index(name)])

    def _priors(self, seed: int, first: int, trials: int) -> list[dict[str, tuple[float, float]]]:
        """Return what the estimator is told in each trial, as (mean, sigma)."""
        if not self.prior:
            return [{}] * trials
        # Of the numbers of a trial those after what `simulate` takes.
        size = self.simulate(seed, first, 1).size
        size += sum(name.startswith(("attitude", "scale")) for name in self.names)
        drawn = _core.normals(seed, first, trials, size + len(self.prior))[:, size:].tolist()
        return [
            {
                name: (self._true(name) + sigma * one, sigma)
                for (name, sigma), one in zip(self.prior.items(), line, strict=True)
            }
            for line in drawn
        ]

    @property
    def _free(self) -> list[int]:
        return [i for i, name in enumerate(_model.NAMES) if name not in self.known]

    @property
    def names(self) -> tuple[str, ...]:
        """The states that are not known."""
        if passing := self._passing:
            return passing.model.names
        return tuple(_model.NAMES[i] for i in self._free)

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        if passing := self._passing:
            return passing.model.units
        return tuple(_model.UNITS[i] for i in self._free)

    @property
    def truth(self) -> Array:
        """Their true values."""
        if passing := self._passing:
            return passing.truth
        state: Array = self._state[self._free]
        return state

    @property
    def cost(self) -> float:
        """Seconds for a trial, roughly."""
        return 1e-3 if self.body is None else 0.3

    def problem(self) -> Problem:
        """Return the problem at the true state, with what is known."""
        if passing := self._passing:
            problem = passing.problem
        else:
            given = self.r0, self.v, self.m, self.times, self.sigma
            problem = _model.problem(*given, **self._kind)
            states = [name for name in self.known if name in _model.NAMES]
            problem = problem.fix(*states) if states else problem
            problem = problem.prior(self.prior) if self.prior else problem
        # As good as exact, beside any accuracy of the rest.
        exact = {
            name: 1e-7 * float(np.linalg.norm(vector))
            for name, vector in (("speed", self.v), ("moment", self.m))
            if name in self.known
        }
        return problem.prior(exact) if exact else problem

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return fields (trials, K, 3) or (trials, K, S, 3), without the 3 of the total field."""
        if passing := self._passing:
            return passing.simulate(seed, first, trials)[0]
        exact = _model.measure(self.r0, self.v, self.m, self.times, **self._kind)
        noise = _core.normals(seed, first, trials, exact.size).reshape(-1, *exact.shape)
        level = _model.as_noise(self.sigma, exact, 3 if self.ambient is None else 1)
        fields: Array = exact + level * noise
        return fields

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the errors of the located passes."""
        known = {name: self._true(name) for name in self.known}
        priors = self._priors(seed, first, trials)
        if passing := self._passing:
            return passing.estimate(seed, first, trials, known, priors)
        status = np.zeros(trials, dtype=np.int16)
        if self.prior:
            found = np.full((trials, 9), np.nan)
            for k, prior in enumerate(priors):
                try:
                    found[k] = self._located(known, prior, seed, first + k, 1)[0]
                except InputError:
                    status[k] = 1
        else:
            found = self._located(known, {}, seed, first, trials)
        errors = (found - self._state)[:, self._free]
        sized = "speed" in self.known or "moment" in self.known
        nees = np.full(trials, np.nan) if sized else None
        return Estimates(errors, nees, status, {1: "refused"})

    def _located(
        self,
        known: Mapping[str, float],
        prior: Mapping[str, tuple[float, float]],
        seed: int,
        first: int,
        trials: int,
    ) -> Array:
        """Return the passes (trials, 9) that are located with one prior."""
        return _trials.localize_trials(
            self.r0,
            self.v,
            self.m,
            self.times,
            self.sigma,
            seed,
            trials,
            known=known,
            prior=prior,
            first=first,
            **self._kind,
        )
