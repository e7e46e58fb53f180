"""Where solvers start: states carried over from other ribbons, and closed bands made by turning an end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..equilibrium import equilibrate
from ..errors import LissomeError, NotConverged
from ..rods import RodState
from ..rods.quaternions import conjugate, exponential, logarithm, multiply

if TYPE_CHECKING:
    from ._equilibrium import RibbonEquilibrium
    from ._structure import Ribbon, RibbonState

__all__ = ["carried_over", "turned_band"]

Array = NDArray[np.float64]

#: Segments with which the end of a circle is turned.
COARSE = 120
#: Angle by which the end is turned at once.
TURN = math.pi / 8.0
#: Width over length of the strip whose end is turned.
NARROW = 0.04
#: Factor by which the width then grows at once.
WIDEN = 1.35


def carried_over(ribbon: Ribbon, source: RibbonEquilibrium) -> tuple[RodState, Array, Array]:
    """Return the center line, and the rulings and folds at the hinges, of another ribbon's equilibrium.

    Frames are interpolated in arc length (as a fraction of the length).
    """
    old: Ribbon = source.structure
    ratio = ribbon.length / old.length
    middle = 0.5 * (old.arclength[:-1] + old.arclength[1:]) * ratio
    frames = np.array(source.state.quaternions)
    s, q = middle, frames
    if old.closed:
        joint = exponential([0.0, 0.0, old.rod.joint])
        before = multiply(frames[-1], conjugate(joint))
        after = multiply(frames[0], joint)
        s = np.concatenate([[middle[-1] - ribbon.length], middle, [middle[0] + ribbon.length]])
        q = np.concatenate([before[None], frames, after[None]])
    # Inflections that are pinned to the middle of the first segment stay there.
    pinned = ribbon.pins_phase and old.pins_phase
    shift = 0.5 * (old.lengths[0] * ratio - ribbon.lengths[0]) if pinned else 0.0
    at = 0.5 * (ribbon.arclength[:-1] + ribbon.arclength[1:]) + shift
    if at.size == middle.size and np.allclose(at, middle, rtol=0.0, atol=1e-12 * ribbon.length):
        new = frames
    else:
        k = np.clip(np.searchsorted(s, at) - 1, 0, s.size - 2)
        part = (at - s[k]) / (s[k + 1] - s[k])
        steps = logarithm(multiply(conjugate(q[k]), q[k + 1]))
        new = multiply(q[k], exponential(part[:, None] * steps))
        new /= np.sqrt(np.sum(new**2, axis=1))[:, None]
    # rulings, as functions of the arc length
    where = np.array(source.hinge_arclength) * ratio
    eta, fold = np.array(source.ruling), np.arctanh(np.clip(
        0.5 * old.law.width * source.ruling_slope, -1.0 + 1e-12, 1.0 - 1e-12))  # fmt: skip
    if old.closed:  # beyond the joint too
        where[-1] = length = ribbon.length
        where = np.concatenate([where[-2:] - length, where, where[:2] + length])
        eta, fold = (
            np.concatenate([old._joint_sign * v[-2:], v, old._joint_sign * v[:2]])
            for v in (eta, fold)
        )
    targets = np.array(ribbon.layout.arclength)
    if ribbon.closed:
        targets[-1] = ribbon.length
    targets += shift
    state = RodState(new, np.array(source.state.origin) * ratio)
    return state, np.interp(targets, where, eta), np.interp(targets, where, fold)


def turned_band(ribbon: Ribbon) -> RibbonState:
    """Return the state of a closed band that a circle becomes when its end is turned and joined.

    The strip is narrow while it is turned; then its width grows to that of `ribbon`.
    """
    from .laws import Wunderlich
    from .shapes import band, circle

    length, law = ribbon.length, ribbon.law
    width = NARROW * length
    target = law.width if law.has_fold else width
    first = Wunderlich(width=width, rigidity=1.0 / width)
    total = math.pi * ribbon.half_turns
    steps = max(1, math.ceil(abs(total) / TURN - 1e-9))
    found: Any = None
    try:
        for turn in np.linspace(0.0, total, steps + 1):
            bent = circle(length, COARSE, first, turn=float(turn))
            found = equilibrate(bent, start=found)
        # A strip narrower than this needs its own mesh: the bending changes sign within a width.
        count = COARSE if target >= width else max(COARSE, ribbon.lengths.size)
        closed = band(length, count, first, ribbon.half_turns)
        found = equilibrate(closed, start=closed.adapted(found))
        while width != target:
            width = min(width * WIDEN, target) if width < target else max(width / WIDEN, target)
            found = equilibrate(closed.with_width(width), start=found)
    except LissomeError as error:
        raise NotConverged(
            f"no band with {ribbon.half_turns} half turns was reached by turning the end of a circle and "
            f"widening it (at width {width:.4g} of {target:.4g}): {error}; start from a state of your "
            "own with `with_initial`",
            state=None if found is None else found.state,
        ) from error
    state = ribbon.adapted(found)
    if not (ribbon.half_turns % 2 and (law.natural_curvature or law.natural_cross_curvature)):
        return state
    # One of its sides is hollow at rest: begin with the hollow side in.
    other = _turned_over(state)
    nothing = np.zeros(ribbon.constraints_count)
    energies = [ribbon.evaluate(ribbon.adopt(s), nothing, 0).energy for s in (state, other)]
    return other if energies[1] < energies[0] else state


def _turned_over(state: RibbonState) -> RibbonState:
    """Return the same shape with the sides of the strip exchanged: frames turn about their tangents.

    The whole is turned so that the first frame stays where it is.
    """
    half_turn = np.array([0.0, 0.0, 0.0, 1.0])
    frames = np.array(state.quaternions)
    back = multiply(multiply(frames[0], conjugate(half_turn)), conjugate(frames[0]))
    frames = multiply(back, multiply(frames, half_turn))
    return replace(state, quaternions=frames, rulings=-state.rulings, folds=-state.folds)
