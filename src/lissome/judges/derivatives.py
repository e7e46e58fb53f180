"""Judges of the claims on strains and their derivatives (Appendix A.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import Check, Facts, all_below, holds, judge, number, optional, short

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["JUDGES"]


@judge(
    "psi-function",
    difference=number("largest relative difference of psi(t) from rotation angle over strain norm"),
    at_zero=number("psi(0) - 1"),
    at_two=number("psi(2) - pi/2"),
)
def psi_function(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below(
            "the difference from angle over strain",
            facts["difference"],
            1e-13,
            said="ψ is the angle over the norm of the strain to {value}, and meets both ends",
        ),
        all_below("ψ(0) − 1", facts["at_zero"], 1e-15, said=""),
        all_below("ψ(2) − π/2", facts["at_two"], 1e-15, said=""),
    ]


@judge(
    "derivative-errors",
    value=number("largest relative error of gradient and Hessian against finite differences"),
    gradient=number("largest relative error of the gradient, central differences, step 1e-7"),
    hessian=number("largest relative error of the Hessian, central differences, step 1e-7"),
    exact_gradient=number("the same against complex steps or automatic differentiation"),
    exact_hessian=number("the same against complex steps or automatic differentiation"),
    states=number("number of states"),
    nodes=optional(number("number of nodes")),
)
def derivative_errors(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below(
            "the difference of the gradient from finite differences",
            facts["gradient"],
            1e-6,
            said=f"over {facts['states']:.0f} states the gradient differs from finite differences "
            f"by at most {{value}}, the Hessian by {short(facts['hessian'])}",
        ),
        all_below(
            "the difference of the Hessian from finite differences",
            facts["hessian"],
            1e-6,
            said="",
        ),
        all_below(
            "the difference of the gradient from complex steps",
            facts["exact_gradient"],
            1e-12,
            said="from complex steps they differ by at most {value} and "
            f"{short(facts['exact_hessian'])}: what remains is the error of the differences",
        ),
        all_below(
            "the difference of the Hessian from complex steps",
            facts["exact_hessian"],
            1e-12,
            said="",
        ),
        holds(
            facts["states"] >= 100,
            "",
            f"only {facts['states']:.0f} states are compared, not 100",
        ),
    ]


JUDGES = (psi_function, derivative_errors)
