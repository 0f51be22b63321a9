"""Problems from the objects of other packages: GTSAM, SciPy, pyceres, pandapower.

Each function takes an object of the package and returns a `gramian.large.SparseProblem`
with the names that the package has. The packages are imported where they are used.

- `from_gtsam`: a `GaussianFactorGraph`, or a `NonlinearFactorGraph` with its `Values`.
- `from_least_squares`: the result of `scipy.optimize.least_squares`.
- `from_pyceres`: a `pyceres.Problem` with the names of its parameter blocks.
- `from_pandapower`: a network and its measurements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import finite
from gramian.exceptions import InputError
from gramian.large import SparseProblem

__all__ = ["from_gtsam", "from_least_squares", "from_pandapower", "from_pyceres"]

Array = NDArray[np.float64]

#: The states of the poses that GTSAM has, by their number, in its order.
_POSE = {3: ("x", "y", "theta"), 6: ("rx", "ry", "rz", "x", "y", "z")}


def from_gtsam(graph: Any, values: Any = None) -> SparseProblem:
    """Return the problem of a GTSAM factor graph.

    Parameters
    ----------
    graph : gtsam.GaussianFactorGraph or gtsam.NonlinearFactorGraph
        A nonlinear graph is linearised at `values`.
    values : gtsam.Values, optional

    Returns
    -------
    SparseProblem
        States are "x12.theta" (key and component) for blocks of 3 or 6 that are poses
        (known with `values` alone), "l3.0" for others; rows are whitened by the noise
        models.
    """
    import gtsam

    if isinstance(graph, gtsam.NonlinearFactorGraph):
        if values is None:
            raise InputError("values is missing: a nonlinear graph is linearised at them")
        linear = graph.linearize(values)
    else:
        linear = graph
    widths: dict[int, int] = {}
    parts = []
    for index in range(linear.size()):
        factor = linear.at(index)
        if factor is None:
            continue
        jacobian, _ = factor.jacobian()
        keys = list(map(int, factor.keys()))
        # The widths of one factor follow from those known, but for one key.
        sizes = [_width(factor, key, values, widths) for key in keys]
        if sum(sizes) != jacobian.shape[1]:
            raise InputError(
                f"factor {index} has {jacobian.shape[1]} columns for the keys "
                f"{', '.join(_key(key) for key in keys)}: give values, which know their widths"
            )
        widths |= dict(zip(keys, sizes, strict=True))
        parts.append((keys, np.asarray(jacobian, dtype=float)))
    keys = sorted(widths)
    start = dict(zip(keys, np.cumsum([0, *(widths[key] for key in keys)])[:-1], strict=True))
    names, blocks = [], []
    for key in keys:
        width = widths[key]
        pose = values is not None and width in _POSE and _is_pose(values, key)
        states = _POSE[width] if pose else [str(k) for k in range(width)]
        names += [f"{_key(key)}.{state}" for state in states]
        blocks += [_key(key)] * width
    triplets = _Triplets()
    for own, jacobian in parts:
        columns = np.concatenate([start[key] + np.arange(widths[key]) for key in own])
        triplets.add(jacobian, columns)
    return SparseProblem(triplets.rows(len(names)), names, blocks=blocks)


def _width(factor: Any, key: int, values: Any, widths: Mapping[int, int]) -> int:
    if key in widths:
        return widths[key]
    keys = list(map(int, factor.keys()))
    if values is not None:
        return int(values.zeroVectors().at(key).size)
    unknown = [k for k in keys if k not in widths]
    total = int(factor.jacobian()[0].shape[1])
    rest = total - sum(widths[k] for k in keys if k in widths)
    if rest % len(unknown):
        raise InputError(f"the width of {_key(key)} does not follow from the graph: give values")
    return rest // len(unknown)


def _is_pose(values: Any, key: int) -> bool:
    for kind in ("Pose2", "Pose3"):
        try:
            getattr(values, f"at{kind}")(key)
        except (RuntimeError, ValueError):
            continue
        return True
    return False


def _key(key: int) -> str:
    """Return "x12" for a symbol, "x" and the number for a plain key."""
    letter, number = key >> 56, key & (2**56 - 1)
    return f"{chr(letter)}{number}" if letter else f"x{key}"


class _Triplets:
    def __init__(self) -> None:
        self.count = 0
        self.values: list[Array] = []
        self.i: list[Any] = []
        self.j: list[Any] = []

    def add(self, rows: Array, columns: Any) -> None:
        i, j = np.nonzero(rows)
        self.values.append(rows[i, j])
        self.i.append(i + self.count)
        self.j.append(np.asarray(columns)[j])
        self.count += len(rows)

    def rows(self, n: int) -> Any:
        from scipy.sparse import coo_array

        if not self.values:
            return coo_array((0, n)).tocsr()
        places = (np.concatenate(self.i), np.concatenate(self.j))
        return coo_array((np.concatenate(self.values), places), shape=(self.count, n)).tocsr()


def from_least_squares(
    result: Any, sigma: ArrayLike = 1.0, names: Sequence[str] | None = None
) -> SparseProblem:
    """Return the problem of a result of `scipy.optimize.least_squares`.

    Parameters
    ----------
    result : scipy.optimize.OptimizeResult
        Its `jac`, sparse or dense, at the solution (of a loss that is not linear: as the
        solver scaled it).
    sigma : array_like, shape () or (m,)
        Standard deviation of the residuals; 1 for residuals that are whitened already.
    names : sequence of str, optional
        The parameters; x0, x1, ... by default.
    """
    from scipy.sparse import csr_array, diags_array

    rows = csr_array(result.jac)
    deviation = finite(sigma, "sigma")
    if deviation.shape not in ((), (rows.shape[0],)):
        raise InputError(f"sigma has shape {deviation.shape}: must be () or ({rows.shape[0]},)")
    if not (deviation > 0).all():
        raise InputError("sigma: every standard deviation must be > 0")
    weight = np.broadcast_to(1 / deviation, rows.shape[0])
    return SparseProblem((diags_array(weight) @ rows).tocsr(), names)


def from_pyceres(
    problem: Any, blocks: Mapping[str, Any], states: Mapping[str, Sequence[str]] | None = None
) -> SparseProblem:
    """Return the problem of a `pyceres.Problem` at its present parameters.

    Parameters
    ----------
    problem : pyceres.Problem
        Its residuals are taken as whitened.
    blocks : mapping of str to ndarray
        The parameter blocks that are asked about, by name: the arrays that were given to
        ``add_residual_block``. Others are taken as known.
    states : mapping of str to sequence of str, optional
        Names of the (tangent) components of blocks; numbers by default.
    """
    import pyceres
    from scipy.sparse import csr_array

    options = pyceres.EvaluateOptions()
    options.set_parameter_blocks(list(blocks.values()))
    found = problem.evaluate_jacobian(options)
    rows = csr_array(
        (np.asarray(found.values), np.asarray(found.cols), np.asarray(found.rows)),
        shape=(found.num_rows, found.num_cols),
    )
    names, of = [], []
    for name, values in blocks.items():
        width = (
            0
            if problem.is_parameter_block_constant(values)
            else problem.parameter_block_tangent_size(values)
        )
        own = list((states or {}).get(name, [str(k) for k in range(width)]))
        names += [f"{name}.{state}" for state in own[:width]]
        of += [name] * width
    return SparseProblem(rows, names, blocks=of)


def from_pandapower(net: Any) -> SparseProblem:
    """Return the problem of state estimation in a pandapower network.

    Parameters
    ----------
    net : pandapowerNet
        With `net.measurement`; linearised at the flat start that pandapower's estimator
        begins with. Buses that the estimator fuses or leaves out do not appear.

    Returns
    -------
    SparseProblem
        States "bus3.angle" (rad) and "bus3.voltage" (per unit) of each bus, the angle of
        the reference bus too: where nothing measures angles they shift together, and
        `problem.fix("bus0.angle")` is what a reference does.
    """
    from pandapower.estimation.algorithm.matrix_base import BaseAlgebra
    from pandapower.estimation.ppc_conversion import pp2eppci
    from scipy.sparse import csr_array, diags_array

    *_, grid = pp2eppci(net, calculate_voltage_angles=True)
    count = len(grid["bus"])
    # pandapower leaves out the columns of reference angles: here they are states.
    grid.non_slack_buses = np.arange(count)
    grid.num_non_slack_bus = count
    grid.delta_v_bus_selector = np.arange(2 * count)
    state = np.concatenate([grid.delta_init, grid.v_init])
    algebra = BaseAlgebra(grid)
    rows = algebra.create_hx_jacobian(state)
    deviation = np.asarray(algebra.sigma, dtype=float).ravel()
    lookup = net._pd2ppc_lookups["bus"]
    number = {int(lookup[bus]): int(bus) for bus in reversed(net.bus.index)}
    buses = [f"bus{number[k]}" if k in number else f"node{k}" for k in range(count)]
    return SparseProblem(
        (diags_array(1 / deviation) @ csr_array(rows)).tocsr(),
        [f"{bus}.angle" for bus in buses] + [f"{bus}.voltage" for bus in buses],
        units=["rad"] * count + ["p.u."] * count,
    )
