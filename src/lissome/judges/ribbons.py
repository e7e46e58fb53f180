"""Judges of claims on inextensible ribbons (chapter 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import (
    Check,
    Facts,
    agrees_with_measurement,
    all_above,
    all_below,
    holds,
    judge,
    number,
    numbers,
    optional,
    same_length,
    within,
)

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["JUDGES"]


@judge(
    "moebius-shape",
    value=number("twist plus writhe of the band, from separate sums, turns"),
    inflections=number("number of zeros of kappa_1 along the band, the joint included"),
    asymmetry=number("largest distance of the half-turned center line from itself, in L"),
    eigenvalue=number("smallest eigenvalue of the second variation, any unit"),
)
def moebius_shape(claim: Claim, facts: Facts) -> list[Check]:
    zeros = facts["inflections"]
    return [
        within(
            "twist plus writhe",
            facts["value"],
            0.5,
            1e-6,
            spread=facts.uncertainty,
            said="twist and writhe add up to half a turn, to {distance}",
        ),
        holds(
            zeros == 1,
            "bending vanishes once",
            f"bending vanishes {zeros:g} times instead of once",
        ),
        all_below(
            "the asymmetry under a half turn",
            facts["asymmetry"],
            1e-8,
            "L",
            said="turned about its axis of symmetry, the band meets itself to {value}",
        ),
        all_above(
            "the smallest eigenvalue",
            facts["eigenvalue"],
            0.0,
            said="it is stable: the smallest eigenvalue is {value}",
        ),
    ]


@judge(
    "moebius-strains",
    half_widths=numbers("half widths for L = 2 pi, as Starostin and van der Heijden count them"),
    energies=numbers("relative differences of the extrapolated energies from the reference"),
    strains=numbers("relative L2 differences of (kappa_1, kappa_3) at N = 250 from the reference"),
    measured=optional(number("largest deviation of the published curves, 1/L")),
)
def moebius_strains(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "half_widths", "energies", "strains")
    least, most = facts["half_widths"].min(), facts["half_widths"].max()
    return [
        all_below(
            "the difference of the extrapolated energies",
            facts["energies"],
            1e-4,
            said=f"at {len(facts['half_widths'])} half widths from {least:g} to {most:g} (for "
            "L = 2π) the extrapolated energies are those of the boundary-value problem to {value}",
        ),
        all_below(
            "the difference of the strains at N = 250",
            facts["strains"],
            1e-2,
            said="the strains with 250 segments agree to {value}",
        ),
        holds(
            bool(len(facts["half_widths"]) >= 3 and least <= 0.1 and most >= 1.5),
            "",
            f"only {len(facts['half_widths'])} half widths from {least:g} to {most:g} are compared, "
            "not three or more from 0.1 to 1.5",
        ),
        agrees_with_measurement("moebius-strains", facts, "measured", 0.5, "published curves"),
    ]


JUDGES = (moebius_shape, moebius_strains)
