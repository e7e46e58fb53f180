r"""What the supports of a plate exert on it.

The derivative of the energy by an unknown that is held is the generalized force that holds it. Summed
over what a support holds, with the values of a rigid motion as weights, these make its force and its
moment. The sums are those of the discrete plate: they balance its loads to rounding errors, and are the
derivative of its energy by a motion of the support.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..reactions import Reaction, Reactions
from ._fvk_edge_reactions import edge_work
from ._fvk_supports import Hold

if TYPE_CHECKING:
    from ._fvk_state import PlateState, PlateUnknowns

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Displacements and slopes in the order in which they are counted.
_ROWS = {"displacement_x": 0, "displacement_y": 1, "deflection": 2, "slope": 3, "gradient": 3}


def plate_reactions(plate: PlateUnknowns, state: PlateState, multipliers: Array) -> Reactions:
    """Return what the supports exert at an equilibrium."""
    space = plate.space
    held: dict[Hashable, list[Index]] = {}
    holds: dict[Hashable, list[Hold]] = {}
    for hold, unknowns in space.holders:
        held.setdefault(hold.part, []).append(unknowns)
        holds.setdefault(hold.part, []).append(hold)
    which = {part: np.unique(np.concatenate(unknowns)) for part, unknowns in held.items()}
    owners = np.zeros(space.size)
    for unknowns in which.values():
        owners[unknowns] += 1.0
    residual = plate._residual(state, multipliers)
    shared = residual / np.maximum(owners, 1.0)
    counts = np.zeros((4, plate.mesh.facets.shape[1]), dtype=np.int64)
    for part, those in holds.items():
        if not isinstance(part, tuple):
            for row in {_ROWS[hold.what] for hold in those}:
                counts[row, those[0].place] += 1
    found = []
    for part, unknowns in which.items():
        place = _place(plate, state, part, holds[part])
        motions = plate._rigid_motions(place, state)[:, unknowns]
        sums = motions @ shared[unknowns]
        line = None
        if plate._edges_tell and not isinstance(part, tuple):
            line = edge_work(plate, state, shared, owners, counts, holds[part]).along
        found.append(Reaction(sums[:3], sums[3:], place, part, line))
    return Reactions(found)


def _place(plate: Any, state: PlateState, part: Hashable, holds: list[Hold]) -> Array:
    """Return the place of a support: a vertex, or the middle of the chords of its edges."""
    mesh, w = plate.mesh, plate.deflection(state)
    if isinstance(part, tuple):  # a point
        vertex = int(holds[0].place[0])
        return np.array([*mesh.p[:, vertex], w[vertex]])
    ends = mesh.facets[:, np.unique(np.concatenate([hold.place for hold in holds]))]
    corners = np.vstack([mesh.p[:, : mesh.nvertices], w])[:, ends]  # (3, 2, facets)
    length = np.linalg.norm(corners[:2, 1] - corners[:2, 0], axis=0)
    return np.asarray(corners.mean(axis=1) @ length / np.sum(length))
