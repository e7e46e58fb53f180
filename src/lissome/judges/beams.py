"""Judges of the claims on photomechanical beams (chapter 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput
from ._core import (
    Check,
    Facts,
    _short,
    all_above,
    all_below,
    decreasing,
    flags,
    for_every_reading,
    holds,
    increasing,
    judge,
    number,
    numbers,
    optional,
    order_of,
    same_length,
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
    checks = [within_percent("|Λ|", abs(facts["value"]), abs(claim.number), 2)]
    if "other_readings" in facts:
        near = np.abs(np.abs(facts["other_readings"]) / abs(claim.number) - 1) <= 0.02
        listed = ", ".join(f"{value:.3g}" for value in facts["other_readings"])
        found = "one of them agrees" if near.any() else "none agrees"
        checks.append(holds(True, f"other values printed elsewhere give {listed}: {found}"))
    return checks


@judge(
    "ring-steady-speed",
    intensities=numbers("Lambda of each run"),
    changes=numbers("relative change of the speed over the last revolution, for each Lambda"),
    speeds=optional(numbers("the steady speeds")),
)
def ring_steady_speed(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "changes")
    _demand("intensities", facts["intensities"], RING_INTENSITIES)
    checks = [all_below("the change over the last revolution", facts["changes"], 1e-3)]
    if "speeds" in facts:
        same_length(facts, "intensities", "speeds")
        checks.append(all_above("the speed", np.abs(facts["speeds"]), 0.0))
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
        all_below("|V(0)|", facts["value"], 1e-8),
        all_below("|V(angle) + V(-angle)|", facts["speeds"] + facts["mirrored_speeds"], 1e-8),
        increasing(f"V up to {facts['increasing_to']:.3g} rad", np.r_[0.0, facts["speeds"][part]]),
        holds(
            facts["slope"] > 0,
            f"the slope at 0 is {facts['slope']:.4g}, and the linear theory breaks down at "
            f"{facts['breakdown']:.4g} rad",
        ),
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
    listed = ", ".join(
        f"{100 * d:.2g} % at {i:g}"
        for i, d in zip(facts["intensities"], facts["deviations"], strict=True)
    )
    return [
        order_of("the deviation from (3.29)", facts["intensities"], facts["deviations"], 1),
        holds(
            bool(near.all()),
            f"the deviation is {listed}: independent (at most 5 %) up to Λ = {largest:g}",
        ),
    ]


@judge(
    "ring-curvature-profile",
    intensities=numbers("Lambda of each run"),
    differences=numbers("relative rms difference of (K0 - Kr)/Lambda from linear theory"),
)
def ring_curvature_profile(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "intensities", "differences")
    _demand("intensities", facts["intensities"], RING_INTENSITIES)
    listed = ", ".join(
        f"{100 * d:.2g} % at {i:g}"
        for i, d in zip(facts["intensities"], facts["differences"], strict=True)
    )
    order = order_of("the difference", facts["intensities"], facts["differences"], 1)
    return [Check(order.outcome, f"{order.sentence}; it is {listed}")]


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
        all_below("the distance after one period", facts["return_distance"], 1e-6),
        holds(
            facts["snaps_per_period"] == 2,
            f"{facts['snaps_per_period']:.0f} snaps in a period (two expected)",
        ),
        all_above("the drift of the crest away from the light", facts["crest_drift"], 0.0),
        all_below("the difference of the cycles from both sides", facts["side_difference"], 1e-6),
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
        all_below("the eigenvalue at the snap", facts["value"], 1e-2),
        within("the exponent at worst", float(worst), 0.5, 0.05),
        all_above("the eigenvalue after a snap", facts["after"], 0.0),
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
    ends = ", ".join(
        f"{low:.1f} to {high:.1f} at {i:g}"
        for i, low, high in zip(facts["intensities"], facts["lower"], facts["upper"], strict=True)
    )
    return [
        all_below("the uncertainty of the ends", facts["resolution"], 0.1, "degrees"),
        holds(
            bool(np.all(np.diff(facts["lower"]) < 0) and np.all(np.diff(facts["upper"]) > 0)),
            f"each window holds the one of weaker light: {ends}",
            f"the windows are not nested: {ends}",
        ),
        increasing(f"the frequency at {facts['angle']:g} degrees", facts["frequencies"]),
    ]


def _best_angle(claim: Claim, facts: Facts) -> list[Check]:
    return [
        all_below("the uncertainty of the angle", facts.uncertainty, 0.1, "degrees"),
        within("the best angle", facts["value"], claim.number, 0.5, "degrees", facts.uncertainty),
        all_below("its spread over Λ", facts["spread"], 1.0, "degrees"),
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
        all_above("the drift of the crest towards the light", -facts["crest_drift"], 0.0),
        holds(
            abs(distance) > 1e-8,
            f"the orbits differ by {_short(distance)}"
            + ("" if abs(distance) > 1e-8 else ": they are the same path, not another one"),
        ),
        holds(
            abs(change) <= 0.05,
            f"the periods differ by {_short(change)}"
            + (": they are equal" if abs(change) <= 1e-8 else " (not significant up to 5 %)"),
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
        all_above("the ratio of the frequencies, planar over homeotropic,", ratio, 1.0),
        holds(
            inside,
            f"the window of the homeotropic face, {inner[0]:.1f} to {inner[1]:.1f} degrees, "
            f"{'lies' if inside else 'does not lie'} inside that of the planar face, "
            f"{outer[0]:.1f} to {outer[1]:.1f}",
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
        for_every_reading("the strip snaps down", facts["widths"], facts["snaps_down"]),
        for_every_reading(
            "the curvature at the middle has passed zero before the snap", facts["widths"], flat
        ),
    ]


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
        for_every_reading("the strip snaps down", facts["widths"], facts["snaps_down"]),
        for_every_reading("the crest moves away from the light", facts["widths"], away),
        for_every_reading(
            "the shape changes by less than 1 % after the snap",
            facts["widths"],
            facts["change_after"] < 0.01,
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
        ),
        for_every_reading(
            "the least light falls with the offset", facts["widths"], facts["slopes"] < 0
        ),
        for_every_reading(
            "the strip does not snap at large offset",
            facts["widths"],
            facts["no_snap_at_large_offset"],
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
        within("the slope from 20 times the critical light on, at worst,", float(worst), -1, 0.02),
        decreasing("the change of Λ T* with log Λ", changes),
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
