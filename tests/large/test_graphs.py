"""Pose graphs in g2o files, against the reference answers of the recorded ones."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import gramian as gm
from gramian.io.g2o import read_graph


def reference(recorded, name):
    data = np.load(recorded(f"graphs/{name}.npz"))
    rows = csr_array((data["data"], data["indices"], data["indptr"]), shape=data["shape"])
    return rows, data["std_first_pose_fixed"], data["smallest_singular_values"]


@pytest.mark.recorded
@pytest.mark.parametrize("name", ["smallGrid3D", "sphere2500"])
def test_a_recorded_graph_floats_and_its_bounds_are_the_reference_ones(recorded, name):
    rows, std, values = reference(recorded, name)
    problem = read_graph(recorded(f"graphs/{name}.g2o")).problem
    difference = abs((problem.rows.T @ problem.rows) - (rows.T @ rows)).max()
    # In some edges of smallGrid3D the logarithm is near a half turn.
    assert difference < 1e-9 * abs(rows.T @ rows).max()

    answer = gm.analyze(problem)
    assert answer.nullity == 6
    assert answer.gap > 1e10
    assert {m.gauge for m in answer.missing} == {
        f"{what} {axis}" for what in ("translation along", "rotation about") for axis in "xyz"
    }
    assert all(len(m.blocks) == problem.n // 6 for m in answer.missing)
    scaled = problem.rows @ answer.null_space
    length = np.linalg.norm(problem.rows.data) * np.sqrt((answer.null_space**2).sum(axis=0))
    assert (np.sqrt((scaled**2).sum(axis=0)) < 1e-12 * length).all()
    assert answer.singular_values[-7] == pytest.approx(values[6], rel=1e-6)
    assert np.isinf(answer.crlb_std).all()

    fixed = gm.analyze(problem.fix("x0"))
    assert fixed.status == "observable"
    np.testing.assert_allclose(fixed.crlb_std, std[6:], rtol=1e-8)


@pytest.mark.recorded
def test_what_is_known_does_not_depend_on_where_the_gauge_is_fixed(recorded):
    graph = read_graph(recorded("graphs/smallGrid3D.g2o"))
    free = gm.analyze(graph.problem)
    # The relative pose of two poses, in the first one's axes: rows of an edge.
    rows = graph.rows_of(np.array([[3, 77]]), np.eye(6)[None]).toarray()
    bound = free.std_of_all(list(rows))
    assert np.isfinite(bound).all()
    assert free.rank_gain(rows) == 0
    for pose in ("x0", "x50"):
        problem = graph.problem.fix(pose)
        keep = [graph.problem.index(name) for name in problem.names]
        fixed = gm.analyze(problem)
        np.testing.assert_allclose(fixed.std_of_all(list(rows[:, keep])), bound, rtol=1e-9)
    assert free.rank_gain(np.eye(graph.problem.n)[:4]) == 4


PLANE = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0.2 0.3  # a comment
VERTEX_SE2 2 2 0.5 -0.4
VERTEX_SE2 3 3 0.5 -0.4
EDGE_SE2 0 1 1.5 0.1 0.9 1 0.1 0.05 2 0.1 3
EDGE_SE2 1 2 1.1 -0.3 -0.2 1 0 0 1 0 1
EDGE_SE2 0 2 1.1 -0.3 -0.2 1 0 0 1 0 1
EDGE_SE2 2 3 1.1 -0.3 -0.2 1 0 0 1 0 1
"""

SPACE = """\
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 7 1.0 0.2 -0.3 0.3171845 -0.2366641 0.1427899 0.9071908
VERTEX_SE3:QUAT 9 1.8 -0.1 -0.2 0.3990360 -0.1862907 -0.8967650 0.0433426
EDGE_SE3:QUAT 0 7 1 0 0 0.1 0 0 1 4 0.1 0 0 0 0 4 0 0 0 0 4 0 0 0 9 1 0 9 0 9
EDGE_SE3:QUAT 7 9 0.5 -0.5 -0.3 0.1 -0.5 -0.8 0.1 4 0 0 0 0 0 4 0 0 0 0 4 0 0 0 9 0 0 9 0 9
"""


@pytest.fixture
def plane(tmp_path):
    path = tmp_path / "plane.g2o"
    path.write_text(PLANE)
    return path


def moved(graph, step):
    """Errors of the edges with every pose moved by its part of `step`, by exponentials."""
    from scipy.linalg import expm, logm

    def matrix(r, t):
        m = np.eye(graph.dimensions + 1)
        m[:-1, :-1], m[:-1, -1] = r, t
        return m

    def hat(xi):
        m = np.zeros((graph.dimensions + 1,) * 2)
        if graph.dimensions == 2:
            m[0, 1], m[1, 0], m[:2, 2] = -xi[2], xi[2], xi[:2]
        else:
            x, y, z = xi[:3]
            m[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
            m[:3, 3] = xi[3:]
        return m

    def vee(m):
        if graph.dimensions == 2:
            return np.array([m[0, 2], m[1, 2], m[1, 0]])
        return np.array([m[2, 1], m[0, 2], m[1, 0], *m[:3, 3]])

    p = len(graph.states)
    poses = [
        matrix(r, t) @ expm(hat(xi))
        for r, t, xi in zip(graph.rotations, graph.positions, step.reshape(-1, p), strict=True)
    ]
    return np.concatenate(
        [
            vee(np.real(logm(np.linalg.inv(matrix(z, s)) @ np.linalg.inv(poses[a]) @ poses[b])))
            for (a, b), z, s in zip(graph.edges, *graph.moves, strict=True)
        ]
    )


@pytest.mark.parametrize("text", [PLANE, SPACE], ids=["SE2", "SE3"])
def test_rows_are_the_derivatives_of_the_edges_logarithms(tmp_path, text):
    path = tmp_path / "graph.g2o"
    path.write_text(text)
    graph = read_graph(path)
    n = graph.problem.n
    np.testing.assert_allclose(graph.errors.ravel(), moved(graph, np.zeros(n)), atol=1e-12)
    h = 1e-5
    jacobian = np.array([(moved(graph, h * e) - moved(graph, -h * e)) / (2 * h) for e in np.eye(n)])
    p = len(graph.states)
    rows = graph.problem.rows.toarray().reshape(-1, p, n)
    for k, own in enumerate(jacobian.T.reshape(-1, p, n)):
        np.testing.assert_allclose(
            rows[k].T @ rows[k], own.T @ graph.information[k] @ own, atol=1e-7
        )


def test_a_graph_in_the_plane_has_three_gauges_and_one_bridge(plane):
    graph = read_graph(plane)
    answer = gm.analyze(graph.problem)
    assert [m.gauge for m in answer.missing] == [
        "translation along x",
        "translation along y",
        "rotation about z",
    ]
    assert graph.weak_places.bridges == (("x2", "x3", 1),)
    assert graph.weak_places.cut_poses == ("x2",)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("EDGE_SE2 2 3", "EDGE_SE2 2 9"), "line 8: vertex 9 is not in the file"),
        (("EDGE_SE2 2 3 1.1 -0.3 -0.2 1 0 0 1 0 1", "EDGE_SE2 2 3 1.1 -0.3"), "line 8: EDGE_SE2 has 4 values: must have 11"),
        (("-0.2 1 0 0 1 0 1\n", "-0.2 1 0 x 1 0 1\n"), "line 6: 'x' is not a number"),
        (("VERTEX_SE2 3 3", "VERTEX_SE2 3 nan"), "line 4: nan: must be finite"),
        (("VERTEX_SE2 3", "VERTEX_SE2 2"), "line 4: vertex 2 was given in line 3 already"),
        (("VERTEX_SE2 3", "VERTEX_XY 3"), "line 4: VERTEX_XY is not read"),
        (("EDGE_SE2 2 3", "EDGE_SE2 2 2"), "line 8: an edge from vertex 2 to itself"),
        (("VERTEX_SE2 3", "VERTEX_SE2 3.5"), "line 4: '3.5': must be the number of a vertex"),
        (("EDGE_SE2 2 3 1.1 -0.3 -0.2 1", "EDGE_SE2 2 3 1.1 -0.3 -0.2 -1"), "line 8: the information matrix is not positive definite"),
        ((PLANE, "VERTEX_SE2 0 0 0 0\n"), "has no edge"),
        ((PLANE, SPACE.replace("0 0 0 1\n", "0 0 0 0\n", 1)), "line 1: the quaternion of VERTEX_SE3:QUAT is zero"),
        ((PLANE, SPACE.replace("0 0 0 1\n", "0 0 1e200 1\n", 1)), r"line 1: the quaternion of VERTEX_SE3:QUAT is of length 1e\+200"),
        ((PLANE, PLANE + SPACE), "line 9: VERTEX_SE3:QUAT in a graph of the other dimension"),
        ((PLANE, "FIX 4\n" + PLANE), "line 1: vertex 4 is not in the file"),
    ],
)  # fmt: skip
def test_a_broken_file_is_named_with_its_line(plane, change, said):
    plane.write_text(PLANE.replace(*change))
    with pytest.raises(gm.InputError, match=said) as raised:
        read_graph(plane)
    assert str(plane) in str(raised.value)


def test_the_report_holds_one_pose_of_each_part_and_draws_the_graph(tmp_path):
    from gramian.io.graph_report import report

    path = tmp_path / "parts.g2o"
    path.write_text(PLANE.replace("EDGE_SE2 2 3", "EDGE_SE2 4 3") + "VERTEX_SE2 4 5 5 0\n")
    made = report(path)
    facts = dict(made.facts)
    assert facts["graph"] == "5 poses, 4 edges, 2 parts"
    assert facts["bridges"] == "1 edge without which the graph falls apart"
    assert made.data["nullity"] == 6
    assert "with x0, x3 fixed" in made.tables[0].title
    assert [made.data["position_std"][k] for k in (0, 3)] == [0, 0]
    assert made.data["closures"][0][2] > 0
    figure = made.pictures[0].draw()
    assert len(figure.axes) == 4  # two panels and their bars
    # A part that lacks more than its gauge has no such bounds.
    path.write_text(
        "FIX 0\n" + PLANE.replace("VERTEX_SE2 3 3", "VERTEX_SE2 4 0 0 0\nVERTEX_SE2 3 3")
    )
    assert dict(report(path).facts)["graph"] == "5 poses, 4 edges, 2 parts"
