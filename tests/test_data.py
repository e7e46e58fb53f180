"""The stored data themselves: described, sound, traceable, and recomputed where derived."""

import re
from pathlib import Path

import mpmath
import numpy as np
import pint
import pytest

from lissome import literature
from lissome._datapackage import Descriptor

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "data"
# Scales of a problem that stand where a unit would: they mean nothing to a table of units.
SCALES = {"L", "1/L", "L/(2 pi)", "2 pi/L", "B/L^2", "B/L^3", "D w/L", "D w/L^2", "decay time"}


def facts():
    """All rows of the tables of single numbers, as (table, row)."""
    for name in literature.tables():
        table = literature.load(name)
        if {"id", "value", "unit", "reference"} <= set(table.columns):
            for record in table.frame.to_dict("records"):
                yield name, record


def test_frictionless_and_the_loader_agree_that_all_is_sound():
    assert literature.check() == literature.tables()


def test_every_table_is_described_and_every_file_belongs_to_a_table():
    package = Descriptor()
    assert package.folder == DATA
    paths = {resource["path"] for resource in package.resources.values()}
    assert {path.name for path in DATA.glob("*.csv")} == paths
    for resource in package.resources.values():
        assert resource["provenance"] in ("published", "derived", "digitized")
        assert resource["sources"]
        assert resource["licenses"]
        assert resource["description"]
        assert all(field["type"] in ("string", "number") for field in resource["schema"]["fields"])
        if resource["provenance"] == "derived":
            assert resource["code"].startswith("column") or (ROOT / resource["code"]).is_file()


def test_ids_are_unique_over_all_tables():
    ids = [row["id"] for _, row in facts()]
    assert len(ids) == len(set(ids)) > 150


def test_every_unit_is_known():
    registry = pint.UnitRegistry()
    for name, row in facts():
        unit = row["unit"]
        if unit == "":
            assert "unit" in row["note"], (name, row["id"])
        elif unit not in SCALES:
            registry.parse_units(unit)  # raises for an unknown unit
    for name in literature.tables():
        for unit in literature.load(name).units.values():
            assert unit in SCALES or registry.parse_units(unit) is not None


def test_every_reference_is_in_the_bibliography():
    text = (ROOT / "book" / "references.bib").read_text("utf-8")
    keys = set(re.findall(r"^@\w+\{([^,\s]+),", text, re.M))
    references = {row["reference"] for _, row in facts()}
    references |= set(literature.load("reported-statements")["reference"])
    assert references <= keys


def test_no_cell_tells_of_the_machine_it_was_made_on():
    for path in [*DATA.rglob("*.csv"), *DATA.rglob("*.json")]:
        text = path.read_text("utf-8")
        assert not re.search(
            r"/tmp|/work|/home|thesis\.md|https?://(?!doi\.org|creativecommons)", text
        )


def test_printed_characters_hold_the_stored_number():
    """The number is the first one of `printed`, or what its expression evaluates to."""
    expressions = {
        **{"sqrt(3)": 3**0.5, "pi^2/4": np.pi**2 / 4, "pi/4": np.pi / 4, "2 pi": 2 * np.pi},
        **{"1/(2 pi)": 0.5 / np.pi, "pi/sqrt(3) = 1.8138": np.pi / 3**0.5, "1/360": 1 / 360},
        **{"-1/181440": -1 / 181440, "2/v^2": 2.0, "1/10 s": 0.1, "10^-7": 1e-7},
        **{"no leaping": 0.0, "2 cm": 20.0, "approaching 10^2 mm/s": 100.0},
    }
    for name, row in facts():
        printed = row["printed"]
        if printed in expressions:
            assert row["value"] == pytest.approx(expressions[printed], rel=1e-15), (name, row["id"])
            continue
        cleaned = re.sub(r"\*10\^(-?\d+)", r"e\1", printed)
        numbers = [float(x) for x in re.findall(r"(?<![\d.])-?\d+\.?\d*(?:e-?\d+)?", cleaned)]
        # a range such as 0.6-4 reads as 0.6 and -4
        assert row["value"] in numbers or -row["value"] in numbers, (name, row["id"], printed)


def test_contradictions_of_the_thesis_are_kept_side_by_side():
    assert float(literature.value("c3-beam-thickness")) == 50.0
    assert float(literature.value("c3-film-thickness")) == 15.0
    assert float(literature.value("t31-depth")) != float(literature.value("c3-penetration-depth"))
    assert float(literature.value("ta1-crosslink-temperature")) == 100.0
    assert float(literature.value("c5-crosslink-temperature")) == 150.0


def test_phi_of_audoly_and_neukirch_is_recomputed():
    """The closed form with other means: its power series for small, mpmath for all arguments."""
    table = literature.load("audoly-neukirch-phi")
    with mpmath.workdps(50):

        def phi(v):
            s = mpmath.sqrt(abs(v) / 2)
            bracket = mpmath.mpf(1) / 2 - (mpmath.cosh(s) - mpmath.cos(s)) / (
                s * (mpmath.sinh(s) + mpmath.sin(s))
            )
            return 4 * bracket / v**2

        for v, stored in zip(table["v"], table["phi"], strict=True):
            exact = phi(mpmath.mpf(v)) if v else mpmath.limit(phi, 0, direction=1)
            assert stored == pytest.approx(float(exact), rel=1e-13 if v else 1e-9)
    small = table["v"] <= 0.5
    series = (
        float(literature.value("an-phi-zero"))
        + float(literature.value("an-phi-second")) * table["v"][small] ** 2
    )
    np.testing.assert_allclose(table["phi"][small], series, rtol=1e-6)
    large = table["v"] >= 5000
    limit = float(literature.value("an-phi-large")) / table["v"][large] ** 2
    np.testing.assert_allclose(table["phi"][large], limit, rtol=0.05)
    np.testing.assert_allclose(table["phi_sano_wada"], 1 / (360 + table["v"] ** 2 / 2), rtol=1e-14)
    np.testing.assert_allclose(table["large_v"][1:], 2 / table["v"][1:] ** 2, rtol=1e-14)
    assert np.isnan(table["large_v"][0])


def test_the_buckling_constants_follow_from_bessel_functions():
    """y'' + lambda x^4 y = 0 with y'(0) = y(1) = 0 is solved by J_{-1/6}(sqrt(lambda) x^3/3)."""
    root = float(mpmath.findroot(lambda x: mpmath.besselj(-mpmath.mpf(1) / 6, x), 2.1))
    eigenvalue = (3 * root) ** 2
    assert float(literature.value("an-eigenvalue")) == pytest.approx(eigenvalue, abs=5e-5)
    assert float(literature.value("an-load-extensible")) == pytest.approx(
        (8 * eigenvalue) ** 0.5, abs=5e-3
    )
    column = float(mpmath.findroot(lambda x: mpmath.besselj(-mpmath.mpf(1) / 3, x), 1.9))
    assert float(literature.value("self-buckling-load")) == pytest.approx(
        9 / 4 * column**2, abs=5e-5
    )
    assert float(literature.value("thesis-distributed-load")) == pytest.approx(
        9 / 4 * column**2, abs=5e-4
    )
