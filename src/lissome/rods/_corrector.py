"""A fast corrector for rods: Newton's method with few safeguards."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FactorizationError
from ..factorization import Factorization
from ..structure import Corrected, Evaluation

if TYPE_CHECKING:
    from ._structure import Rod, RodState

__all__ = ["fast_correction"]

Array = NDArray[np.float64]

#: Iterations after which the corrector gives up.
LIMIT = 25
#: Largest turn (radians) of a segment in one step.
LARGEST = 1.5
#: Newton steps up to this size (radians) are followed by one with the same factors.
CLOSE = 1e-3
#: Newton steps up to this size (radians) need no look at the next one.
SURE = 1e-6
#: Newton steps up to this size (radians) lead to a stationary point nearby.
NEAR = 0.3


def fast_correction(
    rod: Rod, state: RodState, multipliers: Array, tolerance: float
) -> Corrected | None:
    """Return a stationary point near `state`, or None.

    None too if a stationary point that is not a minimum seems to be near: whoever wants it must not
    be led away from it. Else the Hessian is shifted until the matrix has the inertia of a minimum. A
    step is taken if it lowers the energy with the constraints as penalties, or if it is followed by
    a much shorter one.
    """
    gauge = rod.gauge(state)
    # A straight isotropic rod does not move when it turns about itself; bent, it does. No ribbon is so.
    revealed = getattr(rod, "isotropic", False)
    here = rod.evaluate(state, multipliers, 2)
    penalty = np.zeros(multipliers.size)
    shift, expected, last = 0.0, math.inf, math.inf
    for iteration in range(LIMIT):
        found = _factors(rod, state, here, gauge, shift)
        if found is None:
            return None
        factor, shift = found
        assert here.gradient is not None
        if shift == 0.0 and last <= min(SURE, 1e3 * tolerance):  # its square is far below
            return Corrected(state, multipliers, here, factor, iteration)
        if shift > 0.0 and iteration == 0 and _is_near_saddle(here, gauge):
            return None
        try:
            dx, dm = factor.solve(-here.gradient, -here.constraints, refine=False)
        except FactorizationError:
            return None
        size = float(np.max(np.abs(dx)))
        if not math.isfinite(size):
            return None
        unit = rod.typical(state)
        if shift == 0.0 and float(np.max(np.abs(dx) / unit)) <= tolerance:
            return Corrected(state, multipliers, here, factor, iteration)
        step = LARGEST / max(size, LARGEST)
        if size > 1e-3:
            step = min(step, rod.max_step(state, dx))
        target = np.abs(multipliers + dm)
        penalty = np.maximum(target, 0.5 * (penalty + target))
        merit = here.energy + float(penalty @ np.abs(here.constraints))
        slack = 1e-13 * (abs(here.energy) + float(penalty @ np.abs(here.constraints)))
        converging = shift == 0.0 and step == 1.0 and size <= expected
        if converging and size <= CLOSE:  # a second step with the same factors
            state, multipliers = rod.retract(state, dx), multipliers + dm
            new = rod.evaluate(state, multipliers, 1)
            assert new.gradient is not None
            dx, dm = factor.solve(-new.gradient, -new.constraints, refine=False)
            second = float(np.max(np.abs(dx) / unit))
            if not second <= 0.1 * size:
                return None
            state, multipliers = rod.retract(state, dx), multipliers + dm
            here = rod.evaluate(state, multipliers, 2)
            if gauge.shape[0] or revealed:
                gauge = rod.gauge(state)
            # The error that is left shrinks once more by the ratio of the two steps.
            last = second
            continue
        for attempt in range(5):
            trial = rod.retract(state, step * dx)
            new = rod.evaluate(trial, multipliers + step * dm, 2 if attempt == 0 else 1)
            if converging or _merit(new, penalty) <= merit + slack:
                break
            if multipliers.size and step == 1.0:  # the curvature of the constraints: once more
                try:
                    back = factor.solve(np.zeros_like(dx), -new.constraints, refine=False)[0]
                except FactorizationError:
                    return None
                trial = rod.retract(trial, back * rod.max_step(trial, back))
                new = rod.evaluate(trial, multipliers + dm, 1)
                if _merit(new, penalty) <= merit + slack:
                    break
            step *= 0.35
        else:
            return None
        if new.kkt is None:
            new = rod.evaluate(trial, multipliers + step * dm, 2)
        # Within this size the next step of Newton's method is taken for granted.
        expected = 0.1 * size if shift == 0.0 and step == 1.0 and size < 0.3 else 0.0
        last = size if shift == 0.0 and step == 1.0 else math.inf
        state, multipliers, here = trial, multipliers + step * dm, new
        if gauge.shape[0] or revealed:
            gauge = rod.gauge(state)
        if step == 1.0:
            shift *= 0.1
    return None


def _is_near_saddle(here: Evaluation, gauge: Array) -> bool:
    """Return whether Newton's method without a shift makes a small step."""
    assert here.kkt is not None
    assert here.gradient is not None
    try:
        plain = here.kkt.factorize(0.0, gauge, None)
        dx, _ = plain.solve(-here.gradient, -here.constraints, refine=False)
    except FactorizationError:
        return True
    return not float(np.max(np.abs(dx))) > NEAR


def _merit(evaluation: Evaluation, penalty: Array) -> float:
    value = evaluation.energy + float(penalty @ np.abs(evaluation.constraints))
    return value if math.isfinite(value) else math.inf


def _factors(
    rod: Rod, state: Any, here: Evaluation, gauge: Array, shift: float
) -> tuple[Factorization, float] | None:
    """Return factors with the inertia of a minimum, and the shift that it took."""
    metric = rod.metric(state)
    kkt = here.kkt
    assert kkt is not None
    try:
        plain = kkt.factorize(0.0, gauge, metric)
        if plain.is_minimum:
            return plain, 0.0
    except FactorizationError:
        pass
    stiffness = kkt.magnitude(np.ones(rod.size), np.zeros(kkt.m))[0]
    scale = float(np.median(stiffness / metric)) or float(np.max(stiffness / metric))
    if not 0.0 < scale < math.inf:
        return None
    trial = max(shift, 1e-6 * scale)
    while trial <= 1e3 * scale:
        try:
            factor = kkt.factorize(trial, gauge, metric)
            if factor.is_minimum:
                return factor, trial
        except FactorizationError:
            pass
        trial *= 8.0
    return None
