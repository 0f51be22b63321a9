"""The size of a pass that several heads see from so far that they cannot tell it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, describe_null_space
from gramian.exceptions import UnobservableError
from gramian.models.dipole._estimate import DipoleModel
from gramian.models.dipole._model import NAMES

__all__ = ["require_size"]

Array = NDArray[np.float64]

#: Beyond so many times the distance between heads differences of the field lose their digits.
_FAR = 1e3
#: Of chi2, 95 % on one side.
_RISE = 2.71


def require_size(model: DipoleModel, state: Array, z: Array) -> None:
    """Refuse a pass that fits as well at any larger size, and say how near it may be.

    A gradiometer tells the size of a pass by how its field bends within the baseline, several
    sensors of the total field by how it differs between them. From afar noise hides this, and the
    least squares lie at infinity. The pass of another size is fitted with its speed held.
    """
    heads = [model.sensors]
    if model.baselines is not None:
        heads.append(model.sensors + model.baselines)
    places = np.concatenate(heads)
    extent = float(np.linalg.norm(places[:, None] - places, axis=2).max())
    reach = model.functions["range"][0](state)[0]
    if not reach > _FAR * extent > 0.0:
        return
    speed = float(np.linalg.norm(model.expand(state)[0][3:6]))
    # The field falls as the cube of the distance, a difference of it by one power more.
    power = 3 if model.baselines is None else 4
    grows = {"m": 1, "m/s": 1, "m/s^2": 1, "A m^2": power, "m^3": power, "A m^3": power + 1}
    powers = [grows.get(unit, 0) for unit in model.units]

    def fitted(start: Array, size: float, held: float) -> tuple[Array, float, float]:
        """Return the states of the pass of a size, its chi2 and its range."""
        scaled = start * size ** np.array(powers, dtype=float)
        near = model.expand(scaled)[0]
        other = replace(model, near=near, known=dict(model.known) | {"speed": held})
        handle = other.handle(z)
        reached = handle.minimize(model.carry(scaled, other)[None], ("squares", 0.0), 100)
        if not reached:
            # It meets a sensor.
            return start, np.inf, 0.0
        found = np.asarray(reached[0]["x"])
        chi2 = float((handle.linearize(found)[0] ** 2).sum())
        return other.carry(found, model), chi2, other.functions["range"][0](found)[0]

    at = _FAR * extent / reach
    x, far, _ = fitted(state, at, at * speed)
    _, farther, _ = fitted(x, 10.0, 10.0 * at * speed)
    least = min(far, farther)
    if not max(far, farther) < least + _RISE:
        return
    here, distance = far, _FAR * extent
    while here < least + _RISE and distance > 0.1 * extent:
        before, nearest = here, distance
        at *= 0.5
        x, here, distance = fitted(x, 0.5, at * speed)
    # Between the two sizes, on a logarithmic scale.
    share = min(max((least + _RISE - before) / max(here - before, 1e-300), 0.0), 1.0)
    limit = nearest * (distance / nearest) ** share
    # From where least squares have run to the end of the numbers no pass is led back.
    told = (
        f"Its closest range is at least {brief(limit, 3)} m (95 %), without an upper limit"
        if limit < 10.0 * _FAR * extent
        else "How near it may be cannot be told from where the fit ended"
    )
    full = model.expand(x)[0]
    null = np.concatenate([full[:6], power * full[6:]])
    directions = describe_null_space((null / np.linalg.norm(null))[:, None], NAMES)
    raise UnobservableError(
        f"too far to tell: the pass fits as well at any larger size. {told}; "
        f"{'; '.join(directions)} is not determined, any one of these would do: speed, moment",
        directions,
    )
