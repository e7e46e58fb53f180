r"""A plate that deforms while heat passes through it: heat and mechanics in one run.

Heat does not wait for the shape, and inertia waits for neither: at each instant the plate is at a
stable equilibrium with the spontaneous strain and curvature of that instant, until it snaps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .._validate import finite, positive
from ..equilibrium import equilibrate
from ..errors import InvalidInput
from ..evolution import History, evolve
from .directors import Defect, Director, require_inside
from .fvk import Plate
from .heat import TemperatureHistory
from .laminate import Laminate, Spontaneous

__all__ = ["HeatedPlate"]


@dataclass(frozen=True, eq=False)
class HeatedPlate:
    r"""A plate of a laminate through which heat passes.

    Time is scaled, t over the time scale of the heat problem (t D/h^2 where all layers conduct
    alike); lengths in the plane are in units of `length`, energies in units of :math:`C L^2`, (5.9)
    of the thesis.

    Parameters
    ----------
    mesh : skfem.MeshTri or skfem.MeshTri2
        The plate, in units of `length`.
    laminate : Laminate
        The stack through its thickness; it must be that of the heat problem, or conduct alike.
    director : Director
        Direction of the mesogens, at all heights; a defect must lie on the plate.
    temperature : TemperatureHistory
        What heats it.
    length : float
        Unit of length of the mesh, in that of the thicknesses of the laminate.
    edges, degree
        See :class:`.Plate`.

    Raises
    ------
    InvalidInput
        If a defect lies outside of the plate, or an argument is of the wrong kind.

    Examples
    --------
    One active film, heated from below: the square becomes a dome, whose center is high.

    >>> import numpy as np
    >>> from lissome import plates
    >>> from lissome.plates import meshes
    >>> film = plates.SigmoidCurve(saturation=0.01, transition=100.0, width=10.0)
    >>> sheet = plates.Laminate([plates.Layer(0.05, 1.0, 0.5, strain=film)])
    >>> hot, free = plates.FixedTemperature(160.0), plates.Insulated()
    >>> heat = plates.Conduction(sheet, bottom=hot, top=free, initial=25.0)
    >>> heated = plates.HeatedPlate(
    ...     meshes.rectangle(divisions=3), sheet, plates.Defect(), heat.run(until=heat.time_scale)
    ... )
    >>> history = heated.run(until=0.1, step=0.02)
    >>> w = history.equilibrium.deflection
    >>> bool(w[np.argmin(np.hypot(*heated.mesh.p))] > w.max() - 1e-9)
    True
    """

    mesh: Any
    laminate: Laminate
    director: Director
    temperature: TemperatureHistory
    length: float = 1.0
    edges: Any = "free"
    degree: int = 2

    def __post_init__(self) -> None:
        for name, kind in (
            ("laminate", Laminate),
            ("director", Director),
            ("temperature", TemperatureHistory),
        ):
            if not isinstance(getattr(self, name), kind):
                raise InvalidInput(
                    f"argument `{name}` is {getattr(self, name)!r}; pass a {kind.__name__}"
                )
        object.__setattr__(self, "length", positive("length", self.length))
        if isinstance(self.director, Defect):
            require_inside(self.director, self.mesh)
        heated = self.temperature.problem.laminate
        if [(l.thickness, l.conductivity, l.heat_capacity) for l in heated.layers] != [
            (l.thickness, l.conductivity, l.heat_capacity) for l in self.laminate.layers
        ]:
            raise InvalidInput(
                "argument `temperature` was computed for a laminate of other thicknesses, "
                "conductivities or heat capacities; solve the heat problem of this laminate"
            )

    @cached_property
    def plate(self) -> Plate:
        """The plate when cold, without spontaneous strain and curvature."""
        moduli: dict[str, Any] = {**self.laminate.moduli(self.length)}
        return Plate(mesh=self.mesh, edges=self.edges, degree=self.degree, **moduli)

    def spontaneous(self, time: float) -> Spontaneous:
        """Return spontaneous strain and curvature at a scaled time (curvature per thickness unit)."""
        scale = self.temperature.problem.time_scale
        last = float(self.temperature.times[-1])
        t = finite("time", time) * scale
        if last < t <= last * (1.0 + 1e-12):  # scaling to and fro may pass the end by a rounding
            t = last
        return self.laminate.spontaneous(self.temperature.at(t))

    def structure(self, memory: float) -> Plate:
        """Return the plate at a scaled time; a parameter that :func:`lissome.follow` can move too."""
        return self.plate.with_(**self.spontaneous(memory).fields(self.director, self.length))

    def advance(self, memory: float, time: float, step: float, before: Any, after: Any) -> float:
        """Return the time one step later: what the heat does is known beforehand."""
        return memory + step

    def run(
        self,
        until: float,
        step: float,
        *,
        start: float | None = None,
        **options: Any,
    ) -> History:
        """Follow the plate in time, through its snaps.

        Parameters
        ----------
        until : float
            Last scaled time, within the history of temperature.
        step : float
            Scaled time step.
        start : float, optional
            First scaled time, at which the equilibrium near the flat plate is taken; `step` by
            default. Before heat has come in the flat plate is all there is.
        **options
            Any of `report_at`, `outputs`, `stop_when`, `sign`, `time_tolerance`, `max_change` and
            `max_steps` of :func:`lissome.evolve`.

        Returns
        -------
        History
            Of :class:`.PlateEquilibrium`; its snaps are in ``events``, with the energy released.

        Raises
        ------
        InvalidInput
            If a time lies outside the history of temperature, or an option is unknown.
        EvolutionInterrupted
            If the plate cannot be followed; what was found is attached. It happens to thin plates of
            perfect symmetry, which lose it at gentle bifurcations: the states beyond can hardly be
            told apart.
        """
        known = {
            "report_at", "outputs", "stop_when", "sign", "time_tolerance", "max_change", "max_steps",
        }  # fmt: skip
        if set(options) - known:
            raise InvalidInput(
                f"unknown options {sorted(set(options) - known)}; known are {sorted(known)}"
            )
        first = positive("step", step) if start is None else positive("start", start)
        end = float(self.temperature.times[-1] / self.temperature.problem.time_scale)
        if not first < finite("until", until) <= end * (1.0 + 1e-12):
            raise InvalidInput(
                f"argument `until` is {until!r}; it must lie in ({first:g}, {end:g}]: after the first "
                "time, and within the history of temperature"
            )
        return evolve(
            self,
            first,
            equilibrate(self.structure(first)),
            until,
            step,
            time=first,
            corrections=0,
            **options,
        )
