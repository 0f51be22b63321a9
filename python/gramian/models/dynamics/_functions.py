"""The user's functions, called for several points at once, and their derivatives."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array
from gramian.exceptions import InputError

__all__ = ["Function", "OneByOne", "System"]

Array = NDArray[np.float64]
Function = Callable[..., Any]
#: Of times (k,) and states (k, n).
Many = Callable[[Array, Array], Array]

#: Of values: far above how numpy's loops over long and short arrays differ, far below
#: what differences and rows could tell.
ROUNDING = 1e-13


class OneByOne(BaseException):
    """A function that seemed to take many states at once does not: `name` is asked anew.

    No Exception: it must not pass for a fault of a guess.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


class Asked:
    """A function of the caller's, asked about many states: with values of a known shape.

    Parameters
    ----------
    function : callable
        Of t and x (n,), or of t (k,) and x (n, k) as well.
    name : str
        For messages.
    shape : tuple of int or None, optional
        Of its value at one state: (p,) or (p, n). None in it: any number.
    vectorized : bool, optional
        Whether it takes many states in one call. None: `try_many` finds out, and what it
        says of many is compared with what it says of single ones ever after.

    Notes
    -----
    A function for one state that is given many may look at the wrong axis (`x.sum()`,
    `np.linalg.norm(x)`), decide for all by one of them (`if (x > 0).all()`), or keep
    something from one call to the next. What is wrong for some of the states is seen where
    these are compared: at states near the first and of both signs, and in each call those
    where a state or the time is smaller or larger than it was before, and one more. Of the
    points that a Jacobian is made of, those at one time are compared together: values may
    hide what derivatives show.
    """

    def __init__(
        self, function: Function, name: str, shape: tuple[int | None, ...], vectorized: bool | None
    ) -> None:
        self.function, self.name, self.shape = function, name, shape
        self.at_once = bool(vectorized)
        self.found_out = vectorized is None
        self.calls = 0
        #: Least and largest states and times that were compared, alone and in Jacobians.
        self._seen: dict[bool, tuple[Array, Array]] = {}

    def __call__(self, t: Array, x: Array) -> Array:
        """Return the values (k, *shape) at times (k,) and states (k, n), complex where x is."""
        if not self.at_once or (self.found_out and len(t) == 1):
            return self._singly(t, x)
        if not self.found_out:
            return self._together(t, x)
        try:
            values = self._together(t, x)
        except Exception:
            # One of the states may be what it refuses: then this says so.
            self._singly(t, x)
            raise OneByOne(self.name) from None
        places = self._looked_at(t, x)
        if not _agree(values[places], self._singly(t[places], x[places])):
            raise OneByOne(self.name)
        return values

    def try_many(self, times: Array, x: Array, moves: Array) -> None:
        """Find out, near the state x (n,) at the first time, whether it takes many at once."""
        if not self.found_out:
            return
        # A number that no axis of it has, and no product along one.
        few, more = [k for k in (5, 7, 11, 13, 17) if k not in (len(x), *self.shape)][:2]
        self.at_once = self._takes(*_around(times, x, moves, few, signs=False)) and self._takes(
            *_around(times, x, moves, more, signs=True), refused=True
        )

    def _takes(self, t: Array, x: Array, *, refused: bool = False) -> bool:
        """Whether it agrees at many with itself at each; `refused`: or refuses most of them."""
        kept, alone = [], []
        with np.errstate(all="ignore"):
            for k in range(len(t)):
                try:
                    alone.append(self._singly(t[k : k + 1], x[k : k + 1])[0])
                    kept.append(k)
                except Exception:
                    # A state that it refuses tells nothing.
                    continue
            if len(kept) < 3:
                return refused
            try:
                values = self._together(t[kept], x[kept])
            except Exception:
                return False
        return _agree(values, np.array(alone))

    def _looked_at(self, t: Array, x: Array) -> NDArray[np.int64]:
        """Return which of many states are compared."""
        n = x.shape[1]
        # One state, moved to make a Jacobian, is at one time.
        ends = np.flatnonzero(np.diff(t, append=np.inf) != 0) + 1
        moved = len(ends) < len(t)
        where = np.column_stack([t, x.real])[ends - 1]
        low, high = where.min(axis=0), where.max(axis=0)
        least, most = self._seen.get(moved, (np.full(n + 1, np.inf), np.full(n + 1, -np.inf)))
        # What is hardly beyond waits until it is more.
        margin = np.fmax(0.02 * (most - least), 0.0)
        under, over = low < least - margin, high > most + margin
        new = {int(where[:, j].argmin()) for j in np.flatnonzero(under)}
        new |= {int(where[:, j].argmax()) for j in np.flatnonzero(over)}
        self._seen[moved] = np.where(under, low, least), np.where(over, high, most)
        self.calls += 1
        begins = np.append(0, ends[:-1])
        # Of each state that is moved one move.
        runs = [
            np.arange(begins[k], ends[k], max(1, (ends[k] - begins[k]) // n)) for k in sorted(new)
        ]
        return np.concatenate([*runs, [7919 * self.calls % len(t)]])

    def _singly(self, t: Array, x: Array) -> Array:
        # A function may return one array of its own at each call: it is copied.
        out: Any = None
        for k, (a, b) in enumerate(zip(t.tolist(), x, strict=True)):
            value = self._read(self.function(a, b.copy()), None, complex_too=x.dtype.kind == "c")
            if out is None:
                out = np.empty((len(t), *value.shape), dtype=x.dtype)
            out[k] = value
        return np.empty((0, *(s or 0 for s in self.shape)), x.dtype) if out is None else out

    def _together(self, t: Array, x: Array) -> Array:
        count = len(t)
        value = self.function(t.copy(), np.array(x.T, order="C"))
        values = self._read(value, count, complex_too=x.dtype.kind == "c")
        return np.ascontiguousarray(np.moveaxis(values, -1, 0), dtype=x.dtype)

    def _read(self, value: Any, count: int | None, *, complex_too: bool) -> Array:
        """Return what the function gave for one state, or for `count`, checked."""
        depth = len(self.shape)
        if count is not None and isinstance(value, (list, tuple)):
            value = _level(value, depth, count)
        what = f"what {self.name} returned"
        array: Any = np.asarray(value) if complex_too else as_float_array(value, what)
        if depth == 1 and array.ndim == (0 if count is None else 1) and self.shape[0] in (None, 1):
            # One output, as a number.
            array = array[None]
        elif depth == 2 and count is not None and array.shape == self.shape:
            array = np.broadcast_to(array[..., None], (*array.shape, count))
        wanted = self.shape if count is None else (*self.shape, count)
        if array.ndim != len(wanted) or any(
            w is not None and w != s for w, s in zip(wanted, array.shape, strict=True)
        ):
            shape = ", ".join("p" if w is None else str(w) for w in wanted)
            comma = "," if len(wanted) == 1 else ""
            raise InputError(f"{self.name} returned shape {array.shape}: must be ({shape}{comma})")
        return array  # type: ignore[no-any-return]


def _level(value: Any, depth: int, count: int) -> Any:
    """Return nested lists with the constants among their entries as long as the others."""
    if depth and isinstance(value, (list, tuple)):
        return [_level(entry, depth - 1, count) for entry in value]
    return np.full(count, value) if not depth and np.ndim(value) == 0 else value


def _agree(a: Array, b: Array) -> bool:
    """Whether values (k, ...) are the same to rounding, each beside others of its kind."""
    if a.shape != b.shape:
        return False
    parts = ((a.real, b.real), (a.imag, b.imag)) if a.dtype.kind == "c" else ((a, b),)
    with np.errstate(all="ignore"):
        for x, y in parts:
            size = np.where(np.isfinite(y), np.abs(y), 0.0)
            off = np.abs(x - y)
            same = (x == y) | (np.isnan(x) & np.isnan(y)) | (off <= ROUNDING * size)
            if not same.all():
                # A difference of large numbers: beside the usual size, the middle of those
                # that are not zero.
                zeros = (size == 0).sum(axis=0, keepdims=True)
                middle = np.minimum((zeros + len(size)) // 2, len(size) - 1)
                usual = np.take_along_axis(np.sort(size, axis=0), middle, axis=0)
                same |= off <= ROUNDING * usual
                if not same.all():
                    return False
    return True


def _around(
    times: Array, x: Array, moves: Array, count: int, *, signs: bool
) -> tuple[Array, Array]:
    """Return `count` times and states, all different in every entry: near x, or of both signs."""
    part = 0.5 + np.arange(1, len(x) + 1) / (len(x) + 1)

    def spread(root: float) -> Array:
        # Multiples of irrational numbers: no two are alike.
        parts: Array = np.outer(np.arange(1, count + 1), np.sqrt(root) * part) % 1.0
        return parts

    t = times[0] + (times[-1] - times[0]) * (np.arange(count) * np.sqrt(5) % 1.0)
    if not signs:
        return t, x + 0.02 * moves * (spread(2) - 0.5)
    flip = np.where(spread(3) < 0.5, -1.0, 1.0)
    # Every state has both signs.
    flip[-1] = -flip[0]
    return t, flip * np.where(x == 0, moves, np.abs(x)) * (0.5 + spread(2))


def complex_step(function: Asked) -> Many:
    """Return the Jacobian by complex steps: exact to rounding where the code is analytic."""
    step = 1e-30

    def call(t: Array, x: Array) -> Array:
        count, n = x.shape
        points: Any = np.repeat(x.astype(complex), n, axis=0)
        points[np.arange(count * n), np.tile(np.arange(n), count)] += 1j * step
        values = function(np.repeat(t, n), points)
        derivative = np.imag(values).reshape(count, n, -1) / step
        return np.ascontiguousarray(np.swapaxes(derivative, 1, 2))

    return call


def by_jax(asked: Asked) -> Many:
    """Return the Jacobian by forward differentiation of JAX."""
    try:
        jax: Any = importlib.import_module("jax")
    except ImportError:
        raise InputError('jacobian = "jax" needs JAX: pip install jax') from None
    if asked.at_once and not asked.found_out:
        raise InputError('jacobian = "jax" takes functions of one state: set vectorized=False')
    jax.config.update("jax_enable_x64", True)
    forward = jax.jit(jax.vmap(jax.jacfwd(lambda t, x: jax.numpy.asarray(asked.function(t, x)), 1)))

    def call(t: Array, x: Array) -> Array:
        values: Array = np.ascontiguousarray(np.asarray(forward(t, x), dtype=float))
        return values

    return call


def derivative(
    function: Asked, jacobian: Any, at: tuple[Array, Array], scale: Array
) -> Many | None:
    """Return how the Jacobian of a function is found; None for differences in the crate.

    "auto" takes complex steps where they agree with a difference at `at`.
    """
    t, x = at
    word = jacobian if isinstance(jacobian, str) else ""
    if word == "differences":
        return None
    if word == "jax":
        return by_jax(function)
    found = complex_step(function)
    if word == "complex":
        return found
    if not isinstance(jacobian, str) or jacobian != "auto":
        raise InputError(
            f'jacobian = {options.given(jacobian)}: must be "auto", "complex", "differences", '
            '"jax" or two functions'
        )
    direction = scale * np.linspace(0.6, 1.0, x.shape[1])
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            exact = found(t, x)[0] @ direction
    except (TypeError, ValueError, InputError, ArithmeticError, np.exceptions.ComplexWarning):
        return None
    step = 1e-4
    rough = (function(t, x + step * direction) - function(t, x - step * direction))[0] / (2 * step)
    size = np.abs(rough).max(initial=0.0) + np.abs(exact).max(initial=0.0)
    agrees = np.isfinite(exact).all() and np.abs(exact - rough).max(initial=0.0) <= 1e-4 * size
    return found if agrees else None


class System:
    """f and h with their derivatives, asked as they can be.

    Parameters
    ----------
    f, h : callable
    n : int
        States.
    vectorized : bool, optional
        None: to be found out.
    singly : set of str
        The functions that are asked about one state at a time, whatever is found out.
    """

    def __init__(
        self, f: Function, h: Function, n: int, vectorized: bool | None, singly: set[str]
    ) -> None:
        self._declared, self._singly = vectorized, singly
        self.rate = Asked(f, "f", (n,), self._many("f"))
        self.output = Asked(h, "h", (None,), self._many("h"))
        self.by_rate: Many | None = None
        self.by_output: Many | None = None

    def _many(self, name: str) -> bool | None:
        return False if name in self._singly else self._declared

    def look(self, times: Array, x: Array, moves: Array, jacobians: Sequence[Any]) -> None:
        """Ask f and h at the first time, find out how they may be asked and differentiated."""
        here = times[:1], x[None]
        self.output.shape = self.output(*here).shape[1:]
        self.rate(*here)
        for function in (self.rate, self.output):
            function.try_many(times, x, moves)
        self.by_rate, self.by_output = (
            self._given(jacobian, function, times, x, moves)
            if callable(jacobian)
            else derivative(function, jacobian, here, moves)
            for function, jacobian in zip((self.rate, self.output), jacobians, strict=True)
        )

    def _given(
        self, jacobian: Function, function: Asked, times: Array, x: Array, moves: Array
    ) -> Asked:
        name = f"the Jacobian of {function.name}"
        given = Asked(jacobian, name, (*function.shape, len(x)), self._many(name))
        given.try_many(times, x, moves)
        return given

    @property
    def outputs(self) -> int:
        """How many outputs there are."""
        return self.output.shape[0] or 0

    @property
    def takes_many(self) -> bool:
        """Whether f and its derivative take many states in little more time than one."""
        return all(part.at_once for part in (self.rate, self.by_rate) if isinstance(part, Asked))

    @property
    def vectorized(self) -> tuple[str, ...]:
        """The names of the functions that are asked about many states in one call."""
        parts = (self.rate, self.output, self.by_rate, self.by_output)
        return tuple(part.name for part in parts if isinstance(part, Asked) and part.at_once)

    def moves(self, t: float, x: Array, names: tuple[str, ...], most: Array) -> Array:
        """Return over which moves (n,) what is differenced bends at x: 500 of the best steps.

        Or `most`.

        Raises
        ------
        InputError
            Where one jumps or has no derivative there.
        """
        moves = most
        for function, by in ((self.rate, self.by_rate), (self.output, self.by_output)):
            if by is None:
                step = _steps(function, function.name, t, x, names)
                moves = np.fmin(moves, np.where(step > 0, 500 * step, np.inf))
        return moves


def _steps(function: Many, name: str, t: float, x: Array, names: tuple[str, ...]) -> Array:
    """Return the longest good step of each state."""

    def values(points: Array) -> Array:
        return function(np.full(len(points), t), points)

    here = values(x[None])[0]
    unknown = np.full(len(x), np.nan)
    try:
        with np.errstate(all="ignore"):
            found = _core.differences(
                values,
                x,
                here,
                unknown,
                1 / np.where(here == 0, 1.0, np.abs(here)),
                np.zeros(here.size),
                np.full(here.size, np.nan),
                unknown,
                None,
                names,
            )
    except InputError as error:
        told = str(error).replace("h(x)", name).split(": for an angle")[0]
        wraps = " jumps " in told or " kink " in told
        hint = ": give sine and cosine of an angle that wraps, or a jacobian" if wraps else ""
        raise InputError(f"at t = {t:g} {told}{hint}") from None
    return found.step()
