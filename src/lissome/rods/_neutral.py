"""Motions of a rod that nothing opposes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ._layout import REACH
from .quaternions import to_matrix

if TYPE_CHECKING:
    from ._structure import Rod, RodState

__all__ = ["neutral_rotations"]

Array = NDArray[np.float64]


def neutral_rotations(rod: Rod, state: RodState) -> Array:
    """Return rotations (and spins of the sections) that change neither energy nor constraints.

    A motion is (omega, spin): it turns everything by omega in space, and every section by -spin about
    its d3. Segment j then turns by R_j^T omega - spin e3 in its own directors.
    """
    layout = rod.layout
    plan = layout.plan
    frames = rod._frames(state)
    basis = _neutral_motions(rod, state, frames)
    rows = np.zeros((basis.shape[0], rod.size))
    if not basis.size:
        return rows
    columns = plan.column[: rod.lengths.size]
    free = columns >= 0
    matrices = to_matrix(state.quaternions)
    for row, motion in zip(rows, basis, strict=True):
        body = np.einsum("jab,a->jb", matrices, motion[:3])
        body[:, 2] -= motion[3]
        row[columns[free][:, None] + np.arange(3)] = body[free]
        for i, k in enumerate(layout.hinged):
            f = rod.lengths.size + int(k)
            turn = to_matrix(frames[f]).T @ motion[:3]
            turn[2] -= motion[3]
            row[plan.first_angle + i] = float(plan.axis[f] @ turn)
    if not rod.isotropic:
        return rows
    # A straight rod that turns and spins back about its axis does not move at all.
    root = np.sqrt(layout.metric / rod.length)
    turn, sizes, _ = np.linalg.svd(rows * root, full_matrices=False)
    return turn.T[sizes > 1e-6] @ rows


def _neutral_motions(rod: Rod, state: RodState, frames: Array) -> Array:
    """Return a basis (g, 4) of the motions (omega, spin).

    A motion has to be neutral however far it goes. What is so to first order only (the turn of an end
    that is prescribed in one component, seen along its arm) is a direction that may be unstable. A
    prescribed component stays if omega is along it or along the arm: the motions are found for one
    such line after the other, and with and without a spin.
    """
    layout = rod.layout
    plan = layout.plan
    spin = np.array([[0.0, 0.0, 0.0, 1.0]])

    def along(vector: Array) -> Array:
        return np.column_stack([_cross_matrix(vector), np.zeros(3)])

    conditions: list[Array] = []
    forces = np.array(layout.node_forces)
    held_nodes = [(anchor[0], k) for k, anchor in enumerate(layout.anchors) if anchor is not None]
    rows = zip(layout.row_nodes, plan.rows, strict=True)
    for node, k in [*held_nodes, *((node, int(row[0])) for node, row in rows if node >= 0)]:
        forces[node, k] = 0.0  # a load on what is prescribed does no work
    loads = np.unique(forces, axis=0)
    for force in loads[np.any(loads != 0.0, axis=1)]:
        conditions.append(along(force / np.linalg.norm(force)))
    for _, force, arm in rod._couples:
        # Other turns than those about the force are neutral to first order at best.
        conditions.append(along(force / np.linalg.norm(force)))
        if np.any(arm[:2]):
            conditions.append(spin)
    held = [0] if rod.held else []
    turning = []
    for f in [*held, *layout.segment_of, *range(rod.lengths.size, frames.shape[0])]:
        body = np.column_stack([to_matrix(frames[f]).T, [0.0, 0.0, -1.0]])
        if plan.turning[f] and not plan.moments[int(plan.column[f]) - plan.first_angle]:
            axis = plan.axis[f]
            turned = (np.eye(3) - np.outer(axis, axis)) @ body
            # A spin goes on beside the turn only about the same axis.
            turning.append((turned, turned if abs(axis[2]) > 1.0 - 1e-14 else body))
        else:
            conditions.append(body)

    if not rod.isotropic:
        conditions.append(spin)
    if conditions and not _null_space(conditions).size:
        return np.zeros((0, 4))

    pairs = []  # of lines: the component that is prescribed, and the arm
    places = rod.positions(state)
    for node, (k, _, _) in zip(layout.row_nodes, plan.rows, strict=True):
        if node < 0:
            continue  # closure: a rotation leaves it
        anchor = layout.anchors[k]
        assert anchor is not None
        arm = places[node] - places[anchor[0]]
        size = float(np.linalg.norm(arm))
        if size > REACH * rod.length:
            pairs.append((np.eye(3)[k], arm / size))

    found: list[Array] = []
    # Without hinged supports the motions with a spin contain those without.
    choices = (False, True) if turning and rod.isotropic else (rod.isotropic,)
    for spinning in choices:
        some = [*conditions, *([] if spinning else [spin])]
        some += [pair[int(spinning)] for pair in turning]
        for line in pairs[0] if pairs else (None,):
            if line is None:
                found.append(_null_space(some))
                continue
            cross = _cross_matrix(line)
            if all(min(np.linalg.norm(cross @ v) for v in pair) < 1e-7 for pair in pairs):
                found.append(_null_space([*some, along(line)]))
            elif spinning:
                found.append(_null_space([*some, np.eye(4)[:3]]))
    motions = np.concatenate([np.zeros((0, 4)), *found])
    if not motions.size:
        return motions
    _, sizes, vectors = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(vectors[: np.count_nonzero(sizes > 1e-6)])


def _null_space(conditions: list[Array]) -> Array:
    if not conditions:
        return np.eye(4)
    _, sizes, vectors = np.linalg.svd(np.concatenate(conditions))
    return np.asarray(vectors[int(np.count_nonzero(sizes > 1e-7)) :])


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
