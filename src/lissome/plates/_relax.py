r"""The way down of a thin plate, as if it moved in something viscous.

Where a shape gives way almost without resistance (a wave that turns, a ridge that wanders), the valley of
the energy is narrow and curved: a push along the critical mode leaves it at once, and the trust region of a
minimization is as narrow as the valley. Steps of :math:`g(y)+s\,M\,(y-x)=0`, of the implicit Euler method
for a viscous plate, follow it: each is solved to the end, so that its length is not bound to the range in
which the energy is quadratic, and s falls as fast as that goes well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._corrector import Balanced, CorrectionFailed, gauge_of, typical_size
from ..errors import FactorizationError

Array = NDArray[np.float64]
NONE = np.zeros(0)

#: Size of corrections, relative to typical unknowns, at which a step is solved.
SOLVED = 1e-7
#: Growth of the drag that is needed, at which a way down is no gentle one.
STEEPER = 60.0


def _step(
    structure: Any, start: Any, guess: Any, metric: Array, size: Array, drag: float, most: int = 10
) -> Any:
    """Return the end of one implicit step, and the number of factorizations."""
    state = guess

    def unbalanced(there: Any) -> Array:
        gradient = structure.evaluate(there, NONE, 1).gradient
        return gradient + drag * metric * structure.difference(start, there)

    for number in range(most):
        kkt = structure.evaluate(state, NONE, 2).kkt
        factors = kkt.factorize(shift=drag, gauge=gauge_of(structure, state), metric=metric)
        if not factors.is_minimum:
            raise CorrectionFailed("the drag is too small to hold the plate")
        dx, _ = factors.solve(-unbalanced(state))
        correction = float(np.max(np.abs(dx) / size))
        length = float(np.sqrt(dx @ (metric * dx)))
        part = 1.0
        while True:
            trial = structure.retract(state, part * dx)
            again, _ = factors.solve(-unbalanced(trial), refine=False)
            left = float(np.sqrt(again @ (metric * again)))
            if left <= (1.0 - 0.25 * part) * length or correction <= 10 * SOLVED:
                break
            part *= 0.5
            if part < 1e-2:
                raise CorrectionFailed("damped corrections come to nothing")
        state = trial
        if correction <= SOLVED or (part == 1.0 and np.max(np.abs(again) / size) <= SOLVED):
            return state, number + 1
    raise CorrectionFailed("corrections contract too slowly")


def relax(
    structure: Any,
    state: Any,
    finish: Callable[[Any, Any], Balanced],
    *,
    most: int = 80,
    farthest: float = np.inf,
) -> Balanced:
    """Let a plate go from a state that is no equilibrium, or an unstable one.

    Parameters
    ----------
    structure : Plate
    state : PlateState
    finish : callable
        Called with a structure and a state when the plate hardly moves any more; returns the
        equilibrium next to it, or raises CorrectionFailed.
    most : int
        Steps, after which to give up.
    farthest : float
        Way, in typical unknowns, after which to give up.

    Raises
    ------
    CorrectionFailed
        If no equilibrium is come to, or the way down is no gentle one: then a minimization is fit.
    """
    metric = np.asarray(structure.metric(state), dtype=float)
    size = typical_size(structure, state)
    energy = structure.evaluate(state, NONE, 0).energy
    begin, last, slower = state, np.zeros(len(size)), 0
    pull = structure.evaluate(state, NONE, 1).gradient
    drag = 1e3 * max(float(np.max(np.abs(pull) / (metric * size))), 1e-12)  # a thousandth of `size`
    least = drag
    stretch = 0.0  # what part of the last step to foretell
    for _ in range(most):
        try:
            guess = structure.retract(state, stretch * last)
            new, work = _step(structure, state, guess, metric, size, drag)
        except (CorrectionFailed, FactorizationError):
            stretch = 0.0
            drag *= 2.5
            if drag > STEEPER * least:
                raise CorrectionFailed("the valley becomes a slope: a snap") from None
            continue
        value = structure.evaluate(new, NONE, 0).energy
        if value > energy + 1e-12 * abs(energy):
            raise CorrectionFailed("the energy grows")
        step = structure.difference(state, new)
        least = min(least, drag)
        before, moved = np.max(np.abs(last) / size), np.max(np.abs(step) / size)
        state, energy, last = new, value, step
        if float(np.max(np.abs(structure.difference(begin, state)) / size)) > farthest:
            raise CorrectionFailed("the plate moves far")
        slower = slower + 1 if moved < 0.97 * before else 0
        if slower >= 3:
            try:
                return finish(structure, state)
            except CorrectionFailed:
                slower = 0
        ease = 0.4 if work <= 2 else 0.7 if work <= 4 else 1.0
        drag, stretch = ease * drag, min(1.0, 1.0 / ease) if moved > 0.5 * before else 0.0
    raise CorrectionFailed(f"the plate has not come to rest after {most} steps")
