"""book/_ext/numerals.py: how numbers in sentences and tables are written."""

import runpy

import pytest
from docutils import nodes


@pytest.fixture(scope="module")
def extension(root):
    return runpy.run_path(str(root / "book" / "_ext" / "numerals.py"))


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("off by 2e-06.", "off by 2_×_10⁻⁶."),
        ("1e-13", "10⁻¹³"),
        ("1.0e-3, (-1.2e-04)", "1.0_×_10⁻³, (−1.2_×_10⁻⁴)"),
        ("2.04(3)e+12", "2.04(3)_×_10¹²"),
        ("7.9 × 10⁻¹⁴ of it", "7.9_×_10⁻¹⁴ of it"),
        ("-0.33 (1.90)", "−0.33 (1.90)"),
        ("20.9 % of 90 μm", "20.9_% of 90_μm"),
        ("-", "–"),
    ],
)
def test_a_number_is_set_and_stays_on_its_line(extension, said, meant):
    numerals = extension["numerals"]
    assert numerals(said) == meant.replace("_", "\N{NO-BREAK SPACE}")
    assert numerals(numerals(said)) == numerals(said)


@pytest.mark.parametrize(
    "text",
    ["Fig. T3.3e-4", "v1.2e5.x", "0x1e-3f", "a2e3", "3 × 10 mm/s", "2e-3b", "3-4", "x=-1", "a - b", "5 men"],
)  # fmt: skip
def test_what_is_no_such_number_is_left_alone(extension, text):
    assert extension["numerals"](text) == text


def test_code_and_links_are_kept_and_a_hyphen_behind_a_link_joins(extension):
    paragraph = nodes.paragraph(
        "", "", nodes.literal("", "1e-3"), nodes.Text("-5 and 1e-3"), nodes.reference("", "-1e-3")
    )
    page = nodes.section("", paragraph, nodes.literal_block("", "-1e-3"))
    extension["_apply"](None, page, "page")
    assert [child.astext() for child in paragraph] == ["1e-3", "-5 and 10⁻³", "-1e-3"]
    assert page[1].astext() == "-1e-3"
