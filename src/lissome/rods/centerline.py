r"""The centerline-twist representation of a discrete rod: nodes and twist angles.

A configuration of N segments is the vector :math:`X = (x_0, \varphi^0, x_1, \varphi^1, \dots, x_N)` of the
nodes and of one angle for each segment, together with reference frames :math:`D^j` that do not move. The
frame of segment j is

.. math:: d^j = p_{T^j}^{t^j}\, r_{T^j}(\varphi^j)\, D^j ,

that is: turn the reference frame by :math:`\varphi^j` about its own tangent :math:`T^j = D^j * e_3`,
then carry it to the tangent :math:`t^j` of the segment on the shortest way.

:func:`strain_energy` gives energy, gradient and Hessian of any law in these unknowns.
:class:`~lissome.rods.centerline_structure.CenterlineTwist` is a whole rod in them, with one constraint
of inextensibility for each segment: a second structure with the same discrete equilibria as the rod
that it is made from, which uses other unknowns (the frames themselves). It is here to check that one,
and to check the formulas of the thesis; it costs more, and its matrices are worse conditioned by a
factor of about the number of segments squared.

**The reference.** Energy, strains, and the derivative with respect to the twist angles do not
depend on it. The derivative with respect to the nodes does away from equilibrium, because a motion of a node
with fixed :math:`\varphi` turns the frame in a way that the reference decides (it is *covariant*: the
same differential in other coordinates). The chart ends where a segment points opposite to its reference,
:math:`1 + T\cdot t = 0`; states within :data:`~lissome.rods.quaternions.ANTIPARALLEL` of it are refused. A
structure takes the current frames of a segment as its new reference whenever
:math:`1 + T\cdot t` falls below :data:`RESET`; this is a change of coordinates and moves nothing.

**Signs.** The rotation across a hinge is taken with an angle of at most pi, the scalar part of its
quaternion positive. Without this, (4.14) of the thesis depends on the signs of the quaternions that
represent the frames, and one wrong sign silently changes the energy of a rod with natural curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite_array
from ..errors import InvalidInput
from . import _centerline_kernel as _kernel
from .laws import Law
from .quaternions import ANTIPARALLEL, UNIT, multiply, to_directors

__all__ = ["RESET", "CenterlineState", "StrainEnergy", "strain_energy"]

Array = NDArray[np.float64]

#: A segment gets a new reference when 1 + T.t falls below this: when it has turned by 120 degrees.
RESET = 0.5


class _Reconstruction(NamedTuple):
    """What follows from nodes, twists and reference; see ``_centerline_kernel.reconstruct``."""

    tangents: Array
    edges: Array
    sizes: Array
    binormals: Array
    bent: Array
    frames: Array


def _reconstruct(
    positions: Array, twists: Array, reference: Array, extra: int = 0
) -> tuple[_Reconstruction, float]:
    n = twists.size
    made = _Reconstruction(
        np.empty((2, n, 3)), np.empty((n, 3)), np.empty(n), np.empty((n, 3)), np.empty(n),
        np.empty((n + extra, 4)),
    )  # fmt: skip
    return made, _kernel.reconstruct(positions, twists, reference, *made)


@dataclass(frozen=True, eq=False)
class CenterlineState:
    r"""A configuration of a discrete rod: nodes, twist angles, and reference frames.

    Parameters
    ----------
    positions : array_like, shape (N + 1, 3)
        Nodes x.
    twists : array_like, shape (N,)
        Angles :math:`\varphi` (radians) about the tangents, counted from the reference frames.
    reference : array_like, shape (N, 4)
        Unit quaternions D, scalar first, of the reference frames. Their third directors are the
        reference tangents T; they may be any frames, as long as no segment points opposite to its own.

    Raises
    ------
    InvalidInput
        If shapes do not fit, two successive nodes coincide, or a segment points opposite to the
        tangent of its reference.

    Examples
    --------
    A right-angled bend, referred to a straight rod along e3:

    >>> import numpy as np
    >>> from lissome.rods.centerline import CenterlineState
    >>> straight = np.array([[1.0, 0, 0, 0]] * 2)
    >>> bend = CenterlineState([[0, 0, 0], [0, 0, 1], [1, 0, 1]], [0.0, 0.0], straight)
    >>> print(bend.strains.round(12))  # 2 sin(90 degrees / 2) about d2
    [[0.         1.41421356 0.        ]]
    """

    positions: Array
    twists: Array
    reference: Array
    _made: _Reconstruction = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions: Array = finite_array("positions", self.positions, (None, 3))
        n = positions.shape[0] - 1
        if n < 1:
            raise InvalidInput(
                f"argument `positions` has shape {positions.shape}; a rod has at least two nodes"
            )
        twists: Array = finite_array("twists", self.twists, (n,))
        reference: Array = finite_array("reference", self.reference, (n, 4))
        norms = np.linalg.norm(reference, axis=1)
        if np.any(np.abs(norms - 1.0) > UNIT):
            j = int(np.argmax(np.abs(norms - 1.0)))
            raise InvalidInput(
                f"argument `reference`[{j}] has length {norms[j]:.9g}; pass unit quaternions"
            )
        reference /= norms[:, None]
        made, least = _reconstruct(positions, twists, reference)
        _check_chart(made, least)
        for name, array in (("positions", positions), ("twists", twists), ("reference", reference)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "_made", made)

    @classmethod
    def from_frames(cls, positions: ArrayLike, quaternions: ArrayLike) -> CenterlineState:
        """Return the state of given nodes and frames, with these frames as reference.

        Parameters
        ----------
        positions : array_like, shape (N + 1, 3)
            Nodes.
        quaternions : array_like, shape (N, 4)
            Unit quaternions of the frames of the segments, scalar first. Third directors must
            point along the segments, to 1e-8.

        Raises
        ------
        InvalidInput
            If a frame is not adapted to its segment, or shapes do not fit.
        """
        nodes: Array = finite_array("positions", positions, (None, 3))
        frames: Array = finite_array("quaternions", quaternions, (max(nodes.shape[0] - 1, 0), 4))
        state = cls(nodes, np.zeros(frames.shape[0]), frames)
        off = np.linalg.norm(state.tangents - state.reference_tangents, axis=1)
        if np.any(off > UNIT):
            j = int(np.argmax(off))
            raise InvalidInput(
                f"argument `quaternions`[{j}] is a frame whose third director is off the tangent of "
                f"segment {j} by {off[j]:.2g} radians; adapt the frames to the segments"
            )
        return state

    @classmethod
    def from_vector(cls, x: ArrayLike, reference: ArrayLike) -> CenterlineState:
        """Return the state of a vector of unknowns (4.13), shape (4 N + 3,).

        Parameters
        ----------
        x : array_like, shape (4 N + 3,)
            The unknowns (4.13).
        reference : array_like, shape (N, 4)
            Reference frames: unit quaternions, scalar first.

        Raises
        ------
        InvalidInput
            If shapes do not fit, or the configuration is not in the chart of the reference.
        """
        vector: Array = finite_array("x", x, (None,))
        n, rest = divmod(vector.size - 3, 4)
        if rest or n < 1:
            raise InvalidInput(
                f"argument `x` has {vector.size} entries; N segments have 4 N + 3 unknowns"
            )
        rows = vector[:-3].reshape(n, 4)
        return cls(np.vstack([rows[:, :3], vector[-3:]]), rows[:, 3], reference)  # type: ignore[arg-type]

    @property
    def segments(self) -> int:
        """Number N of segments."""
        return int(self.twists.size)

    @property
    def vector(self) -> Array:
        """The unknowns in the order of (4.13): x_0, phi^0, x_1, ..., x_N; shape (4 N + 3,)."""
        rows = np.hstack([self.positions[:-1], self.twists[:, None]])
        return np.concatenate([rows.ravel(), self.positions[-1]])

    @property
    def tangents(self) -> Array:
        """Unit tangents t of the segments, shape (N, 3)."""
        return _frozen(self._made.tangents[1])

    @property
    def reference_tangents(self) -> Array:
        """Unit tangents T of the reference, shape (N, 3)."""
        return _frozen(self._made.tangents[0])

    @property
    def quaternions(self) -> Array:
        """Unit quaternions d of the frames of the segments (4.11), shape (N, 4), scalar first."""
        return _frozen(self._made.frames)

    @property
    def directors(self) -> Array:
        """Directors of the segments (4.10), shape (N, 3, 3): ``directors[j, I]`` is director I."""
        return to_directors(self._made.frames)

    @cached_property
    def strains(self) -> Array:
        """Strains kappa (4.16) at the inner nodes, shape (N - 1, 3): integrated, not densities."""
        inner = np.arange(self.segments - 1)
        q, kappa = np.empty((inner.size, 4)), np.empty((inner.size, 3))
        _kernel.hinge_rotations(self._made.frames, inner, inner + 1, q, kappa)
        return _frozen(kappa)

    def stretching(self, lengths: ArrayLike) -> Array:
        """Return the stretching measures (4.17), integrated over the segments, shape (N,).

        Parameters
        ----------
        lengths : array_like, shape (N,)
            Rest lengths of the segments.
        """
        rest = _rest_lengths(lengths, self.segments)
        return 0.5 * (self._made.sizes**2 / rest - rest)

    def reset(self) -> CenterlineState:
        """Return the same configuration with its own frames as reference, and no twist angles."""
        return CenterlineState(self.positions, np.zeros(self.segments), self._made.frames)

    def referred_to(self, reference: ArrayLike) -> CenterlineState:
        """Return the same configuration with other reference frames.

        Twist angles follow from the frames, up to whole turns: they are taken in (-pi, pi].

        Parameters
        ----------
        reference : array_like, shape (N, 4)
            Unit quaternions, scalar first.

        Raises
        ------
        InvalidInput
            If a segment points opposite to its reference.
        """
        bare = CenterlineState(self.positions, np.zeros(self.segments), reference)  # type: ignore[arg-type]
        q = multiply(self._made.frames, bare._made.frames * [1.0, -1.0, -1.0, -1.0])
        along = np.sum(q[:, 1:] * self._made.tangents[1], axis=1)
        angle = 2.0 * np.arctan2(along, q[:, 0])
        angle -= 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
        return CenterlineState(self.positions, angle, reference)  # type: ignore[arg-type]


def reconstructed(
    positions: Array, twists: Array, reference: Array, reset_below: float
) -> CenterlineState:
    """Return a state of arrays of the right shapes, with new references where 1 + T.t is small."""
    made, least = _reconstruct(positions, twists, reference)
    _check_chart(made, least)
    if least < reset_below:
        far = made.bent < reset_below
        twists = np.where(far, 0.0, twists)
        reference = np.where(far[:, None], made.frames, reference)
        reference /= np.sqrt(np.sum(reference**2, axis=1))[:, None]
        made, _ = _reconstruct(positions, twists, reference)
    state: CenterlineState = object.__new__(CenterlineState)
    for name, array in (("positions", positions), ("twists", twists), ("reference", reference)):
        array.flags.writeable = False
        object.__setattr__(state, name, array)
    object.__setattr__(state, "_made", made)
    return state


def _frozen(array: Array) -> Array:
    view = array.view()
    view.flags.writeable = False
    return view


def _check_chart(made: _Reconstruction, least: float) -> None:
    # |T + t| is the angle to the opposite direction, when it is small
    if least >= 0.5 * ANTIPARALLEL**2:
        return
    empty = made.sizes == 0.0
    if np.any(empty):
        j = int(np.argmax(empty))
        raise InvalidInput(
            f"argument `positions` has the same point for nodes {j} and {j + 1}; a segment needs a "
            "length to have a tangent"
        )
    j = int(np.argmin(made.bent))
    raise InvalidInput(
        f"segment {j} points opposite to the tangent of its reference (1 + T.t is "
        f"{made.bent[j]:.2g}); parallel transport has no axis then: take a nearer reference "
        "(`reset` before such a move)"
    )


def _rest_lengths(lengths: ArrayLike, n: int) -> Array:
    rest: Array = finite_array("lengths", lengths, (n,))
    if not np.all(rest > 0.0):
        j = int(np.argmin(rest))
        raise InvalidInput(f"argument `lengths`[{j}] is {rest[j]:g}; it must be greater than 0")
    return rest


@dataclass(frozen=True, eq=False)
class StrainEnergy:
    """Strain energy of a rod in the unknowns (4.13), with its derivatives.

    Attributes
    ----------
    value : float
        The energy.
    gradient : ndarray, shape (4 N + 3,), or None
        First derivatives, in the order of ``CenterlineState.vector``.
    band : ndarray, shape (4 N + 3, 11), or None
        Second derivatives: ``band[j, k]`` is the entry in row j + k, column j. Beyond it all is zero.

    Examples
    --------
    Each of the two inner hinges of a straight rod of three segments bends in two ways and twists; all
    other motions of the 15 unknowns cost nothing:

    >>> import numpy as np
    >>> from lissome.rods import Kirchhoff
    >>> from lissome.rods.centerline import CenterlineState, strain_energy
    >>> nodes = [[0.0, 0.0, float(i)] for i in range(4)]
    >>> state = CenterlineState(nodes, np.zeros(3), [[1.0, 0.0, 0.0, 0.0]] * 3)
    >>> energy = strain_energy(state, Kirchhoff(1.0, 1.0), np.ones(3))
    >>> print(energy.value, np.count_nonzero(np.linalg.eigvalsh(energy.hessian()) > 1e-9))
    0.0 6
    """

    value: float
    gradient: Array | None = None
    band: Array | None = None

    def hessian(self) -> Array:
        """Return the second derivatives as a dense matrix, shape (4 N + 3, 4 N + 3).

        Raises
        ------
        InvalidInput
            If the energy was evaluated to first order only.
        """
        if self.band is None:
            raise InvalidInput("this energy was evaluated to first order; pass `order=2`")
        return dense_from_band(self.band)


def dense_from_band(band: Array) -> Array:
    """Return the symmetric matrix of a band: ``band[j, k]`` is in row j + k, column j."""
    size = band.shape[0]
    matrix = np.zeros((size, size))
    for k in range(min(band.shape[1], size)):
        columns = np.arange(size - k)
        matrix[columns + k, columns] = band[: size - k, k]
        matrix[columns, columns + k] = band[: size - k, k]
    return matrix


def strain_energy(
    state: CenterlineState,
    law: Law,
    lengths: ArrayLike,
    natural: ArrayLike | None = None,
    *,
    order: int = 2,
) -> StrainEnergy:
    r"""Return the strain energy of bending and twisting with its derivatives.

    .. math:: \mathcal E(X) = \sum_{i=1}^{N-1} \ell_i\, W\!\left(\frac{\kappa_i(X)}{\ell_i} - \bar k_i\right)

    over the inner nodes, with their Voronoi lengths.

    Parameters
    ----------
    state : CenterlineState
        Configuration and reference.
    law : Law
        Energy per unit length of the strain densities; if its parameters vary, with one row for each
        of the N + 1 nodes.
    lengths : array_like, shape (N,)
        Rest lengths of the segments.
    natural : array_like, shape (3,) or (N + 1, 3), optional
        Natural strain densities, uniform or at the nodes; zero by default.
    order : {0, 1, 2}
        Highest derivative that is wanted.

    Returns
    -------
    StrainEnergy

    Raises
    ------
    InvalidInput
        If shapes do not fit.

    Notes
    -----
    First sum of (4.32) of the thesis, (4.31), (4.34), and the variations (4.22)-(4.28), contracted with
    the stress.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.centerline import CenterlineState, strain_energy
    >>> from lissome.rods.laws import Kirchhoff
    >>> straight = np.array([[1.0, 0, 0, 0]] * 2)
    >>> bend = CenterlineState([[0, 0, 0], [0, 0, 1], [1, 0, 1]], [0.0, 0.0], straight)
    >>> print(round(strain_energy(bend, Kirchhoff(1.0, 1.0), [1, 1]).value, 12))  # kappa^2 / 2
    1.0
    """
    if order not in (0, 1, 2):
        raise InvalidInput(f"argument `order` is {order!r}; it must be 0, 1 or 2")
    n = state.segments
    rest = _rest_lengths(lengths, n)
    if natural is None:
        natural = np.zeros(3)
    strain: Array = finite_array("natural", natural)
    if strain.shape not in ((3,), (n + 1, 3)):
        raise InvalidInput(
            f"argument `natural` has shape {strain.shape}; it must be (3,), or ({n + 1}, 3): one row "
            "for each node"
        )
    inner = np.arange(n - 1)
    span = 0.5 * (rest[1:] + rest[:-1])
    rows = np.broadcast_to(strain, (n + 1, 3))[1:-1]
    here = law if law.count is None else law.at(inner + 1)
    q, kappa = np.empty((n - 1, 4)), np.empty((n - 1, 3))
    made = state._made
    _kernel.hinge_rotations(made.frames, inner, inner + 1, q, kappa)
    density, stress, stiffness = here.evaluate(kappa / span[:, None] - rows, order)  # (4.31)
    value = float(span @ density)
    if order == 0:
        return StrainEnergy(value)
    base = 4 * np.arange(n + 1)
    gradient = np.empty(4 * n + 3)
    band = np.empty((4 * n + 3 if order == 2 else 0, 11))
    stiffness = np.empty((0, 3, 3)) if stiffness is None else stiffness / span[:, None, None]
    _kernel.assemble(
        state.positions, made.tangents, made.edges, made.sizes, made.binormals, made.bent, made.frames,
        q, stress, stiffness, inner, inner + 1, rest, -1.0, np.zeros((n + 1, 3)), np.empty((0, 7)),
        np.zeros(n), base[:, None] + np.arange(3), base[:-1] + 3, np.full(n, -1), gradient,
        np.empty(n), band, order,
    )  # fmt: skip
    return StrainEnergy(value, gradient, band if order == 2 else None)
