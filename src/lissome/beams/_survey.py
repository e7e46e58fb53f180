"""Does a strip flap, and how fast; when does it snap: answers without a recorded history."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._validate import integer_at_least, one_of, positive
from ..errors import InvalidInput
from . import _kernel
from ._motion import DEFAULT_STEP, PERIOD_MEMORY, SCHEMES, ElasticaSnap, Motion, Runner, period_of
from ._structures import ClampedStrip
from .light import Light

__all__ = ["FirstSnap", "Flapping", "first_snap", "flapping"]


@dataclass(frozen=True)
class Flapping:
    r"""Whether a strip flaps.

    Attributes
    ----------
    flaps : bool or None
        None: undecided until the time limit.
    frequency, period : float
        Of the limit cycle; frequency 0 and period infinite at rest; NaN if undecided.
    uncertainty : float
        Of the period: its change over the last cycle (not the error of the time step).
    snaps_per_cycle : int
        0 at rest.
    snaps_seen : int
        Snaps until the end of the run.
    time : float
        Time that was run.
    rate : float
        Largest rate of change of the natural curvature at the end: how close to rest.
    smallest_eigenvalue : float
        Smallest eigenvalue of the second variation at the end.

    Examples
    --------
    The window of :math:`\Lambda` has a lower end: a weak light bends a strip, a stronger one makes it
    flap, with two snaps per cycle.

    >>> import numpy as np
    >>> from lissome.beams import ClampedStrip, ParallelLight, flapping
    >>> strip = ClampedStrip(span=0.95, segments=50)
    >>> weak, strong = (
    ...     flapping(strip, ParallelLight(intensity, angle=np.pi / 4), tolerance=1e-3)
    ...     for intensity in (1.0, 10.0)
    ... )
    >>> print(weak.flaps, weak.frequency, strong.flaps, strong.snaps_per_cycle)
    False 0.0 True 2
    """

    flaps: bool | None
    frequency: float
    period: float
    uncertainty: float
    snaps_per_cycle: int
    snaps_seen: int
    time: float
    rate: float
    smallest_eigenvalue: float


@dataclass(frozen=True)
class FirstSnap:
    """The first snap.

    Attributes
    ----------
    snaps : bool or None
        None: undecided until the time limit.
    time : float
        Of the first snap; infinite if there is none, NaN if undecided.
    uncertainty : float
        Bracket of the snap.
    bifurcation_time : float
        Of an earlier loss of stability without a jump (loss of symmetry); NaN if there was none.
    rate, smallest_eigenvalue : float
        At the end (before the snap); see :class:`Flapping`.
    energy_released : float
        By the snap; NaN without one.

    Examples
    --------
    Strong light leaves the material no time to relax: the time to the first snap is then inversely
    proportional to the intensity.

    >>> import numpy as np
    >>> from lissome.beams import ClampedStrip, ParallelLight, first_snap
    >>> strip = ClampedStrip(span=0.95, segments=50)
    >>> found = [
    ...     first_snap(strip, ParallelLight(intensity, angle=np.pi / 4))
    ...     for intensity in (1000.0, 2000.0)
    ... ]
    >>> print(f"{found[0].time / found[1].time:.2f}")
    2.00
    """

    snaps: bool | None
    time: float
    uncertainty: float
    bifurcation_time: float
    rate: float
    smallest_eigenvalue: float
    energy_released: float


def _runner(strip: ClampedStrip, light: Light, step: float, scheme: str) -> Runner:
    if not isinstance(strip, ClampedStrip):
        raise InvalidInput(
            f"argument `strip` is of type {type(strip).__name__}; pass a ClampedStrip"
        )
    motion = Motion(strip, light)  # checks the light
    one_of("scheme", scheme, SCHEMES)
    runner = Runner(motion.structure, motion.light, SCHEMES[scheme], positive("step", step))
    runner.begin()
    return runner


def flapping(
    strip: ClampedStrip,
    light: Light,
    *,
    until: float = 200.0,
    step: float = 0.01,
    scheme: str = "exponential-2",
    tolerance: float = 1e-6,
    rest: float = 1e-8,
    max_snaps: int = 1000,
) -> Flapping:
    """Find out whether a strip flaps under a steady light, and its frequency.

    The run ends when the natural curvature at the snaps repeats (a limit cycle), or when it has
    come to rest at a stable shape, or at the limits.

    Parameters
    ----------
    strip : ClampedStrip
        The strip.
    light : ParallelLight, GaussianSpot or UserLight
        Steady light.
    until : float
        Limit of time (relaxation times).
    step : float
        Longest time step.
    scheme : str
        As in :meth:`Motion.run`.
    tolerance : float
        A limit cycle has converged when the natural curvature changes by less than this, relative to
        its largest value, from one cycle to the next.
    rest : float
        At rest the natural curvature changes at a rate less than this. Near the ends of the window
        the motion passes slowly by a shape that is almost one of rest: the smaller, the surer.
    max_snaps : int
        Limit of snaps.

    Returns
    -------
    Flapping

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If no stable shape is found after a loss of stability.

    Examples
    --------
    >>> import math
    >>> from lissome.beams import ClampedStrip, ParallelLight, flapping
    >>> strip = ClampedStrip(span=0.95, segments=60)
    >>> flapping(strip, ParallelLight(10.0, angle=0.0)).flaps
    False
    """
    until = positive("until", until)
    tolerance = positive("tolerance", tolerance)
    rest = positive("rest", rest)
    max_snaps = integer_at_least("max_snaps", max_snaps, 1)
    runner = _runner(strip, light, step, scheme)
    table = runner.empty_table()
    seen: list[ElasticaSnap] = []
    count = 0
    # Decay to rest takes log(1/rest) relaxation times at least: look about once in each.
    while runner.time < until and count < max_snaps:
        reason, _ = runner.advance(min(runner.time + 1.0, until), 0, table)
        if reason == _kernel.ENCLOSED:
            snap = runner.snap()
            if snap is None:
                continue
            if snap.kind != "snap":
                continue
            count += 1
            seen.append(snap)
            if len(seen) > PERIOD_MEMORY:
                seen.pop(0)
            found = period_of(seen, tolerance)
            if found is not None:
                return Flapping(
                    True,
                    1.0 / found.value,
                    found.value,
                    found.uncertainty,
                    found.snaps_per_cycle,
                    count,
                    runner.time,
                    runner.rate(),
                    snap.smallest_eigenvalue,
                )
        elif runner.rate() < rest:
            return Flapping(
                False,
                0.0,
                math.inf,
                0.0,
                0,
                count,
                runner.time,
                runner.rate(),
                runner.smallest_eigenvalue(),
            )
    return Flapping(
        None,
        math.nan,
        math.nan,
        math.nan,
        0,
        count,
        runner.time,
        runner.rate(),
        runner.smallest_eigenvalue(),
    )


def first_snap(
    strip: ClampedStrip,
    light: Light,
    *,
    until: float = 200.0,
    step: float = DEFAULT_STEP,
    scheme: str = "exponential-2",
    rest: float = 1e-8,
) -> FirstSnap:
    """Find the first snap of a strip, or that it comes to rest without one.

    Parameters
    ----------
    strip, light, until, step, scheme, rest
        As in :func:`flapping`.

    Returns
    -------
    FirstSnap

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If no stable shape is found after a loss of stability.

    Examples
    --------
    >>> from lissome.beams import ClampedStrip, GaussianSpot, first_snap
    >>> strip = ClampedStrip(span=0.95, segments=60)
    >>> first_snap(strip, GaussianSpot(1.0, center=0.4, width=0.1)).time
    inf
    """
    until = positive("until", until)
    rest = positive("rest", rest)
    runner = _runner(strip, light, step, scheme)
    table = runner.empty_table()
    bifurcated = math.nan
    while runner.time < until:
        reason, _ = runner.advance(min(runner.time + 1.0, until), 0, table)
        if reason == _kernel.ENCLOSED:
            rate = runner.rate()
            snap = runner.snap()
            if snap is None:
                continue
            if snap.kind == "snap":
                return FirstSnap(
                    True,
                    snap.time,
                    snap.uncertainty,
                    bifurcated,
                    rate,
                    snap.smallest_eigenvalue,
                    snap.energy_released,
                )
            if math.isnan(bifurcated):
                bifurcated = snap.time
        elif runner.rate() < rest:
            return FirstSnap(
                False,
                math.inf,
                0.0,
                bifurcated,
                runner.rate(),
                runner.smallest_eigenvalue(),
                math.nan,
            )
    return FirstSnap(
        None,
        math.nan,
        math.nan,
        bifurcated,
        runner.rate(),
        runner.smallest_eigenvalue(),
        math.nan,
    )
