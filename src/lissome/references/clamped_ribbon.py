r"""A ribbon between two clamps that are pushed together, shifted sideways and twisted.

Inextensible center line, energy per unit length (4.41), here with the width along :math:`d_1`, so that
:math:`\kappa_1` is the easy bending:

.. math:: W = \tfrac12\left[\kappa_1^2 + \frac{\kappa_3^4}{\xi^{-2} + \kappa_1^2}
   + A_2\kappa_2^2 + A_3\kappa_3^2\right];

without crossover length (:math:`\xi = 0`) it is Kirchhoff's rod. Lengths are in units of the length L
of the ribbon, energies in units of the easy bending stiffness over L. The first clamp stands at the
origin with the tangent along x and the width along y. The second one stands at
:math:`(1 - c, p, 0)`, turned by the angle :math:`\phi` about x: shortening c, shear p, twist
:math:`\phi`. The balance

.. math:: m' + \kappa\times m + e_3\times n = 0

in the ribbon's frame is solved by Gauss collocation on the whole length, without any symmetry. A
*pitchfork* is where the linearized equations at fixed clamps are singular although the branch does
not turn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0

from .._validate import finite, in_open_interval, integer_at_least, one_of, positive
from ..errors import InvalidInput, NotConverged
from ._collocation import Family, Point, gauss
from ._frames import directors, quaternion_rate

__all__ = [
    "Clamps",
    "Equilibrium",
    "Ribbon",
    "arch",
    "beyond",
    "helicoid_load",
    "moved",
    "pitchfork",
]

Array = npt.NDArray[np.float64]
Control = Literal["shortening", "shear", "twist"]
_CONTROLS = ("shortening", "shear", "twist")


@dataclass(frozen=True)
class Ribbon:
    r"""Stiffnesses of a ribbon, in units of that of easy bending, and its crossover length.

    Parameters
    ----------
    hard_bending : float
        :math:`A_2`.
    twisting : float
        :math:`A_3`.
    crossover : float
        :math:`\xi/L`; zero for Kirchhoff's rod.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.clamped_ribbon import Ribbon
    >>> ribbon = Ribbon.of(width=0.1, thickness=0.01, poisson_ratio=0.5)
    >>> round(ribbon.hard_bending), round(ribbon.twisting, 4), round(ribbon.crossover, 4)
    (100, 1.3333, 0.1118)
    """

    hard_bending: float
    twisting: float
    crossover: float = 0.0

    def __post_init__(self) -> None:
        positive("hard_bending", self.hard_bending)
        positive("twisting", self.twisting)
        if finite("crossover", self.crossover) < 0.0:
            raise InvalidInput(f"argument `crossover` is {self.crossover:g}; it must be at least 0")

    @classmethod
    def of(
        cls, width: float, thickness: float, poisson_ratio: float, *, stretches: bool = True
    ) -> Ribbon:
        r"""Ribbon of a rectangular section, with :math:`\xi^2 = (1-\nu^2)w^4/60h^2`.

        Parameters
        ----------
        width, thickness : float
            Over the length L.
        poisson_ratio : float
            In (-1, 0.5].
        stretches : bool
            If False, Kirchhoff's rod of the same stiffnesses.

        Raises
        ------
        InvalidInput
            If an argument is out of its range.
        """
        w, h = positive("width", width), positive("thickness", thickness)
        nu = finite("poisson_ratio", poisson_ratio)
        if not -1.0 < nu <= 0.5:
            raise InvalidInput(f"argument `poisson_ratio` is {nu:g}; it must lie in (-1, 0.5]")
        xi = float(np.sqrt((1.0 - nu**2) / 60.0) * w**2 / h)
        return cls((w / h) ** 2, 2.0 / (1.0 + nu), xi if stretches else 0.0)

    def density(self, k1: npt.NDArray, k2: npt.NDArray, k3: npt.NDArray) -> npt.NDArray:
        """Energy per length for strains `k1`, `k2`, `k3` in units of 1/L (arrays of one shape)."""
        total = k1**2 + self.hard_bending * k2**2 + self.twisting * k3**2
        if self.crossover:
            total = total + k3**4 / (self.crossover**-2 + k1**2)
        return np.asarray(0.5 * total)

    def moments(self, k1: npt.NDArray, k3: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray]:
        """Moments m1 and m3 in units of A1/L, of the shape of the strains `k1`, `k3` (1/L)."""
        if not self.crossover:
            return k1, self.twisting * k3
        base = self.crossover**-2 + k1**2
        return k1 - k3**4 * k1 / base**2, self.twisting * k3 + 2.0 * k3**3 / base

    def moduli(
        self, k1: npt.NDArray, k3: npt.NDArray
    ) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
        """Second derivatives W11, W13, W33 in units of A1, of the shape of the strains `k1`, `k3` (1/L)."""
        if not self.crossover:
            return 1.0 + 0.0 * k1, 0.0 * k1, self.twisting + 0.0 * k1
        c = self.crossover**-2
        base = c + k1**2
        return (
            1.0 - k3**4 * (c - 3.0 * k1**2) / base**3,
            -4.0 * k3**3 * k1 / base**2,
            self.twisting + 6.0 * k3**2 / base,
        )


@dataclass(frozen=True)
class Clamps:
    """Where the second clamp is: shortening and shear in units of L, twist in radians.

    Parameters
    ----------
    shortening : float
        Length minus distance of the clamps along the axis, over L.
    shear : float
        Distance across the axis, over L.
    twist : float
        Angle about the axis, in radians.

    Examples
    --------
    >>> from lissome.references.clamped_ribbon import Ribbon, arch
    >>> from lissome.references.elastica import buckled_strip
    >>> state = arch(Ribbon(100.0, 4 / 3), 0.25, elements=12)
    >>> state.clamps, round(state.energy / buckled_strip(0.75).energy, 6)
    (Clamps(shortening=0.25, shear=0.0, twist=0.0), 1.0)
    """

    shortening: float
    shear: float = 0.0
    twist: float = 0.0


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium between clamps.

    Attributes
    ----------
    ribbon : Ribbon
        The ribbon.
    clamps : Clamps
        Its clamps.
    solution : Point
        Center line, quaternion (scalar first), m2, k1 and k3 along the ribbon, and the force in space.

    Examples
    --------
    The planar arch is Euler's elastica, whatever the ribbon:

    >>> from lissome.references.clamped_ribbon import Ribbon, arch
    >>> from lissome.references.elastica import buckled_strip
    >>> state, plane = arch(Ribbon(100.0, 4 / 3), 0.25, elements=12), buckled_strip(0.75)
    >>> print(f"{-state.force[0] / plane.thrust:.6f} {-state.middle[2] / plane.height:.6f}")
    1.000000 1.000000
    """

    ribbon: Ribbon
    clamps: Clamps
    solution: Point

    def _at(self, control: Control, value: float, point: Point) -> Self:
        return replace(self, clamps=replace(self.clamps, **{control: value}), solution=point)

    def _family(self, control: Control, mesh: Array, stages: int) -> Family:
        return _family(self.ribbon, self.clamps, control, mesh, stages)

    @property
    def force(self) -> Array:
        """Force of the part beyond a section on the part before it, in space, shape (3,), in A1/L^2."""
        return np.array(self.solution.parameters[:3])

    @property
    def middle(self) -> Array:
        """Middle of the center line, shape (3,), over L."""
        return np.array(self.solution.at(0.5)[:3])

    @property
    def energy(self) -> float:
        """Energy, units of the easy bending stiffness over L."""
        _, weight, _ = gauss(self.solution.slopes.shape[1])
        values = self.solution.stage_values
        k2 = values[..., 7] / self.ribbon.hard_bending
        density = self.ribbon.density(values[..., 8], k2, values[..., 9])
        return float(np.einsum("e,j,ej->", np.diff(self.solution.mesh), weight, density))

    @property
    def margin(self) -> float:
        """Least determinant of the Hessian of W by (k1, k3): the law is elliptic while positive."""
        values = self.solution.at(np.linspace(0.0, 1.0, 40 * len(self.solution.mesh)))
        bend, mixed, twist = self.ribbon.moduli(values[:, 8], values[:, 9])
        return float((bend * twist - mixed**2).min())

    def strains(self, position: npt.ArrayLike) -> Array:
        """Strains k1, k2, k3 at arc lengths `position` in [0, 1], shape (..., 3), units of 1/L."""
        values = self.solution.at(position)
        hard = values[..., 7] / self.ribbon.hard_bending
        return np.stack([values[..., 8], hard, values[..., 9]], axis=-1)


State = TypeVar("State", bound=Equilibrium)


def arch(ribbon: Ribbon, shortening: float, *, elements: int = 24, stages: int = 4) -> Equilibrium:
    """Return the planar arch between clamps that are only pushed together, bulging to negative z.

    Parameters
    ----------
    ribbon : Ribbon
        The ribbon.
    shortening : float
        By which part of its length; in (0, 1).
    elements, stages : int
        Collocation elements, and points in each.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If Newton's method fails.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.clamped_ribbon import Ribbon, arch
    >>> ribbon = Ribbon(100.0, 4 / 3)
    >>> state = arch(ribbon, 1e-4)
    >>> print(f"{-state.force[0] / (4 * np.pi**2):.4f}")  # Euler's load
    1.0000
    """
    c = in_open_interval("shortening", shortening, 0.0, 1.0, "clamps nearer than the strip is long")
    integer_at_least("elements", elements, 4)
    integer_at_least("stages", stages, 2)
    mesh = np.linspace(0.0, 1.0, elements + 1)
    family = _family(ribbon, Clamps(c), "shear", mesh, stages)
    # the angle of the tangent is about a sine, whose mean cosine is J0 of its amplitude
    amplitude = float(brentq(lambda a: j0(a) - 1.0 + c, 0.0, 2.4048))
    angle = amplitude * np.sin(2.0 * np.pi * mesh)
    step = np.diff(mesh)
    x = np.concatenate([[0.0], np.cumsum(0.5 * step * (np.cos(angle[1:]) + np.cos(angle[:-1])))])
    z = np.concatenate([[0.0], np.cumsum(-0.5 * step * (np.sin(angle[1:]) + np.sin(angle[:-1])))])
    zero = np.zeros_like(mesh)
    half = 0.5 * angle
    # the turn about y after the turn that takes e1, e2, e3 to y, z, x
    q = 0.5 * np.array(
        [
            np.cos(half) - np.sin(half),
            np.cos(half) + np.sin(half),
            np.cos(half) + np.sin(half),
            np.cos(half) - np.sin(half),
        ]
    )
    k1 = 2.0 * np.pi * amplitude * np.cos(2.0 * np.pi * mesh)
    values = np.stack([x, zero, z, *q, zero, k1, zero], axis=1)
    load = -4.0 * np.pi**2 * (1.0 + 0.5 * c)
    guess = family.start(values, np.array([load, 0.0, 0.0, 0.0]))
    return Equilibrium(ribbon, Clamps(c), family.fixed(guess, 0.0))


def moved(state: State, control: Control, value: float, *, step: float = 0.05) -> State:
    """Move one clamp in steps, at equilibrium all the way.

    Parameters
    ----------
    state : Equilibrium
        Where to begin: of :func:`arch`, or of
        :func:`lissome.references.clamped_strip.sheared_arch`.
    control : {'shortening', 'shear', 'twist'}
        What moves.
    value : float
        Where to.
    step : float
        Longest step.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the equilibria turn back before `value`, or meet a singular law.

    Examples
    --------
    >>> from lissome.references.clamped_ribbon import Ribbon, arch, moved
    >>> start = arch(Ribbon(100.0, 4 / 3), 0.25)
    >>> state = moved(start, "shear", 0.1)
    >>> bool(state.energy > start.energy)
    True
    """
    target, longest = finite("value", value), positive("step", step)
    one_of("control", control, _CONTROLS)
    family = _like(state, control)
    here = getattr(state.clamps, control)
    point = _controlled(state, control)
    length = longest
    while here != target:
        ahead = here + float(np.clip(target - here, -length, length))
        try:
            tangent = family.tangent(point)
            guess = _along(family, point, tangent / tangent[-1] * (ahead - here))
            found = family.fixed(guess, ahead)
            if state._at(control, ahead, found).margin <= 0.0:
                raise NotConverged("the law is not elliptic")
        except (NotConverged, np.linalg.LinAlgError) as error:
            length *= 0.5
            if length < 1e-3 * longest:
                raise NotConverged(
                    f"no equilibrium leads from the {control} {here:.6g} on to {target:g}: the branch "
                    "turns there, or the law loses its ellipticity",
                    state=state._at(control, here, point),
                ) from error
            continue
        point, here, length = found, ahead, min(1.5 * length, longest)
    return state._at(control, here, point)


def pitchfork(
    state: State, control: Control, until: float, *, step: float = 0.02
) -> tuple[State, Array]:
    """Follow a branch to the first place where its linearized equations are singular.

    Parameters
    ----------
    state : Equilibrium
        Where to begin.
    control : {'shortening', 'shear', 'twist'}
        What moves.
    until : float
        Where to give up.
    step : float
        Between the states that are looked at.

    Returns
    -------
    critical : Equilibrium
        The state there.
    mode : ndarray, shape (elements + 1, 10)
        The solution of the linearized equations, at the nodes: nodal values of the state.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If there is none, or the branch cannot be followed.

    Examples
    --------
    >>> from lissome.references.clamped_ribbon import Ribbon, arch, pitchfork
    >>> start = arch(Ribbon(100.0, 4 / 3), 0.25, elements=16)
    >>> critical, mode = pitchfork(start, "shear", 0.4, step=0.05)
    >>> print(f"{critical.clamps.shear:.3f}")
    0.267
    """
    one_of("control", control, _CONTROLS)
    here, target = getattr(state.clamps, control), finite("until", until)
    count = max(int(np.ceil(abs(target - here) / positive("step", step))), 1)
    old, before = _orientation(state, control), state
    for value in np.linspace(here, target, count + 1)[1:]:
        after = moved(before, control, float(value))
        new = _orientation(after, control)
        if old != new:
            return _interpolated(before, after, control)
        old, before = new, after
    raise NotConverged(f"no singular state between the {control} {here:g} and {target:g}")


def _interpolated(before: State, after: State, control: Control) -> tuple[State, Array]:
    """Root of the test function's polynomial: at the root itself Newton's matrix is singular."""
    low, high = (getattr(state.clamps, control) for state in (before, after))
    border = _border(before, control)
    old, new = (_test(state, control, border)[0] for state in (before, after))
    guess = low + (high - low) * float(np.clip(old / (old - new), 0.1, 0.9))
    side = np.sign(high - low)
    for spread in (0.1 * (high - low) * side, 3e-3, 2e-3):
        places = guess + side * spread * np.array([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5])
        states = list[State]()
        for place in places:
            states.append(moved(states[-1] if states else before, control, float(place)))
        border = _border(states[2], control)
        tests = [_test(found, control, border) for found in states]
        values = np.array([value for value, _ in tests])
        scaled = (places - guess) / spread
        roots = np.roots(np.polyfit(scaled, values, 5))
        real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
        root = float(real[np.abs(real).argmin()])
        guess = guess + spread * root
        before = states[0]
    powers = np.linalg.solve(np.vander(scaled, 6).T, np.vander([root], 6)[0])

    def between(arrays: list[Array]) -> Array:
        return np.asarray(np.tensordot(powers, np.array(arrays), axes=1))

    points = [found.solution for found in states]
    middle = Point(
        points[0].mesh,
        between([point.nodes for point in points]),
        between([point.slopes for point in points]),
        between([point.parameters for point in points]),
    )
    return before._at(control, float(guess), middle), between([mode for _, mode in tests])


def beyond(critical: State, mode: Array, control: Control, amplitude: float) -> State:
    """Return a state of the branch that crosses at a pitchfork.

    Parameters
    ----------
    critical, mode
        What :func:`pitchfork` returned.
    control : {'shortening', 'shear', 'twist'}
        What may move, to be found.
    amplitude : float
        Distance from the critical state: root mean square of the nodal values' change.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If Newton's method fails; try another amplitude.

    Examples
    --------
    The two halves of the branch are mirror images: they need the same shear.

    >>> from lissome.references.clamped_ribbon import Ribbon, arch, beyond, pitchfork
    >>> start = arch(Ribbon(100.0, 4 / 3), 0.25, elements=8, stages=3)
    >>> critical, mode = pitchfork(start, "shear", 0.3, step=0.1)
    >>> left, right = (beyond(critical, mode, "shear", size) for size in (0.05, -0.05))
    >>> print(f"{left.clamps.shear - right.clamps.shear:.6f} {left.energy - right.energy:.6f}")
    0.000000 0.000000
    """
    family, point = _like(critical, control), _controlled(critical, control)
    direction = np.concatenate([mode.ravel(), np.zeros(len(point.parameters))])
    weight = family._weight(point)
    direction /= np.sqrt(np.sum(weight * direction**2))
    found = family.step(point, direction, finite("amplitude", amplitude))
    return critical._at(control, float(found.parameters[-1]), found)


def helicoid_load(
    bend: float, hard_bending: float, couple: float, twist: float, *, tension: float = 60.0
) -> float:
    r"""Return the tension at which a straight ribbon, twisted between clamps, buckles as it is let go.

    One clamp may slide along the axis. The strains :math:`(0, 0, \phi)` are uniform, so that the
    linearized equations have constant coefficients in the ribbon's frame. With small rotations t,
    moments m, tension T and lateral force f,

    .. math::
        t_1' = m_1/B_1 + \phi t_2,\quad t_2' = m_2/B_2 - \phi t_1,\quad
        m_1' = (\phi - M/B_2) m_2 + T t_1 + f_2,\quad m_2' = (M/B_1 - \phi) m_1 + T t_2 - f_1 .

    Displacement and rotation at the far clamp are a block of the matrix exponential times moment and
    lateral force at the first one; its determinant vanishes at the load.

    Parameters
    ----------
    bend : float
        Stiffness :math:`\partial^2W/\partial k_1^2` of the twisted, straight ribbon.
    hard_bending : float
        That of bending in its plane.
    couple : float
        Couple M = :math:`\partial W/\partial k_3` there.
    twist : float
        The angle :math:`\phi` of the far clamp.
    tension : float
        Where to begin to look, downwards; larger than the load.

    Returns
    -------
    float
        The largest load below `tension`; negative for a thrust.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If there is none above -400.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.clamped_ribbon import helicoid_load
    >>> round(helicoid_load(1.0, 1e9, 0.0, 0.0) / (4 * np.pi**2), 6)  # Euler's load
    -1.0
    """
    easy, hard = positive("bend", bend), positive("hard_bending", hard_bending)
    m3, phi = finite("couple", couple), finite("twist", twist)

    def determinant(load: float) -> float:
        # u1, u2, t1, t2, m1, m2, f1, f2: displacement, rotation, moment, lateral force
        a = np.zeros((8, 8))
        a[0, 1], a[0, 3] = phi, 1.0
        a[1, 0], a[1, 2] = -phi, -1.0
        a[2, 3], a[2, 4] = phi, 1.0 / easy
        a[3, 2], a[3, 5] = -phi, 1.0 / hard
        # m1' = k3 m2 - k2 m3 + n2, m2' = k1 m3 - k3 m1 - n1; n = load d3, seen from the turned frame
        a[4, 5], a[4, 2], a[4, 7] = phi - m3 / hard, load, 1.0
        a[5, 4], a[5, 3], a[5, 6] = m3 / easy - phi, load, -1.0
        a[6, 7], a[7, 6] = phi, -phi
        return float(np.linalg.det(expm(a)[:4, 4:]))

    loads = np.arange(finite("tension", tension), -400.0, -0.5)
    values = [determinant(loads[0])]
    for i in range(1, len(loads)):
        values.append(determinant(loads[i]))
        if values[-1] * values[-2] <= 0.0:
            return float(brentq(determinant, loads[i], loads[i - 1], xtol=1e-12, rtol=1e-13))
        if i > 1 and abs(values[-2]) < min(abs(values[-3]), abs(values[-1])):
            # two loads close together, or a double one, between neighbors of one sign
            side = np.sign(values[-1])
            least = minimize_scalar(
                lambda load, side=side: side * determinant(load),
                bounds=(loads[i], loads[i - 2]),
                method="bounded",
                options={"xatol": 1e-10},
            )
            if least.fun < 0.0:
                return float(brentq(determinant, least.x, loads[i - 2], xtol=1e-12, rtol=1e-13))
            if least.fun < 1e-9 * abs(values[-1]):
                return float(least.x)
    raise NotConverged(f"no load between {tension:g} and -400 makes the helicoid buckle")


def _along(family: Family, point: Point, change: Array) -> Point:
    _, _, sensitivity = family._linearize(point)
    return family._moved(point, change, sensitivity, homogeneous=True)


def _like(state: Equilibrium, control: Control) -> Family:
    mesh, stages = state.solution.mesh, state.solution.slopes.shape[1]
    return state._family(control, mesh, stages)


def _controlled(state: Equilibrium, control: Control) -> Point:
    """Return the solution with the control as its last parameter."""
    parameters = np.array([*state.solution.parameters[:-1], getattr(state.clamps, control)])
    return replace(state.solution, parameters=parameters)


def _square(state: Equilibrium, control: Control) -> Array:
    """Matrix of the linearized equations between clamps that do not move."""
    matrix, _, _ = _like(state, control)._linearize(_controlled(state, control))
    return np.asarray(matrix[:, :-1])


def _orientation(state: Equilibrium, control: Control) -> float:
    """Sign of the determinant: it changes where an odd number of eigenvalues passes zero."""
    return float(np.linalg.slogdet(_square(state, control))[0])


def _border(state: Equilibrium, control: Control) -> tuple[Array, Array]:
    left, _, right = np.linalg.svd(_square(state, control))
    return np.asarray(left[:, -1], dtype=float), np.asarray(right[-1], dtype=float)


def _test(state: Equilibrium, control: Control, border: tuple[Array, Array]) -> tuple[float, Array]:
    """Return a number that is zero where the equations are singular, and the null vector there.

    The matrix is bordered with fixed vectors: the last unknown of the bordered system is the ratio of
    both determinants.
    """
    square = _square(state, control)
    size = len(square)
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = square
    whole[:size, size], whole[size, :size] = border
    right = np.zeros(size + 1)
    right[size] = 1.0
    found = np.linalg.solve(whole, right)
    nodes = found[: state.solution.nodes.size].reshape(state.solution.nodes.shape)
    return float(found[-1]), np.asarray(nodes, dtype=float)


def _family(ribbon: Ribbon, clamps: Clamps, control: Control, mesh: Array, stages: int) -> Family:
    hard = ribbon.hard_bending

    def right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        q = y[3:7]
        m2, k1, k3 = y[7:10]
        k2 = m2 / hard
        d1, d2, d3 = directors(q)
        n1 = p[0] * d1[0] + p[1] * d1[1] + p[2] * d1[2]
        n2 = p[0] * d2[0] + p[1] * d2[1] + p[2] * d2[2]
        m1, m3 = ribbon.moments(k1, k3)
        rate1 = k3 * m2 - k2 * m3 + n2
        rate2 = k1 * m3 - k3 * m1 - n1
        rate3 = k2 * m1 - k1 * m2
        bend, mixed, twist = ribbon.moduli(k1, k3)
        determinant = bend * twist - mixed**2
        return np.array(
            [
                *d3,
                *quaternion_rate(q, k1, k2, k3),
                rate2,
                (twist * rate1 - mixed * rate3) / determinant,
                (bend * rate3 - mixed * rate1) / determinant,
            ]
        )

    def ends(y0: npt.NDArray, y1: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        at = {name: getattr(clamps, name) for name in _CONTROLS} | {control: p[3]}
        cos, sin = np.cos(at["twist"] / 2), np.sin(at["twist"] / 2)
        # the turn about x after that which takes e1, e2, e3 to y, z, x
        q = [(cos - sin) / 2, (cos + sin) / 2, (cos - sin) / 2, (cos + sin) / 2]
        a, b, c, d = y1[3:7]
        turned = [
            q[0] * b - q[1] * a - q[2] * d + q[3] * c,
            q[0] * c - q[2] * a - q[3] * b + q[1] * d,
            q[0] * d - q[3] * a - q[1] * c + q[2] * b,
        ]
        start = [*y0[:3], *(y0[3:7] - 0.5)]
        reached = [y1[0] - 1.0 + at["shortening"], y1[1] - at["shear"], y1[2]]
        return np.array([*start, *reached, *turned])

    return Family(right, ends, mesh, stages)
