"""Sparse systems of very many states: whether chosen modes are shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, real, whole
from gramian._text import brief, count
from gramian.exceptions import InputError
from gramian.large import SparseProblem
from gramian.large._analysis import reduced
from gramian.large._problem import compressed
from gramian.models.linear._pencil import Mode
from gramian.models.linear._systems import SystemLike, Time, matrices, time_of

__all__ = ["Modes", "modes"]

Array = NDArray[np.float64]

#: Eigenvalues nearer to each other than this part of the norm of A are looked at once.
_ALIKE = 1e-9
#: Below this part of the norm a mode may be hidden, and its eigenvalue is improved.
_NEAR = 1e-6
#: An eigenvalue is no more accurate than this part of the norm of A.
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Answer):
    """Whether the modes of a sparse system near a point are shown.

    Attributes
    ----------
    near : complex
        The point.
    eigenvalues : ndarray of complex, shape (m,)
        The eigenvalues of A nearest to it, with imaginary part >= 0, each once.
    distances : ndarray, shape (m,)
        The smallest singular value of [A - z I; C] at each: by so much A and C would
        have to change for a mode there not to be shown. No distance to an unobservable
        pair exceeds it.
    norm : float
        The largest singular value of [A - z I; C] at the first, nearly.
    hidden : tuple of Mode
        The motions among them that no output shows.
    hidden_at : ndarray, shape (m,)
        How many combinations (real ones) are hidden at each eigenvalue.
    rtol : float
    names : tuple of str, length n
    """

    near: complex
    eigenvalues: NDArray[np.complex128]
    distances: Array
    norm: float
    hidden: tuple[Mode, ...]
    hidden_at: NDArray[np.int64]
    rtol: float
    names: tuple[str, ...]

    def summary(self) -> str:
        """Return which of the modes are not shown, as text."""
        looked = f"{count(len(self.eigenvalues), 'eigenvalue')} nearest to {_shown(self.near)}"
        if not self.hidden:
            least = brief(self.distances.min())
            return f"SHOWN: all modes at the {looked}; the least clear at distance {least}"
        lines = [
            f"NOT SHOWN: {count(int(self.hidden_at.sum()), 'combination')} of the modes at the "
            f"{looked}"
        ]
        lines += [f"  {mode.motion}: {count(mode.combinations.shape[1], 'combination')}"
                  for mode in self.hidden]  # fmt: skip
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values = {"distance": self.distances, "hidden": self.hidden_at}
        return Columns("eigenvalue", [_shown(z) for z in self.eigenvalues], values, {})


def modes(
    A: SystemLike,
    C: Any = None,
    near: complex = 0.0,
    count: int = 6,
    *,
    names: Sequence[str] | Callable[[int], str] | None = None,
    rtol: float | None = None,
    time: Time = "continuous",
) -> Modes:
    """Say whether the modes of a large sparse system near a point are shown.

    Parameters
    ----------
    A : scipy.sparse array, shape (n, n), or state-space object with one
        Up to about 10^5 states; arrays serve too.
    C : array_like or scipy.sparse array, shape (p, n)
    near : complex
        The modes whose eigenvalues are nearest to this are looked at: 0 for the slowest,
        2 pi i f for those that oscillate with frequency f; for a discrete system, 1 and
        e^(2 pi i f dt).
    count : int
        So many eigenvalues, copies and conjugates counted.
    names : sequence of str, or function of the column number, optional
    rtol : float, optional
        A singular value below this part of the norm counts as zero; 1024 eps sqrt(n) by
        default.
    time : {"continuous", "discrete"}

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, eigenvalues that cannot be
        found there.
    MemoryError
        A factor that does not fit; the message says how much it takes.

    Notes
    -----
    The eigenvalues by Arnoldi's method with shift and inversion (ARPACK by SciPy), which
    may miss copies of one; what is hidden at each by the sparse null space of
    [A - z I; C] (Hautus), which misses none: real and imaginary part side by side for a
    complex z. A chain of generalised eigenvectors counts once. A and C are used in the
    units they have.

    Examples
    --------
    Two equal rods are heated, and the sum of the temperatures at their ends is measured.

    >>> import numpy as np
    >>> from scipy.sparse import block_diag, diags_array
    >>> rod = diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(50, 50))
    >>> C = np.zeros((1, 100))
    >>> C[0, [49, 99]] = 1.0
    >>> found = modes(block_diag([rod, rod]), C, near=0.0, count=4)
    >>> found.hidden_at
    array([1, 1])
    >>> found.hidden[0].motion
    'decays with time constant 263.6'
    """
    time = time_of(A, time)
    tolerance = options.tolerance(rtol)
    number = whole(count, "count", 1)
    z0 = _point(near)
    a, c, labels = _system(A, C, names)
    n = a.shape[0]
    used = 1024 * float(np.finfo(float).eps) * np.sqrt(n) if tolerance is None else tolerance
    size = float(np.sqrt(a.multiply(a).sum(axis=0).max(initial=0.0))) or 1.0
    found = _distinct(_nearest(a, z0, number, size), _ALIKE * size)
    hidden, each, distances, values = [], [], [], []
    norm = 0.0
    for z in found:
        at, value, vectors, largest = _look(a, c, z, used)
        norm = norm or largest
        values.append(at)
        distances.append(value)
        each.append(vectors.shape[1])
        if vectors.shape[1]:
            # As accurate as the singular value that was taken for zero.
            hidden.append(Mode(at, vectors, labels, time, max(value, _ROUNDING * size)))
    return Modes(
        near=z0,
        eigenvalues=np.array(values),
        distances=np.array(distances),
        norm=norm,
        hidden=tuple(hidden),
        hidden_at=np.array(each, dtype=np.int64),
        rtol=used,
        names=labels,
    )


def _shown(z: complex) -> str:
    return f"{z:.8g}" if z.imag else f"{z.real:.8g}"


def _point(near: complex) -> complex:
    if isinstance(near, (str, bytes)):
        raise InputError(f"near = {options.given(near)}: must be a complex number")
    try:
        z = complex(near)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"near = {options.given(near)}: must be a complex number") from None
    # As everywhere: a number that is not finite is named.
    real(z.real, "near")
    real(z.imag, "near")
    if not (np.isfinite(z.real) and np.isfinite(z.imag)):
        raise InputError(f"near = {near}: must be finite")
    return z


def _system(A: SystemLike, C: Any, names: Any) -> tuple[Any, Any, tuple[str, ...]]:
    from scipy.sparse import csr_array, issparse

    a, c = matrices(A, C)
    parts = []
    for label, value in (("A", a), ("C", c)):
        given = value if issparse(value) else finite(value, label)
        if given.ndim != 2:
            raise InputError(f"{label} has shape {given.shape}: must be a matrix")
        array = compressed(given if issparse(given) else csr_array(given), None, None)
        if (bad := np.flatnonzero(~np.isfinite(array.data))).size:
            raise InputError(f"{label} has {array.data[bad[0]]}: must be finite")
        parts.append(array)
    a, c = parts
    if a.shape[0] != a.shape[1] or a.shape[0] == 0:
        raise InputError(f"A has shape {a.shape}: must be square, a row and a column a state")
    if c.shape[1] != a.shape[0] or c.shape[0] == 0:
        raise InputError(f"C has shape {c.shape}: must be (outputs, {a.shape[0]})")
    # The names are checked as those of sparse rows are.
    return a, c, SparseProblem(c, names).names


def _nearest(a: Any, z0: complex, count: int, size: float) -> NDArray[np.complex128]:
    """Return the eigenvalues nearest to a point."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, eigs

    n = a.shape[0]
    if n <= max(100, 4 * count):
        every = np.linalg.eigvals(a.toarray())
        return every[np.argsort(np.abs(every - z0), kind="stable")[:count]]
    # The shift itself must not be an eigenvalue.
    shift = z0 + size * (1e-7 + 0.7e-7j)
    start = np.random.default_rng(0).normal(size=n).astype(complex)
    try:
        values = eigs(
            csc_array(a, dtype=complex),
            k=count,
            sigma=shift,
            v0=start,
            return_eigenvectors=False,
        )
    except ArpackNoConvergence as error:
        values = error.eigenvalues
    except (ArpackError, RuntimeError) as error:
        raise InputError(f"near = {z0:g}: no eigenvalue was found there: {error}") from error
    if not len(values):
        raise InputError(f"near = {z0:g}: no eigenvalue of A converged: try another point")
    found: NDArray[np.complex128] = values[np.argsort(np.abs(values - z0), kind="stable")]
    return found


def _distinct(values: NDArray[np.complex128], alike: float) -> list[complex]:
    kept: list[complex] = []
    for value in values:
        z = complex(value.real, abs(value.imag) if abs(value.imag) > alike else 0.0)
        if all(abs(z - other) > alike for other in kept):
            kept.append(z)
    return kept


def _look(a: Any, c: Any, z: complex, rtol: float) -> tuple[complex, float, Array, float]:
    """Return the eigenvalue, the smallest singular value there, what is hidden, the norm."""
    n = a.shape[0]
    for attempt in range(4):
        pencil = _pencil(a, c, z)
        unit = float(np.sqrt(pencil.multiply(pencil).sum(axis=0).max(initial=0.0))) or 1.0
        analysis = reduced(pencil, rtol, unit=unit)
        if analysis.nullity:
            vectors = _columns(analysis.null_vectors(), pencil.shape[1])[:n]
            return z, analysis.largest_dropped * unit, _basis(vectors), analysis.norm * unit
        value = analysis.smallest_counting
        if attempt == 3 or value > _NEAR * analysis.norm:
            break
        # Perhaps hidden, and the eigenvalue not accurate enough to tell.
        _, packed = analysis.weakest(1)
        v = _columns(packed, pencil.shape[1])[:, 0]
        w = v[:n] + 1j * v[n:] if len(v) > n else v.astype(complex)
        better = complex(np.vdot(w, a @ w) / np.vdot(w, w))
        if z.imag == 0:
            better = complex(better.real)
        if abs(better - z) <= 1e-16 * unit:
            break
        z = better
    return z, value * unit, np.zeros((n, 0)), analysis.norm * unit


def _pencil(a: Any, c: Any, z: complex) -> Any:
    """Return [A - z I; C], for a complex z with real and imaginary part side by side."""
    from scipy.sparse import block_array, csr_array, eye_array, vstack

    shifted = a - z.real * eye_array(a.shape[0], format="csr")
    if z.imag == 0:
        return csr_array(vstack([shifted, c], format="csr"))
    turn = z.imag * eye_array(a.shape[0], format="csr")
    whole_pencil = block_array(
        [[shifted, turn], [-turn, shifted], [c, None], [None, c]], format="csr"
    )
    return csr_array(whole_pencil)


def _columns(packed: Any, n: int) -> Array:
    start, index, value = packed
    dense = np.zeros((n, len(start) - 1))
    for k in range(len(start) - 1):
        own = slice(start[k], start[k + 1])
        dense[index[own], k] = value[own]
    return dense


def _basis(vectors: Array) -> Array:
    """Return the combinations with a leading coefficient of 1 each."""
    from scipy.linalg import qr, solve

    left, values, _ = np.linalg.svd(vectors, full_matrices=False)
    # The upper halves of the null vectors of a complex z span real and imaginary parts.
    kept = left[:, values > 1e-6 * values[0]]
    _, _, pivots = qr(kept.T, mode="economic", pivoting=True)
    reduced_basis: Array = solve(kept[pivots[: kept.shape[1]]].T, kept.T).T
    reduced_basis[np.abs(reduced_basis) < 1e-9] = 0.0
    return reduced_basis
