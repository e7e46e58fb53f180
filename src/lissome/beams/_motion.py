"""The slow motion of a strip or ring under light: the driver of the compiled time loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from .._readonly import readonly_property
from .._validate import finite, finite_array, integer_at_least, one_of, positive
from ..errors import InvalidInput, NotConverged
from ..reactions import Reactions
from . import _kernel
from ._structures import ClampedStrip, Elastica, ElasticaState, Ring, residual_floor
from .light import GaussianSpot, Light, ParallelLight, UserLight

__all__ = ["ElasticaHistory", "ElasticaSnap", "Motion", "Period"]

Array = NDArray[np.float64]
SCHEMES = {
    "explicit-euler": _kernel.EXPLICIT_EULER,
    "exponential-1": _kernel.EXPONENTIAL_1,
    "exponential-2": _kernel.EXPONENTIAL_2,
}
DEFAULT_STEP = 0.005
# Steps are shortened where the flux bends more in time than this (see `_kernel.march`).
BENDING = 1.0
PATIENCE = 500  # losses of stability in a row that are none
LOST = 0.3  # smallest eigenvalue (of order 40 for a strip) above which stability is not being lost
# The rest is for a strip whose largest angle is HIGH (radians; that of a span of 0.95); lengths in
# radians and changes of curvature are proportionally less for a flatter one.
HIGH = 0.45
RESOLUTION = 2e-8  # change of the natural curvature within which a loss of stability is enclosed
TURN = 0.3  # radians: largest turn of a tangent in one step
PUSH = 0.05  # radians, along the critical mode of a snap
NEAR = 1e-3  # radians: the equilibrium just after is nearer than this, if it exists
SNAP_DISTANCE = 0.05  # radians: a loss of stability that moves the shape less is no jump
# Smallest eigenvalue that the equilibrium equations, solved to rounding errors, resolve with certainty.
RESOLVED = 2e-5
CHUNK = 512
PERIOD_MEMORY = 25  # jumps that tell the period: three cycles of eight, and one more
DISTINCT = 0.05  # relative difference of the curvatures at two jumps that are surely not the same


class Period(NamedTuple):
    """Period of a limit cycle.

    Attributes
    ----------
    value : float
        In relaxation times.
    uncertainty : float
        Change over the last cycle, and bracket of the snaps. The error of the time step is not in it.
    snaps_per_cycle : int
        Number of snaps in it.
    distance : float
        Change of the natural curvature over the last cycle, relative to its largest value.

    Examples
    --------
    Under oblique light a strip snaps down and up again, and the two halves differ:

    >>> import numpy as np
    >>> from lissome.beams import ClampedStrip, ParallelLight
    >>> strip = ClampedStrip(span=0.95, segments=50)
    >>> history = strip.under(ParallelLight(10.0, angle=np.pi / 4)).run(until=12.0)
    >>> period = history.find_period()
    >>> down, up = np.diff([snap.time for snap in history.snaps[-3:]])
    >>> print(period.snaps_per_cycle, abs(down + up - period.value) < 1e-6, abs(down - up) > 0.1)
    2 True True
    """

    value: float
    uncertainty: float
    snaps_per_cycle: int
    distance: float


@dataclass(frozen=True, eq=False)
class ElasticaSnap:
    """A loss of stability at a fixed instant, and what follows at frozen natural curvature.

    Attributes
    ----------
    time : float
        When (relaxation times).
    uncertainty : float
        Half of the bracket that holds the instant, for the given time steps.
    kind : str
        ``"snap"``: a jump to another shape; ``"bifurcation"``: the shape changes without a jump.
    before, after : ElasticaState
        The shapes before and after.
    curvature : ndarray, shape (k - 1,)
        The natural curvature, frozen.
    mode : ndarray, shape (n,)
        Critical mode of the unknown angles, of unit L2 norm.
    smallest_eigenvalue : float
        Smallest eigenvalue of the second variation just before.
    energy_released : float
        Bending energy before, minus after.
    row : int
        Row of the history with the state before; the state after is in the next one. -1 if the
        history was not recorded.

    Examples
    --------
    The first snap of a strip that buckles upward: at frozen natural curvature the shape turns over
    and energy is released.

    >>> import numpy as np
    >>> from lissome.beams import ClampedStrip, ParallelLight
    >>> strip = ClampedStrip(span=0.95, segments=50)
    >>> light = ParallelLight(10.0, angle=np.pi / 4)
    >>> (snap,) = strip.under(light).run(until=10.0, stop_after=1).snaps
    >>> middle = [strip.positions(state)[25, 1] for state in (snap.before, snap.after)]
    >>> print(snap.kind, np.sign(middle), snap.energy_released > 0)
    snap [ 1. -1.] True
    """

    time: float
    uncertainty: float
    kind: str
    before: ElasticaState = field(repr=False)
    after: ElasticaState = field(repr=False)
    curvature: Array = field(repr=False)
    mode: Array = field(repr=False)
    smallest_eigenvalue: float
    energy_released: float
    row: int = -1


class Runner:
    """Mutable state of a run, and the calls of the compiled loop."""

    def __init__(
        self,
        structure: Elastica,
        light: Light,
        scheme: int,
        step: float,
        initial: Array | None = None,
        curvature: Array | None = None,
        time: float = 0.0,
        resolution: float = RESOLUTION,
        bending: float = BENDING,
    ) -> None:
        self.structure = structure
        self.chain = structure._chain
        k = structure.angles_count
        self.angles = np.array(structure.start().angles if initial is None else initial)
        self.curvature = np.array(structure.present_curvature if curvature is None else curvature)
        self.natural = np.array(structure.rest_curvature)
        self.multipliers = np.zeros(2)
        self.space = _kernel.space_for(self.chain, k)
        self.work = _kernel.chain_work(structure.size, 2)
        self.clock = np.zeros(_kernel.CLOCK_SIZE)
        self.clock[_kernel.COS] = 1.0
        self.clock[_kernel.TIME] = time
        hold = structure.hold if isinstance(structure, Ring) else 0.0
        largest = max(float(np.max(np.abs(a))) for a in (self.curvature, self.natural))
        if isinstance(light, ParallelLight):
            largest += abs(structure.response) * light.intensity
        self.tolerance = residual_floor(structure.segments, largest)
        # A nearly straight strip is as long as its chord and a quarter of its squared amplitude.
        slack = 1.0 - math.hypot(self.chain.chord_x, self.chain.chord_y)
        self.amplitude = min(1.0, 2.0 * math.sqrt(max(slack, 0.0)) / HIGH)
        self.resolution = resolution * self.amplitude
        self.step = step
        self.options = _kernel.Options(
            time,
            step,
            scheme,
            bending,
            self.tolerance,
            self.resolution,
            hold,
            TURN * self.amplitude,
            0,
        )
        gain = structure.response * structure.face(light.side)
        if isinstance(light, UserLight):
            self.lamp = _kernel.Lamp(gain, 0.0, 1.0, structure.face(light.side), 0.0, 0.0)
            self.look: Any = _python_look(structure, light)
            self.march: Any = _kernel.march.py_func
        else:
            self.lamp = _kernel.Lamp(*light._lamp(gain, structure.face(light.side)))
            self.look = _kernel.look_at_lamp
            self.march = _kernel.march
        self.light = light
        self.patience = PATIENCE

    @property
    def time(self) -> float:
        return float(self.clock[_kernel.TIME])

    @property
    def unknown(self) -> Array:
        return self.angles[self.chain.first : self.chain.last]

    @property
    def data(self) -> tuple[Any, ...]:
        return (self.chain, self.angles, self.curvature, self.space.nodes)

    def empty_table(self) -> Array:
        """Return a table for runs that record nothing."""
        return np.zeros((1, _kernel.SCALARS + 2 + 2 * self.angles.size - 1))

    def begin(self) -> None:
        """Descend from the guess to the first equilibrium."""
        if self.descend(2000) != 0:
            raise NotConverged(
                f"no stable shape to begin with: residual {self.clock[_kernel.RESIDUAL]:.3g}; "
                "pass a shape as `initial`",
                state=ElasticaState(self.angles),
            )
        structure = self.structure
        if isinstance(structure, ClampedStrip) and structure.rise == 0.0:
            height = float(np.mean(structure._positions(self.angles)[:, 1]))
            if (height > 0) != (structure.bump == "up") and structure.end_angles == (0.0, 0.0):
                raise NotConverged(
                    f"argument `bump` is {structure.bump!r}, but no stable shape buckled that way "
                    "was found with this natural curvature; pass the other one"
                )

    def descend(self, limit: int) -> int:
        """Descend to a minimum; returns 0 if it was found."""
        status, _, energy, residual = _kernel.descend(
            self.unknown,
            self.multipliers,
            self.data,
            self.space.masses,
            self.tolerance,
            limit,
            TURN * self.amplitude,
            self.work,
        )
        self.clock[_kernel.ENERGY] = energy
        self.clock[_kernel.RESIDUAL] = residual
        return int(status)

    def advance(self, until: float, record_every: int, table: Array) -> tuple[int, int]:
        options = self.options._replace(until=until, record_every=record_every)
        reason, rows = self.march(
            self.clock,
            self.angles,
            self.curvature,
            self.multipliers,
            self.natural,
            self.chain,
            self.lamp,
            self.look,
            options,
            self.work,
            self.space,
            table,
        )
        if reason == _kernel.FAILED:
            raise NotConverged(
                f"no stable equilibrium near the shape at t = {self.time:.6g}",
                state=ElasticaState(self.angles),
            )
        return reason, rows

    def rate(self) -> float:
        """Largest rate of change of the natural curvature."""
        return float(np.max(np.abs(self.space.springs[_kernel.TARGET] - self.curvature)))

    def smallest_eigenvalue(self) -> float:
        """Smallest eigenvalue of the second variation; the mode is left in ``space.mode``."""
        _kernel.evaluate(self.data, self.unknown, self.multipliers, self.work)
        return float(_kernel.smallest_eigenpair(self.space.masses, self.work, self.space.mode))

    def nearby(self) -> bool:
        """Move to the stable equilibrium beside the present shape, if there is one."""
        near = NEAR * self.amplitude
        angles, forces = self.angles.copy(), self.multipliers.copy()
        status, _, energy, residual, _, _, negative, zero, _ = _kernel.correct(
            self.unknown, self.multipliers, self.data, self.tolerance, 12.0, near, self.work
        )
        moved = float(np.max(np.abs(self.angles - angles)))
        if status == 0 and negative == 2 and zero == 0 and moved < near:
            self.clock[_kernel.ENERGY] = energy
            self.clock[_kernel.RESIDUAL] = residual
            return True
        self.angles[:], self.multipliers[:] = angles, forces
        return False

    def snap(self) -> ElasticaSnap | None:
        """Leave the equilibrium that is being lost, or return None if it is not.

        The natural curvature is first advanced by twice the bracket of the event, past the loss,
        and then frozen. If the equilibrium is still there and stable, a step was merely too long.
        Otherwise the energy descends from the old shape, pushed along the critical mode: at a fold
        one side leads back to where the minimum vanished, so both are tried.
        """
        time = self.time
        eigenvalue = self.smallest_eigenvalue()
        if eigenvalue > LOST:
            return None  # a long step merely led astray
        mode = self.space.mode.copy()
        before = self.angles.copy()
        forces = self.multipliers.copy()
        delay = min(2.0 * self.resolution / max(self.rate(), 1e-300), 0.01 * self.step)
        target = self.space.springs[_kernel.TARGET]
        self.curvature += -math.expm1(-delay) * (target - self.curvature)
        self.clock[_kernel.TIME] += delay
        energy_before = _kernel.evaluate(self.data, self.unknown, self.multipliers, self.work)
        # At a fold the eigenvalue goes with the root of the distance, in units of the height.
        if eigenvalue > RESOLVED / math.sqrt(self.amplitude) and self.nearby():
            self.clock[_kernel.TRIAL] = delay
            self.patience -= 1
            if self.patience < 0:
                raise NotConverged(
                    f"no time step succeeds near t = {time:.9g}, though the shape is stable; use "
                    "another number of segments or step",
                    state=ElasticaState(before),
                )
            return None
        self.patience = PATIENCE
        direction = mode / np.max(np.abs(mode))
        beside: tuple[float, Array, Array, Array] | None = None
        unit, jump = PUSH * self.amplitude, SNAP_DISTANCE * self.amplitude
        for push in (unit, -unit, 3 * unit, -3 * unit, 9 * unit, -9 * unit):
            if beside is not None and abs(push) > unit:
                break  # a far push might throw a stable shape over a barrier
            self.angles[:] = before
            self.unknown[:] += push * direction
            self.multipliers[:] = forces
            for limit in (20, 2000):
                status = self.descend(limit)
                distance = float(np.max(np.abs(self.angles - before)))
                if status == 0 or distance < 0.7 * abs(push):
                    break  # done, or on the way back
            if status == 0 and distance > jump:
                beside = None
                break
            if status == 0 and beside is None:
                beside = distance, self.angles.copy(), self.multipliers.copy(), self.clock.copy()
            distance = 0.0
        if beside is not None:  # a stable shape grows out of the old one, without a jump
            distance = beside[0]
            self.angles[:], self.multipliers[:], self.clock[:] = beside[1:]
        elif distance == 0.0:
            raise NotConverged(
                f"stability is lost at t = {time:.9g}, but the descent from there found no stable "
                "shape; use more segments or another step",
                state=ElasticaState(before),
            )
        self.clock[_kernel.TRIAL] = 0.0
        return ElasticaSnap(
            time + 0.5 * delay,
            0.5 * delay,
            "snap" if distance > jump else "bifurcation",
            ElasticaState(before),
            ElasticaState(self.angles),
            self.curvature.copy(),
            mode,
            eigenvalue,
            float(energy_before - self.clock[_kernel.ENERGY]),
        )


def _python_look(structure: Elastica, light: UserLight) -> Callable[..., None]:
    s = structure.spring_arclength
    face = structure.face(light.side)

    def look(
        clock: Array,
        free: bool,
        natural: Array,
        chain: _kernel.Chain,
        lamp: _kernel.Lamp,
        angles: Array,
        space: _kernel.Space,
    ) -> None:
        if chain.ring:
            _kernel.roll(clock, free, chain, angles, space.nodes)
        x, y, theta = structure_points(structure, angles, clock)
        flux = light.flux(x, y, theta, s, float(clock[_kernel.TIME]))
        space.springs[_kernel.TARGET_NEXT] = natural + structure.response * face * flux

    return look


def structure_points(
    structure: Elastica, angles: Array, clock: Array
) -> tuple[Array, Array, Array]:
    """Return position and angle of the tangent at the springs, in the laboratory."""
    nodes = structure._positions(angles)
    if structure.spring_arclength.size == nodes.shape[0] - 1:  # springs between nodes
        points = 0.5 * (nodes[1:] + nodes[:-1])
    else:  # springs at the inner nodes (segment clamps)
        points = nodes[1:-1]
    c, s = clock[_kernel.COS], clock[_kernel.SIN]
    x = c * points[:, 0] - s * points[:, 1] + clock[_kernel.SHIFT_X]
    y = s * points[:, 0] + c * points[:, 1] + clock[_kernel.SHIFT_Y]
    theta = 0.5 * (angles[1:] + angles[:-1]) + math.atan2(s, c)
    return x, y, theta


def flux_target(
    structure: Elastica,
    light: Light,
    angles: Array,
    time: float,
    pose: ArrayLike = (1.0, 0.0, 0.0, 0.0),
) -> Array:
    """Return what the natural curvature relaxes to, for a shape."""
    clock = np.zeros(_kernel.CLOCK_SIZE)
    clock[_kernel.COS : _kernel.SHIFT_Y + 1] = pose
    face = structure.face(light.side)
    gain = structure.response * face
    angles = np.array(angles)
    if isinstance(light, UserLight):
        x, y, theta = structure_points(structure, angles, clock)
        flux = light.flux(x, y, theta, structure.spring_arclength, time)
        return structure.rest_curvature + gain * flux
    space = _kernel.space_for(structure._chain, angles.size)
    space.nodes[_kernel.SINE] = np.sin(angles)
    space.nodes[_kernel.COSINE] = np.cos(angles)
    _kernel.illuminate(
        _kernel.Lamp(*light._lamp(gain, face)),
        structure._chain,
        angles,
        clock,
        np.array(structure.rest_curvature),
        space.nodes,
        space.springs,
    )
    return space.springs[_kernel.TARGET_NEXT].copy()


class _Recorder:
    """Rows of a history, filled by the compiled loop in chunks."""

    def __init__(self, structure: Elastica) -> None:
        k = structure.angles_count
        self.chunks: list[Array] = []
        self.kinds: list[str] = []
        self.table = np.zeros((CHUNK, _kernel.SCALARS + 2 + 2 * k - 1))

    def take(self, rows: int) -> None:
        if rows:
            self.chunks.append(self.table[:rows].copy())
            self.kinds.extend(["step"] * rows)

    def row(self, runner: Runner, kind: str) -> int:
        clock = runner.clock
        head = [clock[_kernel.TIME], clock[_kernel.ENERGY]]
        pose = clock[_kernel.CONTACT : _kernel.SHIFT_Y + 1]
        parts = (head, pose, runner.multipliers, runner.angles, runner.curvature)
        self.chunks.append(np.concatenate(parts)[None])
        self.kinds.append(kind)
        return len(self.kinds) - 1

    def drop(self) -> None:
        self.chunks.pop()
        self.kinds.pop()

    @property
    def last_time(self) -> float:
        return float(self.chunks[-1][-1, 0])


@dataclass(frozen=True, eq=False)
class Motion:
    """A strip or ring under a light. Nothing is computed before :meth:`run`.

    Parameters
    ----------
    structure : ClampedStrip or Ring
        What is lit.
    light : ParallelLight, GaussianSpot or UserLight
        The light.

    Raises
    ------
    InvalidInput
        If the two are not of these kinds.

    Examples
    --------
    A strip comes to rest where its natural curvature is what the light on the shape asks for:

    >>> from lissome.beams import ClampedStrip, Motion, ParallelLight
    >>> motion = Motion(ClampedStrip(span=0.95, segments=50), ParallelLight(5.0))
    >>> history = motion.run(until=30.0, step=0.05)
    >>> print(history.stationary, abs(history.curvature[-1] - history.flux_target(-1)).max() < 1e-9)
    True True
    """

    structure: Elastica
    light: Light

    def __post_init__(self) -> None:
        if not isinstance(self.structure, Elastica):
            raise InvalidInput(
                f"argument `structure` is of type {type(self.structure).__name__}; "
                "pass a ClampedStrip or a Ring"
            )
        if not isinstance(self.light, (ParallelLight, GaussianSpot, UserLight)):
            raise InvalidInput(
                f"argument `light` is of type {type(self.light).__name__}; "
                "pass a ParallelLight, a GaussianSpot or a UserLight"
            )

    def run(
        self,
        until: float,
        *,
        step: float = DEFAULT_STEP,
        scheme: str = "exponential-2",
        record_every: int | None = 1,
        report_at: ArrayLike | None = None,
        initial: ElasticaState | ElasticaHistory | None = None,
        stop_after: int | None = None,
        on_snap: Callable[[ElasticaSnap], None] | None = None,
    ) -> ElasticaHistory:
        r"""Follow the shape in time, through snaps.

        The natural curvature relaxes toward what the light asks for, :math:`\partial_T K_0 = -(K_0 -
        K_r) + \Lambda f` (3.13), at equilibrium at every instant. Every step ends at a stable
        equilibrium; a step that cannot is halved until the instant at which stability is lost is
        enclosed within a change of the natural curvature of 2e-8. There the curvature is frozen
        and the energy descends to another stable shape.

        Parameters
        ----------
        until : float
            Final time, in relaxation times of the material.
        step : float
            Longest time step. With the exponential schemes it is shortened where the flux on the
            material bends strongly in time (before a snap), which keeps the order of the scheme.
        scheme : {"exponential-2", "exponential-1", "explicit-euler"}
            "exponential-2" (default) is exact for a light flux on the material that varies linearly in
            time, and of second order, away from the terminator (where the flux has a kink as
            a function of time, the local error is that of a kink: second order in the mean).
            "exponential-1" is exact for a constant flux. "explicit-euler" is the thesis's.
        record_every : int or None
            Record every so many steps; None: only start, snaps, end and `report_at`.
        report_at : array_like, optional
            Times to hit exactly and record. Steps in between are then recorded only if
            `record_every` is given as well.
        initial : ElasticaState or ElasticaHistory, optional
            Begin with this state, or go on from the end of a history.
        stop_after : int, optional
            Stop after so many snaps.
        on_snap : callable, optional
            Called with each :class:`ElasticaSnap`.

        Returns
        -------
        ElasticaHistory

        Raises
        ------
        InvalidInput
            If an argument is out of its range, or a light function returns nonsense.
        NotConverged
            If no stable shape was found at the start or after a loss of stability. Its ``history``
            holds what was recorded.
        """
        structure = self.structure
        until = finite("until", until)
        step = positive("step", step)
        one_of("scheme", scheme, SCHEMES)
        if record_every is not None:
            record_every = integer_at_least("record_every", record_every, 1)
        if stop_after is not None:
            stop_after = integer_at_least("stop_after", stop_after, 1)
        angles = curvature = None
        time, contact = 0.0, 0.0
        if isinstance(initial, ElasticaHistory):
            if initial.structure.angles_count != structure.angles_count:
                raise InvalidInput(
                    f"argument `initial` is a history with {initial.structure.angles_count} angles;"
                    f" this structure has {structure.angles_count}"
                )
            angles, curvature = initial.angles[-1], initial.curvature[-1]
            time, contact = float(initial.times[-1]), float(initial.contact[-1])
        elif isinstance(initial, ElasticaState):
            angles = structure.adopt(initial).angles
        elif initial is not None:
            raise InvalidInput(
                f"argument `initial` is of type {type(initial).__name__}; pass an ElasticaState or an "
                "ElasticaHistory"
            )
        if until <= time:
            raise InvalidInput(f"argument `until` is {until}; it must exceed the start, {time:g}")
        reports: list[float] = []
        if report_at is not None:
            wanted = finite_array("report_at", report_at, shape=(None,))
            if np.any(np.diff(wanted) <= 0) or (
                wanted.size and (wanted[0] < time or wanted[-1] > until)
            ):
                raise InvalidInput(
                    f"argument `report_at` must increase within [{time:g}, {until:g}]"
                )
            reports = [float(t) for t in wanted if t > time]
        runner = Runner(structure, self.light, SCHEMES[scheme], step, angles, curvature, time)
        runner.clock[_kernel.CONTACT] = contact
        recorder = _Recorder(structure)
        snaps: list[ElasticaSnap] = []
        every = 0 if record_every is None else record_every
        reason = "until"

        def history(why: str) -> ElasticaHistory:
            return ElasticaHistory._build(
                structure, self.light, recorder, tuple(snaps), why, runner
            )

        try:
            if angles is None:
                runner.begin()
            runner.advance(time, 0, recorder.table)
            recorder.row(runner, "start")
            targets = [*reports, until] if not reports or reports[-1] < until else reports
            stalled = 0
            for index, target in enumerate(targets):
                while True:
                    why, rows = runner.advance(target, every, recorder.table)
                    recorder.take(rows)
                    if why == _kernel.DONE:
                        break
                    if why == _kernel.ENCLOSED:
                        last = snaps[-1].time if snaps else -math.inf
                        row = recorder.row(runner, "before snap")
                        snap = runner.snap()
                        if snap is None:
                            recorder.drop()
                            continue
                        snap = ElasticaSnap(**{**snap.__dict__, "row": row})
                        recorder.row(runner, "after snap")
                        snaps.append(snap)
                        stalled = stalled + 1 if snap.time - last < 1e-7 else 0
                        if stalled >= 20:
                            raise NotConverged(
                                f"stability is lost again and again at t = {snap.time:.9g}; "
                                "use more segments",
                                state=ElasticaState(runner.angles),
                            )
                        if on_snap is not None:
                            on_snap(snap)
                        if stop_after is not None and len(snaps) >= stop_after:
                            reason = "snaps"
                            break
                if reason != "until":
                    break
                if recorder.kinds[-1] != "step" or recorder.last_time != runner.time:
                    kind = "end" if index == len(targets) - 1 else "reported"
                    recorder.row(runner, kind)
        except (NotConverged, InvalidInput) as error:
            if isinstance(error, NotConverged) and recorder.kinds:
                error.history = history("failed")
            raise
        return history(reason)


@dataclass(frozen=True, eq=False)
class ElasticaHistory:
    """What happened to a strip or ring under light: one row per recorded instant.

    It holds arrays, as compiled code fills them; :class:`lissome.evolution.History`, of any structure that
    evolves, holds equilibria.

    Attributes
    ----------
    structure, light
        What was run.
    times : ndarray, shape (r,)
        In relaxation times. A snap has two rows of the same time, before and after it.
    angles : ndarray, shape (r, k)
        Angles of the tangent. For a ring they are those of a frame in which S = 0 points to the
        right: add ``rotation[:, None]`` for the laboratory.
    curvature : ndarray, shape (r, k - 1)
        Natural curvature :math:`K_0` at ``structure.spring_arclength``.
    forces : ndarray, shape (r, 2)
        Multipliers of the end-to-end vector.
    energy : ndarray, shape (r,)
        Bending energy.
    contact : ndarray, shape (r,)
        Arc length of the contact of a ring, unwrapped: the distance traveled.
    kinds : tuple of str
        "start", "step", "reported", "before snap", "after snap" or "end".
    snaps : tuple of ElasticaSnap
        Losses of stability.
    reason : str
        "until", "snaps" (stop_after) or "failed".
    rate : float
        Largest rate of change of the natural curvature at the end.
    steps, rejected : int
        Accepted and halved time steps.
    pose : ndarray, shape (r, 4)
        Cosine and sine of the rotation of a ring in the laboratory, and its translation.

    Examples
    --------
    In the dark natural curvature decays exactly as :math:`e^{-T}`, whatever the time step:

    >>> import numpy as np
    >>> from lissome.beams import ClampedStrip, ParallelLight
    >>> bent = ClampedStrip(span=0.95, segments=50, curvature=np.full(50, 0.5))
    >>> history = bent.under(ParallelLight(0.0)).run(until=1.0, step=0.1)
    >>> print(history.times.size, np.allclose(history.curvature[-1], 0.5 * np.exp(-1.0), rtol=1e-12))
    11 True
    """

    structure: Elastica
    light: Light
    times: Array = field(repr=False)
    angles: Array = field(repr=False)
    curvature: Array = field(repr=False)
    forces: Array = field(repr=False)
    energy: Array = field(repr=False)
    contact: Array = field(repr=False)
    pose: Array = field(repr=False)
    kinds: tuple[str, ...] = field(repr=False)
    snaps: tuple[ElasticaSnap, ...] = field(repr=False)
    reason: str
    rate: float
    steps: int
    rejected: int

    @classmethod
    def _build(
        cls,
        structure: Elastica,
        light: Light,
        recorder: _Recorder,
        snaps: tuple[ElasticaSnap, ...],
        reason: str,
        runner: Runner,
    ) -> ElasticaHistory:
        """Assemble the recorded chunks."""
        table = np.concatenate(recorder.chunks)
        table.flags.writeable = False
        k, first = structure.angles_count, _kernel.SCALARS
        return cls(
            structure,
            light,
            table[:, 0],
            table[:, first + 2 : first + 2 + k],
            table[:, first + 2 + k :],
            table[:, first : first + 2],
            table[:, 1],
            table[:, 2],
            table[:, 3:7],
            tuple(recorder.kinds),
            snaps,
            reason,
            runner.rate(),
            int(runner.clock[_kernel.STEPS]),
            int(runner.clock[_kernel.REJECTED]),
        )

    def __len__(self) -> int:
        return self.times.size

    # -- shapes -------------------------------------------------------------------------------
    @readonly_property
    def rotation(self) -> Array:
        """Angle by which a ring is turned in the laboratory (0 for strips), unwrapped, shape (r,)."""
        return np.unwrap(np.arctan2(self.pose[:, 1], self.pose[:, 0]))

    @readonly_property
    def positions(self) -> Array:
        """Positions of the nodes in the laboratory, shape (r, nodes, 2)."""
        body = self.structure._positions(self.angles)
        c, s = self.pose[:, 0, None], self.pose[:, 1, None]
        x = c * body[..., 0] - s * body[..., 1] + self.pose[:, 2, None]
        y = s * body[..., 0] + c * body[..., 1] + self.pose[:, 3, None]
        return np.stack([x, y], axis=-1)

    @property
    def x(self) -> Array:
        """Horizontal positions of the nodes, shape (r, nodes)."""
        return self.positions[..., 0]

    @property
    def y(self) -> Array:
        """Heights of the nodes, shape (r, nodes)."""
        return self.positions[..., 1]

    def state(self, row: int) -> ElasticaState:
        """Return the shape in row `row`, to begin another run with."""
        return ElasticaState(self.angles[row])

    def reactions(self, row: int) -> Reactions:
        """Return what the supports exert in row `row`: forces and moments of "start" and "end".

        Light exerts none: it changes the natural curvature. A ring has no supports. Forces are in units
        of bending stiffness over length squared, moments of bending stiffness over length.

        Examples
        --------
        >>> from lissome.beams import ClampedStrip, ParallelLight
        >>> strip = ClampedStrip(span=0.95, segments=50)
        >>> history = strip.under(ParallelLight(1.0)).run(until=0.1, step=0.05)
        >>> thrust = [history.reactions(row)["start"].force[0] for row in range(len(history))]
        >>> print(thrust == list(history.forces[:, 0]))
        True
        """
        return self.structure._supports_exert(
            self.angles[row], self.curvature[row], self.forces[row]
        )

    @readonly_property
    def smallest_eigenvalue(self) -> Array:
        """Smallest eigenvalue of the second variation under the constraints, shape (r,).

        In the L2 metric of the angle, so that it does not depend on the mesh. Computed at first use.
        """
        structure = self.structure
        chain = structure._chain
        space = _kernel.space_for(chain, structure.angles_count)
        out = np.empty(len(self))
        _kernel.eigenvalues_of(
            chain,
            np.array(self.angles),
            np.array(self.curvature),
            np.array(self.forces),
            space.masses,
            _kernel.chain_work(structure.size, 2),
            space.nodes,
            out,
        )
        out.flags.writeable = False
        return out

    # -- descriptors --------------------------------------------------------------------------
    @readonly_property
    def deflection_descriptor(self) -> Array:
        r""":math:`\gamma = \int \sin(2\pi S)\, Y \, dS` of (3.31), shape (r,)."""
        s = self.structure.arclength
        return np.asarray(np.trapezoid(np.sin(2 * math.pi * s) * self.y, s, axis=1))

    @readonly_property
    def curvature_descriptor(self) -> Array:
        r""":math:`\beta = \int \sin(2\pi S)\, K_0 \, dS` of (3.31), shape (r,)."""
        weights = np.sin(2 * math.pi * self.structure.spring_arclength) / self.structure.segments
        return self.curvature @ weights

    @readonly_property
    def crest(self) -> Array:
        """Arc length of the point that is farthest from the chord (its highest or lowest), shape (r,)."""
        y = self.y
        row = np.arange(y.shape[0])
        k = np.clip(np.argmax(np.abs(y), axis=1), 1, y.shape[1] - 2)
        a, b, c = y[row, k - 1], y[row, k], y[row, k + 1]
        bend = a - 2 * b + c
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = np.where(bend == 0, 0.0, 0.5 * (a - c) / bend)
        s = self.structure.arclength
        return np.asarray(s[k] + shift * (s[1] - s[0]))

    def flux_target(self, row: int) -> Array:
        """Return what the natural curvature relaxes to in row `row`, shape (k - 1,).

        It is :math:`K_r + \\Lambda f` of (3.13), at the springs.
        """
        return flux_target(
            self.structure, self.light, self.angles[row], float(self.times[row]), self.pose[row]
        )

    # -- cycles -------------------------------------------------------------------------------
    def find_period(self, tolerance: float = 1e-3) -> Period | None:
        """Return the period of the limit cycle, or None if there is none to be seen.

        The natural curvatures at the snaps are a Poincare section. The motion is periodic with q
        snaps per cycle if the curvature at the last snap is that of q snaps before.

        Parameters
        ----------
        tolerance : float
            Largest change of the curvature over a cycle relative to its largest value.
        """
        return period_of(self.snaps, tolerance)

    @property
    def period(self) -> float:
        """Period of the limit cycle (relaxation times).

        Raises
        ------
        NotConverged
            If the motion is not periodic, or not yet.
        """
        found = self.find_period()
        if found is None:
            raise NotConverged(
                f"no period is seen in {len(self.snaps)} snaps until t = {self.times[-1]:.6g} (the "
                f"natural curvature changes at a rate of {self.rate:.3g} at the end); run longer, or "
                "there is none",
                history=self,
            )
        return found.value

    @property
    def frequency(self) -> float:
        """Reciprocal of the period."""
        return 1.0 / self.period

    @property
    def stationary(self) -> bool:
        """Whether natural curvature has come to rest (rate below 1e-6)."""
        return self.rate < 1e-6

    # -- rolling ------------------------------------------------------------------------------
    @readonly_property
    def distance(self) -> Array:
        """Distance that a ring has rolled, shape (r,)."""
        return self.contact - self.contact[0]

    def find_speed(self, window: float = 1.0) -> tuple[float, float]:
        """Return the rolling speed over the last `window` of time, and its change since before.

        Parameters
        ----------
        window : float
            In relaxation times.

        Returns
        -------
        speed, uncertainty : float
            The uncertainty is the difference from the speed over the window before.

        Raises
        ------
        InvalidInput
            If this is no ring, or the window is longer than half of the history or holds too few rows.
        """
        if not self.structure._chain.ring:
            raise InvalidInput("a strip does not roll; only a Ring has a speed")
        window = positive("window", window)
        end = self.times[-1]
        if end - 2 * window < self.times[0]:
            raise InvalidInput(
                f"argument `window` is {window}; twice the window must fit into the history, "
                f"which is {end - self.times[0]:g} long"
            )

        def mean(t: float) -> float:
            chosen = (self.times >= t - window - 1e-9) & (self.times <= t + 1e-9)
            if np.count_nonzero(chosen) < 3:
                raise InvalidInput("the history has too few rows in the window; record more often")
            return float(np.polyfit(self.times[chosen] - t, self.contact[chosen], 1)[0])

        last = mean(end)
        return last, abs(last - mean(end - window))

    @property
    def speed(self) -> float:
        """Rolling speed of a ring over the last relaxation time."""
        return self.find_speed()[0]

    # -- table --------------------------------------------------------------------------------
    @cached_property
    def table(self) -> pd.DataFrame:
        """Table with one row per recorded instant.

        Columns: time, kind, energy, smallest_eigenvalue, deflection_descriptor, curvature_descriptor,
        crest (strips), contact and rotation (rings).
        """
        columns: dict[str, Any] = {
            "time": self.times,
            "kind": list(self.kinds),
            "energy": self.energy,
            "smallest_eigenvalue": self.smallest_eigenvalue,
            "deflection_descriptor": self.deflection_descriptor,
            "curvature_descriptor": self.curvature_descriptor,
        }
        if self.structure._chain.ring:
            columns["contact"] = self.contact
            columns["rotation"] = self.rotation
        else:
            columns["crest"] = self.crest
        return pd.DataFrame(columns)


def period_of(snaps: Sequence[ElasticaSnap], tolerance: float, longest: int = 8) -> Period | None:
    """Find the shortest repeating cycle at the end of a sequence of snaps.

    A cycle of q snaps is not taken for the period while a part of it repeats ever better: the motion
    then converges to a shorter cycle, from side to side.
    """
    jumps = [s for s in snaps if s.kind == "snap"][-PERIOD_MEMORY:]
    n = len(jumps)
    if n < 3:
        return None
    last = jumps[-1]
    scale = float(np.max(np.abs(last.curvature)))

    def distance(later: int, apart: int) -> float:
        """Return how much the curvature has changed at a jump since an earlier one."""
        change = jumps[later].curvature - jumps[later - apart].curvature
        return float(np.max(np.abs(change))) / scale

    def differs(part: int, cycle: int) -> bool:
        """Return whether a part of the cycle will never repeat."""
        now = distance(n - 1, part)
        if now > min(1e3 * tolerance, DISTINCT):
            return True
        if now <= tolerance or n - 1 - 2 * cycle - part < 0:
            return False
        before, first = (distance(n - 1 - k * cycle, part) for k in (1, 2))
        bend = now - 2.0 * before + first
        limit = now if bend == 0.0 else now - (now - before) ** 2 / bend  # Aitken
        return limit > 0.5 * now

    for q in range(1, min(longest, (n - 1) // 2) + 1):
        found = distance(n - 1, q)
        if found > tolerance:
            continue
        before = jumps[n - 1 - q]
        value = last.time - before.time
        previous = before.time - jumps[n - 1 - 2 * q].time
        if abs(value - previous) > 10 * tolerance * value:
            return None
        if not all(differs(part, q) for part in range(1, q) if q % part == 0):
            return None
        uncertainty = max(abs(value - previous), last.uncertainty + before.uncertainty)
        return Period(value, uncertainty, q, found)
    return None
