"""What is exact: measurements without noise, and the surface that the states lie on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import finite
from gramian._noise import negligible
from gramian.exceptions import InputError
from gramian.problem import Array

if TYPE_CHECKING:
    from gramian.model._model import Model

__all__ = ["Ties", "moved_by", "normals_of"]


class Ties:
    """A model with its measurements: whitened residuals, and exact ones as heavy rows."""

    def __init__(self, model: Model, measured: Array) -> None:
        self.model, self.measured = model, measured
        self.kept = ~np.isnan(measured)
        self.noise = model.noise.keep(self.kept)
        self.exact = self.noise.exact
        self.groups: list[list[int]] = []
        self.lengths: list[tuple[list[int], float]] = []
        self.surface = np.zeros((0, model.n))
        tangent = model._options["tangent"]
        at = model.x
        if not len(self.exact) and tangent is None:
            self.count, self.sigma = 0, np.zeros(0)
            return
        if at is None:
            raise InputError("exact measurements or tangent: the model needs an x")
        self.at = at
        values, error, _ = model._derivatives(at)
        values, error = values[self.kept], None if error is None else error[self.kept]
        moved = moved_by(self.exact, values, error)
        self._check_redundant(self.exact[~moved])
        self.exact = self.exact[moved]
        normals = np.zeros((0, model.n))
        if tangent is not None:
            if callable(tangent):
                raise InputError(
                    "tangent is a function: an estimate needs the surface itself; "
                    "name the groups of states whose vector keeps its length"
                )
            normals = normals_of(tangent, at, model.names)
            if is_groups(tangent):
                self.groups = [[model.names.index(name) for name in group] for group in tangent]
                self.lengths = [(group, float(np.linalg.norm(at[group]))) for group in self.groups]
            else:
                self.surface = normals
        self.count = len(self.exact) + len(normals)
        self.sigma = negligible(
            self.noise.whiten(values), np.vstack([self.exact @ values, normals])
        )

    def twofold(self) -> list[int]:
        """Return which groups mean the same with the opposite sign, as unit quaternions do."""
        places = []
        for k, group in enumerate(self.groups):
            opposite = self.at.copy()
            opposite[group] = -opposite[group]
            same, other = self.model._value(self.at), self.model._batch(opposite[None])[0]
            off = np.abs(self.model.difference(other, same))
            if len(group) == 4 and (off <= 1e-12 * np.abs(same).max(initial=0.0)).all():
                places.append(k)
        return places

    def _check_redundant(self, combinations: Array) -> None:
        sizes = np.abs(combinations) @ np.abs(self.measured[self.kept])
        off = np.abs(combinations @ self.measured[self.kept])
        if (bad := np.flatnonzero(off > 1e-9 * sizes)).size:
            raise InputError(
                f"measurements contradict sigma: a combination of them that has no noise and "
                f"that no state moves is {off[bad[0]]:.3g}, and must be 0"
            )

    def difference(self, start: Array, to: Array) -> Array:
        """Return h(to) - h(start), whitened."""
        model = self.model
        off = model.difference(model._value(to), model._value(start))[self.kept]
        return np.concatenate(
            [self.noise.whiten(off), (self._ties(off, to) - self._ties(0 * off, start))]
        )

    def _ties(self, off: Array, x: Array) -> Array:
        lengths = [float(np.linalg.norm(x[group])) for group in self.groups]
        return np.concatenate([self.exact @ off, lengths, self.surface @ x]) / self.sigma

    def linearize(self, x: Array, with_rows: bool) -> tuple[Array, Array | None]:
        """Return residuals and rows."""
        model = self.model
        off = model.difference(self.measured, model._value(x))[self.kept]
        residuals = self.noise.whiten(off)
        if self.count:
            ties = self._ties(0 * off, self.at) - self._ties(-off, x)
            residuals = np.concatenate([residuals, ties])
        if not with_rows:
            return residuals, None
        values = model._derivatives(x)[0][self.kept]
        rows = self.noise.whiten(values)
        if self.count:
            normals = self.surface
            if self.groups:
                normals = np.zeros((len(self.groups), model.n))
                for line, group in zip(normals, self.groups, strict=True):
                    line[group] = x[group] / np.linalg.norm(x[group])
            heavy = np.vstack([self.exact @ values, normals]) / self.sigma[:, None]
            rows = np.vstack([rows, heavy])
        return residuals, rows


def moved_by(combinations: Array, values: Array, error: Array | None) -> NDArray[np.bool_]:
    """Return which exact combinations (q, m) of measurements any state moves.

    Of redundant measurements some are moved by none, and say nothing.
    """
    allowed = 1e-12 * (np.abs(combinations) @ np.abs(values))
    if error is not None:
        allowed = allowed + np.abs(combinations) @ error
    above = np.abs(combinations @ values) > 3 * allowed
    moved: NDArray[np.bool_] = np.any(above, axis=1)
    return moved


def normals_of(tangent: Any, state: Array, names: Sequence[str]) -> Array:
    """Return the directions (q, n) in which the state cannot move."""
    n = state.size
    if callable(tangent):
        tangent = tangent(state.copy())
    if is_groups(tangent):
        # The states of each group keep the length of their vector.
        normals = np.zeros((len(tangent), n))
        for line, group in zip(normals, tangent, strict=True):
            for name in group:
                if name not in names:
                    raise InputError(f"tangent names {name!r}: no state has that name")
                i = names.index(name)
                line[i] = state[i]
        return normals
    basis = finite(tangent, "tangent")
    if basis.ndim != 2 or basis.shape[0] != n or basis.shape[1] >= n:
        raise InputError(f"tangent has shape {basis.shape}: must be ({n}, d) with d < {n}")
    left, values, _ = np.linalg.svd(basis)
    rank = int((values > 1e-12 * values[0]).sum()) if values.size else 0
    return left[:, rank:].T


def is_groups(tangent: Any) -> bool:
    """Say whether a tangent is given as groups of states whose vector keeps its length."""
    return isinstance(tangent, (list, tuple)) and any(
        isinstance(part, (list, tuple)) and part and isinstance(part[0], str) for part in tangent
    )
