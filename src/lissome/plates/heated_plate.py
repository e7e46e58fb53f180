r"""A plate that deforms while heat passes through it: heat and mechanics in one run.

Heat does not wait for the shape, and inertia waits for neither: at each instant the plate is at a
stable equilibrium with the spontaneous strain and curvature of that instant, until it snaps.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from .._validate import finite, finite_array, integer_at_least, positive
from ..equilibrium import Equilibrium, equilibrate
from ..errors import InvalidInput
from ..evolution import History, Outputs
from ._quasistatic import PlateRun
from .conduction import TemperatureHistory
from .directors import Defect, Director, require_inside
from .laminate import Laminate, SpontaneousDeformation
from .plate import Plate, PlateState

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

    def spontaneous(self, time: float) -> SpontaneousDeformation:
        """Return what the laminate would do at `time` if nothing held it.

        Raises
        ------
        InvalidInput
            If `time` lies outside the history of temperature.
        """
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

    @property
    def last(self) -> float:
        """The last scaled time of the history of temperature."""
        return float(self.temperature.times[-1] / self.temperature.problem.time_scale)

    def run(
        self,
        until: float,
        step: float,
        *,
        start: float | None = None,
        initial: Equilibrium | PlateState | None = None,
        report_at: ArrayLike | None = None,
        outputs: Outputs | None = None,
        stop_when: Callable[[float, Any, Equilibrium], str | None] | None = None,
        sign: int = 1,
        time_tolerance: float | None = None,
        max_change: float = 0.25,
        max_steps: int = 100_000,
        checkpoint: str | os.PathLike[str] | None = None,
        progress: bool | None = None,
    ) -> History:
        """Follow the plate in time, through its bifurcations and snaps.

        Parameters
        ----------
        until : float
            Last scaled time, within the history of temperature.
        step : float
            Scaled time step, at most.
        start : float, optional
            First scaled time, at which the equilibrium near the flat plate is taken; `step` by
            default. Before heat has come in the flat plate is all there is.
        initial : Equilibrium or PlateState, optional
            From where to look for that first equilibrium, instead of the flat plate.
        report_at, outputs, stop_when, max_steps, progress
            See :func:`lissome.evolve`.
        sign : int
            +1 or -1: side of the critical mode that is tried first where a symmetry is lost.
        time_tolerance : float, optional
            Length of the bracket of an event; by default 1e-4 of `step`.
        max_change : float
            Largest change of an unknown (relative to its typical size) in a step.
        checkpoint : path, optional
            File to which the history is written after every step, all or nothing. If it is there
            already, the run goes on from its end: an interrupted run loses nothing.

        Returns
        -------
        History
            Of :class:`.PlateEquilibrium`. Its ``events`` are of the kind "snap", with the energy
            released, or "loss of symmetry": a bifurcation from which the stable states depart
            gradually. Beyond one the run goes on a little later (2 % of `step` or more), where they
            can be told apart; a time of `report_at` in between has no row.

        Raises
        ------
        InvalidInput
            If a time lies outside the history of temperature, or the checkpoint is that of another
            run.
        EvolutionInterrupted
            If the plate cannot be followed; what was found is attached.
        DataError
            If the checkpoint is damaged, or its states are no equilibria of this plate.
        """
        first = positive("step", step) if start is None else positive("start", start)
        if not first < finite("until", until) <= self.last * (1.0 + 1e-12):
            raise InvalidInput(
                f"argument `until` is {until!r}; it must lie in ({first:g}, {self.last:g}]: after the "
                "first time, and within the history of temperature"
            )
        earlier: History | None = None
        if checkpoint is not None and os.path.exists(checkpoint):
            earlier = History.load(checkpoint, self, 0.0)
            if set(earlier.values) != set(outputs or {}):
                raise InvalidInput(
                    f"argument `checkpoint`: {checkpoint} holds the outputs {sorted(earlier.values)}; "
                    f"this run has {sorted(outputs or {})}"
                )
            if abs(float(earlier.times[0]) - first) > 1e-12:
                raise InvalidInput(
                    f"argument `checkpoint`: {checkpoint} holds a run that begins at "
                    f"{earlier.times[0]:.10g}, not at {first:.10g}; name another file, or delete it"
                )
            if earlier.time >= until:
                return earlier
            first, begin = earlier.time, earlier.equilibrium
        else:
            plate = self.structure(first)
            guess = initial.state if isinstance(initial, Equilibrium) else initial
            begin = equilibrate(plate, guess, require="stable")
        run = PlateRun(
            evolving=self, until=float(until), step=positive("step", step),
            outputs=dict(outputs or {}), corrections=0, tolerance=None,
            time_tolerance=(
                1e-4 * step if time_tolerance is None else positive("time_tolerance", time_tolerance)
            ),
            max_change=positive("max_change", max_change), sign=sign, stop_when=stop_when,
            max_steps=integer_at_least("max_steps", max_steps, 1),
            reports=None if report_at is None else _within(report_at, first, earlier),
            march=None, checkpoint=checkpoint, earlier=earlier,
        )  # fmt: skip
        run.begin(first, begin, first)
        history = run.run(progress)
        return history if earlier is None else earlier.joined(history)


def _within(report_at: ArrayLike, first: float, earlier: History | None) -> Any:
    times = finite_array("report_at", report_at, (None,))
    return times if earlier is None else times[times >= first]
