"""Strips and rings: planar inextensible elasticas with a natural curvature that may change."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import j0

from .._readonly import readonly_property
from .._tridiagonal import DIAGONAL, GRADIENT, OFF_DIAGONAL
from .._validate import (
    finite,
    finite_array,
    in_open_interval,
    integer_at_least,
    one_of,
    positive,
)
from ..equilibrium import Equilibrium
from ..errors import InvalidInput
from ..factorization import TridiagonalKKT
from ..reactions import Reaction, Reactions
from ..structure import EPS, BaseStructure, Corrected, Evaluation
from . import _kernel
from .light import Light

__all__ = ["ClampedStrip", "Elastica", "ElasticaEquilibrium", "ElasticaState", "Ring"]

Array = NDArray[np.float64]
Curvature = float | ArrayLike | Callable[[Array], ArrayLike]


@dataclass(frozen=True, eq=False)
class ElasticaState:
    """Configuration of a strip or ring.

    Parameters
    ----------
    angles : array_like, shape (k,)
        Angles of the tangent from the horizontal (radians), unwrapped. Copied and made read-only.

    Raises
    ------
    InvalidInput
        If `angles` is not a vector of finite numbers.

    Examples
    --------
    Angles are not wrapped: once around a ring they grow by a full turn.

    >>> import numpy as np
    >>> from lissome.beams import Ring
    >>> angles = Ring(segments=100).start().angles
    >>> print((angles[-1] - angles[0]) / np.pi)
    2.0
    """

    angles: Array

    def __post_init__(self) -> None:
        angles = finite_array("angles", self.angles, shape=(None,))
        angles.flags.writeable = False
        object.__setattr__(self, "angles", angles)


@dataclass(frozen=True, eq=False)
class ElasticaEquilibrium(Equilibrium):
    """An equilibrium of a strip or ring.

    Attributes
    ----------
    angles : ndarray, shape (k,)
        Angles of the tangent (radians).
    x, y : ndarray
        Positions of the nodes, from the origin at the start (in units of the length).

    Examples
    --------
    A strip that is hardly shortened presses on its clamps with the load of Euler's column,
    :math:`4\\pi^2` in units of bending stiffness over length squared:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.beams import ClampedStrip
    >>> state = ls.equilibrate(ClampedStrip(span=0.9999, segments=200))
    >>> print(f"{state.force[0] / (4 * np.pi**2):.3f} {abs(state.force[1]):.3f}")
    1.000 0.000
    """

    @property
    def angles(self) -> Array:
        """Angles of the tangent, shape (k,)."""
        return self.state.angles

    @readonly_property
    def positions(self) -> Array:
        """Positions of the nodes, shape (nodes, 2)."""
        return self.structure.positions(self.state)

    @property
    def x(self) -> Array:
        """Horizontal positions of the nodes, shape (nodes,), in units of the length."""
        return self.positions[:, 0]

    @property
    def y(self) -> Array:
        """Vertical positions of the nodes, shape (nodes,), in units of the length."""
        return self.positions[:, 1]

    @property
    def force(self) -> Array:
        """Force along the elastica, shape (2,): what its end presses with on the support; it is constant.

        In units of bending stiffness over length squared: the multipliers of the end-to-end vector.
        What the supports exert, moments included, is in :meth:`reactions`.
        """
        return self.multipliers


class Elastica(BaseStructure):
    r"""Base of :class:`ClampedStrip` and :class:`Ring`: the discrete inextensible elastica.

    The energy :math:`\int_0^1 \tfrac12 (\theta' - K_0)^2 \, dS` (3.15), with the tangent
    :math:`(\cos\theta, \sin\theta)` integrating to a given end-to-end vector. Lengths are in units
    of the length of the elastica, energies in units of bending stiffness over length.

    Attributes
    ----------
    segments : int
        Number of equal parts of the length.
    response : float
        Factor of the light in the change of natural curvature, :math:`\Lambda` = response times
        intensity. Positive: a lit face contracts (the strip bends toward the light).
    natural_curvature : float, array_like or callable
        Curvature :math:`K_r` without light and load: a number, a function of arc length S in (0, 1)
        (called with an array), or one number per spring (shape of :attr:`spring_arclength`).
    curvature : array_like, optional
        The present natural curvature :math:`K_0` of each spring; :math:`K_r` by default.

    Examples
    --------
    A straight strip that is closed to a circle stores the energy :math:`(2\pi)^2 / 2`:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.beams import Elastica, Ring
    >>> ring = Ring(segments=100, natural_curvature=0.0)
    >>> print(isinstance(ring, Elastica), f"{ls.equilibrate(ring).energy / np.pi**2:.6f}")
    True 2.000000
    """

    segments: int
    response: float
    natural_curvature: Curvature
    curvature: ArrayLike | None

    # -- to be defined by the kinds -----------------------------------------------------------
    @property
    def _chain(self) -> _kernel.Chain:
        """What the compiled kernels know of the geometry."""
        raise NotImplementedError

    @property
    def angles_count(self) -> int:
        """Number of angles, the prescribed ones included."""
        return self.segments + 1

    @property
    def angle_arclength(self) -> Array:
        """Arc length of each angle, shape (k,)."""
        return np.arange(self.segments + 1) / self.segments

    @property
    def spring_arclength(self) -> Array:
        """Arc length of each spring, where natural curvature lives, shape (k - 1,)."""
        return (np.arange(self.segments) + 0.5) / self.segments

    def face(self, side: str) -> float:
        """Return the face that light from `side` falls on: +1 left of the tangent, -1 right."""
        return 1.0 if side == "upper" else -1.0

    # -- Structure ----------------------------------------------------------------------------
    def _check_common(self) -> None:
        object.__setattr__(self, "segments", integer_at_least("segments", self.segments, 8))
        object.__setattr__(self, "response", finite("response", self.response))
        for name in ("natural_curvature", "curvature"):
            value = getattr(self, name)
            if name == "curvature" and value is None:
                continue
            values = self._per_spring(name, value)
            values.flags.writeable = False
            object.__setattr__(self, "_" + name, values)
        if self.curvature is None:
            object.__setattr__(self, "_curvature", getattr(self, "_natural_curvature"))  # noqa: B009

    def _per_spring(self, name: str, value: Any) -> Array:
        count = self.spring_arclength.size
        if callable(value):
            value = value(self.spring_arclength)
            if np.ndim(value) == 0:
                raise InvalidInput(
                    f"argument `{name}` is a function that returns a single number; it is called "
                    f"with an array of arc lengths and must return shape ({count},)"
                )
        if np.ndim(value) == 0:
            return np.full(count, finite(name, value))
        return finite_array(name, value, shape=(count,))

    @property
    def present_curvature(self) -> Array:
        """Present natural curvature :math:`K_0` of each spring, shape (k - 1,), in units of 1/length."""
        return self._curvature  # type: ignore[attr-defined]

    @property
    def rest_curvature(self) -> Array:
        """Natural curvature :math:`K_r` of each spring without light, shape (k - 1,), units of 1/length."""
        return self._natural_curvature  # type: ignore[attr-defined]

    def with_curvature(self, curvature: ArrayLike) -> Any:
        """Return this elastica with another present natural curvature :math:`K_0`.

        Parameters
        ----------
        curvature : array_like, shape (k - 1,)
            One number per spring.
        """
        return replace(self, curvature=curvature)  # type: ignore[type-var]

    @property
    def size(self) -> int:
        """Number of unknown angles."""
        return self._chain.last - self._chain.first

    @property
    def constraints_count(self) -> int:
        """Two: the components of the end-to-end vector."""
        return 2

    @property
    def constraint_names(self) -> tuple[str, str]:
        """Names of the constraints."""
        return ("horizontal distance of the ends", "vertical distance of the ends")

    def adopt(self, state: ElasticaState) -> ElasticaState:
        """Return `state` with the prescribed end angles of this elastica.

        Raises
        ------
        InvalidInput
            If `state` has another number of angles.
        """
        if not isinstance(state, ElasticaState):
            raise InvalidInput(
                f"argument `start` is of type {type(state).__name__}; pass an ElasticaState"
            )
        angles = np.array(state.angles)
        if angles.shape != (self.angles_count,):
            raise InvalidInput(
                f"argument `start` has {angles.size} angles; this elastica has {self.angles_count}"
            )
        return ElasticaState(self._impose(angles))

    def _impose(self, angles: Array) -> Array:
        return angles

    def retract(self, state: ElasticaState, dx: Array) -> ElasticaState:
        """Return the shape with the unknown angles changed by `dx`."""
        chain = self._chain
        angles = np.array(state.angles)
        angles[chain.first : chain.last] += dx
        return ElasticaState(angles)

    def difference(self, a: ElasticaState, b: ElasticaState) -> Array:
        """Return the change of the unknown angles from `a` to `b`."""
        chain = self._chain
        return (b.angles - a.angles)[chain.first : chain.last]

    def metric(self, state: ElasticaState) -> Array:
        """Return quadrature weights: norms approximate :math:`\\int u^2 dS`."""
        chain = self._chain
        weights = np.full(self.angles_count, chain.spacing)
        weights[0], weights[-1] = chain.weight_start, chain.weight_end
        return weights[chain.first : chain.last]

    def noise(self, state: ElasticaState) -> float:
        """Return the round-off of the differences of angles."""
        return 8 * EPS

    def evaluate(self, state: ElasticaState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`.

        Raises
        ------
        InvalidInput
            If `state` has another number of angles.
        """
        chain = self._chain
        n, k = self.size, self.angles_count
        if state.angles.shape != (k,):
            raise InvalidInput(f"the state has {state.angles.size} angles; this elastica has {k}")
        angles = np.array(state.angles)
        work = _kernel.chain_work(n, 2)
        energy = _kernel.evaluate(
            (chain, angles, np.array(self.present_curvature), np.zeros((_kernel.NODE_ROWS, k))),
            angles[chain.first : chain.last],
            np.array(multipliers, dtype=float),
            work,
        )
        if order == 0:
            return Evaluation(energy, work.constraints)
        gradient = work.band[GRADIENT]
        if order == 1:
            return Evaluation(energy, work.constraints, gradient)
        kkt = TridiagonalKKT(work.band[DIAGONAL], work.band[OFF_DIAGONAL, :-1], work.rows)
        return Evaluation(energy, work.constraints, gradient, kkt)

    def correct(
        self, state: ElasticaState, multipliers: Array, tolerance: float
    ) -> Corrected | None:
        """Return a nearby stationary point by the compiled corrector, or None if it is not near.

        Parameters
        ----------
        state : ElasticaState
            Where to start.
        multipliers : ndarray, shape (2,)
            A guess of the force.
        tolerance : float
            Not needed: the corrector goes on until rounding errors are all that is left.
        """
        chain = self._chain
        angles = np.array(state.angles)
        forces = np.array(multipliers, dtype=float)
        work = _kernel.chain_work(self.size, 2)
        data = (
            chain,
            angles,
            np.array(self.present_curvature),
            np.zeros((_kernel.NODE_ROWS, self.angles_count)),
        )
        status, steps, *_ = _kernel.correct(
            angles[chain.first : chain.last],
            forces,
            data,
            residual_floor(self.segments, float(np.max(np.abs(self.present_curvature)))),
            12.0,
            0.5,
            work,
        )
        return (
            Corrected(ElasticaState(angles), forces, iterations=int(steps)) if status == 0 else None
        )

    def present(self, equilibrium: Equilibrium) -> ElasticaEquilibrium:
        """Return `equilibrium` with positions, as an :class:`ElasticaEquilibrium`."""
        return equilibrium.as_type(ElasticaEquilibrium)

    def reactions(self, equilibrium: Any) -> Reactions:
        """Return what the supports exert in `equilibrium`.

        See :meth:`lissome.equilibrium.Equilibrium.reactions`. Forces are in units of bending stiffness
        over length squared, moments (about z) of bending stiffness over length, positions of the length.
        """
        return self._supports_exert(
            equilibrium.angles, self.present_curvature, equilibrium.multipliers
        )

    def _supports_exert(self, angles: Array, curvature: Array, force: Array) -> Reactions:
        """Return what the supports exert at given angles, natural curvature and internal force.

        Parameters
        ----------
        angles : ndarray, shape (k,)
            Angles of the tangent (radians) of an equilibrium.
        curvature : ndarray, shape (k - 1,)
            Its natural curvature :math:`K_0`, in units of 1/length.
        force : ndarray, shape (2,)
            Its multipliers, in units of bending stiffness over length squared.
        """
        return Reactions(())

    # -- geometry -----------------------------------------------------------------------------
    def positions(self, state: ElasticaState) -> Array:
        """Return the positions of the nodes in `state`, shape (nodes, 2), in units of the length."""
        return self._positions(state.angles)

    def _positions(self, angles: Array) -> Array:
        """Return the positions (..., nodes, 2) of the nodes for angles (..., k) of many states."""
        h = self._chain.spacing
        tangent = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        steps = 0.5 * h * (tangent[..., 1:, :] + tangent[..., :-1, :])
        out = np.zeros((*angles.shape[:-1], steps.shape[-2] + 1, 2))
        np.cumsum(steps, axis=-2, out=out[..., 1:, :])
        return out

    @property
    def arclength(self) -> Array:
        """Arc length of the nodes that :meth:`positions` returns, shape (nodes,), in units of the length."""
        return np.arange(self.segments + 1) / self.segments

    def under(self, light: Light) -> Any:
        """Return this elastica under `light`: a :class:`~lissome.beams.Motion` that can be run."""
        from ._motion import Motion

        return Motion(self, light)


def residual_floor(segments: int, curvature: float) -> float:
    """Residual below which Newton's method stops: some twenty times the rounding errors.

    They are those of the differences of angles times the number of segments, and of the natural
    curvature (its largest modulus).
    """
    return 4e-15 * (max(segments, 50) + curvature)


@dataclass(frozen=True, eq=False)
class ClampedStrip(Elastica):
    r"""A strip whose ends are held at a distance less than its length, so that it buckles.

    Parameters
    ----------
    span : float
        Distance of the ends over the length of the strip, in (0, 1): :math:`l_f` of (3.30).
    segments : int
        Number of equal parts.
    response : float
        Sign and size of the reaction of the material to light: the curvature :math:`K_0` relaxes to
        :math:`K_r` + response x flux on the upper face (- response x flux on the lower one).
        +1: the lit face contracts.
    natural_curvature : float, array_like or callable
        :math:`K_r`; see :class:`Elastica`.
    clamp : {"node", "segment"}
        "node" (default): the angles belong to the nodes S = 0, h, ..., 1 and closure is integrated by
        the trapezoidal rule; second order. "segment": the angles are those of rigid segments, of which
        the first and the last are frozen (appendix A.1 of the thesis); first order.
    bump : {"up", "down"}
        The buckled state that :meth:`start` leads to.
    end_angles : tuple of float
        Angles of the tangent at the two ends (radians), where clamped.
    rise : float
        Height of the end above the start, in units of the length.
    ends : tuple of {"clamped", "hinged"}
        Support of start and end: a hinged end turns freely.
    curvature : array_like, optional
        The present natural curvature; see :class:`Elastica`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> import lissome as ls
    >>> from lissome.beams import ClampedStrip
    >>> strip = ClampedStrip(span=0.95, segments=200)
    >>> state = ls.equilibrate(strip)
    >>> print(f"{state.y.max():.4f}")
    0.1401
    """

    span: float
    segments: int = 100
    response: float = 1.0
    natural_curvature: Curvature = 0.0
    clamp: str = "node"
    bump: str = "up"
    end_angles: tuple[float, float] = (0.0, 0.0)
    rise: float = 0.0
    ends: tuple[str, str] = ("clamped", "clamped")
    curvature: ArrayLike | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        remedy = "the clamps are nearer to each other than the strip is long"
        object.__setattr__(self, "span", in_open_interval("span", self.span, 0.0, 1.0, remedy))
        one_of("clamp", self.clamp, ("node", "segment"))
        one_of("bump", self.bump, ("up", "down"))
        if not isinstance(self.end_angles, (tuple, list)) or len(self.end_angles) != 2:
            raise InvalidInput(
                f"argument `end_angles` is {self.end_angles!r}; pass two angles (radians)"
            )
        first, last = (finite(f"end_angles[{i}]", a) for i, a in enumerate(self.end_angles))
        object.__setattr__(self, "end_angles", (first, last))
        if not isinstance(self.ends, (tuple, list)) or len(self.ends) != 2:
            raise InvalidInput(f"argument `ends` is {self.ends!r}; pass two kinds of support")
        for i, kind in enumerate(self.ends):
            one_of(f"ends[{i}]", kind, ("clamped", "hinged"))
        object.__setattr__(self, "ends", tuple(self.ends))
        rise = finite("rise", self.rise)
        object.__setattr__(self, "rise", rise)
        if math.hypot(self.span, rise) >= 1.0:
            raise InvalidInput(
                f"argument `rise` is {rise} with a span of {self.span}; the ends must be nearer to "
                "each other than the strip is long"
            )
        if self.clamp == "segment" and "hinged" in self.ends:
            raise InvalidInput(
                "argument `ends` has a hinge and `clamp` is 'segment'; segment clamps are for two "
                "clamped ends"
            )
        self._check_common()

    @cached_property
    def _chain(self) -> _kernel.Chain:
        """What the compiled kernels know of the geometry."""
        h = 1.0 / self.segments
        end = 0.5 * h if self.clamp == "node" else h
        count = self.angles_count
        return _kernel.Chain(
            h,
            end,
            end,
            self.span,
            self.rise,
            1 if self.ends[0] == "clamped" else 0,
            count - 1 if self.ends[1] == "clamped" else count,
            False,
        )

    @property
    def angles_count(self) -> int:
        """Number of angles, the prescribed ones included."""
        return self.segments + 1 if self.clamp == "node" else self.segments

    @property
    def angle_arclength(self) -> Array:
        """Arc length of each angle."""
        if self.clamp == "node":
            return np.arange(self.segments + 1) / self.segments
        return (np.arange(self.segments) + 0.5) / self.segments

    @property
    def spring_arclength(self) -> Array:
        """Arc length of each spring."""
        if self.clamp == "node":
            return (np.arange(self.segments) + 0.5) / self.segments
        return np.arange(1, self.segments) / self.segments

    def _impose(self, angles: Array) -> Array:
        if self.ends[0] == "clamped":
            angles[0] = self.end_angles[0]
        if self.ends[1] == "clamped":
            angles[-1] = self.end_angles[1]
        return angles

    def start(self) -> ElasticaState:
        """Return a guess of the buckled shape: the linear mode with the right shortening."""
        s = self.angle_arclength
        if self.clamp == "segment":
            s = np.linspace(0.0, 1.0, s.size)
        turns = 2.0 - 0.5 * sum(kind == "hinged" for kind in self.ends)
        sign = 1.0 if self.bump == "up" else -1.0
        chord = math.hypot(self.span, self.rise)
        amplitude = brentq(lambda a: j0(a) - chord, 0.0, 2.4049)
        tilt = math.atan2(self.rise, self.span)
        if self.ends == ("hinged", "clamped"):
            wave = np.sin(math.pi * turns * (s - 1.0))
        elif self.ends == ("hinged", "hinged"):
            wave = np.cos(math.pi * s)
        else:
            wave = np.sin(math.pi * turns * s)
        angles = sign * amplitude * wave + tilt
        if self.ends == ("clamped", "clamped"):
            angles += self.end_angles[0] - tilt
            angles += s * (self.end_angles[1] - self.end_angles[0])
        return ElasticaState(self._impose(angles))

    def _positions(self, angles: Array) -> Array:
        if self.clamp == "node":
            return super()._positions(angles)
        tangent = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        out = np.zeros((*angles.shape[:-1], angles.shape[-1] + 1, 2))
        np.cumsum(tangent / self.segments, axis=-2, out=out[..., 1:, :])
        return out

    def _supports_exert(self, angles: Array, curvature: Array, force: Array) -> Reactions:
        """Return what "start" and "end" exert; see :meth:`Elastica._supports_exert`.

        The moment of a clamp is the derivative of the energy by its angle.

        Parameters
        ----------
        angles : ndarray, shape (k,)
            Angles of the tangent (radians) of an equilibrium.
        curvature : ndarray, shape (k - 1,)
            Its natural curvature :math:`K_0`, in units of 1/length.
        force : ndarray, shape (2,)
            Its multipliers, in units of bending stiffness over length squared.
        """
        chain = self._chain
        bent = (angles[[1, -1]] - angles[[0, -2]]) / chain.spacing - curvature[[0, -1]]
        found = []
        for i, name in enumerate(("start", "end")):
            side = 1.0 - 2.0 * i
            moment = 0.0
            if self.ends[i] == "clamped":
                angle = float(angles[-i])
                weight = (chain.weight_start, chain.weight_end)[i]
                lever = force[1] * math.cos(angle) - force[0] * math.sin(angle)
                moment = weight * lever - side * bent[i]
            place = np.array([i * self.span, i * self.rise, 0.0])
            push = np.array([side * force[0], side * force[1], 0.0])
            found.append(Reaction(push, np.array([0.0, 0.0, moment]), place, name))
        return Reactions(found)

    def with_span(self, span: float) -> ClampedStrip:
        """Return this strip between clamps at another distance `span`, in (0, 1)."""
        return replace(self, span=span)


@dataclass(frozen=True, eq=False)
class Ring(Elastica):
    r"""A closed ring that rolls on the ground.

    The ring is counterclockwise: the tangent angle grows by :math:`2\pi` along it, from 0 at the
    bottom. Light falls on its outer face. The ring touches the ground where its center of mass is
    lowest, (3.17)-(3.18), and rolls without sliding; the contact is followed as a continuous root.

    Parameters
    ----------
    segments : int
        Number of equal parts.
    response : float
        Reaction of the material: :math:`K_0` relaxes to :math:`K_r` - response x flux, since light
        falls on the outer face. +1: the lit face contracts, which flattens the lit part.
    natural_curvature : float, array_like or callable
        :math:`K_r`, a circle (:math:`2\pi`) by default; see :class:`Elastica`.
    hold : float
        Time during which the contact is held at S = 0. A circle has no preferred contact, and
        the linear theory from a circle has a logarithmic singularity at time 0 (the ring would start
        to roll at infinite speed): the later motion depends on this regularization only by a shift.
    curvature : array_like, optional
        The present natural curvature; see :class:`Elastica`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> import lissome as ls
    >>> from lissome.beams import Ring
    >>> state = ls.equilibrate(Ring(segments=100))
    >>> print(f"{state.y.max() - state.y.min():.3f}")  # the diameter, 1 / pi
    0.318
    """

    segments: int = 100
    response: float = 1.0
    natural_curvature: Curvature = 2.0 * math.pi
    hold: float = 0.01
    curvature: ArrayLike | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "hold", positive("hold", self.hold))
        self._check_common()

    @cached_property
    def _chain(self) -> _kernel.Chain:
        """What the compiled kernels know of the geometry."""
        h = 1.0 / self.segments
        return _kernel.Chain(h, 0.5 * h, 0.5 * h, 0.0, 0.0, 1, self.segments, True)

    def face(self, side: str) -> float:
        """Return the face that light falls on: the outer one, to the right of the tangent."""
        return -1.0

    def start(self) -> ElasticaState:
        """Return a circle."""
        return ElasticaState(2.0 * math.pi * self.angle_arclength)

    def _impose(self, angles: Array) -> Array:
        angles = angles - angles[0]
        angles[-1] = 2.0 * math.pi
        return angles
