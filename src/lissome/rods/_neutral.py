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
    conditions: list[Array] = []

    def turns(rows: Array) -> None:
        for row in np.atleast_2d(rows):
            conditions.append(np.append(row, 0.0))

    spin = np.array([0.0, 0.0, 0.0, 1.0])
    if not rod.isotropic:
        conditions.append(spin)
    loads = np.unique(layout.plan.dead, axis=0)
    for force in loads[np.any(loads != 0.0, axis=1)]:
        turns(_cross_matrix(force / np.linalg.norm(force)))
    places = rod.positions(state)
    for node, (k, _, _) in zip(layout.row_nodes, plan.rows, strict=True):
        if node < 0:
            continue  # closure: a rotation leaves it
        anchor = layout.anchors[k]
        assert anchor is not None
        arm = places[node] - places[anchor[0]]
        size = float(np.linalg.norm(arm))
        if size <= REACH * rod.length:
            continue
        unit = np.eye(3)[k]
        row = np.cross(arm / size, unit)
        if np.linalg.norm(row) > 1e-9:
            turns(row)
        else:  # the component is at its extreme: every turn of the arm counts
            turns(_cross_matrix(unit))
    for _, force, arm in rod.couples:
        # Other turns than those about the force are neutral to first order at best.
        turns(_cross_matrix(force / np.linalg.norm(force)))
        if np.any(arm[:2]):
            conditions.append(spin)
    frames = rod.frames(state)
    held = [0] if rod.held else []
    for f in [*held, *layout.segment_of, *range(rod.lengths.size, frames.shape[0])]:
        body = np.column_stack([to_matrix(frames[f]).T, [0.0, 0.0, -1.0]])
        if plan.turning[f]:
            axis = plan.axis[f]
            k = int(plan.column[f]) - plan.first_angle
            if not layout.plan.moments[k]:
                body = (np.eye(3) - np.outer(axis, axis)) @ body
        conditions.extend(body)
    basis = np.eye(4)
    if conditions:
        _, sizes, vectors = np.linalg.svd(np.array(conditions))
        basis = vectors[int(np.count_nonzero(sizes > 1e-7)) :]
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


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
