"""Cantilevers in space against planar closed forms, collocation, and work."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from lissome.errors import InvalidInput, NotConverged
from lissome.references import elastica, lateral_buckling
from lissome.references.cantilever_in_space import spatial_cantilever


@pytest.mark.parametrize("load", [0.5, 5.0, 12.0])
def test_planar_loads(load):
    """In either principal plane the rod is the planar elastica, whatever its other stiffnesses."""
    planar = elastica.transverse_cantilever(load)
    for axis, stiffness in ((0, [3.0, 1.0, 2.0]), (1, [1.0, 3.0, 0.1])):
        force = np.zeros(3)
        force[axis] = load
        rod = spatial_cantilever(force, stiffness=stiffness)
        expected = np.zeros(3)
        expected[[axis, 2]] = planar.y, planar.x
        assert np.allclose(rod.tip, expected, atol=1e-9)
        assert rod.energy == pytest.approx(planar.energy, rel=1e-9)
        assert np.linalg.norm(rod.clamp_moment) == pytest.approx(planar.clamp_moment, rel=1e-9)


def test_isotropic_rod_bends_in_the_plane_of_the_force():
    planar = elastica.transverse_cantilever(4.0)
    rod = spatial_cantilever([4.0 * np.cos(0.7), 4.0 * np.sin(0.7), 0.0])
    expected = [planar.y * np.cos(0.7), planar.y * np.sin(0.7), planar.x]
    assert np.allclose(rod.tip, expected, atol=1e-9)
    assert abs(rod.clamp_moment[2]) < 1e-9


def test_oblique_force_by_collocation():
    """Anisotropic, naturally curved and twisted; quaternions and collocation instead."""
    stiffness, natural = np.array([1.0, 2.5, 0.7]), np.array([0.4, 1.1, -0.8])
    force = np.array([1.5, -2.0, 0.8])
    rod = spatial_cantilever(force, stiffness=stiffness, natural=natural)

    def right(s, y):
        q, m = y[3:7], y[7:]
        k = natural[:, None] + m / stiffness[:, None]
        r = Rotation.from_quat((q / np.linalg.norm(q, axis=0)).T).as_matrix()
        push = np.cross(np.einsum("pij,i->pj", r, force), [0, 0, 1.0]).T
        v, w = q[:3], q[3]
        slope = 0.5 * np.vstack([w * k + np.cross(v, k, axis=0), -np.sum(v * k, axis=0)])
        return np.vstack([r[:, :, 2].T, slope, np.cross(m, k, axis=0) + push])

    def ends(a, b):
        return np.concatenate([a[:3], a[3:7] - [0, 0, 0, 1.0], b[7:]])

    s = np.linspace(0, 1, 31)
    guess = np.zeros((10, s.size))
    guess[2], guess[6] = s, 1.0
    found = solve_bvp(right, ends, s, guess, tol=1e-8, max_nodes=20000)
    assert found.success
    assert np.allclose(found.y[:3, -1], rod.tip, atol=1e-7)
    assert np.allclose(found.y[7:, 0], rod.clamp_moment, atol=1e-6)
    frame = Rotation.from_quat(found.y[3:7, -1]).as_matrix()
    assert np.allclose(frame, rod.tip_frame, atol=1e-6)
    assert np.allclose(rod.points(found.x[::5]), found.y[:3, ::5].T, atol=1e-7)


def test_moment_at_the_clamp_is_that_of_the_force():
    force = np.array([2.0, 1.0, -0.5])
    rod = spatial_cantilever(force, stiffness=[1.0, 4.0, 0.5], natural=[0.0, 0.5, 0.3])
    assert np.allclose(rod.clamp_moment, np.cross(rod.tip, force), atol=1e-9)


def test_work_of_the_force_is_the_energy():
    """d(energy) = F . d(tip), and the compliance matrix is symmetric."""
    options = {"stiffness": [1.0, 4.0, 0.5], "natural": [0.2, 0.5, 0.3]}
    force, step = np.array([1.0, 0.6, -0.4]), 1e-3
    rows, work = [], []
    for j in range(3):
        up, down = (
            spatial_cantilever(force + sign * step * np.eye(3)[j], **options) for sign in (1, -1)
        )
        rows.append((up.tip - down.tip) / (2 * step))
        work.append((up.energy - down.energy) / (2 * step))
    compliance = np.array(rows)
    assert np.allclose(compliance, compliance.T, atol=1e-6)
    assert np.allclose(work, compliance @ force, atol=1e-6)


def test_lateral_buckling_from_the_response_to_a_side_load():
    """The compliance across diverges at Prandtl's load.

    The stiff plane is taken ever stiffer, since the closed form neglects bending in it.
    """
    exact = lateral_buckling.end_load(1.0, 0.6)
    found = []
    for stiff in (500.0, 2000.0):
        loads = exact * np.array([0.97, 0.99])
        softness = [
            spatial_cantilever([1e-5, load, 0.0], stiffness=[stiff, 1.0, 0.6]).tip[0] / 1e-5
            for load in loads
        ]
        # 1/compliance is linear in the square of the load near the critical one, to first order
        a, b = 1 / np.array(softness)
        x = loads**2
        found.append(np.sqrt(x[1] + b * (x[1] - x[0]) / (a - b)))
    assert found[1] == pytest.approx(exact, rel=3e-3)
    assert abs(found[1] - exact) < abs(found[0] - exact)


def test_the_branch_ends_at_the_lateral_buckling_load():
    load = 1.02 * lateral_buckling.end_load(1.0, 0.6)
    with pytest.raises(NotConverged, match=r"beyond 0\.9"):
        spatial_cantilever([0.0, load, 0.0], stiffness=[2000.0, 1.0, 0.6])
    with pytest.raises(NotConverged, match=r"beyond 0\.9"):
        spatial_cantilever([0.0, 0.0, -2.6], stiffness=[1.0, 2.0, 1.0])  # Euler: pi^2/4


def test_bad_input():
    with pytest.raises(InvalidInput, match="stiffness"):
        spatial_cantilever([1.0, 0, 0], stiffness=[1.0, -1.0, 1.0])
    with pytest.raises(InvalidInput, match="force"):
        spatial_cantilever([1.0, 0])
    rod = spatial_cantilever([0.1, 0, 0])
    with pytest.raises(InvalidInput, match="position"):
        rod.points([0.5, 0.2])
