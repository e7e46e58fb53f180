"""The derived tables of ribbons, recomputed by integration from the clamp."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lissome import literature
from lissome.references import lateral_buckling
from lissome.references.ribbon_twist import Ribbon, trace

RADIUS, THICKNESS = 108.0, 0.2
FACTOR = {
    "thesis": lambda nu: (1 - nu**2) / 60,
    "audoly-neukirch": lambda nu: 1 / 60,
    "panda-jawed": lambda nu: 1 / 120,
}


def _shoot(width, nu, form, twist, clamp, force):
    """Position, frame and moment at the middle, from m1, k2, k3 at the clamp and the force along x.

    Strains follow from the moments, these from statics.
    """
    hard, soft = (width / THICKNESS) ** 2, 2 / (1 + nu)
    c = (THICKNESS * RADIUS / width**2) ** 2 / FACTOR[form](nu)
    pull = np.array([force, 0.0, 0.0])

    def moments(k2, k3):
        base = c + k2**2
        return np.array([k2 - k3**4 * k2 / base**2, soft * k3 + 2 * k3**3 / base])

    def moduli(k2, k3):
        base = c + k2**2
        mixed = -4 * k3**3 * k2 / base**2
        return np.array(
            [
                [1 - k3**4 * (c - 3 * k2**2) / base**3, mixed],
                [mixed, soft + 6 * k3**2 / base],
            ]
        )

    cos, sin = np.cos(twist), np.sin(twist)
    frame = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    first = np.array([clamp[0], *moments(*clamp[1:])]) @ frame
    origin = np.array([-1.0, 0.0, 0.0])

    def moment(y):
        return first - np.cross(y[:3] - origin, pull)

    def right(s, y):
        d = y[3:12].reshape(3, 3)
        k = np.array([d[0] @ moment(y) / hard, *y[12:]])
        # m' + t x n = 0 in the frame: rates of m2 and m3
        m = d @ moment(y)
        rate = d @ -np.cross(d[2], pull) - np.cross(k, m)
        strain = np.linalg.solve(moduli(*y[12:]), rate[1:])
        return np.concatenate([d[2], np.cross(k @ d, d).ravel(), strain])

    start = [*origin, *frame.ravel(), *clamp[1:]]
    run = solve_ivp(right, (0, np.pi / 2), start, "DOP853", rtol=1e-9, atol=1e-10)
    y = run.y[:, -1]
    return y[:3], y[3:12].reshape(3, 3), moment(y), y[12:]


def _misses(width, nu, form, twist, unknown):
    """What vanishes at the middle of a mirror-symmetric equilibrium."""
    x, d, _, k = _shoot(width, nu, form, twist, unknown[:3], unknown[3])
    return np.array([x[0], d[2, 1], d[2, 2], k[1]])


def _rows(name):
    return literature.load(name).frame.to_dict("records")


def _unknown(row):
    return np.array([row[c] for c in ("clamp_moment", "clamp_bending", "clamp_twist", "force")])


def test_branches_are_equilibria():
    rows = _rows("ribbon-twist-branches")
    assert {(r["width"], r["poisson_ratio"]) for r in rows} == {
        (w, nu) for w in (8.0, 15.0) for nu in (0.3, 0.4)
    }
    for row in rows[::40]:
        args = row["width"], row["poisson_ratio"], "thesis", row["twist"]
        x, d, m, k = _shoot(*args, _unknown(row)[:3], row["force"])
        assert np.allclose(x, [0, row["out_of_plane"], row["in_plane"]], atol=2e-5)
        assert np.allclose(d[2], [1, 0, 0], atol=2e-5)
        assert abs(k[1]) < 1e-4
        assert abs(m[0]) < 1e-4 * max(1, abs(m).max())
        assert np.exp(1j * row["tilt"]) == pytest.approx(d[1, 1] + 1j * d[1, 2], abs=2e-5)


def test_signs_of_the_lowest_eigenvalues():
    """Only beyond the fold of the narrow ribbon is one negative, and there one at first."""
    frame = literature.load("ribbon-twist-branches").frame
    for (width, nu), branch in frame.groupby(["width", "poisson_ratio"]):
        top = branch["twist"].to_numpy().argmax()
        symmetric = branch["symmetric"].to_numpy()
        if width == 8.0:
            assert np.all(symmetric[: top - 1] > 0)
            assert np.all(symmetric[top + 2 :] < 0)
            assert np.all(branch["antisymmetric"].to_numpy()[: top + 2] > 0)
        else:
            below = branch["twist"] < 3.13
            assert below.sum() > 30
            assert np.all(branch.loc[below, ["symmetric", "antisymmetric"]] > 0), nu


def _determinant(nu, form, twist, unknown):
    """Of the derivatives of what must vanish at the middle by the unknowns at the clamp."""
    steps = 1e-5 * np.maximum(1, abs(unknown))
    columns = []
    for step in np.diag(steps):
        ahead = _misses(8.0, nu, form, twist, unknown + step)
        columns.append((ahead - _misses(8.0, nu, form, twist, unknown - step)) / 2e-5)
    return np.linalg.det(np.array(columns))


@pytest.mark.parametrize("form", list(FACTOR))
def test_snaps_are_folds(form):
    """The equations at the middle are singular there, and regular elsewhere on the branch."""
    row = next(
        r for r in _rows("ribbon-snap") if r["xi_form"] == form and r["poisson_ratio"] == 0.4
    )
    unknown = _unknown(row)
    assert np.allclose(_misses(8.0, 0.4, form, row["twist"], unknown), 0, atol=2e-5)
    branch = [
        r for r in _rows("ribbon-twist-branches") if (r["width"], r["poisson_ratio"]) == (8.0, 0.4)
    ]
    regular = min(branch, key=lambda r: abs(r["symmetric"] - 0.8))
    other = _determinant(0.4, "thesis", regular["twist"], _unknown(regular))
    assert abs(_determinant(0.4, form, row["twist"], unknown)) < 1e-2 * abs(other)


def test_snap_lands_lower_across_the_plane():
    for row in _rows("ribbon-snap"):
        assert row["landed_energy"] < row["energy"]
        across = row["out_of_plane"] - row["landed_out_of_plane"]
        along = row["in_plane"] - row["landed_in_plane"]
        assert across > 0.15
        assert abs(along) < 0.15 * across
        assert 1.99 < row["twist"] < 2.03


def test_printed_threshold_lies_between_the_forms():
    """Only xi matters, so that forms differ by the fourth root of the ratio of its squares."""
    rows = _rows("ribbon-thresholds")
    assert [row["poisson_ratio"] for row in rows] == [0.2, 0.3, 0.4, 0.5]
    values = {}
    for row in rows:
        assert 0 < row["high"] - row["low"] < 2e-3
        for form, factor in FACTOR.items():
            ratio = FACTOR["thesis"](row["poisson_ratio"]) / factor(row["poisson_ratio"])
            values[form, row["poisson_ratio"]] = ratio**0.25 * (row["low"] + row["high"]) / 2
    # without (1 - nu^2) Poisson's ratio hardly matters
    plain = [values["audoly-neukirch", nu] for nu in (0.2, 0.3, 0.4, 0.5)]
    assert max(plain) - min(plain) < 0.01
    printed = float(literature.value("ribbon-threshold-coefficient"))
    assert max(values["thesis", nu] for nu in (0.2, 0.3, 0.4, 0.5)) < printed
    assert printed < values["panda-jawed", 0.2]


def test_threshold_brackets_are_reproduced():
    """On another mesh, a little outside the bracket."""
    row = next(r for r in _rows("ribbon-thresholds") if r["poisson_ratio"] == 0.4)
    scale = 8.0 / Ribbon(8.0, poisson_ratio=0.4).relative_width
    ends = [
        trace(
            Ribbon(value * scale, poisson_ratio=0.4),
            until=2.4,
            elements=14,
            stages=6,
            stop_at_fold=True,
        ).end
        for value in (row["low"] - 2e-3, row["high"] + 2e-3)
    ]
    assert ends == ["ellipticity", "range"]


def test_hanging_ribbons_lie_between_the_two_laws():
    low, high = (62.3 * f(0.4) ** (1 / 3) for f in LAWS)
    for row in _rows("lateral-buckling"):
        assert low < row["overhang"] < high
        assert row["load"] == pytest.approx((row["overhang"] / 62.3) ** 3, rel=1e-6)
        # the amplitude that belongs to it, by the curve that all widths share
        scale = lateral_buckling.curvature_scale(0.0925, row["width"], 0.4)
        if row["rotation"] in (0.01, 0.1):
            amplitude = row["rotation"] / (row["overhang"] * scale)
            curve = lateral_buckling.postbuckling([amplitude], 0.4, elements=16, stages=4)
            assert curve.load[0] == pytest.approx(row["load"], rel=1e-5)


LAWS = (lateral_buckling.linear_load, lateral_buckling.sadowsky_load)
