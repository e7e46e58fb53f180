r"""The elastic Moebius band, by collocation of its Euler-Lagrange equations.

An inextensible strip of width w and thickness h whose center line has the length L = 1 bends along
straight rulings. With the bending strain :math:`\kappa_1` about the width direction :math:`d_1`, the
twisting strain :math:`\kappa_3 = \eta\kappa_1` about the tangent :math:`d_3` and
:math:`\kappa_2 = 0`, its energy is Wunderlich's,

.. math:: E = \frac{Dw}{2}\int\kappa_1^2(1+\eta^2)^2\,g(w\eta')\,ds,\qquad
   g(v) = \frac1v\ln\frac{1+v/2}{1-v/2},\qquad D = \frac{Yh^3}{12(1-\nu^2)} .

**Equations.** Adding :math:`\int m_2\kappa_2 + m_3(\kappa_3 - \eta\kappa_1)` to
:math:`U = E/Dw`, the variation of the strains gives the moment, that of :math:`\eta` the rest:

.. math:: P := m_1 + \eta m_3 = \kappa_1(1+\eta^2)^2 g,\qquad
   p := \frac{\partial U}{\partial\eta'} = \frac w2\kappa_1^2(1+\eta^2)^2g'(w\eta'),\qquad
   p' = 2\kappa_1^2\eta(1+\eta^2)g - m_3\kappa_1 ,

with a constant force F and the moment :math:`m = C - x\times F` about the origin. The variable a
with :math:`w\eta' = 2\tanh a` makes :math:`g = a\coth a`, and P and p determine it through an odd,
increasing function:

.. math:: h(a) = \frac{g'}{g^2} = \frac{\sinh 2a - 2a}{4a^2} = \frac{2(1+\eta^2)^2p}{wP^2} .

**Half a band.** A half turn R about an axis maps the band to itself. The axis meets it in the
inflection s = 0, along :math:`d_1`, and at the middle s = 1/2, along :math:`d_2`. About s = 0,
:math:`\kappa_1` and :math:`\eta` are odd; about s = 1/2 both are even. Force and moment are normal
to the axis. With the axis as the first of the coordinates, :math:`x(0) = 0` and :math:`d_3(0)` as
the third, nine unknowns and four constants meet the thirteen conditions

.. math:: \eta(0) = 0,\quad x(0) = 0,\quad d(0) = 1,\qquad
   p = x_2 = x_3 = d_{2,2} = d_{2,3} = 0\ \text{at}\ s = \tfrac12 .

**The inflection.** There P vanishes by symmetry and p does not: a is infinite, the ruling turns as
fast as the width allows, :math:`w\eta' = 2`, and :math:`\kappa_1\sim s/\ln(1/s)` is not analytic. In
a variable t with :math:`ds/dt \sim s` everything is, so that s = 1e-9 instead of zero costs
1e-16. The same variable resolves the sharp folds of wide bands (large negative a).

**No width.** As w vanishes, p does, and the equations become algebraic in the strains: with
:math:`\eta = \tan\gamma`,

.. math:: (m_1, m_3) = |m|(\cos 2\gamma, \sin 2\gamma),\qquad |m| = \sqrt{m_1^2+m_3^2}
   = \kappa_1(1+\eta^2)^2 .

This is Sadowsky's band. At the inflection :math:`m_1 = 0`, so that :math:`\eta = \pm 1`, and
:math:`\kappa_1` jumps. In the other limit,
:math:`w = 1/\sqrt3`, the band is a flat triangle; it is followed to within a hundredth of that.

Starostin and van der Heijden (Nature Materials 6, 563, 2007) treat the same problem with half the
width and :math:`L = 2\pi`: their width is :math:`\pi w`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from .._validate import finite, finite_array, integer_at_least, positive
from ..errors import InvalidInput, NotConverged
from ._collocation import Family, Point, gauss

__all__ = ["WIDEST", "Band", "band"]

Array = npt.NDArray[np.float64]
#: Width over length of the strip that folds flat into an equilateral triangle.
WIDEST = 1.0 / np.sqrt(3.0)
_NEAR = 1e-9  # arc length that stands for the inflection
_REACH = 0.03  # arc length over which the grading ends
_SPAN = np.log(0.5 / _NEAR) + (0.5 - _NEAR) / _REACH  # of the graded variable
_FIRST = 0.5 / np.pi
_MOST = 400  # elements
#: A sketch of the band of the first width, to start Newton's method: arc length, bending, ruling, p.
_SKETCH = (
    (0.00, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50),
    (0.0, 7.0, 9.4, 12.0, 10.0, 5.0, 4.0),
    (0.0, 0.55, 0.73, 0.52, -0.03, -0.65, -0.9),
    (5.0, 3.0, 0.2, -2.2, -2.1, -0.7, 0.0),
)


# -- functions of the ruling's slope ---------------------------------------------------------------


def _split(a: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Return whether `a` is small, it where it is and 0 elsewhere, it where it is not and 1."""
    small = np.abs(a) < 0.3
    return small, np.where(small, a, 0.0), np.where(small, 1.0, a)


def _g(a: npt.NDArray) -> npt.NDArray:
    small, u, b = _split(a)
    u = u * u
    series = 1 + u / 3 * (1 - u / 15 * (1 - 2 * u / 21 * (1 - u / 10 * (1 - 10 * u / 99))))
    return np.where(small, series, b / np.tanh(b))


def _h(a: npt.NDArray) -> npt.NDArray:
    small, u, b = _split(a)
    z = 4 * u * u
    series = u / 3 * (1 + z / 20 * (1 + z / 42 * (1 + z / 72 * (1 + z / 110 * (1 + z / 156)))))
    return np.where(small, series, (np.sinh(2 * b) - 2 * b) / (4 * b * b))


def _slope_of_h(a: npt.NDArray) -> npt.NDArray:
    small, u, b = _split(a)
    z = 4 * u * u
    series = 1 + 3 * z / 20 * (
        1 + 5 * z / 126 * (1 + 7 * z / 360 * (1 + 9 * z / 770 * (1 + 11 * z / 1404)))
    )
    large = (np.cosh(2 * b) - 1) / (2 * b * b) - (np.sinh(2 * b) - 2 * b) / (2 * b**3)
    return np.where(small, series / 3, large)


def _inverse_of_h(value: npt.NDArray) -> npt.NDArray:
    """Solve h(a) = value; an imaginary part (infinitesimal) is carried along."""
    real = np.real(value)
    # arsinh(3 h(a)) is nearly straight: a at the origin, 2 a less a logarithm far from it
    target = np.arcsinh(3 * real)
    size = np.abs(target)
    a = np.where(size < 1, target, np.sign(target) * (size / 2 + np.log1p(size) / 2))
    for _ in range(60):
        here = _h(a)
        slope = 3 * _slope_of_h(a) / np.sqrt(1 + 9 * here * here)
        step = np.clip((np.arcsinh(3 * here) - target) / slope, -2.0, 2.0)
        a = a - step
        if np.max(np.abs(step) / (1 + np.abs(a))) < 1e-15:
            break
    if np.iscomplexobj(value):
        return np.asarray(a + 1j * np.imag(value) / _slope_of_h(a))
    return np.asarray(a)


# -- kinematics and statics ------------------------------------------------------------------------


def _directors(q: npt.NDArray) -> npt.NDArray:
    """Return d_i in space, shape (3 directors, 3 components, points)."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _turning(q: npt.NDArray, k1: npt.NDArray, k3: npt.NDArray) -> npt.NDArray:
    """Rate of the quaternion of a frame with the strains (k1, 0, k3)."""
    w, x, y, z = q
    return 0.5 * np.array([-x * k1 - z * k3, w * k1 + y * k3, z * k1 - x * k3, w * k3 - y * k1])


def _moments(x: npt.NDArray, d: npt.NDArray, load: npt.NDArray) -> npt.NDArray:
    """Components of C - x times F along the directors; F and C are normal to the axis."""
    f2, f3, c2, c3 = load
    m = np.array([x[2] * f2 - x[1] * f3, c2 + x[0] * f3, c3 - x[0] * f2])
    return np.asarray(np.einsum("ijp,jp->ip", d, m))


@dataclass(frozen=True)
class _Local:
    """What follows algebraically from the unknowns at a point of the band."""

    bending: npt.NDArray
    ruling: npt.NDArray
    a: npt.NDArray
    stretch: npt.NDArray  # g
    moments: npt.NDArray
    directors: npt.NDArray


def _wide(y: npt.NDArray, load: npt.NDArray, width: float) -> _Local:
    eta, d = y[1], _directors(y[3:7])
    m = _moments(y[7:10], d, load)
    stress = m[0] + eta * m[2]
    square = (1 + eta * eta) ** 2
    a = _inverse_of_h(2 * square * y[2] / (width * stress * stress))
    g = _g(a)
    return _Local(stress / (square * g), eta, a, g, m, d)


def _narrow(y: npt.NDArray, load: npt.NDArray) -> _Local:
    d = _directors(y[:4])
    m = _moments(y[4:7], d, load)
    size = np.sqrt(m[0] ** 2 + m[2] ** 2)
    eta = m[2] / (size + m[0])  # tan of half the angle of (m1, m3)
    return _Local(size / (1 + eta * eta) ** 2, eta, 0 * eta, 1 + 0 * eta, m, d)


def _right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
    """Derivatives by t/span in [0, 1], t = ln s + s/reach; y: ln s, eta, p, quaternion, x."""
    width, s = p[4], np.exp(y[0])
    at = _wide(y, p[:4], width)
    k, eta = at.bending, at.ruling
    strained = k * (2 * k * eta * (1 + eta * eta) * at.stretch - at.moments[2])
    turn = _turning(y[3:7], k, eta * k)
    slope = 2 / width * np.tanh(at.a)
    rates = np.array([1 / s, slope, strained, *turn, *at.directors[2]])
    return np.asarray(_SPAN / (1 / s + 1 / _REACH) * rates)


def _ends(y: npt.NDArray, z: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
    normal = _directors(z[3:7])[1]
    first = [y[0] - np.log(_NEAR), y[1] - 2 * _NEAR / p[4], y[3] - 1, *y[4:9], y[9] - _NEAR]
    return np.array([*first, z[2], z[8], z[9], normal[1], normal[2]])


def _narrow_right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
    # p: F, C, half the length
    at = _narrow(y, p[:4])
    turn = _turning(y[:4], at.bending, at.ruling * at.bending)
    return np.asarray(p[4] * np.array([*turn, *at.directors[2]]))


def _narrow_ends(y: npt.NDArray, z: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
    normal = _directors(z[:4])[1]
    return np.array([y[0] - 1, *y[1:], z[5], z[6], normal[1], normal[2]])


# -- solutions -------------------------------------------------------------------------------------


@lru_cache
def _first(elements: int, stages: int) -> Point:
    """Solution of the first width: frames that fit the sketch, then Newton's method."""
    at, *values = np.array(_SKETCH)
    bending, ruling, strained = (PchipInterpolator(at, value) for value in values)

    def right(s: float, y: Array) -> Array:
        k = bending(s)
        return np.concatenate([_turning(y[:4], k, ruling(s) * k), _directors(y[:4])[2]])

    t = np.linspace(0.0, 1.0, elements + 1)
    fine = np.geomspace(_NEAR, 0.5, 4000)
    grade = np.log(fine) + fine / _REACH
    s = np.interp(t, (grade - grade[0]) / _SPAN, fine)
    run = solve_ivp(right, (0, 0.5), [1, 0, 0, 0, 0, 0, 0], t_eval=s, rtol=1e-8, atol=1e-10)
    d, x, eta = _directors(run.y[:4]), run.y[4:], ruling(s)
    # constants for which the stress fits best: it is linear in them
    e = d[0] + eta * d[2]
    matrix = np.array([e[0] * x[2] - e[2] * x[0], e[1] * x[0] - e[0] * x[1], e[1], e[2]]).T
    a = np.arctanh(np.clip(_FIRST / 2 * ruling.derivative()(s), -0.99, 0.99))
    stress = bending(s) * (1 + eta**2) ** 2 * _g(a)
    load = np.linalg.lstsq(matrix, stress, rcond=None)[0]
    family = Family(_right, _ends, t, stages)
    nodes = np.column_stack([np.log(s), eta, strained(s), *run.y])
    return family.fixed(family.start(nodes, np.array([*load, _FIRST])), _FIRST)


def _refined(family: Family, point: Point, tolerance: float) -> tuple[Family, Point]:
    """Halve elements until the equation holds between the collocation points."""
    while np.any(split := family.defect(point) > tolerance):
        if len(family.mesh) + np.count_nonzero(split) > _MOST:
            raise NotConverged(
                f"a defect of {tolerance:g} at the width {point.parameters[-1]:g} takes more than "
                f"{_MOST} elements"
            )
        family, point = family.refined(point, split)
    return family, point


@lru_cache(maxsize=64)
def _solution(width: float, elements: int, stages: int, tolerance: float) -> Point:
    """Go from the first width in steps of ln(w/(1/sqrt 3 - w)), shortened where Newton fails."""
    family = Family(_right, _ends, np.linspace(0, 1, elements + 1), stages)

    def progress(w: float) -> float:
        return float(np.log(w / (WIDEST - w)))

    point, place, goal, step = _first(elements, stages), progress(_FIRST), progress(width), 0.8
    previous: tuple[Point, float] | None = None
    while place != goal:
        there = goal if abs(goal - place) <= step else place + np.copysign(step, goal - place)
        wanted = width if there == goal else float(WIDEST / (1 + np.exp(-there)))
        guess = point
        if previous is not None:
            ratio = (there - place) / (place - previous[1])
            old = family.resample(previous[0])
            guess = Point(
                point.mesh,
                point.nodes + ratio * (point.nodes - old.nodes),
                point.slopes + ratio * (point.slopes - old.slopes),
                point.parameters + ratio * (point.parameters - old.parameters),
            )
        try:
            with np.errstate(all="ignore"):  # steps that fail may do so by overflow
                found = family.fixed(guess, wanted)
        except NotConverged:
            step /= 2
            if step < 1e-2:
                raise NotConverged(
                    f"the Moebius band of width {width:g} was followed to {point.parameters[-1]:g}"
                ) from None
            continue
        previous, place = (point, place), there
        family, point = _refined(family, found, 1e-3)
        step = min(1.2 * step, 0.8)
    return _refined(family, point, tolerance)[1]


@lru_cache
def _narrow_solution(elements: int, stages: int) -> Point:
    family = Family(_narrow_right, _narrow_ends, np.linspace(0, 1, elements + 1), stages)
    # A narrow but finite band as the guess: the jump of the ruling is all that it lacks.
    near = _solution(0.02 / np.pi, elements, stages, 1e-4)
    s = np.exp(near.nodes[:, 0])
    nodes = np.array([np.interp(family.mesh / 2, s, values) for values in near.nodes[:, 3:].T]).T
    guess = family.start(nodes, np.array([*near.parameters[:4], 0.5]))
    return family.fixed(guess, 0.5)


@dataclass(frozen=True, eq=False)
class Band:
    """An elastic Moebius band of unit length; arc length s runs from inflection to inflection.

    Bending is positive between them and changes its sign across the joint s = 0, 1.

    Attributes
    ----------
    width : float
        Full width over the length; 0 is Sadowsky's limit.
    point : Point
        Collocation solution on half a band.

    Examples
    --------
    Half a turn about the first axis brings the band to itself; twist and writhe add to half a turn.

    >>> import numpy as np
    >>> from lissome.references.moebius import band
    >>> found = band(0.1, elements=12, stages=3, tolerance=0.1)
    >>> here, there = found.points([0.2, 0.8])
    >>> print(np.allclose(here * [1, -1, -1], there), f"{found.twist + found.writhe():.3f}")
    True 0.500
    """

    width: float
    point: Point

    @property
    def load(self) -> Array:
        """Force and moment about the origin along the second and third axis, shape (4,), in D w."""
        return self.point.parameters[:4]

    def _local(self, y: Array) -> _Local:
        return _wide(y, self.load, self.width) if self.width else _narrow(y, self.load)

    @cached_property
    def _quadrature(self) -> tuple[Array, _Local]:
        """Weights over half the band, and what is integrated."""
        _, b, _ = gauss(self.point.slopes.shape[1])
        weights = (np.diff(self.point.mesh)[:, None] * b).ravel()
        local = self._local(self.point.stage_values.reshape(len(weights), -1).T)
        if self.width:
            # the first unknown is ln s
            s = np.exp(self.point.stage_values[..., 0].ravel())
            return weights * s * self.point.slopes[..., 0].ravel(), local
        return weights / 2, local

    @cached_property
    def energy(self) -> float:
        """Energy E L/(D w)."""
        weights, at = self._quadrature
        density = at.bending**2 * (1 + at.ruling**2) ** 2 * at.stretch
        return float(weights @ density)

    @cached_property
    def twist(self) -> float:
        """Turns of the strip about its center line."""
        weights, at = self._quadrature
        return float(weights @ (at.bending * at.ruling)) / np.pi

    def _values(self, s: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Unknowns at arc lengths folded into the first half, and which were in the second."""
        mirrored = s > 0.5
        folded = np.where(mirrored, 1.0 - s, s)
        if not self.width:
            return self.point.at(2 * folded), mirrored
        wanted = np.log(np.maximum(folded, _NEAR))
        place = np.interp(wanted, self.point.nodes[:, 0], self.point.mesh)
        for _ in range(50):
            values = self.point.at(place)
            rate = _right(values.reshape(-1, 10).T, self.point.parameters)[0].reshape(place.shape)
            step = (wanted - values[..., 0]) / rate
            place = np.clip(place + step, 0.0, 1.0)
            if np.max(np.abs(step)) < 1e-14:
                break
        return self.point.at(place), mirrored

    def strains(self, position: npt.ArrayLike) -> Array:
        """Strains (bending, 0, twisting) at arc lengths in [0, 1], shape (..., 3).

        Parameters
        ----------
        position : array_like
            Arc lengths.

        Returns
        -------
        ndarray
            In 1/L; between the inflections bending is not negative.
        """
        s = self._positions(position)
        at = self._local(self._values(s)[0].reshape(s.size, -1).T)
        k1, k3 = at.bending.reshape(s.shape), (at.bending * at.ruling).reshape(s.shape)
        return np.stack([k1, np.zeros_like(k1), k3], axis=-1)

    def ruling(self, position: npt.ArrayLike) -> Array:
        """Ruling parameter eta = kappa_3/kappa_1 at arc lengths `position` in [0, 1], of their shape."""
        s = self._positions(position)
        at = self._local(self._values(s)[0].reshape(s.size, -1).T)
        return np.asarray(at.ruling.reshape(s.shape))

    def density(self, position: npt.ArrayLike) -> Array:
        """Energy per arc length, in D w/L^2, at arc lengths `position` in [0, 1], of their shape."""
        s = self._positions(position)
        at = self._local(self._values(s)[0].reshape(s.size, -1).T)
        value = 0.5 * at.bending**2 * (1 + at.ruling**2) ** 2 * at.stretch
        return np.asarray(value.reshape(s.shape))

    def points(self, position: npt.ArrayLike) -> Array:
        """Center line at arc lengths `position` in [0, 1], shape (..., 3).

        The first axis is that of symmetry.
        """
        s = self._positions(position)
        values, mirrored = self._values(s)
        return np.asarray(values[..., -3:] * self._mirror(mirrored))

    def frames(self, position: npt.ArrayLike) -> Array:
        """Directors as columns at arc lengths `position` in [0, 1], shape (..., 3, 3)."""
        s = self._positions(position)
        values, mirrored = self._values(s)
        q = values[..., -7:-3].reshape(-1, 4).T
        d = _directors(q).transpose(2, 1, 0).reshape(*s.shape, 3, 3)
        signs = np.where(mirrored[..., None], [-1.0, 1.0, -1.0], 1.0)
        return np.asarray(d * self._mirror(mirrored)[..., :, None] * signs[..., None, :])

    @staticmethod
    def _mirror(mirrored: npt.NDArray[np.bool_]) -> Array:
        return np.where(mirrored[..., None], [1.0, -1.0, -1.0], 1.0)

    @staticmethod
    def _positions(position: npt.ArrayLike) -> Array:
        s = finite_array("position", position)
        if s.size and (s.min() < 0.0 or s.max() > 1.0):
            raise InvalidInput(
                f"argument `position` reaches from {s.min():g} to {s.max():g}; arc lengths lie in "
                "[0, 1]"
            )
        return s

    def writhe(self, panels: int = 24, points: int = 8) -> float:
        r"""Writhe of the center line, by quadrature of Gauss's double integral.

        .. math:: \frac{1}{2\pi}\int_0^1\!\!\int_0^s
           \frac{(t\times\tilde t)\cdot(x-\tilde x)}{|x-\tilde x|^3}\,d\tilde s\,ds

        Parameters
        ----------
        panels : int, optional
            Panels on half the band, narrow where it turns fast.
        points : int, optional
            Gauss points a panel. Triangles on the diagonal are mapped from squares.

        Returns
        -------
        float
            Twist and writhe add to one half.

        Raises
        ------
        InvalidInput
            If an argument is out of its range.
        """
        count = integer_at_least("panels", panels, 2)
        x, w = np.polynomial.legendre.leggauss(integer_at_least("points", points, 2))
        x, w = (x + 1) / 2, w / 2
        # equal shares of how far the frame turns, plus a little of the length
        fine = np.linspace(0.0, 1.0, 40 * len(self.point.mesh))
        values = self.point.at(fine)
        arc = np.exp(values[:, 0]) if self.width else fine / 2
        turned = np.abs(np.diff(values[:, -7:-3], axis=0)).sum(axis=1) + np.diff(arc)
        share = np.concatenate([[0.0], np.cumsum(turned)]) / turned.sum()
        half = np.interp(np.arange(count + 1) / count, share, arc)
        half[0], half[-1] = 0.0, 0.5
        ends = np.concatenate([half, 1 - half[-2::-1]])
        step = np.diff(ends)
        s = ends[:-1, None] + step[:, None] * x
        place, tangent = self.points(s), self.frames(s)[..., 2]
        weight = step[:, None] * w
        total = 0.0
        for i in range(1, len(step)):
            total += float(
                np.einsum(
                    "a,bc,abc->",
                    weight[i],
                    weight[:i],
                    _gauss_integrand(
                        place[i][:, None, None], tangent[i][:, None, None], place[:i], tangent[:i]
                    ),
                )
            )
        # below the diagonal: s = start + h u, s~ = start + h u v
        u, v = np.meshgrid(x, x, indexing="ij")
        share = np.einsum("a,b->ab", w * x, w)
        one = ends[:-1, None, None] + step[:, None, None] * u
        two = ends[:-1, None, None] + step[:, None, None] * u * v
        values = _gauss_integrand(
            self.points(one), self.frames(one)[..., 2], self.points(two), self.frames(two)[..., 2]
        )
        total += float(np.einsum("p,ab,pab->", step**2, share, values))
        return total / (2 * np.pi)


def _gauss_integrand(x: Array, t: Array, y: Array, u: Array) -> Array:
    gap = x - y
    return np.asarray(
        np.sum(np.cross(t, u) * gap, axis=-1) / np.sum(gap * gap, axis=-1) ** 1.5, dtype=float
    )


def band(width: float, *, elements: int = 40, stages: int = 6, tolerance: float = 1e-6) -> Band:
    r"""Return the elastic Moebius band of unit length.

    Parameters
    ----------
    width : float
        Full width over the length, in :math:`[0, 1/\sqrt3)`; 0 is Sadowsky's limit. Starostin and
        van der Heijden's width is pi times it.
    elements : int, optional
        Collocation elements on half the band to begin with.
    stages : int, optional
        Collocation points an element; errors are of twice this order.
    tolerance : float, optional
        Elements are halved until the equation holds to this between the collocation points (there
        the order is only the number of stages; the energy is far more accurate).

    Returns
    -------
    Band

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If a width is so near to the limit that the folds are not resolved.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.moebius import band
    >>> found = band(0.5 / np.pi)
    >>> round(found.energy, 6), round(found.twist + found.writhe(), 9)
    (64.737622, 0.5)
    """
    w = finite("width", width)
    if not 0.0 <= w < WIDEST:
        raise InvalidInput(
            f"argument `width` is {w:g}; it must lie in [0, 1/sqrt(3)): a strip as wide as "
            f"{WIDEST:.6f} of its length folds flat into a triangle, a wider one does not close"
        )
    m = integer_at_least("elements", elements, 10)
    k = integer_at_least("stages", stages, 2)
    small = positive("tolerance", tolerance)
    return Band(w, _solution(w, m, k, small) if w else _narrow_solution(m, k))
