"""A model of the user's own: a measurement function, what is known of it, and its rows."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import SEED_MOST, as_float_array, finite, number, whole
from gramian._compiled import CompiledFunction, is_compiled
from gramian._foreign import FOREIGN
from gramian._noise import Noise, as_noise, negligible
from gramian._registry import load
from gramian._units import bare
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.problem import Accuracy, Array, Problem, ProblemSource, checked_names, is_sparse

if TYPE_CHECKING:
    from gramian.large import SparseProblem

__all__ = ["Model", "from_function"]

#: From so many states on, and up to such a share of entries, rows are sparse.
SPARSE_STATES = 100
SPARSE_SHARE = 0.1

Method = Literal["central", "complex", "given", "jax", "torch", "casadi"]


@dataclass(frozen=True, eq=False, repr=False)
class Model(ProblemSource, Value):
    """A measurement function with the names, units and noise of what it relates.

    Made by `from_function`. Every function that takes a problem takes a model, at its `x`.

    Attributes
    ----------
    names, units : tuple of str, length n
        The states.
    x : ndarray, shape (n,), or None
        Where the questions are asked by default.
    scale : ndarray, shape (n,)
        The deviation of each state that would be useless; NaN where it has none.
    periods : ndarray, shape (m,), or None
        Period of each measurement, 0 for one that is no angle.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    x: Array | None
    scale: Array
    _h: Callable[[Array], ArrayLike] = field(repr=False)
    _sigma: ArrayLike = field(repr=False)
    _options: Mapping[str, Any] = field(repr=False)
    _kept: dict[Any, Any] = field(default_factory=dict, repr=False)

    _not_stored = frozenset({"_kept"})

    def __repr__(self) -> str:
        at = "" if self.x is None else f" at x = {self.x}"
        return f"Model of the states {', '.join(self.names)}{at}"

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        super().__setstate__(state)
        self.__dict__["_kept"] = {}

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def combinations(self) -> Mapping[str, Array]:
        """Named combinations (n,) of the states."""
        combinations: Mapping[str, Array] = self._options["combinations"]
        return combinations

    def at(self, x: ArrayLike) -> Model:
        """Return the same model, asked at another state (n,)."""
        state = self._state(x)
        values = self.__dict__ | {"x": state, "_kept": {}}
        return Model(**values)

    def h(self, x: ArrayLike | None = None) -> Array:
        """Return the exact measurements (m,) at a state; of complex ones both parts, stacked."""
        return self._value(self._state(x)).copy()

    def problem(self, x: ArrayLike | None = None) -> Problem:
        """Return the rows at one state with all that belongs to them.

        Of a hundred states or more, with a `sparsity` (given or found) of at most a tenth of
        all entries, it is a `gramian.large.SparseProblem`, unless noise correlates the
        measurements, some are exact, or `tangent` or `row_sigma` is given.

        Parameters
        ----------
        x : array_like, shape (n,), optional
            The model's own by default.

        Raises
        ------
        InputError
            Where h has no value or no derivative, or jumps.
        """
        state = self._state(x)
        key = state.tobytes()
        if self._kept.get("key") != key:
            self._kept.update({"key": key, "problem": self._problem(state)})
        kept: Problem = self._kept["problem"]
        return kept

    def rows(self, x: ArrayLike | None = None) -> Array:
        """Return the whitened rows (K, n) at one state, as a plain array."""
        rows: Any = self.problem(x).rows
        dense: Array = rows.toarray() if is_sparse(rows) else rows
        return dense

    def jacobian(self, x: ArrayLike | None = None) -> Array:
        """Return the derivatives (m, n) of h at one state, without noise."""
        return self._derivatives(self._state(x))[0].copy()

    def measured(self, z: ArrayLike) -> Array:
        """Return measurements (m,) as real numbers, both parts of complex ones stacked.

        NaN marks a missing one.
        """
        try:
            given = np.asarray(bare(z, "measurements"))
        except ValueError as error:
            # Rows of different lengths.
            raise InputError(f"measurements cannot be read: {error}") from None
        if self._options["memory"].get("complex") or np.iscomplexobj(given):
            if np.iscomplexobj(given):
                given = np.concatenate([given.real.ravel(), given.imag.ravel()])
            self._prepare(given.size, is_complex=True)
        measured = as_float_array(given, "measurements").ravel()
        self._prepare(measured.size, is_complex=False)
        if measured.shape != self._options["memory"]["shape"]:
            raise InputError(
                f"measurements has {measured.size} entries: must have "
                f"{self._options['memory']['shape'][0]}, one for each of h(x)"
            )
        if (bad := np.flatnonzero(np.isinf(measured))).size:
            raise InputError(
                f"measurements[{bad[0]}] = {measured[bad[0]]}: must be finite, or NaN where missing"
            )
        return measured

    def residuals(self, x: ArrayLike, z: ArrayLike) -> Array:
        """Return the whitened residuals (K,) of measurements z (m,) at a state.

        Angles are unwrapped to the nearest turn; missing measurements (NaN, or of
        infinite sigma) are left out.
        """
        measured = self.measured(z)
        kept = ~np.isnan(measured)
        off = self.difference(measured, self._value(self._state(x)))
        return self.noise.keep(kept).whiten(off[kept])

    def handle(self, z: ArrayLike) -> _core.Model:
        """Return the model with its measurements (m,) as the extension's estimators take it.

        Exact measurements and the surface of `tangent` are kept to a millionth of what the
        others tell of them.
        """
        measured = self.measured(z)
        if np.isnan(measured).all():
            raise InputError("measurements: all are NaN (missing): at least one must be there")
        ties = _Ties(self, measured)
        return _core.Model.from_functions(
            self.n,
            ties.noise.whiten(np.zeros(int(ties.kept.sum()))).size + ties.count,
            ties.linearize,
            ties.difference,
            None,
            ties.count,
            ties.lengths,
            ties.twofold(),
        )

    def difference(self, to: Array, start: Array) -> Array:
        """Return the difference of measurements (..., m), angles to the nearest turn."""
        off: Array = to - start
        if self.periods is not None:
            turn = np.where(self.periods > 0, self.periods, 1.0)
            off = np.where(self.periods > 0, off - turn * np.round(off / turn), off)
        return off

    def simulate(
        self,
        x: ArrayLike | None = None,
        seed: int = 0,
        trials: int | None = None,
        first: int = 0,
    ) -> Array:
        """Return measurements (m,), or (trials, m), with noise.

        Parameters
        ----------
        x : array_like, shape (n,), optional
            The truth; the model's own by default.
        seed : int
        trials : int, optional
        first : int
            The number of the first trial: trial i depends on (seed, i) alone.
        """
        exact, noise = self.h(x), self.noise
        count = 1 if trials is None else whole(trials, "trials", 1)
        start = whole(first, "first")
        normals = _core.normals(whole(seed, "seed", 0, SEED_MOST), start, count, noise.draws)
        drawn = noise.sample(normals)
        drawn += exact
        return drawn if trials is not None else drawn[0]

    @property
    def compiled(self) -> CompiledFunction | None:
        """The function where estimates of it need no interpreter; else None.

        It is compiled, and so is its Jacobian if one is given; the noise is independent, no
        measurement exact, and the states lie on no surface.
        """
        h, noise = self._h, self.noise
        if not isinstance(h, CompiledFunction) or self._options["tangent"] is not None:
            return None
        if self._options["method"] == "given" and not h.has_jacobian:
            return None
        return h if noise.root.ndim == 1 and not len(noise.exact) else None

    @property
    def noise(self) -> Noise:
        """The noise of the measurements, as what whitens them."""
        if "noise" not in self._kept_shape:
            raise InputError("x was not given, and h was not yet evaluated anywhere")
        kept: Noise = self._kept_shape["noise"]
        return kept

    @property
    def periods(self) -> Array | None:
        """Period of each measurement, 0 for one that is no angle."""
        periods: Array | None = self._kept_shape.get("periods")
        return periods

    @property
    def accuracy(self) -> Accuracy:
        """How accurate the rows at `x` are, and how they were found."""
        accuracy = self.problem().accuracy
        if accuracy is None:
            raise InputError("the rows of this model have no stated accuracy")
        return accuracy

    @property
    def _kept_shape(self) -> dict[str, Any]:
        if "shape" not in self._options["memory"] and self.x is not None:
            self._value(self.x)
        memory: dict[str, Any] = self._options["memory"]
        return memory

    def _state(self, x: ArrayLike | None) -> Array:
        if x is None:
            if self.x is None:
                raise InputError("x is missing: the model was made without one")
            return self.x
        state = finite(x, "x").copy()
        if state.shape != (self.n,):
            raise InputError(
                f"x has shape {state.shape}: must be ({self.n},), one for each of the states "
                f"{', '.join(self.names)}"
            )
        return state

    def _value(self, state: Array) -> Array:
        """Return h(x), checked; what depends on its shape is read the first time."""
        key = state.tobytes()
        last = self._kept.get("value")
        if last is not None and last[0] == key:
            known: Array = last[1]
            return known
        if self._options["vectorized"]:
            raw = np.asarray(self._h(state[None].copy()))
            if raw.shape[:1] != (1,):
                raise InputError(
                    f"h has the shape {raw.shape} at points (1, {self.n}): "
                    "a vectorized h must return one row for each point"
                )
            raw = raw[0]
        else:
            raw = _array(self._h(state.copy()))
        memory = self._options["memory"]
        is_complex = np.iscomplexobj(raw) or bool(memory.get("complex"))
        flat = _stacked(raw, is_complex=is_complex)
        if flat.size == 0:
            raise InputError("h(x) is empty: must return at least one measurement")
        self._prepare(flat.size, is_complex=is_complex)
        if flat.shape != memory["shape"]:
            raise InputError(
                f"h(x) has {flat.size} measurements at x = {state}, "
                f"and {memory['shape'][0]} elsewhere: must be as many at each state"
            )
        value = finite(flat, "h(x)").copy()
        self._kept["value"] = (key, value)
        return value

    def _prepare(self, count: int, *, is_complex: bool) -> None:
        """Read, the first time, what depends on the number of measurements."""
        memory = self._options["memory"]
        if "shape" not in memory:
            memory["noise"] = as_noise(self._sigma, count, is_complex=is_complex)
            memory["periods"] = self._read_periods(count)
            memory["complex"] = is_complex
            memory["shape"] = (count,)

    def _read_periods(self, count: int) -> Array | None:
        angles, periods = self._options["angles"], self._options["periods"]
        if periods is not None:
            given = as_float_array(periods, "periods")
            if given.shape not in {(), (count,)}:
                raise InputError(f"periods has shape {given.shape}: must be one, or ({count},)")
            each = np.array(np.broadcast_to(given, (count,)))
            if (bad := np.flatnonzero(~(each >= 0))).size:
                raise InputError(f"periods[{bad[0]}] = {each[bad[0]]}: must be >= 0")
            return each
        if angles is None or angles is False:
            return None
        each = np.zeros(count)
        if angles is True:
            each[:] = 2 * np.pi
            return each
        for entry in angles:
            index = whole(entry, "angles", -count, count - 1)
            each[index] = 2 * np.pi
        return each

    def _batch(self, points: Array) -> Array:
        """Return h at points (count, n), NaN where it has no value."""
        count = self._kept_shape["shape"][0]
        is_complex = self._kept_shape["complex"]
        with np.errstate(all="ignore"):
            if self._options["vectorized"]:
                values = np.asarray(self._h(points))
                if values.shape[:1] != points.shape[:1]:
                    raise InputError(
                        f"h has the shape {values.shape} at points {points.shape}: "
                        "a vectorized h must return one row for each point"
                    )
                return np.stack([_stacked(line, is_complex=is_complex) for line in values])
            out = np.full((len(points), count), np.nan)
            for line, point in zip(out, points, strict=True):
                try:
                    flat = _stacked(_array(self._h(point.copy())), is_complex=is_complex)
                except (ArithmeticError, ValueError, RuntimeError) as error:
                    if isinstance(error, InputError):
                        raise
                    continue
                if flat.shape != (count,):
                    raise InputError(
                        f"h(x) has {flat.size} measurements at x = {point}, and {count} "
                        "elsewhere: must be as many at each state"
                    )
                line[:] = flat
        return out

    def _derivatives(self, state: Array) -> tuple[Array, Array | None, dict[str, Any]]:
        """Return derivatives (m, n), their error and how they were found; asked once a state."""
        key = state.tobytes()
        if self._kept.get("derivatives", (None,))[0] != key:
            self._kept["derivatives"] = (key, self._found_derivatives(state))
        found: tuple[Array, Array | None, dict[str, Any]] = self._kept["derivatives"][1]
        return found

    def _found_derivatives(self, state: Array) -> tuple[Array, Array | None, dict[str, Any]]:
        at = self._value(state)
        options = self._options
        method, given = options["method"], options["jacobian"]
        if method == "central":
            weight = self._weights(at)
            found = _core.differences(
                self._batch,
                state,
                at,
                self._reach(state),
                weight,
                np.zeros(at.size) if self.periods is None else self.periods,
                self._spread(options["noise"], at.size, "noise"),
                self._spread(options["step"], self.n, "step"),
                self._pattern(at.size, state),
                self.names,
            )
            if self.x is not None and np.array_equal(state, self.x):
                self._kept["step"] = found.step()
            how = {
                "noise": found.noise(),
                "step": found.step(),
                "evaluations": found.evaluations + 1,
                "groups": found.groups,
            }
            return found.values(), found.error(), how
        if method == "complex":
            h: Any = self._h
            one = (lambda x: h(x[None])[0]) if options["vectorized"] else h
            return self._measured(state, functools.partial(_complex_step, one), at)
        if method == "given":

            def derivative(x: Array) -> Array:
                raw = np.asarray(given(x.copy()))
                if np.iscomplexobj(raw) or self._kept_shape["complex"]:
                    raw = np.concatenate([raw.real, raw.imag])
                finite(raw, "jacobian(x)")
                return raw if raw.dtype.kind == "f" else raw.astype(float)

            return self._measured(state, derivative, at)
        foreign: Any = self._h
        automatic = functools.partial(foreign.jacobian_of, vectorized=options["vectorized"])
        return self._measured(state, automatic, at)

    def _reach(self, state: Array) -> Array:
        """Return where the search for steps starts: the scale, or what was right at `x`.

        The size of a state that happens to be near zero says nothing.
        """
        if self.x is None or not np.isnan(self.scale).any():
            return self.scale
        at_home = np.array_equal(state, self.x)
        if not at_home and "step" not in self._kept:
            try:
                self._derivatives(self.x)
            except InputError:
                self._kept["step"] = np.full(self.n, np.nan)
        if at_home:
            return self.scale
        # The first step is a 64th of it.
        reach: Array = np.where(np.isnan(self.scale), 64 * self._kept["step"], self.scale)
        return reach

    def _measured(
        self, state: Array, derivative: Callable[[Array], Array], at: Array
    ) -> tuple[Array, Array | None, dict[str, Any]]:
        """Return derivatives, their error by rounding, after a check against differences."""
        raw = derivative(state)
        # Of a Jacobian in single precision fewer digits are right.
        precision = np.finfo(raw.dtype if raw.dtype.kind == "f" else float).eps
        values = finite(raw, "the Jacobian")
        if values.shape != (at.size, self.n):
            hint = ": is it transposed?" if values.shape == (self.n, at.size) else ""
            raise InputError(
                f"the Jacobian has shape {values.shape}: must be ({at.size}, {self.n}){hint}"
            )
        # What rounding inside leaves: second differences over a few units in the last place;
        # also of single precision, where all that was returned may be such numbers.
        largest = np.abs(values).max(axis=0, initial=0.0)
        single = float(np.finfo(np.float32).eps)
        error = precision * np.maximum(np.abs(values), largest if precision >= single else 0.0)
        size = np.where(state == 0, np.where(np.isnan(self.scale), 1.0, self.scale), state)
        with np.errstate(over="ignore"):
            maybe_single = precision < single and bool((values == values.astype(np.float32)).all())
        calls = 1
        for unit in (precision, single)[: 1 + maybe_single]:
            for signs in (1.0, np.where(np.arange(self.n) % 2, 1.0, -1.0)):
                step = 8 * unit * np.abs(size) * signs
                calls += 2
                try:
                    bent = derivative(state + step) - 2 * values + derivative(state - step)
                except (InputError, ArithmeticError, ValueError):
                    continue
                bent = np.abs(bent)
                if unit >= single and (bent > 1e-2 * single * largest).any():
                    error = np.maximum(error, single * largest)
                error = np.maximum(error, bent)
        # A complex step takes an evaluation a state, and one more.
        calls *= self.n + 1 if self._options["method"] == "complex" else 1
        calls += 1 + self._check(state, values, error, at)
        return values, error, {"evaluations": calls, "step": None, "noise": None, "groups": self.n}

    def _check(self, state: Array, values: Array, error: Array, at: Array) -> int:
        """Compare derivatives with differences along two directions.

        Returns how often h was evaluated.
        """
        nothing, calls = np.zeros(1), 0
        known = np.where(np.isnan(self.scale), np.where(state == 0, 1.0, np.abs(state)), self.scale)
        for turn in (0, 1):
            direction = known * np.cos(1.0 + 2.4 * np.arange(self.n) + turn)

            def line(t: Array, along: Array = direction) -> Array:
                return self._batch(state + t * along)

            with np.errstate(all="ignore"):
                try:
                    found = _core.differences(
                        line,
                        nothing,
                        at,
                        np.ones(1),
                        self._weights(at),
                        np.zeros(at.size) if self.periods is None else self.periods,
                        np.full(at.size, np.nan),
                        np.full(1, np.nan),
                        None,
                        ("the state along a line",),
                    )
                except InputError:
                    # Differences that do not exist check nothing.
                    return calls
            calls += found.evaluations
            slope, allowed = found.values()[:, 0], found.error()[:, 0]
            expected = values @ direction
            slack = 3 * allowed + 3 * (error @ np.abs(direction)) + 1e-6 * np.abs(slope).max()
            off = np.abs(expected - slope)
            if (bad := np.flatnonzero(off > slack + 1e-3 * np.abs(slope))).size:
                i = int(bad[np.argmax(off[bad] / slack[bad])])
                raise InputError(
                    f"the Jacobian does not fit h: along a line h(x)[{i}] changes by "
                    f"{slope[i]:.6g}, by the Jacobian {expected[i]:.6g}"
                    + self._guess(values, expected, slope, direction)
                )
        return calls

    def _guess(self, values: Array, expected: Array, slope: Array, direction: Array) -> str:
        if self._options["method"] == "complex":
            return (
                ": h is not analytic (abs, norm, real, a comparison or conjugate in it); "
                'use method = "central"'
            )
        if values.shape[0] == values.shape[1] and np.allclose(
            values.T @ direction, slope, rtol=1e-3
        ):
            return ": it is transposed"
        if np.allclose(-expected, slope, rtol=1e-3):
            return ": its sign is wrong"
        with np.errstate(all="ignore"):
            ratio = slope / expected
        if np.isfinite(ratio).all() and np.allclose(ratio, ratio[0], rtol=1e-3):
            return f": it is off by the factor {ratio[0]:.6g}, a unit perhaps"
        return ""

    def _weights(self, at: Array) -> Array:
        """One over the deviation of each measurement; of one without noise by its size."""
        sigma = np.broadcast_to(self.noise.sigma, at.shape)
        size = np.where(at == 0, 1.0, np.abs(at))
        known = (sigma > 0) & np.isfinite(sigma)
        weight: Array = 1 / np.where(known, sigma, size)
        return weight

    def _spread(self, value: Any, count: int, name: str) -> Array:
        if value is None:
            return np.full(count, np.nan)
        given = as_float_array(value, name)
        if given.shape not in {(), (count,)}:
            raise InputError(f"{name} has shape {given.shape}: must be one number, or ({count},)")
        each = np.array(np.broadcast_to(given, (count,)))
        if (bad := np.flatnonzero(each < 0)).size or np.isinf(each).any():
            place = f"[{bad[0]}]" if given.ndim and bad.size else ""
            raise InputError(f"{name}{place} = {value}: must be >= 0 and finite")
        return each

    def _pattern(self, count: int, state: Array) -> list[list[int]] | None:
        """Return for each state the measurements it may move; None where that is not known."""
        sparsity = self._options["sparsity"]
        if sparsity is None:
            return None
        # One that is found may be another at another state.
        key = state.tobytes() if isinstance(sparsity, str) else b""
        if self._kept.get("pattern", (None,))[0] == key:
            known: list[list[int]] = self._kept["pattern"][1]
            return known
        pattern: Any
        if isinstance(sparsity, str):
            if sparsity != "find":
                raise InputError(f'sparsity = {sparsity!r}: must be "find" or a pattern (m, n)')
            pattern = self._found_pattern(count, state)
        else:
            pattern = sparsity if is_sparse(sparsity) else np.asarray(sparsity)
        if pattern.shape != (count, self.n):
            raise InputError(f"sparsity has shape {pattern.shape}: must be ({count}, {self.n})")
        if is_sparse(pattern):
            columns = pattern.tocsc(copy=True)
            columns.eliminate_zeros()
            columns.sum_duplicates()
            listed = [part.tolist() for part in np.split(columns.indices, columns.indptr[1:-1])]
        else:
            listed = [np.flatnonzero(column).tolist() for column in pattern.T]
        self._kept["pattern"] = (key, listed)
        return listed

    def _sparse_problem(
        self, state: Array, values: Array, error: Array | None
    ) -> SparseProblem | None:
        """Return the problem with sparse rows, or None where it has no use or place."""
        options, noise = self._options, self.noise
        if self.n < SPARSE_STATES or options["sparsity"] is None:
            return None
        pattern = self._pattern(len(values), state)
        if pattern is None or noise.root.ndim > 1 or len(noise.exact):
            return None
        if options["tangent"] is not None or options["row_sigma"] is not None:
            return None
        entries = sum(map(len, pattern))
        if entries > SPARSE_SHARE * values.size:
            return None
        from scipy.sparse import csr_array

        j = np.repeat(np.arange(self.n), [len(column) for column in pattern])
        i = np.concatenate([np.asarray(column, dtype=int) for column in pattern])
        if (missed := np.count_nonzero(values)) > np.count_nonzero(values[i, j]):
            outside = values != 0
            outside[i, j] = False
            row, column = np.argwhere(outside)[0]
            raise InputError(
                f"sparsity leaves out {missed - np.count_nonzero(values[i, j])} entries of the "
                f"Jacobian: h(x)[{row}] depends on {self.names[column]}"
            )
        kept = np.flatnonzero(noise.root > 0)
        whitened = csr_array((values[i, j] * noise.root[i], (i, j)), shape=values.shape)[kept]
        rtol = options["rtol"]
        if error is not None and rtol is None:
            # As `Problem.doubt`: ranks are decided above the errors of the columns.
            lengths = np.sqrt(np.asarray(whitened.multiply(whitened).sum(axis=0)).ravel())
            errors = csr_array((error[i, j] * noise.root[i], (i, j)), shape=values.shape)
            off = np.sqrt(np.asarray(errors.multiply(errors).sum(axis=0)).ravel())
            if ((off > 0) & ~(off < lengths / 3)).any():
                return None
            relative = float(np.linalg.norm(off / np.where(lengths > 0, lengths, 1.0)))
            default = 32 * np.finfo(float).eps * np.sqrt(max(whitened.shape))
            rtol = min(relative, 0.5) if relative > default else None
        return load("large").SparseProblem(  # type: ignore[no-any-return]
            whitened,
            self.names,
            units=self.units,
            scale=self.scale,
            rtol=rtol,
            combinations=options["combinations"],
        )

    def _found_pattern(self, count: int, state: Array) -> NDArray[np.bool_]:
        """Return which outputs each state may move: those that NaN in its place reaches."""
        generator = np.random.default_rng(0)
        possible = np.ones((count, self.n), dtype=bool)
        share, settled = 0.5, 0
        # Groups of states at once: an output that stays finite depends on none of them.
        for _ in range(12 * int(np.ceil(np.log2(self.n + 1))) + 40):
            group = generator.random(self.n) < share
            points = np.where(group, np.nan, state)[None, :]
            untouched = np.isfinite(self._batch(points)[0])
            before = possible.sum()
            possible[np.ix_(untouched, group)] = False
            # Most is learned where about a third of the outputs stay finite.
            share = min(0.5, share * (1.5 if untouched.mean() > 0.37 else 0.7))
            settled = settled + 1 if possible.sum() == before else 0
            if settled >= 20:
                break
        return possible

    def _problem(self, state: Array) -> Problem:
        values, error, how = self._derivatives(state)
        options, noise = self._options, self.noise
        sparse = self._sparse_problem(state, values, error)
        problem = (
            sparse
            if sparse is not None
            else Problem(
                noise.whiten(values),
                self.names,
                units=self.units,
                scale=self.scale,
                rtol=options["rtol"],
                combinations=options["combinations"],
                row_error=None if error is None else noise.errors(error),
                row_sigma=options["row_sigma"],
            )
        )
        accuracy = Accuracy(
            method=options["method"],
            error=error,
            noise=how["noise"],
            step=how["step"],
            evaluations=how["evaluations"],
            groups=how["groups"],
        )
        problem = problem._replaced(accuracy=accuracy)
        if sparse is not None:
            return problem
        exact = noise.exact[_moved(noise.exact, values, error)] @ values
        if len(exact):
            problem = problem.constrain(exact)
        if options["tangent"] is not None:
            problem = problem.constrain(self._normals(state))
        return problem

    def _normals(self, state: Array) -> Array:
        """Return the directions (q, n) in which the state cannot move."""
        tangent = self._options["tangent"]
        if callable(tangent):
            tangent = tangent(state.copy())
        if _is_groups(tangent):
            # The states of each group keep the length of their vector.
            normals = np.zeros((len(tangent), self.n))
            for line, group in zip(normals, tangent, strict=True):
                for name in group:
                    if name not in self.names:
                        raise InputError(f"tangent names {name!r}: no state has that name")
                    i = self.names.index(name)
                    line[i] = state[i]
            return normals
        basis = finite(tangent, "tangent")
        if basis.ndim != 2 or basis.shape[0] != self.n or basis.shape[1] >= self.n:
            raise InputError(
                f"tangent has shape {basis.shape}: must be ({self.n}, d) with d < {self.n}"
            )
        left, values, _ = np.linalg.svd(basis)
        rank = int((values > 1e-12 * values[0]).sum()) if values.size else 0
        return left[:, rank:].T


def from_function(
    h: Callable[[Array], ArrayLike],
    x: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    *,
    method: Method = "central",
    jacobian: Callable[[Array], ArrayLike] | None = None,
    units: Sequence[str] | None = None,
    scale: ArrayLike | None = None,
    combinations: Mapping[str, ArrayLike] | None = None,
    angles: Sequence[int] | bool | None = None,
    periods: ArrayLike | None = None,
    step: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    rtol: float | None = None,
    row_sigma: ArrayLike | None = None,
    sparsity: ArrayLike | Literal["find"] | None = None,
    tangent: Any = None,
    vectorized: bool = False,
    measurements: int | None = None,
) -> Model:
    """Make a model of a measurement function of your own.

    Parameters
    ----------
    h : callable
        Takes the state (n,), returns the measurements (m,). Complex measurements are
        their real parts, then their imaginary parts. Or a compiled function, which takes the
        state and writes the measurements (NaN where there is no value), and is called without
        the interpreter, from several threads at once: ``numba.cfunc("void(CPointer(float64),
        CPointer(float64))")``, ``scipy.LowLevelCallable`` or a ``ctypes`` function.
    x : array_like, shape (n,), optional
        The state at which questions are asked by default.
    sigma : array_like, shape (), (m,), (m, m) or (b, k, k)
        Standard deviation of all measurements or of each (0: exact, `inf`: missing), their
        covariance, which may be singular, or its blocks along the diagonal. For complex
        measurements also a Hermitian covariance; the noise is circular then.
    names : sequence of str, length n
        The states.
    method : {"central", "complex", "given", "jax", "torch", "casadi"}
        How the Jacobian is found: central differences whose step is searched for; a
        complex step, exact to rounding, for an `h` that accepts complex numbers and is
        analytic in them; the function `jacobian`; or automatic differentiation of an `h`
        written for that package. All but differences are compared once with differences.
    jacobian : callable, optional
        Takes the state (n,), returns (m, n), or, compiled like `h`, writes it row by row. Needed
        by ``method="given"`` only.
    units, scale, combinations : optional
        As for `Problem`. The search for the step of the differences starts at the scale.
    angles : sequence of int, or True, optional
        Which measurements, or all, are angles in rad that wrap at 2 pi.
    periods : array_like, shape () or (m,), optional
        Period of each measurement where it is another, 0 for none.
    step : array_like, shape () or (n,), optional
        The longest step of the differences, instead of one that is searched for.
    noise : array_like, shape () or (m,), optional
        Standard deviation of the noise of `h` itself (a solver's tolerance, printed
        digits), instead of one that is measured.
    rtol : float, optional
        Relative accuracy of the rows, instead of the one found.
    row_sigma : array_like, shape () or (n,), optional
        As for `Problem`.
    sparsity : array_like, shape (m, n), or "find", optional
        Which measurement depends on which state (not zero: it does). States that share no
        measurement are moved together, which takes few evaluations for local models; of a
        hundred states or more the rows are sparse then (see `Model.problem`). Also a
        ``scipy.sparse`` matrix. "find" looks where NaN in place of a state reaches.
    tangent : array_like, shape (n, d), callable or list of tuples of str, optional
        Directions in which the state can move, where it lies on a surface; a function of
        the state that returns them; or groups of states whose vector keeps its length:
        ``[("qw", "qx", "qy", "qz")]``.
    vectorized : bool
        Whether `h` takes many states (count, n) at once and returns (count, m). Unlike in
        `dynamics.from_ode` this is not found out: the comparison would evaluate points
        twice, and numpy's last bits depend on how many states are in a call, so that
        results would depend on how a batch is divided.
    measurements : int, optional
        How many numbers a compiled `h` writes; of no other.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        Shapes that do not fit, noise that is none, a result that is not finite; an `h`
        that jumps or has a kink at `x`; a Jacobian that does not fit it.

    Notes
    -----
    Each derivative comes with its error, from the differences of a ladder of steps and
    the measured noise of `h` (Ridders 1982; More & Wild 2011). `analyze` decides ranks
    above it, and calls "undecided" what it cannot tell; `model.accuracy` says what was
    found. It takes about 6 evaluations a state for a smooth `h` of many states, more where
    the noise must be measured, and never more than 18, the value at x included; no point is
    evaluated twice. Outputs of seven decimals or fewer at every point count as rounded to
    them.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> ranges = lambda p: [np.hypot(p[0], p[1]), np.hypot(p[0] - 100, p[1])]
    >>> model = gm.from_function(ranges, [30.0, 40.0], 1.0, ["east", "north"])
    >>> gm.analyze(model).rank
    2
    >>> bool(model.accuracy.error.max() < 1e-10)
    True
    >>> model.rows([100.0, 1e-3]).shape
    (2, 2)
    """
    if not callable(h) and not is_compiled(h):
        raise InputError(f"h is a {type(h).__name__}: must be a function of the state")
    if names is None or sigma is None:
        missing = "names" if names is None else "sigma"
        raise InputError(f"{missing} is missing: from_function(h, x, sigma, names)")
    known = checked_names(names)
    options.choice(method, "method", ("central", "complex", "given", "jax", "torch", "casadi"))
    if (method == "given") != (jacobian is not None):
        raise InputError(
            f'method = "{method}" with jacobian {"given" if jacobian is not None else "missing"}: '
            'a jacobian goes with method = "given" and with no other'
        )
    if rtol is not None and not 0 < number(rtol, "rtol") < 1:
        raise InputError(f"rtol = {rtol}: must be between 0 and 1")
    # Checks names, units, scale and combinations.
    empty = Problem(
        np.zeros((0, len(known))), known, units=units, scale=scale, combinations=combinations
    )
    state = None
    if x is not None:
        state = finite(x, "x").copy()
        if state.shape != (len(known),):
            raise InputError(
                f"x has shape {state.shape}: must be ({len(known)},), one for each name"
            )
    if method in FOREIGN:
        h = FOREIGN[method](h)
    if is_compiled(h):
        h = _compiled(h, jacobian, len(known), measurements, method, vectorized)
        jacobian = h.jacobian if h.has_jacobian else jacobian
        vectorized = True
    elif measurements is not None or is_compiled(jacobian):
        what = "measurements" if measurements is not None else "a compiled jacobian"
        raise InputError(f"{what} goes with a compiled h only: h is a {type(h).__name__}")
    model = Model(
        names=known,
        units=empty.units,
        x=state,
        scale=empty.scale,
        _h=h,
        _sigma=sigma,
        _options={
            "method": method,
            "jacobian": jacobian,
            "combinations": dict(empty.combinations),
            "angles": angles,
            "periods": periods,
            "step": step,
            "noise": noise,
            "rtol": rtol,
            "row_sigma": row_sigma,
            "sparsity": sparsity,
            "tangent": tangent,
            "vectorized": vectorized,
            "memory": {},
        },
    )
    if state is not None:
        model.problem()
    return model


def _compiled(
    h: Any, jacobian: Any, states: int, measurements: Any, method: str, vectorized: bool
) -> CompiledFunction:
    """Return a compiled function as the models take it, checked."""
    if method not in ("central", "given"):
        raise InputError(
            f'method = "{method}" with a compiled h: must be "central" or "given", as only its '
            "values are known"
        )
    if vectorized:
        raise InputError("vectorized = True with a compiled h: it takes one state a call")
    if measurements is None:
        raise InputError("measurements is missing: how many numbers the compiled h writes")
    count = whole(measurements, "measurements", 1)
    given = jacobian if jacobian is not None and is_compiled(jacobian) else None
    return CompiledFunction(h, given, states, count)


def _moved(combinations: Array, values: Array, error: Array | None) -> NDArray[np.bool_]:
    """Return which exact combinations (q, m) of measurements any state moves.

    Of redundant measurements some are moved by none, and say nothing.
    """
    allowed = 1e-12 * (np.abs(combinations) @ np.abs(values))
    if error is not None:
        allowed = allowed + np.abs(combinations) @ error
    above = np.abs(combinations @ values) > 3 * allowed
    moved: NDArray[np.bool_] = np.any(above, axis=1)
    return moved


class _Ties:
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
        moved = _moved(self.exact, values, error)
        self._check_redundant(self.exact[~moved])
        self.exact = self.exact[moved]
        normals = np.zeros((0, model.n))
        if tangent is not None:
            if callable(tangent):
                raise InputError(
                    "tangent is a function: an estimate needs the surface itself; "
                    "name the groups of states whose vector keeps its length"
                )
            normals = model._normals(at)
            if _is_groups(tangent):
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


def _is_groups(tangent: Any) -> bool:
    """Say whether a tangent is given as groups of states whose vector keeps its length."""
    return isinstance(tangent, (list, tuple)) and any(
        isinstance(part, (list, tuple)) and part and isinstance(part[0], str) for part in tangent
    )


def _array(values: Any) -> NDArray[Any]:
    """Return what h returned as an array of any type."""
    if np.ma.is_masked(values):
        place = int(np.flatnonzero(np.ma.getmaskarray(values))[0])
        raise InputError(f"h(x)[{place}] is masked: must be a number")
    try:
        return np.asarray(values)
    except ValueError as error:
        # Parts of different lengths.
        raise InputError(f"h(x) cannot be read as an array of numbers: {error}") from None


def _stacked(values: NDArray[Any], *, is_complex: bool) -> Array:
    """Return measurements as one vector of real numbers."""
    if is_complex:
        return np.concatenate([values.real.ravel(), values.imag.ravel()]).astype(float)
    return as_float_array(values, "h(x)").ravel()


def _complex_step(h: Callable[[Array], ArrayLike], x: Array) -> Array:
    """Return the Jacobian by steps along the imaginary axis (Squire & Trapp 1998)."""
    if np.iscomplexobj(np.asarray(h(x.copy()))):
        raise InputError('h(x) is complex: a complex step needs a real h; use method = "central"')
    columns = []
    for i in range(x.size):
        step = 1e-100 * max(1.0, abs(x[i]))
        moved: Any = x.astype(complex)
        moved[i] += 1j * step
        try:
            values = np.asarray(h(moved))
        except TypeError as error:
            raise InputError(f"h does not accept complex numbers: {error}") from error
        if not np.iscomplexobj(values):
            raise InputError(
                'h returns real numbers for a complex state: use method = "central", '
                "or an h without abs, real or conversions to float"
            )
        columns.append(values.ravel().imag / step)
    return finite(np.stack(columns, axis=1), "the complex-step Jacobian of h")
