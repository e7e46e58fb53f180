"""Judges of claims on plates (chapter 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import Check, Facts, flag, holds, judge, number, within_percent

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["JUDGES"]


@judge(
    "laminate-uniform",
    stretching_equal=flag("whether computer algebra gives h E W"),
    bending_equal=flag("whether computer algebra gives h^3 E/12 W"),
)
def laminate_uniform(claim: Claim, facts: Facts) -> list[Check]:
    return [
        holds(
            facts["stretching_equal"],
            "the stretching term is equal by computer algebra",
            "the stretching term differs",
        ),
        holds(
            facts["bending_equal"],
            "the bending term is equal by computer algebra",
            "the bending term differs",
        ),
    ]


@judge(
    "jump-height",
    value=number("C dE/(rho g h) with the printed parameters, m"),
    modulus=number("C of the laminate of Table A.1, Pa m"),
    printed_modulus=number("C as printed in Table 5.2, Pa m"),
)
def jump_height(claim: Claim, facts: Facts) -> list[Check]:
    ratio = facts["modulus"] / facts["printed_modulus"]
    return [
        within_percent("the height", facts["value"], claim.number, 2, spread=facts.uncertainty),
        holds(True, f"C from Table A.1 is {ratio:.3g} times the printed one"),
    ]


JUDGES = (laminate_uniform, jump_height)
