"""Spontaneous strain and curvature while heat passes: limits, symmetries, signs."""

from __future__ import annotations

import json
import shutil
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lissome import literature
from lissome._datapackage import Descriptor
from lissome.errors import DataAwaited, InvalidInput
from lissome.plates import (
    Conduction,
    FixedTemperature,
    HeatFlux,
    Insulated,
    Laminate,
    Layer,
    SigmoidCurve,
    TabulatedCurve,
    film_curve,
    film_fits,
    film_laminate,
    film_layer,
    measured_film_curve,
    spontaneous_history,
)

LINE = TabulatedCurve([-1.0, 2.0], [0.05, -0.1])  # strain -0.05 T


def heated(sheet, until=4.0, bottom=1.0, top=None):
    top = Insulated() if top is None else FixedTemperature(top)
    return Conduction(sheet, FixedTemperature(bottom), top, 0.0).run(until=until)


def test_linear_film_on_a_hot_plate_in_closed_form():
    # With strain proportional to temperature the moments of the series of the heat equation are
    # eps_m = -a (1 - sum 2/l^2 e), kappa = -12 a sum (2/l)(sin(l)/l^2 - 1/(2 l)) e with l = (n+1/2) pi.
    sheet = Laminate([Layer(1.0, 1.0, 0.3, strain=LINE, tensor="isotropic")])
    history = spontaneous_history(sheet, heated(sheet), times=[0.02, 0.1, 0.5, 2.0])
    root = (np.arange(2000)[:, None] + 0.5) * np.pi
    decay = np.exp(-(root**2) * history.times)
    mean = 1 - (2 / root**2 * decay).sum(axis=0)
    # first moment of 1 - sum 2/l sin(l s) e about the middle s = 1/2
    first = -(2 / root * (np.sin(root) / root**2 - 0.5 / root) * decay).sum(axis=0)
    assert history.values.strain_along == pytest.approx(-0.05 * mean, rel=1e-5)
    assert history.values.curvature_along == pytest.approx(12 * 0.05 * first, rel=1e-4, abs=1e-9)
    assert (history.values.curvature_along < 0).all()  # a dome: the bottom is the shorter side


def test_mirrored_stack_heated_from_the_other_side_mirrors():
    curves = SigmoidCurve(0.3, 0.5, 0.1, 0.0), SigmoidCurve(0.1, 0.8, 0.1, 0.0)
    sheet = Laminate(
        [Layer(0.3, 4.0, 0.4, strain=curves[0]), Layer(0.7, 1.0, 0.4, strain=curves[1])]
    )
    t = np.geomspace(1e-3, 2.0, 12)
    a = spontaneous_history(sheet, heated(sheet), t).values
    over = sheet.flipped()
    below = Conduction(over, Insulated(), FixedTemperature(1.0), 0.0).run(until=2.0)
    b = spontaneous_history(over, below, t).values
    assert b.strain_along == pytest.approx(a.strain_along, rel=1e-8)
    assert b.curvature_along == pytest.approx(-a.curvature_along, rel=1e-7, abs=1e-10)
    assert b.residual_energy == pytest.approx(a.residual_energy, rel=1e-6, abs=1e-14)


@given(
    st.floats(0.1, 0.9),
    st.floats(0.1, 10.0),
    st.floats(-0.2, 0.2),
    st.floats(-0.2, 0.2),
    st.floats(-0.5, 0.5),
)
@settings(max_examples=40, deadline=None)
def test_final_curvature_of_two_materials_follows_the_greater_contraction(share, ratio, a, b, nu):
    # kappa = -C1 C2 (z2 - z1)(e2 - e1)/(C B): the sheet bends toward the side that is shorter
    def curve(strain):
        return TabulatedCurve([0.0, 1.0], [0.0, strain])

    sheet = Laminate(
        [Layer(share, ratio, nu, strain=curve(a)), Layer(1 - share, 1.0, nu, strain=curve(b))]
    )
    stiffness = np.array([share * ratio, 1 - share])
    apart = 0.5  # between the middles of the layers, whatever their thicknesses
    expected = -stiffness.prod() * apart * (b - a) / stiffness.sum() / sheet.bending_modulus
    found = sheet.spontaneous(1.0).curvature_along
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-13)
    assert sheet.flipped().spontaneous(1.0).curvature_along == pytest.approx(-expected, abs=1e-12)


def test_long_times_are_the_steady_state():
    sheet = film_laminate(soft_width=12.0, stiff_width=25.0)
    problem = Conduction(sheet, FixedTemperature(160.0), Insulated(), 25.0)
    history = spontaneous_history(sheet, problem.run(until=8 * problem.time_scale))
    limit = history.limit()
    uniform = sheet.spontaneous(160.0)
    for name in ("strain_along", "strain_across", "curvature_along", "curvature_across"):
        assert getattr(limit, name) == pytest.approx(float(getattr(uniform, name)), rel=1e-8)
        assert getattr(history.values, name)[-1] == pytest.approx(
            float(getattr(uniform, name)), rel=1e-6
        )
    (zero,) = history.curvature_zeros()
    assert abs(history.at(zero).curvature_along) < 1e-6 * abs(limit.curvature_along)
    assert history.curvature_zeros("across") == pytest.approx([zero], rel=1e-8)
    assert history.curvature_zeros("difference") == pytest.approx([zero], rel=1e-8)
    assert history.scaled_times[-1] == pytest.approx(8.0, rel=1e-12)


def test_films_meet_table_a_1():
    for film, width in (("stiff", 25.0), ("soft", 12.0)):
        curve = film_curve(film, width=width)
        rate = float(literature.value(f"ta1-{film}-strain-rate"))
        assert 100 * curve.contraction_rate(155.0, 165.0) == pytest.approx(rate, rel=1e-12)
        assert curve.transition == float(literature.value(f"ta1-{film}-transition"))
        assert curve(25.0) == 0.0
        for direction, name in (("along", "parallel"), ("across", "perpendicular")):
            layer = film_layer(film, curve, modulus=direction)
            printed = literature.value(f"ta1-{film}-modulus-{name}")
            assert layer.modulus == pytest.approx(printed.to("Pa"), rel=1e-12)
            assert layer.thickness == pytest.approx(30e-6, rel=1e-12)
    physical = film_layer("soft", curve, diffusivity="0.1 mm^2/s")
    assert physical.diffusivity == pytest.approx(1e-7, rel=1e-12)
    assert physical.physical


def test_the_soft_film_acts_faster_than_the_stiff_one():
    for arguments in film_fits(shapes=["logistic"], moduli=["across"]):
        soft = film_curve("soft", width=arguments["soft_width"])
        stiff = film_curve(
            "stiff", width=arguments["stiff_width"], transition=arguments["stiff_transition"]
        )
        assert soft(160.0) < stiff(160.0) < 0


def test_measured_curves_take_the_place_of_fits(tmp_path):
    # a filled slot in a copy of the data; in the repository itself it may be empty
    folder = tmp_path / "data"
    shutil.copytree(Descriptor().folder, folder)
    package = Descriptor(folder)
    resources = package.content["resources"]
    package.content["resources"] = [r for r in resources if r["provenance"] != "digitized"]
    package.write()
    with pytest.raises(DataAwaited, match="film-strains"):
        measured_film_curve("soft", folder=folder)
    points = tmp_path / "points.csv"
    points.write_text(
        "film,temperature,strain\nstiff,25,0\nstiff,200,-3\nsoft,25,0\nsoft,200,-30\n"
    )
    project = tmp_path / "project.json"
    pixels = [(10, 200, 0, 0), (210, 200, 200, 0), (10, 200, 0, 0), (10, 20, 0, -40)]
    marks = [{"px": a, "py": b, "dx": str(c), "dy": str(d), "dz": None} for a, b, c, d in pixels]
    axes = {"name": "XY", "type": "XYAxes", "isLogX": False, "isLogY": False}
    axes["calibrationPoints"] = marks
    project.write_text(json.dumps({"version": [4, 2], "axesColl": [axes]}))
    literature.register(
        slot="film-strains",
        file=points,
        project=project,
        tool="WebPlotDigitizer 5.2",
        uncertainty={"temperature": 1, "strain": 0.5},
        declare=None,
        folder=folder,
    )
    curves = {film: measured_film_curve(film, folder=folder) for film in ("soft", "stiff")}
    assert curves["soft"](200.0) == pytest.approx(-0.30, rel=1e-12)
    sheet = film_laminate(curves=curves)
    hot = sheet.spontaneous(200.0)
    mean = (17.0 * -0.03 + 2 * 3.2 * -0.30) / (17.0 + 2 * 3.2)
    assert hot.strain_along == pytest.approx(mean, rel=1e-10)
    with pytest.raises(InvalidInput, match="measured from 25 to 200 only"):
        sheet.spontaneous(210.0)
    with pytest.raises(InvalidInput, match="exclude each other"):
        film_laminate(curves=curves, soft_width=12.0)
    with pytest.raises(InvalidInput, match=r"lacks \['stiff'\]"):
        film_laminate(curves={"soft": curves["soft"]})


def test_other_stacks():
    sheet = film_laminate(("stiff", "soft"), soft_width=12.0, stiff_width=25.0)
    assert sheet.thickness == pytest.approx(60e-6, rel=1e-12)
    assert [layer.name for layer in sheet.layers] == ["stiff", "soft"]


@cache
def through(*layers):
    """Temperature in layers of the given thickness, conductivity and capacity on the hot plate."""
    stack = Laminate([Layer(h, 1.0, 0.5, conductivity=k, heat_capacity=c) for h, k, c in layers])
    problem = Conduction(stack, FixedTemperature(160.0), Insulated(), 25.0)
    return problem.run(until=6.0 * problem.time_scale)


def on_hot_plate(sheet):
    """Spontaneous history of a sheet on the hot plate of the thesis, the stack as given and turned."""
    for stack in (sheet, sheet.flipped()):
        layers = ((l.thickness, l.conductivity, l.heat_capacity) for l in stack.layers)
        yield spontaneous_history(stack, through(*layers))


@pytest.mark.parametrize("modulus", ["across", "along"])
@pytest.mark.parametrize(("soft", "stiff"), [(5.0, 20.0), (12.0, 25.0), (30.0, 60.0)])
def test_curvature_changes_sign_with_the_stiff_film_down_only(soft, stiff, modulus):
    sheet = film_laminate(soft_width=soft, stiff_width=stiff, modulus=modulus)
    down, up = on_hot_plate(sheet)
    assert down.curvature_zeros().size == 1 and up.curvature_zeros().size == 0
    for history in (down, up):
        strain = history.values.strain_along
        assert np.all(np.diff(strain) <= 1e-6 * np.abs(strain[-1]))
    last = float(down.limit().curvature_along)
    assert last > 0  # ends as a cup: the soft film, above, is the shorter one
    assert float(up.limit().curvature_along) == pytest.approx(-last, rel=1e-9)


def test_nearly_equal_final_strains_change_the_sign_the_other_way_too():
    # the sharpest transition of the soft film with a wide one of the stiff film
    sheet = film_laminate(soft_width=5.0, stiff_width=45.0)
    stiff, soft = (float(layer.strain(160.0)) for layer in (sheet.layers[0], sheet.layers[-1]))
    assert 1.0 < soft / stiff < 1.2
    down, up = on_hot_plate(sheet)
    assert down.curvature_zeros().size == 1 and up.curvature_zeros().size == 2


def test_even_heating_makes_one_film_flat():
    sheet = Laminate([Layer(1.0, 1.0, 0.5, strain=SigmoidCurve(0.2, 100.0, 10.0))])
    down, up = on_hot_plate(sheet)
    assert down.curvature_zeros().size == up.curvature_zeros().size == 0
    assert abs(float(down.limit().curvature_along)) < 1e-9
    times = np.geomspace(1e-3, 5.0, 50)
    strains = [
        spontaneous_history(h.laminate, h.temperature, times).values.strain_along
        for h in (down, up)
    ]
    assert strains[0] == pytest.approx(strains[1], abs=1e-9 * abs(strains[0][-1]))


def test_bad_input():
    sheet = Laminate([Layer(1.0, 1.0, 0.3, strain=LINE)])
    heat = heated(sheet, until=0.1)
    with pytest.raises(InvalidInput, match="other thicknesses"):
        spontaneous_history(Laminate([Layer(2.0, 1.0, 0.3)]), heat)
    with pytest.raises(InvalidInput, match="strictly increasing"):
        spontaneous_history(sheet, heat, times=[0.05, 0.05])
    with pytest.raises(InvalidInput, match="run it for longer"):
        spontaneous_history(sheet, heat, times=[0.05, 0.2])
    with pytest.raises(InvalidInput, match=r"what Conduction\.run returned"):
        spontaneous_history(sheet, 160.0)
    with pytest.raises(InvalidInput, match="pass a Laminate"):
        spontaneous_history(None, heat)
    history = spontaneous_history(sheet, heat)
    with pytest.raises(InvalidInput, match="one of 'along'"):
        history.curvature_zeros("radial")
    hot = TabulatedCurve([0.0, 0.9], [0.0, -0.1])
    with pytest.raises(InvalidInput, match=r"measured from 0 to 0\.9 only"):
        spontaneous_history(Laminate([Layer(1.0, 1.0, 0.3, strain=hot)]), heat)
    endless = Conduction(sheet, HeatFlux(1.0), Insulated(), 0.0).run(until=0.1)
    with pytest.raises(InvalidInput, match="no steady state"):
        spontaneous_history(sheet, endless).limit()
    with pytest.raises(InvalidInput, match="> 225"):
        film_curve("stiff", width=25.0, transition=200.0)
    with pytest.raises(InvalidInput, match="prints 170"):
        film_curve("soft", width=12.0, transition=180.0)
    with pytest.raises(InvalidInput, match="one of 'stiff', 'soft'"):
        film_curve("medium", width=12.0)
    with pytest.raises(InvalidInput, match="greater width"):
        film_curve("stiff", width=5.0)
    with pytest.raises(InvalidInput, match="bottom film first"):
        film_laminate("stiff", soft_width=12.0, stiff_width=25.0)
    with pytest.raises(InvalidInput, match="prints neither"):
        film_laminate(soft_width=12.0)


def test_a_table_measured_just_to_the_temperatures_of_the_run_is_enough():
    # the discrete heat equation overshoots by rounding and by a jump: no temperature leaves [0, 1]
    curve = TabulatedCurve([0.0, 0.5, 1.0], [0.0, -0.02, -0.1])
    sheet = Laminate([Layer(0.5, 1.0, 0.3, strain=curve)] * 2)
    values = spontaneous_history(sheet, heated(sheet, until=1.0)).values
    assert values.strain_along.min() >= -0.1
    assert values.strain_along.max() <= 0.0
