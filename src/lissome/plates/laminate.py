r"""Laminates: a stack of layers seen as one plate.

Conventions, here and in every module of :mod:`lissome.plates`: z points up and counts from the
middle of the thickness, layers are listed from the bottom, and the curvature is the Hessian of the
deflection, :math:`\kappa = \nabla\nabla w`, so that the strain at height z is

.. math:: \varepsilon(z) = \varepsilon - (z - z_0)\,\kappa .

A positive curvature is a cup, a negative one a dome. A stack whose bottom contracts becomes a dome.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._readonly import readonly_property
from .._units import magnitude
from .._validate import finite, integer_at_least, positive
from ..errors import InvalidInput, NotConverged
from .directors import DirectedTensor, Director
from .thermal_strain import NoStrain, StrainCurve, checked_tensor, transverse_strain

__all__ = ["Laminate", "Layer", "SpontaneousDeformation"]

Array = NDArray[np.float64]
Profile = Callable[[Array], ArrayLike]

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(8)
_MOST_PANELS = 1 << 14


@dataclass(frozen=True)
class Layer:
    r"""One film of a laminate: isotropic in its elasticity, actuated along and across a director.

    Any consistent units will do; :meth:`of` takes physical quantities.

    Parameters
    ----------
    thickness : float
        Positive.
    modulus : float or callable
        Young's modulus: positive; or a function of the height inside the layer over its thickness,
        an array in [0, 1] counted from the bottom of the layer, that returns an array.
    poisson_ratio : float
        In (-1, 1/2].
    strain : callable
        Spontaneous strain along the director as a function of temperature; a passive layer by
        default.
    tensor : str or float
        What happens across the director, see :func:`lissome.plates.transverse_strain`.
    conductivity, heat_capacity : float
        Heat conductivity, and heat capacity per volume; positive. With the default of 1 and a
        total thickness of 1, time is counted in thickness squared over diffusivity.
    name : str
        A label.
    physical : bool
        Whether the numbers are in SI units, as :meth:`of` makes them: times may then be given as
        quantities.

    Raises
    ------
    InvalidInput
        If a number is out of its range.

    Examples
    --------
    >>> from lissome.plates import Layer
    >>> Layer(thickness=30e-6, modulus=-1.0, poisson_ratio=0.5)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `modulus` is -1.0; it must be greater than 0
    """

    thickness: float
    modulus: float | Profile
    poisson_ratio: float
    strain: StrainCurve = field(default_factory=NoStrain)
    tensor: str | float = "incompressible"
    conductivity: float = 1.0
    heat_capacity: float = 1.0
    name: str = ""
    physical: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "thickness", positive("thickness", self.thickness))
        if not callable(self.modulus):
            object.__setattr__(self, "modulus", positive("modulus", self.modulus))
        nu = finite("poisson_ratio", self.poisson_ratio)
        if not -1.0 < nu <= 0.5:
            raise InvalidInput(
                f"argument `poisson_ratio` is {nu!r}; it must lie in (-1, 1/2]: beyond, an isotropic "
                "solid is not stable"
            )
        object.__setattr__(self, "poisson_ratio", nu)
        if not callable(self.strain):
            raise InvalidInput(
                f"argument `strain` is {self.strain!r}; pass a function of temperature, such as a "
                "SigmoidCurve or a TabulatedCurve"
            )
        object.__setattr__(self, "tensor", checked_tensor("tensor", self.tensor))
        object.__setattr__(self, "conductivity", positive("conductivity", self.conductivity))
        object.__setattr__(self, "heat_capacity", positive("heat_capacity", self.heat_capacity))

    @classmethod
    def of(
        cls,
        *,
        thickness: Any,
        modulus: Any,
        poisson_ratio: float,
        diffusivity: Any,
        heat_capacity: Any = "1 J/(m^3 K)",
        strain: StrainCurve | None = None,
        tensor: str | float = "incompressible",
        name: str = "",
    ) -> Layer:
        """Return a layer from physical quantities: strings with units, or pint quantities.

        Parameters
        ----------
        thickness, modulus, diffusivity, heat_capacity : pint.Quantity or str
            Length, stress, area per time, and energy per volume and degree. Where all layers
            share one heat capacity and no heat flux is given its value is of no effect.
        poisson_ratio, strain, tensor, name
            As above.

        Returns
        -------
        Layer
            In SI units.

        Raises
        ------
        InvalidInput
            If a quantity has no unit, a wrong one, or is out of its range.

        Examples
        --------
        >>> from lissome.plates import Layer
        >>> film = Layer.of(
        ...     thickness="30 um", modulus="17 MPa", poisson_ratio=0.5, diffusivity="0.1 mm^2/s"
        ... )
        >>> print(f"{film.thickness:.1e} {film.modulus:.1e} {film.diffusivity:.1e}")
        3.0e-05 1.7e+07 1.0e-07
        """
        capacity = magnitude("heat_capacity", heat_capacity, "J/(m^3 K)", "1.8 MJ/(m^3 K)")
        spread = magnitude("diffusivity", diffusivity, "m^2/s", "0.1 mm^2/s")
        return cls(
            thickness=magnitude("thickness", thickness, "m", "30 um"),
            modulus=magnitude("modulus", modulus, "Pa", "17 MPa"),
            poisson_ratio=poisson_ratio,
            strain=NoStrain() if strain is None else strain,
            tensor=tensor,
            conductivity=positive("diffusivity", spread) * positive("heat_capacity", capacity),
            heat_capacity=capacity,
            name=name,
            physical=True,
        )

    @property
    def diffusivity(self) -> float:
        """Conductivity over heat capacity."""
        return self.conductivity / self.heat_capacity

    def modulus_at(self, height: ArrayLike) -> Array:
        """Return the modulus at `height` over the thickness, from the bottom of the layer, in [0, 1].

        Raises
        ------
        InvalidInput
            If the function `modulus` returns another shape, or a number that is not positive.
        """
        height = np.asarray(height, dtype=float)
        if not callable(self.modulus):
            return np.full_like(height, self.modulus)
        values = np.asarray(self.modulus(height), dtype=float)
        if values.shape != height.shape or not np.all((values > 0.0) & np.isfinite(values)):
            raise InvalidInput(
                f"argument `modulus` of layer {self.name!r} returns an array of shape "
                f"{values.shape} for heights of shape {height.shape}, or values that are not "
                "positive and finite; return one positive modulus for each height"
            )
        return values

    def spontaneous_strain(self, temperature: ArrayLike) -> tuple[Array, Array]:
        """Return the spontaneous strains along and across the director at `temperature`.

        Raises
        ------
        InvalidInput
            If the function `strain` returns another shape, or a number that is not finite.
        """
        t = np.asarray(temperature, dtype=float)
        axial = np.asarray(self.strain(t), dtype=float)
        if axial.shape != t.shape or not np.isfinite(axial).all():
            raise InvalidInput(
                f"argument `strain` of layer {self.name!r} returns an array of shape {axial.shape} "
                f"for temperatures of shape {t.shape}, or numbers that are not finite; return one "
                "finite strain for each temperature"
            )
        return axial, transverse_strain(axial, self.tensor)

    def flipped(self) -> Layer:
        """Return the layer upside down."""
        if not callable(self.modulus):
            return self
        return replace(self, modulus=_Reversed(self.modulus))


@dataclass(frozen=True)
class _Reversed:
    """A modulus profile read from the other side (a class, so that it can be pickled)."""

    profile: Profile

    def __call__(self, height: Array) -> ArrayLike:
        return self.profile(1.0 - height)


@dataclass(frozen=True, eq=False)
class SpontaneousDeformation:
    r"""What a laminate would do if nothing held it: its strain and curvature, and what energy stays.

    Attributes
    ----------
    strain_along, strain_across : numpy.ndarray
        :math:`\varepsilon_m` along and across the director, in the plane at height `plane`.
    curvature_along, curvature_across : numpy.ndarray
        :math:`\kappa_m`, the spontaneous Hessian of the deflection: a cup is positive.
    residual_energy : numpy.ndarray
        Energy per area that no strain and no curvature relaxes, from strains that are not linear
        in z.
    plane : float
        Height from the middle of the thickness: the neutral plane where there is one.

    Examples
    --------
    Timoshenko's strip of two equal layers, of which the upper one contracts by 1 %: half of it is seen
    as strain in the middle, and the curvature is 3/2 of it over the thickness.

    >>> from lissome.plates import Laminate, Layer
    >>> still = Layer(0.5, 1.0, 0.5, strain=lambda t: 0.0 * t)
    >>> short = Layer(0.5, 1.0, 0.5, strain=lambda t: -0.01 + 0.0 * t)
    >>> free = Laminate([still, short]).spontaneous(20.0)
    >>> print(f"{free.strain_along:.4f} {free.curvature_along:.4f}")
    -0.0050 0.0150
    """

    strain_along: Array
    strain_across: Array
    curvature_along: Array
    curvature_across: Array
    residual_energy: Array
    plane: float

    @property
    def strain_difference(self) -> Array:
        """Strain across minus along, of their shape.

        Radial minus azimuthal where the director runs in circles.
        """
        return self.strain_across - self.strain_along

    def fields(self, director: Director, length: float = 1.0) -> dict[str, DirectedTensor]:
        r"""Return the arguments `strain` and `curvature` of a :class:`.Plate`.

        Parameters
        ----------
        director : Director
            Direction of the mesogens, the same at all heights.
        length : float
            L: how long the unit of length of the mesh is. Curvatures become
            :math:`\bar\kappa_m = L\,\kappa_m`.

        Returns
        -------
        dict
            Functions of x and y under the names ``"strain"`` and ``"curvature"``.

        Raises
        ------
        InvalidInput
            If this is a history: take one time of it with :meth:`SpontaneousHistory.at`.
        """
        if np.ndim(self.strain_along) > 0:
            raise InvalidInput(
                f"these are spontaneous strains of shape {np.shape(self.strain_along)}; a plate takes "
                "those of one time"
            )
        unit = positive("length", length)
        return {
            "strain": director.field(float(self.strain_along), float(self.strain_across)),
            "curvature": director.field(
                unit * float(self.curvature_along), unit * float(self.curvature_across)
            ),
        }

    @property
    def curvature_difference(self) -> Array:
        """Curvature across minus along, of their shape (1/length)."""
        return self.curvature_across - self.curvature_along


@dataclass(frozen=True)
class Laminate:
    r"""A stack of perfectly bonded layers in plane stress, listed from the bottom.

    With moments :math:`\mathcal M^p(f) = \int_{-h/2}^{h/2} z^p f\,dz` and a common Poisson ratio
    the energy per area is, exactly,

    .. math:: C\,W(\varepsilon - \varepsilon_m) + B\,W(\kappa - \kappa_m) + \text{residual},

    .. math:: C = \mathcal M^0(E), \quad z_0 = \frac{\mathcal M^1(E)}{C}, \quad
              B = \mathcal M^2(E) - \frac{\mathcal M^1(E)^2}{C}, \quad
              \varepsilon_m = \frac{\mathcal M^0(E\hat\varepsilon)}{C}, \quad
              \kappa_m = -\frac{1}{B}\left(\mathcal M^1(E\hat\varepsilon)
              - z_0 \mathcal M^0(E\hat\varepsilon)\right)

    (Table 5.1 of the thesis; :math:`\kappa` here is :math:`\nabla\nabla w`, hence the sign). It
    follows by completing squares: nothing is assumed about :math:`\varepsilon`.

    Parameters
    ----------
    layers : sequence of Layer
        From the bottom to the top.
    thickness : float, optional
        Total thickness; checked against the sum of the layers.

    Raises
    ------
    InvalidInput
        If there is no layer, something is not a layer, SI and plain layers are mixed, or the
        thicknesses do not add up.

    Examples
    --------
    Two layers of one material, the lower of which contracts: the sheet becomes a dome.

    >>> from lissome.plates import Laminate, Layer, SigmoidCurve
    >>> active = SigmoidCurve(saturation=0.2, transition=100.0, width=5.0, reference=20.0)
    >>> sheet = Laminate([Layer(0.5, 1.0, 0.5, strain=active), Layer(0.5, 1.0, 0.5)])
    >>> print(f"{sheet.stretching_modulus:.3f} {sheet.bending_modulus:.5f}")
    1.000 0.08333
    >>> hot = sheet.spontaneous(200.0)
    >>> print(f"{hot.strain_along:.3f} {hot.curvature_along:.3f}")
    -0.100 -0.300
    """

    layers: Sequence[Layer]
    thickness: float = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        try:
            layers = tuple(self.layers)
        except TypeError:
            layers = ()
        if not layers or not all(isinstance(layer, Layer) for layer in layers):
            raise InvalidInput(
                f"argument `layers` is {self.layers!r}; pass a sequence of one or more Layer, the "
                "bottom one first"
            )
        if len({layer.physical for layer in layers}) > 1:
            raise InvalidInput(
                "argument `layers` mixes layers in SI units (Layer.of) with layers of plain numbers; "
                "make all of them the same way"
            )
        total = math.fsum(layer.thickness for layer in layers)
        if self.thickness is not None:
            wanted = positive("thickness", self.thickness)
            if abs(wanted - total) > 1e-9 * total:
                raise InvalidInput(
                    f"argument `thickness` is {wanted!r}; the layers add up to {total!r}: correct one "
                    "of them, or leave `thickness` out"
                )
        object.__setattr__(self, "layers", layers)
        object.__setattr__(self, "thickness", total)

    def flipped(self) -> Laminate:
        """Return the laminate upside down."""
        return Laminate([layer.flipped() for layer in reversed(self.layers)])

    @readonly_property
    def interfaces(self) -> Array:
        """Heights of the faces and interfaces from the middle, shape (layers + 1,), increasing."""
        heights = np.concatenate([[0.0], np.cumsum([layer.thickness for layer in self.layers])])
        heights -= 0.5 * self.thickness
        heights[-1] = 0.5 * self.thickness
        heights.setflags(write=False)
        return heights

    def layer_at(self, z: ArrayLike) -> NDArray[np.intp]:
        """Return the index of the layer at heights `z`, of their shape (an interface belongs to the upper).

        Raises
        ------
        InvalidInput
            If a height lies outside the laminate.
        """
        z = np.asarray(z, dtype=float)
        half = 0.5 * self.thickness * (1.0 + 1e-12)
        if not np.all(np.abs(z) <= half):
            raise InvalidInput(
                f"argument `z` holds {float(np.ravel(z)[np.argmax(np.abs(z))]):g}; heights lie within "
                f"{0.5 * self.thickness:g} of the middle"
            )
        found = np.searchsorted(self.interfaces, z, side="right") - 1
        return np.clip(found, 0, len(self.layers) - 1)

    def modulus_at(self, z: ArrayLike) -> Array:
        """Return Young's modulus at heights `z` from the middle of the thickness, of their shape."""
        z = np.asarray(z, dtype=float)
        index = self.layer_at(z)
        result = np.empty(z.shape)
        for i, layer in enumerate(self.layers):
            here = index == i
            if here.any():
                local = (z[here] - self.interfaces[i]) / layer.thickness
                result[here] = layer.modulus_at(local)
        return result

    def moment(self, power: int) -> float:
        r"""Return :math:`\mathcal M^p(E)` about the middle of the thickness.

        Exact for layers of constant modulus, by Gauss quadrature to rounding errors for others.

        Parameters
        ----------
        power : int
            p, 0 or more.

        Raises
        ------
        InvalidInput
            If `power` is not a whole number, 0 or more.
        """
        return self._moment(integer_at_least("power", power, 0), lambda layer: 1.0)

    def _moment(self, power: int, factor: Callable[[Layer], float]) -> float:
        total = []
        for i, layer in enumerate(self.layers):
            low, high = self.interfaces[i], self.interfaces[i + 1]
            if callable(layer.modulus):
                value = float(_integral(_weighted(layer, power, low), low, high))
            else:
                value = layer.modulus * (high ** (power + 1) - low ** (power + 1)) / (power + 1)
            total.append(factor(layer) * value)
        return math.fsum(total)

    @property
    def poisson_ratio(self) -> float:
        """The common Poisson ratio of the layers.

        Raises
        ------
        InvalidInput
            If they differ.
        """
        ratios = {layer.poisson_ratio for layer in self.layers}
        if len(ratios) > 1:
            raise InvalidInput(
                f"the layers have Poisson ratios {sorted(ratios)}: such a laminate has no single "
                "stretching and bending modulus and no neutral plane; use `stiffness_matrices()`, or "
                "give all layers one ratio"
            )
        return ratios.pop()

    @property
    def stretching_modulus(self) -> float:
        """C: force per length."""
        self.poisson_ratio  # noqa: B018  (refuses laminates without one)
        return self.moment(0)

    @property
    def neutral_plane(self) -> float:
        r"""Height :math:`z_0` at which stretching and bending decouple, from the middle."""
        self.poisson_ratio  # noqa: B018
        return self.moment(1) / self.moment(0)

    @property
    def bending_modulus(self) -> float:
        """B: force times length. The bending stiffness of a plate is B/(1 - nu^2)."""
        self.poisson_ratio  # noqa: B018
        return self._channel(lambda layer: 1.0)[2]

    def moduli(self, length: float | None = None) -> dict[str, float]:
        r"""Return the arguments `stretching`, `bending` and `poisson_ratio` of a :class:`.Plate`.

        Parameters
        ----------
        length : float, optional
            L: how long the unit of length of the mesh is. With it energies are in units of
            :math:`C L^2`: the stretching modulus is 1, the bending modulus
            :math:`\bar B = B/(C L^2)`, (5.9) of the thesis. Without it moduli are as they are.

        Raises
        ------
        InvalidInput
            If the length is not positive, or Poisson ratios differ.
        """
        c, b = self.stretching_modulus, self.bending_modulus
        if length is not None:
            c, b = 1.0, b / (c * positive("length", length) ** 2)
        return {"stretching": c, "bending": b, "poisson_ratio": self.poisson_ratio}

    @property
    def bending_length(self) -> float:
        r"""Square root of B over C: thickness over the root of 12 for a uniform plate."""
        return math.sqrt(self.bending_modulus / self.stretching_modulus)

    def _channel(self, factor: Callable[[Layer], float]) -> tuple[float, float, float]:
        """Return stiffness, neutral height and central second moment of E times a factor."""
        m0 = self._moment(0, factor)
        center = self._moment(1, factor) / m0
        # The second moment about the center itself: M2 - M1^2/M0 cancels for thin stiff layers.
        central = []
        for i, layer in enumerate(self.layers):
            low, high = self.interfaces[i], self.interfaces[i + 1]
            if callable(layer.modulus):
                value = float(_integral(_weighted(layer, 2, low, center), low, high))
            else:
                value = layer.modulus * ((high - center) ** 3 - (low - center) ** 3) / 3.0
            central.append(factor(layer) * value)
        return m0, center, math.fsum(central)

    def stiffness_matrices(self) -> tuple[Array, Array, Array]:
        r"""Return the matrices A, B, D of classical lamination theory about the middle plane.

        .. math:: \begin{pmatrix} N \\ M \end{pmatrix} =
                  \begin{pmatrix} A & B \\ B & D \end{pmatrix}
                  \begin{pmatrix} \varepsilon \\ -\kappa \end{pmatrix}

        in components 11, 22, 12 with engineering shear :math:`2\varepsilon_{12}` and
        :math:`2\kappa_{12}`; :math:`M = \int z\,\sigma\,dz`. Poisson ratios may differ.

        Returns
        -------
        A, B, D : numpy.ndarray, shape (3, 3)
        """
        bulk = [self._moment(p, lambda l: 1.0 / (1.0 - l.poisson_ratio)) for p in range(3)]
        shear = [self._moment(p, lambda l: 1.0 / (1.0 + l.poisson_ratio)) for p in range(3)]
        # sigma = E/(1 - nu) * mean strain * 1 + E/(1 + nu) * deviator
        mean = np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 0.0]])
        deviator = np.array([[0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 0.5]])
        a, b, d = (k * mean + g * deviator for k, g in zip(bulk, shear, strict=True))
        return a, b, d

    def spontaneous(self, temperature: float | Callable[[Array], Array]) -> SpontaneousDeformation:
        r"""Return the spontaneous strain and curvature at a temperature or a temperature profile.

        Poisson ratios may differ from layer to layer: mean strain and deviator have their own
        neutral planes then, and strains are those of the middle plane.

        Parameters
        ----------
        temperature : float or callable
            One temperature; or a function that takes heights, shape (n,), and returns
            temperatures, shape (..., n), such as a profile of a
            :class:`~lissome.plates.TemperatureHistory`. Leading axes (times) stay in the result.

        Returns
        -------
        SpontaneousDeformation

        Raises
        ------
        InvalidInput
            If a temperature is not finite, or outside the range of a measured curve.
        NotConverged
            If the quadrature does not settle, which takes a profile or a curve full of jumps.
        """
        panels = self.interfaces
        if callable(temperature):
            panels = np.union1d(panels, getattr(temperature, "breaks", panels))
            profile = temperature
        else:
            constant = finite("temperature", temperature)
            profile = lambda z: np.full(np.shape(z), constant)  # noqa: E731
        ratios = {layer.poisson_ratio for layer in self.layers}
        uniform = len(ratios) == 1
        bulk = self._channel(lambda l: 1.0 / (1.0 - l.poisson_ratio))
        shear = self._channel(lambda l: 1.0 / (1.0 + l.poisson_ratio))
        plane = bulk[1] if uniform else 0.0

        def integrals(edges: Array) -> tuple[Array, Array]:
            z, weight = _points(edges)
            t = np.asarray(profile(z), dtype=float)
            if t.shape[-1:] != z.shape or not np.isfinite(t).all():
                raise InvalidInput(
                    f"argument `temperature` returns an array of shape {t.shape} for heights of "
                    f"shape {z.shape}, or numbers that are not finite; return one temperature for "
                    "each height on the last axis"
                )
            index = self.layer_at(z)
            modulus = self.modulus_at(z)
            along, across = np.empty(t.shape), np.empty(t.shape)
            nu = np.array([layer.poisson_ratio for layer in self.layers])[index]
            for i, layer in enumerate(self.layers):
                here = index == i
                along[..., here], across[..., here] = layer.spontaneous_strain(t[..., here])
            residual: Any = 0.0
            rows = []
            for part, stiffness, (m0, center, m2) in (
                (0.5 * (along + across), modulus / (1.0 - nu), bulk),
                (0.5 * (along - across), modulus / (1.0 + nu), shear),
            ):
                w = weight * stiffness
                strain = part @ w / m0
                slope = part @ (w * (z - center)) / m2  # strain per height, minus the curvature
                rest = part - strain[..., None] - slope[..., None] * (z - center)
                residual = residual + rest**2 @ w
                rows += [strain + slope * (plane - center), -slope]
            e, k, f, g = rows
            return np.stack([e + f, e - f, k + g, k - g, residual]), _floors(along, across)

        def _floors(along: Array, across: Array) -> Array:
            # What rounding leaves of a quantity that is zero (a symmetric stack, a linear strain).
            size = max(float(np.abs(along).max()), float(np.abs(across).max()))
            bent = size / self.thickness
            return 1e-12 * np.array([size, size, bent, bent, shear[0] * size**2])

        along, across, bent, turned, residual = _refined(
            integrals, panels, getattr(temperature, "accuracy", 0.0)
        )
        return SpontaneousDeformation(along, across, bent, turned, residual, plane)


def _weighted(
    layer: Layer, power: int, bottom: float, center: float = 0.0
) -> Callable[[Array], Array]:
    return lambda z: (z - center) ** power * layer.modulus_at((z - bottom) / layer.thickness)


def _points(edges: Array) -> tuple[Array, Array]:
    """Return Gauss points and weights on the panels between `edges`."""
    half = 0.5 * np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return (middle[:, None] + half[:, None] * _GAUSS_X).ravel(), np.outer(half, _GAUSS_W).ravel()


def _integral(function: Callable[[Array], Array], low: float, high: float) -> Array:
    def value(edges: Array) -> tuple[Array, Array]:
        z, weight = _points(edges)
        values = function(z)
        return np.atleast_1d(values @ weight), np.atleast_1d(1e-15 * (np.abs(values) @ weight))

    return _refined(value, np.array([low, high]))[0]


#: Numbers below it have lost digits: nothing settles to a relative accuracy there.
_LEAST = float(np.finfo(float).tiny / np.finfo(float).eps)


def _refined(
    function: Callable[[Array], tuple[Array, Array]], edges: Array, accuracy: float = 0.0
) -> Array:
    """Return an array of integrals on panels that are halved until it settles.

    The function returns values and floors. The first axis lists quantities of different size: each
    is judged on its own scale, or by the floor that rounding errors set.
    """
    previous, _ = function(edges)
    for tolerance in (1e-11, 1e-11, 1e-11, 1e-10, 1e-9, 1e-9, 1e-8, 1e-8):
        if 2 * edges.size > _MOST_PANELS:
            break
        middle = 0.5 * (edges[1:] + edges[:-1])
        edges = np.sort(np.concatenate([edges, middle]))
        current, floors = function(edges)
        scale = np.abs(current).reshape(len(current), -1).max(axis=1)
        change = np.abs(current - previous).reshape(len(current), -1).max(axis=1)
        allowed = np.maximum(max(tolerance, accuracy) * scale, floors)
        if np.all(change <= np.maximum(allowed, _LEAST)):
            return current
        previous = current
    raise NotConverged(
        f"the quadrature through the thickness does not settle on {edges.size - 1} panels: a modulus, "
        "a strain curve or a temperature profile jumps inside a layer; put a layer boundary there"
    )
