"""Laws in which the stretch takes part: closed forms, a second scheme, an initial value problem."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root_scalar

import lissome as ls
from lissome import rods
from lissome.errors import InvalidInput
from lissome.rods._cells import relaxed

FOUR = ("curvature_1", "curvature_2", "twist", "stretch")


def linear(matrix):
    """Return the quadratic law of a matrix, by one numpy function."""
    matrix = np.asarray(matrix, dtype=float)

    def law(k):
        stress = k @ matrix
        return 0.5 * np.sum(stress * k, axis=1), stress, np.tile(matrix, (len(k), 1, 1))

    return rods.FunctionLaw(law, strains=FOUR)


def coupled(bending=1.0, twisting=1.0, stretching=20.0, *, curvature=0.0, twist=0.0):
    matrix = np.diag([bending, bending, twisting, stretching])
    matrix[0, 3] = matrix[3, 0] = curvature
    matrix[2, 3] = matrix[3, 2] = twist
    return linear(matrix)


@pytest.mark.parametrize("ends", ["free", "clamped", "pinned", "ring"])
def test_without_coupling_it_is_the_law_of_three_strains_with_a_stretching_stiffness(ends):
    plain = rods.Kirchhoff((1.0, 2.0), 1.5)
    found = []
    for law, stretching in ((plain, 40.0), (linear(np.diag([1.0, 2.0, 1.5, 40.0])), None)):
        if ends == "ring":
            rod = rods.ring(1.0, 24, law, stretching=stretching).pinned(0)
            rod = rod.loaded(nodes={6: [3, 0, 5], 18: [0, 2, -5], 12: [0, 0, 4]})
            rod = rod.clamped(0)
        else:
            lengths = np.linspace(1.0, 2.0, 20) / 30.0
            rod = rods.straight(law=law, lengths=lengths, stretching=stretching)
            rod = rod.with_natural(curvature_1=0.7, twist=1.0).clamped("start")
            if ends == "free":
                rod = rod.loaded(end=[2.0, 1.0, 3.0])
            elif ends == "clamped":
                rod = rod.clamped("end", (0.1, 0.05, 0.9))
            else:
                rod = rod.pinned("end", (0.1, None, 0.9))
        found.append(ls.equilibrate(rod))
    one, two = found
    assert one.inertia == two.inertia
    assert np.abs(one.positions - two.positions).max() < 1e-11
    assert np.abs(one.state.stretches - two.state.stretches).max() < 1e-11
    assert one.energy == pytest.approx(two.energy, rel=1e-11)
    assert one.bending_energy + one.stretching_energy == pytest.approx(
        two.bending_energy, rel=1e-11
    )


@pytest.mark.parametrize("force", [3.0, -2.0])
def test_a_pulled_cord_untwists(force):
    """Straight, uniform and free to turn: C tau + D eps = 0 and (A - D^2/C) eps e = F, exactly."""
    twisting, stretching, d = 1.0, 20.0, 2.5
    law = coupled(twisting=twisting, stretching=stretching, twist=d, bending=5.0)
    rod = rods.straight(1.0, 17, law).clamped("start").loaded(end=[0, 0, force])
    eq = ls.equilibrate(rod)
    soft = stretching - d * d / twisting
    e = brentq(lambda e: soft * 0.5 * (e * e - 1) * e - force, 0.6, 2.0, xtol=1e-15)
    strain = 0.5 * (e * e - 1)
    assert eq.stable
    assert np.abs(eq.state.stretches - e).max() < 1e-12
    assert np.abs(eq.strains - [0, 0, -d * strain / twisting]).max() < 1e-12
    assert eq.energy == pytest.approx(0.5 * soft * strain**2 - force * e, rel=1e-12)


def test_a_bent_rod_whose_curvature_stretches_it():
    """Under a moment alone B k + c eps = M and c k + A eps = 0: an arc, exactly in the measure "angle"."""
    c, stretching, moment = 1.5, 10.0, 0.8
    law = coupled(curvature=c, stretching=stretching)
    rod = rods.straight(1.0, 12, law, measure="angle").clamped("start")
    rod = rod.hinged("end", (None, None, None), axis=[1, 0, 0], moment=moment)
    eq = ls.equilibrate(rod)
    k = moment / (1.0 - c * c / stretching)
    assert np.abs(eq.strains - [k, 0, 0]).max() < 1e-12
    assert np.abs(0.5 * (eq.state.stretches**2 - 1) + c * k / stretching).max() < 1e-12
    assert eq.state.angles[0] == pytest.approx(k, rel=1e-12)


def continuum_tip(c, stretching, force):
    """Return the tip of a plane cantilever of the continuous model, by shooting."""

    def strains(theta, moment):
        along = -np.sin(theta) * force[0] + np.cos(theta) * force[1]

        def balance(e):
            strain = 0.5 * (e * e - 1)
            return (c * (moment - c * strain) + stretching * strain) * e - along

        e = root_scalar(balance, x0=1.0, x1=1.1, xtol=1e-15).root
        return moment - c * 0.5 * (e * e - 1), e

    def slopes(s, y):
        k, e = strains(y[0], y[1])
        sin, cos = np.sin(y[0]), np.cos(y[0])
        return [k, e * (sin * force[1] + cos * force[0]), -e * sin, e * cos]

    def shot(moment):
        return solve_ivp(
            slopes, (0, 1), [0, moment, 0, 0], rtol=1e-11, atol=1e-12, method="DOP853"
        ).y[:, -1]

    first = brentq(lambda m: shot(m)[1], -2.0, 0.0, xtol=1e-12)
    return shot(first)[2:]


def test_a_cantilever_converges_with_second_order_to_the_continuous_one():
    c, stretching, force = 1.2, 8.0, (1.3, 0.9)
    exact = continuum_tip(c, stretching, force)
    law = coupled(curvature=c, stretching=stretching)
    errors, tips = [], []
    for n in (20, 40, 80):
        rod = rods.straight(1.0, n, law).clamped("start").loaded(end=[0, *force])
        eq = ls.equilibrate(rod)
        tips.append(eq.positions[-1, 1:])
        errors.append(np.abs(tips[-1] - exact).max())
    assert np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 2).max() < 0.1
    assert np.abs((4 * tips[2] - tips[1]) / 3 - exact).max() < 2e-6
    # without the coupling the tip is elsewhere: the test sees it
    assert np.abs(continuum_tip(0.0, stretching, force) - exact).max() > 1e-2


def test_symbolic_law_of_four_strains():
    k1, k2, t, e = sp.symbols("k1 k2 t e")
    density = (k1**2 + 2 * k2**2 + t**2 + 20 * e**2) / 2 + t * e + t**2 * e**2
    law = rods.SymbolicLaw(density, (k1, k2, t, e), names=FOUR)
    rod = rods.straight(1.0, 16, law).clamped("start").loaded(end=[0.3, 0.2, 2.0])
    eq = ls.equilibrate(rod)
    assert eq.stable and eq.residual < 1e-12
    assert np.ptp(eq.state.stretches) < 0.1 and eq.state.stretches.min() > 1.02
    assert eq.strains[:, 2].max() < -0.01  # it untwists


def test_alternating_stretches_cost_as_much_as_others():
    law = coupled(stretching=20.0)
    rod = rods.straight(1.0, 10, law).clamped("start")
    strain = 0.1 * (-1.0) ** np.arange(10)
    state = rods.RodState(rod.initial.quaternions, np.zeros(3), np.sqrt(1 + 2 * strain))
    energy = rod.evaluate(state, np.zeros(0), 0).energy
    assert energy == pytest.approx(0.5 * 20.0 * 0.1**2, rel=1e-12)


def test_strains_without_moment():
    """A nonlinear law, relaxed, and differences of its energy."""

    def density(k):
        w = np.sum(k[:, :3] ** 2, axis=1) + k[:, 2] ** 4 + k[:, 3] * k[:, 2] + 5 * k[:, 3] ** 2
        stress = np.stack(
            [
                2 * k[:, 0],
                2 * k[:, 1],
                2 * k[:, 2] + 4 * k[:, 2] ** 3 + k[:, 3],
                k[:, 2] + 10 * k[:, 3],
            ],
            1,
        )
        stiffness = np.tile(np.diag([2.0, 2.0, 2.0, 10.0]), (len(k), 1, 1))
        stiffness[:, 2, 2] += 12 * k[:, 2] ** 2
        stiffness[:, 2, 3] = stiffness[:, 3, 2] = 1.0
        return w, stress, stiffness

    law = rods.FunctionLaw(density, strains=FOUR)
    at, h = np.array([0.0, 0.3, -0.8]), 1e-4
    energy, slope, curvature = relaxed(law, at)
    up, down = relaxed(law, at + h), relaxed(law, at - h)
    assert energy[0] == 0.0
    assert np.allclose((up[0] - down[0]) / (2 * h), slope, atol=1e-7)
    assert np.allclose((up[1] - down[1]) / (2 * h), curvature, atol=1e-6)


def test_bad_input():
    law = coupled()
    with pytest.raises(InvalidInput, match="`stretching` is 3, but the stretch is a strain"):
        rods.straight(1.0, 10, law, stretching=3.0)
    with pytest.raises(InvalidInput, match="`stretching` is 3, but the stretch is a strain"):
        rods.straight(1.0, 10, rods.Kirchhoff(1.0, 1.0), stretching=3.0).with_law(law)
    other = rods.FunctionLaw(linear(np.eye(4)).function, strains=(*FOUR[:3], "temperature"))
    with pytest.raises(InvalidInput, match="or of these and stretch"):
        rods.straight(1.0, 10, other)
