"""The search for what a record is explained by best, of several descriptions of its body."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import finite, number, whole
from gramian.estimation import Solution as Other
from gramian.exceptions import InputError
from gramian.models.dipole._answer import Found, localization, states_of
from gramian.models.dipole._estimate import Description, DipoleModel
from gramian.models.dipole._result import Localization, Solution
from gramian.models.dipole._setup import Record
from gramian.models.dipole._size import require_size

__all__ = ["Motion", "Sources", "as_descriptions", "described"]

Array = NDArray[np.float64]
Motion = Literal["straight", "along", "accelerated", "turning"]
Sources = int | Literal["quadrupole"]


def as_descriptions(
    sources: Sources | Sequence[Sources],
    motion: str | Sequence[str],
    drift: bool,
    attitude: float | None,
    scale: float | None,
    earth_field: ArrayLike | None,
) -> list[Description]:
    """Return what a record may be explained by, motion after motion, sources ascending.

    A dipole with a quadrupole stands after one without.
    """
    if isinstance(sources, str) or not isinstance(sources, Sequence):
        kinds = [_as_sources(sources)]
    else:
        kinds = sorted({_as_sources(one) for one in sources})
    motions = [motion] if isinstance(motion, str) or motion is None else list(motion)
    for one in motions:
        options.choice(one, "motion", ("straight", "along", "accelerated", "turning"))
    if not kinds or not motions:
        raise InputError("sources and motion must name at least one each")
    deviations = []
    for given, name in ((attitude, "attitude [rad]"), (scale, "scale")):
        value = None if given is None else number(given, name)
        if value is not None and not value > 0:
            raise InputError(f"{name} = {value}: must be > 0")
        deviations.append(value)
    ambient = None
    if earth_field is not None:
        values = finite(earth_field, "earth_field [T]")
        if values.shape != (3,) or not values.any():
            raise InputError(f"earth_field = {values.tolist()}: must be three numbers, not all 0")
        x, y, z = values.tolist()
        ambient = (x, y, z)
        if any(quadrupole for _, quadrupole in kinds):
            raise InputError(
                "a body that earth_field magnetises has a quadrupole that this induces, which is "
                'not modelled: leave out earth_field, or "quadrupole" in sources'
            )
    tilt, gain = deviations
    return [
        Description(m, count, quadrupole, drift, tilt, gain, ambient)
        for m in motions
        for count, quadrupole in kinds
    ]


def _as_sources(given: object) -> tuple[int, bool]:
    """Return how many dipoles are given, and whether with a quadrupole."""
    if not isinstance(given, str):
        return whole(given, "sources", 1, 4), False
    if given != "quadrupole":
        raise InputError(
            f'sources = {options.given(given)}: must be from 1 to 4 dipoles, or "quadrupole"'
        )
    return 1, True


#: No more places than this are looked at for a further dipole.
_PLACES = 1000
#: A few steps are made from every place where a further dipole may be, as the place where the rows
#: foretell the most often leads to a lesser minimum. Of each stage: the steps, and how many of the
#: best go on; those of the last are fitted to the end.
_STAGES = ((20, 16), (40, 6))
#: Exchanges of the dipoles, of each at most.
_EXCHANGES = 3
#: A chi2 that is less by this is of another minimum.
_BETTER = 0.01
#: What is known of these is known of the first dipole.
_OF_THE_FIRST = {"x0", "y0", "z0", "mx", "my", "mz", "moment"}
_SQUARES = ("squares", 0.0)
#: Steps of a fit whose weights have changed a little.
_AGAIN = 50


@dataclass(frozen=True)
class _Settled:
    """What a description makes of a record."""

    about: Description
    model: DipoleModel
    state: Array
    weights: Array
    efficiency: float
    sigma: float
    converged: bool
    iterations: int
    bic: float
    #: Other minima that were reached, (n, states).
    beside: Array


def _settle(
    about: Description, starts: Array, raw: _core._DipoleLocalized, record: Record
) -> _Settled:
    """Fit a description from some starts, until noise and weights settle."""
    filled, setup = record.filled, record.setup
    counts = (raw["weights"] > 0) & ~np.isnan(record.field)
    beside = np.zeros((0, starts.shape[1]))
    weights, efficiency = raw["weights"] * counts, float(raw["efficiency"])
    sigma, count = float(raw["sigma"]), int(counts.sum())
    iterations = 0
    for _ in range(20):
        model = record.model(raw, np.sqrt(weights * efficiency) / sigma, about)
        handle = model.handle(filled)
        # After the first round only weights and noise have changed.
        limit = min(setup.max_iterations, _AGAIN) if iterations else setup.max_iterations
        found = handle.minimize(starts, _SQUARES, limit)
        if not found:
            raise InputError("the body meets a sensor at every start")
        if not iterations and setup.sigma is not None:
            beside = np.array([other["x"] for other in found[1:]]).reshape(-1, starts.shape[1])
        best, before = found[0], (sigma, record.options.correlation)
        if about.quadrupole and not iterations:
            # From the dipole alone the way often leads to a lesser minimum.
            searched = handle.others(best["x"], np.zeros((0, len(best["x"]))), None, 0, 0)
            best = searched if searched["chi2"] < best["chi2"] else best
        state = best["x"]
        starts, iterations = state[None], iterations + found[0]["iterations"]
        unit = replace(model, weights=(counts * setup.precision).astype(float))
        if record.correlated:
            even = replace(unit, correlation=0.0)
            rho, _ = even.record(filled).noise(state, model.spacing, setup.sigma)
            record = record.with_correlation(rho)
        if setup.loss == "huber":
            flat, efficiency, sigma = unit.record(filled).robust(state, setup.sigma)
            weights = flat.reshape(counts.shape)
        elif setup.sigma is None:
            left = unit.residuals(state, filled)
            sigma = float(np.sqrt(left @ left / max(count - len(state), 1)))
            sigma = max(sigma, 1e-12 * before[0])
        settled, correlation = abs(sigma - before[0]) < 1e-4 * sigma, record.options.correlation
        ended = best["converged"] or iterations >= 2 * setup.max_iterations
        if ended and settled and abs(correlation - before[1]) < 1e-2 * (1 - correlation):
            break
    left = unit.residuals(state, filled) / sigma
    size = np.abs(left)
    loss = left**2
    if setup.loss == "huber":
        loss = np.where(size > 1.345, 1.345 * (2 * size - 1.345), loss)
    # Twice the log likelihood, less a constant; with the variances of the innovations.
    steps = np.diff(record.times) / model.spacing
    share = correlation ** (2 * steps) if correlation > 0 else np.zeros(len(steps))
    log_variance = setup.used * float(np.log1p(-share).sum())
    bic = loss.sum() + 2 * count * np.log(sigma) + log_variance + len(state) * np.log(count)
    return _Settled(
        about,
        record.model(raw, np.sqrt(weights * efficiency) / sigma, about),
        state,
        weights,
        efficiency,
        sigma,
        bool(best["converged"]),
        iterations,
        float(bic),
        beside,
    )


def _one_more(last: _Settled, about: Description, record: Record) -> tuple[Array, Array]:
    """Return starts (n, states) of a description from the answer with a dipole less.

    A few steps are made from each of many places, and more of them from the best. Also the places
    themselves where the rows foretell the most.
    """
    filled = record.filled
    model = replace(last.model, description=about)
    handle = model.handle(filled)
    less = last.model.record(filled)
    foretold = less.seeds(last.state, _PLACES)
    places = [*foretold, *(x for other in last.beside[:1] for x in less.seeds(other, _PLACES))]
    for steps, most in _STAGES:
        reached: list[tuple[float, Array]] = []
        for start in places:
            found = handle.minimize(start[None], _SQUARES, steps)
            reached += [(found[0]["chi2"], found[0]["x"])] if found else []
        reached.sort(key=lambda one: one[0])
        places = [x for _, x in reached[:most]]
    if not places:
        raise InputError("the body meets a sensor at every start")
    return np.array(places), foretold[:8]


def _improved(found: _Settled, record: Record) -> Array | None:
    """Return states that fit better than a fit of several dipoles, from moves of its dipoles.

    Where it is told what the first one is, the dipoles change their order. Of three and more, one
    at a time is taken away and looked for again from what the others leave.
    """
    model, state = found.model, found.state
    handle, count = model.handle(record.filled), found.about.sources
    begun = least = handle.fit(state)["chi2"]
    told = {*model.known, *model.prior}
    if count > 1 and told & _OF_THE_FIRST:
        for order in itertools.permutations(range(count)):
            moved = handle.minimize(model.reordered(state, order)[None], _SQUARES, _AGAIN)
            if moved and moved[0]["chi2"] < least - _BETTER:
                state, least = moved[0]["x"], moved[0]["chi2"]
    # Where the noise is estimated, of long records with more in them than dipoles, it takes long.
    if count > 2 and record.setup.sigma is not None:
        less = replace(found.about, sources=count - 1)
        small = replace(model, description=less)
        kept = [k for k, n in enumerate(model.names) if not n.endswith(f" of dipole {count}")]
        untried, out = count, count - 1
        for _ in range(_EXCHANGES * count):
            rest = model.reordered(state, (*(k for k in range(count) if k != out), out))[kept]
            # What the others leave where they are, and settled without it.
            fits = small.handle(record.filled).minimize(rest[None], _SQUARES, _STAGES[0][0])
            settled = np.array([fit["x"] for fit in fits[:1]]).reshape(-1, rest.size)
            last = replace(found, about=less, model=small, state=rest, beside=settled)
            starts, _ = _one_more(last, found.about, record)
            moved = handle.minimize(starts, _SQUARES, record.setup.max_iterations)
            untried, out = untried - 1, (out - 1) % count
            if moved and moved[0]["chi2"] < least - _BETTER:
                state, least, untried = moved[0]["x"], moved[0]["chi2"], count
            if not untried:
                break
    return state if least < begun else None


def _with_moves(
    found: _Settled, record: Record, settled: Callable[[Description, Array], _Settled | None]
) -> _Settled:
    """Return a fit, or the better one that moves of its dipoles lead to."""
    better = _improved(found, record)
    other = None if better is None else settled(found.about, better[None])
    if other is None or not other.bic < found.bic:
        return found
    return replace(other, beside=found.beside)


def _tried(
    wanted: Sequence[Description], raw: _core._DipoleLocalized, record: Record
) -> list[_Settled]:
    """Return what descriptions make of a record, that of the least BIC first.

    Dipoles are added one after the other, up to the first that does not lower it.
    """
    filled = record.filled
    failed: list[str] = []

    numbers = int((~np.isnan(record.field)).sum()) + len(record.setup.prior)
    # Noise that is to be estimated needs one more.
    most = numbers - (record.setup.sigma is None)

    def settled(about: Description, starts: Array) -> _Settled | None:
        names = record.model(raw, np.sqrt(raw["weights"]), about).names
        # Attitude and scale have a prior each.
        free = sum(not name.startswith(("attitude", "scale")) for name in names)
        if free > most and (about.sources > 1 or about.quadrupole):
            failed.append(f"{about}: {free} states for {numbers} numbers")
            return None
        try:
            found = _settle(about, starts, raw, record)
            # A dipole without a moment, or far away, tells of nothing.
            _core.Analysis(found.model.handle(filled).linearize(found.state)[1], None)
        except InputError as error:
            failed.append(f"{about}: {error}")
            return None
        return found

    tried: list[_Settled] = []
    for motion in dict.fromkeys(about.motion for about in wanted):
        own = [about for about in wanted if about.motion == motion]
        counts = {about.sources for about in own if not about.quadrupole}
        last: _Settled | None = None
        for count in range(1, max(about.sources for about in own) + 1):
            about = replace(own[0], sources=count, quadrupole=False)
            if last is None:
                model = record.model(raw, np.sqrt(raw["weights"]), about)
                starts = states_of(model, raw)[None]
            else:
                starts, foretold = _one_more(last, about, record)
            found = settled(about, starts)
            if found is None:
                break
            if last is not None and not found.converged:
                # Two dipoles that draw together never come to rest; from where the rows foretell
                # the most others are found that fit no worse.
                other = settled(about, foretold)
                found = found if other is None else min(found, other, key=lambda one: one.bic)
            found = _with_moves(found, record, settled)
            if count in counts:
                tried.append(found)
                earlier = last is not None and last.about.sources in counts
                if last is not None and earlier and found.bic > last.bic:
                    break
            for about in own:
                if about.quadrupole and about.sources == count:
                    own_model = replace(found.model, description=about)
                    with_it = settled(about, found.model.carry(found.state, own_model)[None])
                    tried += [] if with_it is None else [with_it]
            last = found
    if not tried:
        raise InputError(f"no description fits: {'; '.join(failed)}")
    return sorted(tried, key=lambda one: one.bic)


def described(
    wanted: Sequence[Description], raw: _core._DipoleLocalized, record: Record
) -> Localization:
    """Return the answer of the description that explains the record best."""
    tried = _tried(wanted, raw, record)
    best, filled = tried[0], record.filled
    model, handle = best.model, best.model.handle(filled)
    alike = model.record(filled).alike(best.state)
    searched = handle.others(best.state, alike, None, 0, 0)
    # The best of all that were reached, which may be another than the fit began with.
    state = np.asarray(searched["x"])
    require_size(model, state, filled)
    found = model.expand(state)[0]
    others, mirror = [], None
    best_bodies = _bodies(model, state, handle)
    for other in searched["others"]:
        if _same_bodies(best_bodies, _bodies(model, other["x"], handle)):
            # Only which of the dipoles is called the first differs.
            continue
        others.append(
            Other(other["x"], other["chi2"], other["distance"], other["chance"], other["hits"])
        )
        if mirror is None:
            image = model.expand(other["x"])[0]
            mirror = Solution(image[:3], image[3:6], image[6:], other["chi2"])
    left = handle.linearize(state)[0]
    exact = model.h(state).reshape(filled.shape)
    names = [name for name in model.names if name.startswith("background")]
    levels = np.zeros(record.offsets.shape)
    if names:
        first = model.names.index(names[0])
        levels[model.used.reshape(levels.shape)] = state[first : first + len(names)]
    return localization(
        Found(
            model=model,
            state=state,
            found=found,
            cost=float(left @ left),
            mirror=mirror,
            others=tuple(others),
            sigma=best.sigma,
            weights=best.weights,
            residuals=filled - exact,
            fitted=levels,
            converged=best.converged,
            iterations=best.iterations,
        ),
        record.with_correlation(model.correlation),
        candidates=tuple((one.about, one.bic) for one in tried),
    )


def _bodies(model: DipoleModel, x: Array, handle: _core.Model) -> tuple[Array, Array]:
    """Return place and moment (count, 6) of each dipole of a state, and their deviations."""
    full, by = model.expand(x)
    places, moved = model.bodies(x)
    places[:, :3] += full[:3]
    moved[:, :3] += by[:3]
    covariance = _core.Analysis(handle.linearize(x)[1], None).crlb()
    if covariance is None:
        return places, np.zeros(places.shape)
    spread = ((moved @ covariance) * moved).sum(axis=-1)
    return places, np.sqrt(np.maximum(spread, 0.0))


def _same_bodies(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Say whether two answers have the same dipoles in another order, as far as noise tells."""
    orders = list(itertools.permutations(range(len(one[0]))))[1:]
    return any(
        (np.abs(one[0] - other[0][list(p)]) < 5 * np.hypot(one[1], other[1][list(p)])).all()
        for p in orders
    )
