"""Judges of claims on plates (chapter 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import (
    Check,
    Facts,
    Outcome,
    all_below,
    flag,
    flags,
    holds,
    judge,
    number,
    numbers,
    same_length,
    within_percent,
)

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
    "laminate-sign-change",
    ratios=numbers("strain of the soft film over that of the stiff one on the plate, each fit"),
    changes_down=numbers("changes of sign with the high-modulus side on the plate, each fit"),
    changes_up=numbers("changes of sign with the low-modulus side on the plate, each fit"),
    strain_monotone=flags("whether the in-plane strain is monotone in both cases, each fit"),
    strain_apart=numbers("greatest difference of the strains of both cases over the final, each"),
    limit_mismatch=number("largest sum of the two final curvatures over their size"),
)
def laminate_sign_change(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "ratios", "changes_down", "changes_up", "strain_monotone", "strain_apart")
    ratios = facts["ratios"]
    count = len(ratios)
    true = (facts["changes_down"] == 1) & (facts["changes_up"] == 0)
    name = "one change of sign with the high-modulus side down, none with it up,"
    if true.all():
        signs = Check(Outcome.HOLDS, f"{name} in all {count} fits")
    elif not true.any():
        signs = Check(Outcome.FAILS, f"{name} in none of {count} fits")
    else:
        signs = Check(
            Outcome.UNDETERMINED,
            f"{name} in {true.sum()} of {count} fits: those that fail have strains of the films in "
            f"ratios from {ratios[~true].min():.3g} to {ratios[~true].max():.3g}, the others from "
            f"{ratios[true].min():.3g}",
        )
    monotone = bool(facts["strain_monotone"].all())
    return [
        signs,
        holds(monotone, "the in-plane strain is monotone", "the in-plane strain turns back"),
        all_below("the sum of the final curvatures", facts["limit_mismatch"], 1e-6),
        holds(
            True,
            "the in-plane strains of both cases differ on the way by at most "
            f"{facts['strain_apart'].max():.2g} of the final one",
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


JUDGES = (laminate_uniform, laminate_sign_change, jump_height)
