"""Judges of claims on discrete rods (chapter 4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ._core import (
    Check,
    Facts,
    agrees_with_measurement,
    all_above,
    all_below,
    for_every_reading,
    holds,
    judge,
    number,
    numbers,
    optional,
    same_length,
    short,
    within,
    within_percent,
)

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["DISTRIBUTED_LOAD", "JUDGES", "POINT_LOAD"]

#: Critical loads of the clamped-free elastica: pi^2/4 in B/L^2, and (9/4) j^2 in B/L^3 with j the
#: first zero of the Bessel function of order -1/3. A test recomputes the second.
POINT_LOAD = math.pi**2 / 4
DISTRIBUTED_LOAD = 7.837347438943484

_BUCKLING = {
    "value": number("critical load extrapolated to infinitely many segments"),
    "order": number("order of convergence with the clamp at the node"),
}


def _buckling(exact: float, facts: Facts) -> list[Check]:
    return [
        within(
            "the extrapolated load",
            facts["value"],
            exact,
            1e-6,
            spread=facts.uncertainty,
            said="the extrapolated load agrees with the exact one, to {distance}",
        ),
        within(
            "the order of convergence",
            facts["order"],
            2,
            0.1,
            said="with the clamp at the node it converges at order {value}",
        ),
    ]


@judge("buckling-point", **_BUCKLING)
def buckling_point(claim: Claim, facts: Facts) -> list[Check]:
    return _buckling(POINT_LOAD, facts)


@judge("buckling-distributed", **_BUCKLING)
def buckling_distributed(claim: Claim, facts: Facts) -> list[Check]:
    return _buckling(DISTRIBUTED_LOAD, facts)


@judge(
    "buckling-postcritical",
    value=number("largest difference of the tip from the boundary-value problem, extrapolated"),
    segment_clamp=number("the same at N = 100, two nodes fixed as in the thesis"),
    node_clamp=number("the same at N = 100, clamp at the node"),
)
def buckling_postcritical(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below(
            "the extrapolated difference",
            facts["value"],
            1e-6,
            "L",
            said="extrapolated, the tip is that of the boundary-value problem to {value}",
        ),
        holds(
            True,
            f"with 100 segments it is off by {short(facts['segment_clamp'])} L if two nodes are fixed, "
            f"as in the thesis, and by {short(facts['node_clamp'])} L with the clamp at the node",
        ),
    ]


@judge(
    "slinky-onset",
    value=number("overcurvature at which the discrete ring leaves its plane"),
    exact=number("the same by exact linear stability"),
)
def slinky_onset(claim: Claim, facts: Facts) -> list[Check]:
    return [
        within(
            "the onset",
            facts["value"],
            facts["exact"],
            1e-3,
            spread=facts.uncertainty,
            said="the discrete ring leaves its plane where exact linear stability says, to {distance}",
        )
    ]


@judge(
    "slinky-triple",
    value=number("overcurvature at which the discrete triple circle becomes stable"),
    exact=number("the same by exact linear stability"),
    stable_to=number("overcurvature at which it loses stability again"),
)
def slinky_triple(claim: Claim, facts: Facts) -> list[Check]:
    return [
        within(
            "the threshold",
            facts["value"],
            facts["exact"],
            1e-3,
            spread=facts.uncertainty,
            said="the triple circle becomes stable where exact linear stability says, to {distance}",
        ),
        within_percent(
            "the threshold",
            facts["value"],
            claim.number,
            1,
            spread=facts.uncertainty,
            said="the printed overcurvature is {distance} % off",
        ),
        holds(
            facts["stable_to"] > facts["value"],
            f"the circle stays stable up to {facts['stable_to']:.4g} only",
            f"the circle is unstable above {facts['stable_to']:.4g}",
        ),
    ]


@judge(
    "equilibrium-time",
    value=number("time per equilibrium at N = 100 in the stored benchmark, s"),
)
def equilibrium_time(claim: Claim, facts: Facts) -> list[Check]:
    faster = claim.number / facts["value"]
    return [
        all_below(
            "the stored time per equilibrium",
            facts["value"],
            claim.number,
            "s",
            said=f"the stored benchmark takes {short(1e3 * facts['value'])} ms, {faster:.0f} times "
            "less than the thesis's code took on its machine",
        )
    ]


@judge(
    "slinky-distance",
    value=number("largest difference from the continuum solution over the distance at O = 1"),
    overcurvatures=numbers("the overcurvatures compared"),
    measured=optional(number("largest deviation of the measured points, in units of the length")),
)
def slinky_distance(claim: Claim, facts: Facts) -> list[Check]:
    least, most = facts["overcurvatures"].min(), facts["overcurvatures"].max()
    return [
        all_below(
            "the difference from the continuum solution, over the initial distance,",
            facts["value"],
            1e-3,
            said=f"from O = {least:.3g} to {most:.3g} the distance is that of the continuum, to "
            "{value} of the initial one",
        ),
        holds(
            bool(least <= 1.05 and most >= 2.8),
            "",
            f"only O = {least:.3g} to {most:.3g} is compared, not the whole buckled range",
        ),
        agrees_with_measurement("slinky-distance", facts, "measured", 0.02),
    ]


@judge(
    "ribbon-snap-narrow",
    value=number("critical twist extrapolated to infinitely many segments, rad"),
    continuum=number("the fold of the continuum model, rad"),
    exponent=number("exponent of the smallest eigenvalue against the distance to the snap"),
    before=number("smallest eigenvalue without twist, any unit"),
    after=number("smallest eigenvalue after the snap, same unit"),
    measured=optional(number("largest deviation of the measured points of y0")),
)
def ribbon_snap_narrow(claim: Claim, facts: Facts) -> list[Check]:
    return [
        within(
            "the critical twist",
            facts["value"],
            facts["continuum"],
            1e-3,
            "rad",
            spread=facts.uncertainty,
            said="the strip snaps at a twist of {value}, {distance} from the fold of the continuum",
        ),
        within(
            "the exponent of the smallest eigenvalue",
            facts["exponent"],
            0.5,
            0.05,
            said="there the smallest eigenvalue reaches zero, with the exponent {value} (a fold has "
            "1/2); before and after it is positive",
        ),
        all_above(
            "the smallest eigenvalue before and after",
            [facts["before"], facts["after"]],
            0.0,
            said="",
        ),
        agrees_with_measurement("ribbon-twist", facts, "measured", 0.05),
    ]


@judge(
    "ribbon-nosnap-wide",
    twists=numbers("the twists, rad"),
    eigenvalues=numbers("smallest eigenvalue at each twist, any unit"),
    measured=optional(number("largest deviation of the measured points of y0")),
)
def ribbon_nosnap_wide(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "twists", "eigenvalues")
    low, high = facts["twists"].min(), facts["twists"].max()
    return [
        all_above(
            f"the smallest eigenvalue for twists of {low:.3g} to {high:.3g} rad",
            facts["eigenvalues"],
            0.0,
            said=f"from a twist of {low:.3g} to {high:.3g} rad no eigenvalue comes below "
            "{value}: the strip is stable",
        ),
        agrees_with_measurement("ribbon-twist", facts, "measured", 0.05),
    ]


@judge(
    "ribbon-threshold",
    thresholds=numbers("threshold width over sqrt(L h), for each Poisson ratio and form of xi"),
    poisson_ratios=optional(numbers("the Poisson ratios")),
)
def ribbon_threshold(claim: Claim, facts: Facts) -> list[Check]:
    thresholds = facts["thresholds"]
    near = np.abs(thresholds - claim.number) <= 0.02
    check = for_every_reading(f"the threshold is {claim.number:g} within 0.02", thresholds, near)
    return [
        Check(
            check.outcome,
            f"the threshold depends on the form of ξ and on ν, from {thresholds.min():.3f} to "
            f"{thresholds.max():.3f}; the printed value is met within 0.02 by {near.sum()} of "
            f"{len(near)} combinations",
        )
    ]


JUDGES = (
    buckling_point,
    buckling_distributed,
    buckling_postcritical,
    slinky_onset,
    slinky_triple,
    slinky_distance,
    equilibrium_time,
    ribbon_snap_narrow,
    ribbon_nosnap_wide,
    ribbon_threshold,
)
