r"""Slow evolution: equilibria that follow what changes in time, and the snaps where they are lost.

Something of a structure changes in time, its *memory* m: the natural curvature of a film, the
temperature of a plate. Inertia and viscosity are negligible, so that the structure is at a stable
equilibrium :math:`x(m)` at every instant, and the memory may in turn depend on the shape,

.. math:: \dot m = f(m, x(m), t).

:func:`evolve` advances the memory, corrects the equilibrium, and accepts a step only if the new
equilibrium is stable and continues the old one. Otherwise stability is lost within the step: the
instant is bracketed by halving steps, the memory is frozen, and the structure descends to another
stable equilibrium, a *snap* that takes no time on the scale of the memory. Then evolution goes on.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from . import _archive, _progress
from ._corrector import (
    Balanced,
    CorrectionFailed,
    as_balanced,
    as_equilibrium,
    confirm,
    correct,
    critical_modes,
)
from ._descent import descend, distance
from ._stored import pack_equilibria, unpack_equilibria, without_what_cannot_travel
from ._telling import one_call
from ._validate import finite, finite_array, functions, integer_at_least, positive
from .equilibrium import Equilibrium
from .errors import DataError, FactorizationError, InvalidInput, NotConverged

__all__ = ["EvolutionInterrupted", "Evolving", "History", "Marched", "Snap", "evolve"]

Array = NDArray[np.float64]
Outputs = Mapping[str, Callable[[float, Any, Equilibrium], float]]


class Evolving(Protocol):
    """What :func:`evolve` asks of something that changes in time.

    A third method is optional: ``march(memory, equilibrium, time, until, step) -> Marched`` advances
    by many steps at once, in compiled code; see :class:`Marched`.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> class Tilted:
    ...     def structure(self, tilt):
    ...         return ls.DenseStructure(
    ...             initial=[-1.0],
    ...             energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
    ...             gradient=lambda x: x**3 - x - tilt,
    ...             hessian=lambda x: np.diag(3 * x**2 - 1),
    ...         )
    ...     def advance(self, tilt, time, step, before, after):
    ...         return tilt + step
    >>> tilted = Tilted()
    >>> start = ls.equilibrate(tilted.structure(0.0))
    >>> print(round(ls.evolve(tilted, 0.0, start, until=0.2, step=0.05).memory, 9))
    0.2
    """

    def structure(self, memory: Any) -> Any:
        """Return the structure that goes with `memory`."""
        ...

    def advance(
        self, memory: Any, time: float, step: float, before: Equilibrium, after: Equilibrium
    ) -> Any:
        """Return the memory one step later.

        Parameters
        ----------
        memory : object
            At `time`.
        time, step : float
        before : Equilibrium
            At `time`.
        after : Equilibrium
            At ``time + step``: first `before` itself (a predictor, of first order), then what was found
            with the memory predicted (a corrector, of second order if it uses both).
        """
        ...


@dataclass(frozen=True, eq=False)
class Marched:
    """What a compiled march has come to.

    Attributes
    ----------
    time, memory, state, multipliers
        After the last accepted step, whose equilibrium is balanced and stable. All steps are those of
        :func:`evolve` with ``corrections=1``.
    reason : str
        ``"until"``: at the time asked for, exactly. Anything else says why the next step, of the full
        length or up to that time, was not accepted; :func:`evolve` then takes it, and finds the snap.
    steps : int
        Number of accepted steps.

    Examples
    --------
    What a march that took three steps of 0.1 and could have gone on returns:

    >>> import numpy as np
    >>> from lissome.evolution import Marched
    >>> from lissome.structure import VectorState
    >>> Marched(0.3, 0.3, VectorState([-0.8]), np.zeros(0), reason="until", steps=3).steps
    3
    """

    time: float
    memory: Any
    state: Any
    multipliers: Array
    reason: str
    steps: int


@dataclass(frozen=True, eq=False)
class Snap:
    """A loss of stability, and the motion to another equilibrium.

    Attributes
    ----------
    time : float
        When.
    uncertainty : float
        Half of the bracket that holds the instant, for the given time steps.
    memory : object
        Frozen during the snap.
    before, after : Equilibrium
        The last stable equilibrium, and the one after the snap.
    modes : ndarray, shape (1, n)
        Critical mode, of unit length in the metric; along the motion if that has a part along it.
    energy_released : float
        Potential energy at the frozen memory before the snap, minus that after it.
    row : int
        Row of `before` in the history; `after` is in the next one.
    kind : str
        Always ``"snap"``: what tells it from other events in a table.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> class Tilted:
    ...     def structure(self, tilt):
    ...         return ls.DenseStructure(
    ...             initial=[-1.0],
    ...             energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
    ...             gradient=lambda x: x**3 - x - tilt,
    ...             hessian=lambda x: np.diag(3 * x**2 - 1),
    ...         )
    ...     def advance(self, tilt, time, step, before, after):
    ...         return tilt + step
    >>> tilted = Tilted()
    >>> start = ls.equilibrate(tilted.structure(0.0))
    >>> (snap,) = ls.evolve(tilted, 0.0, start, until=0.5, step=0.02).events
    >>> print(snap.before.state.x.round(3), snap.after.state.x.round(3))
    [-0.577] [1.155]
    >>> print(round(snap.energy_released, 3))
    0.75
    """

    time: float
    uncertainty: float
    memory: Any = field(repr=False)
    before: Equilibrium = field(repr=False)
    after: Equilibrium = field(repr=False)
    modes: Array = field(repr=False)
    energy_released: float
    row: int
    kind: str = "snap"

    @property
    def mode(self) -> Array:
        """The critical mode, shape (n,)."""
        return self.modes[0]


class EvolutionInterrupted(NotConverged):
    """An evolution could not be followed to its end. What was found is attached.

    Attributes
    ----------
    history : History
        Up to the interruption.
    state : object or None
        The last state.

    Examples
    --------
    What was found before the interruption is not lost:

    >>> import numpy as np
    >>> import lissome as ls
    >>> class Tilted:
    ...     def structure(self, tilt):
    ...         return ls.DenseStructure(
    ...             initial=[-1.0],
    ...             energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
    ...             gradient=lambda x: x**3 - x - tilt,
    ...             hessian=lambda x: np.diag(3 * x**2 - 1),
    ...         )
    ...     def advance(self, tilt, time, step, before, after):
    ...         return tilt + step
    >>> tilted = Tilted()
    >>> start = ls.equilibrate(tilted.structure(0.0))
    >>> try:
    ...     ls.evolve(tilted, 0.0, start, until=1.0, step=0.02, max_steps=5)
    ... except ls.evolution.EvolutionInterrupted as error:
    ...     print(error.history.reason, round(error.history.time, 9))
    interrupted 0.1
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return without_what_cannot_travel(super().__reduce__(), "history")


@dataclass(frozen=True, eq=False)
class History:
    """Stable equilibria in the order of time.

    Attributes
    ----------
    times : ndarray, shape (k,)
        A snap has two rows, before and after it.
    memories, equilibria : tuple
        What goes with the times.
    kinds : tuple of str
        ``"start"``, ``"step"``, ``"reported"``, ``"before snap"``, ``"after snap"``, ``"end"``.
    events : tuple of Snap
        The losses of stability, in the order of time.
    reason : str
        Why it ended: ``"until"``, what `stop_when` said, or ``"interrupted"``.
    steps : int
        Number of accepted steps.
    values : mapping of str to ndarray, shape (k,)
        The user's outputs.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> class Tilted:
    ...     def structure(self, tilt):
    ...         return ls.DenseStructure(
    ...             initial=[-1.0],
    ...             energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
    ...             gradient=lambda x: x**3 - x - tilt,
    ...             hessian=lambda x: np.diag(3 * x**2 - 1),
    ...         )
    ...     def advance(self, tilt, time, step, before, after):
    ...         return tilt + step
    >>> tilted = Tilted()
    >>> start = ls.equilibrate(tilted.structure(0.0))
    >>> history = ls.evolve(tilted, 0.0, start, until=0.5, step=0.02, report_at=[0.25])
    >>> print(history.kinds)
    ('start', 'reported', 'before snap', 'after snap', 'end')
    >>> end = history.equilibrium
    >>> later = ls.evolve(tilted, history.memory, end, time=0.5, until=0.6, step=0.02)
    >>> print(round(history.joined(later).time, 9))
    0.6
    """

    times: Array
    memories: tuple[Any, ...] = field(repr=False)
    equilibria: tuple[Equilibrium, ...] = field(repr=False)
    kinds: tuple[str, ...] = field(repr=False)
    events: tuple[Snap, ...]
    reason: str
    steps: int
    values: Mapping[str, Array] = field(repr=False)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def time(self) -> float:
        """The last time."""
        return float(self.times[-1])

    @property
    def memory(self) -> Any:
        """The last memory."""
        return self.memories[-1]

    @property
    def equilibrium(self) -> Equilibrium:
        """The last equilibrium."""
        return self.equilibria[-1]

    @cached_property
    def table(self) -> pd.DataFrame:
        """Time, energy, kind, and the user's outputs, a row for each equilibrium."""
        data: dict[str, Any] = {
            "time": self.times,
            "energy": np.array([e.energy for e in self.equilibria]),
            "kind": list(self.kinds),
        }
        return pd.DataFrame(data | dict(self.values))

    def joined(self, later: History) -> History:
        """Return this history and one that goes on from its end, as one.

        Raises
        ------
        InvalidInput
            If `later` does not begin when this one ends, or has other outputs.
        """
        if later.times[0] != self.time:
            raise InvalidInput(
                f"argument `later` begins at {later.times[0]}; this history ends at {self.time}"
            )
        if set(later.values) != set(self.values):
            raise InvalidInput(
                f"argument `later` has the outputs {sorted(later.values)}; this history has "
                f"{sorted(self.values)}"
            )
        shift = len(self) - 1  # the first row of the later one is the last row of this one
        return History(
            times=np.concatenate([self.times, later.times[1:]]),
            memories=self.memories + later.memories[1:],
            equilibria=self.equilibria + later.equilibria[1:],
            kinds=self.kinds + later.kinds[1:],
            events=self.events + tuple(replace(e, row=e.row + shift) for e in later.events),
            reason=later.reason,
            steps=self.steps + later.steps,
            values={k: np.concatenate([v, later.values[k][1:]]) for k, v in self.values.items()},
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the history to the file `path` (.npz: arrays and JSON, no pickle), all or nothing.

        The memory must be a number, an array, or a dataclass of these.
        """
        meta = {
            "kind": "history",
            "reason": self.reason,
            "steps": self.steps,
            "kinds": list(self.kinds),
            "outputs": list(self.values),
            "events": [
                {
                    "time": e.time,
                    "uncertainty": e.uncertainty,
                    "energy_released": e.energy_released,
                    "row": e.row,
                    "kind": e.kind,
                }
                for e in self.events
            ],
        }
        arrays = {"times": self.times, **pack_equilibria(self.equilibria)}
        arrays |= _archive.pack_values("memory", self.memories)
        arrays |= {f"output.{name}": column for name, column in self.values.items()}
        arrays |= {f"event.{i}.modes": e.modes for i, e in enumerate(self.events)}
        _archive.write(path, meta, arrays)

    @staticmethod
    def load(path: str | os.PathLike[str], evolving: Evolving, memory: Any) -> History:
        """Read a history that :meth:`save` wrote.

        Parameters
        ----------
        path : path
        evolving : Evolving
            What evolved: structures are not in the file.
        memory : object
            A memory of the same kind (its values do not matter).

        Raises
        ------
        DataError
            If the file is damaged, or its states do not fit the structures.
        """
        meta, arrays = _archive.read(path, "history")
        try:
            count = len(meta["kinds"])
            memories = _archive.unpack_values("memory", arrays, memory, count)
            structures = [evolving.structure(m) for m in memories]
            equilibria = unpack_equilibria(arrays, structures, path)
            events = tuple(
                Snap(
                    **item, memory=memories[item["row"] + 1], modes=arrays[f"event.{i}.modes"],
                    before=equilibria[item["row"]], after=equilibria[item["row"] + 1],
                )
                for i, item in enumerate(meta["events"])
            )  # fmt: skip
            return History(
                times=arrays["times"], memories=tuple(memories), equilibria=tuple(equilibria),
                kinds=tuple(meta["kinds"]), events=events, reason=meta["reason"],
                steps=meta["steps"],
                values={name: arrays[f"output.{name}"] for name in meta["outputs"]},
            )  # fmt: skip
        except (KeyError, IndexError, TypeError) as error:
            raise DataError(f"the file {path} is incomplete: {error!r}") from error


@one_call
def evolve(
    evolving: Evolving,
    memory: Any,
    equilibrium: Equilibrium,
    until: float,
    step: float,
    *,
    time: float = 0.0,
    report_at: ArrayLike | None = None,
    outputs: Outputs | None = None,
    corrections: int = 1,
    tolerance: float | None = None,
    time_tolerance: float | None = None,
    max_change: float = 0.25,
    sign: int = 1,
    stop_when: Callable[[float, Any, Equilibrium], str | None] | None = None,
    max_steps: int = 1_000_000,
    compiled: bool = True,
    progress: bool | None = None,
) -> History:
    r"""Advance what changes in time, with the structure at stable equilibrium throughout.

    Each step predicts the memory from the equilibrium before it, finds the equilibrium, corrects the
    memory with the equilibria at both ends, and finds the equilibrium again.

    Parameters
    ----------
    evolving : Evolving
        The structure as a function of the memory, and the evolution of the memory.
    memory : object
        The memory at the beginning.
    equilibrium : Equilibrium
        A stable equilibrium at that memory.
    until : float
        Time at the end, greater than `time`.
    step : float
        Time step; the first one if steps are adapted.
    time : float, optional
        Time at the beginning.
    report_at : array_like, optional
        Times, from `time` to `until`, that are hit exactly. With it, the history holds these times,
        the snaps, the beginning and the end; without it, it holds every step. A time that falls
        between the two rows of a snap (within 1e-5 of `step`, as a rule) has no row of its own; if
        it is `until`, the history ends with the snap, that much later.
    outputs : mapping of str to callable, optional
        Functions of time, memory and equilibrium that return a number; columns of the table.
    corrections : int, optional
        How often the memory is corrected in each step: 0 (explicit), 1 (default) or more.
    tolerance : float, optional
        If given, steps are adapted so that the last correction of the memory moves no unknown by more
        than this (relative to its typical size). Otherwise steps are fixed.
    time_tolerance : float, optional
        Length of the bracket of a snap; by default 1e-7 of `step`.
    max_change : float, optional
        Largest change of an unknown (relative to its typical size) in a step; a larger one might be
        a jump, and the step is divided.
    sign : int, optional
        +1 or -1: the side of the critical mode tried first where the loss of stability prefers none.
    stop_when : callable, optional
        Function of time, memory and equilibrium, called after every step (after every march to a
        reported time if the march is compiled). A string that it returns ends the evolution and
        becomes its `reason`; None goes on.
    max_steps : int, optional
        Number of accepted steps after which the attempt is given up.
    compiled : bool, optional
        Use the compiled march of `evolving` if it has one. It has fixed steps and one correction.
    progress : bool, optional
        Show a progress bar on stderr, after two seconds. By default only if that is a terminal.

    Returns
    -------
    History

    Raises
    ------
    InvalidInput
        If an argument is wrong, or `equilibrium` is not stable, or not an equilibrium of `memory`.
    EvolutionInterrupted
        If the evolution cannot be continued; its attribute `history` holds what was found.

    Notes
    -----
    Near a fold the unknowns move as the square root of the remaining time. With fixed steps the
    instant of a snap therefore converges with order 3/2 in the step; with a `tolerance`, steps shrink
    towards the fold.

    Examples
    --------
    A particle in a double well that is tilted more and more leaves its well at a tilt of
    :math:`2/\sqrt{27}`.

    >>> import numpy as np
    >>> from lissome import DenseStructure, equilibrate, evolve
    >>> class Tilted:
    ...     def structure(self, tilt):
    ...         return DenseStructure(
    ...             initial=[-1.0],
    ...             energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
    ...             gradient=lambda x: x**3 - x - tilt,
    ...             hessian=lambda x: np.diag(3 * x**2 - 1),
    ...         )
    ...     def advance(self, tilt, time, step, before, after):
    ...         return tilt + step
    >>> tilted = Tilted()
    >>> history = evolve(tilted, 0.0, equilibrate(tilted.structure(0.0)), until=1.0, step=0.02)
    >>> print(round(history.events[0].time, 6), round(2 / 27**0.5, 6))
    0.3849 0.3849
    """
    run = _Evolution(
        evolving=evolving,
        until=finite("until", until),
        step=positive("step", step),
        outputs=functions("outputs", outputs),
        corrections=integer_at_least("corrections", corrections, 0),
        tolerance=None if tolerance is None else positive("tolerance", tolerance),
        time_tolerance=(
            1e-7 * positive("step", step)
            if time_tolerance is None
            else positive("time_tolerance", time_tolerance)
        ),
        max_change=positive("max_change", max_change),
        sign=sign,
        stop_when=stop_when,
        max_steps=integer_at_least("max_steps", max_steps, 1),
        reports=None if report_at is None else finite_array("report_at", report_at, (None,)),
        march=getattr(evolving, "march", None) if compiled else None,
    )
    run.begin(memory, equilibrium, finite("time", time))
    return run.run(progress)


@dataclass(frozen=True)
class _Trial:
    memory: Any
    balanced: Balanced
    error: float  # what the last correction of the memory changed


class _Extrapolation:
    """Guesses when an eigenvalue comes to zero, from its last values.

    It falls like the square root of the remaining time at a fold, and linearly at a loss of symmetry.
    The law that foretold the last value better is trusted.
    """

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        self.guess = math.nan
        self.power = 2
        self.aside = 0.25  # of the remaining time: how far from the guess to aim
        self.beyond = False

    def add(self, time: float, value: float) -> bool:
        """Take a value in. Return whether it is smaller than the one before."""
        falling = not self.points or value < self.points[-1][1]
        if len(self.points) >= 2 and falling:
            misses = [
                abs((max(self._line(p, time), 0.0)) ** (1 / p) - value) for p in (1, 2)
            ]  # fmt: skip
            self.power = 1 if misses[0] < misses[1] else 2
        self.points.append((time, value))
        if len(self.points) >= 2 and falling:
            old, self.guess = self.guess, self._zero(self.power)
            left = self.guess - time
            if math.isfinite(old) and left > 0:
                self.aside = min(max(2 * abs(self.guess - old) / left, 1e-3), 0.5)
        else:
            self.guess = math.nan
        return falling

    def aim(self, time: float, bracket: float, least: float) -> float:
        """Return the length of the next trial step, within the bracket."""
        left = self.guess - time
        self.beyond = not self.beyond
        if not 0 < left < bracket:
            return 0.5 * bracket
        aside = max(self.aside * left, 0.3 * least)
        length = left + aside if self.beyond else left - aside
        return length if 0 < length < 0.9 * bracket else 0.5 * bracket

    def _line(self, power: int, time: float) -> float:
        (t0, v0), (t1, v1) = self.points[-2:]
        return v1**power + (time - t1) * (v1**power - v0**power) / (t1 - t0)

    def _zero(self, power: int) -> float:
        (t0, v0), (t1, v1) = self.points[-2:]
        return t1 + v1**power * (t1 - t0) / (v0**power - v1**power)


class _Lost(Exception):
    """The step does not lead to a stable equilibrium that continues the last one."""


@dataclass
class _Evolution:
    """One run. The only mutable object here; lives for one call."""

    evolving: Any
    until: float
    step: float
    outputs: dict[str, Callable[[float, Any, Equilibrium], float]]
    corrections: int
    tolerance: float | None
    time_tolerance: float
    max_change: float
    sign: int
    stop_when: Callable[[float, Any, Equilibrium], str | None] | None
    max_steps: int
    reports: Array | None
    march: Callable[..., Marched] | None

    def begin(self, memory: Any, equilibrium: Equilibrium, time: float) -> None:
        if self.sign not in (1, -1):
            raise InvalidInput(f"argument `sign` is {self.sign!r}; it must be +1 or -1")
        if not self.until > time:
            raise InvalidInput(
                f"argument `until` is {self.until}; it must be later than `time` = {time}"
            )
        if self.tolerance is not None and self.corrections == 0:
            raise InvalidInput(
                "argument `corrections` is 0, so that there is no estimate of the error to hold to "
                "`tolerance`; pass corrections=1, or fixed steps"
            )
        if self.corrections != 1 or self.tolerance is not None:
            self.march = None  # the compiled march has fixed steps and one correction
        if not isinstance(equilibrium, Equilibrium):
            raise InvalidInput(
                f"argument `equilibrium` is of type {type(equilibrium).__name__}; pass the result of "
                "`equilibrate`"
            )
        structure = self.evolving.structure(memory)
        try:
            balanced = confirm(
                structure, structure.adopt(equilibrium.state), equilibrium.multipliers
            )
        except CorrectionFailed as error:
            raise InvalidInput(
                "argument `equilibrium` is not an equilibrium of the structure at `memory` "
                f"({error}); pass equilibrate(evolving.structure(memory))"
            ) from error
        if not balanced.stable:
            raise InvalidInput(
                f"argument `equilibrium` is not stable (inertia {balanced.factorization.inertia}); an "
                "evolution begins at a stable equilibrium"
            )
        self.time, self.memory, self.balanced = time, memory, balanced
        self.size = self.step
        self.last: Array | None = None  # increment of the unknowns in the last step
        self.steps = 0
        self.times: list[float] = []
        self.memories: list[Any] = []
        self.equilibria: list[Equilibrium] = []
        self.kinds: list[str] = []
        self.events: list[Snap] = []
        self.values: dict[str, list[float]] = {name: [] for name in self.outputs}
        self.reason = "interrupted"
        wanted = [] if self.reports is None else sorted({float(t) for t in self.reports})
        outside = [t for t in wanted if not time <= t <= self.until]
        if outside:
            raise InvalidInput(
                f"argument `report_at` has the time {outside[0]}; all must lie between `time` = "
                f"{time} and `until` = {self.until}"
            )
        self.targets = [t for t in wanted if time < t < self.until] + [self.until]
        self.record("start")

    # -- results ----------------------------------------------------------------------------------

    def record(self, kind: str) -> Equilibrium:
        equilibrium = as_equilibrium(self.balanced)
        for name, function in self.outputs.items():
            value = np.asarray(function(self.time, self.memory, equilibrium))
            if value.shape != () or value.dtype.kind not in "biuf":
                raise InvalidInput(
                    f"the output {name!r} returned {value!r} at time {self.time:.8g}; it must return "
                    "a number"
                )
            self.values[name].append(float(value))
        self.times.append(self.time)
        self.memories.append(self.memory)
        self.equilibria.append(equilibrium)
        self.kinds.append(kind)
        return equilibrium

    def history(self) -> History:
        return History(
            times=np.array(self.times), memories=tuple(self.memories),
            equilibria=tuple(self.equilibria), kinds=tuple(self.kinds), events=tuple(self.events),
            reason=self.reason, steps=self.steps,
            values={name: np.array(column) for name, column in self.values.items()},
        )  # fmt: skip

    def interrupted(self, message: str) -> EvolutionInterrupted:
        if self.times[-1] != self.time:
            self.record("end")
        return EvolutionInterrupted(
            f"{message}, at time {self.time:.10g}; the attribute `history` of this error holds what was "
            "found, from which `evolve` can go on",
            history=self.history(), state=self.balanced.state,
        )  # fmt: skip

    # -- steps ------------------------------------------------------------------------------------

    def run(self, progress: bool | None) -> History:
        with _progress.bar("evolve", progress, float(self.until - self.time)) as bar:
            return self.walk(bar)

    def walk(self, bar: Any) -> History:
        for target in self.targets:
            while self.time < target:
                if self.steps >= self.max_steps:
                    raise self.interrupted(
                        f"{self.steps} steps have been taken (`max_steps`) before the end"
                    )
                before = self.time
                self.onward(target)
                bar.update(self.time - before)
                said = None
                if self.stop_when is not None:
                    equilibrium = as_equilibrium(self.balanced)
                    said = self.stop_when(self.time, self.memory, equilibrium)
                end = "end" if self.time == self.until else "reported"
                if said is not None and not isinstance(said, str):
                    raise InvalidInput(
                        f"the function `stop_when` returned {said!r} at time {self.time:.8g}; it must "
                        "return a reason in words, or None to go on"
                    )
                if said:
                    self.reason = said
                    self.record_new("end")
                    return self.history()
                if self.time == target:
                    self.record_new(end)
                elif self.reports is None:
                    self.record_new("step")
        self.reason = "until"
        return self.history()

    def record_new(self, kind: str) -> None:
        if self.times[-1] != self.time:
            self.record(kind)

    def onward(self, target: float) -> None:
        """Take one step, or a compiled march, towards `target`, with a snap if there is one."""
        if self.march is not None:
            marched = self.march(
                self.memory, as_equilibrium(self.balanced), self.time, target, self.step
            )
            if marched.steps:
                self.take_march(marched, target)
            if marched.reason == "until":
                return
        step = self.size
        if self.time + step >= target - 1e-9 * step:
            step = target - self.time
        if not self.time + step > self.time:
            raise self.interrupted("time steps have come to nothing")
        try:
            trial = self.attempt(step)
        except _Lost:
            self.locate(step)
            return
        if self.tolerance is not None:
            factor = 0.9 * math.sqrt(self.tolerance / max(trial.error, 1e-4 * self.tolerance))
            if trial.error > self.tolerance:
                self.size = step * max(0.2, min(factor, 0.8))
                if self.size < self.time_tolerance:
                    raise self.interrupted(
                        f"no time step meets the tolerance {self.tolerance:g}; raise it"
                    )
                return
            if step >= self.size:
                self.size = step * max(0.2, min(factor, 2.0))
        else:
            self.size = min(self.step, 2 * self.size)
        self.accept(trial, target if step == target - self.time else self.time + step)

    def take_march(self, marched: Marched, target: float) -> None:
        structure = self.evolving.structure(marched.memory)
        if marched.reason == "until" and marched.time != target:
            raise self.interrupted(
                f"the compiled march ended at {marched.time!r} instead of {target!r}"
            )
        try:
            balanced = confirm(structure, marched.state, marched.multipliers)
        except CorrectionFailed as error:
            raise self.interrupted(
                f"the compiled march left a state off balance ({error})"
            ) from error
        if not balanced.stable:
            raise self.interrupted("the compiled march accepted an unstable state")
        self.time, self.memory, self.balanced = marched.time, marched.memory, balanced
        self.steps += marched.steps
        self.last = None

    def attempt(self, step: float) -> _Trial:
        """Return where one step leads, if it leads to a stable equilibrium nearby."""
        before = as_equilibrium(self.balanced)
        after, balanced = before, self.balanced
        error = 0.0
        for k in range(self.corrections + 1):
            memory = self.evolving.advance(self.memory, self.time, step, before, after)
            structure = self.evolving.structure(memory)
            state = structure.adopt(balanced.state)
            try:
                found = correct(structure, state, balanced.multipliers, stable=True)
            except CorrectionFailed as reason:
                raise _Lost(str(reason)) from reason
            if not found.stable:
                raise _Lost("the equilibrium is not stable")
            if (
                distance(structure, structure.adopt(self.balanced.state), found.state)
                > self.max_change
            ):
                raise _Lost("the equilibrium has moved far")
            if k:
                error = distance(structure, state, found.state)
            balanced, after = found, as_equilibrium(found)
        return _Trial(memory, balanced, error)

    def accept(self, trial: _Trial, time: float) -> None:
        structure = trial.balanced.structure
        origin = structure.adopt(self.balanced.state)
        self.last = structure.difference(origin, trial.balanced.state)
        self.time, self.memory, self.balanced = time, trial.memory, trial.balanced
        self.steps += 1

    def locate(self, failed: float) -> None:
        """Approach the loss of stability that is less than `failed` away; then snap.

        A long step may fail where two short ones get through, since it errs more. So after an accepted
        step the far end of the bracket is a guess, until a step fails again; and where the smallest
        eigenvalue grows nothing is being lost, and the ordinary walk goes on with short steps.
        """
        bracket, confirmed, shortest = failed, True, math.inf
        extrapolation = _Extrapolation()
        extrapolation.add(self.time, self.smallest())
        while not (confirmed and bracket <= self.time_tolerance):
            length = extrapolation.aim(self.time, bracket, self.time_tolerance)
            if not confirmed and bracket <= self.time_tolerance:
                length = bracket
            length = min(length, shortest)
            if not self.time + length > self.time:
                break  # nothing is left to divide
            try:
                trial = self.attempt(length)
            except _Lost:
                bracket, confirmed = length, True
                continue
            if self.tolerance is not None and trial.error > self.tolerance:
                shortest = 0.5 * length
                if shortest < 1e-3 * self.time_tolerance:
                    raise self.interrupted(
                        f"no time step meets the tolerance {self.tolerance:g}; raise it"
                    )
                continue
            self.accept(trial, self.time + length)
            bracket, confirmed, shortest = bracket - length, False, math.inf
            growing = not extrapolation.add(self.time, self.smallest())
            if growing or bracket <= 1e-3 * self.time_tolerance:
                self.size = 2 * length
                return
        self.snap(bracket)

    def smallest(self) -> float:
        """Return the size of the eigenvalue that is nearest to zero."""
        try:
            return abs(float(critical_modes(self.balanced, 1, iterations=5)[0][0]))
        except FactorizationError:
            return 0.0

    def snap(self, length: float) -> None:
        """Freeze the memory just beyond the loss of stability, descend, and record the snap."""
        before = self.balanced
        try:
            _, modes = critical_modes(before, 1)
        except FactorizationError as error:
            raise self.interrupted(f"the critical mode cannot be resolved ({error})") from error
        signs = (self.sign, -self.sign)
        if self.last is not None:
            metric = np.asarray(before.structure.metric(before.state), dtype=float)
            along = float(self.last @ (metric * modes[0]))
            if abs(along) > 0.1 * math.sqrt(float(self.last @ (metric * self.last))):
                modes = modes * math.copysign(1.0, along)
                signs = (1, -1)
        equilibrium = as_equilibrium(before)
        failure: EvolutionInterrupted | None = None
        # Just beyond the loss nothing is left of the old equilibrium but a flat place.
        for beyond in (1e-5, 1e-4, 1e-3):
            ahead = max(length, beyond * self.step)
            memory = self.evolving.advance(self.memory, self.time, ahead, equilibrium, equilibrium)
            structure = self.evolving.structure(memory)
            try:
                after, top = descend(structure, before, modes, signs, self.interrupted)
                break
            except EvolutionInterrupted as error:
                failure = error
        else:
            assert failure is not None
            raise failure
        instant = self.time + 0.5 * length
        row = len(self.times)
        if self.times[-1] == self.time:  # recorded already, as a step
            row -= 1
            self.kinds[row] = "before snap" if self.kinds[row] == "step" else self.kinds[row]
        else:
            self.record("before snap")
        kept = self.equilibria[row]
        self.time, self.memory, self.balanced = self.time + ahead, memory, as_balanced(after)
        new = self.record("after snap")
        self.events.append(
            Snap(
                time=instant, uncertainty=0.5 * length, memory=memory, before=kept, after=new,
                modes=modes, energy_released=top - after.energy, row=row,
            )
        )  # fmt: skip
        self.last = None
        self.size = min(self.size, self.step)
