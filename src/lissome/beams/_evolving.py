"""A strip under light as the general :func:`lissome.evolve` sees it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..equilibrium import Equilibrium
from ..errors import InvalidInput
from ..evolution import Marched
from . import _kernel
from ._motion import Motion, Runner, flux_target
from ._structures import ClampedStrip, ElasticaState
from .light import Light

__all__ = ["LitStrip"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LitStrip:
    """A strip under light, for :func:`lissome.evolve`: the memory is the natural curvature.

    :meth:`lissome.beams.Motion.run` is faster, since it also locates and follows snaps by itself, and
    keeps its order up to them. This class leaves both to the general evolution: a second opinion, and
    a way to give a strip the options of :func:`lissome.evolve`.

    Parameters
    ----------
    strip : ClampedStrip
        The strip.
    light : ParallelLight, GaussianSpot or UserLight
        The light.

    Raises
    ------
    InvalidInput
        If the two are not of these kinds.

    Examples
    --------
    >>> import lissome as ls
    >>> from lissome.beams import ClampedStrip, LitStrip, ParallelLight
    >>> lit = LitStrip(ClampedStrip(span=0.95, segments=50), ParallelLight(10.0, angle=0.8))
    >>> start = ls.equilibrate(lit.strip)
    >>> history = ls.evolve(lit, lit.strip.rest_curvature, start, until=1.2, step=0.01)
    >>> [event.kind for event in history.events]
    ['snap']
    """

    strip: ClampedStrip
    light: Light

    def __post_init__(self) -> None:
        Motion(self.strip, self.light)  # checks both
        if not isinstance(self.strip, ClampedStrip):
            raise InvalidInput(
                f"argument `strip` is of type {type(self.strip).__name__}; pass a ClampedStrip (the "
                "contact of a ring remembers where it was: use `Ring.under`)"
            )

    def structure(self, memory: Array) -> ClampedStrip:
        """Return the strip with the natural curvature `memory`."""
        strip: ClampedStrip = self.strip.with_curvature(memory)
        return strip

    def _target(self, equilibrium: Equilibrium, time: float) -> Array:
        return flux_target(self.strip, self.light, equilibrium.state.angles, time)

    def advance(
        self, memory: Array, time: float, step: float, before: Equilibrium, after: Equilibrium
    ) -> Array:
        """Return the natural curvature one step later, by the exponential scheme.

        Of first order if `after` is `before`; of second order if it is the equilibrium at the end.
        """
        target = self._target(before, time)
        a = -math.expm1(-step)
        predicted = memory + a * (target - memory)
        if after is before:
            return predicted
        return predicted + (1.0 - a / step) * (self._target(after, time + step) - target)

    def march(
        self, memory: Array, equilibrium: Equilibrium, time: float, until: float, step: float
    ) -> Marched:
        """Advance by compiled steps until a step is not accepted.

        Parameters
        ----------
        memory : ndarray, shape (segments,)
            The natural curvature.
        equilibrium : Equilibrium
            The shape that goes with it.
        time, until, step : float
            From when, to when, and how long a step is (relaxation times).
        """
        runner = Runner(
            self.strip,
            self.light,
            _kernel.EXPONENTIAL_2,
            step,
            equilibrium.state.angles,
            memory,
            time,
            resolution=math.inf,
            bending=math.inf,
        )
        runner.multipliers[:] = equilibrium.multipliers
        reason, _ = runner.advance(until, 0, runner.empty_table())
        return Marched(
            time=runner.time,
            memory=runner.curvature,
            state=ElasticaState(runner.angles),
            multipliers=runner.multipliers,
            reason="until" if reason == _kernel.DONE else "a step was not accepted",
            steps=int(runner.clock[_kernel.STEPS]),
        )
