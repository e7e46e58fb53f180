"""Tables of rods, and files for ParaView."""

import meshio
import numpy as np
import pytest

import lissome as ls
from lissome.errors import InvalidInput
from lissome.rods import _tables, shapes
from lissome.rods.laws import Kirchhoff
from lissome.rods.quaternions import to_directors

NODES = np.stack([np.zeros(60), np.zeros(60), np.arange(60.0)], axis=1)


def test_values_of_hinges_at_nodes():
    values = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 8.0]])
    out = _tables.node_values(values, [1, 2, 2], [1.0, 1.0, 3.0], 4)
    assert np.isnan(out[[0, 3]]).all()
    np.testing.assert_allclose(out[1:3], [[1, 2], [4.5, 7.0]])
    with pytest.raises(InvalidInput, match="numbered 0 to 2"):
        _tables.node_values(values, [1, 2, 3], [1.0, 1.0, 1.0], 3)


def test_tables():
    x = np.arange(12.0).reshape(4, 3)
    table = _tables.node_table(np.arange(4.0), x, strains=-x)
    assert list(table.columns) == ["s", "x", "y", "z", "curvature_1", "curvature_2", "twist"]
    np.testing.assert_array_equal(table[["x", "y", "z"]], x)
    np.testing.assert_array_equal(table["twist"], -x[:, 2])
    hinges = _tables.hinge_table([1, 2], [0.1, 0.2], moments=x[:2])
    assert list(hinges.columns) == ["node", "s", "moment_1", "moment_2", "moment_3"]
    assert hinges["node"].dtype.kind == "i"
    directors = np.arange(27.0).reshape(3, 3, 3)
    segments = _tables.segment_table([1, 2, 3], directors, forces=x[:3], stretches=[1, 1, 1])
    np.testing.assert_array_equal(segments[["d2x", "d2y", "d2z"]], directors[:, 1])
    assert segments.shape == (3, 14)
    with pytest.raises(InvalidInput, match="`strains` has shape"):
        _tables.node_table(np.arange(4.0), x, strains=x[:3])


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize("closed", [False, True])
def test_vtk_is_read_back(tmp_path, suffix, closed):
    rod = (
        shapes.ring(5.0, 12, Kirchhoff(1.0, 1.0))
        if closed
        else shapes.straight(5.0, 12, Kirchhoff(1.0, 1.0))
    )
    x, d = rod.positions(rod.initial), to_directors(rod.initial.quaternions)
    strains = np.full((13, 3), np.nan)
    strains[1:-1] = rod.natural[1:-1]
    force = np.arange(36.0).reshape(12, 3)
    file = _tables.write_vtk(
        tmp_path / f"rod{suffix}",
        x,
        d,
        closed=closed,
        point_data={"strain": strains, "s": rod.arclength},
        cell_data={"force": force},
    )
    mesh = meshio.read(file)
    kept = 12 if closed else 13
    np.testing.assert_allclose(mesh.points, x[:kept], atol=1e-14)
    lines = mesh.cells_dict["line"]
    assert lines.shape == (12, 2)
    np.testing.assert_allclose(
        mesh.points[lines[:, 1]] - mesh.points[lines[:, 0]], np.diff(x, axis=0), atol=1e-14
    )
    np.testing.assert_allclose(mesh.point_data["strain"], strains[:kept])
    np.testing.assert_allclose(mesh.point_data["s"], rod.arclength[:kept])
    np.testing.assert_allclose(mesh.cell_data["d1"][0], d[:, 0], atol=1e-15)
    np.testing.assert_allclose(mesh.cell_data["force"][0], force)


def test_equilibrium_gives_tables_and_a_file(tmp_path):
    rod = shapes.straight(1.0, 12, Kirchhoff((1.0, 2.0), 1.0)).clamped("start")
    eq = ls.equilibrate(rod.loaded(end=[1.0, 0.5, -1.0]))
    nodes, hinges, segments = (eq.to_frame(of) for of in ("nodes", "hinges", "segments"))
    np.testing.assert_array_equal(nodes[["x", "y", "z"]], eq.positions)
    assert len(hinges) == 12 and len(segments) == 12  # a half hinge at the clamp, none at the tip
    inner = nodes.dropna()
    np.testing.assert_allclose(inner["curvature_1"], hinges["curvature_1"])
    np.testing.assert_allclose(hinges["moment_2"], 2 * hinges["curvature_2"])
    np.testing.assert_allclose(segments[["force_x", "force_y", "force_z"]], [[1.0, 0.5, -1.0]] * 12)
    mesh = meshio.read(eq.to_vtk(tmp_path / "rod.vtu"))
    np.testing.assert_allclose(mesh.cell_data["d3"][0], eq.directors[:, 2])
    np.testing.assert_allclose(mesh.point_data["moment"][:-1], eq.moments)
    assert np.isnan(mesh.point_data["moment"][-1]).all()
    with pytest.raises(InvalidInput, match="did you mean 'nodes'"):
        eq.to_frame("node")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda p: _tables.write_vtk(p / "rod.stl", NODES, np.tile(np.eye(3), (59, 1, 1))),
            "`path` is '.stl'",
        ),
        (
            lambda p: _tables.write_vtk(p / "rod.vtu", NODES, np.tile(np.eye(3), (60, 1, 1))),
            "`directors` has shape",
        ),
        (
            lambda p: _tables.write_vtk(
                p / "rod.vtu", NODES, np.tile(np.eye(3), (59, 1, 1)), point_data={"a": [1.0]}
            ),
            r"`point_data`\['a'\] has shape \(1,\); it must have 60 rows",
        ),
    ],
)
def test_bad_input_leaves_no_file(tmp_path, call, message):
    with pytest.raises(InvalidInput, match=message):
        call(tmp_path)
    assert not list(tmp_path.iterdir())
