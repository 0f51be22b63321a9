"""Problems from the objects of other packages, against their own numbers."""

from importlib.metadata import version

import numpy as np
import pytest
from packaging.version import Version
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix

import gramian as gm
from gramian.io.g2o import read_graph
from gramian.io.neighbours import (
    from_gtsam,
    from_least_squares,
    from_pandapower,
    from_pyceres,
)

GRAPH = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0.2 0.3
VERTEX_SE2 2 2 0.5 -0.4
EDGE_SE2 0 1 1.5 0.1 0.9 1 0.1 0.05 2 0.1 3
EDGE_SE2 1 2 1.1 -0.3 -0.2 1 0 0 1 0 1
EDGE_SE2 0 2 1.1 -0.3 -0.2 1 0 0 1 0 1
"""


def test_a_gtsam_graph_floats_and_has_its_marginals_with_a_prior(tmp_path):
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed")
    path = tmp_path / "graph.g2o"
    path.write_text(GRAPH)
    factors, values = gtsam.readG2o(str(path), False)
    problem = from_gtsam(factors, values)
    ours = read_graph(path).problem
    assert problem.names == ours.names
    np.testing.assert_allclose(problem.rows.toarray(), ours.rows.toarray(), atol=1e-12)
    linear = from_gtsam(factors.linearize(values))
    np.testing.assert_allclose(linear.rows.toarray(), ours.rows.toarray(), atol=1e-12)
    assert gm.analyze(problem).nullity == 3
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.2, 0.05]))
    factors.add(gtsam.PriorFactorPose2(0, values.atPose2(0), noise))
    answer = gm.analyze(from_gtsam(factors, values))
    marginals = gtsam.Marginals(factors, values)
    for key in range(3):
        np.testing.assert_allclose(
            answer.covariance([f"x{key}"]), marginals.marginalCovariance(key), rtol=1e-8, atol=1e-12
        )
    with pytest.raises(gm.InputError, match="values is missing"):
        from_gtsam(factors)


def test_a_result_of_least_squares():
    t = np.linspace(0, 1, 20)
    result = least_squares(
        lambda p: p[0] * np.exp(-p[1] * t) - 1,
        [1.0, 0.5],
        jac=lambda p: csr_matrix(
            np.column_stack([np.exp(-p[1] * t), -p[0] * t * np.exp(-p[1] * t)])
        ),
    )
    answer = gm.analyze(from_least_squares(result, 0.1, ["a", "b"]))
    covariance = 0.01 * np.linalg.inv((result.jac.T @ result.jac).toarray())
    np.testing.assert_allclose(answer.crlb_std, np.sqrt(np.diag(covariance)), rtol=1e-9)
    with pytest.raises(gm.InputError, match="sigma has shape"):
        from_least_squares(result, [1.0, 2.0])


def test_a_pyceres_problem():
    pyceres = pytest.importorskip("pyceres", reason="pyceres is not installed")
    rng = np.random.default_rng(1)
    a, b = np.array([1.0, 2.0]), np.array([0.5])

    class Sum(pyceres.CostFunction):
        """weights . a + factor * b"""

        def __init__(self, weights, factor):
            pyceres.CostFunction.__init__(self)
            self.set_num_residuals(1)
            self.set_parameter_block_sizes([2, 1])
            self.weights, self.factor = weights, factor

        def Evaluate(self, parameters, residuals, jacobians):
            residuals[0] = self.weights @ parameters[0] + self.factor * parameters[1][0]
            if jacobians is not None:
                if jacobians[0] is not None:
                    jacobians[0][:] = self.weights
                if jacobians[1] is not None:
                    jacobians[1][:] = [self.factor]
            return True

    problem = pyceres.Problem()
    rows = rng.normal(size=(6, 3))
    rows[:, 2] = rows[:, 0]
    costs = [Sum(row[:2], row[2]) for row in rows]
    for cost in costs:
        problem.add_residual_block(cost, None, [a, b])
    made = from_pyceres(problem, {"a": a, "b": b}, {"a": ("x", "y")})
    assert made.names == ("a.x", "a.y", "b.0")
    np.testing.assert_allclose(made.rows.toarray(), rows)
    assert gm.analyze(made).null_combinations == ("a.x +1, b.0 -1",)


def test_a_pandapower_network_without_a_reference_floats():
    pp = pytest.importorskip("pandapower", reason="pandapower is not installed")
    if Version(version("pandas")) >= Version("3"):
        pytest.skip("pandapower 3.5 needs pandas 2, which gramian[interop] installs beside it")
    net = pp.create_empty_network()
    buses = [pp.create_bus(net, vn_kv=110.0) for _ in range(4)]
    pp.create_ext_grid(net, buses[0])
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        pp.create_line_from_parameters(
            net, buses[a], buses[b], 10, r_ohm_per_km=0.06, x_ohm_per_km=0.3,
            c_nf_per_km=9, max_i_ka=0.5,
        )  # fmt: skip
    for line in range(4):
        for kind, value in (("p", 1.0), ("q", 0.5)):
            pp.create_measurement(net, kind, "line", value, 0.1, line, side="from")
    pp.create_measurement(net, "v", "bus", 1.0, 0.01, buses[0])
    problem = from_pandapower(net)
    answer = gm.analyze(problem)
    assert answer.null_combinations == ("all angle of 4 blocks shift alike",)
    assert gm.analyze(problem.fix("bus0.angle")).status == "observable"
