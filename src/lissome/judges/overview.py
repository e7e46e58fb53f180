"""Judges of the claims on bifurcations and on the models (chapters 1 and 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import Check, Facts, all_below, flag, flags, holds, judge, number

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["JUDGES"]


@judge(
    "balloon-three-radii",
    equilibria=number("number of equilibrium radii at the stated pressure"),
    pressure=number("the stated pressure, over that of the limit point"),
    radius_before=number("radius at the limit point, followed under rising pressure"),
    radius_after=number("radius that the balloon jumps to"),
    largest=number("largest equilibrium radius at the pressure of the limit point"),
)
def balloon_three_radii(claim: Claim, facts: Facts) -> list[Check]:
    after, largest = facts["radius_after"], facts["largest"]
    return [
        holds(
            facts["equilibria"] == 3 and 0 < facts["pressure"] < 1,
            f"at {facts['pressure']:.3g} of the limit pressure the balloon has three radii in equilibrium",
            f"at {facts['pressure']:.3g} of the limit pressure {facts['equilibria']:.0f} radii are "
            "in equilibrium, not three",
        ),
        holds(
            after > facts["radius_before"] and abs(after / largest - 1) <= 1e-6,
            f"past that limit it jumps from {facts['radius_before']:.4g} to {after:.4g}, the "
            "largest that the limit pressure can hold",
            f"past that limit it goes from {facts['radius_before']:.4g} to {after:.4g}, but the "
            f"largest equilibrium is {largest:.4g}",
        ),
    ]


@judge(
    "pitchfork-table",
    derivatives_equal=flags("whether computer algebra finds mu and -2 mu, for each equilibrium"),
    stability_equal=flags("whether the followed branch has the stability of the table, likewise"),
)
def pitchfork_table(claim: Claim, facts: Facts) -> list[Check]:
    return [
        holds(
            bool(facts["derivatives_equal"].all()),
            "computer algebra finds the derivatives of the table",
            "a derivative is not that of the table",
        ),
        holds(
            bool(facts["stability_equal"].all()),
            "every branch that is followed has the stability of the table",
            "the stability of a followed branch differs from the table",
        ),
    ]


@judge(
    "kirchhoff-balance",
    residual=number("largest difference of the variation from the balance, over its size"),
)
def kirchhoff_balance(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below(
            "the difference of variation and balance",
            facts["residual"],
            1e-12,
            said="the variation gives the balance, to {value} of its size",
        )
    ]


@judge("beam-reduction", equal=flag("whether computer algebra reduces the difference to zero"))
def beam_reduction(claim: Claim, facts: Facts) -> list[Check]:
    return [
        holds(
            facts["equal"],
            "computer algebra reduces the balance of the rod to that of the beam",
            "the balance of the rod does not reduce to that of the beam",
        )
    ]


@judge(
    "fvk-energy",
    stretching_equal=flag("whether the stretching term is h W(eps) by computer algebra"),
    bending_equal=flag("whether the bending term is h^3/12 W(grad grad w) by computer algebra"),
    plane_stress=flag("whether plane stress is reached by minimizing over the transverse strain"),
)
def fvk_energy(claim: Claim, facts: Facts) -> list[Check]:
    return [
        holds(
            facts["stretching_equal"],
            "computer algebra finds both terms, of stretching and of bending",
            "the stretching term differs",
        ),
        holds(
            facts["bending_equal"],
            "",
            "the bending term differs",
        ),
        holds(
            facts["plane_stress"],
            "minimizing over the transverse strain leads to plane stress",
            "minimizing over the transverse strain does not give plane stress",
        ),
    ]


JUDGES = (balloon_three_radii, pitchfork_table, kirchhoff_balance, beam_reduction, fvk_energy)
