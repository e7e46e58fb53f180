"""Meshes of plates: areas, symmetry, files and slits."""

import re

import meshio
import numpy as np
import pytest
import skfem

import lissome as ls
from lissome.errors import DataError, InvalidInput
from lissome.plates import Plate, meshes


@pytest.mark.parametrize("center", [(0.0, 0.0), (0.3, -0.2)])
@pytest.mark.parametrize("grading", [1.0, 2.0])
def test_rectangle_has_its_area_and_its_point(center, grading):
    mesh = meshes.rectangle(1.2, 0.8, 4, center=center, grading=grading)
    plate = Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3)
    assert plate.space.area == pytest.approx(0.96, rel=1e-12)
    assert np.min(np.hypot(*(mesh.p - np.array(center)[:, None]))) < 1e-15
    assert sum(len(part) for part in mesh.boundaries.values()) == len(mesh.boundary_facets())


def test_square_mesh_has_the_symmetry_of_the_square():
    points = {tuple(p) for p in np.round(meshes.rectangle(divisions=3).p.T, 12) + 0.0}
    for a, b, c, d in ((0, -1, 1, 0), (-1, 0, 0, 1), (0, 1, 1, 0)):
        turned = {(a * x + b * y + 0.0, c * x + d * y + 0.0) for x, y in points}
        assert turned == points


@pytest.mark.parametrize("center", [(0.0, 0.0), (0.2, 0.1)])
def test_disc_area_is_of_fourth_order(center):
    errors = [
        abs(
            Plate(
                mesh=meshes.disc(0.5, n, center=center), bending=1.0, poisson_ratio=0.3
            ).space.area
            / (np.pi / 4)
            - 1
        )
        for n in (2, 4)
    ]
    assert np.log2(errors[0] / errors[1]) > 3.7


@pytest.mark.parametrize("kind", ["straight", "curved"])
def test_files_give_the_mesh_back(tmp_path, kind):
    path = tmp_path / "plate.vtu"
    if kind == "straight":
        mesh = meshes.rectangle(1.0, 0.7, 2)
        cells = [("triangle", mesh.t.T)]
    else:
        mesh = meshes.disc(0.5, 2)
        nodes = mesh.dofs.element_dofs.T  # corners, then the edges 0-1, 1-2, 0-2
        cells = [("triangle6", nodes)]
    points = np.column_stack([mesh.doflocs.T, np.zeros(mesh.doflocs.shape[1])])
    meshio.Mesh(points, cells).write(path)
    plates = [Plate(mesh=m, bending=1e-3, poisson_ratio=0.3, edges="clamped", pressure=1e-3)
              for m in (mesh, meshes.from_file(path))]  # fmt: skip
    energies = [ls.equilibrate(plate).energy for plate in plates]
    assert energies[1] == pytest.approx(energies[0], rel=1e-10)


@pytest.mark.parametrize("curved", [False, True])
def test_named_lines_of_a_file_become_boundaries(tmp_path, curved):
    """Physical curves of Gmsh: supports find them by name."""
    mesh = meshes.disc(0.5, 2) if curved else meshes.rectangle(1.0, 0.7, 2)
    rim = mesh.boundary_facets()
    least = 0.3 if curved else 0.49
    right = rim[mesh.p[0, mesh.facets[:, rim]].mean(axis=0) > least]
    points = np.column_stack([mesh.doflocs.T, np.zeros(mesh.doflocs.shape[1])])
    cells = [("line", mesh.facets[:, rim].T),
             ("triangle6", mesh.dofs.element_dofs.T) if curved else ("triangle", mesh.t.T)]  # fmt: skip
    tags = [np.where(np.isin(rim, right), 1, 2), np.full(mesh.t.shape[1], 3)]
    path = tmp_path / "plate.msh"
    meshio.Mesh(
        points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"clamp": np.array([1, 1]), "others": np.array([2, 1]), "plate": np.array([3, 2])},
    ).write(path, file_format="gmsh22")  # fmt: skip
    read = meshes.from_file(path)
    assert sorted(read.boundaries) == ["clamp", "others"]
    plates = [
        Plate(mesh=m, bending=1e-3, poisson_ratio=0.3, edges={part: "clamped"}, pressure=1e-6)
        for m, part in ((mesh, lambda x, y: x > least), (read, "clamp"))
    ]
    expected = set(map(tuple, np.round(mesh.p[:, mesh.facets[:, right]].mean(axis=1).T, 12)))
    names = read.p[:, read.facets[:, read.boundaries["clamp"]]].mean(axis=1).T
    assert set(map(tuple, np.round(names, 12))) == expected
    energies = [ls.equilibrate(plate).energy for plate in plates]
    assert energies[1] == pytest.approx(energies[0], rel=1e-10)


def test_bad_files_are_refused(tmp_path):
    path = tmp_path / "plate.vtu"
    path.write_text("no mesh")
    with pytest.raises(DataError):
        meshes.from_file(path)
    bent = meshes.rectangle(divisions=1)
    points = np.column_stack([bent.p.T, bent.p[0] ** 2])
    meshio.Mesh(points, [("triangle", bent.t.T)]).write(path)
    with pytest.raises(DataError, match="plane"):
        meshes.from_file(path)
    meshio.Mesh(points, [("line", bent.facets.T)]).write(path)
    with pytest.raises(DataError, match="triangles"):
        meshes.from_file(path)
    with pytest.raises(FileNotFoundError):
        meshes.from_file(tmp_path / "none.vtu")


@pytest.mark.parametrize("ending", ["msh", "vtk", "dat", "inp", "obj", "vtu", "nonsense"])
def test_a_file_that_is_no_mesh_is_refused_in_words(tmp_path, capfd, ending):
    path = tmp_path / f"mesh.{ending}"
    path.write_text("nothing that anyone could read")
    with pytest.raises(DataError, match="mesh") as caught:
        meshes.from_file(path)
    assert not re.search(r"[:(] ?\d*\)?$", str(caught.value)), "the reason is missing"
    assert capfd.readouterr() == ("", "")


def test_a_slit_opens_the_mesh_and_relaxes_a_defect():
    whole = meshes.rectangle(divisions=4, grading=1.0)
    cut = meshes.with_slit(whole, (0.0, 0.0), (0.5, 0.0))
    assert cut.nvertices - whole.nvertices == 4  # all but the tip
    assert len(cut.boundary_facets()) == len(whole.boundary_facets()) + 8
    inside = meshes.with_slit(whole, (0.125, 0.0), (0.375, 0.0))
    assert inside.nvertices - whole.nvertices == 1

    assert sorted(cut.boundaries) == ["bottom", "left", "right", "slit", "top"]
    for name, old in whole.boundaries.items():
        before, after = (
            {tuple(x) for x in np.round(m.p[:, m.facets[:, f]].mean(axis=1).T, 12)}
            for m, f in ((whole, old), (cut, cut.boundaries[name]))
        )
        assert before == after
    faces = cut.p[:, cut.facets[:, cut.boundaries["slit"]]].mean(axis=1)
    assert faces.shape[1] == 8 and np.all(faces[1] == 0) and np.all(faces[0] > 0)
    assert set(cut.boundaries["slit"]) <= set(cut.boundary_facets())

    def strain(x, y):
        out = np.array([[x * x, x * y], [x * y, y * y]]) / (x * x + y * y)
        return 1e-5 * out

    energies = [
        ls.equilibrate(Plate(mesh=m, bending=1e-2, poisson_ratio=0.3, strain=strain)).energy
        for m in (whole, cut)
    ]
    assert 0 < energies[1] < 0.9 * energies[0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: meshes.rectangle(center=(0.5, 0.0)), "center"),
        (lambda: meshes.rectangle(width=-1.0), "width"),
        (lambda: meshes.rectangle(divisions=0), "divisions"),
        (lambda: meshes.rectangle(grading=0.0), "grading"),
        (lambda: meshes.disc(center=(1.0, 0.1)), "center"),
        (lambda: meshes.disc(sectors=3), "sectors"),
        (lambda: meshes.with_slit(meshes.rectangle(), (0, 0), (0.31, 0.17)), "along edges"),
        (lambda: meshes.with_slit(meshes.rectangle(), (0, 0), (0, 0)), "same point"),
        (lambda: meshes.with_slit(skfem.MeshQuad(), (0, 0), (1, 0)), "MeshQuad"),
    ],
)
def test_bad_arguments_are_refused(call, words):
    with pytest.raises(InvalidInput, match=words):
        call()
