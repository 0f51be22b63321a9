"""A measurement function with the names, units and noise of what it relates."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian._arrays import SEED_MOST, as_float_array, finite, whole
from gramian._compiled import CompiledFunction
from gramian._noise import Noise, as_noise
from gramian._registry import load
from gramian._units import bare
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.model._exact import Ties, moved_by, normals_of
from gramian.model._jacobian import Around, complex_step, confirmed
from gramian.model._outputs import as_outputs, stacked
from gramian.model._sparsity import SPARSE_STATES, as_columns, by_nan, sparse_rows
from gramian.problem import Accuracy, Array, Problem, ProblemSource, is_sparse

if TYPE_CHECKING:
    from gramian.large import SparseProblem

__all__ = ["Model"]


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
        ties = Ties(self, measured)
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
            raw = as_outputs(self._h(state.copy()))
        memory = self._options["memory"]
        is_complex = np.iscomplexobj(raw) or bool(memory.get("complex"))
        flat = stacked(raw, is_complex=is_complex)
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
                return np.stack([stacked(line, is_complex=is_complex) for line in values])
            out = np.full((len(points), count), np.nan)
            for line, point in zip(out, points, strict=True):
                try:
                    flat = stacked(as_outputs(self._h(point.copy())), is_complex=is_complex)
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
        around = self._around(state, at)
        if method == "central":
            found = _core.differences(
                around.batch,
                state,
                at,
                self._reach(state),
                around.weight,
                around.periods,
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
        h: Any = self._h
        derivative: Callable[[Array], Array]
        if method == "complex":
            one = (lambda x: h(x[None])[0]) if options["vectorized"] else h
            derivative = functools.partial(complex_step, one)
        elif method == "given":

            def derivative(x: Array) -> Array:
                raw = np.asarray(given(x.copy()))
                if np.iscomplexobj(raw) or self._kept_shape["complex"]:
                    raw = np.concatenate([raw.real, raw.imag])
                finite(raw, "jacobian(x)")
                return raw if raw.dtype.kind == "f" else raw.astype(float)

        else:
            derivative = functools.partial(h.jacobian_of, vectorized=options["vectorized"])
        values, error, calls = confirmed(derivative, around, by_complex_step=method == "complex")
        return values, error, {"evaluations": calls, "step": None, "noise": None, "groups": self.n}

    def _around(self, state: Array, at: Array) -> Around:
        sigma = np.broadcast_to(self.noise.sigma, at.shape)
        size = np.where(at == 0, 1.0, np.abs(at))
        # One without noise counts by its size.
        known = (sigma > 0) & np.isfinite(sigma)
        return Around(
            batch=self._batch,
            state=state,
            at=at,
            scale=self.scale,
            weight=1 / np.where(known, sigma, size),
            periods=np.zeros(at.size) if self.periods is None else self.periods,
        )

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
        if not isinstance(sparsity, str):
            pattern = sparsity
        elif sparsity == "find":
            pattern = by_nan(self._batch, state, count)
        else:
            raise InputError(f'sparsity = {sparsity!r}: must be "find" or a pattern (m, n)')
        listed = as_columns(pattern, count, self.n)
        self._kept["pattern"] = (key, listed)
        return listed

    def _sparse_problem(
        self, state: Array, values: Array, error: Array | None
    ) -> SparseProblem | None:
        """Return the problem with sparse rows, or None where it has no use or place."""
        options, noise = self._options, self.noise
        if self.n < SPARSE_STATES:
            return None
        pattern = self._pattern(len(values), state)
        if pattern is None or noise.root.ndim > 1 or len(noise.exact):
            return None
        if options["tangent"] is not None or options["row_sigma"] is not None:
            return None
        found = sparse_rows(values, error, pattern, noise.root, self.names, options["rtol"])
        if found is None:
            return None
        return load("large").SparseProblem(  # type: ignore[no-any-return]
            found[0],
            self.names,
            units=self.units,
            scale=self.scale,
            rtol=found[1],
            combinations=options["combinations"],
        )

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
        exact = noise.exact[moved_by(noise.exact, values, error)] @ values
        if len(exact):
            problem = problem.constrain(exact)
        if options["tangent"] is not None:
            problem = problem.constrain(normals_of(options["tangent"], state, self.names))
        return problem
