r"""An inextensible strip between two clamps that are pushed together and shifted sideways.

Wunderlich's energy of :mod:`lissome.references.moebius`, with the clamps and units of
:mod:`lissome.references.clamped_ribbon`, but for the energy: its unit is that of bending :math:`Dw`
over the length. The rulings at the clamps are free. Unknowns are the center line x, the quaternion of
its frame, the ruling :math:`\eta` and :math:`p = \partial U/\partial\eta'`; force F and moment
:math:`m = C - x\times F` are constants. With :math:`P = m_1 + \eta m_3`

.. math:: \frac{\sinh 2a - 2a}{4a^2} = \frac{2(1+\eta^2)^2p}{wP^2},\qquad
   \eta' = \frac2w\tanh a,\qquad \kappa_1 = \frac{P}{(1+\eta^2)^2\,a\coth a},\qquad
   p' = \kappa_1\left[2\kappa_1\eta(1+\eta^2)a\coth a - m_3\right].

**Two inflections.** P vanishes at two places :math:`s_1 < s_2`, p does not, and so a is infinite
there: rulings turn as fast as the width allows, and :math:`\kappa_1\sim s/\ln(1/s)`. Both places are
unknowns, with the condition P = 0 each. The four pieces of the strip between clamps, inflections and
middle are solved together, each in a variable t with :math:`ds/dt\sim s` near its inflection, in which
everything is analytic. No symmetry is used.

:func:`~lissome.references.clamped_ribbon.moved`, :func:`~lissome.references.clamped_ribbon.pitchfork`
and :func:`~lissome.references.clamped_ribbon.beyond` work with these states as with those of ribbons
that stretch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from .._validate import finite, in_open_interval, integer_at_least, positive
from ..errors import InvalidInput, NotConverged
from ._collocation import Family, gauss
from ._frames import directors, quaternion_rate
from .clamped_ribbon import Clamps, Control, Equilibrium, moved
from .moebius import _g, _inverse_of_h

__all__ = ["StripEquilibrium", "sheared_arch"]

Array = npt.NDArray[np.float64]
_CONTROLS = ("shortening", "shear", "twist")
_NEAR = 1e-7  # arc length that stands for the inflection: an error of its square
_REACH = 0.05  # arc length over which the grading ends
_MOST = 80  # elements of a piece
_COUNT = 10  # unknowns of a piece: ln of the distance to its inflection, eta, p, quaternion, x
_SIGN = np.array([-1.0, 1.0, -1.0, 1.0])[:, None]  # of ds/dt: clamp, middle, middle, clamp
#: Width, shortening and shear of the first solution; its force and moment, inflection, and a sketch of
#: a half to start Newton's method: arc length, bending, ruling, p.
_FIRST = (1.0 / 12.0, 0.25, 0.15)
_LOADS = (-30.523, 45.660, 0.0, 12.781, 2.305, 19.412)
_PLACE = 0.2484
_SKETCH = (
    (0, 0.04, 0.08, 0.12, 0.16, 0.19, 0.21, 0.23, 0.2484, 0.265, 0.285, 0.305, 0.33, 0.37, 0.41, 0.45, 0.5),
    (5.01, 5.39, 5.88, 5.51, 4.1, 3.02, 2.56, 1.7, 0, -1.43, -2.38, -2.7, -3.29, -4.37, -5.26, -5.82, -6.07),
    (0.716, 0.581, 0.337, 0.047, -0.269, -0.486, -0.558, -0.401, 0.012, 0.392, 0.607, 0.593, 0.496, 0.332,
     0.21, 0.136, 0.104),
    (0, -0.17, -0.185, -0.154, -0.101, -0.051, 0, 0.1, 0.16, 0.113, 0.019, -0.023, -0.044, -0.051, -0.043,
     -0.027, 0),
)  # fmt: skip


@dataclass(frozen=True)
class _Local:
    """What follows algebraically from the unknowns."""

    bending: npt.NDArray
    a: npt.NDArray
    stretch: npt.NDArray  # a coth a
    twisting_moment: npt.NDArray
    stress: npt.NDArray  # P
    tangent: npt.NDArray


def _local(z: npt.NDArray, p: npt.NDArray, width: float) -> _Local:
    """`z` (10, ...): unknowns of pieces."""
    eta, x = z[1], z[7:10]
    d1, _, d3 = directors(z[3:7])
    f, c = p[:3], p[3:6]
    m = np.array(
        [
            c[0] - x[1] * f[2] + x[2] * f[1],
            c[1] - x[2] * f[0] + x[0] * f[2],
            c[2] - x[0] * f[1] + x[1] * f[0],
        ]
    )
    m3 = (d3 * m).sum(axis=0)
    stress = (d1 * m).sum(axis=0) + eta * m3
    square = (1 + eta * eta) ** 2
    a = _inverse_of_h(2 * square * z[2] / (width * stress * stress))
    g = _g(a)
    return _Local(stress / (square * g), a, g, m3, stress, d3)


def _lengths(p: npt.NDArray) -> npt.NDArray:
    return np.array([p[6], 0.5 - p[6], p[7] - 0.5, 1 - p[7]])


def _span(length: npt.NDArray) -> npt.NDArray:
    """Length of the graded variable t = ln s + s/reach."""
    with np.errstate(invalid="ignore"):  # a trial step past a clamp is not finite, and refused
        return np.asarray(np.log(length / _NEAR) + (length - _NEAR) / _REACH)


def _family(width: float, clamps: Clamps, control: Control, mesh: Array, stages: int) -> Family:
    def right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        z = y.reshape(4, _COUNT, -1).transpose(1, 0, 2)
        at = _local(z, p, width)
        k, eta, distance = at.bending, z[1], np.exp(z[0])
        strained = k * (2 * k * eta * (1 + eta * eta) * at.stretch - at.twisting_moment)
        turn = quaternion_rate(z[3:7], k, 0 * k, eta * k)
        slope = 2 / width * np.tanh(at.a)
        rates = np.array([_SIGN / distance, slope, strained, *turn, *at.tangent])
        span = _span(_lengths(p).reshape(4, -1))
        scale = _SIGN * span / (1 / distance + 1 / _REACH)
        return np.asarray((scale * rates).transpose(1, 0, 2).reshape(4 * _COUNT, -1))

    def ends(y0: npt.NDArray, y1: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        at = {name: getattr(clamps, name) for name in _CONTROLS} | {control: p[-1]}
        start, end = (y.reshape(4, _COUNT, *y.shape[1:]) for y in (y0, y1))
        local = _local(start.swapaxes(0, 1), p, width)
        out = [*(start[:, 0] - np.log(_NEAR))]
        for i in (0, 2):  # across an inflection
            low, high = start[i], start[i + 1]
            slope = 2 / width * np.tanh(local.a[i])
            out += [high[1] - low[1] - 2 * _NEAR * slope, *(high[2:7] - low[2:7])]
            out += [*(high[7:] - low[7:] - 2 * _NEAR * local.tangent[:, i])]
            out += [local.stress[i] + local.stress[i + 1]]
        first, last = end[0], end[3]
        cos, sin = np.cos(at["twist"] / 2), np.sin(at["twist"] / 2)
        # the turn about x after that which takes e1, e2, e3 to y, z, x
        q = [(cos - sin) / 2, (cos + sin) / 2, (cos - sin) / 2, (cos + sin) / 2]
        a, b, c, d = last[3:7]
        turned = [
            q[0] * b - q[1] * a - q[2] * d + q[3] * c,
            q[0] * c - q[2] * a - q[3] * b + q[1] * d,
            q[0] * d - q[3] * a - q[1] * c + q[2] * b,
        ]
        reached = [last[7] - 1 + at["shortening"], last[8] - at["shear"], last[9]]
        out += [*first[7:], *(first[3:7] - 0.5), first[2], *(end[1, 1:] - end[2, 1:])]
        return np.array([*out, *reached, *turned, last[2]])

    return Family(right, ends, mesh, stages)


@dataclass(frozen=True, eq=False)
class StripEquilibrium(Equilibrium):
    """An equilibrium of an inextensible strip between clamps.

    Attributes
    ----------
    ribbon : float
        Width over length.
    clamps : Clamps
        Its clamps.
    solution : Point
        The four pieces over the graded variable; force, moment about the origin, places of the
        inflections, and the control.

    Examples
    --------
    A half turn about its middle brings the sheared arch to itself:

    >>> from lissome.references.clamped_strip import sheared_arch
    >>> state = sheared_arch(1 / 12, elements=8, stages=3, tolerance=0.3)
    >>> first, second = state.inflections
    >>> print(f"{first + second:.6f} {state.middle[0]:.6f} {state.middle[1]:.6f}")
    1.000000 0.375000 0.075000
    """

    ribbon: Any

    def _family(self, control: Control, mesh: Array, stages: int) -> Family:
        return _family(self.ribbon, self.clamps, control, mesh, stages)

    @property
    def inflections(self) -> Array:
        """Arc lengths where the bending changes sign, shape (2,)."""
        return np.array(self.solution.parameters[6:8])

    @property
    def middle(self) -> Array:
        """Middle of the center line, shape (3,), over L."""
        return np.array(self.solution.nodes[-1].reshape(4, _COUNT)[1, 7:])

    @property
    def margin(self) -> float:
        """1: the law is elliptic everywhere."""
        return 1.0

    @property
    def energy(self) -> float:
        """Energy, units of Dw/L."""
        stages = self.solution.slopes.shape[1]
        _, weight, _ = gauss(stages)
        p = self.solution.parameters
        z = self.solution.stage_values.reshape(-1, stages, 4, _COUNT).transpose(3, 2, 0, 1)
        at = _local(z, p, self.ribbon)
        density = 0.5 * at.bending**2 * (1 + z[1] ** 2) ** 2 * at.stretch
        scale = _span(_lengths(p))[:, None, None] / (np.exp(-z[0]) + 1 / _REACH)
        step = np.diff(self.solution.mesh)
        return float(np.einsum("e,j,iej->", step, weight, density * scale))

    def _values(self, position: npt.ArrayLike) -> tuple[npt.NDArray, _Local]:
        s = np.asarray(position, dtype=float)
        one, two = self.inflections
        piece = np.searchsorted([one, 0.5, two], s)
        distance = np.abs(s - np.where(piece < 2, one, two))
        length = _lengths(self.solution.parameters)[piece]
        t = (np.log(np.maximum(distance, _NEAR) / _NEAR) + (distance - _NEAR) / _REACH) / _span(
            length
        )
        table = self.solution.at(np.clip(t, 0.0, 1.0))
        table = table.reshape(*s.shape, 4, _COUNT)
        z = np.moveaxis(
            np.take_along_axis(table, piece[..., None, None], axis=-2)[..., 0, :], -1, 0
        )
        return z, _local(z, self.solution.parameters, self.ribbon)

    def strains(self, position: npt.ArrayLike) -> Array:
        """Strains k1, k2 = 0, k3 at arc lengths `position` in [0, 1], shape (..., 3), units of 1/L."""
        z, at = self._values(position)
        return np.stack([at.bending, 0 * at.bending, z[1] * at.bending], axis=-1)

    def ruling(self, position: npt.ArrayLike) -> Array:
        """Ruling parameter at arc lengths `position` in [0, 1], of their shape."""
        return np.asarray(self._values(position)[0][1])


def _first(elements: int, stages: int) -> StripEquilibrium:
    """Integrate the sketch of one half, turn it to get the other, and correct."""
    width, shortening, shear = _FIRST
    at, *sketch = np.array(_SKETCH)
    bending, ruling, strained = (PchipInterpolator(at, value) for value in sketch)

    def right(s: float, y: Array) -> Array:
        k = bending(s)
        return np.array([*quaternion_rate(y[:4], k, 0 * k, ruling(s) * k), *directors(y[:4])[2]])

    begin = [0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]
    run = solve_ivp(right, (0.0, 0.5), begin, rtol=1e-8, atol=1e-10, dense_output=True)
    mesh = np.linspace(0.0, 1.0, elements + 1)
    pieces = []
    for sign, length in ((-1.0, _PLACE), (1.0, 0.5 - _PLACE)):
        fine = np.geomspace(_NEAR, length, 6000)
        grade = np.log(fine / _NEAR) + (fine - _NEAR) / _REACH
        distance = np.interp(mesh * grade[-1], grade, fine)
        s = _PLACE + sign * distance
        pieces.append(np.array([np.log(distance), ruling(s), strained(s), *run.sol(s)]))
    # half a turn about the vertical axis through the middle: of the frame, then of its d1 and d3
    for values in (pieces[1], pieces[0]):
        other = values.copy()
        a, b, c, d = values[3:7]
        other[3:7] = [b, a, d, c]
        other[2] = -values[2]
        other[7], other[8] = 1.0 - shortening - values[7], shear - values[8]
        pieces.append(other)
    clamps = Clamps(shortening, shear)
    family = _family(width, clamps, "shear", mesh, stages)
    guess = family.start(np.concatenate(pieces).T, np.array([*_LOADS, _PLACE, 1.0 - _PLACE, shear]))
    return StripEquilibrium(width, clamps, family.fixed(guess, shear))


def sheared_arch(
    width: float,
    shortening: float = 0.25,
    shear: float = 0.15,
    *,
    elements: int = 16,
    stages: int = 4,
    tolerance: float = 3e-2,
) -> StripEquilibrium:
    """Return the sheared arch of an inextensible strip, bulging to negative z.

    Parameters
    ----------
    width : float
        Over the length.
    shortening : float
        Part of the length by which the clamps come nearer; in (0, 1).
    shear : float
        Shift of the second clamp along the width, over the length; positive. (Without shear the
        rulings of an arch that is not twisted do not turn, and the inflections are not singular.)
    elements, stages : int
        Collocation elements of each piece to begin with, and points in each.
    tolerance : float
        Elements are halved until the defect of the equations between their points is less.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the equilibria that lead there end.

    Examples
    --------
    >>> from lissome.references.clamped_strip import sheared_arch
    >>> state = sheared_arch(1 / 12)
    >>> print(f"{state.energy:.3f}")
    13.534
    """
    target = positive("width", width)
    if target > 0.5:
        raise InvalidInput(f"argument `width` is {width:g}; it must be at most half the length")
    c = in_open_interval("shortening", shortening, 0.0, 1.0, "clamps nearer than the strip is long")
    p = finite("shear", shear)
    if p <= 0.0:
        raise InvalidInput(f"argument `shear` is {p:g}; it must be positive: mirror the other side")
    integer_at_least("elements", elements, 6)
    integer_at_least("stages", stages, 2)
    limit = positive("tolerance", tolerance)
    state = _first(elements, stages)
    here, factor = float(state.ribbon), 1.3
    while here != target:
        there = min(here * factor, target) if target > here else max(here / factor, target)
        family = _family(there, state.clamps, "shear", state.solution.mesh, stages)
        try:
            found = family.fixed(state.solution, state.clamps.shear)
        except NotConverged as error:
            factor = 1.0 + 0.5 * (factor - 1.0)
            if factor < 1.005:
                raise NotConverged(
                    f"the sheared arch of width {width:g} was followed to {here:g}", state=state
                ) from error
            continue
        state, here = StripEquilibrium(there, state.clamps, found), there
    state = moved(moved(state, "shortening", c), "shear", p)
    family, point = (
        _family(target, state.clamps, "shear", state.solution.mesh, stages),
        state.solution,
    )
    point = replace(point, parameters=np.array([*point.parameters[:-1], p]))
    while np.any(split := family.defect(point) > limit):
        if len(family.mesh) + np.count_nonzero(split) > _MOST:
            raise NotConverged(
                f"a defect of {limit:g} takes more than {_MOST} elements", state=state
            )
        family, point = family.refined(point, split)
    return replace(state, solution=point)
