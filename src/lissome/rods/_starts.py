"""Where a solve may start: states that meet the supports of a rod."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import FactorizationError
from ..factorization import ChainKKT
from . import _kernel
from .measures import CODES, pull_back_all

if TYPE_CHECKING:
    from ._structure import Rod, RodState

__all__ = ["reach_supports"]

Array = NDArray[np.float64]

#: Change of length in a start, beyond which bending alone is tried.
STRETCHED = 0.1


def reach_supports(rod: Rod, state: RodState) -> RodState:
    """Return a state near `state` that meets the constraints, if one is found.

    Where hinges are far from their natural angles (a ring that is not closed yet, a clamp that has
    turned) the angles are evened out first. Then come Newton steps of least elastic work; where the
    rod is so straight that turning its segments does not bring its ends nearer, it is bent before.

    To stretch costs much more than to bend. An extensible rod that would change its length by much keeps
    it, if its supports can be met so: from where it is squeezed hardly any way leads down.
    """
    near = 1e-9 * rod.length
    found, left = _reached(rod, state, True)
    change = np.max(np.abs(found.stretches / state.stretches - 1.0))
    if rod.extensible and not (left <= near and change <= STRETCHED):
        kept, left = _reached(rod, state, False)
        if left <= near:
            return kept
    return found


def _reached(rod: Rod, state: RodState, stretching: bool) -> tuple[RodState, float]:
    """Return that state, and by how much it misses the supports; segments may keep their lengths."""
    layout = rod.layout
    plan = layout.plan
    m = plan.rows.shape[0]
    zero, none = np.zeros(m), np.zeros(rod.size)
    if np.max(np.abs(_excess_angles(rod, state)[2])) > 0.5:
        state = _even_out(rod, state)
    if m == 0:
        return state, 0.0
    stiff = plan.stretch_column[plan.stretch_column >= 0 if not stretching else slice(0, 0)]
    metric = np.array(layout.metric)
    metric[stiff] *= 1e12
    violation = rod.evaluate(state, zero, 0).constraints
    bent = False
    for _ in range(60):
        size = float(np.linalg.norm(violation))
        if size <= 1e-9 * rod.length:
            break
        kkt = _unstressed(rod, state)
        rows = kkt.jacobian_rows() / np.sqrt(metric)
        # A turn by dx (root mean square) moves the ends by about |rows| dx: is it enough?
        grip = np.linalg.svd(rows / math.sqrt(rod.length), compute_uv=False)[-1]
        if grip < 0.1 and not bent:
            bent = True
            middle = 0.5 * (rod.arclength[:-1] + rod.arclength[1:]) / rod.length
            bend = np.zeros(rod.size)
            columns = plan.column[: rod.lengths.size]
            free = columns >= 0
            share = math.sqrt(min(1.0, size / rod.length))
            bend[columns[free] + _softer(rod)] = share * np.sin(2.0 * math.pi * middle[free])
            state = rod.retract(state, bend * rod.max_step(state, bend))
            violation = rod.evaluate(state, zero, 0).constraints
            continue
        try:
            factor = kkt.factorize(1.0 / rod.length**2, None, metric, 1e-4 * rod.length**3)
            step = factor.solve(none, -violation)[0]
            step[stiff] = 0.0
        except FactorizationError:
            break
        fraction = min(rod.max_step(state, step), 0.7 / max(float(np.max(np.abs(step))), 0.7))
        while fraction > 1e-4:
            trial = rod.retract(state, fraction * step)
            left = rod.evaluate(trial, zero, 0).constraints
            if np.linalg.norm(left) < (1.0 - 0.1 * fraction) * size:
                break
            fraction *= 0.5
        else:
            break
        state, violation = trial, left
    return state, float(np.linalg.norm(violation))


def _excess_angles(rod: Rod, state: RodState) -> tuple[Array, Array, Array]:
    """Return frames, rotations of the hinges, and their rotation vectors beyond the natural ones."""
    plan = rod.layout.plan
    n = plan.left.size
    frames = rod._frames(state)
    q, vector = np.empty((n, 4)), np.empty((n, 3))
    _kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, vector)
    size = np.sqrt(np.sum(q[:, 1:] ** 2, axis=1))
    angle = 2.0 * np.arctan2(size, q[:, 0])
    factor = np.where(size > 0.0, angle / np.where(size > 0.0, size, 1.0), 2.0)
    return frames, q, factor[:, None] * q[:, 1:] - plan.natural * plan.span[:, None]


def _evened(rod: Rod, state: RodState) -> tuple[Array, float]:
    """Return gradient and value of the squares of the excess angles over the lengths of hinges."""
    layout = rod.layout
    plan = layout.plan
    n, m = plan.left.size, plan.rows.shape[0]
    frames, q, angle = _excess_angles(rod, state)
    stress = angle / plan.span[:, None]
    value = 0.5 * float(np.sum(stress * angle))
    pull_back_all(CODES["angle"], q, stress, np.zeros((0, 3, 3)), 1)
    gradient = np.empty(plan.length + layout.border)
    _kernel.assemble(
        frames, np.array(state.stretches), np.array(state.angles), q, np.zeros(n), stress,
        np.zeros((0, 3, 3)), _without_loads(plan), np.zeros(m), gradient,
        np.empty((0, layout.width + 1)), np.empty((0, layout.border)),
        np.empty((layout.border, layout.border)), np.empty(m), 1,
    )  # fmt: skip
    return gradient[: rod.size], value


def _even_out(rod: Rod, state: RodState) -> RodState:
    """Return a state with hinges nearer to their natural angles, by Gauss and Newton's method.

    Constraints count as springs.
    """
    zero = np.zeros(rod.constraints_count)
    soft = 1e-3 * rod.length**3

    def merit(state: RodState) -> tuple[float, Array, Array]:
        violation = rod.evaluate(state, zero, 0).constraints
        gradient, value = _evened(rod, state)
        return value + 0.5 * float(violation @ violation) / soft, gradient, violation

    value, gradient, violation = merit(state)
    for _ in range(40):
        try:
            factor = _unstressed(rod, state).factorize(
                0.1 / rod.length**2, None, rod.layout.metric, soft
            )
            step = factor.solve(-gradient, -violation)[0]
        except FactorizationError:
            break
        fraction = min(rod.max_step(state, step), 0.7 / max(float(np.max(np.abs(step))), 0.7))
        while fraction > 1e-3:
            trial = rod.retract(state, fraction * step)
            new = merit(trial)
            if new[0] < value:
                break
            fraction *= 0.5
        else:
            break
        done = new[0] > 0.99 * value
        state, (value, gradient, violation) = trial, new
        if done:
            break
    return state


def _without_loads(plan: _kernel.Plan) -> _kernel.Plan:
    return plan._replace(
        dead=np.zeros_like(plan.dead), moments=np.zeros_like(plan.moments), arms=np.zeros((0, 7))
    )


def _softer(rod: Rod) -> int:
    """Return the director about which the rod bends more easily: 0 or 1."""
    layout = rod.layout
    stiffness = layout.law.evaluate(np.zeros((layout.nodes.size, len(layout.law.strains))), 2)[2]
    return int(np.argmin(np.mean(stiffness[:, [0, 1], [0, 1]], axis=0)))


def _unstressed(rod: Rod, state: RodState) -> ChainKKT:
    """Return the KKT matrix of hinges without stress, of unit stiffness."""
    layout = rod.layout
    plan = layout.plan
    n = plan.left.size
    stiffness = np.ascontiguousarray(np.broadcast_to(np.eye(3), (n, 3, 3)))
    m = plan.rows.shape[0]
    frames = rod._frames(state)
    q, kappa = np.empty((n, 4)), np.empty((n, 3))
    _kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, kappa)
    band = np.empty((plan.length, layout.width + 1))
    border = np.empty((plan.length, layout.border))
    corner = np.empty((layout.border, layout.border))
    _kernel.assemble(
        frames, np.array(state.stretches), np.array(state.angles), q, np.zeros(n), np.zeros((n, 3)),
        stiffness, _without_loads(plan), np.zeros(m), np.empty(plan.length + layout.border), band, border,
        corner, np.empty(m), 2,
    )  # fmt: skip
    return ChainKKT(band, border.T, corner, layout=layout.chain)
