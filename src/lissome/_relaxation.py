"""Down to a minimum where no equilibrium is one of the Lagrangian: forces are unknowns there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import FactorizationError

__all__ = ["relaxed"]

Array = NDArray[np.float64]

#: Largest change of an unknown in one step, relative to its typical size.
_FAR = 0.5
#: Change below which a full step without shift ends the iteration.
_NEAR = 1e-3
#: Smallest and largest shift, over the typical stiffness.
_LEAST, _LARGEST = 1e-6, 1e9
#: Factors of the shift: where the inertia asks for more, and from step to step.
_MORE, _LESS = 8.0, 0.25


def relaxed(structure: Any, state: Any, multipliers: Array, most: int) -> tuple[Any, Array] | None:
    """Return a state near a stable equilibrium, and its multipliers.

    If the constraints depend on the multipliers (moments that are unknowns, whose complementary energy
    gives the angles), the Lagrangian is to be minimized by the unknowns, and maximized by those
    multipliers. Steps are those of the implicit Euler method for a motion with friction, with one
    Newton iteration each: the metric is added to the Hessian, with a factor that gives the matrix the
    inertia of a minimum, and steps that would lead far are shortened. (A larger factor would turn them,
    which leads into places whence no step is short.) The factor goes to zero as the state comes to rest.
    No function tells whether to accept a step: what is found is to be corrected, and its stability
    judged, by the caller.

    Parameters
    ----------
    structure : Structure
    state : state
        Where to start; may be a saddle that has been pushed.
    multipliers : ndarray, shape (m,)
        Near those of the state.
    most : int
        Limit of the steps.

    Returns
    -------
    tuple or None
        None if the state does not come to rest.
    """
    metric = np.asarray(structure.metric(state), dtype=float)
    gauge = np.asarray(structure.gauge(state), dtype=float).reshape(-1, structure.size)
    typical = structure.typical(state)
    unit, zero = np.ones(structure.size), np.zeros(multipliers.size)
    scale, shift = 0.0, 0.0
    for _ in range(most):
        evaluation = structure.evaluate(state, multipliers, 2)
        if not (np.isfinite(evaluation.energy) and np.all(np.isfinite(evaluation.gradient))):
            return None
        if not scale:
            scale = float(np.median(evaluation.kkt.magnitude(unit, zero)[0] / metric))
        while True:
            try:
                factor = evaluation.kkt.factorize(shift, gauge, metric)
                if factor.is_minimum:
                    break
            except FactorizationError:
                pass
            shift = max(_MORE * shift, _LEAST * scale)
            if not shift <= _LARGEST * scale:
                return None
        dx, dm = factor.solve(-evaluation.gradient, -evaluation.constraints, refine=False)
        size = float(np.max(np.abs(dx) / typical))
        step = min(1.0, structure.max_step(state, dx), _FAR / max(size, _FAR))
        state = structure.retract(state, step * dx)
        multipliers = multipliers + step * dm
        if shift == 0.0 and step == 1.0 and size <= _NEAR:
            return state, multipliers
        shift = _LESS * shift if shift > _LEAST * scale else 0.0
    return None
