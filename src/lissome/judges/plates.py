"""Judges of claims on plates (chapter 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ._core import (
    Check,
    Facts,
    Outcome,
    all_above,
    all_below,
    decreasing,
    flag,
    flags,
    holds,
    increasing,
    judge,
    number,
    numbers,
    same_length,
    short,
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
            "computer algebra finds both terms, of stretching and of bending",
            "the stretching term differs",
        ),
        holds(
            facts["bending_equal"],
            "",
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
    name = "the curvature changes sign once with the high-modulus side down, and never with it up,"
    if true.all():
        signs = Check(Outcome.HOLDS, f"{name} in all {count} fits")
    elif not true.any():
        signs = Check(Outcome.FAILS, f"{name} in none of {count} fits")
    else:
        signs = Check(
            Outcome.UNDETERMINED,
            f"{name} in {true.sum()} of {count} fits: where the soft film strains "
            f"{ratios[true].min():.3g} times as much as the stiff one, or more. It fails for ratios "
            f"from {ratios[~true].min():.3g} to {ratios[~true].max():.3g}",
        )
    monotone = bool(facts["strain_monotone"].all())
    return [
        signs,
        holds(monotone, "the in-plane strain is monotone", "the in-plane strain turns back"),
        all_below(
            "the sum of the final curvatures over their size",
            facts["limit_mismatch"],
            1e-6,
            said="the final curvatures are opposite",
        ),
        holds(
            True,
            "on the way the in-plane strains of both cases differ by at most "
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
        within_percent(
            "the height in m",
            facts["value"],
            claim.number,
            2,
            spread=facts.uncertainty,
            said="the printed parameters give the printed height, to {distance} %",
        ),
        holds(True, f"the modulus C of Table A.1, however, is {ratio:.3g} times the printed one"),
    ]


@judge(
    "offset-critical-curvature",
    value=number("critical curvature at offset 0.1 towards the edge over that of the centered one"),
    strains=numbers("strain differences over (t/L)^2"),
    offsets=numbers("offsets of the defect over the side of the sheet"),
    to_edge=numbers("critical curvatures over t/L^2 towards an edge, strain by strain"),
    to_corner=numbers("critical curvatures over t/L^2 towards a corner, strain by strain"),
)
def offset_critical_curvature(claim: Claim, facts: Facts) -> list[Check]:
    return _falls_with_offset("the critical curvature", facts)


@judge(
    "offset-energy",
    value=number("energy released at offset 0.1 towards the edge over that of the centered one"),
    strains=numbers("strain differences over (t/L)^2"),
    offsets=numbers("offsets of the defect over the side of the sheet"),
    to_edge=numbers("released energies over C t^4/L^2 towards an edge, strain by strain"),
    to_corner=numbers("released energies over C t^4/L^2 towards a corner, strain by strain"),
)
def offset_energy(claim: Claim, facts: Facts) -> list[Check]:
    return _falls_with_offset("the released energy", facts)


def _falls_with_offset(name: str, facts: Facts) -> list[Check]:
    """Decide whether something falls with the offset of the defect, at each of several strains."""
    strains, offsets = facts["strains"], facts["offsets"]
    if len(strains) < 2:
        raise InvalidInput("the fact 'strains' has one entry; the claim is tested at two or more")
    steps = np.diff(offsets)
    if offsets[0] != 0 or offsets[-1] < 0.3 or np.any(steps <= 0) or np.any(steps > 0.1 + 1e-9):
        raise InvalidInput(
            f"the fact 'offsets' is {offsets.tolist()}; it must go from 0 to 0.3 or more in steps of "
            "at most 0.1"
        )
    checks = []
    kept = []
    for fact, way in (("to_edge", "an edge"), ("to_corner", "a corner")):
        if len(facts[fact]) != len(strains) * len(offsets):
            raise InvalidInput(
                f"the fact '{fact}' has {len(facts[fact])} entries; {len(strains)} strains times "
                f"{len(offsets)} offsets are needed"
            )
        for strain, row in zip(strains, facts[fact].reshape(len(strains), -1), strict=True):
            full = f"{name} towards {way} at the strain {strain:g} (t/L)²"
            checks.append(decreasing(full, row, said=""))
            kept.append(row[-1] / row[0])
    return [
        Check(
            Outcome.HOLDS,
            f"{name} falls towards edge and corner, at every strain tried: an offset of "
            f"{offsets[-1]:.2g} leaves {100 * min(kept):.2g} to {100 * max(kept):.2g} % of it",
        ),
        *checks,
    ]


@judge(
    "offset-height-measured",
    offsets=numbers("offsets of the defect over the side of the sheet"),
    measured=numbers("measured heights, mm"),
    bounds=numbers("energy bounds of the heights, mm, strain by strain"),
)
def offset_height_measured(claim: Claim, facts: Facts) -> list[Check]:
    offsets, measured = facts["offsets"], facts["measured"]
    same_length(facts, "offsets", "measured")
    if len(facts["bounds"]) % len(offsets):
        raise InvalidInput(
            f"the fact 'bounds' has {len(facts['bounds'])} entries, no multiple of {len(offsets)}"
        )
    bounds = facts["bounds"].reshape(-1, len(offsets))
    if np.any(bounds <= 0):
        raise InvalidInput(
            "the fact 'bounds' must be positive: a sheet that snaps sets energy free"
        )
    share = measured / bounds
    checks = [
        decreasing(
            "the measured height",
            measured,
            said="the measured height and the energy bound both fall with the offset",
        ),
        *(decreasing("the bound", row, said="") for row in bounds),
    ]
    parts = [
        f"{_percent_range(part)} at {offset:.2g}"
        for offset, part in zip(offsets, share.T, strict=True)
    ]
    checks.append(
        holds(
            bool(np.all(share <= 1)),
            f"the leap uses little of the bound: {', '.join(parts)}",
            f"a leap is higher than the energy bound, {share.max():.3g} times",
        )
    )
    return checks


def _percent_range(shares: Any) -> str:
    low, high = short(100 * shares.min()), short(100 * shares.max())
    return f"{low} %" if low == high else f"{low} to {high} %"


@judge(
    "thickness-critical-curvature",
    value=number("critical curvature over t/L^2 at the strain difference 300 (t/L)^2"),
    strains=numbers("strain differences over (t/L)^2"),
    curvatures=numbers("critical curvatures over t/L^2: F"),
    slopes=numbers("d ln F/d ln(strain) there"),
    thicknesses=numbers("thicknesses over the size of which the scaled curves are compared"),
    collapse=number("largest relative difference of their F at one scaled strain"),
)
def thickness_critical_curvature(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "strains", "curvatures", "slopes")
    _several_thicknesses(facts)
    # At a fixed strain kappa_c = (t/L^2) F(strain L^2/t^2) changes as t^(1 - 2 slope).
    return [
        all_below(
            "the difference of F between thicknesses",
            facts["collapse"],
            1e-5,
            said="the curves of all thicknesses fall on one, F, to {value}",
        ),
        increasing("F", facts["curvatures"], said="F rises with the strain"),
        all_above(
            "the log-slope of F",
            facts["slopes"],
            0.5,
            said="its log-slope is at least {value}: above 1/2, thicker sheets need less curvature",
        ),
    ]


@judge(
    "thickness-energy",
    value=number("released energy over C t^4/L^2 at the strain difference 300 (t/L)^2"),
    strains=numbers("strain differences over (t/L)^2, increasing"),
    slopes=numbers("d ln G/d ln(strain) there, G the released energy over C t^4/L^2"),
    thicknesses=numbers("thicknesses over the size of which the scaled curves are compared"),
    collapse=number("largest relative difference of their G at one scaled strain"),
    crossing=number("scaled strain at which the slope is 2"),
)
def thickness_energy(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "strains", "slopes")
    _several_thicknesses(facts)
    strains, above = facts["strains"], facts["slopes"] > 2
    changes = int(np.sum(above[1:] != above[:-1]))
    # At a fixed strain the energy changes as t^(4 - 2 slope).
    return [
        all_below(
            "the difference of G between thicknesses",
            facts["collapse"],
            1e-5,
            said="the curves of all thicknesses fall on one, G, to {value}",
        ),
        holds(
            changes == 1 and bool(above[0]) and bool(np.all(np.diff(strains) > 0)),
            f"its log-slope falls through 2 once, at a strain of {facts['crossing']:.0f} (t/L)²: "
            "below it thin sheets release more, above it thick ones",
            f"the log-slope of G passes 2 {changes} times, from {facts['slopes'][0]:.3g} to "
            f"{facts['slopes'][-1]:.3g}",
        ),
    ]


def _several_thicknesses(facts: Facts) -> None:
    if len(set(facts["thicknesses"].tolist())) < 4:
        raise InvalidInput(
            f"the fact 'thicknesses' is {facts['thicknesses'].tolist()}; four or more are compared"
        )


@judge(
    "released-energy",
    value=number("energy over C L^2 that the experiment's own stack releases, one stated fit"),
    stack=numbers("the same for every fit with which the stack snaps"),
    fits=number("how many fits there are"),
    thicknesses=numbers("thicknesses over the size"),
    strains=numbers("strain difference with which each of them releases the printed energy"),
)
def released_energy(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "thicknesses", "strains")
    printed, found = claim.number, facts["stack"]
    pairs = holds(
        bool(np.all(facts["strains"] > 0)),
        f"the printed energy belongs to pairs of strain and thickness, from a strain of "
        f"{short(facts['strains'].min())} to {short(facts['strains'].max())} for h/L from "
        f"{short(facts['thicknesses'].min())} to {short(facts['thicknesses'].max())}",
        "some thicknesses release the printed energy at no strain",
    )
    low, high = found.min(), found.max()
    name = (
        f"the stack snaps in {len(found)} of {facts['fits']:.0f} fits and releases "
        f"{short(low)} to {short(high)}"
    )
    if np.all(np.abs(found / printed - 1) <= 0.2):
        own = Check(Outcome.HOLDS, name)
    elif low <= printed <= high:
        own = Check(
            Outcome.UNDETERMINED,
            f"{name}. The printed value lies between, but the text does not say which fit is meant",
        )
    else:
        own = Check(Outcome.FAILS, f"{name}, never the printed value")
    return [pairs, own]


@judge(
    "jump-height-size",
    sizes=numbers("sizes of the sheet"),
    heights=numbers("energy bounds of the jump height"),
)
def jump_height_size(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "sizes", "heights")
    if facts["sizes"].max() < 2 * facts["sizes"].min():
        raise InvalidInput("the fact 'sizes' spans less than a factor of 2; that is no test")
    ratio = float(facts["heights"].max() / facts["heights"].min())
    grown = float(facts["sizes"].max() / facts["sizes"].min())
    return [
        holds(
            ratio <= 1.01,
            f"a sheet {grown:.3g} times as large leaps as high, to {short(ratio - 1, 1)}",
            f"among sheets up to {grown:.3g} times as large the height varies {ratio:.3g}-fold",
        )
    ]


@judge(
    "directional-leap",
    heights=numbers("heights of the leap taken, mm"),
    tilts_legs=numbers("launch angles from the vertical with legs, degrees, each height"),
    tilts_plain=numbers("launch angles without legs, degrees, each height"),
    speeds=numbers("launch speeds with legs, m/s, each height"),
    differences=numbers("difference of the legs of a sheet so tilted, mm, each height"),
    side=number("side of the sheet, mm"),
    bound=number("energy bound of the height, mm"),
)
def directional_leap(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "heights", "tilts_legs", "tilts_plain", "speeds", "differences")
    energies = facts["speeds"] ** 2 / (2 * 9.8) * 1e3
    legs, tilts = facts["differences"], facts["tilts_legs"]
    return [
        holds(
            bool(np.all(tilts > facts["tilts_plain"])),
            f"with legs the sheet leaves {tilts.min():.2g}° to {tilts.max():.2g}° from the "
            f"vertical, without them {facts['tilts_plain'].min():.2g}° to "
            f"{facts['tilts_plain'].max():.2g}°",
            "legs do not tilt the launch",
        ),
        holds(
            bool(np.all(legs < facts["side"])),
            f"a rigid sheet is so tilted if its legs differ by {legs.min():.2g} to "
            f"{legs.max():.2g} mm",
            "no legs of a rigid sheet give that tilt",
        ),
        holds(
            bool(np.all(energies < facts["bound"])),
            f"the launch takes at most {100 * energies.max() / facts['bound']:.2g} % of the energy "
            "bound",
            "the launch takes more than the energy bound",
        ),
    ]


def _in_fits(name: str, true: Any, ratios: Any) -> Check:
    """Check a statement for every fit of the strain curves, told apart by the ratio of strains."""
    count = len(true)
    if true.all():
        return Check(Outcome.HOLDS, f"{name} in all {count} fits")
    if not true.any():
        return Check(Outcome.FAILS, f"{name} in none of {count} fits")
    return Check(
        Outcome.UNDETERMINED,
        f"{name} in {int(true.sum())} of {count} fits. In those the stiff film strains up to "
        f"{short(ratios[true].max())} times as much as the soft one; in the others, "
        f"{short(ratios[~true].min())} times or more",
    )


@judge(
    "sheet-snap-orientation",
    ratios=numbers("strain of the stiff film over that of the soft one on the plate, each fit"),
    inverts_down=flags("whether the sheet inverts with the high-modulus side down, each fit"),
    inverts_up=flags("whether it inverts with the high-modulus side up, each fit"),
    runs_down=flags("whether it inverts in full runs with the high-modulus side down"),
    runs_predicted=flags("whether the master curve says that it does, for the same runs"),
    runs_up=flags("whether it inverts in full runs with the high-modulus side up"),
)
def sheet_snap_orientation(claim: Claim, facts: Facts) -> list[Check]:
    same_length(facts, "ratios", "inverts_down", "inverts_up")
    same_length(facts, "runs_down", "runs_predicted")
    up = int(facts["inverts_up"].sum())
    return [
        _in_fits(
            "with the high-modulus side down the sheet inverts",
            facts["inverts_down"],
            facts["ratios"],
        ),
        holds(
            not up and not facts["runs_up"].any(),
            "with the high-modulus side up it never does",
            f"with the high-modulus side up it inverts in {up} fits and "
            f"{int(facts['runs_up'].sum())} full runs",
        ),
        holds(
            bool((facts["runs_down"] == facts["runs_predicted"]).all()),
            "full runs do what the scaling law says",
            "a full run does not do what the scaling law says",
        ),
    ]


@judge(
    "dome-first-up",
    lifts=numbers("least height of the center over the rim before the inversion, over L"),
    inverts=flag("whether the sheet inverts later on"),
    cone_errors=numbers("height of ever thinner discs over R sqrt(2 Delta), minus 1"),
    cone_limit=number("the same extrapolated to no thickness"),
)
def dome_first_up(claim: Claim, facts: Facts) -> list[Check]:
    errors = np.abs(facts["cone_errors"])
    return [
        all_above(
            "the height of the center over the highest part of the rim",
            facts["lifts"].min(),
            0.0,
            "L",
            said="the sheet first rises: its center stands at least {value} over the highest part of "
            "the rim until it inverts",
        ),
        holds(facts["inverts"], "", "the sheet does not invert later"),
        decreasing("the distance from the height of a cone", errors, said=""),
        all_below(
            "the distance from a cone without thickness",
            abs(facts["cone_limit"]),
            0.02,
            said="ever thinner sheets tend to the cone of slope √(2Δ), whose height is met within "
            f"{short(100 * abs(facts['cone_limit']))} %",
        ),
    ]


@judge(
    "laminate-variants",
    ratios=numbers("strain of the stiff film over that of the soft one on the plate, each fit"),
    base=numbers("bound of the leap of 1 stiff + 2 soft films, 0 without a snap, mm, each fit"),
    two_stiff=numbers("the same of 2 stiff + 1 soft films"),
    thin=numbers("the same of 1 stiff + 1 soft films"),
    thick=numbers("the same of 1 stiff + 3 soft films"),
)
def laminate_variants(claim: Claim, facts: Facts) -> list[Check]:
    names = ("base", "two_stiff", "thin", "thick")
    same_length(facts, "ratios", *names)
    all_snap = np.all([facts[name] > 0 for name in names], axis=0)
    checks = [_in_fits("all four stacks snap, as was observed,", all_snap, facts["ratios"])]
    for name, stack in (("two_stiff", "2 stiff + 1 soft"), ("thin", "1 stiff + 1 soft")):
        both = (facts["base"] > 0) & (facts[name] > 0)
        if not both.any():
            checks.append(
                Check(
                    Outcome.UNDETERMINED, f"{stack} films snap in no fit in which the sheet snaps"
                )
            )
            continue
        checks.append(
            _in_fits(
                f"{stack} films have less energy to leap than the sheet",
                facts[name][both] < facts["base"][both],
                facts["ratios"][both],
            )
        )
    return checks


JUDGES = (
    sheet_snap_orientation,
    dome_first_up,
    laminate_variants,
    laminate_uniform,
    laminate_sign_change,
    jump_height,
    offset_critical_curvature,
    offset_energy,
    offset_height_measured,
    thickness_critical_curvature,
    thickness_energy,
    released_energy,
    jump_height_size,
    directional_leap,
)
