r"""A ribbon bent into half a circle whose clamps turn: the continuum model of Sano and Wada.

The ribbon is inextensible along its center line, of energy per unit length (4.41)

.. math:: W = \tfrac12\left[A_1\kappa_1^2 + A_2\left(\kappa_2^2
   + \frac{\kappa_3^4}{\xi^{-2} + \kappa_2^2}\right) + A_3\kappa_3^2\right]

with the width along :math:`d_2`. Lengths are in units of the radius R of the half circle, energies of
:math:`A_2/R`. The clamps stand at :math:`\mp e_x`, their tangents are :math:`\pm e_z`, the width is
along :math:`e_y` at first. Then

``"mirror"``
    the clamps turn by :math:`+\phi` and :math:`-\phi` about :math:`e_z`: mirror images of each other,
    so that the halves of the ribbon are twisted in opposite senses and the net twist is zero;
``"rotation"``
    both turn by :math:`+\phi` about :math:`e_z`, which is :math:`+\phi` and :math:`-\phi` about the
    ribbon's own tangent: the net twist is :math:`2\phi`, and half a turn about :math:`e_z` maps the
    ribbon onto itself.

Equilibria of that symmetry are solved for on one half, by Gauss collocation of

.. math:: m' + \kappa\times m + e_3\times n = 0,\qquad
   \begin{pmatrix} m_2' \\ m_3'\end{pmatrix} = \frac{\partial^2 W}{\partial(\kappa_2,\kappa_3)^2}
   \begin{pmatrix} \kappa_2' \\ \kappa_3'\end{pmatrix}

in the ribbon's own frame, for the center line, a quaternion, :math:`m_1`, :math:`\kappa_2`,
:math:`\kappa_3` and the constant force. Where the Hessian of W ceases to be positive definite the
equations are singular: branches end there. Strains that jump, of less energy, exist before that;
:func:`trace_jump` follows them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh, qr

from .._validate import finite, in_open_interval, integer_at_least, one_of, positive
from ..errors import InvalidInput, NotConverged
from ._collocation import Family, Point, gauss
from ._frames import directors, quaternion_rate

__all__ = [
    "Branch",
    "Equilibrium",
    "Fold",
    "Ribbon",
    "critical_twist",
    "equilibrium",
    "stability",
    "threshold_width",
    "trace",
    "trace_jump",
]

Array = npt.NDArray[np.float64]
Reading = Literal["mirror", "rotation"]
Form = Literal["thesis", "audoly-neukirch", "panda-jawed"]
_HALF = np.pi / 2.0
_JUMPS = 0.49  # extensibility length over R above which k3 at the clamp exceeds 1/xi at pi/2
_DEFECT = 1e-4  # of the collocation polynomial between its points; the nodes are far better


@dataclass(frozen=True)
class Ribbon:
    r"""A thin rectangular ribbon in the model of Sano and Wada.

    Parameters
    ----------
    width, thickness, radius : float
        w, h and the radius R of the half circle, all in the same unit.
    poisson_ratio : float
        In (-1, 0.5].
    form : {'thesis', 'audoly-neukirch', 'panda-jawed'}
        Which of the three published squares of the extensibility length :math:`\xi`:
        :math:`(1-\nu^2)w^4/60h^2`, :math:`w^4/60h^2` or :math:`w^4/120h^2`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.ribbon_twist import Ribbon
    >>> ribbon = Ribbon(width=8.0, thickness=0.2, radius=108.0, poisson_ratio=0.3)
    >>> round(ribbon.relative_width, 4), round(ribbon.hard_bending), round(ribbon.extensibility, 4)
    (0.9712, 1600, 0.3649)
    """

    width: float
    thickness: float = 0.2
    radius: float = 108.0
    poisson_ratio: float = 0.3
    form: Form = "thesis"

    def __post_init__(self) -> None:
        for name in ("width", "thickness", "radius"):
            positive(name, getattr(self, name))
        nu = finite("poisson_ratio", self.poisson_ratio)
        if not -1.0 < nu <= 0.5:
            raise InvalidInput(f"argument `poisson_ratio` is {nu:g}; it must lie in (-1, 0.5]")
        one_of("form", self.form, ("thesis", "audoly-neukirch", "panda-jawed"))

    @property
    def relative_width(self) -> float:
        r"""Width over :math:`\sqrt{Lh}` with the length :math:`L = \pi R`."""
        return float(self.width / np.sqrt(np.pi * self.radius * self.thickness))

    @property
    def hard_bending(self) -> float:
        r""":math:`A_1/A_2 = w^2/h^2`."""
        return (self.width / self.thickness) ** 2

    @property
    def twisting(self) -> float:
        r""":math:`A_3/A_2 = 2/(1+\nu)`."""
        return 2.0 / (1.0 + self.poisson_ratio)

    @property
    def extensibility(self) -> float:
        r"""Extensibility length :math:`\xi/R`."""
        factor = {
            "thesis": (1.0 - self.poisson_ratio**2) / 60.0,
            "audoly-neukirch": 1.0 / 60.0,
            "panda-jawed": 1.0 / 120.0,
        }[self.form]
        return float(np.sqrt(factor) * self.width**2 / self.thickness / self.radius)

    def energy_density(self, k1: npt.ArrayLike, k2: npt.ArrayLike, k3: npt.ArrayLike) -> Array:
        """W in units of A2/R^2, for strains `k1`, `k2`, `k3` in units of 1/R (arrays of one shape)."""
        one, two, three = (np.asarray(k) for k in (k1, k2, k3))
        soft = two**2 + three**4 / (self.extensibility**-2 + two**2)
        return np.asarray(0.5 * (self.hard_bending * one**2 + soft + self.twisting * three**2))

    def moments(self, k2: npt.NDArray, k3: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray]:
        """Moments m2 and m3 in units of A2/R, of the shape of the strains `k2`, `k3` (1/R)."""
        base = self.extensibility**-2 + k2**2
        return k2 - k3**4 * k2 / base**2, self.twisting * k3 + 2.0 * k3**3 / base

    def tangent_moduli(
        self, k2: npt.NDArray, k3: npt.NDArray
    ) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
        """Second derivatives W22, W23, W33 in units of A2, of the shape of the strains `k2`, `k3` (1/R)."""
        c = self.extensibility**-2
        base = c + k2**2
        return (
            1.0 - k3**4 * (c - 3.0 * k2**2) / base**3,
            -4.0 * k3**3 * k2 / base**2,
            self.twisting + 6.0 * k3**2 / base,
        )

    def ellipticity(self, k2: npt.NDArray, k3: npt.NDArray) -> npt.NDArray:
        """Determinant W22 W33 - W23^2, of the shape of the strains `k2`, `k3` (1/R).

        The Hessian is positive definite where it is positive, since W33 always is.
        """
        bend, mixed, twist = self.tangent_moduli(k2, k3)
        return bend * twist - mixed**2


@dataclass(frozen=True, eq=False)
class Equilibrium:
    r"""An equilibrium of one of the two symmetries, stored as its first half.

    Attributes
    ----------
    ribbon : Ribbon
        The ribbon.
    reading : {'mirror', 'rotation'}
        In which senses the clamps turn.
    twist : float
        The angle phi of the clamps, rad.
    solution : Point
        Center line, quaternion, m1, k2, k3 from the clamp (s = 0) to the middle (s = pi/2), and
        the force components along x and y.
    jump : float or None
        Arc length from the clamp at which k2 jumps.

    Examples
    --------
    With hardly any twist it is the half circle: energy :math:`\pi/2`, middle one radius away.

    >>> import numpy as np
    >>> from lissome.references.ribbon_twist import Ribbon, equilibrium
    >>> state = equilibrium(Ribbon(8.0, poisson_ratio=0.4), 1e-6, elements=4, stages=3)
    >>> print(f"{state.energy / np.pi:.6f} {state.midpoint[2]:.6f} {state.strains(0.5)[1]:.6f}")
    0.500000 1.000000 1.000000
    """

    ribbon: Ribbon
    reading: Reading
    twist: float
    solution: Point
    jump: float | None = None

    @property
    def midpoint(self) -> Array:
        """Middle of the ribbon, shape (3,), units of R: along x, out of plane, in plane."""
        return np.array(self.solution.nodes[-1, :3])

    @property
    def tilt(self) -> float:
        """Angle by which the width at the middle has turned about x, in (-pi, pi]; rad."""
        _, second, _ = directors(self.solution.nodes[-1, 3:7])
        return float(np.arctan2(second[2], second[1]))

    @property
    def force(self) -> Array:
        """Force along x, y and z that the far half exerts on the first, shape (3,), units of A2/R^2."""
        return np.array([*self.solution.parameters[:2], 0.0])

    @property
    def clamp_strains(self) -> Array:
        """Strains k1, k2, k3 at the clamp, shape (3,), units of 1/R."""
        return self.strains(0.0)

    @cached_property
    def margin(self) -> float:
        """Least determinant of the Hessian of W by (k2, k3) over all points of the solution."""
        states = np.concatenate([self.solution.nodes, self.solution.stage_values.reshape(-1, 10)])
        return float(self.ribbon.ellipticity(states[:, 8], states[:, 9]).min())

    @cached_property
    def convexity(self) -> float:
        r"""Least :math:`\xi^{-2} + \kappa_2^2 - \kappa_3^2` over all points of the solution.

        Where it is negative the energy density lies above its convex envelope: the equilibrium
        may be a local minimum, but strains that jump have less energy.
        """
        states = np.concatenate([self.solution.nodes, self.solution.stage_values.reshape(-1, 10)])
        gap = self.ribbon.extensibility**-2 + states[:, 8] ** 2 - states[:, 9] ** 2
        return float(gap.min())

    @cached_property
    def weakest(self) -> float:
        """Arc length, from the clamp, of the least determinant."""
        points = np.concatenate([self.solution.mesh, self.solution.stage_positions.ravel()])
        states = np.concatenate([self.solution.nodes, self.solution.stage_values.reshape(-1, 10)])
        return float(points[self.ribbon.ellipticity(states[:, 8], states[:, 9]).argmin()])

    @property
    def energy(self) -> float:
        """Energy of the whole ribbon, units of A2/R."""
        _, weight, _ = gauss(self.solution.slopes.shape[1])
        values = self.solution.stage_values
        density = self.ribbon.energy_density(
            values[..., 7] / self.ribbon.hard_bending, values[..., 8], values[..., 9]
        )
        return float(2.0 * np.einsum("e,j,ej->", np.diff(self.solution.mesh), weight, density))

    def positions(self, position: npt.ArrayLike) -> Array:
        """Points at arc lengths `position` of the first half, in [0, pi/2], shape (..., 3), units of R."""
        return self.solution.at(position)[..., :3]

    def strains(self, position: npt.ArrayLike) -> Array:
        """Strains k1, k2, k3 at arc lengths `position` in [0, pi/2], shape (..., 3), units of 1/R."""
        values = self.solution.at(position)
        return np.stack(
            [values[..., 7] / self.ribbon.hard_bending, values[..., 8], values[..., 9]], axis=-1
        )


@dataclass(frozen=True, eq=False)
class Fold:
    """A turning point of a branch.

    Attributes
    ----------
    state : Equilibrium
        The equilibrium there.
    index : int
        It lies between the states `index` and `index + 1` of the branch.

    Examples
    --------
    Where the twist turns back, a ribbon whose clamps are turned further snaps:

    >>> from lissome.references.ribbon_twist import Ribbon, trace
    >>> branch = trace(Ribbon(8.0, poisson_ratio=0.4), stop_at_fold=True)
    >>> (fold,) = branch.folds
    >>> print(f"{fold.twist:.4f}", bool(fold.twist > branch.twist.max()))
    2.0119 True
    """

    state: Equilibrium
    index: int

    @property
    def twist(self) -> float:
        """Critical angle of the clamps, rad."""
        return self.state.twist


@dataclass(frozen=True, eq=False)
class Branch:
    """A curve of equilibria.

    Attributes
    ----------
    states : tuple of Equilibrium
        In the order of arc length along the curve.
    folds : tuple of Fold
        Turning points of the twist.
    end : {'range', 'ellipticity', 'count'}
        Why it ends: the twist left the range asked for, the Hessian of the energy density was
        about to lose its definiteness, or there were as many states as asked for.

    Examples
    --------
    The branch begins with the half circle, whose middle lies one radius from the line of the clamps:

    >>> from lissome.references.ribbon_twist import Ribbon, trace
    >>> branch = trace(Ribbon(8.0, poisson_ratio=0.4), until=0.1, elements=8)
    >>> print(branch.twist[0], branch.deflection[0], branch.end, branch.folds)
    0.0 [0. 1.] range ()
    """

    states: tuple[Equilibrium, ...]
    folds: tuple[Fold, ...]
    end: Literal["range", "ellipticity", "count"]

    @property
    def twist(self) -> Array:
        """Angles of the clamps, rad, shape (k,)."""
        return np.array([state.twist for state in self.states])

    @property
    def deflection(self) -> Array:
        """Middle of the ribbon: out of plane and in plane, units of R; shape (k, 2)."""
        return np.array([state.midpoint[1:] for state in self.states])

    @property
    def margin(self) -> Array:
        """Least determinant of the Hessian, per state, shape (k,)."""
        return np.array([state.margin for state in self.states])


def equilibrium(
    ribbon: Ribbon,
    twist: float,
    *,
    reading: Reading = "mirror",
    elements: int = 24,
    stages: int = 5,
    layer: float = 0.03,
) -> Equilibrium:
    """Return the equilibrium at `twist` on the branch of the half circle, before its first fold.

    Parameters
    ----------
    ribbon : Ribbon
        The ribbon.
    twist : float
        Angle of the clamps, rad, positive.
    reading, elements, stages, layer
        As for :func:`trace`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the branch folds or ends before `twist`.

    Examples
    --------
    >>> from lissome.references.ribbon_twist import Ribbon, equilibrium
    >>> state = equilibrium(Ribbon(8.0, poisson_ratio=0.4), 0.5)
    >>> [round(float(x), 4) for x in state.midpoint[1:]]
    [0.1768, 0.9782]
    """
    target = positive("twist", twist, "rad")
    branch = trace(
        ribbon,
        reading=reading,
        until=target,
        elements=elements,
        stages=stages,
        layer=layer,
        stop_at_fold=True,
    )
    if branch.end != "range":
        raise NotConverged(
            f"the branch of the half circle ends at the twist {branch.twist.max():.6f} rad "
            f"({'a fold' if branch.folds else branch.end}) before the twist asked for, {target:g}"
        )
    last = branch.states[-1].solution
    family = _family(ribbon, reading, elements, stages, layer)
    family = Family(family.right, family.ends, last.mesh, stages)
    point = family.fixed(last, target)
    return Equilibrium(ribbon, reading, target, point)


def trace(
    ribbon: Ribbon,
    *,
    reading: Reading = "mirror",
    until: float = 3.3,
    step: float = 0.1,
    count: int = 400,
    elements: int = 24,
    stages: int = 5,
    layer: float = 0.03,
    stop_at_fold: bool = False,
) -> Branch:
    r"""Follow the equilibria of one symmetry from the half circle, through folds.

    Parameters
    ----------
    ribbon : Ribbon
        The ribbon.
    reading : {'mirror', 'rotation'}
        In which senses the clamps turn.
    until : float
        The branch ends where the twist exceeds this or falls below -0.1; rad.
    step : float
        Largest step of pseudo-arclength (mean square of all unknowns).
    count : int
        Largest number of states.
    elements, stages : int
        Collocation elements on the half ribbon, and points in each.
    layer : float
        Elements are graded as a hyperbolic sine towards the clamp: their length there is about
        `layer` times asinh(1/layer) times pi/2 over `elements`.
    stop_at_fold : bool
        End at the first fold (`end` is then 'count').

    Returns
    -------
    Branch

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If no step, however small, leads on although the Hessian is far from singular.

    Examples
    --------
    A twist to both sides of the half circle: the middle moves out of the plane by it.

    >>> from lissome.references.ribbon_twist import Ribbon, trace
    >>> branch = trace(Ribbon(8.0, poisson_ratio=0.4), until=0.1, elements=8)
    >>> bool(branch.twist[-1] > 0.1), bool(branch.deflection[-1, 0] > 0), branch.end
    (True, True, 'range')
    """
    top, longest = positive("until", until, "rad"), positive("step", step)
    integer_at_least("count", count, 2)
    family = _family(ribbon, reading, elements, stages, layer)
    s = family.mesh
    zero = np.zeros_like(s)
    # d3 = (sin s, 0, cos s): turned by s about y, with the width along y
    circle = [-np.cos(s), zero, np.sin(s), np.cos(s / 2), zero, np.sin(s / 2), zero, zero, zero + 1]
    guess = family.start(np.stack([*circle, zero], axis=1), np.zeros(3))
    point = family.fixed(guess, 0.0)

    def wrap(point: Point) -> Equilibrium:
        return Equilibrium(ribbon, reading, float(point.parameters[-1]), point)

    return _follow(family, point, family.tangent(point), wrap, top, longest, count, stop_at_fold)


def trace_jump(
    ribbon: Ribbon,
    *,
    until: float = 3.3,
    step: float = 0.1,
    count: int = 400,
    elements: int = 20,
    stages: int = 5,
    stop_at_fold: bool = False,
) -> Branch:
    r"""Follow the equilibria whose bending strain jumps at one place near each clamp.

    With :math:`D = \xi^{-2} + \kappa_2^2` the soft part of W is
    :math:`\tfrac12(D + \kappa_3^4/D - \xi^{-2}) \ge \kappa_3^2 - \tfrac12\xi^{-2}`, and equality holds at
    :math:`D = \kappa_3^2`. The convex envelope of W follows: where :math:`\kappa_3^2 > D` it is
    independent of :math:`\kappa_2`, and :math:`\kappa_2` may jump between
    :math:`\pm\sqrt{\kappa_3^2 - \xi^{-2}}` where :math:`m_2 = 0`. These are the strains of least
    energy; a smooth branch on which :math:`\kappa_3^2 > D` somewhere is only a local minimum.

    In the mirror-symmetric reading :math:`m_x = 0` all along, so that :math:`m_2` vanishes at the
    clamp at :math:`\phi = \pi/2` whatever the width: the jump starts there if
    :math:`\kappa_3^2 > \xi^{-2}`. (In narrower ribbons it starts at an interior point later on, or
    never.)

    Parameters
    ----------
    ribbon : Ribbon
        The ribbon.
    until, step, count, elements, stages, stop_at_fold
        As for :func:`trace`, elements on either side of the jump. Steps are those of the rescaled
        halves.

    Returns
    -------
    Branch
        From the start of the jump at the clamps; mirror-symmetric.

    Raises
    ------
    InvalidInput
        If the ribbon is too narrow for that.

    Examples
    --------
    >>> from lissome.references.ribbon_twist import Ribbon, trace_jump
    >>> branch = trace_jump(Ribbon(10.0, poisson_ratio=0.4), elements=4, stages=4, count=3)
    >>> [round(float(twist), 3) for twist in branch.twist[:2]]  # from pi/2 on
    [1.571, 1.576]
    """
    top, longest = positive("until", until, "rad"), positive("step", step)
    integer_at_least("count", count, 2)
    if ribbon.extensibility < _JUMPS:
        raise InvalidInput(
            f"argument `ribbon` has the extensibility length {ribbon.extensibility:.4f} R; jumps "
            f"start at a clamp if it exceeds {_JUMPS:g} R, in wider ribbons"
        )
    smooth = equilibrium(ribbon, _HALF, elements=elements, stages=stages).solution
    family = _jump_family(ribbon, elements, stages)
    outer = smooth.at(_HALF * family.mesh)
    inner = np.tile(outer[0], (len(outer), 1))
    inner[:, 8] *= -1.0
    constants = np.array([*smooth.parameters[:2], 0.0, _HALF])
    guess = family.start(np.hstack([inner, outer]), constants)
    point = family.fixed(guess, 0.0, which=2)
    tangent = family.tangent(point, which=2)

    def wrap(point: Point) -> Equilibrium:
        return _joined(ribbon, point)

    return _follow(family, point, tangent, wrap, top, longest, count, stop_at_fold)


def critical_twist(ribbon: Ribbon, *, elements: int = 24, stages: int = 5) -> Equilibrium:
    """Return the fold at which a ribbon whose strains have the least energy snaps, mirror-symmetric.

    The branch of the half circle leads there directly, or on a detour: where the energy density
    loses its convexity the strains jump (:func:`trace_jump`) and may be smooth again at the fold,
    which is then reached from a narrower ribbon at the same twist.

    Parameters
    ----------
    ribbon : Ribbon
        The ribbon.
    elements, stages : int
        Mesh, as for :func:`trace`.

    Returns
    -------
    Equilibrium

    Raises
    ------
    NotConverged
        If neither way leads to a fold.

    Examples
    --------
    >>> from lissome.references.ribbon_twist import Ribbon, critical_twist
    >>> round(critical_twist(Ribbon(8.0, poisson_ratio=0.4), elements=8).twist, 2)
    2.01
    """
    if ribbon.extensibility > _JUMPS:
        branch = trace_jump(ribbon, elements=elements, stages=stages, stop_at_fold=True)
    else:
        narrow = min(0.36, ribbon.extensibility) / ribbon.extensibility
        start = replace(ribbon, width=ribbon.width * np.sqrt(narrow))
        near = equilibrium(start, 1.99, elements=elements, stages=stages)
        family, point = _widened(start, ribbon, near.solution, stages)

        def wrap(point: Point) -> Equilibrium:
            return Equilibrium(ribbon, "mirror", float(point.parameters[-1]), point)

        branch = _follow(family, point, family.tangent(point), wrap, 3.3, 0.05, 100, True)
    if not branch.folds:
        raise NotConverged(
            f"the branch ends at the twist {branch.twist[-1]:.4f} without a fold ({branch.end})"
        )
    return branch.folds[0].state


def threshold_width(
    ribbon: Ribbon, *, tolerance: float = 1e-3, elements: int = 20, stages: int = 5
) -> tuple[float, float]:
    r"""Bracket the width from which on the smooth branch of the half circle does not snap.

    Narrower, the branch ends on its way to a twist of 2.4 rad, at a fold or where the Hessian of the
    energy density becomes singular at the clamp and the strains have to jump. Wider, the Hessian
    stays positive definite. Mirror-symmetric.

    Parameters
    ----------
    ribbon : Ribbon
        Gives thickness, radius, Poisson ratio and form; its width does not matter.
    tolerance : float
        Relative width of the bracket.
    elements, stages : int
        Mesh, as for :func:`trace`.

    Returns
    -------
    (low, high) : tuple of float
        Widths over :math:`\sqrt{Lh}`; the branch ends at `low` and goes on at `high`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the iteration finds no solution.

    Examples
    --------
    A coarse bracket, on a coarse mesh:

    >>> from lissome.references.ribbon_twist import Ribbon, threshold_width
    >>> ribbon = Ribbon(8.0, poisson_ratio=0.4)
    >>> low, high = threshold_width(ribbon, tolerance=0.2, elements=8, stages=3)
    >>> print(f"{low:.2f} {high:.2f}")
    1.10 1.27
    """
    goal = positive("tolerance", tolerance)
    # The extensibility length decides, so that all forms share one first bracket.
    unit = ribbon.width / np.sqrt(ribbon.extensibility)
    low, high = unit * np.sqrt(0.45), unit * np.sqrt(0.60)

    def survives(width: float) -> bool:
        wide = replace(ribbon, width=float(width))
        found = trace(
            wide, until=2.4, step=0.12, elements=elements, stages=stages, stop_at_fold=True
        )
        return found.end == "range"

    if survives(low) or not survives(high):
        raise NotConverged(
            f"the threshold lies outside the widths {low:g} to {high:g} of the first bracket"
        )
    while high - low > goal * low:
        middle = (low + high) / 2.0
        low, high = (low, middle) if survives(middle) else (middle, high)
    scale = ribbon.relative_width / ribbon.width
    return float(low * scale), float(high * scale)


def _follow(
    family: Family,
    point: Point,
    tangent: Array,
    wrap: Callable[[Point], Equilibrium],
    top: float,
    longest: float,
    count: int,
    stop_at_fold: bool,
) -> Branch:
    """Pseudo-arclength continuation with refinement of the mesh."""
    states, folds = [wrap(point)], list[Fold]()
    limit = 4 * len(family.mesh)
    length = longest / 2.0
    while len(states) < count:
        try:
            ahead = family.step(point, tangent, length)
            turned = family.tangent(ahead, tangent)
            if family.turn(tangent, turned, point) < 0.95:
                raise NotConverged("the curve turns too much")
            state = wrap(ahead)
            rough = family.defect(ahead) > _DEFECT
            if rough.any():
                if len(rough) + rough.sum() > limit:
                    raise NotConverged("the strains vary too fast for the mesh")
                # finer where the present state is, in case that the next one is out of reach
                old = family.mesh
                family, point = family.refined(point, rough)
                tangent = family.tangent(
                    point, _carried(tangent, point.nodes.shape[1], old, family)
                )
                continue
            if state.margin <= 0.0:
                raise NotConverged("the Hessian of the energy density is not positive definite")
        except (NotConverged, np.linalg.LinAlgError) as error:
            length /= 2.0
            if length > 1e-3 * longest:
                continue
            weakest = states[-1].margin
            if weakest < 0.5 * states[-1].ribbon.twisting:  # at the middle it is `twisting`
                return Branch(tuple(states), tuple(folds), "ellipticity")
            raise NotConverged(
                f"no step leads on from the twist {states[-1].twist:.6f} rad, where the least "
                f"determinant of the Hessian is {weakest:.3g}; refine with `elements` or `layer`",
                state=states[-1],
            ) from error
        if tangent[-1] * turned[-1] < 0.0:
            there, _ = family.fold(point, tangent, length)
            folds.append(Fold(wrap(there), len(states) - 1))
            if stop_at_fold:
                return Branch(tuple(states), tuple(folds), "count")
        point, tangent = ahead, turned
        states.append(state)
        length = min(1.3 * length, longest)
        if not -0.1 <= state.twist <= top:
            return Branch(tuple(states), tuple(folds), "range")
    return Branch(tuple(states), tuple(folds), "count")


def stability(state: Equilibrium, *, degree: int = 4) -> tuple[float, float]:
    r"""Lowest eigenvalues of the second variation, per unit length of squared rotation.

    Rotations :math:`\theta` of the cross-sections, in the ribbon's frame, with
    :math:`\delta\kappa = \theta' + \kappa\times\theta`, leave the length unchanged;

    .. math:: \delta^2 E = \int \delta\kappa\cdot W''\delta\kappa
       + m\cdot[\theta\times(\theta\times\kappa) - \theta\times\theta']
       - n\cdot[\theta\times(\theta\times e_3)]\,ds

    is discretized by polynomials on the elements of the solution, under the constraint that the
    ends stay where they are.

    Parameters
    ----------
    state : Equilibrium
        The equilibrium.
    degree : int
        Degree of the polynomials.

    Returns
    -------
    (symmetric, antisymmetric) : tuple of float
        Over variations that keep the symmetry of `state` and over those that break it; units of
        :math:`A_2/R^2`. The equilibrium is stable where both are positive.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.ribbon_twist import Ribbon, equilibrium, stability
    >>> state = equilibrium(Ribbon(8.0, poisson_ratio=0.4), 0.5)
    >>> min(stability(state)) > 0
    True
    """
    integer_at_least("degree", degree, 2)
    if state.jump is not None:
        raise InvalidInput(
            f"argument `state` has strains that jump at {state.jump:g}; the second variation here is "
            "that of smooth strains"
        )
    lowest = []
    stiffness, mass, rows = _second_variation(state, degree)
    middle = 3 * (len(stiffness) // 3 - 1)
    mirror = state.reading == "mirror"
    # At the middle: which of the three components of the rotation vanish, and which components of
    # the middle's displacement do; see the symmetries of the module's docstring.
    cases = (
        ((0, 1), (0,)) if mirror else ((1, 2), (0, 1)),
        ((2,), (1, 2)) if mirror else ((0,), (2,)),
    )
    for held, fixed in cases:
        gone = {0, 1, 2} | {middle + j for j in held}
        keep = np.array([i for i in range(len(stiffness)) if i not in gone])
        basis, _ = qr(rows[list(fixed)][:, keep].T)
        null = basis[:, len(fixed) :]
        k = null.T @ stiffness[np.ix_(keep, keep)] @ null
        m = null.T @ mass[np.ix_(keep, keep)] @ null
        lowest.append(float(eigh(k, m, subset_by_index=(0, 0), eigvals_only=True)[0]))
    return lowest[0], lowest[1]


def _family(ribbon: Ribbon, reading: Reading, elements: int, stages: int, layer: float) -> Family:
    one_of("reading", reading, ("mirror", "rotation"))
    integer_at_least("elements", elements, 4)
    integer_at_least("stages", stages, 2)
    thin = in_open_interval("layer", layer, 0.0, 1.0, "the part of the half ribbon to refine")
    fraction = np.linspace(0.0, 1.0, elements + 1)
    mesh = _HALF * thin * np.sinh(fraction * np.arcsinh(1.0 / thin))
    mesh[-1] = _HALF

    def right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        q = y[3:7]
        k1, k2, k3 = y[7] / ribbon.hard_bending, y[8], y[9]
        first, second, third = directors(q)
        m1, (m2, m3) = y[7], ribbon.moments(k2, k3)
        n1 = p[0] * first[0] + p[1] * first[1]
        n2 = p[0] * second[0] + p[1] * second[1]
        rate1 = k3 * m2 - k2 * m3 + n2
        rate2 = k1 * m3 - k3 * m1 - n1
        rate3 = k2 * m1 - k1 * m2
        bend, mixed, twist = ribbon.tangent_moduli(k2, k3)
        determinant = bend * twist - mixed**2
        return np.array(
            [
                *third,
                *quaternion_rate(q, k1, k2, k3),
                rate1,
                (twist * rate2 - mixed * rate3) / determinant,
                (bend * rate3 - mixed * rate2) / determinant,
            ]
        )

    def ends(y0: npt.NDArray, y1: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        _, second, third = directors(y1[3:7])
        turned = [y0[3] - np.cos(p[2] / 2), y0[4], y0[5], y0[6] - np.sin(p[2] / 2)]
        clamp = [y0[0] + 1.0, y0[1], y0[2], *turned]
        if reading == "mirror":  # d3 along x, no moment along x, the force along x
            middle = [y1[0], third[1], third[2], y1[9], p[1]]
        else:  # on the axis z, d1 along it, no moment along it
            middle = [y1[0], y1[1], second[2], third[2], y1[7]]
        return np.array([*clamp, *middle])

    return Family(right, ends, mesh, stages)


def _jump_family(ribbon: Ribbon, elements: int, stages: int) -> Family:
    """Both sides of the jump on [0, 1]; constants: force along x and y, place of the jump, twist."""
    single = _family(ribbon, "mirror", 4, stages, 0.5)
    thin, fraction = 0.1, np.linspace(0.0, 1.0, elements + 1)
    mesh = thin * np.sinh(fraction * np.arcsinh(1.0 / thin))
    mesh[-1] = 1.0

    def right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        constants = p[[0, 1, 3]]
        inner, outer = single.right(y[:10], constants), single.right(y[10:], constants)
        return np.concatenate([p[2] * inner, (_HALF - p[2]) * outer])

    def ends(y0: npt.NDArray, y1: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        before, after = y1[:10], y0[10:]
        joint = [
            *(after[:8] - before[:8]),
            after[8] + before[8],
            after[9] - before[9],
            ribbon.extensibility**-2 + after[8] ** 2 - after[9] ** 2,
        ]
        return np.concatenate([single.ends(y0[:10], y1[10:], p[[0, 1, 3]]), joint])

    return Family(right, ends, mesh, stages)


def _widened(start: Ribbon, ribbon: Ribbon, point: Point, stages: int) -> tuple[Family, Point]:
    """Lead smooth strains from a narrow ribbon to a wider one at the same twist."""
    width, factor = start.width, 1.02
    twist = float(point.parameters[-1])

    def family(width: float, mesh: Array) -> Family:
        single = _family(replace(ribbon, width=width), "mirror", 4, stages, 0.5)
        return Family(single.right, single.ends, mesh, stages)

    here = family(width, point.mesh)
    while width < ribbon.width:
        ahead = min(width * factor, ribbon.width)
        there = family(ahead, point.mesh)
        try:
            moved = there.fixed(point, twist)
            state = Equilibrium(replace(ribbon, width=ahead), "mirror", twist, moved)
            rough = there.defect(moved) > _DEFECT
            if rough.any() and len(point.mesh) < 200:
                here, point = here.refined(point, rough)
                continue
            if rough.any() or state.margin <= 0.0:
                raise NotConverged("the strains are not smooth")
        except NotConverged as error:
            factor = np.sqrt(factor)
            if factor < 1.0001:
                raise NotConverged(
                    f"a ribbon wider than {width:.4f} has no smooth strains of least energy at a "
                    f"twist of {twist:g} rad (asked for: {ribbon.width:g})"
                ) from error
            continue
        here, point, width = there, moved, ahead
    return here, point


def _joined(ribbon: Ribbon, point: Point) -> Equilibrium:
    """Both sides as one solution over the arc length; elements of no length are left out."""
    place, twist = float(point.parameters[2]), float(point.parameters[3])
    outer = _HALF - place
    mesh = [place + outer * point.mesh]
    nodes = [point.nodes[:, 10:]]
    slopes = [point.slopes[..., 10:] / outer]
    if place > 1e-12:
        # values to the right of each element's start: the inner side's last node is superseded
        mesh.insert(0, place * point.mesh[:-1])
        nodes.insert(0, point.nodes[:-1, :10])
        slopes.insert(0, point.slopes[..., :10] / place)
    constants = np.array([*point.parameters[:2], twist])
    joined = Point(np.concatenate(mesh), np.concatenate(nodes), np.concatenate(slopes), constants)
    return Equilibrium(ribbon, "mirror", twist, joined, place)


def _carried(tangent: Array, n: int, old: Array, family: Family) -> Array:
    """A tangent on another mesh, good enough to tell its sense."""
    nodes = tangent[: n * len(old)].reshape(len(old), n)
    moved = [np.interp(family.mesh, old, column) for column in nodes.T]
    return np.concatenate([np.stack(moved, axis=1).ravel(), tangent[n * len(old) :]])


def _second_variation(state: Equilibrium, degree: int) -> tuple[Array, Array, Array]:
    """Stiffness, mass and the rows of the middle's displacement, shapes (3 k, 3 k) and (3, 3 k)."""
    ribbon, mesh = state.ribbon, state.solution.mesh
    points = degree + 3
    _, weights, place = gauss(points)
    # Lagrange polynomials on Chebyshev-Lobatto points of [0, 1]
    knots = (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2.0
    coefficient = np.linalg.inv(np.vander(knots, increasing=True))
    shape = np.vander(place, degree + 1, increasing=True) @ coefficient
    powers = np.arange(1, degree + 1)
    slope = (place[:, None] ** (powers - 1) * powers) @ coefficient[1:]
    size = 3 * (degree * (len(mesh) - 1) + 1)
    stiffness, mass, rows = np.zeros((size, size)), np.zeros((size, size)), np.zeros((3, size))
    third = np.array([0.0, 0.0, 1.0])
    for e, step in enumerate(np.diff(mesh)):
        values = state.solution.at(mesh[e] + step * place)
        local = slice(3 * degree * e, 3 * degree * (e + 1) + 3)
        for g, y in enumerate(values):
            k = np.array([y[7] / ribbon.hard_bending, y[8], y[9]])
            m = np.array([y[7], *ribbon.moments(y[8], y[9])])
            frame = np.array(directors(y[3:7]))  # rows are directors
            n = frame @ state.force
            bend, mixed, twist = ribbon.tangent_moduli(y[8], y[9])
            moduli = np.array([[ribbon.hard_bending, 0, 0], [0, bend, mixed], [0, mixed, twist]])
            theta = np.kron(shape[g], np.eye(3))
            strain = np.kron(slope[g] / step, np.eye(3)) + _cross(k) @ theta
            # a . [t x (t x b)] = (t.a)(t.b) - (a.b) |t|^2, symmetric in a and b
            initial = _double(m, k) - _double(n, third)
            rate = np.kron(slope[g] / step, np.eye(3))
            # -m . (t x t') = t . (m x t')
            gyric = theta.T @ _cross(m) @ rate
            weight = step * weights[g]
            stiffness[local, local] += weight * (
                strain.T @ moduli @ strain + theta.T @ initial @ theta + 0.5 * (gyric + gyric.T)
            )
            mass[local, local] += weight * theta.T @ theta
            rows[:, local] += weight * frame.T @ -_cross(third) @ theta
    return stiffness, mass, rows


def _cross(a: Array) -> Array:
    """Matrix of the vector product with a."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _double(a: Array, b: Array) -> Array:
    """Matrix of the quadratic form a . [t x (t x b)] in t."""
    return np.asarray(0.5 * (np.outer(a, b) + np.outer(b, a)) - (a @ b) * np.eye(3))
