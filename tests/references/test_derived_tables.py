"""The derived tables of rods, recomputed by integration instead of collocation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from scipy.spatial.transform import Rotation

from lissome import literature

STIFF, SOFT = 5.0**3 * 2.0 / 12, 5.0 * 2.0**3 / 12
# torsion constant of 5 x 2 from 4000 terms of the double series of Prandtl's stress function
CONSTANTS = {"thesis": 0.256, "exact": 0.249365074708595}


def _torsion(name):
    return CONSTANTS[name] * 5.0 * 2.0**3 / (2 * 1.41)


def _centerline(stiffness, o, moment, stations):
    """Integrate m' = m x kappa, R' = R [kappa], x' = d3 for length 2 pi; positions and moments."""

    def right(s, y):
        k = y[:3] / stiffness + [0.0, o, 0.0]
        r = y[3:12].reshape(3, 3)
        spin = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        return np.concatenate([np.cross(y[:3], k), (r @ spin).ravel(), r[:, 2]])

    start = np.concatenate([moment, np.eye(3).ravel(), np.zeros(3)])
    run = solve_ivp(
        right, (0, stations[-1]), start, "DOP853", t_eval=stations, rtol=1e-12, atol=1e-13
    )
    return run.y[12:].T, run.y[:3].T


def _quarter(stiffness, o, guess):
    """Size and latitude of the moment at the crest, so that an eighth of the ring ends right."""

    def miss(unknown):
        size, latitude = unknown

        def right(s, y):
            k = y[:3] / stiffness + [0.0, o, 0.0]
            rate = (y[0] ** 2 / stiffness[0] + y[2] ** 2 / stiffness[2]) / (y[0] ** 2 + y[2] ** 2)
            return [*np.cross(y[:3], k), size * rate]

        start = [size * np.cos(latitude), size * np.sin(latitude), 0.0, 0.0]
        end = solve_ivp(right, (0, np.pi / 4), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return [end[0], end[3] - np.pi / 4]

    found = root(miss, guess, tol=1e-12)
    assert found.success, found.message
    size, latitude = found.x
    return np.array([size * np.cos(latitude), size * np.sin(latitude), 0.0])


def test_thresholds_solve_their_quadratics():
    table = literature.load("slinky-thresholds")
    assert len(table) == 16
    for torsion, radial, k, low, high in zip(
        *(table[name] for name in ("torsion", "radial", "turns", "low", "high")), strict=True
    ):
        inner, outer = (STIFF, SOFT) if radial == "width" else (SOFT, STIFF)
        c = _torsion(torsion)
        for place, n in ((low, k - 1), (high, k + 1)):
            if n == 0:
                assert place == pytest.approx(1 - outer / inner, abs=1e-9)
                continue
            mu = inner * (place - k)
            terms = np.array([outer * c * (n * n - k * k), -k * mu * (outer + c), -mu * mu])
            assert abs(terms.sum()) < 1e-8 * np.abs(terms).sum()
    row = table.frame.query("torsion == 'thesis' and radial == 'width' and turns == 3").iloc[0]
    printed = float(literature.value("slinky-flat-overcurvature"))
    assert row["low"] == pytest.approx(printed, rel=0.01)


@pytest.mark.parametrize("name", ["thesis", "exact"])
def test_slinky_rows_by_shooting(name):
    table = literature.load("slinky-continuum").frame
    table = table[table["torsion"] == name]
    stiffness = np.array([SOFT, STIFF, _torsion(name)])
    mean = np.sqrt(SOFT * _torsion(name))
    for o in (1.2, 1.5, 2.0, 2.4, 2.5, 2.8):
        row = table[table["overcurvature"] == o].iloc[0]
        latitude = np.arcsin((o - 2) / 0.84)
        moment = _quarter(stiffness, o, [mean, latitude])
        stations = np.linspace(0, 2 * np.pi, 65)
        points, moments = _centerline(stiffness, o, moment, stations)
        assert np.allclose(points[-1], 0.0, atol=1e-10)
        gap = np.linalg.norm(points[32:] - points[:33], axis=1) / (2 * np.pi)
        assert gap.min() == pytest.approx(row["distance"], abs=2e-10)
        assert abs(row["crest_distance"]) == row["distance"]
        along = points @ moment / np.linalg.norm(moment) / (2 * np.pi)
        assert np.ptp(along) == pytest.approx(row["height"], abs=2e-10)
        density = 0.5 * np.sum(moments[:-1] ** 2 / stiffness, axis=1)
        energy = density.mean() * (2 * np.pi) ** 2 / STIFF
        assert energy == pytest.approx(row["energy"], abs=1e-8)
        twist = np.abs(moments[:, 2]).max() / stiffness[2] * 2 * np.pi
        assert twist == pytest.approx(row["twist"], abs=1e-8)


@pytest.mark.parametrize("name", ["thesis", "exact"])
def test_slinky_is_flat_outside_the_thresholds(name):
    table = literature.load("slinky-continuum").frame
    table = table[table["torsion"] == name]
    limits = literature.load("slinky-thresholds").frame
    limits = limits[(limits["torsion"] == name) & (limits["radial"] == "width")]
    onset = limits[limits["turns"] == 1]["high"].iloc[0]
    end, last = limits[limits["turns"] == 3][["low", "high"]].iloc[0]
    o = table["overcurvature"].to_numpy()
    assert o[0] == 1.0
    assert o[-1] == 3.1 < last
    flat = table["height"].to_numpy() == 0.0
    assert np.array_equal(flat, (o <= onset) | (o >= end))
    for turns, part in ((1, o <= onset), (3, o >= end)):
        rows = table[part]
        assert np.allclose(rows["distance"], 1 / (turns * np.pi), atol=1e-10)
        energy = 0.5 * (2 * np.pi * (turns - o[part])) ** 2
        assert np.allclose(rows["energy"], energy, atol=1e-9)
    assert np.all(np.diff(table["crest_distance"][~flat]) < 0)


def test_shapes_by_integration_from_the_crest():
    table = literature.load("slinky-shapes").frame
    stiffness = np.array([SOFT, STIFF, _torsion("thesis")])
    for o, rows in table.groupby("overcurvature"):
        strains = rows[["bending_out", "bending_in", "twist"]].to_numpy()
        moment = stiffness * (strains[0] / (2 * np.pi) - [0, o, 0])
        s = 2 * np.pi * rows["position"].to_numpy()
        points, moments = _centerline(stiffness, o, moment, s)
        found = 2 * np.pi * (moments / stiffness + [0, o, 0])
        assert np.allclose(found, strains, atol=1e-8)
        stored = rows[["x", "y", "z"]].to_numpy()
        assert np.allclose(stored[:-1].mean(axis=0), 0.0, atol=1e-9)
        points = points / (2 * np.pi)
        points = points - points[:-1].mean(axis=0)
        turn, _ = Rotation.align_vectors(stored, points)
        assert np.allclose(turn.apply(points), stored, atol=1e-9)
        assert np.linalg.norm(stored[32] - stored[0]) == pytest.approx(
            literature.load("slinky-continuum")
            .frame.query("torsion == 'thesis' and overcurvature == @o")["distance"]
            .iloc[0],
            abs=1e-9,
        )


def test_tips_by_integration_of_the_cantilever():
    """From the free end: the angle there is adjusted until the clamp is level."""
    table = literature.load("cantilever-tips").frame
    for kind, distributed in (("end", False), ("distributed", True)):
        rows = table[(table["load_type"] == kind) & (table["y"] > 0)]
        assert len(rows) == 48
        straight = table[(table["load_type"] == kind) & (table["y"] == 0)]
        assert np.all(straight["x"] == 1.0)
        assert straight["load"].max() < rows["load"].min()
        for load, x, y in rows[["load", "x", "y"]].to_numpy()[::6]:

            def right(s, v, load=load, distributed=distributed):
                force = load * s if distributed else load
                return [v[1], -force * np.sin(v[0]), np.cos(v[0]), np.sin(v[0])]

            def shoot(angle, right=right):
                start = [angle, 0, 0, 0]
                return solve_ivp(right, (0, 1), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]

            # a smaller tip angle turns further than the clamp
            angle = brentq(lambda a, shoot=shoot: shoot(a)[0], 1e-3, np.pi - 1e-9, xtol=1e-15)
            end = shoot(angle)
            assert abs(end[0]) < 1e-8
            assert np.allclose(end[2:], [x, y], atol=1e-9)
