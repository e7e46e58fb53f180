"""The uniform helix: balance of forces, geometry, and work."""

import numpy as np
import pytest
from scipy.optimize import minimize

from lissome.errors import InvalidInput, NotConverged
from lissome.references import helix

CASES = [
    (3.0, 4.0, 1.0, 0.7, 2.0, 1.0),
    (1.0, -2.0, 2.0, 1.5, 1.5, -1.0),
    (0.3, 0.0, 1.0, 1.0, 0, 0),
]


@pytest.mark.parametrize(("k", "t", "b", "c", "k0", "t0"), CASES)
def test_moments_balance_along_the_helix(k, t, b, c, k0, t0):
    """M' + t x N = 0 with N along the axis, and the wrench about the axis is constant and axial."""
    rod = helix.uniform_helix(k, t, bending=b, torsion=c, natural_curvature=k0, natural_twist=t0)
    s, d = np.linspace(0, 3, 13), 1e-5

    def moment(place):
        frame = rod.frames(place)
        return b * (k - k0) * frame[..., 1] + c * (t - t0) * frame[..., 2]

    axis = np.array([0.0, 0.0, 1.0])
    slope = (moment(s + d) - moment(s - d)) / (2 * d)
    push = np.cross(rod.frames(s)[..., 2], rod.force * axis)
    assert np.allclose(slope + push, 0.0, atol=1e-8)
    wrench = moment(s) + np.cross(rod.points(s), rod.force * axis)
    assert np.allclose(wrench, rod.torque * axis, atol=1e-12)


@pytest.mark.parametrize(("k", "t", "b", "c", "k0", "t0"), CASES)
def test_geometry(k, t, b, c, k0, t0):
    rod = helix.uniform_helix(k, t)
    s, d = np.linspace(0, 2, 9), 1e-5
    tangent = (rod.points(s + d) - rod.points(s - d)) / (2 * d)
    frames = rod.frames(s)
    assert np.allclose(tangent, frames[..., 2], atol=1e-9)
    spin = frames.transpose(0, 2, 1) @ (rod.frames(s + d) - rod.frames(s - d)) / (2 * d)
    found = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    assert np.allclose(found, [0.0, k, t], atol=1e-9)
    assert np.allclose(np.linalg.det(frames), 1.0)


def test_loaded_helix_is_the_minimum_of_the_potential():
    """A general minimizer on the potential per length, from the rest shape."""
    for force, torque in ((0.4, 0.0), (0.0, -0.3), (-0.5, 0.6)):
        rod = helix.loaded_helix(
            force, torque, natural_curvature=2.0, natural_twist=0.5, bending=1.0, torsion=0.8
        )

        def potential(x, force=force, torque=torque):
            omega = np.hypot(*x)
            energy = 0.5 * (x[0] - 2.0) ** 2 + 0.4 * (x[1] - 0.5) ** 2
            return energy - force * x[1] / omega - torque * omega

        found = minimize(
            potential, [2.0, 0.5], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-16}
        )
        assert found.x == pytest.approx([rod.curvature, rod.twist], abs=1e-7)
        assert (rod.force, rod.torque) == pytest.approx((force, torque), abs=1e-13)


def test_work_of_the_wrench_is_the_energy():
    """dW = F d(rise) + T d(rotation) along a path of loads."""
    rods = [
        helix.loaded_helix(0.6 * x, 0.3 * x**2, natural_curvature=2.0, natural_twist=0.5)
        for x in np.linspace(0, 1, 201)
    ]
    force, torque, rise, rotation, energy = (
        np.array([getattr(rod, name) for rod in rods])
        for name in ("force", "torque", "rise", "rotation", "energy")
    )
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(rise))
    work += np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(rotation))
    assert work == pytest.approx(energy[-1] - energy[0], rel=1e-5)


def test_close_coiled_spring():
    """Small rise: the textbook rate, F = C (change of rise) kappa_0^2 for ends that may turn."""
    rod = helix.loaded_helix(1e-5, 0.0, natural_curvature=2.0, natural_twist=0.0, torsion=0.7)
    assert rod.force / rod.rise == pytest.approx(0.7 * 4.0, rel=1e-8)


def test_bad_input():
    with pytest.raises(InvalidInput, match="curvature"):
        helix.uniform_helix(0.0, 1.0)
    with pytest.raises(InvalidInput, match="natural_curvature"):
        helix.loaded_helix(1.0, 0.0, natural_curvature=0.0, natural_twist=1.0)
    with pytest.raises(NotConverged, match="followed"):
        # unwinding a planar coil makes it straight at -B kappa_0, and no helix beyond
        helix.loaded_helix(0.0, -3.0, natural_curvature=2.0, natural_twist=0.0)
