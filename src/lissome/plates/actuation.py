"""Spontaneous strain and curvature of a laminate while heat passes through it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from .._validate import finite_array, one_of
from ..errors import InvalidInput
from .conduction import TemperatureHistory
from .laminate import Laminate, SpontaneousDeformation

__all__ = ["SpontaneousHistory", "spontaneous_history"]

Array = NDArray[np.float64]
_AT_ONCE = 64  # times evaluated together, which bounds the memory of the quadrature
_COMPONENTS = ("along", "across", "difference")


@dataclass(frozen=True, eq=False)
class SpontaneousHistory:
    r"""What a laminate would do if nothing held it, as a function of time.

    Attributes
    ----------
    laminate : Laminate
        The stack.
    temperature : TemperatureHistory
        What heats it.
    times : numpy.ndarray, shape (m,)
        Increasing times.
    values : SpontaneousDeformation
        With arrays of shape (m,).

    Examples
    --------
    An even sheet curves while one side alone is hot, and ends flat, shortened throughout:

    >>> from lissome import plates
    >>> film = plates.SigmoidCurve(saturation=0.2, transition=100.0, width=10.0)
    >>> sheet = plates.Laminate([plates.Layer(1.0, 1.0, 0.5, strain=film)])
    >>> hot, free = plates.FixedTemperature(160.0), plates.Insulated()
    >>> heat = plates.Conduction(sheet, bottom=hot, top=free, initial=25.0).run(until=4.0)
    >>> history = plates.spontaneous_history(sheet, heat, times=[0.01, 0.1, 4.0])
    >>> print(abs(history.curvature()).argmax(), f"{history.limit().strain_along:.3f}")
    1 -0.199
    """

    laminate: Laminate
    temperature: TemperatureHistory
    times: Array
    values: SpontaneousDeformation

    @property
    def scaled_times(self) -> Array:
        """Times over the time scale of the heat problem, shape (m,): t D/h^2 for one diffusivity."""
        return self.times / self.temperature.problem.time_scale

    def at(self, time: Any) -> SpontaneousDeformation:
        """Return strain and curvature at a time within the history of temperature."""
        return self.laminate.spontaneous(self.temperature.at(time))

    def limit(self) -> SpontaneousDeformation:
        """Return strain and curvature in the steady state of the heat problem.

        Raises
        ------
        InvalidInput
            If heat flows in for ever.
        """
        return self.laminate.spontaneous(self.temperature.problem.steady())

    def curvature(self, component: str = "along") -> Array:
        """Return the spontaneous curvature, shape (m,).

        Parameters
        ----------
        component : {"along", "across", "difference"}
            Along or across the director, or across minus along.

        Raises
        ------
        InvalidInput
            If `component` is none of these.
        """
        return _curvature(self.values, one_of("component", component, _COMPONENTS))

    def curvature_zeros(self, component: str = "along") -> Array:
        r"""Return the times t > 0 at which the spontaneous curvature changes its sign.

        Parameters
        ----------
        component : {"along", "across", "difference"}
            Which curvature; difference means across minus along.

        Returns
        -------
        numpy.ndarray
            Increasing. A curvature of less than 1e-9 of the greatest one counts as none, so that
            rounding errors of a sheet still cold are no changes of sign.

        Raises
        ------
        InvalidInput
            If `component` is none of these.
        """
        one_of("component", component, _COMPONENTS)
        values = self.curvature(component)
        sure = np.flatnonzero(np.abs(values) > 1e-9 * np.abs(values).max())
        zeros = []
        for i, j in zip(sure[:-1], sure[1:], strict=True):
            if values[i] * values[j] < 0.0:
                zeros.append(
                    brentq(
                        lambda t: float(_curvature(self.at(t), component)),
                        self.times[i],
                        self.times[j],
                        xtol=1e-10 * (self.times[j] - self.times[i]),  # times may be in seconds
                        rtol=1e-10,
                    )
                )
        return np.array(zeros)


def _curvature(values: SpontaneousDeformation, component: str) -> Array:
    return np.asarray(getattr(values, f"curvature_{component}"))


def spontaneous_history(
    laminate: Laminate, temperature: TemperatureHistory, times: ArrayLike | None = None
) -> SpontaneousHistory:
    """Return spontaneous strain and curvature as heat passes through a laminate.

    Parameters
    ----------
    laminate : Laminate
        The stack: that of the heat problem, or one that conducts alike and differs in its moduli
        and strains only.
    temperature : TemperatureHistory
        Result of :meth:`Conduction.run`.
    times : array_like, shape (m,), optional
        Strictly increasing times within the history; by default the steps of its integrator, which
        are dense where the temperature changes fast.

    Returns
    -------
    SpontaneousHistory

    Raises
    ------
    InvalidInput
        If the laminate is not one that the temperature belongs to, or the times do not increase.

    Examples
    --------
    A sheet that contracts, evenly stiff: it domes while its bottom alone is hot, and ends flat.

    >>> from lissome import plates
    >>> film = plates.SigmoidCurve(saturation=0.2, transition=100.0, width=10.0)
    >>> sheet = plates.Laminate([plates.Layer(1.0, 1.0, 0.5, strain=film)])
    >>> hot, free = plates.FixedTemperature(160.0), plates.Insulated()
    >>> heat = plates.Conduction(sheet, bottom=hot, top=free, initial=25.0).run(until=4.0)
    >>> history = plates.spontaneous_history(sheet, heat)
    >>> print(f"{history.at(0.05).curvature_along:.3f} {abs(history.limit().curvature_along):.3f}")
    -0.180 0.000
    """
    if not isinstance(laminate, Laminate):
        raise InvalidInput(f"argument `laminate` is {laminate!r}; pass a Laminate")
    if not isinstance(temperature, TemperatureHistory):
        raise InvalidInput(
            f"argument `temperature` is {temperature!r}; pass what Conduction.run returned"
        )
    heated = temperature.problem.laminate
    if _thermal(laminate) != _thermal(heated):
        raise InvalidInput(
            "argument `temperature` was computed for a laminate of other thicknesses, conductivities "
            "or heat capacities; solve the heat problem of this laminate"
        )
    if times is None:
        chosen = temperature.times
    else:
        chosen = finite_array("times", times, (None,))
        if chosen.size < 1 or not (np.diff(chosen) > 0.0).all():
            raise InvalidInput("argument `times` must hold strictly increasing times")
    parts = [
        laminate.spontaneous(temperature.at(chosen[i : i + _AT_ONCE]))
        for i in range(0, chosen.size, _AT_ONCE)
    ]
    columns: dict[str, Any] = {
        item.name: np.concatenate([getattr(part, item.name) for part in parts])
        for item in fields(SpontaneousDeformation)
        if item.name != "plane"
    }
    values = SpontaneousDeformation(plane=parts[0].plane, **columns)
    return SpontaneousHistory(laminate, temperature, chosen, values)


def _thermal(laminate: Laminate) -> list[tuple[float, float, float]]:
    return [(l.thickness, l.conductivity, l.heat_capacity) for l in laminate.layers]
