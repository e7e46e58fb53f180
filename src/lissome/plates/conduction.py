r"""Heat through the thickness of a laminate.

.. math:: c\,\partial_t T = \partial_z (k\,\partial_z T), \qquad -h/2 < z < h/2,

with a conductivity k and a heat capacity c of each layer, and one condition on each face. Quadratic
finite elements in z; in time a singly diagonally implicit Runge-Kutta method of order 4 that is
L-stable, with an error estimate (Hairer and Wanner, Solving ordinary differential equations II,
table IV.6.5): a jump of temperature at the start needs no care.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import skfem
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from skfem.helpers import dot, grad

from .._readonly import readonly_property
from .._units import is_quantity, magnitude
from .._validate import finite, finite_array, integer_at_least, nonnegative
from ..errors import InvalidInput, NotConverged
from .laminate import Laminate

__all__ = [
    "Conduction",
    "Convection",
    "FixedTemperature",
    "HeatFlux",
    "Insulated",
    "TemperatureHistory",
    "TemperatureProfile",
]

Array = NDArray[np.float64]

# SDIRK of order 4, five stages, stiffly accurate, embedded order 3.
_GAMMA = 0.25
_A = np.array(
    [
        [1 / 4, 0, 0, 0, 0],
        [1 / 2, 1 / 4, 0, 0, 0],
        [17 / 50, -1 / 25, 1 / 4, 0, 0],
        [371 / 1360, -137 / 2720, 15 / 544, 1 / 4, 0],
        [25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4],
    ]
)
_ERROR = _A[4] - np.array([59 / 48, -17 / 96, 225 / 32, -85 / 12, 0])
_MOST_STEPS = 20_000


@dataclass(frozen=True)
class FixedTemperature:
    """A face held at a temperature, such as that of a hot plate.

    Parameters
    ----------
    temperature : float, str or pint.Quantity
        A number in the unit of the strain curves, or a quantity, which is read in degrees Celsius.

    Examples
    --------
    >>> from lissome.plates import FixedTemperature
    >>> FixedTemperature("433.15 K").temperature
    160.0
    """

    temperature: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "temperature", _temperature("temperature", self.temperature))


@dataclass(frozen=True)
class HeatFlux:
    """A given flux into the plate through a face.

    Parameters
    ----------
    flux : float
        Energy per area and time; negative where heat leaves.

    Raises
    ------
    InvalidInput
        If the flux is not finite.

    Examples
    --------
    A steady flux needs a slope: conductivity 1 and thickness 1 take a difference of 2 degrees.

    >>> from lissome.plates import Conduction, FixedTemperature, HeatFlux, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> heated = Conduction(sheet, bottom=HeatFlux(2.0), top=FixedTemperature(0.0), initial=0.0)
    >>> print(heated.steady()([-0.5, 0.0, 0.5]).round(9))
    [2. 1. 0.]
    """

    flux: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "flux", finite("flux", self.flux))


@dataclass(frozen=True)
class Convection:
    r"""A face that exchanges heat with its surroundings: flux into the plate H (T_a - T).

    Parameters
    ----------
    coefficient : float
        H, zero or more: energy per area, time and degree. A bad contact with a hot plate is one too.
    ambient : float, str or pint.Quantity
        T_a.

    Raises
    ------
    InvalidInput
        If the coefficient is negative, or a number is not finite.

    Examples
    --------
    Half of the difference of temperature is lost at a face that resists as much as the sheet:

    >>> from lissome.plates import Conduction, Convection, FixedTemperature, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> air = Convection(coefficient=1.0, ambient=10.0)
    >>> heated = Conduction(sheet, bottom=air, top=FixedTemperature(0.0), initial=0.0)
    >>> print(heated.steady()([-0.5, 0.0, 0.5]).round(9))
    [5.  2.5 0. ]
    """

    coefficient: float
    ambient: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficient", nonnegative("coefficient", self.coefficient))
        object.__setattr__(self, "ambient", _temperature("ambient", self.ambient))


@dataclass(frozen=True)
class Insulated:
    """A face through which no heat flows.

    Examples
    --------
    >>> from lissome.plates import Conduction, FixedTemperature, Insulated, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> heated = Conduction(sheet, bottom=FixedTemperature(1.0), top=Insulated(), initial=0.0)
    >>> print(heated.steady()([-0.5, 0.5]).round(9), float(heated.run(until=0.01).inflow(0.01)[1]))
    [1. 1.] 0.0
    """


Face = FixedTemperature | HeatFlux | Convection | Insulated


@dataclass(frozen=True, eq=False)
class TemperatureProfile:
    """Temperature over the thickness at one or several times.

    Attributes
    ----------
    nodes : numpy.ndarray, shape (2 n + 1,)
        Heights of the nodes of n quadratic elements.
    values : numpy.ndarray, shape (..., 2 n + 1)
        Temperatures there.
    low, high : float
        Bounds of the exact solution, by the maximum principle (infinite where a flux is given);
        what is returned is cut off there.
    accuracy : float
        Relative accuracy that integrals over the profile are worth: while a jump at a face is
        thinner than the elements, the cut leaves kinks that no quadrature needs to resolve.

    Examples
    --------
    Called with heights from the middle of the thickness, it interpolates:

    >>> from lissome.plates import Conduction, FixedTemperature, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> hot, cold = FixedTemperature(160.0), FixedTemperature(25.0)
    >>> profile = Conduction(sheet, bottom=hot, top=cold, initial=25.0).steady()
    >>> print(profile([-0.5, 0.0, 0.5]).round(9), profile.low, profile.high)
    [160.   92.5  25. ] 25.0 160.0
    """

    nodes: Array
    values: Array
    low: float = -math.inf
    high: float = math.inf
    accuracy: float = 1e-5

    @property
    def breaks(self) -> Array:
        """Ends of the elements, shape (n + 1,): between them the profile is smooth."""
        return self.nodes[::2]

    def __call__(self, z: ArrayLike) -> Array:
        """Return the temperature at heights `z`, shape (n,): shape (..., n)."""
        z = np.asarray(z, dtype=float)
        breaks = self.breaks
        slack = 1e-12 * (breaks[-1] - breaks[0])
        if not np.all((z >= breaks[0] - slack) & (z <= breaks[-1] + slack)):
            raise InvalidInput(
                f"argument `z` holds heights outside the plate, from {breaks[0]:g} to "
                f"{breaks[-1]:g}; heights count from the middle of the thickness"
            )
        e = np.clip(np.searchsorted(breaks, z, side="right") - 1, 0, breaks.size - 2)
        s = (z - breaks[e]) / (breaks[e + 1] - breaks[e])
        left, middle, right = (self.values[..., 2 * e + i] for i in range(3))
        value = (
            left * (1 - s) * (1 - 2 * s) + middle * 4 * s * (1 - s) + right * s * (2 * s - 1)
        )  # fmt: skip
        return np.clip(value, self.low, self.high)


@dataclass(frozen=True, eq=False)
class TemperatureHistory:
    r"""Temperature over the thickness as a function of time.

    Attributes
    ----------
    problem : Conduction
        What was solved.
    times : numpy.ndarray, shape (m,)
        Steps of the integrator, from 0; in the unit of the problem (seconds for SI layers).
    values, rates : numpy.ndarray, shape (m, 2 n + 1)
        Temperatures at the nodes and their rates of change.

    Examples
    --------
    While the heat has not come to the other side, the flux through the hot face is
    :math:`1/\sqrt{\pi t}`:

    >>> import numpy as np
    >>> from lissome.plates import Conduction, FixedTemperature, Insulated, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> heated = Conduction(sheet, bottom=FixedTemperature(1.0), top=Insulated(), initial=0.0)
    >>> bottom, top = heated.run(until=0.01).inflow(0.01)
    >>> print(f"{bottom * np.sqrt(np.pi * 0.01):.3f} {float(top)}")
    1.000 0.0
    """

    problem: Conduction
    times: Array
    values: Array
    rates: Array

    @property
    def scaled_times(self) -> Array:
        """Times over :attr:`Conduction.time_scale`, shape (m,): t D/h^2 for a uniform plate."""
        return self.times / self.problem.time_scale

    def at(self, time: Any) -> TemperatureProfile:
        """Return the profile at one time or at an array of times.

        Parameters
        ----------
        time : float, array_like, str or pint.Quantity
            Between 0 and the last step. Quantities need layers in SI units.

        Returns
        -------
        TemperatureProfile
            With the shape of `time` in front.

        Raises
        ------
        InvalidInput
            If a time lies outside the computed history.
        """
        problem = self.problem
        return TemperatureProfile(
            problem.nodes, self._interpolated(time)[0], problem.bounds[0], problem.bounds[1]
        )

    def heat(self, time: Any) -> Array:
        """Return the heat content per area, counted from temperature zero, of the shape of `time`."""
        return self._interpolated(time)[0] @ self.problem._system.capacity

    def inflow(self, time: Any) -> tuple[Array, Array]:
        """Return the heat flux into the plate through the bottom and the top, each of the shape of `time`.

        Energy per area and time. At fixed faces it is the reaction that balances the heat of the plate
        exactly.
        """
        values, rates = self._interpolated(time)
        system = self.problem._system
        found = []
        for face, node in ((self.problem.bottom, 0), (self.problem.top, -1)):
            if isinstance(face, FixedTemperature):
                mass = np.asarray(system.mass[[node]].todense())[0]
                stiff = np.asarray(system.stiffness[[node]].todense())[0]
                found.append(rates @ mass + values @ stiff)
            elif isinstance(face, Convection):
                found.append(face.coefficient * (face.ambient - values[..., node]))
            else:
                flux = face.flux if isinstance(face, HeatFlux) else 0.0
                found.append(np.full(values.shape[:-1], flux))
        return found[0], found[1]

    def _interpolated(self, time: Any) -> tuple[Array, Array]:
        """Return temperatures and rates by cubic Hermite interpolation between the steps."""
        t = np.asarray(self.problem._time("time", time), dtype=float)
        if not np.all((t >= 0.0) & (t <= self.times[-1])):
            raise InvalidInput(
                f"argument `time` is {time!r}; the history runs from 0 to {self.times[-1]:g}: run it "
                "for longer"
            )
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 2)
        step = (self.times[i + 1] - self.times[i])[..., None]
        s = (t - self.times[i])[..., None] / step
        a, b = self.values[i], self.values[i + 1]
        p, q = step * self.rates[i], step * self.rates[i + 1]
        value = a + s * p + s**2 * (3 * (b - a) - 2 * p - q) + s**3 * (2 * (a - b) + p + q)
        rate = p + 2 * s * (3 * (b - a) - 2 * p - q) + 3 * s**2 * (2 * (a - b) + p + q)
        return value, rate / step


@dataclass(frozen=True)
class Conduction:
    r"""Transient conduction through the thickness of a laminate.

    Parameters
    ----------
    laminate : Laminate
        Its layers give thickness, conductivity and heat capacity. With plain numbers and the
        defaults time counts in thickness squared over diffusivity of a sheet of thickness 1; with
        layers in SI units it is in seconds.
    bottom, top : FixedTemperature, HeatFlux, Convection or Insulated
        Conditions on the faces.
    initial : float, str, pint.Quantity or callable
        Temperature at the start; or a function of the height from the middle of the thickness,
        such as a profile of an earlier run.
    elements : int
        Quadratic elements in each layer, at least 2; they are smaller near its faces.

    Raises
    ------
    InvalidInput
        If a face is none of the four conditions or a number is not finite.

    Examples
    --------
    A sheet on a hot plate, insulated above: the top is half as hot after 0.38 h^2/D.

    >>> from lissome.plates import Conduction, FixedTemperature, Insulated, Laminate, Layer
    >>> sheet = Laminate([Layer(thickness=1.0, modulus=1.0, poisson_ratio=0.5)])
    >>> heating = Conduction(sheet, bottom=FixedTemperature(1.0), top=Insulated(), initial=0.0)
    >>> history = heating.run(until=1.0)
    >>> print(f"{history.at(0.379)([0.5])[0]:.3f}")
    0.500
    """

    laminate: Laminate
    bottom: Face
    top: Face
    initial: float | Callable[[Array], ArrayLike]
    elements: int = 24

    def __post_init__(self) -> None:
        if not isinstance(self.laminate, Laminate):
            raise InvalidInput(f"argument `laminate` is {self.laminate!r}; pass a Laminate")
        for name, face in (("bottom", self.bottom), ("top", self.top)):
            if not isinstance(face, (FixedTemperature, HeatFlux, Convection, Insulated)):
                raise InvalidInput(
                    f"argument `{name}` is {face!r}; pass a FixedTemperature, a HeatFlux, a "
                    "Convection or Insulated()"
                )
        if not callable(self.initial):
            object.__setattr__(self, "initial", _temperature("initial", self.initial))
        object.__setattr__(self, "elements", integer_at_least("elements", self.elements, 2))

    @property
    def time_scale(self) -> float:
        r"""Heat capacity times thermal resistance of the stack: h^2/D for a uniform one."""
        layers = self.laminate.layers
        capacity = math.fsum(layer.thickness * layer.heat_capacity for layer in layers)
        return capacity * math.fsum(layer.thickness / layer.conductivity for layer in layers)

    @readonly_property
    def nodes(self) -> Array:
        """Heights of the nodes, increasing, shape (2 n + 1,): ends and middles of n elements."""
        spread = 0.5 - 0.5 * np.cos(np.pi * np.arange(self.elements + 1) / self.elements)
        interfaces = self.laminate.interfaces
        ends = [
            interfaces[i] + spread[:-1] * (interfaces[i + 1] - interfaces[i])
            for i in range(len(interfaces) - 1)
        ]
        ends.append(interfaces[-1:])
        breaks = np.concatenate(ends)
        nodes = np.empty(2 * breaks.size - 1)
        nodes[::2] = breaks
        nodes[1::2] = 0.5 * (breaks[1:] + breaks[:-1])
        nodes.setflags(write=False)
        return nodes

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Least and greatest temperature that the exact solution can have."""
        if isinstance(self.bottom, HeatFlux) or isinstance(self.top, HeatFlux):
            return -math.inf, math.inf
        z = np.union1d(self.nodes, self._system.points.ravel())
        known = list(self._start(z))
        for face in (self.bottom, self.top):
            if isinstance(face, FixedTemperature):
                known.append(face.temperature)
            elif isinstance(face, Convection) and face.coefficient > 0.0:
                known.append(face.ambient)
        return min(known), max(known)

    def _start(self, z: Array) -> Array:
        if not callable(self.initial):
            return np.full(z.shape, self.initial)
        values = np.asarray(self.initial(z.ravel()), dtype=float)
        if values.shape != (z.size,) or not np.isfinite(values).all():
            raise InvalidInput(
                f"argument `initial` returns an array of shape {values.shape} for heights of shape "
                f"{(z.size,)}, or numbers that are not finite; return one temperature for each height"
            )
        return values.reshape(z.shape)

    def _time(self, name: str, value: Any) -> Any:
        if not is_quantity(value):
            return finite_array(name, value)
        if not self.laminate.layers[0].physical:
            raise InvalidInput(
                f"argument `{name}` is {value!s}; the layers have no units (make them with Layer.of), "
                "so pass a number"
            )
        return magnitude(name, value, "s", "2 s")

    @cached_property
    def _system(self) -> _System:
        return _System(self)

    def steady(self) -> TemperatureProfile:
        """Return the profile after a long time.

        Raises
        ------
        InvalidInput
            If there is none: given fluxes that do not cancel, and no face that answers.
        """
        system = self._system
        low, high = self.bounds
        if system.grounded:
            values = system.boundary.copy()
            free = ~system.fixed
            k = system.stiffness.toarray()
            right = system.load - k @ values
            values[free] = np.linalg.solve(k[np.ix_(free, free)], right[free])
            return TemperatureProfile(self.nodes, values, low, high)
        net = float(system.load.sum())
        if abs(net) > 1e-12 * float(np.abs(system.load).sum()):
            raise InvalidInput(
                f"arguments `bottom` and `top` let a net flux of {net:g} into the plate for ever, so "
                "that there is no steady state; hold a face at a temperature, or let it exchange heat"
            )
        n = self.nodes.size
        bordered = np.zeros((n + 1, n + 1))
        bordered[:n, :n] = system.stiffness.toarray()
        bordered[:n, n] = bordered[n, :n] = system.capacity
        right = np.append(system.load, system.initial_heat)
        return TemperatureProfile(self.nodes, np.linalg.solve(bordered, right)[:n], low, high)

    def run(self, until: Any, *, rtol: float = 1e-7) -> TemperatureHistory:
        """Return the temperature from time 0 on.

        Parameters
        ----------
        until : float, str or pint.Quantity
            Last time. Quantities need layers in SI units.
        rtol : float
            Error that one step may make, relative to the range of temperatures of the problem, in
            [1e-12, 1e-2].

        Returns
        -------
        TemperatureHistory

        Raises
        ------
        InvalidInput
            If `until` is not positive, or `rtol` out of its range.
        NotConverged
            If the steps become too many.
        """
        end = finite("until", self._time("until", until))
        if end <= 0.0:
            raise InvalidInput(f"argument `until` is {until!r}; it must be greater than 0")
        tolerance = finite("rtol", rtol)
        if not 1e-12 <= tolerance <= 1e-2:
            raise InvalidInput(f"argument `rtol` is {rtol!r}; it must lie in [1e-12, 1e-2]")
        system = self._system
        u = system.start()
        rate = system.rate(u)
        size = float(np.ptp(np.append(u, system.answers)))
        size += float(np.abs(system.load_flux).sum()) * self._resistance
        # The floor stands for rounding errors, where the plate starts at its final temperature.
        scale = max(size, 1e-6 * float(np.abs(np.append(u, system.answers)).max())) or 1.0
        times, values, rates = [0.0], [u], [rate]
        step = min(2.0**-20 * self.time_scale, end)
        while times[-1] < end:
            if len(times) > _MOST_STEPS:
                raise NotConverged(
                    f"{_MOST_STEPS} steps reach time {times[-1]:g} of {end:g}; use a larger `rtol`",
                    state=u,
                )
            last = times[-1] + step >= end * (1.0 - 1e-14)
            taken = end - times[-1] if last else step
            new, rate, error = system.step(u, taken)
            excess = float(np.sqrt(error @ (system.mass @ error) / system.capacity.sum()))
            ratio = excess / (tolerance * scale)
            if ratio > 1.0 and taken > 1e-15 * self.time_scale:
                step = taken * max(0.125, 2.0 ** math.floor(math.log2(0.9 * ratio**-0.25)))
                continue
            u = new
            times.append(end if last else times[-1] + taken)
            values.append(u)
            rates.append(rate)
            if not last and 0.9 * max(ratio, 1e-16) ** -0.25 >= 2.0:
                step *= 2.0  # in powers of two, so that a factorization serves for many steps
        return TemperatureHistory(self, np.array(times), np.array(values), np.array(rates))

    @property
    def _resistance(self) -> float:
        layers = self.laminate.layers
        return math.fsum(layer.thickness / layer.conductivity for layer in layers)


class _System:
    """Matrices of the semi-discrete problem M u' + K u = f, in the order of the nodes."""

    def __init__(self, problem: Conduction) -> None:
        self.factors: dict[float, Any] = {}
        laminate, nodes = problem.laminate, problem.nodes
        mesh = skfem.MeshLine(nodes[::2])
        basis = skfem.Basis(mesh, skfem.ElementLineP2(), intorder=8)
        layer = np.repeat(np.arange(len(laminate.layers)), problem.elements)
        conductivity, capacity = (
            np.array([getattr(l, name) for l in laminate.layers])[layer][:, None]
            * np.ones(basis.dx.shape)
            for name in ("conductivity", "heat_capacity")
        )
        order = np.argsort(basis.doflocs[0])

        def matrix(form: Any, factor: Array) -> Any:
            return skfem.BilinearForm(form).assemble(basis, factor=factor).tocsr()[order][:, order]

        self.mass = matrix(lambda u, v, w: w.factor * u * v, capacity)
        self.stiffness = matrix(lambda u, v, w: w.factor * dot(grad(u), grad(v)), conductivity)
        self.capacity = np.asarray(self.mass.sum(axis=0)).ravel()  # integral of c times shapes
        self.points = np.asarray(basis.global_coordinates())[0]
        start = problem._start(self.points)
        project = skfem.LinearForm(lambda v, w: w.capacity * w.start * v)
        self.projected = project.assemble(basis, capacity=capacity, start=start)[order]
        self.initial_heat = float(self.projected.sum())

        n = nodes.size
        self.load, self.load_flux = np.zeros(n), np.zeros(n)
        self.boundary, self.fixed = np.zeros(n), np.zeros(n, dtype=bool)
        self.grounded = False
        answers = []
        for face, node in ((problem.bottom, 0), (problem.top, n - 1)):
            if isinstance(face, FixedTemperature):
                self.fixed[node], self.boundary[node] = True, face.temperature
                answers.append(face.temperature)
                self.grounded = True
            elif isinstance(face, HeatFlux):
                self.load[node] += face.flux
                self.load_flux[node] += face.flux
            elif isinstance(face, Convection) and face.coefficient > 0.0:
                self.stiffness[node, node] += face.coefficient
                self.load[node] += face.coefficient * face.ambient
                answers.append(face.ambient)
                self.grounded = True
        self.answers = np.array(answers)
        self.free = np.flatnonzero(~self.fixed)
        self.inner_mass = self.mass[self.free][:, self.free].tocsr()
        self.inner_stiffness = self.stiffness[self.free][:, self.free].tocsr()
        # Fixed temperatures do not change in time: they only load the inner nodes.
        self.inner_load = (self.load - self.stiffness @ self.boundary)[self.free]

    def solve(self, shift: float, right: Array) -> Array:
        """Solve (M + shift K) x = right on the inner nodes."""
        if shift not in self.factors:
            matrix = self.inner_mass + shift * self.inner_stiffness
            band = np.zeros((3, self.free.size))
            for k in range(3):
                band[2 - k, k:] = matrix.diagonal(k)
            self.factors[shift] = cholesky_banded(band, check_finite=True)
        return cho_solve_banded((self.factors[shift], False), right)

    def start(self) -> Array:
        """Return the start, projected with respect to heat: its heat content is exact."""
        u = self.boundary.copy()
        u[self.free] = self.solve(0.0, (self.projected - self.mass @ u)[self.free])
        return u

    def rate(self, u: Array) -> Array:
        rate = np.zeros_like(u)
        right = self.inner_load - self.inner_stiffness @ u[self.free]
        rate[self.free] = self.solve(0.0, right)
        return rate

    def step(self, u: Array, dt: float) -> tuple[Array, Array, Array]:
        """Return the next temperatures, their rates, and an estimate of the error."""
        inner = u[self.free]
        stages = np.empty((5, inner.size))
        for i in range(5):
            known = inner + dt * (_A[i, :i] @ stages[:i])
            right = self.inner_load - self.inner_stiffness @ known
            stages[i] = self.solve(_GAMMA * dt, right)
        new, rate, error = u.copy(), np.zeros_like(u), np.zeros_like(u)
        new[self.free] = inner + dt * (_A[4] @ stages)
        rate[self.free] = stages[4]  # stiffly accurate: the last stage is the end of the step
        raw = dt * (_ERROR @ stages)
        # Filtered, so that components which have long decayed do not hold the step back.
        error[self.free] = self.solve(_GAMMA * dt, self.inner_mass @ raw)
        return new, rate, error


def _temperature(name: str, value: Any) -> float:
    if is_quantity(value):
        return magnitude(name, value, "degC", "160 degC")
    return finite(name, value)
