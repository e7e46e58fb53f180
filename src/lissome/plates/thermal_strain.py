"""Strain against temperature of liquid-crystal-elastomer films.

A curve gives the spontaneous strain along the director (negative where a film contracts) at a
temperature in degrees Celsius, or in whatever unit the heat problem uses. What happens across the
director is said by name, see :func:`transverse_strain`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.special import expit, ndtr

from .._validate import finite, finite_array, one_of, positive
from ..errors import InvalidInput

__all__ = [
    "NoStrain",
    "SigmoidCurve",
    "TabulatedCurve",
    "fit_sigmoid",
    "transverse_strain",
]

Array = NDArray[np.float64]
StrainCurve = Callable[[ArrayLike], Array]
"""Spontaneous strain along the director at given temperatures."""

TENSORS: tuple[str, ...] = (
    "incompressible",
    "incompressible-finite",
    "uniaxial",
    "isotropic",
    "area-preserving",
)
"""Names of the spontaneous strain tensors, see :func:`transverse_strain`."""

# Each shape rises from 0 to 1, and its slope at the middle is 1/4 of a unit of width.
_SHAPES: dict[str, Callable[[Array], Array]] = {
    "logistic": expit,
    "gaussian": lambda x: ndtr(x * math.sqrt(2.0 * math.pi) / 4.0),
}


def transverse_strain(axial: ArrayLike, tensor: str | float = "incompressible") -> Array:
    r"""Return the in-plane spontaneous strain across the director.

    The spontaneous strain is :math:`\hat\varepsilon = a\, n\otimes n + b\,(1 - n\otimes n)` in the
    plane of the plate, with a along the director n; this gives b.

    Parameters
    ----------
    axial : array_like
        a, greater than -1.
    tensor : str or float
        ``"incompressible"``: an elastomer that keeps its volume and is alike in the two
        directions across n, to first order: b = -a/2. ``"incompressible-finite"``: the same for
        the stretch 1 + a, b = (1 + a)^(-1/2) - 1. ``"uniaxial"``: b = 0. ``"isotropic"``: b = a.
        ``"area-preserving"``: b = -a. A number r: b = -r a.

    Returns
    -------
    numpy.ndarray
        Of the shape of `axial`.

    Raises
    ------
    InvalidInput
        If the name is unknown or a strain is not above -1.

    Notes
    -----
    The thesis does not say which tensor it uses; its conclusions depend on it.

    Examples
    --------
    >>> from lissome.plates import transverse_strain
    >>> print(float(transverse_strain(-0.19)), float(transverse_strain(-0.19, "uniaxial")))
    0.095 0.0
    >>> print(f"{transverse_strain(-0.19, 'incompressible-finite'):.4f}")
    0.1111
    """
    a = np.asarray(axial, dtype=float)
    if not np.all(a > -1.0):  # also catches NaN
        raise InvalidInput(
            f"argument `axial` holds {float(np.min(a))!r}; a strain must be above -1 (a film cannot "
            "shrink to nothing)"
        )
    if not isinstance(tensor, str):
        return -checked_tensor("tensor", tensor) * a  # type: ignore[operator]
    kind = one_of("tensor", tensor, TENSORS)
    if kind == "incompressible":
        return -0.5 * a
    if kind == "incompressible-finite":
        return -np.expm1(0.5 * np.log1p(a)) / np.sqrt(1.0 + a)
    if kind == "uniaxial":
        return np.zeros_like(a)
    return a.copy() if kind == "isotropic" else -a


def checked_tensor(name: str, tensor: str | float) -> str | float:
    """Return the name of a tensor, or its ratio as a float, or raise InvalidInput."""
    if isinstance(tensor, str):
        return one_of(name, tensor, TENSORS)
    return finite(name, tensor)


@dataclass(frozen=True)
class NoStrain:
    """A passive layer: no spontaneous strain at any temperature.

    Examples
    --------
    >>> from lissome.plates import NoStrain
    >>> print(NoStrain()([20.0, 160.0]))
    [0. 0.]
    """

    def __call__(self, temperature: ArrayLike) -> Array:
        """Return zeros of the shape of `temperature`."""
        return np.zeros_like(np.asarray(temperature, dtype=float))


@dataclass(frozen=True)
class SigmoidCurve:
    r"""A contraction that sets in about a transition temperature.

    .. math:: \varepsilon(T) = -A\left[s\!\left(\frac{T-T_{ni}}{w}\right)
              - s\!\left(\frac{T_0-T_{ni}}{w}\right)\right]

    Parameters
    ----------
    saturation : float
        A: contraction from far below to far above the transition, in (-1, 1); negative for a film
        that expands.
    transition : float
        :math:`T_{ni}`, the inflection.
    width : float
        w > 0: the steepest slope is A/(4 w).
    reference : float
        :math:`T_0`, where the strain is zero.
    shape : {"logistic", "gaussian"}
        s: the logistic function or the normal distribution, both with slope 1/4 at the middle.

    Raises
    ------
    InvalidInput
        If a number is not finite, the width is not positive, or the contraction leaves nothing.

    Examples
    --------
    >>> from lissome.plates import SigmoidCurve
    >>> curve = SigmoidCurve(saturation=0.4, transition=170.0, width=10.0, reference=25.0)
    >>> print(f"{curve(25.0):.3f} {curve(170.0):.3f} {curve(400.0):.3f}")
    0.000 -0.200 -0.400
    """

    saturation: float
    transition: float
    width: float
    reference: float = 25.0
    shape: str = "logistic"

    def __post_init__(self) -> None:
        value = finite("saturation", self.saturation)
        if not -1.0 < value < 1.0:
            raise InvalidInput(
                f"argument `saturation` is {value!r}; it must lie in (-1, 1): a film cannot shrink "
                "to nothing (a steep slope far from the transition asks for that: use a wider curve)"
            )
        object.__setattr__(self, "saturation", value)
        object.__setattr__(self, "transition", finite("transition", self.transition))
        object.__setattr__(self, "width", positive("width", self.width))
        object.__setattr__(self, "reference", finite("reference", self.reference))
        one_of("shape", self.shape, _SHAPES)

    def _rise(self, temperature: ArrayLike) -> Array:
        t = np.asarray(temperature, dtype=float)
        return _SHAPES[self.shape]((t - self.transition) / self.width)

    def __call__(self, temperature: ArrayLike) -> Array:
        """Return the strain along the director at `temperature`, in its shape."""
        return -self.saturation * (self._rise(temperature) - self._rise(self.reference))

    def contraction_rate(self, low: float, high: float) -> float:
        """Return the mean contraction per degree between the temperatures `low` and `high`."""
        low, high = _ordered(low, high)
        return float(self(low) - self(high)) / (high - low)


def fit_sigmoid(
    *,
    transition: float,
    rate: float,
    between: tuple[float, float],
    width: float,
    reference: float = 25.0,
    shape: str = "logistic",
) -> SigmoidCurve:
    r"""Return the sigmoid with a given inflection, width and mean slope.

    Of the three parameters of a sigmoid a table that gives the inflection and one slope leaves the
    width open: it is an argument here.

    Parameters
    ----------
    transition : float
        Temperature of the inflection.
    rate : float
        Mean contraction per degree over `between` (a number, not per cent), positive where the
        film contracts.
    between : (float, float)
        Temperatures between which the slope was taken.
    width : float
        Width of the transition, see :class:`SigmoidCurve`.
    reference : float
        Temperature of zero strain.
    shape : {"logistic", "gaussian"}
        Form of the curve.

    Returns
    -------
    SigmoidCurve

    Raises
    ------
    InvalidInput
        If no contraction below 1 has that slope there, which happens far from the transition.

    Examples
    --------
    >>> from lissome.plates import fit_sigmoid
    >>> curve = fit_sigmoid(transition=170.0, rate=0.0054, between=(155.0, 165.0), width=10.0)
    >>> print(f"{curve.saturation:.4f} {curve.contraction_rate(155.0, 165.0):.4f}")
    0.2768 0.0054
    """
    rate = finite("rate", rate)
    low, high = _ordered(*between)
    unit = SigmoidCurve(0.5, transition, width, reference, shape)
    slope = 2.0 * unit.contraction_rate(low, high)
    if slope <= 0.0 or not abs(rate / slope) < 1.0:
        raise InvalidInput(
            f"argument `rate` is {rate!r} between {low:g} and {high:g}; with the transition at "
            f"{unit.transition:g} and a width of {unit.width:g} that asks for a contraction of "
            f"{rate / slope if slope > 0 else math.inf:.3g} in all, which must be below 1: use a "
            "greater width or a nearer transition"
        )
    return SigmoidCurve(rate / slope, transition, width, reference, shape)


def _ordered(low: float, high: float) -> tuple[float, float]:
    low, high = finite("between", low), finite("between", high)
    if not low < high:
        raise InvalidInput(
            f"argument `between` is ({low!r}, {high!r}); pass the lower temperature first"
        )
    return low, high


@dataclass(frozen=True, eq=False)
class TabulatedCurve:
    """A measured curve: strain at temperatures, with a shape-preserving cubic between them.

    Parameters
    ----------
    temperatures : array_like, shape (n,)
        Strictly increasing, at least two.
    strains : array_like, shape (n,)
        Spontaneous strains along the director, each above -1; negative where the film contracts.
    outside : {"refuse", "hold", "extend"}
        What happens beyond the measured range: an error (the default), the value at its end, or
        the straight line that continues the curve there.

    Raises
    ------
    InvalidInput
        If the table is too short, not increasing, or not finite; and, on a call, if a temperature
        lies outside the table and `outside` is ``"refuse"``.

    Examples
    --------
    >>> from lissome.plates import TabulatedCurve
    >>> curve = TabulatedCurve([25.0, 100.0, 160.0], [0.0, -0.02, -0.10])
    >>> print(curve([25.0, 160.0]))
    [ 0.  -0.1]
    >>> curve(200.0)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `temperature` is 200; the curve is measured from 25 to 160 only: measure further, or ask for `outside="hold"` or `outside="extend"`
    """  # noqa: E501

    temperatures: Array
    strains: Array
    outside: str = "refuse"
    _spline: PchipInterpolator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        t = finite_array("temperatures", self.temperatures, (None,))
        if t.size < 2 or not (np.diff(t) > 0.0).all():
            raise InvalidInput(
                f"argument `temperatures` has {t.size} entries or does not increase; pass at least "
                "two temperatures in strictly increasing order, with the strains sorted alike"
            )
        e = finite_array("strains", self.strains, (t.size,))
        if not (e > -1.0).all():
            raise InvalidInput(
                f"argument `strains` holds {e.min():g}; strains are numbers above -1, not per cent"
            )
        one_of("outside", self.outside, ("refuse", "hold", "extend"))
        t.setflags(write=False)
        e.setflags(write=False)
        object.__setattr__(self, "temperatures", t)
        object.__setattr__(self, "strains", e)
        object.__setattr__(self, "_spline", PchipInterpolator(t, e))

    def __call__(self, temperature: ArrayLike) -> Array:
        """Return the strain along the director at `temperature`, in its shape."""
        t = np.asarray(temperature, dtype=float)
        low, high = float(self.temperatures[0]), float(self.temperatures[-1])
        inside = np.clip(t, low, high)
        # A rounding error at the end of the table is not a measurement beyond it.
        slack = 1e-12 * max(abs(low), abs(high))
        if self.outside == "refuse" and not np.all(np.abs(t - inside) <= slack):
            bad = float(np.ravel(t)[np.argmax(np.nan_to_num(np.abs(t - inside), nan=np.inf))])
            raise InvalidInput(
                f"argument `temperature` is {bad:g}; the curve is measured from {low:g} to {high:g} "
                'only: measure further, or ask for `outside="hold"` or `outside="extend"`'
            )
        strain = self._spline(inside)
        if self.outside == "extend":
            ends = self._spline([low, high], 1)
            strain = strain + np.where(t < low, ends[0], ends[1]) * (t - inside)
        return np.asarray(strain, dtype=float)
