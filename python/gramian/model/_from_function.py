"""Making a model of a measurement function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gramian import _options as options
from gramian._arrays import finite, number, whole
from gramian._compiled import CompiledFunction, is_compiled
from gramian._foreign import FOREIGN
from gramian.exceptions import InputError
from gramian.model._model import Model
from gramian.problem import Array, Problem, checked_names

__all__ = ["from_function"]

Method = Literal["central", "complex", "given", "jax", "torch", "casadi"]


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
