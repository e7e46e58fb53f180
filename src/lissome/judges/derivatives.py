"""Judges of the claims on strains and their derivatives (Appendix A.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import Check, Facts, all_below, holds, judge, number, optional

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
        all_below("the difference from angle over strain", facts["difference"], 1e-13),
        all_below("psi(0) - 1", facts["at_zero"], 1e-15),
        all_below("psi(2) - pi/2", facts["at_two"], 1e-15),
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
        all_below("the error of the gradient", facts["gradient"], 1e-6),
        all_below("the error of the Hessian", facts["hessian"], 1e-6),
        all_below("the error of the gradient by the exact method", facts["exact_gradient"], 1e-12),
        all_below("the error of the Hessian by the exact method", facts["exact_hessian"], 1e-12),
        holds(facts["states"] >= 100, f"{facts['states']:.0f} states (at least 100 demanded)"),
    ]


JUDGES = (psi_function, derivative_errors)
