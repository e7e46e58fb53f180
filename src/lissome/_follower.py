"""The walk along a branch: steps, and what is met on the way.

A step is predicted along the tangent and corrected; then everything that happened within it is looked
for: values to report at, changes of the index, the end of the branch. A step in which something cannot
be resolved is taken back and taken in parts.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _archive, _progress
from ._branch_file import needed, not_of_family, pack, settings_from, unpack
from ._branch_records import BranchInterrupted, Event, Outputs, Row, Settings
from ._corrector import (
    CONTRACTION,
    Balanced,
    CorrectionFailed,
    Family,
    Slope,
    adopted,
    as_balanced,
    as_equilibrium,
    correct,
    correct_on_plane,
    critical_modes,
    gauge_of,
    lowest_of_stable,
    slope_beside,
)
from ._descent import descend
from .equilibrium import Equilibrium, equilibrate
from .errors import FactorizationError, InvalidInput, NotConverged, StabilityNotResolvable
from .sensitivities import implicit_derivative, residual_slope
from .stability import admissible_motions, smallest_eigenvalue

Array = NDArray[np.float64]

# A step is natural (at a fixed parameter) while the tangent has at least this share of parameter.
_NATURAL = 0.3
# Accepted distance between prediction and correction, as a fraction of the step.
_LARGEST_DEVIATION = 0.35
# The deviation that the choice of steps aims at.
_WANTED_DEVIATION = 0.08
# Tangents at the ends of a step must agree to this cosine.
_LARGEST_TURN = math.cos(math.radians(40.0))
_SHORTEST_STEP = 1e-9
# Length of brackets of events from which on states need not be good to rounding.
_COARSE = 1e-5
# Relative change of the residual's derivative from step to step up to which it is used again.
_STEADY = 1e-5
# Number of halvings of a bracket from which on interpolation is worth while.
_FEW = 8
# Corrections over the tolerance up to which the next ones of a step are foretold. (Beside a critical
# state, where events are looked for, corrections along its mode contract more slowly than others.)
_FORETOLD = 100.0
# Distance within which a state is the one at which the branch began.
_SAME = 1e-6
# Factors that are no simple fractions keep halved steps off symmetric parameter values.
_SHORTER = 0.4713


@dataclass(frozen=True)
class Tangent:
    dx: Array
    dm: Array
    dp: float


@dataclass(frozen=True)
class Bend:
    """How a branch goes on from its tangent: coefficients of second and third power.

    Of the cubic with places and tangents of the last two states, over the projection on the last
    tangent.
    """

    two: Tangent
    three: Tangent

    def at(self, sigma: float) -> Tangent:
        """Return the distance from the tangent."""
        a, b, two, three = self.two, self.three, sigma**2, sigma**3
        return Tangent(
            two * a.dx + three * b.dx, two * a.dm + three * b.dm, two * a.dp + three * b.dp
        )


@dataclass(frozen=True)
class Point:
    """A point of the branch close to an anchor: its place relative to it, and its factors."""

    parameter: float
    sigma: float  # projection on the anchor's tangent
    balanced: Balanced
    dx: Array  # from the anchor
    dm: Array
    dp: float

    @property
    def index(self) -> int:
        return self.balanced.index


@dataclass(frozen=True)
class Crossing:
    left: Point
    right: Point
    values: tuple[float, float] = (math.nan, math.nan)  # of the critical eigenvalue at both
    exact: Point | None = None  # a point where rounding hides the sign of the pivot
    fold: bool = False

    @property
    def sigma(self) -> float:
        return 0.5 * (self.left.sigma + self.right.sigma)


@dataclass(frozen=True)
class End:
    sigma: float
    point: Point
    reason: str  # "stop", "bound", "closed"


def _zero_of_quadratic(constant: float, linear: float, square: float) -> float:
    """Return the zero in (0, 1) of a polynomial that has different signs at 0 and 1."""
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        value = constant + middle * (linear + middle * square)
        low, high = (middle, high) if value * constant > 0.0 else (low, middle)
    return 0.5 * (low + high)


class TooLong(Exception):
    """What happens within a step cannot be resolved: the step must be taken in parts."""


class Follower:
    """Walks along one branch. The only mutable object here; lives for one call."""

    def __init__(
        self,
        family: Family,
        settings: Settings,
        outputs: Outputs,
        checkpoint: Path | None,
        checkpoint_every: float,
        derivative: Slope | None,
    ) -> None:
        self.original = family
        # Structures derive much when they are first used; around a step the same few come back.
        self.family: Family = lru_cache(maxsize=8)(family)
        self.derivative = derivative
        self.settings = settings
        self.outputs = outputs
        self.checkpoint = checkpoint
        self.checkpoint_every = checkpoint_every
        self.written = time.monotonic()
        self.rows: list[Row] = []
        self.events: list[Event] = []
        self.finished = False
        self.ends_at_stop = True
        self.steps = 0
        self.ds = settings.step / settings.range
        self.arclength = 0.0
        self.parameter = settings.start
        self.lowest: Array | None = None  # lowest modes of the last row, to start the next from
        self.known: tuple[Balanced, float, bool] | None = None  # eigenvalue of an end of a step
        self.bend: Bend | None = None  # where no step leads to the anchor
        self.probe: tuple[Balanced, Array] | None = None  # where a critical mode was made last
        # Derivative of the residual with respect to the parameter: where it was made last, at the
        # anchor, and whether it was the same at the anchor before.
        self.seen: tuple[Balanced, tuple[Array, Array]] | None = None
        self.slope: tuple[Array, Array] | None = None
        self.steady = False
        self.origin: Point | None = None  # a bifurcation, which the branch leaves by dx, dp
        self.anchor: Balanced
        self.tangent: Tangent

    # -- geometry -------------------------------------------------------------------------------

    def _inner(self, metric: Array, ax: Array, ap: float, bx: Array, bp: float) -> float:
        s = self.settings
        return float(ax @ (metric * bx)) / s.scale**2 + ap * bp / s.range**2

    def _metric(self, balanced: Balanced) -> Array:
        return np.asarray(balanced.structure.metric(balanced.state), dtype=float)

    def _norm(self, metric: Array, dx: Array, dp: float) -> float:
        return math.sqrt(self._inner(metric, dx, dp, dx, dp))

    def _tangent_at(
        self, balanced: Balanced, parameter: float, along: tuple[Array, float]
    ) -> Tangent:
        place = (parameter, balanced.state, balanced.multipliers, self.settings.range)
        if self.derivative is None:
            slope = slope_beside(self.family, balanced.evaluation, *place)
        else:
            slope = residual_slope(self.family, *place, self.derivative)
        self.seen = (balanced, slope)
        dx, dm = implicit_derivative(balanced.factorization, *slope)
        metric = self._metric(balanced)
        length = self._norm(metric, dx, 1.0)
        if self._inner(metric, dx, 1.0, *along) < 0:
            length = -length
        return Tangent(dx / length, dm / length, 1.0 / length)

    def _compare_slopes(self) -> None:
        """Look whether residuals change with the parameter at the anchor as they did before.

        Corrections across the branch do with the derivative that is known then.
        """
        before, self.slope, self.steady = self.slope, None, False
        if self.seen is not None and self.seen[0] is self.anchor:
            self.slope = self.seen[1]
            self.steady = before is not None and all(
                np.max(np.abs(new - old), initial=0.0) <= _STEADY * np.max(np.abs(new), initial=0.0)
                for new, old in zip(self.slope, before, strict=True)
            )

    def _relative(self, parameter: float, balanced: Balanced) -> Point:
        """Return the place of a state relative to the anchor."""
        structure = balanced.structure
        dx = structure.difference(structure.adopt(self.anchor.state), balanced.state)
        dp = parameter - self.parameter
        metric = self._metric(self.anchor)
        return Point(
            parameter, self._inner(metric, dx, dp, self.tangent.dx, self.tangent.dp), balanced, dx,
            balanced.multipliers - self.anchor.multipliers, dp,
        )  # fmt: skip

    def _displaced(self, parameter: float, dx: Array, dm: Array) -> tuple[Any, Any, Array]:
        structure, state = adopted(self.family, parameter, self.anchor.state)
        if structure.max_step(state, dx) < 1.0:
            raise CorrectionFailed("the prediction leaves the domain of the energy")
        return structure, structure.retract(state, dx), self.anchor.multipliers + dm

    def _correct_at(self, parameter: float, dx: Array, dm: Array, foretold: float = 0.0) -> Point:
        structure, state, multipliers = self._displaced(parameter, dx, dm)
        balanced = correct(
            structure, state, multipliers, tolerance=self.settings.tolerance, foretold=foretold
        )
        return self._relative(parameter, balanced)

    def _correct_across(
        self,
        parameter: float,
        dx: Array,
        dm: Array,
        polish: bool = False,
        contraction: float = CONTRACTION,
        foretold: float = 0.0,
    ) -> Point:
        """Correct in the plane orthogonal to the anchor's tangent."""
        _, state, multipliers = self._displaced(parameter, dx, dm)
        s = self.settings
        row = (
            self._metric(self.anchor) * self.tangent.dx / s.scale**2,
            self.tangent.dp / s.range**2,
        )
        slope = self.slope if self.steady else None
        if slope is None and self.derivative is not None:
            slope = residual_slope(
                self.family, parameter, state, multipliers, s.range, self.derivative
            )
        balanced, parameter = correct_on_plane(
            self.family, parameter, state, multipliers, row, slope, s.range,
            tolerance=s.tolerance, foretold=foretold, polish=polish, contraction=contraction,
            max_iterations=12 if contraction <= CONTRACTION else 40,
        )  # fmt: skip
        return self._relative(parameter, balanced)

    def _interpolated(self, end: Point, sigma: float) -> tuple[float, Array, Array]:
        """Parabola from the anchor, with its tangent, to the end of the step."""
        t, f = self.tangent, (sigma / end.sigma) ** 2
        return (
            self.parameter + sigma * t.dp + f * (end.dp - end.sigma * t.dp),
            sigma * t.dx + f * (end.dx - end.sigma * t.dx),
            sigma * t.dm + f * (end.dm - end.sigma * t.dm),
        )

    def _direction(self, end: Point, sigma: float) -> tuple[Array, Array, float]:
        """Unit tangent of that parabola."""
        t, f = self.tangent, 2 * sigma / end.sigma**2
        dx = t.dx + f * (end.dx - end.sigma * t.dx)
        dm = t.dm + f * (end.dm - end.sigma * t.dm)
        dp = t.dp + f * (end.dp - end.sigma * t.dp)
        length = self._norm(self._metric(self.anchor), dx, dp)
        return dx / length, dm / length, dp / length

    # -- beginnings -----------------------------------------------------------------------------

    def begin(self, initial: Any) -> None:
        s = self.settings
        structure = self.family(s.start)
        if isinstance(initial, Equilibrium):
            try:
                balanced = correct(
                    structure, structure.adopt(initial.state), initial.multipliers,
                    tolerance=s.tolerance,
                )  # fmt: skip
            except CorrectionFailed as error:
                raise InvalidInput(
                    f"argument `initial` is not near an equilibrium of the family at `start` = "
                    f"{s.start}: {error}; pass a state to search from instead"
                ) from error
        else:
            found = equilibrate(structure, initial, require="stable")
            balanced = as_balanced(found)
        self.parameter, self.anchor = s.start, balanced
        zero = np.zeros(structure.size)
        sense = math.copysign(1.0, s.stop - s.start)
        try:
            self.tangent = self._tangent_at(balanced, s.start, (zero, sense))
        except FactorizationError as error:
            raise InvalidInput(
                f"the state at `start` = {s.start} is critical, so that the branch has no direction: "
                "start from another parameter value"
            ) from error
        self._emit("reported" if s.start in s.report_at else "step", balanced, s.start, 0.0)

    def begin_at_bifurcation(
        self, event: Event, sign: int, mode: int | Array, amplitude: float | None
    ) -> None:
        s = self.settings
        self.ends_at_stop = False
        origin = as_balanced(event.equilibrium)
        self.anchor, self.parameter = origin, event.equilibrium_parameter
        metric = self._metric(origin)
        # The direction across the old branch, in the plane of its tangent and the critical mode.
        old_dx, _, old_dp = event.direction
        dx, dp = (event.modes[mode] if isinstance(mode, int) else np.array(mode)), 0.0
        share = self._inner(metric, dx, dp, old_dx, old_dp)
        dx, dp = dx - share * old_dx, dp - share * old_dp
        length = sign * self._norm(metric, dx, dp)
        if not abs(length) > 0:
            raise InvalidInput("the critical mode lies along the branch itself: nothing crosses it")
        m = origin.multipliers.size
        self.tangent = Tangent(dx / length, np.zeros(m), dp / length)
        first: Point | None = None
        tried = (amplitude,) if amplitude is not None else (0.01, 0.003, 0.03, 0.001, 0.1, 0.3)
        for size in tried:
            try:
                point = self._correct_across(
                    self.parameter + size * self.tangent.dp, size * self.tangent.dx,
                    np.zeros(m), contraction=0.95,
                )  # fmt: skip
            except (CorrectionFailed, FactorizationError):
                continue
            far = self._norm(metric, point.dx, point.dp) > 4 * size
            if far or point.balanced.marginal:
                continue
            first = point
            break
        if first is None:
            raise BranchInterrupted(
                f"no state was found on the branch that crosses at {event.parameter:.6g}, at distances "
                f"{tried} along its mode; pass another `amplitude`, another `mode`, or locate the "
                "event with a smaller `event_tolerance`",
                state=event.equilibrium.state,
            )  # fmt: skip
        self._emit("event", origin, self.parameter, 0.0)
        self.anchor, self.parameter = first.balanced, first.parameter
        self.arclength = self._norm(metric, first.dx, first.dp)
        try:
            self.tangent = self._tangent_at(first.balanced, first.parameter, (first.dx, first.dp))
        except FactorizationError:
            length = self._norm(metric, first.dx, first.dp)
            self.tangent = Tangent(first.dx / length, first.dm / length, first.dp / length)
        self.ds = min(self.ds, self.arclength)
        self.origin = replace(first, parameter=event.equilibrium_parameter, balanced=origin)
        kind = "reported" if self.parameter in s.report_at else "step"
        self._emit(kind, first.balanced, self.parameter, self.arclength)

    # -- the walk -------------------------------------------------------------------------------

    def run(self, progress: bool | None = None) -> None:
        """Walk to the end of the branch."""
        with _progress.bar("follow", progress, unit=" steps") as bar:
            self._walk(bar)

    def _walk(self, bar: Any) -> None:
        try:
            while not self.finished:
                if self.steps >= self.settings.max_steps:
                    raise self._interrupted(
                        f"the branch has not come to its end after {self.steps} steps, at parameter "
                        f"{self.parameter:.8g}; raise `max_steps`, or give `bounds`"
                    )
                self.steps += 1
                self._advance()
                bar.update()
                if not bar.disable:
                    bar.set_postfix_str(f"parameter {self.parameter:.6g}", refresh=False)
                if self.checkpoint and time.monotonic() - self.written > self.checkpoint_every:
                    self._write()
        finally:
            if self.checkpoint and self.rows:
                self._write()

    def _interrupted(self, message: str) -> BranchInterrupted:
        return BranchInterrupted(
            f"{message}; the attribute `branch` of this error holds the {len(self.rows)} states found",
            history=self.anchor.history, state=self.anchor.state,
        )  # fmt: skip

    def _ends(self) -> list[tuple[float, str]]:
        s = self.settings
        ends = [(s.stop, "stop")] if self.ends_at_stop else []
        return ends + [(b, "bound") for b in (s.lower, s.upper) if b is not None]

    def _advance(self) -> None:
        """Take one step, with everything that happens on it."""
        while True:
            home = self._home()
            end, tangent = self._step() if home is None else (home, self.tangent)
            try:
                if home is None:
                    end, last, crossings, reports = self._within(end, tangent)
                else:
                    last, crossings = End(home.sigma, home, "closed"), []
                    reports = self._reports([(None, home)], home, home.sigma)
                break
            except TooLong as error:
                length = self._norm(self._metric(self.anchor), end.dx, end.dp)
                if length * _SHORTER < _SHORTEST_STEP:
                    raise self._interrupted(str(error)) from error
                self.ds = length * _SHORTER
        marks: list[tuple[float, int, Any]] = [(point.sigma, 0, point) for point in reports]
        marks += [(crossing.sigma, 1, crossing) for crossing in crossings]
        metric = self._metric(self.anchor)
        for _, kind, mark in sorted(marks, key=lambda mark: mark[:2]):
            if kind == 0:
                where = self.arclength + self._norm(metric, mark.dx, mark.dp)
                self._emit("reported", mark.balanced, mark.parameter, where)
            elif self._event(mark, end):
                return
        final = end if last is None else last.point
        self.arclength += self._norm(metric, final.dx, final.dp)
        reported = final.parameter in self.settings.report_at
        self._emit(
            "reported" if reported else "step", final.balanced, final.parameter, self.arclength
        )
        if last is not None:
            if last.reason != "stop":
                self._end_event(last, metric)
            self.finished = True
        old, before, behind = self.anchor, self.parameter, self.tangent
        self.anchor, self.parameter, self.tangent = final.balanced, final.parameter, tangent
        self.bend = self._bend_behind(old, before, behind)
        self._compare_slopes()

    def _within(
        self, end: Point, tangent: Tangent
    ) -> tuple[Point, End | None, list[Crossing], list[Point]]:
        """Return what happens on a step: its end, the end of the branch, events, and reports."""
        turned = tangent.dp * self.tangent.dp < 0
        last = self._end_between([(None, end)]) if not turned else None
        if last is not None and last.sigma < end.sigma:
            end, last = last.point, End(last.point.sigma, last.point, last.reason)
        start = Point(
            self.parameter, 0.0, self.anchor, np.zeros_like(end.dx), np.zeros_like(end.dm), 0.0
        )
        crossings: list[Crossing] = []
        if not self._hides_index(end):
            self._refuse_hidden_changes(end)
            crossings = self._classified(end, self._located(start, end, end), turned)
        if turned and not crossings:
            crossings = [self._vertex(start, end, tangent)]
        pieces: list[tuple[Point | None, Point]] = []
        begin: Point | None = None
        for crossing in crossings:
            if crossing.fold:
                pieces.append((begin, crossing.left))
                begin = crossing.right
        pieces.append((begin, end))
        if last is None and turned:
            last = self._end_between(pieces)
        if last is None and len(self.rows) > 3:
            last = self._closed(pieces)
        limit = end.sigma if last is None else last.sigma
        reports = self._reports(pieces, end, limit)
        return end, last, [c for c in crossings if c.sigma <= limit], reports

    def _step(self) -> tuple[Point, Tangent]:
        """Return the end of an accepted step, and the tangent there. Adapts the step."""
        s = self.settings
        reason = ""
        metric = self._metric(self.anchor)
        longest, foretold = self.ds, _FORETOLD * s.tolerance
        while True:
            ds = min(self.ds, s.max_step / s.range)
            if ds < _SHORTEST_STEP:
                raise self._interrupted(
                    f"the branch cannot be continued at parameter {self.parameter:.10g}: steps became "
                    f"shorter than {_SHORTEST_STEP:g} of the interval ({reason}); check that the "
                    "family is smooth there, and its derivatives right"
                )
            t = self.tangent
            natural = abs(t.dp) > _NATURAL * s.range
            target = self.parameter + ds * t.dp
            if natural:
                for value, _ in self._ends():  # hit the end exactly
                    if (value - self.parameter) * (target - value) > 0:
                        target = value
                ds = (target - self.parameter) / t.dp
            dx, dm, dp = self._predicted(ds)
            try:
                if natural:
                    # Along the tangent to where the parameter is right.
                    missing = (target - self.parameter - dp) / t.dp
                    point = self._correct_at(
                        target, dx + missing * t.dx, dm + missing * t.dm, foretold
                    )
                else:
                    point = self._correct_across(self.parameter + dp, dx, dm, foretold=foretold)
                if self._hides_index(point):
                    if natural and any(target == value for value, _ in self._ends()):
                        return point, t  # an end of the interval is critical itself
                    raise CorrectionFailed("the state is critical to working precision")
                deviation = self._norm(
                    metric, point.dx - ds * t.dx, point.dp - ds * t.dp
                ) / ds  # fmt: skip
                if deviation > _LARGEST_DEVIATION:
                    if ds < 1e-3 * longest:
                        # Steps as short as this follow the tangent. The one at hand was that of the
                        # step before (see `_next_tangent`), behind which the branch bent sharply.
                        self.tangent = self._tangent_at(self.anchor, self.parameter, (t.dx, t.dp))
                        self.bend, longest = None, 0.0  # once
                    raise CorrectionFailed(f"the branch bends by {deviation:.2g} of the step")
                tangent = self._next_tangent(point, deviation)
                if ds > 1e-5:
                    self._refuse_hidden_turns(point, tangent)
            except (CorrectionFailed, FactorizationError) as error:
                reason = str(error)
                self.ds = ds * _SHORTER
                continue
            break
        made = point.balanced.iterations + (point.balanced.correction > s.tolerance)  # or foretold
        growth = min(2.0, 1.5 * 0.7 ** (made - 3))
        growth = min(growth, math.sqrt(_WANTED_DEVIATION / max(deviation, 1e-12)) + 0.3)
        self.ds = ds * max(0.4, growth) if ds >= 0.999 * self.ds or growth < 1 else self.ds
        return point, tangent

    def _predicted(self, ds: float) -> tuple[Array, Array, float]:
        """Return the increments from the anchor at which a step of projection `ds` is looked for."""
        t = self.tangent
        dx, dm, dp = ds * t.dx, ds * t.dm, ds * t.dp
        if self.bend is not None:
            off = self.bend.at(ds)
            if self._norm(self._metric(self.anchor), off.dx, off.dp) <= _LARGEST_DEVIATION * ds:
                return dx + off.dx, dm + off.dm, dp + off.dp
        return dx, dm, dp

    def _bend_behind(self, old: Balanced, parameter: float, tangent: Tangent) -> Bend | None:
        """Return how the branch bends at the anchor, by the step that led to it from `old`."""
        structure = self.anchor.structure
        dx = structure.difference(self.anchor.state, structure.adopt(old.state))
        dm = old.multipliers - self.anchor.multipliers
        dp = parameter - self.parameter
        t, metric = self.tangent, self._metric(self.anchor)
        sigma = self._inner(metric, dx, dp, t.dx, t.dp)
        rate = self._inner(metric, tangent.dx, tangent.dp, t.dx, t.dp)
        if not (sigma < 0.0 and rate > 0.5):
            return None

        def powers(gap: Any, here: Any, before: Any) -> tuple[Any, Any]:
            chord = (gap - sigma * here) / sigma**2
            turn = (before / rate - here) / sigma
            return 3.0 * chord - turn, (turn - 2.0 * chord) / sigma

        parts = (
            powers(dx, t.dx, tangent.dx), powers(dm, t.dm, tangent.dm), powers(dp, t.dp, tangent.dp)
        )  # fmt: skip
        two, three = (Tangent(*(part[k] for part in parts)) for k in (0, 1))
        return Bend(two, three)

    def _refuse_hidden_turns(self, point: Point, tangent: Tangent) -> None:
        """Raise if the parameter seems to turn, and turn back, within a step."""
        if tangent.dp * self.tangent.dp < 0:
            return  # looked for in `_within`
        if point.dp * self.tangent.dp <= 0:
            raise CorrectionFailed("the parameter turns twice")
        # Slope of the cubic that fits values and slopes at both ends, over the mean slope.
        length = self._norm(self._metric(self.anchor), point.dx, point.dp)
        a, b = self.tangent.dp * length / point.dp, tangent.dp * length / point.dp
        bend = 3.0 * (a + b - 2.0)
        place = (2.0 * a + b - 3.0) / bend if bend > 0 else 0.0
        if 0.0 < place < 1.0 and a - bend * place**2 < -1e-3:
            raise CorrectionFailed("the parameter seems to turn twice")

    def _refuse_hidden_changes(self, end: Point) -> None:
        """Raise if stability is lost and regained within a step, when there is reason to look.

        There is when an eigenvalue at either end is smaller than its changes from step to step.
        """
        if not self.settings.eigenvalues or end.index != self.anchor.index:
            return
        values = [row.smallest_eigenvalue for row in self.rows[-2:]]
        if end.index > 0 or len(values) < 2 or not np.all(np.isfinite(values)):
            return
        self.known = (
            end.balanced,
            *self._smallest(end.balanced, as_equilibrium(end.balanced, factors=True)),
        )
        values.append(self.known[1])
        if min(values[1:]) < max(abs(np.diff(values))):
            if self._interpolated_index(end, 0.5 * end.sigma) == end.index:
                return
            middle = self._on_step(end, 0.5 * end.sigma)
            if middle.index != end.index and not middle.balanced.marginal:
                raise TooLong("stability is lost and regained within one step")

    def _interpolated_index(self, end: Point, sigma: float) -> int | None:
        """Return the number of unstable directions on the parabola through the step.

        It differs from the branch by the third power of the step; None if it cannot be told there.
        """
        try:
            structure, state, multipliers = self._displaced(*self._interpolated(end, sigma))
            kkt = structure.evaluate(state, multipliers, 2).kkt
            factors = kkt.factorize(gauge=gauge_of(structure, state))
        except (CorrectionFailed, FactorizationError):
            return None
        return None if factors.inertia[2] else factors.index

    def _next_tangent(self, point: Point, deviation: float) -> Tangent:
        metric = self._metric(self.anchor)
        tangent = self._tangent_at(point.balanced, point.parameter, (point.dx, point.dp))
        turn = self._inner(metric, tangent.dx, tangent.dp, self.tangent.dx, self.tangent.dp)
        dx, dm, dp = self._direction(point, point.sigma)
        agreement = self._inner(metric, tangent.dx, tangent.dp, dx, dp)
        if deviation <= 0.1 and agreement < 0.9 and abs(tangent.dp) < abs(dp):
            # The step itself is straight. Next to a bifurcation the solution for the tangent is
            # polluted by the critical mode, which has no share of the parameter; the parabola through
            # the step is not. (A tangent with more of the parameter is that of another branch.)
            return Tangent(dx, dm, dp)
        if turn >= _LARGEST_TURN:
            if agreement < _LARGEST_TURN:
                raise CorrectionFailed("the step ends across its own direction")
            return tangent
        raise CorrectionFailed(f"the tangent turns by {math.degrees(math.acos(turn)):.0f} degrees"
                               if abs(turn) <= 1 else "the tangent changes its length")  # fmt: skip

    # -- where a parameter value is met -----------------------------------------------------------

    def _met(self, value: float, left: Point | None, right: Point, end: Point) -> Point:
        """Return the state at exactly `value` between two points of a monotone piece."""
        low, p_low = (0.0, self.parameter) if left is None else (left.sigma, left.parameter)
        high, p_high = right.sigma, right.parameter
        if value == p_high:
            return right
        slack = 1e-9 * end.sigma
        for attempt in range(60):
            # Invert the parabola of the step inside the bracket.
            a, b = low, high
            if attempt % 3 == 2:
                a = b = 0.5 * (low + high)
            for _ in range(60):
                if b - a <= 1e-3 * (high - low):
                    break
                mid = 0.5 * (a + b)
                above = self._interpolated(end, mid)[0] >= value
                a, b = (a, mid) if above == (p_high > p_low) else (mid, b)
            sigma = 0.5 * (a + b)
            _, dx, dm = self._interpolated(end, sigma)
            try:
                point = self._correct_at(value, dx, dm)
                if low - slack <= point.sigma <= high + slack:
                    return point
            except (CorrectionFailed, FactorizationError):
                pass
            if high - low <= 1e-12 * end.sigma:
                break
            point = self._on_step(end, sigma)
            if (point.parameter >= value) == (p_high > p_low):
                high = sigma
            else:
                low = sigma
        raise TooLong(
            f"no state was found at parameter {value:.10g}, although the branch passes it between "
            f"{p_low:.10g} and {p_high:.10g}; leave this value out, or move it off the fold"
        )

    def _end_between(self, pieces: list[tuple[Point | None, Point]]) -> End | None:
        """Return the first end of the branch on monotone pieces of the step."""
        found: list[End] = []
        end = pieces[-1][1]
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            for value, reason in self._ends():
                passed = (value - before) * (right.parameter - value)
                if (passed > 0 or value == right.parameter) and value != before:
                    point = self._met(value, left, right, end)
                    found.append(End(point.sigma, point, reason))
        return min(found, key=lambda item: item.sigma, default=None)

    def _closed(self, pieces: list[tuple[Point | None, Point]]) -> End | None:
        """Return the place where the branch comes back to its first state, if it does."""
        first = self.rows[0]
        end = pieces[-1][1]
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            if not (first.parameter - before) * (right.parameter - first.parameter) > 0:
                continue
            structure, metric = self.anchor.structure, self._metric(self.anchor)
            far = structure.difference(self.anchor.state, structure.adopt(first.equilibrium.state))
            if self._norm(metric, far, 0.0) > 2 * self._norm(metric, end.dx, end.dp):
                continue
            point = self._met(first.parameter, left, right, end)
            structure = point.balanced.structure
            gap = structure.difference(first.equilibrium.state, point.balanced.state)
            if self._norm(metric, gap, 0.0) <= _SAME:
                return End(point.sigma, point, "closed")
        return None

    def _home(self) -> Point | None:
        """Return the bifurcation at which the branch began, if it comes back to it just ahead.

        At a pitchfork the parameter turns there, and no value of it is passed that would tell. The
        parabola that ends in the bifurcation must follow the branch; if it might, the steps are
        shortened. (It need not come from where the branch left: see the lemniscate of the tests.)
        """
        if self.origin is None or len(self.rows) < 5:
            return None
        origin, metric = self.origin, self._metric(self.anchor)
        point = self._relative(origin.parameter, origin.balanced)
        t, length = self.tangent, point.sigma
        if not 0.0 < length <= 2.0 * min(self.ds, self.settings.max_step / self.settings.range):
            return None
        off = self._norm(metric, point.dx - length * t.dx, point.dp - length * t.dp)
        if off > _LARGEST_DEVIATION * length or point.dp * t.dp < 0:
            return None
        if any(
            (value - self.parameter) * (origin.parameter - value) > 0 for value, _ in self._ends()
        ):
            return None
        parameter, dx, dm = self._interpolated(point, 0.5 * length)
        try:
            middle = self._correct_across(parameter, dx, dm)
            off = self._norm(metric, middle.dx - dx, middle.parameter - parameter)
            if off <= _SAME and middle.index == self.anchor.index:
                return point
        except (CorrectionFailed, FactorizationError):
            pass
        if length > 1e3 * _SAME:
            self.ds = min(self.ds, 0.5 * length)
        return None

    def _reports(
        self, pieces: list[tuple[Point | None, Point]], end: Point, limit: float
    ) -> list[Point]:
        points = []
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            for value in self.settings.report_at:
                if (value - before) * (right.parameter - value) > 0:
                    point = self._met(value, left, right, end)
                    if point.sigma < limit:
                        points.append(point)
        return points

    # -- events -----------------------------------------------------------------------------------

    def _on_step(
        self, end: Point, sigma: float, left: Point | None = None, right: Point | None = None
    ) -> Point:
        """Return the state of the branch at projection `sigma` of the step.

        Two known states `left` and `right` of it around that place make the guess better.
        """
        reason: Exception | None = None
        # Rounding errors of a state hide its index only where it is nearer to a critical one than
        # brackets are short.
        polish = self.settings.event_tolerance < _COARSE
        # A neighboring place will do when the corrector stumbles over a critical state.
        for nudge in (0.0, 1e-3, -1e-3, 1e-2, -1e-2):
            place = sigma * (1 + nudge)
            if not 0 < place < end.sigma:
                continue
            parameter, dx, dm = self._interpolated(end, place)
            if left is not None and right is not None:
                for known, other in ((left, right), (right, left)):
                    weight = (place - other.sigma) / (known.sigma - other.sigma)
                    there = self._interpolated(end, known.sigma)
                    parameter += weight * (known.parameter - there[0])
                    dx += weight * (known.dx - there[1])
                    dm += weight * (known.dm - there[2])
            try:
                return self._correct_across(parameter, dx, dm, polish=polish)
            except (CorrectionFailed, FactorizationError) as error:
                reason = error
        raise TooLong(
            f"no state was found at parameter {self._interpolated(end, sigma)[0]:.10g}, within an "
            f"accepted step ({reason}); use a smaller `max_step`"
        )

    def _located(self, left: Point, right: Point, end: Point) -> list[Crossing]:
        """Return the changes of index between two points, each in a short bracket."""
        if left.index == right.index:
            return []
        shortest = self.settings.event_tolerance
        # Where a few halvings will do, interpolation between eigenvalues spares nothing.
        halvings = math.log2(max((right.sigma - left.sigma) / shortest, 1.0))
        single = abs(left.index - right.index) == 1 and halvings > _FEW
        values = (math.nan, math.nan)
        probe = self._probe(right) if single else None
        if probe is not None:
            values = (self._test(left, probe), self._test(right, probe))
        last_root, widths = math.nan, [math.inf]
        for _ in range(200):
            width = right.sigma - left.sigma
            if width <= shortest:
                return [Crossing(left, right, values)]
            root = left.sigma + 0.5 * width
            slow = len(widths) > 3 and width > 0.3 * widths[-3]
            widths.append(width)
            if values[0] * values[1] < 0 and not slow:
                root = left.sigma + width * values[0] / (values[0] - values[1])
                change = abs(root - last_root) if math.isfinite(last_root) else 0.2 * width
                last_root = root
                # Aim a little beyond the root, so that the far end of the bracket comes close.
                aside = max(change, 0.4 * shortest)
                root += aside if right.sigma - root > root - left.sigma else -aside
                inside = min(0.4 * shortest, 0.5 * width)
                root = min(max(root, left.sigma + inside), right.sigma - inside)
            middle = self._on_step(end, root, left, right)
            if middle.balanced.marginal:
                return [Crossing(left, right, exact=middle)]
            if not left.sigma < middle.sigma < right.sigma:
                if width > 1e3 * shortest:
                    raise TooLong(
                        f"states near parameter {middle.parameter:.10g} do not follow one another"
                    )
                return [Crossing(left, right, values)]  # rounding: it cannot be divided further
            if middle.index == left.index:
                left = middle
                values = (self._test(left, probe), values[1])
            elif middle.index == right.index:
                right = middle
                values = (values[0], self._test(right, probe))
            else:
                return self._located(left, middle, end) + self._located(middle, right, end)
        return [Crossing(left, right, values)]

    def _vertex(self, start: Point, end: Point, tangent: Tangent) -> Crossing:
        """Return the place where the parameter turns although the index does not change.

        So a branch looks that crosses another one at a pitchfork, on the way from one half to its
        mirror image. A fold and another change of the index would be seen between the states that are
        returned on both sides of it.
        """
        length = end.sigma
        narrow = 0.5 * min(math.sqrt(self.settings.event_tolerance), length)
        if length <= 2.0 * narrow:
            return Crossing(start, end, fold=True)
        rate = self._inner(
            self._metric(self.anchor), tangent.dx, tangent.dp, self.tangent.dx, self.tangent.dp
        )
        # The parameter on the cubic with the tangents at both ends: zero of its derivative.
        first, last, mean = self.tangent.dp, tangent.dp / rate, end.dp / length
        place = _zero_of_quadratic(
            first, 6.0 * mean - 4.0 * first - 2.0 * last, 3.0 * (first + last - 2.0 * mean)
        )
        at, half = length * place, 0.1 * length
        left, right = start, end
        for _ in range(8):
            half = max(half, narrow)
            low, high = at - half, at + half
            if low > left.sigma:
                left = self._on_step(end, low, left, right)
            if high < right.sigma:
                right = self._on_step(end, high, left, right)
            if left.index != start.index or right.index != start.index:
                raise TooLong("the parameter turns where the index changes twice")
            width = right.sigma - left.sigma
            if width <= 2.1 * narrow:
                return Crossing(left, right, fold=True)
            # The parabola through both places, with the curvature of the branch.
            bend = (last - first) / length
            at = 0.5 * (left.sigma + right.sigma) - (right.dp - left.dp) / (width * bend)
            at = min(max(at, left.sigma + 0.1 * width), right.sigma - 0.1 * width)
            half = 0.05 * width
        raise TooLong(f"no turn of the parameter was found near {left.parameter:.10g}")

    def _probe(self, point: Point) -> Array | None:
        """Return the mode of the eigenvalue of smallest size, or None beside a singular matrix."""
        if self.probe is None or self.probe[0] is not point.balanced:
            try:
                mode = critical_modes(point.balanced, 1, iterations=6)[1][0]
            except FactorizationError:
                return None
            self.probe = (point.balanced, mode)
        return self.probe[1]

    def _test(self, point: Point, probe: Array | None) -> float:
        """Return a function that goes through zero where an eigenvalue does.

        Near there it is the eigenvalue itself, if `probe` is about its mode: the inverse of the second
        variation's inverse on it.
        """
        balanced = point.balanced
        if probe is None:
            return math.nan
        load = self._metric(balanced) * probe
        try:
            image, _ = balanced.factorization.solve(load)
        except FactorizationError:
            return math.nan
        inverse = float(load @ image)
        return 1.0 / inverse if inverse else math.nan

    def _hides_index(self, point: Point) -> bool:
        """Return whether rounding errors hide the index of the end of a step."""
        balanced = point.balanced
        if balanced.marginal or point.index == self.anchor.index:
            return balanced.marginal
        probe = self._probe(point)
        if probe is None:
            return True
        return abs(self._test(point, probe)) <= self._floor(balanced, probe)

    def _classified(self, end: Point, crossings: list[Crossing], turned: bool) -> list[Crossing]:
        """Tell folds from bifurcations: only at a fold does the parameter turn."""
        if not crossings:
            return []
        signs = [math.copysign(1.0, self.tangent.dp)]
        for one, other in itertools.pairwise(crossings):
            between = self._on_step(end, 0.5 * (one.sigma + other.sigma))
            direction = self._direction(end, between.sigma)
            try:
                tangent = self._tangent_at(between.balanced, between.parameter, direction[::2])
                signs.append(math.copysign(1.0, tangent.dp))
            except FactorizationError:
                signs.append(math.copysign(1.0, direction[2]))
        signs.append(-signs[0] if turned else signs[0])
        for crossing in crossings:
            left, right = crossing.left, crossing.right
            gap = self._norm(
                self._metric(self.anchor), right.dx - left.dx, right.dp - left.dp
            ) - 10 * (right.sigma - left.sigma)  # fmt: skip
            if gap > 1e-6:
                raise TooLong(
                    f"the states on both sides of a change of stability at parameter "
                    f"{left.parameter:.10g} belong to different branches"
                )
        return [
            replace(crossing, fold=signs[i] != signs[i + 1]) for i, crossing in enumerate(crossings)
        ]

    def _event(self, crossing: Crossing, end: Point) -> bool:
        """Record a fold or a bifurcation. Return whether the walk does not go on from the step."""
        s = self.settings
        left, right = crossing.left, crossing.right
        stable_side = left if left.index <= right.index else right
        count = max(abs(left.index - right.index), 1)
        _, modes = critical_modes(stable_side.balanced, count)
        direction = self._direction(end, crossing.sigma)
        metric = self._metric(self.anchor)
        if crossing.exact is not None:
            parameter = crossing.exact.parameter
            bracket = max(abs(left.parameter - parameter), abs(right.parameter - parameter))
        else:
            parameter = 0.5 * (left.parameter + right.parameter)
            bracket = 0.5 * abs(left.parameter - right.parameter)
        width = right.sigma - left.sigma
        if crossing.fold:
            # The parameter is extremal within the bracket: its curvature bounds what is missed.
            bracket += abs(end.dp - end.sigma * self.tangent.dp) * (width / end.sigma) ** 2
            if float(modes[0] @ (metric * direction[0])) < 0:
                modes = modes * np.array([-1.0] + [1.0] * (count - 1))[:, None]
        where = self.arclength + self._norm(metric, stable_side.dx, stable_side.dp)
        kind = "fold" if crossing.fold else "bifurcation"
        bracket = max(bracket, 4 * np.finfo(float).eps * max(abs(parameter), s.range))
        bracket += stable_side.balanced.correction * s.range
        bracket += self._hidden(crossing, stable_side, modes[0])
        row = self._emit("event", stable_side.balanced, stable_side.parameter, where)
        event = Event(
            kind=kind, parameter=float(parameter), uncertainty=float(bracket), arclength=where,
            equilibrium=self.rows[row].equilibrium, row=row, modes=modes,
            index_before=left.index, index_after=right.index, direction=direction,
            equilibrium_parameter=stable_side.parameter,
            detail=f"{kind}: the number of unstable directions goes from {left.index} to {right.index}",
        )  # fmt: skip
        self.events.append(event)
        lost = left.index == 0
        if s.on_fold == "stop" and (crossing.fold or lost):
            self._arrive(left if lost else stable_side, direction, where)
            self.finished = True
            return True
        if s.on_fold == "snap" and lost:
            self._snap(event, crossing, end, direction)
            return True
        return False

    def _hidden(self, crossing: Crossing, near: Point, mode: Array) -> float:
        """Return the range of the parameter in which rounding hides the sign of the eigenvalue."""
        floor = self._floor(near.balanced, mode)
        values = crossing.values
        if not np.all(np.isfinite(values)):
            values = (self._test(crossing.left, mode), self._test(crossing.right, mode))
        change = abs(values[1] - values[0])
        run = abs(crossing.right.parameter - crossing.left.parameter)
        return 0.0 if not change > 0 else min(floor / change, 1e3) * run

    def _floor(self, balanced: Balanced, mode: Array) -> float:
        """Return the rounding error of the eigenvalue of a mode."""
        kkt = balanced.evaluation.kkt
        assert kkt is not None
        terms, _ = kkt.magnitude(mode, np.zeros_like(balanced.multipliers))
        return float(balanced.structure.noise(balanced.state)) * float(np.abs(mode) @ terms)

    def _arrive(self, point: Point, direction: tuple[Array, Array, float], where: float) -> None:
        self.anchor, self.parameter = point.balanced, point.parameter
        self.tangent, self.arclength = Tangent(*direction), where

    def _end_event(self, last: End, metric: Array) -> None:
        words = {
            "bound": "the branch leaves its bounds",
            "closed": "the branch has come back to its first state",
        }
        index = last.point.index
        self.events.append(
            Event(
                kind="end",
                parameter=last.point.parameter,
                uncertainty=0.0,
                arclength=self.arclength,
                equilibrium=self.rows[-1].equilibrium,
                row=len(self.rows) - 1,
                modes=np.zeros((0, last.point.dx.size)),
                index_before=index,
                index_after=index,
                direction=(self.tangent.dx, self.tangent.dm, self.tangent.dp),
                equilibrium_parameter=last.point.parameter,
                detail=words[last.reason],
            )
        )

    def _snap(
        self, event: Event, crossing: Crossing, end: Point, direction: tuple[Array, Array, float]
    ) -> None:
        """Freeze the parameter just beyond the loss of stability, descend, and begin anew."""
        s = self.settings
        left = crossing.left
        sense = math.copysign(1.0, self.tangent.dp)
        frozen = event.parameter + sense * max(s.overshoot * s.range, 10 * event.uncertainty)
        for value, _ in self._ends():
            if (value - self.parameter) * (frozen - value) > 0:
                frozen = value
        signs = (1,) if crossing.fold else (s.sign, -s.sign)
        self._arrive(left, direction, event.arclength)
        after, energy = descend(
            self.family(frozen), left.balanced, event.modes, signs, self._interrupted
        )
        row = self._emit("event", as_balanced(after), frozen, event.arclength)
        self.events.append(
            replace(
                event,
                kind="snap",
                after=self.rows[row].equilibrium,
                after_row=row,
                energy_released=energy - after.energy,
                detail=f"snap after a {event.kind}, with the parameter frozen at {frozen:.10g}",
            )
        )
        self.anchor, self.parameter, self.bend = as_balanced(after), frozen, None
        self.ds = s.step / s.range
        zero = np.zeros_like(left.dx)
        self.tangent = self._tangent_at(self.anchor, frozen, (zero, sense))
        self.finished = self.ends_at_stop and frozen == s.stop

    # -- rows -------------------------------------------------------------------------------------

    def _emit(self, kind: str, balanced: Balanced, parameter: float, arclength: float) -> int:
        full = as_equilibrium(balanced, factors=True)
        value, marginal = math.nan, balanced.marginal
        if self.settings.eigenvalues and not marginal:
            if self.known is not None and self.known[0] is balanced:
                _, value, marginal = self.known
            else:
                value, marginal = self._smallest(balanced, full)
        outputs: dict[str, float] = {}
        for name, function in self.outputs.items():
            result = np.asarray(function(full))
            if result.shape != () or result.dtype.kind not in "biuf":
                raise InvalidInput(
                    f"the output {name!r} returned {result!r} at parameter {parameter:.8g}; it must "
                    "return a number"
                )
            outputs[name] = float(result)
        self.rows.append(
            Row(
                kind,
                float(parameter),
                float(arclength),
                value,
                balanced.index,
                marginal,
                outputs,
                as_equilibrium(balanced),
            )
        )
        return len(self.rows) - 1

    def _smallest(self, balanced: Balanced, full: Equilibrium) -> tuple[float, bool]:
        """Return the smallest eigenvalue, and whether rounding hides its sign."""
        assert balanced.evaluation.kkt is not None
        free = admissible_motions(balanced.evaluation.kkt, balanced.factorization.g)
        if free < 1:  # the constraints leave no motion: nothing that could be unstable
            return math.nan, False
        if self.lowest is not None and balanced.stable:
            warm = lowest_of_stable(balanced, self.lowest)
            if warm is not None:
                self.lowest = warm[1]
                return warm[0], warm[0] <= warm[2]
        try:
            spectrum = smallest_eigenvalue(full, count=min(3, free))
        except (FactorizationError, StabilityNotResolvable, NotConverged):
            return math.nan, False
        self.lowest = spectrum.modes
        value = float(spectrum.values[0])
        return value, abs(value) <= spectrum.floor

    # -- files ------------------------------------------------------------------------------------

    def _write(self) -> None:
        assert self.checkpoint is not None
        meta, arrays = pack(self.rows, self.events, self.settings, self.finished)
        meta["cursor"] = {
            "steps": self.steps, "ds": self.ds, "arclength": self.arclength,
            "parameter": self.parameter, "dp": self.tangent.dp, "ends_at_stop": self.ends_at_stop,
        }  # fmt: skip
        arrays |= {"cursor.dx": self.tangent.dx, "cursor.dm": self.tangent.dm}
        for name in ("two", "three") if self.bend is not None else ():
            power = getattr(self.bend, name)
            meta["cursor"][name] = power.dp
            arrays |= {f"cursor.{name}.dx": power.dx, f"cursor.{name}.dm": power.dm}
        arrays |= _archive.pack_values("cursor.state", [self.anchor.state])
        arrays["cursor.multipliers"] = self.anchor.multipliers
        _archive.write(self.checkpoint, meta, arrays)
        self.written = time.monotonic()

    def resume(self) -> bool:
        """Take up what the checkpoint holds. Return whether there is one."""
        assert self.checkpoint is not None
        if not self.checkpoint.exists():
            return False
        path = self.checkpoint
        meta, arrays = _archive.read(path, "branch")
        found = settings_from(meta, path)
        wanted = self.settings
        # A larger number of steps is what one asks for after too few.
        if replace(found, max_steps=wanted.max_steps) != wanted:
            names = [k for k, v in asdict(wanted).items() if asdict(found)[k] != v]
            raise InvalidInput(
                f"argument `checkpoint` is {str(path)!r}, which belongs to a call with other values of "
                f"{', '.join(names)}; repeat that call, or name another file"
            )
        rows, events, _, self.finished = unpack(meta, arrays, self.original, path)
        self.rows, self.events = list(rows), list(events)
        cursor = needed(meta, "cursor", path)
        self.steps, self.ds = int(cursor["steps"]), float(cursor["ds"])
        self.arclength = float(cursor["arclength"])
        self.parameter = float(cursor["parameter"])
        self.ends_at_stop = bool(cursor["ends_at_stop"])
        structure = self.family(self.parameter)
        like = self.rows[0].equilibrium.state
        state = _archive.unpack_values("cursor.state", arrays, like, 1)[0]
        try:
            self.anchor = correct(
                structure, structure.adopt(state), arrays["cursor.multipliers"],
                tolerance=self.settings.tolerance, max_iterations=2,
            )  # fmt: skip
        except (CorrectionFailed, KeyError) as error:
            if not self.finished:
                raise not_of_family(path, self.parameter) from error
        self.tangent = Tangent(arrays["cursor.dx"], arrays["cursor.dm"], float(cursor["dp"]))
        if "two" in cursor:
            two, three = (
                Tangent(
                    arrays[f"cursor.{name}.dx"], arrays[f"cursor.{name}.dm"], float(cursor[name])
                )
                for name in ("two", "three")
            )
            self.bend = Bend(two, three)
        return True
