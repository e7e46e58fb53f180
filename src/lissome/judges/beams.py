"""Judges of the claims on photomechanical beams (chapter 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput
from ._core import (
    Check,
    Facts,
    all_above,
    all_below,
    decreasing,
    flags,
    for_every_reading,
    holds,
    increasing,
    judge,
    listed,
    number,
    numbers,
    optional,
    order_of,
    same_length,
    short,
    within,
    within_percent,
)

if TYPE_CHECKING:
    from ..scoreboard import Claim

__all__ = ["JUDGES"]

# The illuminations of Fig. 3.2
RING_INTENSITIES = (0.01, 0.1, 1.0, 10.0)


def _demand(name: str, given: np.ndarray, wanted: tuple[float, ...]) -> None:
    missing = [value for value in wanted if not np.isclose(given, value, rtol=1e-12).any()]
    if missing:
        raise InvalidInput(
            f"the fact '{name}' lacks {', '.join(f'{value:g}' for value in missing)}; "
            "the claim speaks of these"
        )


def _ascending(name: str, values: np.ndarray) -> None:
    if not np.all(np.diff(values) > 0):
        raise InvalidInput(f"the fact '{name}' is {values.tolist()}; list it in increasing order")


@judge(
    "lambda-typical",
    value=number("Lambda of (3.14) with the values of Table 3.1"),
    other_readings=optional(numbers("Lambda with the other thicknesses and depths of the thesis")),
)
def lambda_typical(claim: Claim, facts: Facts) -> list[Check]:
    own = within_percent("|Λ| from the values of the table", abs(facts["value"]), claim.number, 2)
    if "other_readings" not in facts:
        return [own]
    others = facts["other_readings"]
    near = np.abs(np.abs(others) / claim.number - 1) <= 0.02
    found = "one of which agrees" if near.any() else "none of which agrees"
    elsewhere = f"with thicknesses and depths printed elsewhere it is {listed(others, 3)}, {found}"
    return [Check(own.outcome, f"{own.sentence}; {elsewhere}")]


@judge(
    "ring-steady-speed",
    intensities=numbers("Lambda of each run"),
    changes=numbers("relative change of the speed over the last revolution, for each Lambda"),
    speeds=optional(numbers("the steady speeds")),
)
def ring_steady_speed(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "changes")
    _demand("intensities", facts["intensities"], RING_INTENSITIES)
    checks = [
        all_below(
            "the change of speed over the last revolution",
            facts["changes"],
            1e-3,
            said="at each of these intensities the speed settles: over the last revolution it "
            "changes by {value} of itself at most",
        )
    ]
    if "speeds" in facts:
        same_length(facts, "intensities", "speeds")
        checks.append(all_above("the speed", np.abs(facts["speeds"]), 0.0, said=""))
    return checks


@judge(
    "ring-speed-symmetry",
    value=number("speed in vertical light"),
    angles=numbers("angles of the light in radians, increasing, greater than 0"),
    speeds=numbers("speed V at each angle"),
    mirrored_speeds=numbers("speed at the opposite of each angle"),
    increasing_to=number("angle up to which the speed is said to increase, radians"),
    slope=number("dV/d(angle) at 0"),
    breakdown=number("angle at which the linear theory breaks down, radians"),
)
def ring_speed_symmetry(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "angles", "speeds", "mirrored_speeds")
    _ascending("angles", facts["angles"])
    part = facts["angles"] <= facts["increasing_to"] * (1 + 1e-12)
    if np.count_nonzero(part) < 5 or facts["angles"][0] <= 0:
        raise InvalidInput("at least five angles between 0 and `increasing_to` are needed")
    return [
        all_below("|V(0)|", facts["value"], 1e-8, said="in vertical light the ring rests"),
        all_below(
            "|V(angle) + V(−angle)|",
            facts["speeds"] + facts["mirrored_speeds"],
            1e-8,
            said="opposite angles give opposite speeds, to {value}",
        ),
        increasing(
            f"V up to {facts['increasing_to']:.3g} rad",
            np.r_[0.0, facts["speeds"][part]],
            said=f"up to {facts['increasing_to']:.3g} rad V rises from 0 to {{last}}, with the slope "
            f"{facts['slope']:.4g} at 0; the linear theory breaks down at "
            f"{facts['breakdown']:.4g} rad",
        ),
        holds(facts["slope"] > 0, "", f"the slope at 0 is {short(facts['slope'])}, not positive"),
    ]


@judge(
    "ring-speed-intensity",
    intensities=numbers("Lambda of each run"),
    deviations=numbers(
        "largest relative deviation of the speed from linear theory over |angle| <= 0.6 rad"
    ),
)
def ring_speed_intensity(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "deviations")
    _demand("intensities", facts["intensities"], RING_INTENSITIES)
    near = facts["deviations"] <= 0.05
    largest = facts["intensities"][near].max() if near.any() else 0.0
    deviations = _per_intensity(facts["intensities"], facts["deviations"])
    departs = f"the speed departs from (3.29) by {deviations}"
    return [
        order_of("the deviation from (3.29)", facts["intensities"], facts["deviations"], 1),
        holds(
            bool(near.all()),
            f"{departs}: by 5 % at most",
            f"{departs}: it is practically independent of the intensity (to 5 %) up to "
            f"Λ = {largest:g} only",
        ),
    ]


def _per_intensity(intensities: np.ndarray, fractions: np.ndarray) -> str:
    parts = [
        f"{short(100 * fraction)} % at Λ = {intensity:g}"
        for intensity, fraction in zip(intensities, fractions, strict=True)
    ]
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


@judge(
    "ring-curvature-profile",
    intensities=numbers("Lambda of each run"),
    differences=numbers("relative rms difference of (K0 - Kr)/Lambda from linear theory"),
)
def ring_curvature_profile(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "differences")
    _demand("intensities", facts["intensities"], RING_INTENSITIES)
    differences = _per_intensity(facts["intensities"], facts["differences"])
    order = order_of(
        "the difference",
        facts["intensities"],
        facts["differences"],
        1,
        said="the difference vanishes at order {order} in Λ",
    )
    return [
        Check(
            order.outcome,
            f"the profile departs from linear theory by {differences}; {order.sentence}",
        )
    ]


@judge(
    "strip-cycle",
    value=number("period of the cycle"),
    return_distance=number("relative distance of the state from itself after one period"),
    crest_drift=numbers(
        "displacement of the crest between a snap and the next; positive: away from the light"
    ),
    snaps_per_period=number("snaps in a period"),
    side_difference=number("relative difference of the cycles started up and started down"),
)
def strip_cycle(claim: Claim, facts: Facts) -> list[Check]:
    if facts.uncertainty == 0:
        raise InvalidInput("argument `uncertainty` is 0; no computed period is exact")
    return [
        all_below(
            "the distance of the strip from itself after one period",
            facts["return_distance"],
            1e-6,
            said="after a period with two snaps the strip is back, to {value}",
        ),
        holds(
            facts["snaps_per_period"] == 2,
            "",
            f"a period has {facts['snaps_per_period']:.0f} snaps, not two",
        ),
        all_above(
            "the drift of the crest away from the light",
            facts["crest_drift"],
            0.0,
            said="before each snap the crest drifts away from the light",
        ),
        all_below(
            "the difference of the cycles from both sides",
            facts["side_difference"],
            1e-6,
            said="started up or down, it reaches the same cycle, to {value}",
        ),
    ]


@judge(
    "strip-eigenvalue",
    value=number("lowest eigenvalue extrapolated to the snap, over its largest value in the cycle"),
    exponents=numbers("exponent p of eigenvalue ~ (T_snap - T)^p before each snap"),
    after=numbers("lowest eigenvalue after each snap"),
)
def strip_eigenvalue(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "exponents", "after")
    worst = facts["exponents"][np.argmax(np.abs(facts["exponents"] - 0.5))]
    return [
        all_below(
            "the eigenvalue at the snap, over its largest,",
            facts["value"],
            1e-2,
            said="at each snap the eigenvalue has fallen to {value} of its largest",
        ),
        within(
            "the exponent furthest from 1/2",
            float(worst),
            0.5,
            0.05,
            said="it falls as the power {value} of the time that is left; a fold has 1/2",
        ),
        all_above(
            "the eigenvalue after a snap",
            facts["after"],
            0.0,
            said="after each snap it is positive",
        ),
    ]


@judge(
    "strip-window",
    intensities=numbers("Lambda, increasing"),
    lower=numbers("lower end of the window of angles, degrees, for each Lambda"),
    upper=numbers("upper end of the window of angles, degrees, for each Lambda"),
    resolution=number("uncertainty of the ends, degrees"),
    frequencies=numbers("frequency at one common angle, for each Lambda"),
    angle=number("the common angle, degrees"),
)
def strip_window(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "lower", "upper", "frequencies")
    _ascending("intensities", facts["intensities"])
    if len(facts["intensities"]) < 3:
        raise InvalidInput("the fact 'intensities' needs at least three entries to show a trend")
    ends = [
        f"{low:.1f}°–{high:.1f}° at Λ = {i:g}"
        for i, low, high in zip(facts["intensities"], facts["lower"], facts["upper"], strict=True)
    ]
    return [
        all_below("the uncertainty of the ends", facts["resolution"], 0.1, "°", said=""),
        holds(
            bool(np.all(np.diff(facts["lower"]) < 0) and np.all(np.diff(facts["upper"]) > 0)),
            f"the window widens with the light at both ends, from {ends[0]} to {ends[-1]}",
            f"the windows are not nested: {', '.join(ends)}",
        ),
        increasing(f"the frequency at {facts['angle']:g}°", facts["frequencies"]),
    ]


def _best_angle(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below("the uncertainty of the angle", facts.uncertainty, 0.1, "°", said=""),
        within(
            "the best angle",
            facts["value"],
            claim.number,
            0.5,
            "°",
            facts.uncertainty,
            said="{name} is {value}, {distance} from the printed one",
        ),
        all_below(
            "the spread over Λ", facts["spread"], 1.0, "°", said="over Λ it varies by {value}"
        ),
    ]


_BEST_ANGLE = {
    "value": number("angle of the greatest frequency, degrees"),
    "spread": number("difference of the largest and the least best angle over Lambda, degrees"),
    "intensities": optional(numbers("the Lambda over which the spread is taken")),
}
strip_best_angle_095 = judge("strip-best-angle-095", **_BEST_ANGLE)(_best_angle)
strip_best_angle_0957 = judge("strip-best-angle-0957", **_BEST_ANGLE)(_best_angle)


@judge(
    "strip-reverse",
    crest_drift=numbers(
        "displacement of the crest between a snap and the next; positive: away from the light"
    ),
    orbit_difference=number("relative distance of the orbits (beta, gamma) at Lambda and -Lambda"),
    period_difference=number("relative difference of the periods at Lambda and -Lambda"),
)
def strip_reverse(claim: Claim, facts: Facts) -> list[Check]:
    distance, change = facts["orbit_difference"], facts["period_difference"]
    return [
        all_above(
            "the drift of the crest towards the light",
            -facts["crest_drift"],
            0.0,
            said="the crest moves towards the light",
        ),
        holds(
            abs(distance) > 1e-8,
            f"the path is another one: the orbits differ by {short(distance)}",
            f"the path is the same, not another one: the orbits differ by {short(distance)} only",
        ),
        holds(
            abs(change) <= 0.05,
            f"the periods differ by {short(change)} of themselves",
            f"the periods differ by {short(change)} of themselves (at most 0.05 allowed)",
        ),
    ]


@judge(
    "strip-faces",
    angles=numbers("common angles, degrees"),
    planar=numbers("frequency at Lambda at each angle"),
    homeotropic=numbers("frequency at -Lambda/2 at each angle"),
    planar_window=numbers("lower and upper end of the window at Lambda, degrees"),
    homeotropic_window=numbers("lower and upper end of the window at -Lambda/2, degrees"),
)
def strip_faces(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "angles", "planar", "homeotropic")
    for name in ("planar_window", "homeotropic_window"):
        if len(facts[name]) != 2 or facts[name][0] >= facts[name][1]:
            raise InvalidInput(f"the fact '{name}' is {facts[name].tolist()}; give both ends")
    outer, inner = facts["planar_window"], facts["homeotropic_window"]
    ratio = facts["planar"] / facts["homeotropic"]
    inside = bool(outer[0] < inner[0] and inner[1] < outer[1])
    return [
        all_above(
            "the ratio of the frequencies, planar over homeotropic,",
            ratio,
            1.0,
            said="at every common angle the strip flaps faster on its planar face, at least {value} "
            "times as fast",
        ),
        holds(
            inside,
            f"the window of the homeotropic face, {inner[0]:.1f}° to {inner[1]:.1f}°, "
            f"{'lies' if inside else 'does not lie'} inside that of the planar one, "
            f"{outer[0]:.1f}° to {outer[1]:.1f}°",
        ),
    ]


@judge(
    "snap-centred",
    widths=numbers("widths W of the light, over the length"),
    curvature_before_light=numbers("curvature at the middle before the light is on"),
    curvature_before_snap=numbers("curvature at the middle just before the snap"),
    snaps_down=flags("whether the strip snaps down"),
)
def snap_centred(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "widths", "curvature_before_light", "curvature_before_snap", "snaps_down")
    flat = facts["curvature_before_snap"] / facts["curvature_before_light"] <= 0
    return [
        _snaps_down(facts),
        for_every_reading(
            "the middle is flat or hollow before the snap",
            facts["widths"],
            flat,
            "W",
            "it is still arched",
        ),
    ]


def _snaps_down(facts: Facts) -> Check:
    return for_every_reading(
        "the strip snaps down",
        facts["widths"],
        facts["snaps_down"],
        "W",
        "it does not",
        said="the strip snaps down at every width tried",
    )


@judge(
    "snap-offcentre",
    widths=numbers("widths W of the light, over the length"),
    crest_drift=numbers("displacement of the crest until the snap; positive: away from the light"),
    crest_monotone=flags("whether the crest moves one way until the snap"),
    snaps_down=flags("whether the strip snaps down"),
    change_after=numbers("largest displacement after the snap in the stated time, over the length"),
)
def snap_offcentre(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "widths", "crest_drift", "crest_monotone", "snaps_down", "change_after")
    away = (facts["crest_drift"] > 0) & facts["crest_monotone"]
    return [
        _snaps_down(facts),
        for_every_reading(
            "the crest moves away from the light", facts["widths"], away, "W", "it does not"
        ),
        for_every_reading(
            "after the snap the shape changes by less than 1 %",
            facts["widths"],
            facts["change_after"] < 0.01,
            "W",
            "it goes on changing",
        ),
    ]


@judge(
    "snap-phase-portrait",
    widths=numbers("widths W of the light, over the length"),
    critical_centred=numbers("least light that snaps the strip, centered, for each width"),
    slopes=numbers("slope of the critical light against the offset, at small offset"),
    no_snap_at_large_offset=flags("whether the strip does not snap at the largest offset"),
)
def snap_phase_portrait(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "widths", "critical_centred", "slopes", "no_snap_at_large_offset")
    return [
        for_every_reading(
            "there is a least light that snaps the strip",
            facts["widths"],
            facts["critical_centred"] > 0,
            "W",
            "any light does",
        ),
        for_every_reading(
            "a small offset lowers the light that is needed",
            facts["widths"],
            facts["slopes"] < 0,
            "W",
            "it raises it",
        ),
        for_every_reading(
            "a large offset keeps the strip from snapping",
            facts["widths"],
            facts["no_snap_at_large_offset"],
            "W",
            "the strip snaps there too",
        ),
    ]


@judge(
    "snap-time-exponent",
    value=number("local slope of log T* against log Lambda at the brightest light"),
    light=numbers("Lambda over its critical value, increasing"),
    slopes=numbers("local slope of log T* against log Lambda there"),
    products=numbers("Lambda T* there"),
)
def snap_time_exponent(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "light", "slopes", "products")
    _ascending("light", facts["light"])
    bright = facts["light"] >= 20
    if np.count_nonzero(bright) < 3:
        raise InvalidInput("the fact 'light' needs at least three entries of 20 or more")
    worst = facts["slopes"][bright][np.argmax(np.abs(facts["slopes"][bright] + 1))]
    changes = np.abs(np.diff(facts["products"][bright]) / np.diff(np.log(facts["light"][bright])))
    return [
        within(
            "the slope furthest from −1, from 20 times the critical light on,",
            float(worst),
            -1,
            0.02,
        ),
        decreasing("the change of Λ T* with log Λ", changes, said="Λ T* converges"),
    ]


JUDGES = (
    lambda_typical,
    ring_steady_speed,
    ring_speed_symmetry,
    ring_speed_intensity,
    ring_curvature_profile,
    strip_cycle,
    strip_eigenvalue,
    strip_window,
    strip_best_angle_095,
    strip_best_angle_0957,
    strip_reverse,
    strip_faces,
    snap_centred,
    snap_offcentre,
    snap_phase_portrait,
    snap_time_exponent,
)
