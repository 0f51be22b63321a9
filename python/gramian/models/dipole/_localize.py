"""Locating a passing dipole from its field and what is known beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import ITERATIONS_MOST, as_float_array, finite, number, whole
from gramian.estimation._knowledge import levels
from gramian.exceptions import InputError
from gramian.models.dipole._answer import plain_answer, states_of
from gramian.models.dipole._described import Motion, Sources, as_descriptions, described
from gramian.models.dipole._estimate import PLAIN
from gramian.models.dipole._result import STATUSES, Localization, Localizations
from gramian.models.dipole._setup import (
    Background,
    Loss,
    Record,
    Setup,
    as_times,
    require_components,
)

__all__ = ["localize", "localize_many"]

Array = NDArray[np.float64]

#: A window of the pass reaches this many times the time from the closest point
#: to 45 degrees: the field is down to 1 or 2 per cent there.
_REACH = 4.0


def localize(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    background: Background | Literal["drift"] | None = None,
    sources: Sources | Sequence[Sources] = 1,
    motion: Motion | Sequence[Motion] = "straight",
    attitude: float | None = None,
    scale: float | None = None,
    earth_field: ArrayLike | None = None,
    loss: Loss = "gaussian",
    sigma: ArrayLike | None = None,
    window: Literal["pass"] | tuple[float, float] | None = None,
    missing: Literal["raise", "drop"] = "raise",
    use: ArrayLike | None = None,
    correlation: float | Literal["fit"] = 0.0,
    starts: int = 12,
    alpha: float = 0.001,
    chance: float = 0.01,
    weak_ratio: float = 0.25,
    max_iterations: int = 200,
) -> Localization:
    """Locate a passing dipole from the field it makes and what is known beforehand.

    Parameters
    ----------
    times : array_like, shape (K,)
        Increasing, seconds. The state is that of the first one.
    field : array_like, shape (K, 3), or (K, S, 3) with `sensors`
        Tesla; with `ambient` (K,) or (K, S), as `measure` returns.
    known : mapping of str to float, optional
        What is known exactly: x0 (or x), y0, z0, vx, vy, vz, mx, my, mz, speed
        (m/s), moment (its size, A m^2).
    prior : mapping of str to (mean, sigma), optional
        What is known to a standard deviation, by the same names.
    sensors : array_like, shape (S, 3), optional
        Where the sensors are, metres; one at the origin by default.
    ambient : array_like, shape (3,), optional
        The field without the dipole, tesla, at sensors of the total field: they read
        ``|ambient + field|``. Its direction must be right; its size may be slightly wrong
        where a `background` is fitted.
    baselines : array_like, shape (3,) or (S, 3), optional
        From each sensor to its second head, metres, of gradiometers: `field` is the
        difference, that of the second head less that of the first, tesla (the gradient
        times the length).
    background : {"median", "fit"}, optional
        What to do about a constant field in the record (of the total field, beside the size
        of `ambient`): fit a constant to each channel;
        with "median" the median of the whole record is taken off first; with "drift" a
        line in time is fitted beside the constant. Nothing by default.
    sources : int or "quadrupole", or a sequence of these
        How many dipoles the body carries, 1 to 4, or one and a quadrupole at the same place
        (see Notes); of several the one of the least BIC. With
        more than one r0 and m, known or with a prior too, are those of the first; `moment` and
        `closest` are of all: of the sum of the moments, and of their centre.
    motion : {"straight", "along", "accelerated", "turning"}, or a sequence of these
        How the body moves, see `Description`; of several the one of the least BIC.
    attitude, scale : float, optional
        Standard deviations of the attitude (rad) and of the scale of each sensor, which are
        states then; exact by default.
    earth_field : array_like, shape (3,), optional
        The ambient field, tesla, of a body that it magnetises: beside the permanent moment
        m, which turns with the body, there is one along this field, whose size is the state
        "induced volume". The two are told apart where the body turns (``motion="turning"``).
    loss : {"gaussian", "huber"}
        Squares, or Huber's loss with spikes rejected.
    sigma : array_like, shape (), (K,), (S, 3) or (K, S, 3), optional
        Standard deviation of the noise, tesla (for gradiometers that of the difference): of
        all, of each time, channel or number, `inf` for what is not to be used; with `ambient`
        (S, 1) or (K, S, 1). Estimated from the residuals, one for all, by default; deviations
        and intervals are then those of Student's t.
    window : "pass" or (start, end), optional
        Use only these times; "pass" finds the pass first and keeps four times
        the time from its closest point to 45 degrees on both sides.
    missing : {"raise", "drop"}
        What to do about numbers that are NaN.
    use : array_like of bool, shape (3 S,), (S, 3) or that of `field`, optional
        Which channels, or which numbers, to use: ``check_record(times, field).usable`` for
        one. All by default. With `ambient` (S,), (S, 1) or that of `field`. What has an
        infinite `sigma` is not used either.
    correlation : float or "fit"
        Of the noise of neighbouring samples of a channel, at the usual time between them:
        from 0, white noise, to below 1; or fitted with the pass.
    starts : int
        How many starts are followed, 1 to 1000.
    alpha, chance, weak_ratio : float
        As for `gramian.estimate`: levels of "misfit" and "ambiguous", and the share of the
        closest range that its deviation may be before the answer is "weak".
    max_iterations : int
        Most iterations of the separable least squares from each start, >= 1.

    Returns
    -------
    Localization
        A `gramian.Estimate`: look at its status first.

    Raises
    ------
    UnobservableError
        The knowledge does not suffice; names the null combinations and what
        would repair it. Also of several heads that see a pass from so far that
        it fits as well at any larger size: then with the least closest range.
    InputError
        Knowledge that contradicts itself, fewer numbers than unknowns, NaN, a
        field of zeros, shapes and names that do not fit.

    Warns
    -----
    UserWarning
        A field above 1 T, which is unlikely to be in tesla.

    Notes
    -----
    Separable least squares: for each position and velocity the moment follows
    by linear least squares, so at most six numbers are searched for. Starts come
    from the shape of the field: in the frame of the pass it is a sum of three
    functions of (t - tc) / tau, whose coefficients give frame and moment in closed
    form. The covariance is the Cramer-Rao bound under the constraints, under Huber's loss
    that of the M-estimate; where the model itself is the larger error it is too small.
    Correlated noise is of first order, its parameters by restricted maximum likelihood. Where
    channels have a `sigma` each, `explained` weighs the numbers by it.

    A dipole with a quadrupole Q (symmetric, without a trace, A m^3) has the potential
    ``mu0/(4 pi) (m . d / d^3 + d . Q d / (2 d^5))`` at d from the body. A dipole that is moved
    by e has, to first order, the field of one that is not and of the quadrupole
    ``3 (e m^T + m e^T) - 2 (e . m) 1``: five free numbers of Q cannot be told from a move. Where
    nothing is known of the place it is therefore that of the centre, with ``Q m = 0``, and Q
    has two states; each component of r0 that is known, or has a prior, leaves it one
    more. One sensor of three components cannot tell (r0, v, m, Q) from
    (u r0, u v, u^3 m, u^4 Q), nor from the mirror image (-r0, -v, m, -Q).

    For the total field, the search takes the component along `ambient` for the reading; the
    best of what it finds is fitted with ``|ambient + field|``. Where the dipole's field is far
    weaker than the ambient one, a single sensor determines five numbers for nine unknowns: a
    time, a duration and three sizes. The mirror image at a single gradiometer is the pass
    reflected in its middle, with the opposite velocity and moment.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(21.0)
    >>> y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-12, seed=1)
    >>> answer = gm.dipole.localize(t, y, {"z": 5.0, "vz": 0.0}, sigma=1e-12)
    >>> answer.m.round(1), answer.mirror
    (array([10., 20., 10.]), None)
    """
    setup = Setup(
        known, prior, sensors, background, loss, sigma, starts, ambient, baselines, drift=True
    )
    require_components(ambient, attitude, scale)
    wanted = as_descriptions(sources, motion, background == "drift", attitude, scale, earth_field)
    limits = levels(alpha, chance, weak_ratio)
    setup.max_iterations = whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST)
    fitted = isinstance(correlation, str) and correlation == "fit"
    if not fitted:
        correlation = number(correlation, "correlation")
        if not 0 <= correlation < 1:
            raise InputError(f"correlation = {correlation}: must be from 0 to below 1")
    t, y, dropped = setup.samples(times, field, missing, use)
    # The instant of the state, whichever samples are used.
    origin = float(np.ravel(as_float_array(times, "times"))[0])
    offsets = np.zeros(y.shape[1:])
    if background == "median":
        # Over the whole record: a window of the pass alone has no quiet part.
        measured = ~np.isnan(y).all(axis=0)
        offsets[measured] = np.nanmedian(y[:, measured], axis=0) - setup.heads.quiet
        y = y - offsets
    fixed = 0.0 if fitted else float(correlation)
    inner = setup.options("none" if background is None else "fit", origin, fixed)
    record = Record(t, y, offsets, dropped, setup, inner, fitted, limits)
    if isinstance(window, tuple):
        start, end = window
        record = record.of((t >= start) & (t <= end))
    elif window is not None and not (isinstance(window, str) and window == "pass"):
        raise InputError(f'window = {options.given(window)}: must be "pass", (start, end) or None')
    setup.enough(record.field, "in the window" if window is not None else "")
    raw = record.run()
    if window == "pass":
        keep = _of_the_pass(raw["state"], t - origin, setup.sensors)
        if (~np.isnan(y[keep])).sum() >= 4 * setup.unknowns:
            record = record.of(keep)
            raw = record.run()
    # Few numbers of each sample leave other passes that fit as well.
    few = ambient is not None or baselines is not None
    if few or wanted != [PLAIN]:
        return described(wanted, raw, record)
    if fitted:
        record, raw = _with_correlation(record, raw)
    return plain_answer(raw, record)


def localize_many(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    background: Background | None = None,
    loss: Loss = "gaussian",
    sigma: ArrayLike | None = None,
    starts: int = 12,
    others: bool = True,
    alpha: float = 0.001,
) -> Localizations:
    """Locate dipoles in many records at once.

    Parameters
    ----------
    times : array_like, shape (..., K)
        Increasing, seconds.
    field : array_like, shape (..., K, 3), or (..., K, S, 3) with `sensors`
        Tesla; with `ambient` (..., K) or (..., K, S).
    known, prior, sensors, ambient, baselines, background, loss, sigma, starts
        As for `localize`.
    others : bool
        Whether to look for other passes that fit as well, and to judge each answer by them: see
        Notes.
    alpha : float
        "misfit" where a true model costs as much with a smaller probability than this, in (0, 1).

    Returns
    -------
    Localizations

    Raises
    ------
    InputError
        As for `localize`. Whether the knowledge suffices is not asked: see
        `problem` for that.

    Notes
    -----
    The best of the starts, and the mirror image. With `others`, as in `localize`, passes turned
    or reflected about the ambient field, of other sizes, with other moments are looked for too,
    for sensors of the total field and gradiometers; a better one that is met takes the place of
    the answer. It takes twice as long for the total field, and a fifth longer for gradiometers.
    `status` is then the first of these that holds:

    - "unobservable": some combination of the states changes no number, or several heads see the
      pass from so far that it fits as well at any larger size (where `localize` follows it there,
      the status may be "ambiguous" here);
    - "misfit": the model does not fit, by chi-square of the cost where `sigma` is given (with the
      Huber loss the cost of gross errors is less);
    - "not_converged";
    - "ambiguous": another pass was found that noise prefers in more than 1 % of records;
    - "weak": the deviation of the closest range is more than a quarter of it, or the noise cannot
      be estimated from as many numbers as states;
    - "determined".

    What would explain a misfit, whether neighbouring residuals are alike and how far intervals
    reach is not asked: `localize` does. Without `others` the status is "misfit" or "not_looked":
    the answer may be one of several.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(21.0)
    >>> y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-9, 1, trials=4)
    >>> found = gm.dipole.localize_many(t, y, {"z": 5.0, "vz": 0.0}, sigma=1e-9)
    >>> found.states.shape, found.status.tolist()
    ((4, 9), ['determined', 'determined', 'determined', 'determined'])
    >>> gm.dipole.localize_many(t, y[0], {"speed": 1.4142}, sigma=1e-9).status
    'ambiguous'
    """
    setup = Setup(known, prior, sensors, background, loss, sigma, starts, ambient, baselines)
    y = as_float_array(field, "field").copy()
    if y.ndim < 1 + (sensors is not None) + (ambient is None):
        raise InputError(f"field has shape {y.shape}: must be (..., {setup.wanted[1:]}")
    if ambient is not None:
        y = y[..., None]
    if sensors is None:
        y = y[..., None, :]
    when = as_times(times)
    there = setup.measured((*when.shape[-1:], len(setup.sensors), setup.heads.components))
    if y.shape[-3:] == there.shape:
        y[..., ~there] = 0.0
    finite(y, "field")
    if background == "median":
        seen = np.where(there, y, np.nan) if y.shape[-3:] == there.shape else y
        used = there.any(axis=0)
        offsets = np.zeros((*y.shape[:-3], 1, *y.shape[-2:]))
        offsets[..., used] = np.nanmedian(seen[..., used], axis=-2, keepdims=True)
        y = y - (offsets - setup.heads.quiet)
    setup.enough(np.where(there, 0.0, np.nan))
    inner = setup.options("none" if background is None else "fit", None)
    options.fraction(alpha, "alpha")
    out = setup.run(when, y, replace(inner, others=options.flag(others, "others")))
    p_value, code = np.full(out["cost"].shape, np.nan), out["status"].astype(np.int8)
    dof = int(there.sum()) + len(setup.prior) - setup.unknowns
    if setup.sigma is not None and dof > 0:
        p_value = _core.chi_square_survival(out["cost"], dof)
        bad = (p_value < alpha) & (code != STATUSES.index("unobservable"))
        code = np.where(bad, np.int8(STATUSES.index("misfit")), code)
    return Localizations(
        states=out["state"],
        costs=out["cost"],
        mirrors=out["mirror"],
        mirror_costs=out["mirror_cost"],
        sigmas=out["sigma"],
        p_value=p_value,
        converged=out["converged"] == 1,
        code=code,
    )


def _with_correlation(
    record: Record, raw: _core._DipoleLocalized
) -> tuple[Record, _core._DipoleLocalized]:
    """Return the record with the correlation of the noise that fits, and its answer."""
    for _ in range(8):
        model = record.model(raw, np.sqrt(raw["weights"]))
        state = states_of(model, raw)
        noise = model.record(record.filled)
        found, _ = noise.noise(state, model.spacing, record.setup.sigma)
        moved = abs(found - record.options.correlation)
        record = record.with_correlation(found)
        raw = record.run()
        if moved < 1e-2 * (1 - found):
            break
    return record, raw


def _of_the_pass(state: Array, t: Array, sensors: Array) -> NDArray[np.bool_]:
    keep = np.zeros(t.shape, dtype=bool)
    v = state[3:6]
    speed = float(np.linalg.norm(v))
    if speed == 0:
        return ~keep
    for sensor in sensors:
        place = state[:3] - sensor
        closest = -(place @ v) / speed**2
        reach = _REACH * float(np.linalg.norm(place + closest * v)) / speed
        keep |= np.abs(t - closest) <= reach
    return keep
