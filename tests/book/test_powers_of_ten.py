"""book/_ext/powers_of_ten.py: how numbers in sentences and tables are written."""

import runpy

import pytest


@pytest.fixture(scope="module")
def with_powers(root):
    return runpy.run_path(str(root / "book" / "_ext" / "powers_of_ten.py"))["with_powers"]


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("off by 2e-06.", "off by 2 × 10⁻⁶."),
        ("1e-13", "10⁻¹³"),
        ("1.0e-3, (-1.2e-04)", "1.0 × 10⁻³, (−1.2 × 10⁻⁴)"),
        ("2.04(3)e+12", "2.04(3) × 10¹²"),
        ("7.9 × 10⁻¹⁴ of it", "7.9 × 10⁻¹⁴ of it"),
    ],
)
def test_a_power_of_ten_is_set_and_stays_on_its_line(with_powers, said, meant):
    assert with_powers(said).replace("\N{NO-BREAK SPACE}", " ") == meant
    assert with_powers(said).count("\N{NO-BREAK SPACE}") == 2 * meant.count("×")
    assert with_powers(with_powers(said)) == with_powers(said)


@pytest.mark.parametrize(
    "text", ["Fig. T3.3e-4", "v1.2e5.x", "0x1e-3f", "a2e3", "3 × 10 mm", "2e-3b"]
)
def test_what_is_no_such_number_is_left_alone(with_powers, text):
    assert with_powers(text) == text
