"""Whether a state is shown at all: the pencil [A - z I; C] and what it leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import atan2, hypot, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer
from gramian._arrays import finite, number, whole
from gramian._text import brief, describe_direction
from gramian.exceptions import InputError
from gramian.models.linear._levels import coefficients
from gramian.models.linear._systems import (
    System,
    SystemLike,
    Time,
    system_of,
    time_of,
    whitener,
)

__all__ = ["Distance", "Mode", "Unobservable", "distance", "unobservable"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Distance(Answer):
    """How far a pair (A, C) is from the nearest unobservable one.

    Attributes
    ----------
    distance : float
        The smallest singular value of [A - z I; C] over all complex z, in the scaling
        of the question.
    z : complex
        Where it is attained; the conjugate serves as well.
    direction : ndarray of complex, shape (n,)
        The unit vector that is nearly not shown there, in the units of A.
    norm : float
        The Frobenius norm of [A; C] in the same scaling.
    at_least : float or None
        With ``certify=True``, a proved lower bound of the distance; None without.
    complete : bool
        Whether the proof came as near as `slack` asked for.
    scaling : str
        What A and C were multiplied by before the question, in words.
    names : tuple of str, length n
    evaluations : int
        How often the singular value was found.
    """

    distance: float
    z: complex
    direction: NDArray[np.complex128]
    norm: float
    at_least: float | None
    complete: bool
    scaling: str
    names: tuple[str, ...]
    evaluations: int

    @property
    def relative(self) -> float:
        """The distance over the norm of [A; C]."""
        return self.distance / self.norm if self.norm > 0 else 0.0

    def summary(self) -> str:
        """Return the distance and what is nearly lost, as text."""
        size = np.abs(self.direction)
        kept = [
            f"{brief(size[i])} {self.names[i]}"
            for i in np.argsort(-size, kind="stable")[:4]
            if size[i] > 1e-3 * size.max()
        ]
        lines = [
            f"distance to the nearest unobservable pair {self.distance:.6g} "
            f"({brief(self.relative)} of the norm of A and C), scaling: {self.scaling}",
            f"  attained at z = {self.z:.6g}, by a motion of {', '.join(kept)}",
        ]
        if self.at_least is not None:
            proof = "proved" if self.complete else "proved so far"
            lines.append(f"  no nearer than {self.at_least:.6g}: {proof}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False, repr=False)
class Mode(Answer):
    """A motion of the state that no output shows.

    Attributes
    ----------
    eigenvalue : complex
        With imaginary part >= 0; of a cluster, the mean. Per unit of time, or a factor
        per sample for a discrete system. A part that is not told from zero is zero.
    combinations : ndarray, shape (n, k)
        The combinations of states that it moves, in physical units, one a column.
    names : tuple of str, length n
    time : {"continuous", "discrete"}
    error : float
        How wrong the eigenvalue may be by rounding.
    """

    eigenvalue: complex
    combinations: Array
    names: tuple[str, ...]
    time: Time = "continuous"
    error: float = 0.0

    _more_in_dict = ("motion", "texts")

    @property
    def decays(self) -> bool:
        """Whether the motion dies out by itself, beyond what rounding may have done."""
        if self.time == "discrete":
            return abs(self.eigenvalue) < 1 - max(self.error, 1e-15)
        return self.eigenvalue.real < -self.error

    @property
    def motion(self) -> str:
        """The motion in words: its time constant, or its frequency and damping."""
        z, error = self.eigenvalue, self.error
        unit = ""
        if self.time == "discrete":
            if abs(z) <= error:
                return "gone after one sample"
            unit, error = " samples", max(error / abs(z), 1e-15)
            z = complex(np.log(abs(z)), abs(atan2(z.imag, z.real)))
        # What is not told from zero is none.
        z = complex(*(0.0 if abs(part) <= error else part for part in (z.real, z.imag)))
        size = hypot(z.real, z.imag)
        if size == 0:
            return "constant"
        if z.imag == 0:
            word = "decays" if z.real < 0 else "grows"
            return f"{word} with time constant {brief(1 / abs(z.real), 4)}{unit}"
        damping = 0.0 - z.real / size
        shape = (
            f"oscillates with period {brief(2 * pi / z.imag, 4)}{unit}, damping {brief(damping)}"
        )
        return shape if damping >= 0 else f"{shape}: grows"

    @property
    def texts(self) -> tuple[str, ...]:
        """The combinations in words: "x +1, y -1"."""
        return tuple(describe_direction(column, self.names) for column in self.combinations.T)


@dataclass(frozen=True, eq=False, repr=False)
class Unobservable(Answer):
    """What no output of a linear system shows.

    Attributes
    ----------
    names : tuple of str, length n
    null_space : ndarray, shape (n, nullity)
        Basis in physical units, each column with a leading coefficient of 1.
    modes : tuple of Mode
        Its motions, the least damped first.
    margins : (float, float)
        The smallest singular value that counted and the largest that was taken for
        rounding, over the norm of the balanced pencil; the tolerance is between them.
    rtol : float
    undecided : bool
        Whether a singular value is so near to rounding that it may be zero or not; always
        False where `rtol` was given. `nullity` is the most it may be then.
    scales : ndarray, shape (n,)
        What each balanced state is multiplied by to give the physical one: powers of two.
    time_scale : float
        What the unit of time was multiplied by.
    time : {"continuous", "discrete"}
    """

    names: tuple[str, ...]
    null_space: Array
    modes: tuple[Mode, ...]
    margins: tuple[float, float]
    rtol: float
    undecided: bool
    scales: Array
    time_scale: float
    time: Time
    _system: System

    _more_in_dict = ("status", "nullity", "detectable", "null_combinations")

    @cached_property
    def _found(self) -> _core.LinearUnobservable:
        return _core.LinearUnobservable(self._system.A, self._system.C, self.rtol)

    @property
    def nullity(self) -> int:
        """Number of combinations that no output shows."""
        return int(self.null_space.shape[1])

    @property
    def rank(self) -> int:
        """Number of combinations that are shown."""
        return len(self.names) - self.nullity

    @property
    def status(self) -> Literal["observable", "undecided", "unobservable"]:
        """What is known of the whole state."""
        if self.undecided:
            return "undecided"
        return "unobservable" if self.nullity else "observable"

    @property
    def detectable(self) -> bool:
        """Whether all that is not shown dies out by itself: harmless to a filter."""
        return all(mode.decays for mode in self.modes)

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """The null space in words."""
        return tuple(describe_direction(column, self.names) for column in self.null_space.T)

    def left_by(
        self, outputs: ArrayLike | Mapping[str, ArrayLike | Mapping[str, float]] | None = None
    ) -> dict[str, int]:
        """Say how many combinations stay unobservable with one more output.

        Parameters
        ----------
        outputs : mapping of str to coefficients, or array_like (k, n), optional
            Candidates, each a row of C; by default every state measured by itself.

        Returns
        -------
        dict of str to int
            The nullity that is left with each: 0 where it repairs the system.
        """
        if outputs is None:
            labels, rows = self.names, np.eye(len(self.names))
        elif isinstance(outputs, Mapping):
            labels = tuple(options.mapping(outputs, "outputs", "name to coefficients"))
            parts = [coefficients(value, self.names) for value in outputs.values()]
            rows = np.array(parts).reshape(-1, len(self.names))
        else:
            rows = np.atleast_2d(finite(outputs, "outputs"))
            if rows.ndim != 2 or rows.shape[1] != len(self.names):
                raise InputError(f"outputs has shape {rows.shape}: must be (k, {len(self.names)})")
            labels = tuple(f"output {i}" for i in range(len(rows)))
        return dict(zip(labels, self._found.left_by(rows), strict=True))

    def project(self, rows: ArrayLike) -> Array:
        """Take from rows about the state, shape (k, n), what rounding says of the subspace."""
        return self._found.project(rows)

    def summary(self) -> str:
        """Return what is not shown, mode by mode, as text."""
        n = len(self.names)
        if self.nullity == 0:
            return f"OBSERVABLE: rank {n} of {n}, margin {brief(self.margins[0])} of the norm"
        harm = "all decay: detectable" if self.detectable else "not detectable"
        lines = [f"UNOBSERVABLE: rank {self.rank} of {n}; {harm}"]
        if self.undecided:
            lines = [
                f"UNDECIDED: rank {self.rank} of {n} at least; a singular value is too near to "
                "rounding to tell whether it is zero",
                f"if it is, not shown; {harm}",
            ]
        for mode in self.modes:
            lines.append(f"  {mode.motion}:")
            lines += [f"    {text}" for text in mode.texts]
        return "\n".join(lines)


def distance(
    A: SystemLike,
    C: ArrayLike | None = None,
    *,
    scaling: Literal["none", "balanced", "prior"] = "none",
    certify: bool = False,
    slack: float = 0.05,
    most: int = 1_000_000,
    names: Sequence[str] | None = None,
    prior: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | None = None,
) -> Distance:
    """Return the distance of (A, C) to the nearest unobservable pair.

    By how much A and C together would have to change (complex changes allowed; for real
    ones, or for A alone, it is a lower bound) until some combination of states is no
    longer shown.

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
    C : array_like, shape (p, n)
    scaling : {"none", "balanced", "prior"}
        "none": A and C as they are; the distance has their mixture of units.
        "balanced": states, outputs and time in the units, powers of two, in which the
        entries come as near to one as they can (Curtis & Reid 1972): other units change it
        no more than the rounding to powers of two does.
        "prior": states in their prior deviations, outputs in those of their noise, time
        in that of the fastest mode.
    certify : bool
        Prove a lower bound.
    slack : float
        With `certify`: prove that the distance is at least (1 - slack) of what was found.
    most : int
        With `certify`: evaluations to stop at.
    names : sequence of str, length n, optional
    prior : array_like, shape (n,), or mapping of str to float, optional
    R : array_like, optional
        Covariance of the outputs.

    Returns
    -------
    Distance

    Raises
    ------
    InputError
        Matrices that do not fit; a state without prior where `scaling` is "prior".

    Notes
    -----
    min over complex z of sigma_min([A - z I; C]) (Eising 1984). One complex Schur form,
    then a singular value costs O(n^2); local minima are found from the eigenvalues of A
    and of its symmetric part and from a coarse grid. The smallest is an upper bound, in
    practice the distance. The certificate covers the plane by squares: the singular value
    changes by no more than z does, so that a square is done when the value at its center
    exceeds the bound by half its diagonal.

    Examples
    --------
    >>> found = distance([[1.0, 0.0], [0.0, 2.0]], [[1.0, 1.0]])
    >>> round(found.distance, 4)
    0.5
    """
    system = system_of(A, C, names, prior=prior, R=R)
    a, c = system.A, system.C
    options.choice(scaling, "scaling", ("none", "balanced", "prior"))
    certify = options.flag(certify, "certify")
    if R is not None:
        whitener(R, len(system.C), None)
    if scaling == "none":
        words = "as given"
    elif scaling == "balanced":
        a, c = _core.linear_balanced(a, c)
        words = "balanced"
    else:
        missing = [n for n, s in zip(system.names, system.prior, strict=True) if np.isnan(s)]
        if missing:
            raise InputError(f"prior is missing for {missing[0]}: scaling = 'prior' needs all")
        white = whitener(R, len(c), system.noise)
        d = system.prior
        fastest = float(np.abs(_core.LinearPencil(a, c).eigenvalues()).max()) or 1.0
        a, c = a * d / d[:, None] / fastest, white @ c * d
        words = f"prior, noise, and the fastest mode ({brief(fastest, 4)} per unit of time)"
    pencil = _core.LinearPencil(a, c)
    at_least, complete = None, False
    if certify:
        slack = number(slack, "slack")
        if not 0 < slack < 1:
            raise InputError(f"slack = {slack}: must be between 0 and 1")
        found, at_least, complete = pencil.certify(slack, whole(most, "most", 1))
    else:
        found = pencil.distance()
    value, z, direction, evaluations = found
    return Distance(
        distance=value,
        z=complex(*z),
        direction=direction[0] + 1j * direction[1],
        norm=pencil.norm,
        at_least=at_least,
        complete=complete,
        scaling=words,
        names=system.names,
        evaluations=evaluations,
    )


def unobservable(
    A: SystemLike,
    C: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    *,
    rtol: float | None = None,
    time: Time = "continuous",
) -> Unobservable:
    """Return what no output of a linear system shows: the subspace and its modes.

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
    C : array_like, shape (p, n)
    names : sequence of str, length n, optional
        The states; x0, x1, ... by default.
    rtol : float, optional
        A singular value of the balanced pencil below this part of its norm counts as
        zero; 1024 eps sqrt(n) by default, and then one near to it, or to the rounding of
        the entries of A, makes the status "undecided". Raise it for matrices from
        measurements.
    time : {"continuous", "discrete"}
        Whether A is that of x' = A x or of x[k+1] = A x[k]; an object with a nonzero
        attribute ``dt`` is discrete.

    Returns
    -------
    Unobservable

    Raises
    ------
    InputError
        An A that is not square, a C of another width, a number that is not finite.

    Notes
    -----
    The largest A-invariant subspace in the kernel of C, for systems of hundreds of
    states: one complex Schur form of the balanced A, the smallest singular value of
    [A - z I; C] at each eigenvalue (Hautus), and an orthogonal deflation of every
    direction where it is rounding. No powers of A are formed. O(n^3).

    Examples
    --------
    Two equal rooms are heated; the sum of the temperatures is measured.

    >>> found = unobservable([[-0.5, 0], [0, -0.5]], [[1, 1]], ["first", "second"])
    >>> print(found.summary())
    UNOBSERVABLE: rank 1 of 2; all decay: detectable
      decays with time constant 2:
        first +1, second -1
    >>> found.left_by()
    {'first': 0, 'second': 0}
    """
    time = time_of(A, time)
    rtol = options.tolerance(rtol)
    system = system_of(A, C, names)
    found = _core.LinearUnobservable(system.A, system.C, rtol)
    rejected, weakest, used = found.margins
    scales, time_scale = found.scales
    return Unobservable(
        names=system.names,
        null_space=found.null_space(),
        modes=tuple(
            Mode(complex(re, im), combinations, system.names, time, error)
            for re, im, error, combinations in found.modes()
        ),
        margins=(weakest, rejected),
        rtol=used,
        undecided=found.undecided,
        scales=np.array(scales),
        time_scale=time_scale,
        time=time,
        _system=system,
    )
