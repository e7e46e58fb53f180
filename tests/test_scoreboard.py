"""Numbers in print, judges, records and the board."""

import csv
import io
import json
import math
import re
import subprocess
import sys
from decimal import Decimal

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lissome import literature, scoreboard
from lissome._digits import rounded, with_uncertainty
from lissome.errors import DataError, InvalidInput
from lissome.judges import JUDGES, Outcome, rods
from lissome.judges import _core as core
from lissome.judges._core import for_every_reading, order_of
from lissome.judges._core import judge as make_judge
from lissome.scoreboard import Verdict

BEST = {"value": 65.13, "spread": 0.2}


@pytest.fixture(autouse=True)
def by_hand(monkeypatch):
    """Tests run as a reader at the keyboard, unless they say otherwise."""
    monkeypatch.delenv("LISSOME_SCOREBOARD", raising=False)
    monkeypatch.delenv("LISSOME_PAGE", raising=False)


@pytest.fixture
def building(tmp_path, monkeypatch):
    """As during a build of the book."""
    folder = tmp_path / "scoreboard"
    monkeypatch.setenv("LISSOME_SCOREBOARD", str(folder))
    monkeypatch.setenv("LISSOME_PAGE", "3-photomechanical-beams")
    return folder


class TestDigits:
    @pytest.mark.parametrize(
        ("value", "uncertainty", "text"),
        [
            (65.1312, 0.04, "65.13(4)"),
            (65.1312, 0.014, "65.131(14)"),
            (65.1312, 0.096, "65.13(10)"),
            (-0.99812, 0.002, "-0.998(2)"),
            (2.0417e-4, 1.3e-6, "2.042(13)e-4"),
            (1119.28, 30, "1.12(3)e3"),
            (7, 0.5, "7.0(5)"),
            (0.0003, 0.02, "0.00(2)"),
            (-0.0003, 0.02, "0.00(2)"),
            (0.5, 0, "0.5"),
            (100, 0, "100"),
            (1e-7, 0, "1e-7"),
            (1 / 3, 1e-30, "0.33333333333333330(4)"),
        ],
    )
    def test_examples(self, value, uncertainty, text):
        assert with_uncertainty(value, uncertainty) == text

    def test_styles(self):
        assert with_uncertainty(2.04e-4, 3e-6, "unicode") == "2.04(3) × 10⁻⁴"
        assert with_uncertainty(2.04e-4, 3e-6, "latex") == r"2.04(3) \times 10^{-4}"
        with pytest.raises(InvalidInput, match="`style`"):
            with_uncertainty(1, 1, "html")

    @given(
        st.floats(min_value=-1e12, max_value=1e12),
        st.floats(min_value=1e-12, max_value=1e12),
    )
    def test_what_is_shown_is_right_and_ends_where_the_uncertainty_begins(self, value, spread):
        spread = max(spread, abs(value) * 1e-15)
        shown = Decimal(rounded(value, spread))
        unit = Decimal(1).scaleb(shown.as_tuple().exponent)
        assert abs(shown - Decimal(repr(value))) <= unit / 2
        # one digit of the uncertainty is kept, two if it begins with 1
        assert unit <= Decimal(spread) * Decimal("1.06")
        assert unit * Decimal("9.51") >= Decimal(spread) or unit * 20 >= Decimal(spread)
        with_it = with_uncertainty(value, spread)
        assert Decimal(re.sub(r"\(.*\)", "", with_it)) == shown

    @given(st.floats(allow_nan=False, allow_infinity=False))
    def test_exact_numbers_are_shown_in_full(self, value):
        assert float(rounded(value, 0)) == value

    @pytest.mark.parametrize("bad", [math.nan, math.inf, "1", None, True])
    def test_bad_numbers_are_refused(self, bad):
        with pytest.raises(InvalidInput, match="`value`"):
            rounded(bad, 1)
        with pytest.raises(InvalidInput, match="`uncertainty`"):
            rounded(1, bad)
        with pytest.raises(InvalidInput, match="`uncertainty`"):
            rounded(1, -1)


def ring(deviation):
    intensities = np.array([0.01, 0.1, 1.0, 10.0])
    return {"intensities": intensities, "deviations": deviation(intensities)}


DISTANCE = {"value": 1e-5, "overcurvatures": [1.0, 2.0, 2.9]}
SNAP = {"value": 0.5, "continuum": 0.5001, "exponent": 0.51, "before": 1.0, "after": 0.5}
MOEBIUS = {"value": 0.5 + 1e-8, "inflections": 1, "asymmetry": 1e-10, "eigenvalue": 0.3}
BANDS = {
    "half_widths": [0.1, 0.5, 1.5],
    "energies": [1e-5, -1e-6, 2e-5],
    "strains": [2e-3, 1e-3, 5e-3],
}
NO_SNAP = {"twists": [0.0, 1.0], "eigenvalues": [1.0, 0.1]}

# A case that each judge accepts, and changes of it with the outcome that they must have.
WINDOW = {
    "intensities": [3, 5, 10],
    "lower": [60, 50, 40],
    "upper": [70, 75, 80],
    "resolution": 0.1,
    "frequencies": [0.1, 0.2, 0.3],
    "angle": 65,
}
SIGNS = {
    "ratios": [7.0, 1.2],
    "changes_down": [1, 1],
    "changes_up": [0, 0],
    "strain_monotone": [True, True],
    "strain_apart": [0.1, 0.3],
    "limit_mismatch": 1e-12,
}
ORIENTATION = {
    "ratios": [0.05, 0.3],
    "inverts_down": [True, True],
    "inverts_up": [False, False],
    "runs_down": [True, False],
    "runs_predicted": [True, False],
    "runs_up": [False],
}
DOME = {"lifts": [0.01, 0.05], "inverts": True, "cone_errors": [0.1, 0.05], "cone_limit": 0.003}
STACKS = {
    "ratios": [0.03, 0.05],
    "base": [100.0, 200.0],
    "two_stiff": [50.0, 150.0],
    "thin": [20.0, 20.0],
    "thick": [90.0, 90.0],
}
SPEED = {
    "value": 1e-12,
    "angles": np.linspace(0.1, 1, 10),
    "speeds": np.linspace(0.1, 1, 10) / 6,
    "mirrored_speeds": -np.linspace(0.1, 1, 10) / 6,
    "increasing_to": 1.0,
    "slope": 0.16,
    "breakdown": 1.2,
}
CYCLE = {
    "value": 2.5,
    "return_distance": 1e-8,
    "crest_drift": [0.2, 0.2],
    "snaps_per_period": 2,
    "side_difference": 1e-9,
}
CENTRED = {
    "widths": [0.1, 0.2],
    "curvature_before_light": [-3.0, -3.0],
    "curvature_before_snap": [0.4, 0.1],
    "snaps_down": [True, True],
}
OFF = {
    "widths": [0.1, 0.2],
    "crest_drift": [0.1, 0.1],
    "crest_monotone": [True, True],
    "snaps_down": [True, True],
    "change_after": [0.001, 0.001],
}
PORTRAIT = {
    "widths": [0.1, 0.2],
    "critical_centred": [3.0, 4.0],
    "slopes": [-1.0, -2.0],
    "no_snap_at_large_offset": [True, True],
}
EXPONENT = {
    "value": -1.0,
    "light": [2, 20, 40, 80, 160],
    "slopes": [-1.5, -1.01, -1.005, -1.002, -1.001],
    "products": [5.0, 4.2, 4.1, 4.05, 4.025],
}
FACES = {
    "angles": [60, 65],
    "planar": [0.3, 0.4],
    "homeotropic": [0.2, 0.3],
    "planar_window": [40, 80],
    "homeotropic_window": [50, 75],
}
REVERSE = {"crest_drift": [-0.2, -0.2], "orbit_difference": 0.1, "period_difference": 0.01}
ERRORS = {
    "value": 1e-8,
    "gradient": 1e-8,
    "hessian": 1e-8,
    "exact_gradient": 1e-14,
    "exact_hessian": 1e-14,
    "states": 100,
}
BALLOON = {
    "equilibria": 3,
    "pressure": 0.9,
    "radius_before": 1.4,
    "radius_after": 4.2,
    "largest": 4.2,
}
FVK = {"stretching_equal": True, "bending_equal": True, "plane_stress": True}
TRIPLE = {"value": 2.85, "exact": 2.8501, "stable_to": 4.0}
OFFSET = {
    "value": 0.9,
    "strains": [300.0, 3000.0],
    "offsets": [0.0, 0.1, 0.2, 0.3],
    "to_edge": [9.0, 8.0, 5.0, 1.0, 20.0, 19.0, 15.0, 9.0],
    "to_corner": [9.0, 8.1, 5.1, 2.0, 20.0, 19.0, 14.0, 8.0],
}
THICKNESS = {
    "value": 92.2,
    "strains": [120.0, 300.0, 1000.0],
    "curvatures": [1.0, 90.0, 700.0],
    "slopes": [9.0, 3.0, 1.0],
    "thicknesses": [0.005, 0.01, 0.02, 0.03],
    "collapse": 1e-8,
}
ENERGY = {
    **{name: fact for name, fact in THICKNESS.items() if name != "curvatures"},
    "crossing": 600.0,
}
RELEASED = {
    "value": 3e-4,
    "stack": [1.7e-4, 2.3e-4],
    "fits": 10,
    "thicknesses": [0.01, 0.02],
    "strains": [0.03, 0.06],
}
LEGS = {
    "heights": [5.0, 20.0],
    "tilts_legs": [27.0, 7.0],
    "tilts_plain": [6.0, 1.4],
    "speeds": [0.35, 0.63],
    "differences": [3.1, 0.9],
    "side": 7.0,
    "bound": 130.0,
}
HEIGHTS = {
    "offsets": [0.0, 0.1, 0.2, 0.3],
    "measured": [20.0, 4.0, 1.5, 0.0],
    "bounds": [130.0, 110.0, 80.0, 40.0],
}
HOLDS, FAILS, OPEN = Verdict.REPRODUCED, Verdict.DIFFERS, Verdict.UNDETERMINED
AWAITS = Verdict.AWAITS
CASES = [
    ("lambda-typical", {"value": 2.9 * 1.019}, {"value": 2.9 * 0.979}, FAILS),
    ("lambda-typical", {"value": -2.9}, {"value": 2.9 * 1.021}, FAILS),
    (
        "ring-steady-speed",
        {"intensities": [0.01, 0.1, 1, 10], "changes": [1e-9, 1e-9, 1e-4, 9e-4]},
        {"changes": [1e-9, 1e-9, 1e-4, 1.1e-3]},
        FAILS,
    ),
    ("ring-speed-symmetry", SPEED, {"value": 2e-8}, FAILS),
    ("ring-speed-symmetry", SPEED, {"mirrored_speeds": np.linspace(0.1, 1, 10) / 6}, FAILS),
    ("ring-speed-symmetry", SPEED, {"speeds": -np.linspace(0.1, 1, 10) / 6}, FAILS),
    ("ring-speed-intensity", ring(lambda x: 0.004 * x), ring(lambda x: 0.006 * x), FAILS),
    ("ring-speed-intensity", ring(lambda x: 0.004 * x), ring(lambda x: 0.01 * x**0.5), FAILS),
    (
        "ring-curvature-profile",
        {"intensities": [0.01, 0.1, 1, 10], "differences": [0.001, 0.01, 0.1, 0.5]},
        {"differences": [0.01, 0.02, 0.1, 0.5]},
        FAILS,
    ),
    ("strip-cycle", CYCLE, {"return_distance": 2e-6}, FAILS),
    ("strip-cycle", CYCLE, {"crest_drift": [0.2, -0.2]}, FAILS),
    ("strip-cycle", CYCLE, {"side_difference": 1e-3}, FAILS),
    ("strip-cycle", CYCLE, {"snaps_per_period": 4}, FAILS),
    (
        "strip-eigenvalue",
        {"value": 1e-4, "exponents": [0.46, 0.54], "after": [3.0, 4.0]},
        {"exponents": [0.5, 1.0]},
        FAILS,
    ),
    (
        "strip-eigenvalue",
        {"value": 1e-4, "exponents": [0.46, 0.54], "after": [3.0, 4.0]},
        {"after": [3.0, -1.0]},
        FAILS,
    ),
    ("strip-window", WINDOW, {"lower": [60, 50, 55]}, FAILS),
    ("strip-window", WINDOW, {"resolution": 0.2}, FAILS),
    ("strip-window", WINDOW, {"frequencies": [0.1, 0.3, 0.2]}, FAILS),
    ("strip-best-angle-095", BEST, {"value": 64.5}, FAILS),
    ("strip-best-angle-095", BEST, {"spread": 1.5}, FAILS),
    ("strip-best-angle-0957", {"value": 65.9, "spread": 0.1}, {"value": 66.3}, FAILS),
    ("strip-reverse", REVERSE, {"orbit_difference": 1e-12}, FAILS),
    ("strip-reverse", REVERSE, {"crest_drift": [0.2, 0.2]}, FAILS),
    ("strip-reverse", REVERSE, {"period_difference": 0.2}, FAILS),
    ("strip-faces", FACES, {"homeotropic": [0.2, 0.5]}, FAILS),
    ("strip-faces", FACES, {"homeotropic_window": [30, 75]}, FAILS),
    ("snap-centred", CENTRED, {"curvature_before_snap": [0.4, -0.1]}, OPEN),
    ("snap-centred", CENTRED, {"curvature_before_snap": [-0.4, -0.1]}, FAILS),
    ("snap-centred", CENTRED, {"snaps_down": [True, False]}, OPEN),
    ("snap-offcentre", OFF, {"crest_drift": [0.1, -0.1]}, OPEN),
    ("snap-offcentre", OFF, {"change_after": [0.1, 0.1]}, FAILS),
    ("snap-phase-portrait", PORTRAIT, {"slopes": [1.0, -1.0]}, OPEN),
    ("snap-phase-portrait", PORTRAIT, {"slopes": [1.0, 1.0]}, FAILS),
    ("snap-time-exponent", EXPONENT, {"slopes": [-1.5, -1.03, -1, -1, -1]}, FAILS),
    ("snap-time-exponent", EXPONENT, {"products": [5, 4.2, 4.1, 4.0, 3.8]}, FAILS),
    (
        "psi-function",
        {"difference": 1e-15, "at_zero": 0.0, "at_two": 0.0},
        {"difference": 1e-10},
        FAILS,
    ),
    ("derivative-errors", ERRORS, {"value": 1e-3, "hessian": 1e-3}, FAILS),
    ("derivative-errors", ERRORS, {"states": 10}, FAILS),
    ("balloon-three-radii", BALLOON, {"equilibria": 1}, FAILS),
    ("balloon-three-radii", BALLOON, {"largest": 5.0}, FAILS),
    ("balloon-three-radii", BALLOON, {"pressure": 1.1}, FAILS),
    (
        "pitchfork-table",
        {"derivatives_equal": [True, True], "stability_equal": [True, True]},
        {"stability_equal": [True, False]},
        FAILS,
    ),
    ("kirchhoff-balance", {"residual": 1e-14}, {"residual": 1e-6}, FAILS),
    ("beam-reduction", {"equal": True}, {"equal": False}, FAILS),
    ("fvk-energy", FVK, {"bending_equal": False}, FAILS),
    ("fvk-energy", FVK, {"plane_stress": False}, FAILS),
    ("buckling-point", {"value": np.pi**2 / 4, "order": 2.01}, {"value": 2.46741}, FAILS),
    ("buckling-point", {"value": np.pi**2 / 4, "order": 2.01}, {"order": 1.0}, FAILS),
    ("buckling-distributed", {"value": 7.8373474, "order": 2.0}, {"value": 7.8374}, FAILS),
    (
        "buckling-postcritical",
        {"value": 1e-7, "segment_clamp": 0.01, "node_clamp": 1e-4},
        {"value": 1e-5},
        FAILS,
    ),
    ("slinky-onset", {"value": 1.5, "exact": 1.5005}, {"exact": 1.502}, FAILS),
    ("slinky-triple", TRIPLE, {"value": 2.9, "exact": 2.9}, FAILS),
    ("slinky-triple", TRIPLE, {"exact": 2.853}, FAILS),
    ("slinky-triple", TRIPLE, {"stable_to": 2.0}, FAILS),
    ("slinky-distance", DISTANCE, {"value": 2e-3}, FAILS),
    ("slinky-distance", DISTANCE, {"overcurvatures": [1.5, 2.9]}, FAILS),
    ("equilibrium-time", {"value": 1e-3}, {"value": 0.2}, FAILS),
    ("ribbon-snap-narrow", SNAP, {"continuum": 0.503}, FAILS),
    ("ribbon-snap-narrow", SNAP, {"exponent": 1.0}, FAILS),
    ("ribbon-snap-narrow", SNAP, {"after": -0.1}, FAILS),
    ("ribbon-nosnap-wide", NO_SNAP, {"eigenvalues": [1.0, -0.1]}, FAILS),
    ("moebius-shape", MOEBIUS, {"value": 0.5001}, FAILS),
    ("moebius-shape", MOEBIUS, {"inflections": 3}, FAILS),
    ("moebius-shape", MOEBIUS, {"asymmetry": 1e-6}, FAILS),
    ("moebius-shape", MOEBIUS, {"eigenvalue": -1.0}, FAILS),
    ("moebius-strains", BANDS, {"energies": [1e-5, 1e-6, 2e-4]}, FAILS),
    ("moebius-strains", BANDS, {"strains": [2e-3, 1e-2, 2e-2]}, FAILS),
    ("moebius-strains", BANDS, {"half_widths": [0.1, 0.5, 1.0]}, FAILS),
    ("ribbon-threshold", {"thresholds": [1.23, 1.25]}, {"thresholds": [1.27, 1.3]}, FAILS),
    ("ribbon-threshold", {"thresholds": [1.23, 1.25]}, {"thresholds": [1.2, 1.25]}, OPEN),
    (
        "laminate-uniform",
        {"stretching_equal": True, "bending_equal": True},
        {"stretching_equal": False},
        FAILS,
    ),
    ("laminate-sign-change", SIGNS, {"changes_up": [0, 2]}, OPEN),
    ("laminate-sign-change", SIGNS, {"changes_down": [0, 2]}, FAILS),
    ("laminate-sign-change", SIGNS, {"strain_monotone": [True, False]}, FAILS),
    ("laminate-sign-change", SIGNS, {"limit_mismatch": 1e-3}, FAILS),
    ("sheet-snap-orientation", ORIENTATION, {"inverts_down": [True, False]}, OPEN),
    ("sheet-snap-orientation", ORIENTATION, {"inverts_down": [False, False]}, FAILS),
    ("sheet-snap-orientation", ORIENTATION, {"inverts_up": [True, False]}, FAILS),
    ("sheet-snap-orientation", ORIENTATION, {"runs_up": [True]}, FAILS),
    ("sheet-snap-orientation", ORIENTATION, {"runs_down": [False, False]}, FAILS),
    ("dome-first-up", DOME, {"lifts": [0.01, -0.05]}, FAILS),
    ("dome-first-up", DOME, {"inverts": False}, FAILS),
    ("dome-first-up", DOME, {"cone_errors": [0.1, 0.2]}, FAILS),
    ("dome-first-up", DOME, {"cone_limit": 0.1}, FAILS),
    ("laminate-variants", STACKS, {"thick": [90.0, 0.0]}, OPEN),
    ("laminate-variants", STACKS, {"thick": [0.0, 0.0]}, FAILS),
    ("laminate-variants", STACKS, {"two_stiff": [150.0, 250.0]}, FAILS),
    ("laminate-variants", STACKS, {"thin": [20.0, 250.0]}, OPEN),
    (
        "jump-height",
        {"value": 0.199, "modulus": 900.0, "printed_modulus": 1053.0},
        {"value": 0.19},
        FAILS,
    ),
    ("offset-critical-curvature", OFFSET, {"to_edge": [9, 8, 5, 1, 20, 19, 15, 16]}, FAILS),
    ("offset-critical-curvature", OFFSET, {"to_corner": [9, 9, 5, 1, 20, 19, 15, 9]}, FAILS),
    ("offset-energy", OFFSET, {"to_corner": [9, 9, 5, 1, 20, 19, 15, 9]}, FAILS),
    ("offset-height-measured", HEIGHTS, {"measured": [20, 25, 1.5, 0]}, FAILS),
    ("offset-height-measured", HEIGHTS, {"bounds": [130, 110, 80, 90]}, FAILS),
    ("offset-height-measured", HEIGHTS, {"bounds": [130, 3, 2, 1]}, FAILS),
    ("thickness-critical-curvature", THICKNESS, {"slopes": [9, 3, 0.4]}, FAILS),
    ("thickness-critical-curvature", THICKNESS, {"curvatures": [1, 90, 80]}, FAILS),
    ("thickness-critical-curvature", THICKNESS, {"collapse": 1e-4}, FAILS),
    ("thickness-energy", ENERGY, {"slopes": [1, 3, 4]}, FAILS),
    ("thickness-energy", ENERGY, {"slopes": [3, 4, 5]}, FAILS),
    ("thickness-energy", ENERGY, {"slopes": [3, 1, 3]}, FAILS),
    ("thickness-energy", ENERGY, {"collapse": 1e-4}, FAILS),
    ("released-energy", RELEASED, {"stack": [1e-4, 4e-4]}, OPEN),
    ("released-energy", RELEASED, {"stack": [1e-5, 4e-5]}, FAILS),
    ("jump-height-size", {"sizes": [1, 4], "heights": [0.1, 0.1]}, {"heights": [0.1, 0.2]}, FAILS),
    ("directional-leap", LEGS, {"tilts_plain": [28.0, 1.4]}, FAILS),
    ("directional-leap", LEGS, {"differences": [8.0, 1.0]}, FAILS),
    ("directional-leap", LEGS, {"bound": 10.0}, FAILS),
]

# Claims that also compare with measured points that nobody has published as numbers.
AWAITING = {"slinky-distance", "ribbon-snap-narrow", "ribbon-nosnap-wide", "moebius-strains"}


def judged(claim, facts, **more):
    if JUDGES[claim].has_value:
        more.setdefault("uncertainty", 1e-9)
    return scoreboard.record(claim, as_printed=facts, **more)


class TestJudges:
    @pytest.mark.parametrize(("claim", "facts", "change", "verdict"), CASES)
    def test_facts_decide(self, claim, facts, change, verdict):
        good = judged(claim, facts)
        assert good.verdict is (AWAITS if claim in AWAITING else HOLDS), good.why
        bad = judged(claim, {**facts, **change})
        assert bad.verdict is verdict, bad.why
        assert bad.why != good.why

    @pytest.mark.parametrize(("claim", "facts", "change", "verdict"), CASES)
    def test_the_reason_is_written_in_sentences(self, claim, facts, change, verdict):
        for result in (judged(claim, facts), judged(claim, {**facts, **change}, remark="a remark")):
            assert result.why
            for sentence in re.split(r"(?<=[.?]) (?=[A-Z|])", result.why):
                assert sentence.endswith("."), sentence
                # a word begins with a capital; a symbol does not
                assert not re.match(r"[a-z]+\b", sentence), sentence
                assert not re.search(r"[{}]|;|e[-+]?\d| -\d", re.sub(r"; (?=\w)", "", sentence))
            assert "A remark." in result.why or "remark" not in result.remark

    @pytest.mark.parametrize(
        ("value", "digits", "text"),
        [
            (7.94e-14, 2, "7.9 × 10⁻¹⁴"),
            (1e-6, 6, "10⁻⁶"),
            (-1.0, 6, "−1"),
            (0.00046, 2, "4.6 × 10⁻⁴"),
            (2.4e7, 1, "2 × 10⁷"),
            (692.4, 2, "690"),
            (0.0, 2, "0"),
            (9.96, 2, "10"),
        ],
    )
    def test_numbers_for_the_reader(self, value, digits, text):
        assert core.short(value, digits) == text

    def test_lists_for_the_reader(self):
        assert core.listed([0.1]) == "0.1"
        assert core.listed([1, 2, 3], unit="°") == "1, 2 and 3°"
        assert core.listed(range(10)) == "0, 1, 2, ..., 7, 8 and 9"

    def test_every_claim_of_these_chapters_has_a_judge_and_every_judge_a_case(self):
        wanted = {id for id, claim in scoreboard.claims().items() if claim.chapter in "123A"}
        assert wanted <= set(JUDGES)
        assert {case[0] for case in CASES} == set(JUDGES)

    def test_every_judge_has_a_claim(self):
        assert set(JUDGES) <= set(scoreboard.claims())

    @pytest.mark.parametrize("claim", sorted(JUDGES))
    def test_needs_are_described_and_missing_ones_refused(self, claim):
        text = scoreboard.needs(claim)
        for name, need in JUDGES[claim].needs.items():
            assert name in text
            assert need.meaning
        with pytest.raises(InvalidInput, match="lacks") as caught:
            judged(claim, {})
        assert text in str(caught.value)

    @pytest.mark.parametrize(("claim", "facts"), {case[0]: case[1] for case in CASES}.items())
    def test_numbers_that_are_not_numbers_are_refused(self, claim, facts):
        for name, need in JUDGES[claim].needs.items():
            if name not in facts:
                continue
            bad = {"number": math.nan, "numbers": [1, math.nan], "flags": [1, 0], "flag": 1}
            with pytest.raises(InvalidInput, match=re.escape(f"as_printed[{name!r}]")):
                judged(claim, {**facts, name: bad[need.kind]})

    def test_lists_must_belong_together(self):
        with pytest.raises(InvalidInput, match="different lengths"):
            judged("strip-window", {**WINDOW, "lower": [1, 2]})
        with pytest.raises(InvalidInput, match="empty"):
            judged("strip-window", {**WINDOW, "lower": []})

    def test_the_claim_says_what_has_to_be_covered(self):
        facts = {"intensities": [0.1, 1, 10], "changes": [0, 0, 0]}
        with pytest.raises(InvalidInput, match=r"lacks 0\.01"):
            judged("ring-steady-speed", facts)
        with pytest.raises(InvalidInput, match="three entries"):
            judged("snap-time-exponent", {**EXPONENT, "light": [1, 2, 3, 4, 50]})

    @pytest.mark.parametrize(
        ("claim", "facts", "message"),
        [
            ("offset-energy", {**OFFSET, "strains": [300.0]}, "two or more"),
            ("offset-energy", {**OFFSET, "offsets": [0.0, 0.1, 0.3, 0.35]}, "steps"),
            ("offset-energy", {**OFFSET, "to_edge": [3.0, 2.0]}, "2 entries"),
            ("offset-height-measured", {**HEIGHTS, "bounds": [3.0, 2.0]}, "no multiple"),
            ("offset-height-measured", {**HEIGHTS, "bounds": [3, 2, 1, 0]}, "positive"),
            ("thickness-energy", {**ENERGY, "thicknesses": [0.01, 0.02, 0.03]}, "four or more"),
            ("jump-height-size", {"sizes": [1, 1.5], "heights": [1, 1]}, "no test"),
        ],
    )
    def test_facts_that_do_not_cover_the_claim_are_refused(self, claim, facts, message):
        with pytest.raises(InvalidInput, match=message):
            judged(claim, facts)

    @pytest.mark.parametrize(
        ("claim", "facts", "uncertainty"),
        [
            ("strip-best-angle-0957", {"value": 65.7, "spread": 0.1}, 0.6),
            ("buckling-point", {"value": np.pi**2 / 4, "order": 2.0}, 1e-5),
            ("slinky-triple", TRIPLE, 2e-3),
            ("jump-height", {"value": 0.2, "modulus": 1.0, "printed_modulus": 1.0}, 0.01),
        ],
    )
    def test_a_number_less_certain_than_its_tolerance_decides_nothing(
        self, claim, facts, uncertainty
    ):
        assert judged(claim, facts).verdict is HOLDS
        with pytest.raises(InvalidInput, match="decides nothing"):
            judged(claim, facts, uncertainty=uncertainty)

    def test_one_entry_is_no_trend(self):
        for trend in (core.increasing, core.decreasing):
            with pytest.raises(InvalidInput, match="at least two"):
                trend("it", [1.0])

    def test_a_computed_period_is_uncertain(self):
        with pytest.raises(InvalidInput, match="no computed period is exact"):
            judged("strip-cycle", CYCLE, uncertainty=0)

    def test_the_distributed_load_is_that_of_the_bessel_function(self):
        zero = mpmath.findroot(lambda x: mpmath.besselj(-mpmath.mpf(1) / 3, x), 1.9)
        assert pytest.approx(float(9 * zero**2 / 4), rel=1e-15) == rods.DISTRIBUTED_LOAD

    def test_readings(self):
        check = for_every_reading("it snaps", [0.1, 0.2, 0.3], [True, False, True])
        assert check.outcome is Outcome.UNDETERMINED
        assert check.sentence == "it snaps for 0.1 and 0.3, but not for 0.2"

    @given(st.floats(0.1, 4), st.floats(1e-3, 1e3))
    def test_orders_are_found(self, order, factor):
        assume(abs(order - 0.95) > 1e-6)
        sizes = np.array([1.0, 0.1, 0.01])
        check = order_of("it", sizes, factor * sizes**order, 1)
        assert (check.outcome is Outcome.HOLDS) == (order > 0.95)


class TestChecks:
    """A check turns exactly at its limit: what lies just beyond it fails."""

    @pytest.mark.parametrize(
        ("check", "good", "bad"),
        [
            (lambda x: core.within("x", x, 2.0, 0.5), [1.5, 2.0, 2.5], [1.499, 2.501, -2.0]),
            (
                lambda x: core.within_percent("x", x, -4.0, 25.0),
                [-3.0, -4.0, -5.0],
                [-2.999, -5.001, 4.0],
            ),
            (
                lambda x: core.all_below("x", x, 1.0),
                [1.0, -1.0, [0.5, -1.0]],
                [1.001, [0.0, -1.001]],
            ),
            (lambda x: core.all_above("x", x, 1.0), [1.001, [2.0, 1.001]], [1.0, -2.0, [3.0, 1.0]]),
            (
                lambda x: core.increasing("x", x),
                [[1.0, 1.001], [-2.0, 0.0, 5.0]],
                [[1.0, 1.0], [1.0, 2.0, 1.999], [2.0, 1.0]],
            ),
            (
                lambda x: core.decreasing("x", x),
                [[1.001, 1.0], [5.0, 0.0, -2.0]],
                [[1.0, 1.0], [2.0, 1.0, 1.001], [1.0, 2.0]],
            ),
            (
                lambda order: core.order_of("x", [2.0, 1.0, 4.0], [2.0**order, 1.0, 0.1], 2.0),
                [1.951, 2.0, 3.0],
                [1.949, 1.0],
            ),
        ],
        ids=["within", "percent", "below", "above", "increasing", "decreasing", "order"],
    )
    def test_a_check_turns_at_its_limit(self, check, good, bad):
        for value in good:
            assert check(value).outcome is Outcome.HOLDS, value
        for value in bad:
            assert check(value).outcome is Outcome.FAILS, value

    def test_a_spread_as_large_as_the_tolerance_is_the_last_that_decides(self):
        assert core.within("x", 2.0, 2.0, 0.5, spread=0.5).outcome is Outcome.HOLDS
        with pytest.raises(InvalidInput, match="decides nothing"):
            core.within("x", 2.0, 2.0, 0.5, spread=0.501)
        with pytest.raises(InvalidInput, match="decides nothing"):
            core.within_percent("x", -2.0, -2.0, 10.0, spread=0.201)


class TestArtificialJudge:
    """All verdicts, by a judge that says what it is told."""

    @pytest.fixture(autouse=True)
    def judge(self, monkeypatch):
        @make_judge(
            "slinky-distance",
            close=core.flag("whether the curves agree"),
            readings=core.optional(core.flags("whether they agree for each reading")),
            deviation=core.optional(core.number("deviation from the measured points")),
        )
        def told(claim, facts):
            checks = [core.holds(facts["close"], "the curves agree")]
            if "readings" in facts:
                checks.append(for_every_reading("ok", range(3), facts["readings"]))
            checks.append(core.agrees_with_measurement(claim.slot, facts, "deviation", 0.1))
            return checks

        monkeypatch.setattr(scoreboard, "JUDGES", {"slinky-distance": told})

    @staticmethod
    def verdict(**facts):
        return scoreboard.record("slinky-distance", as_printed=facts).verdict

    def test_without_data_the_claim_waits(self, monkeypatch):
        monkeypatch.setattr(literature, "is_available", lambda slot: False)
        assert self.verdict(close=True) is Verdict.AWAITS
        assert self.verdict(close=True, readings=[True, True, False]) is Verdict.UNDETERMINED
        assert self.verdict(close=False, readings=[True, True, False]) is Verdict.DIFFERS

    def test_with_data_they_decide(self, monkeypatch):
        monkeypatch.setattr(literature, "is_available", lambda slot: True)
        with pytest.raises(InvalidInput, match="record 'deviation'"):
            self.verdict(close=True)
        assert self.verdict(close=True, deviation=0.05) is Verdict.REPRODUCED
        assert self.verdict(close=True, deviation=0.2) is Verdict.DIFFERS

    def test_flags_are_flags(self):
        for bad in (1, "yes", None, [True]):
            with pytest.raises(InvalidInput, match="True or False"):
                self.verdict(close=bad)

    def test_a_headline_without_a_place_is_refused(self):
        with pytest.raises(InvalidInput, match="needs a mapping"):
            scoreboard.record("slinky-distance", as_printed=1.0)


class TestRecords:
    def test_by_hand_nothing_is_left_behind(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        result = scoreboard.record("strip-best-angle-095", as_printed=BEST, uncertainty=0.04)
        assert result.verdict is Verdict.REPRODUCED
        assert repr(result).startswith("reproduced: Angle of greatest flapping frequency")
        assert repr(result).endswith(result.why)
        assert 'class="verdict verdict-reproduced"' in result._repr_html_()
        assert list(tmp_path.iterdir()) == []

    def test_the_corrected_facts_decide(self):
        good, bad = {"value": 2.9}, {"value": 1.1}
        common = {"uncertainty": 0.01, "correction": "the depth"}
        for printed, corrected, verdict in [
            (bad, good, Verdict.CORRECTED),
            (None, good, Verdict.CORRECTED),
            (good, good, Verdict.REPRODUCED),
            (good, bad, Verdict.DIFFERS),  # agreed only because of the error
            (bad, bad, Verdict.DIFFERS),
        ]:
            result = scoreboard.record(
                "lambda-typical", as_printed=printed, corrected=corrected, **common
            )
            assert result.verdict is verdict
            assert result.why.startswith("Corrected: the depth")
            assert result.value == corrected["value"]

    def test_a_bare_number_is_the_headline(self):
        result = scoreboard.record("lambda-typical", as_printed=1.119, uncertainty=0.001)
        assert result.verdict is Verdict.DIFFERS
        assert result.computed() == "1.1190(10)"
        assert result.difference() == "-1.7810"

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({}, "is empty"),
            ({"as_printed": BEST}, "`uncertainty` is missing"),
            ({"as_printed": BEST, "uncertainty": -1}, "at least 0"),
            ({"as_printed": BEST, "uncertainty": math.nan}, "finite"),
            ({"as_printed": {**BEST, "spraed": 1}, "uncertainty": 0.1}, "did you mean 'spread'"),
            ({"as_printed": 65.1, "uncertainty": 0.1}, "needs a mapping"),
            ({"corrected": BEST, "uncertainty": 0.1}, "go together"),
            ({"as_printed": BEST, "correction": "x", "uncertainty": 0.1}, "go together"),
            ({"as_printed": BEST, "uncertainty": 0.1, "independent": 66.0}, "exclude each other"),
            ({"as_printed": BEST, "uncertainty": 0.1, "independent": math.nan}, "finite"),
            ({"as_printed": BEST, "uncertainty": 0.1, "independent": (1, 2, 3)}, "or one number"),
        ],
    )
    def test_bad_records_are_refused(self, arguments, message):
        with pytest.raises(InvalidInput, match=re.escape(message)):
            scoreboard.record("strip-best-angle-095", **arguments)

    def test_numbers_exclude_each_other_beyond_twice_their_uncertainties(self):
        common = {"as_printed": BEST, "uncertainty": 0.1}
        for side in (-1, 1):
            near, far = (BEST["value"] + side * distance for distance in (0.299, 0.301))
            scoreboard.record("strip-best-angle-095", independent=(near, 0.05), **common)
            with pytest.raises(InvalidInput, match="exclude each other"):
                scoreboard.record("strip-best-angle-095", independent=(far, 0.05), **common)

    def test_independent_numbers_need_a_headline(self):
        with pytest.raises(InvalidInput, match="not recorded"):
            scoreboard.record("strip-reverse", as_printed=REVERSE, independent=(1.0, 0.1))
        with pytest.raises(InvalidInput, match="no uncertainty"):
            scoreboard.record("strip-reverse", as_printed=REVERSE, independent=1.0)

    def test_unknown_claims_come_with_the_nearest(self):
        with pytest.raises(InvalidInput, match=r"did you mean .*'lambda-typical'"):
            scoreboard.record("lambda-tipical", as_printed=1.0, uncertainty=0.1)

    def test_claims_without_a_judge_say_what_to_write(self):
        without = [id for id in scoreboard.claims() if id not in JUDGES]
        for claim in without:
            with pytest.raises(InvalidInput, match="has no judge yet"):
                scoreboard.record(claim, as_printed=1.0, uncertainty=0.1)

    @given(st.floats(), st.floats())
    def test_any_floats_are_judged_or_refused(self, value, spread):
        try:
            result = scoreboard.record(
                "strip-best-angle-095",
                as_printed={"value": value, "spread": spread},
                uncertainty=0.05,
            )
        except InvalidInput:
            assert not (math.isfinite(value) and math.isfinite(spread))
            return
        expected = abs(value - 65.1) <= 0.5 and abs(spread) <= 1
        assert (result.verdict is Verdict.REPRODUCED) == expected


class TestBoard:
    def test_records_are_read_back(self, building, monkeypatch):
        monkeypatch.setenv("LISSOME_PAGE", "3-flapping-strip")
        kept = scoreboard.record(
            "strip-best-angle-095",
            as_printed=BEST,
            uncertainty=0.04,
            independent=(65.12, 0.02),
            remark="Looked at twice.",
        )
        assert [path.name for path in building.iterdir()] == ["strip-best-angle-095.json"]
        row = scoreboard.board(building, [])["strip-best-angle-095"]
        assert row.verdict is kept.verdict
        assert row.why == kept.why
        assert row.record.page == "3-flapping-strip"
        assert "Looked at twice." in row.why

    def test_lists_and_flags_survive(self, building, monkeypatch):
        monkeypatch.setenv("LISSOME_PAGE", "3-snapping-strip")
        kept = judged("snap-centred", {**CENTRED, "snaps_down": np.array([True, False])})
        row = scoreboard.board(building, [])["snap-centred"]
        assert row.verdict is kept.verdict is Verdict.UNDETERMINED

    def test_only_claims_of_written_pages_can_be_missing(self, building):
        empty = scoreboard.board(building, [])
        assert empty.missing == ()
        assert empty.counts()[Verdict.PENDING] == len(scoreboard.claims())
        judged("lambda-typical", {"value": 1.1})
        pages = {"3-photomechanical-beams", "3-rolling-ring"}
        board = scoreboard.board(building, pages)
        of_pages = [c.id for c in scoreboard.claims().values() if c.page in pages]
        assert [c.id for c in board.missing] == [id for id in of_pages if id != "lambda-typical"]
        assert board.missing
        assert sum(board.counts().values()) == len(board.rows)

    def test_a_claim_is_recorded_once(self, building, monkeypatch):
        judged("lambda-typical", {"value": 1.1})
        with pytest.raises(InvalidInput, match="recorded twice on the page"):
            judged("lambda-typical", {"value": 1.1})
        # the same page, run again by another process, replaces its record
        monkeypatch.setattr(scoreboard, "_PROCESS", "another")
        judged("lambda-typical", {"value": 1.2})
        assert scoreboard.board(building, [])["lambda-typical"].record.value == 1.2

    def test_a_claim_belongs_to_a_page(self, building, monkeypatch):
        monkeypatch.setenv("LISSOME_PAGE", "4-discrete-rods")
        with pytest.raises(InvalidInput, match="belongs to the page '3-photomechanical-beams'"):
            judged("lambda-typical", {"value": 1.1})
        assert not building.exists()

    def test_a_cell_may_be_run_again_by_hand(self, building, monkeypatch):
        monkeypatch.delenv("LISSOME_PAGE")
        judged("lambda-typical", {"value": 1.1})
        judged("lambda-typical", {"value": 1.2})
        monkeypatch.setenv("LISSOME_PAGE", "3-photomechanical-beams")
        with pytest.raises(InvalidInput, match="already"):
            judged("lambda-typical", {"value": 1.1})

    def test_damaged_records_are_refused(self, building):
        judged("lambda-typical", {"value": 1.1})
        path = building / "lambda-typical.json"
        good = path.read_text()
        for bad in (good[:-20], "[]", good.replace('"format": 1', '"format": 2'), "{}"):
            path.write_text(bad)
            with pytest.raises(DataError, match=r"lambda-typical\.json"):
                scoreboard.board(building, [])

    def test_verdicts_are_computed_from_the_stored_facts(self, building):
        judged("lambda-typical", {"value": 2.9})
        path = building / "lambda-typical.json"
        content = json.loads(path.read_text())
        assert "verdict" not in content
        content["as_printed"]["value"] = 1.1
        path.write_text(json.dumps(content))
        assert scoreboard.board(building, [])["lambda-typical"].verdict is Verdict.DIFFERS

    def test_the_csv_shows_no_digit_beyond_the_uncertainty(self, building, monkeypatch):
        monkeypatch.setenv("LISSOME_PAGE", "3-flapping-strip")
        scoreboard.record(
            "strip-best-angle-095",
            as_printed={"value": 65.131234, "spread": 0.2},
            uncertainty=0.04,
            independent=(65.1212, 0.002),
        )
        text = scoreboard.board(building, []).to_csv()
        rows = {row["id"]: row for row in csv.DictReader(io.StringIO(text))}
        assert set(rows) == set(scoreboard.claims())
        assert rows["strip-best-angle-095"] == {
            "id": "strip-best-angle-095",
            "printed": "65.1",
            "computed": "65.13",
            "independent": "65.121",
            "difference": "0.03",
            "uncertainty": "0.04",
            "unit": "degree",
            "verdict": "reproduced",
        }
        assert rows["jump-height"]["printed"] == "0.20"
        assert rows["jump-height"]["verdict"] == "pending"


def test_claims_point_to_stored_numbers_and_slots():
    for claim in scoreboard.claims().values():
        for id in claim.data:
            number = literature.value(id)
            if len(claim.data) == 1 and not math.isnan(claim.value):
                assert float(number) == pytest.approx(claim.value, abs=1e-7)
        if claim.slot:
            assert claim.slot in literature.slots()
        if not math.isnan(claim.value):
            assert float(claim.printed) == claim.value


def test_the_scoreboard_is_light():
    code = (
        "import sys; from lissome import scoreboard; scoreboard.claims();"
        "heavy = {'frictionless', 'pandas', 'pint', 'matplotlib', 'numba', 'scipy'};"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
