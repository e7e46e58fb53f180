r"""What supports exert on a structure: forces and moments, in one form for all structures.

At an equilibrium the energy E, with the potential of the loads, changes with a displacement dx of a
support and a rotation :math:`d\phi` about its position by

.. math:: dE = F \cdot dx + M \cdot d\phi,

where F and M are the force and the moment that the support exerts on the structure (Castigliano).
``equilibrium.reactions()`` returns them for all supports: forces in the unit of the energy over that of
lengths, moments in the unit of the energy.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._validate import finite_array
from .errors import InvalidInput

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Reaction", "Reactions"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reaction:
    """What one support exerts on a structure.

    Plane structures are in the plane of x and y; plates lie in it, with z upward.

    Parameters
    ----------
    force : array_like, shape (3,)
        Force; zero in directions that the support leaves free.
    moment : array_like, shape (3,)
        Moment about `position`; zero about axes that the support leaves free.
    position : array_like, shape (3,)
        Where the support is.
    support : hashable
        Name of the support.

    Raises
    ------
    InvalidInput
        If a vector has not three finite components.

    Examples
    --------
    The clamp of a cantilever bears the opposite of the load and its moment:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome import rods
    >>> beam = rods.straight(length=1.0, segments=20, law=rods.Kirchhoff(1.0, 1.0)).clamped("start")
    >>> state = ls.equilibrate(beam.loaded(end=(3.0, 0.0, 0.0)))
    >>> clamp = state.reactions("start")
    >>> print(clamp.force.round(9) + 0.0)
    [-3.  0.  0.]
    >>> print(np.allclose(clamp.moment, -np.cross(state.positions[-1], [3.0, 0.0, 0.0])))
    True
    """

    force: Array
    moment: Array
    position: Array
    support: Hashable = None

    def __post_init__(self) -> None:
        for name in ("force", "moment", "position"):
            value = finite_array(name, getattr(self, name), (3,))
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    def moment_about(self, point: ArrayLike) -> Array:
        """Return the moment of force and moment about another point, shape (3,).

        Parameters
        ----------
        point : array_like, shape (3,)

        Raises
        ------
        InvalidInput
            If `point` has not three finite components.
        """
        away = self.position - finite_array("point", point, (3,))
        return np.asarray(self.moment + np.cross(away, self.force))


class Reactions(Mapping[Hashable, Reaction]):
    """What all supports exert on a structure, by the names of the supports.

    Parameters
    ----------
    reactions : iterable of Reaction
        In the order of the supports.
    aliases : mapping, optional
        Other names of supports, and the names that they stand for.

    Raises
    ------
    InvalidInput
        If two supports have the same name; of a name that no support has.

    Examples
    --------
    A beam on two pins shares a load in the middle between them:

    >>> import lissome as ls
    >>> from lissome import rods
    >>> beam = rods.straight(1.0, 20, rods.Kirchhoff(1.0, 1.0), tangent=(1.0, 0.0, 0.0))
    >>> beam = beam.clamped("start").clamped("end", (None, 0.0, 0.0))
    >>> state = ls.equilibrate(beam.loaded(nodes={10: (0.0, 0.0, -2.0)}))
    >>> found = state.reactions()
    >>> print(list(found), [round(float(one.force[2]), 9) for one in found.values()])
    ['start', 'end'] [1.0, 1.0]
    >>> print(found.total().force.round(9) + 0.0)
    [0. 0. 2.]
    """

    def __init__(
        self, reactions: Iterable[Reaction], aliases: Mapping[Hashable, Hashable] | None = None
    ) -> None:
        self._found: dict[Hashable, Reaction] = {}
        for reaction in reactions:
            if reaction.support in self._found:
                raise InvalidInput(
                    f"argument `reactions` holds two of the support {reaction.support!r}; give each "
                    "support a name of its own"
                )
            self._found[reaction.support] = reaction
        self._aliases = dict(aliases or {})

    def __getitem__(self, where: Any) -> Reaction:
        try:
            name = tuple(where) if isinstance(where, (list, np.ndarray)) else where
            return self._found[self._aliases.get(name, name)]
        except (KeyError, TypeError):
            known = ", ".join(repr(name) for name in self._found) or "none"
            raise InvalidInput(
                f"argument `where` is {where!r}, where there is no support; supported are: {known}"
            ) from None

    def __contains__(self, where: object) -> bool:
        try:
            self[where]
        except InvalidInput:
            return False
        return True

    def get(self, where: Any, default: Any = None) -> Any:
        """Return the reaction of a support, or `default` if there is no such support."""
        try:
            return self[where]
        except InvalidInput:
            return default

    def __iter__(self) -> Iterator[Hashable]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __repr__(self) -> str:
        return f"Reactions({', '.join(repr(name) for name in self._found)})"

    def total(self, about: ArrayLike = (0.0, 0.0, 0.0)) -> Reaction:
        """Return the sum of all forces, and their moment about a point: what balances the loads.

        Parameters
        ----------
        about : array_like, shape (3,)
            The point; the origin by default.

        Raises
        ------
        InvalidInput
            If `about` has not three finite components.
        """
        point = finite_array("about", about, (3,))
        force, moment = np.zeros(3), np.zeros(3)
        for reaction in self.values():
            force += reaction.force
            moment += reaction.moment_about(point)
        return Reaction(force, moment, point, "total")

    def to_frame(self) -> pd.DataFrame:
        """Return a table of one row for each support: its name, position, force and moment.

        Returns
        -------
        pandas.DataFrame
            Columns support, x, y, z, force_x, ..., moment_z.
        """
        import pandas as pd

        data: dict[str, Any] = {"support": list(self)}
        for name, prefix in (("position", ""), ("force", "force_"), ("moment", "moment_")):
            values = np.array([getattr(one, name) for one in self.values()]).reshape(-1, 3)
            data |= {prefix + axis: values[:, i] for i, axis in enumerate("xyz")}
        return pd.DataFrame(data)
