"""The Moebius band by collocation, checked against its functional, its topology and its limits."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from lissome import literature
from lissome.errors import InvalidInput
from lissome.references import moebius
from lissome.references.moebius import WIDEST, band

PUBLISHED = (0.1, 0.2, 0.5, 0.8, 1.0, 1.5)  # half widths for L = 2 pi


def _g(v):
    """Energy over its value for parallel rulings, as printed in (4.36)."""
    return np.log((1 + v / 2) / (1 - v / 2)) / v


def test_functions_of_the_slope():
    a = np.array([-3.0, -0.31, -0.29, 0.05, 0.29, 0.31, 2.0, 8.0])
    v = 2 * np.tanh(a)
    assert np.allclose(moebius._g(a), _g(v), rtol=1e-11)
    step = 1e-30j  # derivative by v through a complex step
    slope = np.imag(_g(v + step)) / 1e-30
    assert np.allclose(moebius._h(a), slope / _g(v) ** 2, rtol=1e-9)
    near = moebius._h(a + step)
    assert np.allclose(near.imag / 1e-30, moebius._slope_of_h(a), rtol=1e-11)
    wide = np.concatenate([a, [-25.0, 0.0, 1e-9, 40.0]])
    assert np.allclose(moebius._inverse_of_h(moebius._h(wide)), wide, rtol=1e-13, atol=1e-22)


def _half(found, bending, ruling, slope, edges):
    """Energy (twice that of the half, in D w) and what must vanish at the middle.

    Gauss quadrature of the functional, and frames by Magnus steps of fourth order: no moment, no
    Euler-Lagrange equation. From a place next to the inflection.
    """
    offset = np.sqrt(3) / 6
    step = np.diff(edges)
    energy, strains = 0.0, []
    for place in (0.5 - offset, 0.5 + offset):
        s = edges[:-1] + place * step
        k, e, v = bending(s), ruling(s), found.width * slope(s)
        energy += float(step / 2 @ (k * k * (1 + e * e) ** 2 * _g(v)))
        strains.append(np.stack([k, 0 * k, e * k], axis=1))
    one, two = strains
    # directors as columns turn by exp[step]: the Magnus term of the body frame has this sign
    mixed = np.sqrt(3) / 12 * step[:, None] ** 2 * np.cross(one, two)
    turn = step[:, None] / 2 * (one + two) + mixed
    frame, place = found.frames(edges[0]), found.points(edges[0])
    for h, w in zip(step, turn, strict=True):
        angle = np.linalg.norm(w)
        n = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        c1, c2 = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / 2 / np.pi) ** 2
        c3 = (1 - c1) / angle**2 if angle > 1e-3 else 1 / 6
        place = place + h * frame @ (np.eye(3) + c2 * n + c3 * n @ n)[:, 2]
        frame = frame @ (np.eye(3) + c1 * n + c2 * n @ n)
    return energy, np.array([place[1], place[2], frame[1, 1], frame[2, 1]])


@pytest.mark.parametrize("half_width", [0.2, 1.0])
def test_functional_is_stationary(half_width):
    """Its derivatives along bumps equal those of the closure, times four multipliers."""
    found = band(half_width / np.pi)
    edges = np.concatenate([np.geomspace(2e-3, 0.02, 80)[:-1], np.linspace(0.02, 0.5, 400)])
    grid = np.concatenate([np.geomspace(1e-3, 0.02, 400)[:-1], np.linspace(0.02, 0.5, 1200)])
    bending = CubicSpline(grid, found.strains(grid)[:, 0])
    ruling = CubicSpline(grid, found.ruling(grid))
    slope = ruling.derivative()

    def changed(size, which, number):
        def bump(s):
            # vanishes at the inflection, even about the middle
            return np.sin((2 * number + 1) * np.pi * s) * s

        def rate(s):
            w = (2 * number + 1) * np.pi
            return np.sin(w * s) + w * s * np.cos(w * s)

        if which == "bending":
            return _half(found, lambda s: bending(s) + size * bump(s), ruling, slope, edges)
        # the slope of the ruling is at its bound in the inflection: only inner changes
        return _half(
            found,
            bending,
            lambda s: ruling(s) + size * s**2 * bump(s),
            lambda s: slope(s) + size * (2 * s * bump(s) + s**2 * rate(s)),
            edges,
        )

    rows, right = [], []
    for which, size in (("bending", 1e-3), ("ruling", 1e-3)):
        for number in range(5):
            up, down = changed(size, which, number), changed(-size, which, number)
            right.append((up[0] - down[0]) / (2 * size))
            rows.append((up[1] - down[1]) / (2 * size))
    rows, right = np.array(rows), np.array(right)
    fit, *_ = np.linalg.lstsq(rows, right, rcond=None)
    assert np.abs(rows @ fit - right).max() < 2e-4 * np.abs(right).max()
    energy, closure = changed(0.0, "bending", 0)
    left = np.linspace(0.0, edges[0], 201)
    energy += 2 * np.trapezoid(found.density(left), left)
    assert energy == pytest.approx(found.energy, rel=1e-6)
    assert np.abs(closure).max() < 1e-5


@pytest.mark.parametrize("half_width", [0.0, *PUBLISHED, 1.7])
def test_twist_and_writhe(half_width):
    found = band(half_width / np.pi)
    assert found.twist + found.writhe(48) == pytest.approx(0.5, abs=2e-9)


@pytest.mark.parametrize("half_width", [0.1, 0.5, 1.5])
def test_energy_does_not_depend_on_the_mesh(half_width):
    fine = band(half_width / np.pi)
    coarse = band(half_width / np.pi, elements=30, stages=5, tolerance=1e-4)
    assert len(fine.point.mesh) > len(coarse.point.mesh)
    assert coarse.energy == pytest.approx(fine.energy, rel=1e-8)
    assert coarse.twist == pytest.approx(fine.twist, abs=1e-8)


def test_half_turn_and_closure():
    found = band(0.5 / np.pi)
    s = np.linspace(0.0, 1.0, 101)
    x, d = found.points(s), found.frames(s)
    turn = np.diag([1.0, -1.0, -1.0])
    assert np.allclose(x[::-1], x @ turn, atol=1e-9)
    # closed, with a half turn of the frame about the tangent
    assert np.allclose(x[0], x[-1], atol=1e-8)
    assert np.allclose(d[-1], d[0] @ np.diag([-1.0, -1.0, 1.0]), atol=1e-8)
    assert np.allclose(np.einsum("pij,pik->pjk", d, d), np.eye(3), atol=1e-12)
    # tangent and strains belong to the curve: differences of it
    h = 1e-5
    middle = np.array([0.1, 0.3, 0.6, 0.9])
    tangent = (found.points(middle + h) - found.points(middle - h)) / (2 * h)
    assert np.allclose(tangent, found.frames(middle)[:, :, 2], atol=1e-8)
    rate = (found.frames(middle + h) - found.frames(middle - h)) / (2 * h)
    spin = np.einsum("pij,pik->pjk", found.frames(middle), rate)
    strains = found.strains(middle)
    assert np.allclose(spin[:, 2, 1], strains[:, 0], atol=1e-5)
    assert np.allclose(spin[:, 0, 2], 0.0, atol=1e-5)
    assert np.allclose(spin[:, 1, 0], strains[:, 2], atol=1e-5)
    assert np.allclose(found.ruling(middle), strains[:, 2] / strains[:, 0], rtol=1e-12)


def test_inflection():
    """Bending vanishes only there, and there the ruling turns as fast as the width allows."""
    found = band(0.5 / np.pi)
    s = np.array([1e-6, 1e-7])
    assert np.allclose(found.width * found.ruling(s) / s, 2.0, atol=1e-5)
    near = found.strains(np.array([1e-4, 1e-5, 1e-6]))[:, 0]
    # kappa_1 ~ s/ln(c/s) loses a little more than a tenth by decade: the same c from all three
    first, second = near[:-1] / near[1:]
    assert 10 < second < first
    decade = np.log(10)
    logarithm = decade / (first / 10 - 1)  # ln(c/1e-4)
    assert second / 10 == pytest.approx(1 + decade / (logarithm + decade), abs=0.01)
    inside = found.strains(np.linspace(1e-6, 1 - 1e-6, 2001))[:, 0]
    assert inside.min() > 0


def test_narrow_limit():
    """Energy and twist tend to Sadowsky's; at the inflection rulings stand at 45 degrees."""
    limit = band(0.0)
    assert limit.ruling(0.0) == pytest.approx(1.0, abs=1e-12)
    widths = np.array([0.04, 0.02, 0.01]) / np.pi
    gaps = np.array([band(w).energy for w in widths]) - limit.energy
    order = np.log2(gaps[:-1] / gaps[1:])
    # first order, with a remainder of first order
    assert 0 < order[1] - 1 < 0.55 * (order[0] - 1)
    assert 2 * order[1] - order[0] == pytest.approx(1.0, abs=1e-3)
    away = np.linspace(0.1, 0.5, 9)
    assert np.abs(band(0.01 / np.pi).strains(away) - limit.strains(away)).max() < 0.1


def test_wide_limit():
    """A triangle folded flat: a half turn of twist less the writhe of its three corners, 1/4."""
    half = np.array([1.6, 1.7, 1.75])
    found = [band(w / np.pi) for w in half]
    energy = np.array([b.energy for b in found])
    assert np.all(np.diff(energy) > 0)
    twist = np.array([b.twist for b in found])
    assert np.all(np.diff(np.abs(twist - 0.25)) < 0)
    for bad in (WIDEST, 0.6, -0.1, np.nan):
        with pytest.raises(InvalidInput, match="width"):
            band(bad)
    with pytest.raises(InvalidInput, match="position"):
        found[0].strains([1.2])


def test_published_energy_at_a_thirtieth_of_pi():
    """5.93 is the energy over D w (w half the width, L = 2 pi) once more over pi."""
    printed = float(literature.value("starostin-energy"))
    half_width = np.pi / 30
    ours = band(half_width / np.pi).energy
    # E = D W U/L with W = 2 w and L = 2 pi: E/(D w) = U/pi
    literal = ours * 2 / (2 * np.pi)
    assert literal > 2 * np.pi  # no closed curve of this length bends less
    assert printed < 2 * np.pi
    assert literal / np.pi == pytest.approx(printed, abs=0.005)


def test_table_of_energies():
    table = literature.load("moebius-energies").frame
    assert list(table["half_width"])[:7] == [0.0, *PUBLISHED]
    for _, row in table[table["half_width"].isin([0.0, 0.2, 0.8, 1.7])].iterrows():
        found = band(row["half_width"] / np.pi, elements=50, stages=5, tolerance=1e-5)
        assert found.width == pytest.approx(row["width"], abs=1e-10)
        assert found.energy == pytest.approx(row["energy"], abs=1e-6)
        assert found.twist == pytest.approx(row["twist"], abs=2e-8)
        assert np.allclose(
            found.load, row[["force_y", "force_z", "moment_y", "moment_z"]], atol=2e-6
        )
        middle = row[["middle_bending", "middle_twisting"]]
        assert np.allclose(found.strains(0.5)[[0, 2]], middle, atol=2e-6)
    assert np.allclose(table["twist"] + table["writhe"], 0.5, atol=5e-8)


def test_table_of_strains_closes():
    """Curves alone, integrated: they close, and give energy and twist of the other table."""
    energies = literature.load("moebius-energies").frame.set_index("half_width")
    for half_width, rows in literature.load("moebius-strain-curves").frame.groupby("half_width"):
        if half_width == 1.5:
            continue  # the sampling is too coarse for its folds
        width = energies.loc[half_width, "width"]
        s = rows["position"].to_numpy()
        u = np.sqrt(2 * s)
        bending, twisting, ruling = (
            CubicSpline(u, rows[name].to_numpy()) for name in ("bending", "twisting", "ruling")
        )

        def right(u, y, bending=bending, twisting=twisting, ruling=ruling, width=width):
            d = y[:9].reshape(3, 3)
            k1, k3, eta = bending(u), twisting(u), ruling(u)
            v = width * ruling(u, 1) / u if u > 0 else 0.0
            v = np.clip(v, -2 + 1e-9, 2 - 1e-9)
            g = _g(v) if abs(v) > 1e-4 else 1 + v * v / 12
            spin = np.array([[0, -k3, 0], [k3, 0, -k1], [0, k1, 0]])
            return u * np.concatenate(
                [(d @ spin).ravel(), d[:, 2], [k1**2 * (1 + eta**2) ** 2 * g, k3 / np.pi]]
            )

        start = np.concatenate([np.eye(3).ravel(), np.zeros(5)])
        end = solve_ivp(right, (0, 1), start, "RK45", rtol=1e-8, atol=1e-9).y[:, -1]
        assert np.abs(end[10:12]).max() < 2e-5
        assert np.abs(end[:9].reshape(3, 3)[1:, 1]).max() < 1e-4
        assert end[12] == pytest.approx(energies.loc[half_width, "energy"], rel=2e-4)
        assert end[13] == pytest.approx(energies.loc[half_width, "twist"], abs=2e-5)


def test_stored_bands_near_the_triangle():
    """Energy grows without bound, twist tends to a quarter, folds cross the middle at 30 degrees."""
    table = literature.load("moebius-energies").frame.set_index("half_width")
    near = table.loc[[1.6, 1.7, 1.75, 1.8]]
    room = WIDEST - near["width"].to_numpy()
    # energy ~ c/room: the product is smooth, so that neighbors extrapolate to the same c
    product = near["energy"].to_numpy() * room
    limit = product[1:] - np.diff(product) / np.diff(room) * room[1:]
    assert np.all(np.diff(product) < 0)
    assert np.ptp(limit[1:]) < 0.005 * limit[-1]
    assert np.all(np.diff(np.abs(near["twist"].to_numpy() - 0.25)) < 0)
    # rulings of the middle fold: tan(30 degrees) = 0.577 from the direction across
    assert np.all(np.diff(np.abs(near["middle_ruling"].to_numpy() + 1 / np.sqrt(3))) < 0)
    assert near["middle_ruling"].iloc[-1] == pytest.approx(-1 / np.sqrt(3), abs=0.01)
