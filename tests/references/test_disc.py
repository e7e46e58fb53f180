"""The axisymmetric disc by collocation against closed forms, limits and a second method."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import iv, ivp, jv, jvp

from lissome.errors import InvalidInput, NotConverged
from lissome.references.disc import AxisymmetricDisc, buckling_strain, fold

DOME = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5, radius=0.5, strain=(0.01, -0.02))


@pytest.mark.parametrize(
    ("edge", "factor"),
    [("clamped", lambda nu: 1.0), ("simply supported", lambda nu: (5 + nu) / (1 + nu))],
)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_small_loads_bend_as_in_closed_form(edge, factor, nu):
    disc = AxisymmetricDisc(bending=2e-3, poisson_ratio=nu, radius=1.7, edge=edge, pressure=1e-10)
    flexural = 2e-3 / (1 - nu**2)
    closed = factor(nu) * 1e-10 * 1.7**4 / (64 * flexural)
    assert disc.solve().height == pytest.approx(closed, rel=1e-9)


@pytest.mark.parametrize("edge", ["clamped", "hinged", "simply supported", "sliding clamp"])
def test_large_deflections_agree_with_a_boundary_value_solver(edge):
    nu, bending, load = 0.3, 1e-4, 2e-3
    state = AxisymmetricDisc(bending=bending, poisson_ratio=nu, edge=edge, pressure=load).solve(
        height=0.1
    )
    c, d = 1 / (1 - nu**2), bending / (1 - nu**2)

    # Displacement, r N_r, slope, r M_r, from the center outward.
    def rates(r, y):
        u, rn, slope, rm = y
        inside = r > 0
        s = np.where(inside, r, 1.0)
        n, m = rn / s, rm / s
        et, kt = u / s, slope / s
        er, kr = n / c - nu * et, m / d - nu * kt
        nt, mt = c * (et + nu * er), d * (kt + nu * kr)
        return np.array([er - slope**2 / 2, nt, kr, mt + rn * slope + load * s**2 / 2])

    def ends(a, b):
        far = [b[0] if edge in ("clamped", "hinged") else b[1],
               b[2] if edge in ("clamped", "sliding clamp") else b[3]]  # fmt: skip
        # At the small first radius strain and curvature are isotropic.
        near = [a[1] - c * (1 + nu) * a[0], a[3] - d * (1 + nu) * a[2]]
        return np.array(near + far)

    r = np.linspace(1e-5, 1, 400)
    guess = np.array([0 * r, r * 1e-3, -0.2 * r, -0.2 * r * d])
    second = solve_bvp(rates, ends, r, guess, tol=1e-9, max_nodes=200000)
    assert second.success
    where = np.array([0.2, 0.5, 0.8, 1.0])
    assert state.slope(where) == pytest.approx(second.sol(where)[2], abs=2e-8)
    assert state.displacement(where) == pytest.approx(second.sol(where)[0], abs=2e-8)
    assert state.height > np.sqrt(bending)  # well beyond small deflections


def test_energy_falls_at_the_rate_of_the_load():
    # Envelope theorem: dE/dq = -integral of w = -(integral of the slope's moment).
    disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.3, edge="hinged", pressure=1e-3)
    state = disc.solve(height=0.1)
    h = 1e-6
    more, less = (replace(disc, pressure=1e-3 + s).solve(state).energy for s in (h, -h))
    r, weights = np.polynomial.legendre.leggauss(60)
    r = 0.5 * (r + 1)
    volume = np.sum(0.5 * weights * 2 * np.pi * r * state.deflection(r))
    assert (more - less) / (2 * h) == pytest.approx(-volume, rel=1e-7)


def test_flat_defect_disc_in_closed_form():
    disc = replace(DOME, radius=2.0)
    flat = disc.solve()
    nu, jump = 0.5, 0.03
    # u/r = a + b log(r/R) balances; the edge is free.
    b = (1 - nu) * jump / 2
    r = np.array([0.01, 0.5, 1.3, 2.0])
    # N_r = 0 at R: a + b - 0.01 + nu (a + 0.02) = 0
    a = (0.01 - b - 0.02 * nu) / (1 + nu)
    assert flat.displacement(r) == pytest.approx(r * (a + b * np.log(r / 2.0)), abs=1e-13)
    assert np.max(np.abs(flat.deflection(r))) < 1e-13


def test_thin_dome_is_a_cone_of_slope_root_two_delta():
    # The boundary layer at the rim and the core shrink with the thickness.
    errors = []
    state = DOME.solve(height=0.1)
    for bending in (1e-5, 1e-6, 1e-7):
        state = replace(DOME, bending=bending).solve(state)
        errors.append(abs(abs(state.slope(0.25)) - np.sqrt(2 * 0.03)))  # up or down
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-4


def test_mirrored_problem_gives_mirrored_dome():
    up = replace(DOME, curvature=(0.1, -0.3)).solve(height=0.1)
    down = replace(DOME, curvature=(-0.1, 0.3)).solve(height=-0.1)
    assert down.height == pytest.approx(-up.height, rel=1e-10)
    assert down.energy == pytest.approx(up.energy, rel=1e-10)


def test_uniform_strain_costs_nothing():
    disc = replace(DOME, strain=(0.02, 0.02)).solve()
    assert disc.energy == pytest.approx(0.0, abs=1e-20)
    assert disc.displacement(0.4) == pytest.approx(0.008, rel=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_buckling_strain_separates_flat_from_domed(nu):
    critical = buckling_strain(0.02, nu)
    disc = AxisymmetricDisc(bending=4e-4, poisson_ratio=nu)

    def tangent(factor):
        flat = replace(disc, strain=(factor * critical, 0.0)).solve()
        assert flat.height == 0
        return np.linalg.slogdet(flat.disc.residual(flat.unknowns)[1])[0]

    assert tangent(0.2) == tangent(0.9) == tangent(0.999) == -tangent(1.001)
    # A pitchfork: the square of the height grows like the excess.
    state = replace(disc, strain=(4 * critical, 0.0)).solve(height=0.2)
    assert state.height > 0.1
    squares, n, before = [], disc.size // 2, 3.0
    for excess in (2.0, 1.3, 0.8, 0.5, 0.32, 0.16, 0.08, 0.04):
        state.unknowns[n:] *= np.sqrt(excess / before)  # not drawn to the flat state
        state = replace(disc, strain=((1 + excess) * critical, 0.0)).solve(state)
        squares.append(state.height**2 / excess)
        before = excess
    squares = squares[4:]
    ratios = np.array(squares[1:]) / squares[:-1] - 1
    assert np.all(np.abs(ratios[1:] / ratios[:-1] - 0.5) < 0.12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
@pytest.mark.parametrize("waves", [2, 3])
def test_softest_wave_of_a_flat_disc_is_the_vibration_of_a_free_disc(nu, waves):
    # W = J_n(k r) + c I_n(k r), with moment and effective shear zero at r = 1.
    def rows(k):
        out = []
        for f, fp, sign in ((jv, jvp, -1.0), (iv, ivp, 1.0)):
            w, w1 = f(waves, k), k * fp(waves, k)
            lap = sign * k**2 * w  # Laplacian, and its radial derivative
            lap1 = sign * k**2 * w1
            moment = lap - (1 - nu) * (w1 - waves**2 * w)
            shear = lap1 - (1 - nu) * waves**2 * (w1 - w)
            out.append((moment, shear))
        return out[0][0] * out[1][1] - out[0][1] * out[1][0]

    k = np.linspace(0.5, 5, 400)
    values = np.array([rows(q) for q in k])
    first = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0]
    root = brentq(rows, k[first], k[first + 1], xtol=1e-13)
    disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=nu)
    assert disc.solve().softest(waves) == pytest.approx(1e-4 / (1 - nu**2) * root**4, rel=1e-8)


def test_shallow_bowl_of_a_bilayer_and_its_loss_of_roundness():
    # Uniform curvature: stable up to k R^2/h = 8/(1 + nu)^(3/2), h^2 = 12 B/C (nu = 0 is least off).
    nu, h = 0.0, np.sqrt(12 * 1e-4)
    disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=nu)
    small = replace(disc, curvature=(1e-3, 1e-3)).solve()
    assert -small.height == pytest.approx(0.5e-3, rel=1e-3)

    def softest(k):
        return replace(disc, curvature=(k, k)).solve(height=-0.02).softest(2)

    critical = brentq(softest, 4 * h, 14 * h, xtol=1e-8)
    uniform = 8 * h
    assert critical == pytest.approx(uniform, rel=0.1)
    # Ritz converges from above.
    state = replace(disc, curvature=(critical, critical)).solve(height=-0.02)
    assert state.softest(2, 22) == pytest.approx(state.softest(2, 14), abs=1e-9)


def test_fold_is_where_the_dome_inverts():
    state = DOME.solve(height=0.1)
    p, at = fold(state, (-1.0, 2.0), step=0.1, most=2.0)
    assert at.height > 0

    def inverted(q):
        try:
            new = state
            for part in np.linspace(0, 1, 9)[1:]:
                new = replace(DOME, curvature=(-q * part, 2 * q * part)).solve(new)
        except NotConverged:
            return True
        return new.height < 0

    assert not inverted(0.995 * p)
    assert inverted(1.005 * p)
    # The tangent is singular there.
    _, jacobian = at.disc.residual(at.unknowns)
    _, before = DOME.residual(state.unknowns)
    assert np.linalg.slogdet(jacobian)[1] < np.linalg.slogdet(before)[1] - 10
    # And the mirrored dome folds under the opposite curvature.
    mirrored = DOME.solve(height=-0.1)
    other, _ = fold(mirrored, (1.0, -2.0), step=0.05, most=2.0)
    assert other == pytest.approx(p, rel=1e-8)


@pytest.mark.parametrize(
    ("name", "value"),
    [("bending", 0.0), ("poisson_ratio", -1.0), ("poisson_ratio", 0.6), ("edge", "glued"),
     ("strain", (1, 2, 3)), ("pressure", 1.0)],
)  # fmt: skip
def test_bad_discs_are_refused(name, value):
    with pytest.raises(InvalidInput, match=name):
        AxisymmetricDisc(**{"bending": 1e-3, "poisson_ratio": 0.3, name: value})


def test_flat_discs_are_no_starts_for_folds():
    disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5)
    with pytest.raises(InvalidInput, match="flat and unstrained"):
        fold(disc.solve(), (1.0, 1.0))


def test_no_fold_is_an_error():
    with pytest.raises(NotConverged, match="no fold"):
        fold(DOME.solve(height=0.1), (1.0, -2.0), step=0.2, most=0.5)
