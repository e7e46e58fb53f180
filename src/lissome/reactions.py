r"""What supports exert on a structure: forces and moments, in one form for all structures.

At an equilibrium the energy E, with the potential of the loads, changes with a displacement dx of a
support and a rotation :math:`d\phi` about its position by

.. math:: dE = F \cdot dx + M \cdot d\phi,

where F and M are the force and the moment that the support exerts on the structure (Castigliano).
``equilibrium.reactions()`` returns them for all supports: forces in the unit of the energy over that of
lengths, moments in the unit of the energy. ``reaction.along()`` tells how that of an edge of a plate is
distributed along it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._validate import finite_array, positive
from .errors import InvalidInput

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["EdgeReaction", "Reaction", "Reactions"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgeReaction:
    r"""How what a support exerts on a plate is distributed along an edge.

    Per length there act a force and, where the slope is held, a moment about the tangent. The force
    across the plate is the effective shear force of Kirchhoff's theory, in which the twisting moment is
    accounted for,

    .. math:: f_z = -\left(\partial_j M_{ij} n_i + \partial_t M_{nt}\right),

    in a plate that is nearly flat, with the outward normal n and the moments M. What is left of the
    twisting moment are forces in the corners and at the ends of an edge that holds the deflection. All
    arrays are samples: the ends and the middle of each edge of a triangle, so that a vertex between two
    of them comes twice.

    Attributes
    ----------
    arclength : ndarray, shape (n,)
        Along the undeformed edge, with the plate on the left; it runs on from piece to piece.
    weights : ndarray, shape (n,)
        Lengths of the samples (Simpson's rule): ``weights @ force`` is an integral along the edge.
    positions : ndarray, shape (n, 3)
        Where the samples are: x and y of the undeformed plate, and the deflection.
    force : ndarray, shape (n, 3)
        Force per length; continuous, and linear between vertices, in each piece.
    moment : ndarray, shape (n, 3)
        Moment per length, a vector along the tangent; jumps at vertices by its error.
    bending_moment : ndarray, shape (n,)
        The same as the component :math:`M_{nn}` of the moments of the plate.
    piece : ndarray of int, shape (n,)
        Number of the smooth piece of the edge. Corners, ends, and places where supports begin to
        share an edge are between pieces.
    point_positions, point_forces : ndarray, shape (k, 3)
        Forces at the ends of pieces. A corner of several supports is divided evenly among them.
    support : hashable
        Name of the support.

    Notes
    -----
    The sum of all is the :class:`Reaction`: the force exactly, the moment to rounding errors on straight
    edges that stay straight, else to the error of the discretization. The forces at points are real where
    Kirchhoff's theory has them, such as in corners that are simply supported; elsewhere, such as
    in corners that are clamped, they vanish as the mesh is refined.

    In the middle of the edges of a square, simply supported or clamped, and on the rim of a disc, plates of
    degree 3 have the force per length to second order of the size of triangles, as the forces in the
    corners, and the moment to third; those of degree 2 are one order less accurate on curved rims and
    in the moment. Towards a corner the force per length goes to zero with a kink and is less accurate.

    Examples
    --------
    A simply supported square: 0.42 q a in the middle of each edge, and 0.065 q a^2 in each corner.

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.plates import Plate, meshes
    >>> plate = Plate(mesh=meshes.rectangle(divisions=4), bending=1.0, poisson_ratio=0.3,
    ...               pressure=1e-3, edges="simply supported", degree=3)
    >>> edge = ls.equilibrate(plate).reactions("all").along()
    >>> print(f"{np.min(edge.force[:, 2]) / 1e-3:.2f}", edge.point_forces.shape)
    -0.42 (4, 3)
    >>> print(np.round(np.max(edge.point_forces[:, 2]) / 1e-3, 2))
    0.07
    """

    arclength: Array
    weights: Array
    positions: Array
    force: Array
    moment: Array
    bending_moment: Array
    piece: NDArray[np.int64]
    point_positions: Array
    point_forces: Array
    support: Hashable = None

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def to_frame(self) -> pd.DataFrame:
        """Return a table of one row for each sample, without the forces at points.

        Returns
        -------
        pandas.DataFrame
            Columns arclength, weight, x, y, z, force_x, ..., moment_z, bending_moment, piece.
        """
        import pandas as pd

        data: dict[str, Any] = {"arclength": self.arclength, "weight": self.weights}
        for values, prefix in (
            (self.positions, ""), (self.force, "force_"), (self.moment, "moment_")
        ):  # fmt: skip
            data |= {prefix + axis: values[:, i] for i, axis in enumerate("xyz")}
        return pd.DataFrame(data | {"bending_moment": self.bending_moment, "piece": self.piece})


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
    _along: Callable[[float], EdgeReaction] | None = field(default=None, repr=False)

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

    def along(self, corner_angle: float = 0.25) -> EdgeReaction:
        """Return how the reaction is distributed along the edge of a :class:`~lissome.plates.Plate`.

        Parameters
        ----------
        corner_angle : float
            Radians. An edge that turns at a vertex by more has a corner there, which can bear a force.

        Returns
        -------
        EdgeReaction
            Force and moment per length, and the forces in corners and at ends.

        Raises
        ------
        InvalidInput
            If the support is no edge of a `Plate`; if a smooth piece of the edge is one edge of a
            triangle long, whose reaction does not tell forces at its ends from a force along it.

        Examples
        --------
        A clamped disc of radius R: :math:`qR/2` per length, and the bending moment :math:`qR^2/8`.

        >>> import lissome as ls
        >>> from lissome.plates import Plate, meshes
        >>> disc = Plate(mesh=meshes.disc(divisions=3), bending=1.0, poisson_ratio=0.3,
        ...              pressure=1e-3, edges="clamped", degree=3)
        >>> rim = ls.equilibrate(disc).reactions("all").along()
        >>> print(f"{rim.force[:, 2].mean() / 1e-3:.2f} {rim.bending_moment.mean() / 1e-3:.3f}")
        -0.50 0.125
        """
        positive("corner_angle", corner_angle)
        if self._along is None:
            raise InvalidInput(
                f"the support {self.support!r} does not tell how its reaction is distributed; only edges "
                "of a `Plate` do: `force` and `moment` are the resultants"
            )
        return self._along(corner_angle)


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
