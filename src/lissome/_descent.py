"""From a lost equilibrium down to a stable one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._corrector import EPS, Balanced, CorrectionFailed, correct, typical_size
from .equilibrium import Equilibrium, equilibrate
from .errors import LissomeError, NotConverged, StabilityNotResolvable, Unstable

Array = NDArray[np.float64]

# Lengths of the push along the critical mode, relative to the typical size of the unknowns: the
# least, and the one that is never exceeded.
_LEAST, _MOST = 1e-4, 0.4
# States nearer than this (relative) are the same.
_SAME = 1e-6
# How far the lost state can have moved while what changes was frozen just beyond.
_CLOSE = 0.02


def distance(structure: Any, one: Any, other: Any) -> float:
    """Return the largest difference of two states relative to the typical unknowns."""
    gap = np.abs(structure.difference(one, other)) / typical_size(structure, one)
    return float(np.max(gap))


def _energy_before(structure: Any, before: Balanced, modes: Array) -> tuple[float, float]:
    """Return the energy that a state of a nearby structure has in `structure`, and a bound of its error.

    With the work of the forces of supports that move from the one to the other. If these forces grow,
    it is the energy of the state that follows where nothing moves along the critical `modes`: errors of
    the one Newton step to it matter with their square, as far as the step is not far.
    """
    state, factors = structure.adopt(before.state), before.factorization
    here = structure.evaluate(state, before.multipliers, 1)
    energy = float(here.energy + before.multipliers @ here.constraints)
    if before.marginal:
        return energy, 0.0
    gradient, constraints = np.array(here.gradient), here.constraints
    metric = np.asarray(structure.metric(state), dtype=float)
    for mode in modes:
        load = metric * mode
        dx, dm = factors.solve(load)  # the mode, over its eigenvalue
        gradient -= load * float(dx @ gradient + dm @ constraints) / float(dx @ load)
    dx, dm = factors.solve(-gradient, -constraints)
    growth = 0.5 * float(dx @ gradient + dm @ constraints)
    if not growth > 0.0 or structure.max_step(state, dx) < 1.0:
        return energy + max(growth, 0.0), 0.0
    multipliers = before.multipliers + dm
    there = structure.evaluate(structure.retract(state, dx), multipliers, 0)
    found = float(there.energy + multipliers @ there.constraints) - energy
    found = min(max(found, 0.5 * growth), 2.0 * growth)
    return energy + found, 0.1 * abs(found - growth)


def descend(
    structure: Any,
    before: Balanced,
    modes: Array,
    signs: Sequence[int],
    interrupted: Callable[[str], LissomeError],
) -> tuple[Equilibrium, float]:
    """Return a stable equilibrium of `structure` below a state that has just lost its stability.

    And the energy of that state in `structure`: where a branch that turns joins a stable one there, it is
    that of the stable state.

    The state is pushed along the critical mode, with each of `signs` in turn, and the energy is then
    minimized. A result that is the continuation of the lost state, or that lies higher, is refused.

    Parameters
    ----------
    structure : Structure
        With everything that changes frozen.
    before : Balanced
        The last state that was stable.
    modes : ndarray, shape (k, n)
        Critical modes; the push is along the first, and then along the others.
    signs : sequence of int
        Directions to try along each mode.
    interrupted : callable
        Makes the exception from a message.
    """
    state = structure.adopt(before.state)
    top, doubt = _energy_before(structure, before, modes)
    size = typical_size(structure, state)
    kept = _continued(structure, state, before.multipliers)
    if kept is not None:
        top = max(top, kept.energy)
    slack = doubt + 1e3 * EPS * (abs(top) + abs(before.energy))

    def lagrangian(dx: Array) -> float:
        if structure.max_step(state, dx) < 1.0:
            return math.inf
        here = structure.evaluate(structure.retract(state, dx), before.multipliers, 0)
        return here.energy + float(before.multipliers @ here.constraints)

    descended = getattr(structure, "descended", lambda *place: None)
    reasons = ["no push along the critical mode lowers the energy"]
    for mode in modes:
        unit = mode / float(np.max(np.abs(mode) / size))
        for sign in signs:
            for push in _pushes(lagrangian, sign * unit):
                dx = sign * push * unit
                if structure.max_step(state, dx) < 1.0:
                    reasons.append("a push leaves the domain of the energy")
                    continue
                start = (structure.retract(state, dx), before.multipliers)
                try:
                    # Newton's method leads back to the saddle: the structure's own way down first.
                    lower = descended(*start) or start
                    after = equilibrate(structure, *lower, require="stable")
                except (NotConverged, Unstable, StabilityNotResolvable) as error:
                    reasons.append(str(error))
                    continue
                if kept is not None and distance(structure, kept.state, after.state) < _SAME:
                    reasons.append("the descent came back to the state that it had left")
                    continue
                if after.energy > top + slack:
                    reasons.append("the descent ended at a higher energy")
                    continue
                return after, max(top, after.energy)
    raise interrupted(
        f"no stable state was found below the one that lost its stability ({reasons[-1]}); the "
        "energy may have no minimum there"
    )


def _pushes(energy: Callable[[Array], float], unit: Array) -> list[float]:
    """Return lengths to try: first the one that leads farthest down, then shorter and longer ones."""
    best, lowest = _LEAST, energy(_LEAST * unit)
    length = 2 * _LEAST
    while length <= _MOST:
        value = energy(length * unit)
        if not value < lowest:
            break
        best, lowest, length = length, value, 2 * length
    return [best, *(other for other in (0.25 * best, 4 * best) if other <= _MOST)]


def _continued(structure: Any, state: Any, multipliers: Array) -> Balanced | None:
    """Return the equilibrium that continues a state, if there is one close by."""
    try:
        kept = correct(structure, state, multipliers)
    except CorrectionFailed:
        return None
    return kept if distance(structure, state, kept.state) < _CLOSE else None
