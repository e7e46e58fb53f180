"""Dead loads on rods: forces that keep their direction, at nodes or at arms fixed to the rod."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite_array
from ..errors import InvalidInput

__all__ = ["Loads"]

Array = NDArray[np.float64]
Distributed = ArrayLike | Callable[[Array], ArrayLike]


@dataclass(frozen=True, eq=False)
class Loads:
    """Dead loads.

    Attributes
    ----------
    points : mapping of int to ndarray (3,)
        Forces on nodes.
    distributed : ndarray (3,) or (N + 1, 3), callable, or None
        Force per unit rest length, uniform, at the nodes, or as a function of arc length.
    couples : mapping of int to (ndarray (3,), ndarray (3,))
        For segments: a force and an arm (components along the directors). The force acts at the end
        of the arm and its opposite at the foot, so that the couple has the potential - force . arm.

    Examples
    --------
    A weight of 2 per length on a rod of unit length: each node bears half of its two segments.

    >>> import numpy as np
    >>> from lissome.rods import Loads
    >>> weight = Loads(distributed=(0.0, 0.0, -2.0))
    >>> print(weight.forces(np.full(4, 0.25), closed=False)[:, 2])
    [-0.25 -0.5  -0.5  -0.5  -0.25]
    """

    points: Mapping[int, Array] = field(default_factory=dict)
    distributed: Any = None
    couples: Mapping[int, tuple[Array, Array]] = field(default_factory=dict)

    @property
    def empty(self) -> bool:
        """Whether there is no load at all."""
        return (
            all(not np.any(f) for f in self.points.values())
            and (
                self.distributed is None
                or (not callable(self.distributed) and not np.any(self.distributed))
            )
            and all(not np.any(f) or not np.any(a) for f, a in self.couples.values())
        )

    def forces(self, lengths: Array, closed: bool) -> Array:
        """Return the forces on the nodes, shape (N + 1, 3); those of node N are 0 if closed.

        A distributed force is lumped: each node takes half of the adjacent segments.

        Parameters
        ----------
        lengths : ndarray, shape (N,)
            Rest lengths of the segments.
        closed : bool
            Whether the last node is the first.

        Raises
        ------
        InvalidInput
            If the function `distributed` returns another shape than one force for each node.
        """
        count = lengths.size
        out = np.zeros((count + 1, 3))
        for node, force in self.points.items():
            out[node] += force
        if self.distributed is not None:
            density = self.distributed
            if callable(density):
                s = np.concatenate([[0.0], np.cumsum(lengths)])
                density = finite_array("distributed", density(s))
                if density.shape not in ((3,), (count + 1, 3)):
                    raise InvalidInput(
                        f"the function `distributed` returned shape {density.shape}; it must return "
                        f"(3,), or ({count + 1}, 3) for {count + 1} arc lengths"
                    )
            weights = np.zeros(count + 1)
            weights[:-1] += 0.5 * lengths
            weights[1:] += 0.5 * lengths
            out += weights[:, None] * density
        if closed:
            out[0] += out[count]
            out[count] = 0.0
        return out
