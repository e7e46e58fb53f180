"""Director fields: winding, symmetries, the tensor that they carry, where a defect may sit."""

from __future__ import annotations

import math

import numpy as np
import pytest
import skfem

from lissome.errors import InvalidInput
from lissome.plates import Defect, UniformDirector, UserDirector, require_inside


@pytest.mark.parametrize("charge", [-1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0])
def test_charge_is_the_winding_around_the_center(charge):
    defect = Defect(charge, center=(0.3, -0.2), phase=0.4)
    turn = np.linspace(0, 2 * np.pi, 2001)
    q = defect.tensor(0.3 + 0.1 * np.cos(turn), -0.2 + 0.1 * np.sin(turn), 1.0, 0.0)
    double = np.unwrap(np.arctan2(2 * q[0, 1], q[0, 0] - q[1, 1]))
    assert (double[-1] - double[0]) / (4 * np.pi) == pytest.approx(charge, abs=1e-12)
    # away from the defect it does not wind
    q = defect.tensor(0.6 + 0.1 * np.cos(turn), -0.2 + 0.1 * np.sin(turn), 1.0, 0.0)
    double = np.unwrap(np.arctan2(2 * q[0, 1], q[0, 0] - q[1, 1]))
    assert abs(double[-1] - double[0]) < 1e-9


def test_circles_and_rays():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 50))
    r = np.hypot(x, y)
    radial, hoop = np.array([x, y]) / r, np.array([-y, x]) / r
    circles = Defect().tensor(x, y, along=-0.1, across=0.05)
    assert np.einsum("in,ijn,jn->n", hoop, circles, hoop) == pytest.approx(np.full(50, -0.1))
    assert np.einsum("in,ijn,jn->n", radial, circles, radial) == pytest.approx(np.full(50, 0.05))
    assert np.einsum("in,ijn,jn->n", radial, circles, hoop) == pytest.approx(0, abs=1e-15)
    rays = Defect(phase=0.0).tensor(x, y, along=-0.1, across=0.05)
    assert np.einsum("in,ijn,jn->n", radial, rays, radial) == pytest.approx(np.full(50, -0.1))


def test_tensors_have_the_given_principal_strains_and_half_turns_mean_nothing():
    x, y = np.random.default_rng(2).normal(size=(2, 4, 5))
    a, b = np.full((4, 5), -0.2), np.linspace(0, 0.1, 20).reshape(4, 5)
    for director in (Defect(0.5, (0.1, 0.2)), UniformDirector(0.7), UserDirector(lambda x, y: x)):
        t = director.tensor(x, y, a, b)
        assert t.shape == (2, 2, 4, 5)
        values = np.linalg.eigvalsh(np.moveaxis(t, (0, 1), (-2, -1)))
        assert values[..., 0] == pytest.approx(a)
        assert values[..., 1] == pytest.approx(b)
        turned = UserDirector(lambda x, y, d=director: d.angle(x, y) + np.pi)
        assert turned.tensor(x, y, a, b) == pytest.approx(t, abs=1e-15)


def test_isotropic_strain_does_not_see_the_director():
    x, y = np.random.default_rng(3).normal(size=(2, 7))
    t = Defect(-0.5).tensor(x, y, 0.03, 0.03)
    assert t == pytest.approx(0.03 * np.eye(2)[:, :, None] * np.ones(7), abs=1e-17)


@pytest.mark.parametrize("charge", [-0.5, 0.5, 1.0])
def test_center_carries_the_mean_of_its_surroundings(charge):
    defect = Defect(charge, center=(0.5, 0.5))
    turn = np.arange(360) * np.pi / 180
    around = defect.tensor(0.5 + 1e-3 * np.cos(turn), 0.5 + 1e-3 * np.sin(turn), -0.1, 0.05)
    assert defect.tensor(0.5, 0.5, -0.1, 0.05) == pytest.approx(around.mean(axis=-1), abs=1e-12)


def test_defect_must_lie_on_the_plate():
    for mesh in (
        skfem.MeshTri().refined(3),
        skfem.MeshQuad().refined(3),
        skfem.MeshTri2().refined(1),
    ):
        for center in ((0.5, 0.5), (0.31, 0.9), (0.0, 0.0), (1.0, 0.4)):
            require_inside(Defect(center=center), mesh)
        for center in ((1.01, 0.5), (-0.1, 0.5), (0.5, 7.0)):
            with pytest.raises(InvalidInput, match="outside the plate"):
                require_inside(Defect(center=center), mesh)
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    middle = np.abs(mesh.p[:, mesh.t].mean(axis=1) - 0.5).max(axis=0) < 0.25
    with pytest.raises(InvalidInput, match="without its holes"):
        require_inside(Defect(center=(0.5, 0.5)), mesh.remove_elements(np.flatnonzero(middle)))
    with pytest.raises(InvalidInput, match="has a center"):
        require_inside(UniformDirector(), mesh)


@pytest.mark.parametrize("charge", [0.0, 0.3, float("nan"), "1"])
def test_bad_charges(charge):
    with pytest.raises(InvalidInput, match="`charge`"):
        Defect(charge)


def test_bad_fields():
    with pytest.raises(InvalidInput, match="`center`"):
        Defect(center=(0.0, math.nan))
    with pytest.raises(InvalidInput, match="pass a function"):
        UserDirector(1.0)
    with pytest.raises(InvalidInput, match="one finite angle"):
        UserDirector(lambda x, y: np.full(x.shape, np.nan)).angle([0.0], [1.0])
    with pytest.raises(InvalidInput, match="one finite angle"):
        UserDirector(lambda x, y: 0.0).angle([0.0], [1.0])
    with pytest.raises(InvalidInput, match="shape of `x`"):
        Defect().angle([0.0, 1.0], [1.0])
    with pytest.raises(InvalidInput, match="direction"):
        UniformDirector(math.inf)
