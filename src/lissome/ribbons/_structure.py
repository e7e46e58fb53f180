"""Ribbons as structures: a rod, rulings, and the constraints that make the strip developable."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from .._relaxation import relaxed
from .._telling import is_news, user_level
from .._validate import finite, finite_array, one_of
from ..equilibrium import Equilibrium, equilibrate
from ..errors import (
    InvalidInput,
    LissomeWarning,
    NotConverged,
    StabilityNotResolvable,
    Unstable,
)
from ..factorization import ChainKKT
from ..rods import Rod, RodState
from ..rods import _kernel as rod_kernel
from ..rods._corrector import fast_correction
from ..rods._structure import check_state
from ..rods.quaternions import conjugate, exponential, multiply
from ..structure import EPS, BaseStructure, Corrected, Evaluation
from . import _kernel
from ._layout import POINTS, WEIGHTS, Layout, derive
from ._starts import carried_over, turned_band
from .laws import RibbonLaw

__all__ = ["Ribbon", "RibbonState"]

Array = NDArray[np.float64]

SCHEMES = ("staggered", "cells", "moments", "nodal")
JOINTS = ("matched", "free")


#: Folds from which on rounding errors of slopes count: cosh(a)^2 is 1e3.
SATURATED = 4.15
#: Largest change of a fold in one step.
LONGEST = 1.0
#: Folds whose difference from infinity rounding errors hide.
LARGEST_FOLD = 15.0

#: Steps in which a strip with moments as unknowns is to come to rest.
RELAXATIONS = 200

#: Number of segments up to which every band is looked at for having passed through itself.
CHECKED = 600


class _RibbonKKT(ChainKKT):
    """The KKT matrix of a ribbon, which knows how large moments are in a ribbon free of stress.

    Moments about d2 and d3 are multipliers. Where they vanish, rounding errors of the bending moment are
    all that there is in some components, and are not to be compared with themselves.
    """

    least: Array

    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms that `apply` sums; if all of `dx` is positive, typical ones."""
        if dx.size and float(dx.min()) > 0.0:
            dmultipliers = np.maximum(np.abs(dmultipliers), self.least)
        return super().magnitude(dx, dmultipliers)


@dataclass(frozen=True, eq=False)
class RibbonState(RodState):
    """Configuration of a ribbon: that of its center line, and its rulings.

    Parameters
    ----------
    quaternions, origin, stretches, angles, supports
        As of :class:`~lissome.rods.RodState`; the stretches are ones.
    rulings : array_like, shape (r,), optional
        Ruling parameters, on segments and clamps (scheme "staggered") or at hinges.
    folds : array_like, shape (n,), optional
        Fold variables of the hinges.

    Raises
    ------
    InvalidInput
        If `rulings` or `folds` is not a vector of finite numbers.

    Examples
    --------
    The rulings of a strip that is merely bent are normal to its center line:

    >>> import lissome as ls
    >>> from lissome import ribbons
    >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    >>> strip = ribbons.straight(1.0, 20, law).clamped("start").clamped("end", position=(0, 0, 0.9))
    >>> state = ls.equilibrate(strip).state
    >>> print(abs(state.rulings).max() < 1e-9, abs(state.folds).max() < 1e-9)
    True True
    """

    rulings: Any = None
    folds: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("rulings", "folds"):
            value = getattr(self, name)
            array = finite_array(name, np.zeros(0) if value is None else value, (None,))
            array.flags.writeable = False
            object.__setattr__(self, name, array)


def _state(rod: RodState, rulings: Array, folds: Array) -> RibbonState:
    """Make a state of parts that are known to be right, and that nobody changes."""
    for array in (rulings, folds):
        array.flags.writeable = False
    state = object.__new__(RibbonState)
    vars(state).update(vars(rod), rulings=rulings, folds=folds)
    return state


@dataclass(frozen=True, eq=False)
class Ribbon(BaseStructure):
    r"""A discrete inextensible ribbon: a chain of plane faces, folded along rulings at the nodes.

    A rod whose hinges bend about their rulings only, :math:`\kappa_2 = 0` and
    :math:`\kappa_3 = \eta\kappa_1` (4.35), with the energy

    .. math:: E = \sum_i \ell_i W(\kappa_{i,1}/\ell_i, \eta_i, \eta'_i) - \sum_i F_i\cdot x_i

    of :class:`Wunderlich` or :class:`Sadowsky`. The ruling parameters are unknowns, and so is the fold
    variable a of each hinge, :math:`\tfrac12 w\eta' = \tanh a`: no step passes the barrier
    :math:`|w\eta'| < 2`. Ribbons are made by :func:`straight`, :func:`circle` and :func:`band`.

    Parameters
    ----------
    law : Wunderlich or Sadowsky
    rod : Rod
        Mesh, supports and loads.
    scheme : {"staggered", "cells", "moments", "nodal"}
        "staggered": rulings belong to segments and clamps, and a hinge takes their mean and difference
        quotient. "cells": rulings belong to hinges, slopes and fold variables to the cells between
        them, and a hinge takes the mean energy of both its cells. "moments" (open ribbons, flat at
        rest, clamped at their ends): moments are unknowns, smooth cubics between hinges, rulings have four
        parts there, and the angles of the hinges are derivatives of the complementary energy, which is
        even where the bending changes sign. Where a twisted strip has inflections, give them at least four
        segments to a width: the energy has a ripple with the place of an inflection between two nodes,
        which with two segments to a width moves a loss of stability by a twentieth, with four by a
        hundredth, if they are equal along the way of the inflections. "nodal" (that of the
        thesis): rulings belong to hinges, with central differences. A place where the bending changes
        sign passes a hinge smoothly with "cells" and "moments": in the other two the slope of a hinge
        without bending is twice the inverse of the width, and its fold variable infinite.
    half_turns : int
        Closed ribbons: half turns of the frame about the tangent at the joint.
    joint : {"matched", "free"}
        Closed ribbons: whether the rulings are continuous across the joint: up to the sign for an odd
        number of half turns. "free" leaves the rulings on both sides of the joint apart; its states of
        least energy have strains that jump there, and are not those of a smooth band.
    phase : bool
        Closed, uniform and unloaded ribbons: whether the ruling on the first segment is held normal to
        the center line, so that the pattern cannot travel along the band.
    clamped_rulings : tuple of (int, float)
        Nodes of clamps whose ruling is given, with its parameter; see :meth:`clamped`.
    initial : RibbonState or RodState, optional
        Where solvers start.

    Raises
    ------
    InvalidInput
        If an argument has a wrong value.

    Examples
    --------
    A band without a half turn is a cylinder, with the energy :math:`2\pi^2 D w / L` but for the mesh:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome import ribbons
    >>> band = ribbons.band(1.0, 40, ribbons.Wunderlich(width=0.1, rigidity=1.0), half_turns=0)
    >>> print(isinstance(band, ribbons.Ribbon))
    True
    >>> print(f"{ls.equilibrate(band).energy / (2 * np.pi**2 * 0.1):.2f}")
    1.00
    """

    law: RibbonLaw
    rod: Rod
    scheme: str = "staggered"
    half_turns: int = 0
    joint: str = "matched"
    phase: bool = True
    clamped_rulings: tuple[tuple[int, float], ...] = ()
    initial: Any = None

    def __post_init__(self) -> None:
        _check_law(self.law)
        if not isinstance(self.rod, Rod):
            raise InvalidInput(
                f"argument `rod` is of type {type(self.rod).__name__}; pass a rods.Rod, or use "
                "ribbons.straight, ribbons.circle or ribbons.band"
            )
        one_of("scheme", self.scheme, SCHEMES)
        one_of("joint", self.joint, JOINTS)
        if self.has_moments:
            self._check_moments()
        if self.rod.stretching is not None:
            raise InvalidInput("argument `rod` can stretch; a ribbon is inextensible")
        if self.rod.measure != "sine":
            raise InvalidInput(
                f"argument `rod` has the measure {self.rod.measure!r}; a ribbon needs 'sine'"
            )
        turns = self.half_turns
        if isinstance(turns, bool) or not isinstance(turns, (int, np.integer)):
            raise InvalidInput(
                f"argument `half_turns` is {turns!r}; pass a whole number: other bands do not close"
            )
        if turns and not self.rod.closed:
            raise InvalidInput(
                f"argument `half_turns` is {turns}; only a closed ribbon has them (ribbons.band)"
            )
        if self.rod.closed and abs(self.rod.joint - turns * math.pi) > 1e-12 * (1 + abs(turns)):
            raise InvalidInput(
                f"argument `rod` is joined at an angle of {self.rod.joint:g}; half_turns={turns} needs "
                f"{turns * math.pi:g}"
            )
        self._check_width(self.law)
        if not isinstance(self.phase, bool):
            raise InvalidInput(f"argument `phase` is {self.phase!r}; pass True or False")
        framed = {support.node for support in self.rod.supports if support.frame is not None}
        for node, value in self.clamped_rulings:
            if node not in framed:
                raise InvalidInput(
                    f"argument `clamped_rulings` names node {node}, which is not clamped; use "
                    "clamped(..., ruling=...)"
                )
            finite("clamped_rulings", value)
        _check_prescribed(self.law, self.clamped_rulings)
        if self.initial is None:
            object.__setattr__(self, "initial", self.rod.initial)

    def _check_moments(self) -> None:
        """Refuse what the scheme "moments" does not know."""
        what = ""
        if self.rod.closed:
            what = "a closed ribbon"
        elif self.law.naturally_curved:
            what = "a ribbon that is curved at rest"
        elif any(0 < support.node < self.rod.lengths.size for support in self.rod.supports
                 if support.frame is not None):  # fmt: skip
            what = "a clamp between the ends"
        if what:
            raise InvalidInput(
                f"argument `scheme` is 'moments', which does not know {what}; use 'cells'"
            )

    def _check_width(self, law: RibbonLaw) -> None:
        """Refuse a strip that is too wide for one half turn."""
        if abs(self.half_turns) != 1 or not law.has_fold:
            return
        limit = self.rod.length / math.sqrt(3.0)
        if law.width >= limit * (1.0 - 1e-9):
            raise InvalidInput(
                f"argument `width` is {law.width:g}, {law.width / self.rod.length:.6g} of the length; a "
                f"band with one half turn must be narrower than 1/sqrt(3) of its length ({limit:.6g}), "
                "where it folds up to flat triangles"
            )

    def _with(self, **changes: Any) -> Ribbon:
        new = object.__new__(Ribbon)
        own = vars(self)
        vars(new).update({name: own[name] for name in _FIELDS}, _shared=self._shared, **changes)
        if new.has_moments:
            new._check_moments()
        return new

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs: all but what other ribbons share."""
        return {name: value for name, value in vars(self).items() if name != "_shared"}

    @cached_property
    def _shared(self) -> dict[str, Any]:
        """What was derived last for this ribbon or one made from it, with what it was derived from."""
        return {}

    # ---- supports, loads, material ---------------------------------------------------------------

    def clamped(
        self,
        where: str | int,
        position: Any = None,
        frame: Any = None,
        clamp: str = "node",
        ruling: float | None = None,
    ) -> Ribbon:
        """Return this ribbon with position and frame of a node prescribed.

        Parameters
        ----------
        where, position, frame, clamp
            As of :meth:`lissome.rods.Rod.clamped`.
        ruling : float, optional
            Ruling parameter at the clamp; 0 is a straight jaw across the strip. Free by default: only
            the center line and its frame are held.

        Raises
        ------
        InvalidInput
            If there is no such node, or a value is not of the right kind.
        """
        rod = self.rod.clamped(where, position, frame, clamp)
        node = rod._node(where)
        kept = [p for p in self.clamped_rulings if p[0] != node]
        if ruling is not None:
            _check_prescribed(self.law, ((node, ruling),))
            kept.append((node, finite("ruling", ruling)))
        return self._with(rod=rod, clamped_rulings=tuple(sorted(kept)))

    def pinned(self, where: str | int, position: Any = None) -> Ribbon:
        """Return this ribbon with the position of a node prescribed.

        Parameters
        ----------
        where, position
            As of :meth:`lissome.rods.Rod.pinned`.
        """
        return self._changed(self.rod.pinned(where, position), where)

    def hinged(
        self,
        where: str | int,
        position: Any = None,
        frame: Any = None,
        *,
        axis: ArrayLike,
        moment: float = 0.0,
    ) -> Ribbon:
        """Return this ribbon with a frame at a node that turns about a fixed axis only.

        Parameters
        ----------
        where, position, frame, axis, moment
            As of :meth:`lissome.rods.Rod.hinged`.
        """
        rod = self.rod.hinged(where, position, frame, axis=axis, moment=moment)
        return self._changed(rod, where)

    def freed(self, where: str | int) -> Ribbon:
        """Return this ribbon without the support of the node `where`."""
        return self._changed(self.rod.freed(where), where)

    def _changed(self, rod: Rod, where: str | int) -> Ribbon:
        node = rod._node(where)
        return self._with(
            rod=rod, clamped_rulings=tuple(p for p in self.clamped_rulings if p[0] != node)
        )

    def loaded(self, *args: Any, **kwargs: Any) -> Ribbon:
        """Return this ribbon under dead loads.

        Parameters
        ----------
        *args, **kwargs
            As of :meth:`lissome.rods.Rod.loaded`.
        """
        return self._with(rod=self.rod.loaded(*args, **kwargs))

    def with_law(self, law: RibbonLaw) -> Ribbon:
        """Return this ribbon with another `law`."""
        _check_law(law)
        self._check_width(law)
        _check_prescribed(law, self.clamped_rulings)
        return self._with(law=law)

    def with_width(self, width: float) -> Ribbon:
        """Return this ribbon with another `width` (length), of the same plate."""
        law = self.law.with_width(width)
        self._check_width(law)
        return self._with(law=law)

    def turned(self, angle: float) -> Ribbon:
        """Return this ribbon with its end clamp turned about its tangent from where it is now.

        Parameters
        ----------
        angle : float
            Radians.

        Raises
        ------
        InvalidInput
            If the angle is not finite, or the end of the ribbon is not clamped.
        """
        end = next((s for s in self.supports if s.node == self.lengths.size), None)
        if end is None or end.kind != "clamped":
            raise InvalidInput("the end of this ribbon is not clamped; clamp it, then turn it")
        frame = multiply(end.frame, exponential([0.0, 0.0, finite("angle", angle)]))
        rod = self.rod.clamped("end", end.position, frame / np.linalg.norm(frame), end.clamp)
        return self._with(rod=rod)

    def with_initial(self, state: RodState) -> Ribbon:
        """Return this ribbon with another starting `state`."""
        check_state("state", state, self.lengths.size, "ribbon")
        return self._with(initial=state)

    # ---- what it shares with its rod ---------------------------------------------------------------

    @property
    def lengths(self) -> Array:
        """Rest lengths of the segments, shape (N,)."""
        return self.rod.lengths

    @property
    def length(self) -> float:
        """Length of the center line."""
        return self.rod.length

    @property
    def arclength(self) -> Array:
        """Arc lengths of the nodes, shape (N + 1,)."""
        return self.rod.arclength

    @property
    def closed(self) -> bool:
        """Whether the last node is the first."""
        return self.rod.closed

    @property
    def supports(self) -> Any:
        """Supports, as of the rod."""
        return self.rod.supports

    @property
    def measure(self) -> str:
        """Strain measure of the hinges."""
        return self.rod.measure

    @property
    def stretching(self) -> None:
        """None: a ribbon is inextensible."""
        return None

    @property
    def _couples(self) -> list[tuple[int, Array, Array]]:
        """Segments, forces and arms of the couples."""
        return self.rod._couples

    def _node(self, where: str | int) -> int:
        return self.rod._node(where)

    def positions(self, state: RodState) -> Array:
        """Return the positions of the nodes in `state`, shape (N + 1, 3)."""
        return self.rod.positions(state)

    def _frames(self, state: RodState) -> Array:
        return self.rod._frames(state)

    def strains(self, state: RodState) -> Array:
        """Return the strain densities of the hinges in `state`, shape (n, 3)."""
        return self.rod.strains(state)

    @property
    def _joint_sign(self) -> float:
        """What rulings are multiplied by across the joint: -1 for an odd number of half turns."""
        return -1.0 if self.half_turns % 2 else 1.0

    @property
    def pins_phase(self) -> bool:
        """Whether the phase of a closed ribbon is pinned."""
        if not (self.phase and self.closed and self.rod.held and self.joint == "matched"):
            return False
        lengths, law = self.lengths, self.law
        if self.half_turns % 2:
            # The ruling that is held is in the axis of symmetry, which must be one of the mesh too.
            gaps = lengths[1:] - lengths[:0:-1]
            # The sides of the strip change at the joint: if they differ, it is not like other places.
            alike = not (law.natural_curvature or law.natural_cross_curvature)
        else:
            gaps, alike = lengths - lengths[0], True
        return alike and float(np.max(np.abs(gaps))) <= 1e-12 * self.length

    # ---- the derived layout ----------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """What the kernels need, derived once."""
        return derive(self)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        assert self.layout.skeleton.chain.unknowns is not None
        return int(self.layout.skeleton.chain.unknowns.size)

    @property
    def constraints_count(self) -> int:
        """Number of constraints: those of the rod, then two or three for each hinge."""
        assert self.layout.skeleton.chain.constraints is not None
        return int(self.layout.skeleton.chain.constraints.size)

    @property
    def has_moments(self) -> bool:
        """Whether bending moments are unknowns, and fold variables are not."""
        return self.law.has_fold and self.scheme == "moments"

    @property
    def has_folds(self) -> bool:
        """Whether fold variables are unknowns."""
        return self.law.has_fold and self.scheme != "moments"

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints."""
        names = ["kappa_2", "kappa_3", "fold"] if self.law.has_fold else ["kappa_2", "kappa_3"]
        if self.has_moments:
            names = ["kappa_1", "kappa_2", "kappa_3"]
            parts = range(self.layout.skeleton.fluxes.size)
            return (
                *self.rod.constraint_names,
                *(f"{name} at node {node}" for node in self.layout.nodes for name in names),
                *(f"slope of part {part}" for part in parts),
            )
        return (
            *self.rod.constraint_names,
            *(f"{name} at node {node}" for node in self.layout.nodes for name in names),
        )

    # ---- the manifold ----------------------------------------------------------------------------

    def start(self) -> RibbonState:
        """Return the initial state, bent so that it meets its supports.

        A band with half turns starts from the state that :func:`circle` reaches when its end is turned
        and joined, and the strip is widened; this takes several solves.
        """
        if self.initial is not self.rod.initial:
            return self.adopt(self.initial)
        if self.closed and self.half_turns:
            return turned_band(self)
        return self.adopt(self.rod.start())

    def adopt(self, state: RodState) -> RibbonState:
        """Return `state` with prescribed values imposed. The rulings of a rod's state are estimated.

        Raises
        ------
        InvalidInput
            If the state is of another mesh, scheme or kind of joint.
        """
        check_state("start", state, self.lengths.size, "ribbon")
        skeleton = self.layout.skeleton
        n = self.layout.nodes.size
        folds = n if self.has_folds else 0
        rod = self.rod.adopt(state)
        self._check_turns(rod)
        if not isinstance(state, RibbonState) or not state.rulings.size:
            return self._estimated(rod)
        if state.rulings.size != skeleton.rulings or state.folds.size != folds:
            raise InvalidInput(
                f"argument `start` has {state.rulings.size} rulings and {state.folds.size} folds; this "
                f"ribbon has {skeleton.rulings} and {folds}. To go from another law, scheme or kind of "
                "support, pass `start=ribbon.adapted(equilibrium)`"
            )
        rulings = state.rulings
        if skeleton.fixed.size and np.any(rulings[skeleton.fixed] != skeleton.values):
            rulings = np.array(rulings)
            rulings[skeleton.fixed] = skeleton.values
        return _state(rod, rulings, state.folds)

    def _check_turns(self, state: RodState) -> None:
        """Refuse a state whose frames close with a full turn more or less than this band's.

        The quaternions of a hinge and of its opposite describe the same strains, so that a band with
        one half turn to the left would pass for one to the right. The product of the signs of all hinges
        does not depend on the signs of the frames, and is that of a circle in every band that is made
        from one by turning its end.
        """
        if not self.closed:
            return
        plan = self.layout.plan
        frames = self.rod._frames(state)
        q = multiply(conjugate(frames[plan.left]), frames[plan.right])
        joint = np.array(plan.twist)
        joint[joint[:, 1] == 0.0, 0] = 1.0  # hinges without a turn
        scalar = q[:, 0] * joint[:, 0] - q[:, 3] * joint[:, 1]
        if np.count_nonzero(scalar < 0.0) % 2 == 0:
            raise InvalidInput(
                f"argument `start` is the state of a band with a full turn more or less than the "
                f"{self.half_turns} half turns of this one, or a hinge of it turns by more than half a "
                "turn; start from a band with as many half turns and the same handedness"
            )

    def _estimated(self, state: RodState) -> RibbonState:
        """Return the state with the rulings that its strains tell, as far as they do."""
        skeleton = self.layout.skeleton
        strain = self.rod.strains(state)
        bend, twist = strain[:, 0], strain[:, 2]
        size = float(np.sqrt(np.mean(bend**2))) or 1.0
        eta = bend * twist / (bend**2 + (0.1 * size) ** 2)
        total, weight = np.zeros(skeleton.rulings), np.zeros(skeleton.rulings)
        for k in range(3):
            at = skeleton.where[:, k]
            share = skeleton.mean[:, k]
            ok = (at >= 0) & (share != 0.0)
            np.add.at(total, at[ok], share[ok] * eta[ok])
            np.add.at(weight, at[ok], np.abs(share[ok]))
        rulings = total / np.where(weight > 0.0, weight, 1.0)
        if self.has_moments:
            rulings = self._on_parts(rulings[:: skeleton.parts])
        rulings[skeleton.fixed] = skeleton.values
        folds = np.zeros(0)
        if self.has_folds:
            _, slope = self._rulings_at_hinges(rulings)
            folds = np.arctanh(np.clip(0.5 * self.law.width * slope, -0.95, 0.95))
        return _state(state, rulings, folds)

    def adapted(self, source: Any) -> RibbonState:
        """Return the state of an equilibrium of another ribbon, as a start for this one.

        Parameters
        ----------
        source : RibbonEquilibrium
            Of a ribbon with another mesh, scheme, law, or with other supports or joint. Frames and
            rulings are interpolated.

        Raises
        ------
        InvalidInput
            If `source` is not the equilibrium of a ribbon that this one can be started from.
        """
        from ._equilibrium import RibbonEquilibrium

        if not isinstance(source, RibbonEquilibrium):
            raise InvalidInput(
                f"argument `source` is of type {type(source).__name__}; pass an equilibrium of a ribbon"
            )
        rod, eta, fold = carried_over(self, source)
        skeleton = self.layout.skeleton
        # Rulings whose means and differences are nearest to those wanted.
        rows = np.repeat(np.arange(eta.size), 3)
        keep = skeleton.where.reshape(-1) >= 0
        shape = (eta.size, skeleton.rulings)
        at = (rows[keep], skeleton.where.reshape(-1)[keep])
        mean = sparse.csr_matrix((skeleton.mean.reshape(-1)[keep], at), shape=shape)
        slope = sparse.csr_matrix((skeleton.slope.reshape(-1)[keep], at), shape=shape)
        span = self.layout.plan.span
        matrix = sparse.vstack([mean, sparse.diags_array(span) @ slope]).tocsr()
        steps = span * np.tanh(fold) * 2.0 / source.structure.law.width
        wanted = np.concatenate([eta, steps]) - matrix[:, skeleton.fixed] @ skeleton.values
        free = skeleton.free
        normal = (matrix[:, free].T @ matrix[:, free]).tocsc()
        rulings = np.zeros(skeleton.rulings)
        rulings[skeleton.fixed] = skeleton.values
        if free.size:
            normal = normal + 1e-12 * sparse.eye_array(free.size, format="csc")
            rulings[free] = spsolve(normal, matrix[:, free].T @ wanted)
        if self.has_moments:
            rulings = self._on_parts(eta)
            rulings[skeleton.fixed] = skeleton.values
        state = self.rod.adopt(rod)
        self._check_turns(state)
        if not self.has_folds:
            fold = np.zeros(0)
        elif self.scheme == "cells":  # they are not at the hinges
            _, slopes = self._rulings_at_hinges(rulings)
            fold = np.arctanh(np.clip(0.5 * self.law.width * slopes, -1.0 + 1e-9, 1.0 - 1e-9))
        return _state(state, rulings, fold)

    def _on_parts(self, rulings: Array) -> Array:
        """Return rulings at the ends of all parts of cells, interpolated between hinges."""
        at = np.arange(self.layout.skeleton.rulings) / self.layout.skeleton.parts
        return np.asarray(np.interp(at, np.arange(rulings.size), rulings))

    def _rulings_at_hinges(self, rulings: Array) -> tuple[Array, Array]:
        plan = self.layout.rulings
        n = plan.where.shape[0]
        eta, slope = np.empty(n), np.empty(n)
        _kernel.hinge_rulings(np.array(rulings), plan, eta, slope)
        return eta, slope

    def rulings(self, state: RibbonState) -> tuple[Array, Array]:
        """Return the ruling parameter in `state` and its derivative at the hinges, shapes (n,)."""
        eta, slope = self._rulings_at_hinges(state.rulings)
        if self.has_moments:
            skeleton = self.layout.skeleton
            slope = np.diff(state.rulings) / np.repeat(skeleton.ahead[:-1], skeleton.parts)
            slope *= skeleton.parts
            before = np.append(slope[:1], slope[skeleton.parts - 1 :: skeleton.parts])
            after = np.append(slope[:: skeleton.parts], slope[-1:])
            slope = 0.5 * (before + after)
        elif self.law.has_fold and self.scheme == "cells":  # of the two sides of a hinge
            skeleton = self.layout.skeleton
            slope = skeleton.share[:, 0] * slope + skeleton.share[:, 1] * slope[skeleton.before]
        return eta, slope

    def retract(self, state: RibbonState, dx: Array) -> RibbonState:
        """Return the state after the increment `dx`."""
        skeleton = self.layout.skeleton
        count = skeleton.rod_size
        dx = np.asarray(dx, dtype=float)
        rod = self.rod.retract(state, dx[:count])
        last = count + skeleton.free.size
        if skeleton.free.size < state.rulings.size:
            rulings = np.array(state.rulings)
            rulings[skeleton.free] += dx[count:last]
        else:
            rulings = state.rulings + dx[count:last]
        return _state(rod, rulings, state.folds + dx[last:])

    def difference(self, a: RibbonState, b: RibbonState) -> Array:
        """Return the increment that leads from `a` to `b`."""
        skeleton = self.layout.skeleton
        free = skeleton.free
        return np.concatenate(
            [
                self.rod.difference(a, b),
                b.rulings[free] - a.rulings[free],
                b.folds - a.folds,
            ]
        )

    def max_step(self, state: RibbonState, dx: Array) -> float:
        """Return the fraction of `dx` at which no hinge turns past pi and no fold changes by much."""
        step = self.rod.max_step(state, dx[: self.layout.skeleton.rod_size])
        if self.has_folds:
            largest = float(np.max(np.abs(dx[-state.folds.size :])))
            step = min(step, LONGEST / max(largest, LONGEST))
        return step

    def metric(self, state: RibbonState) -> Array:
        """Return lengths as masses: norms approximate integrals over the ribbon.

        Fold variables have a mass where they are unknowns. Eigenvalues, though not their signs, differ
        for that from those with moments as unknowns, and fall with the mesh where rulings all but meet.
        """
        return self.layout.skeleton.metric

    def typical(self, state: RibbonState) -> float | Array:
        """Return one (a radian, a ruling at 45 degrees), and more for folds where rulings meet.

        There the slope of the ruling tells a fold only to within its rounding errors, which grow like
        cosh(a)^2: far less can be asked of it.
        """
        if not state.folds.size or float(np.max(np.abs(state.folds))) < SATURATED:
            return 1.0
        sizes = np.ones(self.size)
        folds = np.minimum(np.abs(state.folds), LARGEST_FOLD)
        sizes[-folds.size :] = np.maximum(1.0, (np.cosh(folds) / math.cosh(SATURATED)) ** 2)
        return sizes

    def noise(self, state: RibbonState) -> float:
        """Return the round-off of differences of unit quaternions."""
        return 8 * EPS

    def gauge(self, state: RibbonState) -> Array:
        """Return the rigid motions that nothing opposes, shape (g, n)."""
        if self.rod.held or any(support.kind == "clamped" for support in self.supports):
            return np.zeros((0, self.size))  # a ribbon bends about one direction only
        rows = self.rod.gauge(state)
        if not rows.shape[0]:
            return np.zeros((0, self.size))
        return np.pad(rows, ((0, 0), (0, self.size - rows.shape[1])))

    # ---- energy ----------------------------------------------------------------------------------

    def _hinge_multipliers(self, multipliers: Array) -> Array:
        """Return the hinges' part of `multipliers`, shape (n, 3): of kappa_2, kappa_3 and the fold."""
        n = self.layout.nodes.size
        inner = np.asarray(multipliers, dtype=float)[self.layout.plan.rows.shape[0] :]
        if self.has_moments:
            parts = self.layout.skeleton.parts
            flux = np.append(inner[3 * n :].reshape(n - 1, parts).mean(axis=1), 0.0)
            return np.column_stack([inner[: 3 * n].reshape(n, 3)[:, 1:], flux])
        if self.law.has_fold:
            return np.ascontiguousarray(inner.reshape(n, 3))
        out = np.zeros((n, 3))
        out[:, :2] = inner.reshape(n, 2)
        return out

    def evaluate(self, state: RibbonState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`."""
        layout = self.layout
        skeleton, plan = layout.skeleton, layout.plan
        n, m = plan.left.size, plan.rows.shape[0]
        frames = self.rod._frames(state)
        q, kappa = np.empty((n, 4)), np.empty((n, 3))
        rod_kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, kappa)
        if self.has_moments:
            return self._evaluate_moments(state, multipliers, order, frames, q, kappa)
        inner = self._hinge_multipliers(multipliers)
        eta, slope = self._rulings_at_hinges(state.rulings)
        folds = np.array(state.folds) if self.law.has_fold else np.zeros(n)
        first, second = order >= 1, order >= 2
        values, rows = np.empty(n), np.empty((n, 3))
        stress = np.zeros((n if first else 0, 3))
        stiffness = np.zeros((n if second else 0, 3, 3))
        one, two = np.empty((n if first else 0, 4)), np.empty((n if second else 0, 10))
        _kernel.evaluate_hinges(
            kappa, plan.span, eta, slope, folds, skeleton.before, skeleton.share, layout.parameters,
            layout.ribbon_width, inner, values, rows, stress, stiffness, one, two, order,
        )  # fmt: skip
        total = skeleton.length + skeleton.border
        gradient = np.empty(total if first else 0)
        band = np.empty((skeleton.length if second else 0, skeleton.width + 1))
        border = np.empty((skeleton.length if second else 0, skeleton.border))
        corner = np.empty((skeleton.border, skeleton.border))
        outer = np.empty(m)
        energy = rod_kernel.assemble(
            frames, np.array(state.stretches), np.array(state.angles), q, values, stress,
            stiffness, plan, np.array(multipliers[:m], dtype=float), gradient, band, border, corner,
            outer, order,
        )  # fmt: skip
        if layout.rod.net_force is not None:
            energy -= float(layout.rod.net_force @ self.rod._fixed_position(state))
        constraints = np.concatenate(
            [outer, (rows if self.law.has_fold else rows[:, :2]).reshape(-1)]
        )
        if order == 0:
            return Evaluation(energy, constraints)
        _kernel.add_rulings(
            q, kappa, eta, plan, layout.rulings, layout.ribbon_width, inner, one, two, gradient, band,
            border, corner, order,
        )  # fmt: skip
        gradient = gradient[skeleton.chain.unknowns]
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        kkt = _RibbonKKT(band, border.T, corner, layout=skeleton.chain)
        bending = kappa[:, 0] / plan.span
        moment = layout.parameters[0] * max(math.sqrt(np.mean(bending**2)), 1.0 / self.length)
        kkt.least = np.zeros(constraints.size)
        kkt.least[m:].reshape(n, -1)[:, :2] = moment
        return Evaluation(energy, constraints, gradient, kkt)

    def _evaluate_moments(
        self,
        state: RibbonState,
        multipliers: Array,
        order: int,
        frames: Array,
        q: Array,
        kappa: Array,
    ) -> Evaluation:
        """Return the same for the scheme "moments", by the complementary energy.

        The moments are multipliers, and constraints depend on them: angles are the derivatives of the
        complementary energy. The KKT matrix has its second derivatives, negative, in the corner of the
        multipliers; its inertia is that of a minimum if the state is one.
        """
        layout = self.layout
        skeleton, plan = layout.skeleton, layout.plan
        n, m = plan.left.size, plan.rows.shape[0]
        moments = np.array(multipliers[m : m + 3 * n].reshape(n, 3))
        fluxes = np.array(multipliers[m + 3 * n :])
        first, second = order >= 1, order >= 2
        rows, slopes = kappa.copy(), np.empty(fluxes.size)
        stiffness = np.zeros((n if second else 0, 3, 3))
        total = skeleton.length + skeleton.border
        gradient = np.empty(total if first else 0)
        band = np.empty((skeleton.length if second else 0, skeleton.width + 1))
        border = np.empty((skeleton.length if second else 0, skeleton.border))
        corner = np.empty((skeleton.border, skeleton.border))
        outer = np.empty(m)
        energy = rod_kernel.assemble(
            frames, np.array(state.stretches), np.array(state.angles), q, np.zeros(n), moments,
            stiffness, plan, np.array(multipliers[:m], dtype=float), gradient, band, border, corner,
            outer, order,
        )  # fmt: skip
        if layout.rod.net_force is not None:
            energy -= float(layout.rod.net_force @ self.rod._fixed_position(state))
        if second:
            _kernel.add_moments(q, plan, skeleton.local, band, border)
        energy += _kernel.add_cells(
            skeleton.ahead, skeleton.base, skeleton.shape, skeleton.column, skeleton.local,
            skeleton.fluxes, np.array(state.rulings), moments, fluxes, float(layout.parameters[0]),
            layout.ribbon_width, POINTS, WEIGHTS, rows, slopes, gradient, band, order,
        )  # fmt: skip
        constraints = np.concatenate([outer, rows.reshape(-1), slopes])
        if order == 0:
            return Evaluation(energy, constraints)
        gradient = gradient[skeleton.chain.unknowns]
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        kkt = _RibbonKKT(band, border.T, corner, layout=skeleton.chain)
        size = kappa[:, 0] / plan.span
        moment = layout.parameters[0] * max(math.sqrt(np.mean(size**2)), 1.0 / self.length)
        kkt.least = np.zeros(constraints.size)
        kkt.least[m : m + 3 * n] = moment
        return Evaluation(energy, constraints, gradient, kkt)

    def correct(self, state: RibbonState, multipliers: Array, tolerance: float) -> Corrected | None:
        """Return a nearby stationary point, by Newton's method with a shift and a short line search.

        Parameters
        ----------
        state : RibbonState
            Where to start.
        multipliers : ndarray, shape (m,)
            A guess of the forces of constraint.
        tolerance : float
            Size of the next correction, relative to its typical size, at which to stop.

        Returns
        -------
        Corrected or None
            None if a few steps do not lead to one; :func:`lissome.equilibrate` then descends with care.
        """
        if self.has_moments and not np.any(multipliers):
            return (
                None  # without forces nothing tells where the rulings are: the matrix is singular
            )
        structure: Any = self
        found = fast_correction(structure, state, multipliers, tolerance)
        if found is None or found.iterations or found.factorization is None:
            return found
        # The state was right at once; multipliers of another width or stiffness need not be.
        here = found.evaluation
        assert here is not None
        assert here.gradient is not None
        _, dm = found.factorization.solve(-here.gradient, -here.constraints)
        return Corrected(found.state, found.multipliers + dm)

    def descended(
        self, state: RibbonState, multipliers: Array | None
    ) -> tuple[RibbonState, Array] | None:
        """Return a state near a stable equilibrium, and its multipliers, for the scheme "moments".

        With moments as unknowns every equilibrium is a saddle of the Lagrangian. The scheme "cells" has
        the same frames, and an energy to go down on; where it comes to rest there are all multipliers.

        Parameters
        ----------
        state : RibbonState
            Where to start.
        multipliers : ndarray, shape (m,), or None
            Near those of the state, if they are known.

        Returns
        -------
        tuple or None
            None if there is none, or with the other schemes.
        """
        if not self.has_moments:
            return None
        if multipliers is None:
            found = self._from_cells(state)
            if found is None:
                return None
            state, multipliers = found
        structure: Any = self
        return relaxed(structure, state, multipliers, RELAXATIONS)

    def _from_cells(self, state: RibbonState) -> tuple[RibbonState, Array] | None:
        """Return the stable state below with the scheme "cells", and what it is with moments."""
        other: Any = self._with(scheme="cells")
        skeleton = self.layout.skeleton
        rulings = np.array(state.rulings[:: skeleton.parts])
        _, slope = other._rulings_at_hinges(rulings)
        folds = np.arctanh(np.clip(0.5 * self.law.width * slope, -0.999, 0.999))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LissomeWarning)  # of a state that is not the result
            try:
                found: Any = equilibrate(other, _state(state, rulings, folds))
            except (NotConverged, Unstable, StabilityNotResolvable):
                return None
        n, m = self.layout.nodes.size, self.layout.plan.rows.shape[0]
        _, moments = found._law_values
        fluxes = found.multipliers[m:].reshape(n, 3)[:-1, 2] / skeleton.parts
        multipliers = [found.multipliers[:m], moments.ravel(), np.repeat(fluxes, skeleton.parts)]
        lower = _state(found.state, self._on_parts(found.state.rulings), np.zeros(0))
        return lower, np.concatenate(multipliers)

    def present(self, equilibrium: Equilibrium) -> Any:
        """Return `equilibrium` with strains, rulings, forces and the developed surface.

        Raises
        ------
        NotConverged
            If the bending of a closed band (Wunderlich) jumps between hinges: the state is spurious;
            or if it is held by the condition that pins the phase.
            The limit of Sadowsky does jump where the bending changes sign.

        Warns
        -----
        LissomeWarning
            If a hinge turns by more than 150 degrees, the bending of an open ribbon jumps between
            hinges, or a band has passed through itself. (Bands of less than one turn are looked at up
            to 600 segments, since the writhe costs their square.)
        """
        from ._equilibrium import ROUGH, RibbonEquilibrium

        found, kind = self.diagnose(equilibrium.state), "sharp hinge of a ribbon"
        result = equilibrium.as_type(RibbonEquilibrium)
        if self.pins_phase and not self.half_turns % 2 and self.law.natural_twist:
            self._check_pin(result)
        if self.closed and self.joint == "matched" and self.law.has_fold:
            result.check_smooth()
        elif (
            found is None
            and (self.law.has_fold or not self.closed)
            and np.max(result.bending_jumps, initial=0.0) > ROUGH
        ):
            kind = "jumps of a ribbon"
            found = (
                "the bending jumps between neighboring hinges: use more segments, or see "
                "`check_smooth`"
            )
        if (
            found is None
            and self.closed
            and (abs(self.half_turns) > 1 or self.lengths.size <= CHECKED)
        ):
            wanted = 0.5 * self.half_turns
            if abs(result.link - wanted) > 0.25:
                kind = "crossing of a ribbon"
                found = (
                    f"the band with {self.half_turns} half turns has passed through itself: its link is "
                    f"{result.link:.3g} instead of {wanted:g}; self-contact is not modeled"
                )
        if found and is_news(kind):
            warnings.warn(found, LissomeWarning, stacklevel=user_level())
        return result

    def _check_pin(self, found: Any) -> None:
        """Refuse a state that the pin of the phase holds by force.

        A band with an odd number of half turns has a place whose ruling goes straight across, and a
        pin there does nothing. One that wants to twist and closes up without it may have none.
        """
        free = replace(self, phase=False)
        state = free.adapted(found)
        evaluation = free.evaluate(state, np.zeros(free.constraints_count), 2)
        assert evaluation.kkt is not None and evaluation.gradient is not None  # of order 2
        rows, gradient = evaluation.kkt.jacobian_rows(), evaluation.gradient
        multipliers = np.linalg.lstsq(rows.T, -gradient, rcond=None)[0]
        force = float(np.max(np.abs(gradient + rows.T @ multipliers)))
        if force > 1e-6 * float(np.max(np.abs(gradient))):
            raise NotConverged(
                "the band is held by the condition that pins its phase: no ruling goes straight across "
                "the strip there; solve `dataclasses.replace(band, phase=False)`, starting from the "
                "attribute `state` of this error",
                state=state,
            )

    def diagnose(self, state: RibbonState) -> str | None:
        """Return what is wrong with `state`, that of a failed solve, and the remedy, or None."""
        found = self.rod.diagnose(state)
        if found:
            return found
        bending = np.abs(self.rod.strains(state)[:, 0])
        flat = bending <= 1e-9 * max(float(bending.max()), 1e-3 / self.length)
        if not self.law.has_fold and flat.any() and not flat.all():
            s = self.layout.arclength[np.argmax(flat)]
            return (
                f"the bending passes zero at a hinge, near s = {s:.4g}, and leaves its ruling "
                "undetermined: use the Wunderlich law, whose rulings hold together, or other segments"
            )
        runs = np.flatnonzero(flat[1:] & flat[:-1])
        if runs.size:
            s = self.layout.arclength[runs[0]]
            return (
                f"the ribbon is flat near s = {s:.4g}: rulings are undetermined where it does not bend; "
                "bend it (bring supports nearer, turn a clamp, load it) or give it a natural curvature"
            )
        if self.law.has_fold and np.max(np.abs(state.folds), initial=0.0) > LARGEST_FOLD:
            i = int(np.argmax(np.abs(state.folds)))
            return (
                f"rulings all but meet on an edge near s = {self.layout.arclength[i]:.4g} (fold variable "
                f"{state.folds[i]:.3g}): the strip is nearly flat there; use more segments, a narrower "
                "strip, or smaller steps"
            )
        return None


_FIELDS = tuple(item.name for item in fields(Ribbon))


def _check_law(law: Any) -> None:
    if not isinstance(law, RibbonLaw):
        raise InvalidInput(
            f"argument `law` is of type {type(law).__name__}; pass ribbons.Wunderlich or "
            "ribbons.Sadowsky (other laws of ribbons belong to lissome.rods)"
        )


def _check_prescribed(law: RibbonLaw, prescribed: tuple[tuple[int, Any], ...]) -> None:
    if prescribed and not law.has_fold:
        node, value = prescribed[0]
        raise InvalidInput(
            f"argument `ruling` is {value!r} at node {node}; the Sadowsky law has no condition on rulings "
            "at a clamp: use Wunderlich, or clamp without `ruling`"
        )
