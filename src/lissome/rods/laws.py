r"""Constitutive laws of rods: energy per unit length as a function of strains per unit length.

A law never sees the mesh. It maps strain densities :math:`k` (1/length; the rod has divided by the
length of the hinge and subtracted the natural strains) to the energy per unit length :math:`W`, the
stress :math:`\partial W/\partial k` (for a rod: the moments about its directors) and the stiffness
:math:`\partial^2 W/\partial k\,\partial k`, for all hinges at once. The energy of hinge i with
length :math:`\ell_i` is :math:`\ell_i W(\kappa_i/\ell_i)`, (4.31) of the thesis.

**Convention.** The strains of a rod are ``("curvature_1", "curvature_2", "twist")``: bending about
the directors d1 and d2, twist about d3. The width of a strip lies along d1, its thickness along d2:
``curvature_1`` is the easy bending, as in (4.30), (4.35), (4.40). (4.41) of the thesis has the width
along d2; its :math:`\kappa_1,\kappa_2` are ``curvature_2`` and ``curvature_1`` here.

A law may have a fourth strain, ``"stretch"``: :math:`(e^2 - 1)/2` of a piece whose length is e times its
rest length (4.17). The rod is then extensible, and stretch may be coupled with bending and twist.

**What a law is.** Any object with

* ``strains``: the names of its k strains;
* ``count``: None if the law is the same along the rod; else the number of rows for which it holds
  values, and then ``at(rows)`` returns the law of those rows. A rod wants one row for each of its
  N + 1 nodes (like its natural strains) and picks those of its hinges;
* ``evaluate(k, order=2)``: (W, stress, stiffness) with shapes (n,), (n, k), (n, k, k); what exceeds
  `order` is None.

Compiled laws (all of this module, ribbons included) also have ``kernel`` and ``parameters``, and
``evaluate_into(k, energy, stress, stiffness, order=2)``, which writes into C-contiguous arrays and
checks nothing. It is ``kernel(parameters, k, energy, stress, stiffness, order)``, a compiled function
that compiled loops may call; ``parameters`` has shape (1, p) or (count, p). For other laws ``kernel``
is None. :func:`~lissome.rods.check_law` compares any law with finite differences.
"""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._compile import jit
from .._validate import finite, finite_array, moderate, positive
from ..errors import InvalidInput
from .sections import Rectangle, Section

__all__ = ["ROD_STRAINS", "CompiledLaw", "Kirchhoff", "Law", "LawValues"]

Array = NDArray[np.float64]
LawValues = tuple[Array, Array | None, Array | None]

ROD_STRAINS: tuple[str, ...] = ("curvature_1", "curvature_2", "twist")


@runtime_checkable
class Law(Protocol):
    """What a rod asks of a law. See the module's description.

    Examples
    --------
    Any object with these members is a law. Here is one whose bending stiffens with curvature:

    >>> import numpy as np
    >>> from lissome import rods
    >>> class Stiffening:
    ...     strains = ("curvature_1", "curvature_2", "twist")
    ...     count = None
    ...     def at(self, rows):
    ...         return self
    ...     def evaluate(self, k, order=2):
    ...         k = np.asarray(k, dtype=float)
    ...         size = np.sum(k**2, axis=1)
    ...         energy, stress = size / 2 + size**2 / 4, k * (1 + size[:, None])
    ...         stiffness = np.eye(3) * (1 + size)[:, None, None] + 2 * k[:, :, None] * k[:, None, :]
    ...         return energy, stress if order > 0 else None, stiffness if order > 1 else None
    >>> rods.check_law(Stiffening())
    >>> isinstance(Stiffening(), rods.Law)
    True
    """

    @property
    def strains(self) -> tuple[str, ...]:
        """Names of the strains."""
        ...

    @property
    def count(self) -> int | None:
        """Number of rows for which the law holds values; None if it is uniform."""
        ...

    def at(self, rows: ArrayLike) -> Law:
        """Return the law of some rows: `rows` is an integer array of any length."""
        ...

    def evaluate(self, k: Array, order: int = 2) -> LawValues:
        """Return energy, stress and stiffness per unit length.

        Parameters
        ----------
        k : ndarray, shape (n, number of strains)
            Strain densities (1/length), natural strains subtracted.
        order : {0, 1, 2}
            Highest derivative that is wanted.

        Returns
        -------
        energy : ndarray, shape (n,)
        stress : ndarray, shape (n, number of strains), or None
        stiffness : ndarray, shape (n, number of strains, number of strains), or None
        """
        ...


# ---------------------------------------------------------------------------------------------
# Parameters that may vary along the rod


def varying(name: str, value: ArrayLike, check: Callable[[str, Any], float]) -> float | Array:
    """Return a checked number, or a read-only vector of checked numbers."""
    if np.ndim(value) == 0:
        return check(name, value)
    array: Array = finite_array(name, value, (None,))
    if array.size == 0:
        raise InvalidInput(
            f"argument `{name}` is empty; pass a number, or one number for each node"
        )
    # The check is monotonic in none of our cases by chance: test both ends, which bound the rest.
    for place in (int(np.argmin(array)), int(np.argmax(array))):
        check(f"{name}[{place}]", float(array[place]))
    array.flags.writeable = False
    return array


def common_count(**values: float | Array) -> int | None:
    """Return the common length of those values that are vectors, or None if there are none."""
    lengths = {name: value.size for name, value in values.items() if isinstance(value, np.ndarray)}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"`{name}` has {size}" for name, size in lengths.items())
        raise InvalidInput(
            f"the parameters of the law have different numbers of values ({shown}); each must be a "
            "number, or hold one number for each node of the rod"
        )
    return next(iter(lengths.values()), None)


def table(*columns: float | Array) -> Array:
    """Return the columns as a read-only array of shape (1, p), or (count, p) if one varies.

    Raises
    ------
    InvalidInput
        If a number overflowed.
    """
    result = np.ascontiguousarray(
        np.stack(np.broadcast_arrays(*map(np.atleast_1d, columns)), axis=1)
    )
    if not np.isfinite(result).all():
        raise InvalidInput(
            "the arguments of the law make stiffnesses that no float can hold; use units in which lengths "
            "and moduli are nearer to 1"
        )
    result.flags.writeable = False
    return result


def row_indices(rows: ArrayLike, count: int) -> NDArray[np.int64]:
    """Return row numbers as an array, or raise if one does not exist."""
    indices = finite_array("rows", rows, (None,), dtype=np.int64)
    outside = (indices < -count) | (indices >= count)
    if outside.any():
        raise InvalidInput(
            f"argument `rows` holds {indices[np.argmax(outside)]}; the law has {count} rows"
        )
    return indices


def poisson(name: str, value: Any) -> float:
    """Return Poisson's ratio of an isotropic material."""
    number = finite(name, value)
    if not -1.0 < number <= 0.5:
        raise InvalidInput(
            f"argument `{name}` is {number:g}; Poisson's ratio of an isotropic material lies in "
            "(-1, 0.5]"
        )
    return number


def strain_array(k: ArrayLike, strains: Sequence[str], count: int | None) -> Array:
    """Return strain densities as a C-contiguous array, or say what is wrong with their shape."""
    array = np.ascontiguousarray(k, dtype=float)
    if array.ndim != 2 or array.shape[1] != len(strains):
        raise InvalidInput(
            f"argument `k` has shape {array.shape}; it must be (n, {len(strains)}): one row for each "
            f"hinge, with the columns {', '.join(strains)}"
        )
    if count is not None and array.shape[0] != count:
        raise InvalidInput(
            f"argument `k` has {array.shape[0]} rows; the law holds values for {count}"
        )
    return array


# ---------------------------------------------------------------------------------------------
# Compiled laws


class CompiledLaw:
    """Base of the laws with a compiled kernel: see the module's description.

    A subclass sets ``kernel`` and, in its ``__post_init__``, ``parameters``. Those of its fields
    that are vectors vary along the rod.

    Examples
    --------
    A rod that is ten times stiffer at one end. Each row of the law is that of a node:

    >>> import numpy as np
    >>> from lissome.rods import Kirchhoff
    >>> law = Kirchhoff((np.linspace(1.0, 10.0, 4), 1.0), 1.0)
    >>> print(law.count, law.at([0, 3]).energy([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    4 [0.5 5. ]
    >>> print(law.at([0]).is_elliptic([[1.0, 0.0, 0.0]]))
    [ True]
    """

    strains: ClassVar[tuple[str, ...]] = ROD_STRAINS
    kernel: ClassVar[Any]
    parameters: Array

    @property
    def count(self) -> int | None:
        """Number of nodes for which the law holds values; None if it is uniform."""
        return None if self.parameters.shape[0] == 1 else int(self.parameters.shape[0])

    def at(self, rows: ArrayLike) -> Self:
        """Return the law of some nodes.

        Parameters
        ----------
        rows : array_like of int, shape (n,)
            Numbers of nodes; a uniform law ignores them.

        Raises
        ------
        InvalidInput
            If there is no such row.
        """
        if self.count is None:
            return self
        chosen = object.__new__(type(self))
        parameters = np.ascontiguousarray(self.parameters[row_indices(rows, self.count)])
        if parameters.shape[0] == 1:
            parameters = parameters.copy()
        parameters.flags.writeable = False
        for item in dataclasses.fields(self):  # type: ignore[arg-type]
            object.__setattr__(chosen, item.name, _chosen(getattr(self, item.name), rows))
        object.__setattr__(chosen, "parameters", parameters)
        return chosen

    def evaluate(self, k: Array, order: int = 2) -> LawValues:
        """Return energy, stress and stiffness, all per unit length.

        Parameters
        ----------
        k : array_like, shape (n, 3)
            Strain densities (1/length), natural strains subtracted.
        order : {0, 1, 2}
            Highest derivative that is wanted.

        Returns
        -------
        energy : ndarray, shape (n,)
        stress : ndarray, shape (n, 3), or None
        stiffness : ndarray, shape (n, 3, 3), or None

        Raises
        ------
        InvalidInput
            If the shape of `k` is wrong, or a strain is larger than any that a problem has.
        """
        k = moderate("k", strain_array(k, self.strains, self.count))
        n, m = k.shape
        energy = np.empty(n)
        stress = np.empty((n if order >= 1 else 0, m))
        stiffness = np.empty((n if order >= 2 else 0, m, m))
        self.evaluate_into(k, energy, stress, stiffness, order)
        return energy, stress if order >= 1 else None, stiffness if order >= 2 else None

    def evaluate_into(
        self, k: Array, energy: Array, stress: Array, stiffness: Array, order: int = 2
    ) -> None:
        """Write energy, stress and stiffness into arrays; nothing is checked.

        Parameters
        ----------
        k : ndarray, shape (n, 3)
            Strain densities (1/length), natural strains subtracted; C-contiguous, like all others.
        energy, stress, stiffness : ndarray, shapes (n,), (n, 3) and (n, 3, 3)
            Written to.
        order : {0, 1, 2}
            Highest derivative that is wanted; the others are left as they are.
        """
        self.kernel(self.parameters, k, energy, stress, stiffness, order)

    @staticmethod
    def stiffness_pair(bending: Any) -> tuple[float | Array, float | Array]:
        """Return two checked stiffnesses from `bending`: (B1, B2), or one number for both.

        Raises
        ------
        InvalidInput
            If a stiffness is not positive.
        """
        pair = (bending, bending) if _is_number(bending) else bending
        try:
            first, second = pair
        except (TypeError, ValueError):
            raise InvalidInput(
                f"argument `bending` is {bending!r}; pass (B1, B2), the stiffnesses about d1 and d2, "
                "or one number for both"
            ) from None
        return varying("bending[0]", first, positive), varying("bending[1]", second, positive)

    def _one_row(self) -> list[float]:
        if self.count is not None:
            raise InvalidInput(
                f"this {type(self).__name__} varies along the rod; take the law of one node first, "
                "`law.at([i])`"
            )
        return [float(x) for x in self.parameters[0]]

    def energy(self, k: Array) -> Array:
        """Return the energy per unit length, shape (n,), of strain densities `k`, shape (n, 3)."""
        return self.evaluate(k, 0)[0]

    def is_elliptic(self, k: Array) -> NDArray[np.bool_]:
        """Return where the stiffness is positive definite.

        Elsewhere the energy is not convex, and an infinitely fine mixture of two strains can have
        less energy than the uniform strain: discrete answers then depend on the mesh.

        Parameters
        ----------
        k : array_like, shape (n, 3)
            Strain densities (1/length), natural strains subtracted.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        stiffness = self.evaluate(k, 2)[2]
        assert stiffness is not None
        return np.asarray(np.linalg.eigvalsh(stiffness)[:, 0] > 0.0)


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) or (isinstance(value, np.ndarray) and value.ndim == 0)


def _chosen(value: Any, rows: ArrayLike) -> Any:
    if isinstance(value, np.ndarray):
        value = value[np.asarray(rows)]
        value.flags.writeable = False
        return value
    return tuple(_chosen(item, rows) for item in value) if isinstance(value, tuple) else value


@jit
def _kirchhoff(parameters, k, energy, stress, stiffness, order):
    step = 0 if parameters.shape[0] == 1 else 1
    for i in range(k.shape[0]):
        row = i * step
        total = 0.0
        for a in range(3):
            total += parameters[row, a] * k[i, a] * k[i, a]
        energy[i] = 0.5 * total
        if order >= 1:
            for a in range(3):
                stress[i, a] = parameters[row, a] * k[i, a]
        if order >= 2:
            for a in range(3):
                for b in range(3):
                    stiffness[i, a, b] = 0.0
                stiffness[i, a, a] = parameters[row, a]


@dataclass(frozen=True, eq=False)
class Kirchhoff(CompiledLaw):
    r"""The linear law of an anisotropic rod, (4.30) of the thesis.

    .. math:: W = \tfrac12 B_1 k_1^2 + \tfrac12 B_2 k_2^2 + \tfrac12 C k_3^2

    Natural curvatures and twist belong to the rod: `k` is what exceeds them.

    Parameters
    ----------
    bending : (B1, B2)
        Bending stiffnesses (force times length squared) about d1 and d2. Each is a number, or an
        array with one number for each node; one number alone means both.
    twisting : float or array_like
        Twisting stiffness C (force times length squared).

    Raises
    ------
    InvalidInput
        If a stiffness is not positive, or arrays have different lengths.

    Examples
    --------
    >>> from lissome.rods.laws import Kirchhoff
    >>> energy, moments, stiffness = Kirchhoff((1.0, 4.0), 2.0).evaluate([[1.0, 0.5, 1.0]])
    >>> print(energy, moments)
    [2.] [[1. 2. 2.]]
    """

    bending: Any
    twisting: Any
    kernel: ClassVar[Any] = staticmethod(_kirchhoff)

    def __post_init__(self) -> None:
        first, second = self.stiffness_pair(self.bending)
        twisting = varying("twisting", self.twisting, positive)
        common_count(**{"bending[0]": first, "bending[1]": second, "twisting": twisting})
        object.__setattr__(self, "bending", (first, second))
        object.__setattr__(self, "twisting", twisting)
        object.__setattr__(self, "parameters", table(first, second, twisting))

    @classmethod
    def from_section(
        cls,
        section: Section,
        young_modulus: float,
        poisson_ratio: float,
        torsion_constant: float | None = None,
    ) -> Self:
        r"""Return the law of an isotropic rod with a given cross-section.

        .. math:: B_1 = Y I_1,\qquad B_2 = Y I_2,\qquad C = \frac{Y J}{2 (1 + \nu)}

        Parameters
        ----------
        section : Section
            Rectangle, Ellipse, Circle, or anything with the same properties.
        young_modulus : float
            Y (force per area).
        poisson_ratio : float
            In (-1, 0.5].
        torsion_constant : float, optional
            J (length to the fourth), in place of that of the section.

        Raises
        ------
        InvalidInput
            If an argument is not in its range.
        """
        if not isinstance(section, Section):
            raise InvalidInput(
                f"argument `section` is of type {type(section).__name__}; pass a Rectangle, an Ellipse, "
                "a Circle, or an object with `second_moments` and `torsion_constant`"
            )
        modulus = positive("young_modulus", young_modulus)
        ratio = poisson("poisson_ratio", poisson_ratio)
        j = section.torsion_constant
        if torsion_constant is not None:
            j = positive("torsion_constant", torsion_constant)
        i1, i2 = section.second_moments
        return cls((modulus * i1, modulus * i2), modulus * j / (2.0 * (1.0 + ratio)))

    @classmethod
    def rectangle(
        cls,
        width: float,
        thickness: float,
        young_modulus: float = 1.0,
        *,
        poisson_ratio: float,
        torsion_constant: float | None = None,
    ) -> Self:
        """Return the law of a rod with a rectangular cross-section.

        Parameters
        ----------
        width, thickness : float
            Sides along d1 and d2 (length).
        young_modulus : float
            Y (force per area).
        poisson_ratio : float
            In (-1, 0.5].
        torsion_constant : float, optional
            J (length to the fourth); by default that of Saint-Venant's theory. (4.40) of the thesis
            has 0.256 w t^3 for sides of 5 and 2, where the exact series gives 0.2494.

        Examples
        --------
        >>> from lissome.rods.laws import Kirchhoff
        >>> slinky = Kirchhoff.rectangle(5.0, 2.0, poisson_ratio=0.41, torsion_constant=0.256 * 5 * 2**3)
        >>> print(f"{slinky.twisting:.4f}")
        3.6312
        """
        section = Rectangle(width, thickness)
        return cls.from_section(section, young_modulus, poisson_ratio, torsion_constant)
