r"""A plate in time: stable equilibria that follow one another, through bifurcations and snaps.

Perfectly symmetric plates lose their symmetry gently: at a bifurcation the stable states beyond leave the
symmetric one like the root of time, and for a while nothing tells them apart but rounding errors. So the
symmetric states are followed past the bifurcation, unstable as they are; the zero of the lowest eigenvalue
says when it was; and the plate descends from a symmetric state that is clearly beyond. Folds are bracketed
from the stable side, as there is no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._corrector import (
    TOLERANCE,
    Balanced,
    CorrectionFailed,
    _evaluate,
    as_balanced,
    correct_on_plane,
    critical_modes,
    typical_size,
)
from .._descent import descend, distance
from ..equilibrium import Iteration, relative_residual
from ..errors import FactorizationError, InvalidInput, NotConverged
from ..evolution import (
    EvolutionInterrupted,
    History,
    Snap,
    _Evolution,
    _Extrapolation,
    _Lost,
    _Trial,
)
from ._path import TimePath
from ._relax import relax

Array = NDArray[np.float64]
NONE = np.zeros(0)

#: Part of a time step in which a loss of stability is examined for a bifurcation.
EXAMINED = 1 / 16
#: How far beyond a bifurcation to leave the symmetric states, over the time step.
BEYOND = (0.06, 0.2, 0.6)
#: Way of a gentle fall, in typical unknowns.
NEAR = 0.5
#: How far beyond a fold.
FALLEN = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)


def next_to(structure: Any, guess: Any, most: int = 16) -> Balanced:
    """Return the equilibrium next to a guess, stable or not, by damped Newton steps.

    A thin plate asks for damping: bending by a step stretches it at second order, so that the first
    corrections grow before they contract. Its stability is what the inertia says.
    """
    state = guess
    size = typical_size(structure, state)
    metric = np.asarray(structure.metric(state), dtype=float)
    noise = float(structure.noise(state))
    history: list[Iteration] = []
    previous = np.inf
    for number in range(most):
        evaluation, factors = _evaluate(structure, state, NONE)
        gradient = evaluation.gradient
        residual = relative_residual(gradient, NONE, evaluation.kkt.magnitude(size, NONE))
        floor = residual <= noise
        dx = np.zeros_like(gradient)
        if not factors.inertia[2]:
            try:
                dx, _ = factors.solve(-gradient)
            except FactorizationError as error:
                raise CorrectionFailed(str(error)) from error
        elif not floor:
            raise CorrectionFailed("the Hessian is singular to working precision")
        correction = float(np.max(np.abs(dx) / size))
        done = correction <= TOLERANCE or (floor and not correction < 0.5 * previous)
        history.append(
            Iteration(
                number, evaluation.energy, residual, correction, 0.0, 0.0 if done else 1.0,
                factors.inertia, "accepted" if done else "newton",
            )
        )  # fmt: skip
        if done:
            return Balanced(
                structure, state, NONE, evaluation, residual, factors, tuple(history)
            )  # fmt: skip
        previous = correction
        length = float(np.sqrt(dx @ (metric * dx)))
        step = 1.0
        while True:
            trial = structure.retract(state, step * dx)
            there = structure.evaluate(trial, NONE, 1).gradient
            if np.all(np.isfinite(there)):
                again, _ = factors.solve(-there, refine=False)
                left = float(np.sqrt(again @ (metric * again)))
                if left <= (1.0 - 0.25 * step) * length or correction < 1e-5:
                    break
            step *= 0.5
            if step < 1e-3:
                raise CorrectionFailed("damped Newton steps come to nothing")
        state = trial
    raise CorrectionFailed(f"no equilibrium after {most} iterations")


def fall(
    structure: Any, source: Balanced, modes: Array, signs: Sequence[int], interrupted: Any
) -> Balanced:
    """Return a stable equilibrium below an unstable one, the nearest along its critical mode first.

    Gentle bifurcations leave eigenvalues that rounding might hide from a general descent; here the
    inertia of Newton's limit decides.
    """
    state = structure.adopt(source.state)
    size = typical_size(structure, state)
    top = structure.evaluate(state, NONE, 0).energy
    for mode in modes:
        unit = mode / float(np.max(np.abs(mode) / size))
        for sign in signs:
            previous = top
            for push in 1e-3 * 2.0 ** np.arange(10):
                pushed = structure.retract(state, sign * push * unit)
                energy = structure.evaluate(pushed, NONE, 0).energy
                if energy < previous:
                    previous = energy
                    continue
                if push < 2e-3:  # not downhill
                    break
                # The lowest place along the line, and the two beside it.
                for part in (0.5, 0.25):
                    guess = structure.retract(state, sign * part * push * unit)
                    try:
                        found = next_to(structure, guess)
                    except CorrectionFailed:
                        continue
                    apart = distance(structure, state, found.state)
                    if found.stable and found.energy < top and apart > 1e-6:
                        return found
                break
    push = signs[0] * 1e-3 * modes[0] / float(np.max(np.abs(modes[0]) / size))
    try:
        near = relax(structure, structure.retract(state, push), settled, farthest=NEAR)
        if near.energy < top and distance(structure, state, near.state) > 1e-6:
            return near
    except CorrectionFailed:
        pass  # no gentle way down, but a snap
    return as_balanced(descend(structure, source, modes, signs, interrupted)[0])


def settled(structure: Any, state: Any) -> Balanced:
    """Return the stable equilibrium next to a state."""
    found = next_to(structure, state)
    if not found.stable:
        raise CorrectionFailed("the equilibrium is not stable")
    return found


@dataclass
class PlateRun(_Evolution):
    """One run; the memory is the time."""

    checkpoint: Any = None
    earlier: History | None = None
    pace: float = 0.0  # length of the last step
    unstable: bool = False  # whether the last attempt found an unstable equilibrium

    # -- steps ------------------------------------------------------------------------------------

    def attempt(self, step: float) -> _Trial:
        """Return where one step leads, if it leads to a stable equilibrium nearby."""
        memory = self.evolving.advance(self.memory, self.time, step, None, None)
        structure = self.evolving.structure(memory)
        here = structure.adopt(self.balanced.state)
        guesses = [here]
        self.unstable = False
        if self.last is not None and self.pace > 0 and step <= 4 * self.pace:
            guesses.insert(0, structure.retract(here, step / self.pace * self.last))
        reason: Exception | None = None
        for guess in guesses:
            try:
                found = next_to(structure, guess)
            except CorrectionFailed as error:
                reason = error
                continue
            if not found.stable:
                reason = CorrectionFailed("the equilibrium is not stable")
                self.unstable = found.index > 0
                break
            if distance(structure, here, found.state) > self.max_change:
                reason = CorrectionFailed("the equilibrium has moved far")
            else:
                return _Trial(memory, found, 0.0)
        raise _Lost(str(reason)) from reason

    def accept(self, trial: _Trial, time: float) -> None:
        """Go one step on."""
        self.pace = time - self.time
        super().accept(trial, time)
        if self.last is not None and self.pace <= 0:
            self.last = None
        self.keep()

    def keep(self) -> None:
        """Write what has been found so far."""
        if self.checkpoint is None:
            return
        extra = self.times[-1] != self.time
        if extra:
            self.record("step")
        self.so_far().save(self.checkpoint)
        if extra and self.reports is not None:  # not asked for: it serves to go on from only
            for rows in (self.times, self.memories, self.equilibria, self.kinds):
                rows.pop()
            for column in self.values.values():
                column.pop()

    def so_far(self) -> History:
        """Return what has been found, from the first beginning."""
        history = self.history()
        return history if self.earlier is None else self.earlier.joined(history)

    def locate(self, failed: float) -> None:
        """Shorten the step; if that does not help, find where stability is lost, and leave."""
        length = failed
        while length > EXAMINED * self.step:
            if self.unstable and self.bifurcated(length):
                return
            if not self.unstable and self.traced(length):
                return
            length *= 0.5
            try:
                trial = self.attempt(length)
            except _Lost:
                continue
            self.accept(trial, self.time + length)
            self.size = length
            return
        if self.bifurcated(length):
            return
        end, examined = self.time + length, length
        extrapolation = _Extrapolation()
        extrapolation.add(self.time, self.smallest())
        while (left := end - self.time) > self.time_tolerance:
            if left <= 0.1 * examined:
                examined = left
                if self.bifurcated(left):
                    return
            length = extrapolation.aim(self.time, left, self.time_tolerance)
            if not self.time + length > self.time:
                break
            try:
                trial = self.attempt(length)
            except _Lost:
                end = self.time + length
                continue
            self.accept(trial, self.time + length)
            if not extrapolation.add(self.time, self.smallest()):
                self.size = 2 * length  # nothing is being lost
                return
        length = min(2.0 * left, self.until - self.time)
        try:  # a long step may have failed where short ones get through
            trial = self.attempt(length)
        except _Lost:
            self.snap(left)
            return
        self.accept(trial, self.time + length)
        self.size = 2.0 * length

    def traced(self, failed: float) -> bool:
        """Go on along the arc of equilibria, over a fold if there is one; False if that fails.

        Near a fold, and where a mode is nearly neutral, a little time moves the plate far: the arc
        length is then the better variable.
        """
        end = min(self.time + 2.0 * failed, self.until)
        try:
            path = TimePath(
                self.evolving, self.balanced.state, self.time, self.until, 1e-3 * self.step
            )
            loss = path.to_loss(end, self.time_tolerance / end, most=60)
        except (CorrectionFailed, FactorizationError, NotConverged):
            return False
        within = [p for p in path.points[1:] if self.time < p.parameter <= self.until]
        if loss is not None and loss.kind != "fold":
            return False
        if not within:
            return False
        reached = within[-1]
        self.accept(_Trial(reached.parameter, reached.balanced, 0.0), reached.parameter)
        self.last = None  # steps in time are foretold by steps in time
        if loss is None:
            self.size = failed
            return True
        signs: Sequence[int] = (1, -1)
        mode = loss.modes[0]
        metric = np.asarray(reached.balanced.structure.metric(reached.balanced.state), dtype=float)
        if float(reached.tangent[0] @ (metric * mode)) < 0:
            mode = -mode
        self.leave(
            loss.parameter, loss.uncertainty, np.array([mode]), signs, FALLEN, None
        )  # fmt: skip
        return True

    # -- bifurcations -----------------------------------------------------------------------------

    def at(self, time: float, guess: Any) -> Balanced:
        """Return the equilibrium at a time next to a guess, stable or not."""
        structure = self.evolving.structure(time)
        return next_to(structure, structure.adopt(guess))

    def bifurcated(self, left: float) -> bool:
        """Leave the symmetric states if they have lost their stability within `left`."""
        start, low = self.time, self.balanced
        for part in (
            1.0,
            1.4,
            2.0,
            4.0,
        ):  # near the bifurcation the Hessian is singular to rounding
            if start + part * left > self.evolving.last:
                return False
            try:
                high = self.at(start + part * left, low.state)
            except CorrectionFailed:
                continue
            if high.index > 0:
                left *= part
                break
        else:
            return False
        structure = high.structure
        gap = structure.difference(low.state, high.state)
        # The branch must go straight on: not from broken symmetry back to the symmetric states.
        if distance(structure, low.state, high.state) > self.max_change:
            return False
        if self.last is not None and self.pace > 0:
            sizes = typical_size(structure, low.state)
            bend = (gap - left / self.pace * self.last) / sizes
            if float(np.linalg.norm(bend)) > 0.5 * float(np.linalg.norm(gap / sizes)):
                return False
        modes: Array | None = None
        known: list[tuple[float, float, Balanced]] = []
        for part in (0.0, 1.0, 0.3, 0.7, 0.15):
            time = start + part * left
            try:
                if part in (0.0, 1.0):
                    state = high if part else low
                else:
                    state = self.at(time, structure.retract(low.state, part * gap))
                values, found = critical_modes(state, 3, modes, iterations=6)
            except (CorrectionFailed, FactorizationError):
                continue
            modes = found[np.argsort(values)]
            value = abs(float(np.min(values)))
            known.append((time, value if state.index == 0 else -value, state))
        known.sort(key=lambda item: item[0])
        stable = [item for item in known if item[1] > 0]
        unstable = [item for item in known if item[1] < 0]
        if not stable or not unstable or stable[-1][0] > unstable[0][0]:
            return False
        # The eigenvalue is a smooth function of time along the branch.
        a, b = stable[-1], unstable[0]
        instant = a[0] + (b[0] - a[0]) * a[1] / (a[1] - b[1])
        uncertainty = 0.5 * (b[0] - a[0])
        if len(known) > 2:
            times = np.array([item[0] - start for item in known])
            values = np.array([item[1] for item in known])
            inverse = np.polynomial.Polynomial.fit(values, times, len(known) - 1)
            better = start + float(inverse(0.0))
            if a[0] <= better <= b[0]:
                uncertainty = min(uncertainty, abs(better - instant) + 1e-2 * (b[0] - a[0]))
                instant = better
        if a[0] > start:
            self.accept(_Trial(a[0], a[2], 0.0), a[0])
        assert modes is not None
        rate = gap / left
        there = structure.retract(self.balanced.state, (instant - self.time) * rate)
        branched = self.branch_off(instant, there, modes[0])
        if branched is not None:
            time, after = branched
            source = replace(
                self.balanced,
                state=structure.retract(self.balanced.state, (time - self.time) * rate),
            )
            self.recorded(
                instant, uncertainty, modes, time, after.structure, source, after, True
            )  # fmt: skip
            return True
        signs = (self.sign, -self.sign)
        self.leave(instant, uncertainty, modes[:1], signs, BEYOND, rate)
        return True

    def branch_off(self, instant: float, state: Any, mode: Array) -> tuple[float, Balanced] | None:
        """Return a stable equilibrium of broken symmetry a little later, and its time.

        It is looked for at a given amplitude of the critical mode, with the time as an unknown: at
        a fixed time the matrix would be nearly singular.
        """
        structure = self.evolving.structure(instant)
        little = 1e-3 * self.step
        gradients = [
            self.evolving.structure(instant + d).evaluate(state, NONE, 1).gradient
            for d in (little, 0.0)
        ]
        slope = ((gradients[0] - gradients[1]) / little, NONE)
        metric = np.asarray(structure.metric(state), dtype=float)
        unit = mode / float(np.max(np.abs(mode) / typical_size(structure, state)))
        row = (metric * mode, 0.0)
        for sign in (self.sign, -self.sign):
            amplitude, found = 0.01, None
            for _ in range(5):
                guess = structure.retract(state, sign * amplitude * unit)
                try:
                    balanced, time = correct_on_plane(
                        self.evolving.structure, instant, guess, NONE, row, slope, self.step,
                        contraction=4.0, max_iterations=15,
                    )  # fmt: skip
                except (CorrectionFailed, InvalidInput):
                    amplitude *= 0.5
                    continue
                gone = time - instant
                if gone <= 0 or balanced.index > 0:
                    break  # it goes back in time, or is not stable: a snap
                found = time, balanced
                if gone >= 0.02 * self.step:
                    break
                amplitude *= min(4.0, (0.06 * self.step / gone) ** 0.5)
            if found is not None and found[0] - instant < 0.7 * self.step:
                return found
        return None

    def snap(self, length: float) -> None:
        """Leave at a fold, or where nothing better is known, with the time just beyond it."""
        try:
            _, modes = critical_modes(self.balanced, 1)
        except FactorizationError as error:
            raise self.interrupted(f"the critical mode cannot be resolved ({error})") from error
        signs: Sequence[int] = (self.sign, -self.sign)
        if self.last is not None:
            metric = np.asarray(self.balanced.structure.metric(self.balanced.state), dtype=float)
            along = float(self.last @ (metric * modes[0]))
            if abs(along) > 0.1 * float(np.sqrt(self.last @ (metric * self.last))):
                modes = modes * np.copysign(1.0, along)
                signs = (1, -1)
        self.leave(self.time + 0.5 * length, 0.5 * length, modes, signs, FALLEN, None)

    def leave(
        self,
        instant: float,
        uncertainty: float,
        modes: Array,
        signs: Sequence[int],
        lengths: Sequence[float],
        rate: Array | None,
    ) -> None:
        """Freeze the time beyond the loss of stability, descend, and record the event."""
        before = self.balanced
        failure: Exception | None = None
        end = float(self.evolving.last)
        for part in lengths:
            time = instant + uncertainty + part * self.step
            if time > end:
                break
            structure = self.evolving.structure(time)
            source = before
            if rate is not None:
                state = structure.retract(before.state, (time - self.time) * rate)
                try:
                    source = next_to(structure, state)
                except CorrectionFailed as error:
                    failure = error
                    continue
                if source.index == 0:
                    failure = CorrectionFailed("the symmetric state is still stable")
                    continue
            try:
                after = fall(structure, source, modes, signs, self.interrupted)
                break
            except EvolutionInterrupted as error:
                failure = error
        else:
            if isinstance(failure, EvolutionInterrupted):
                raise failure
            raise self.interrupted(f"no stable state was found ({failure})")
        if time > end:
            raise self.interrupted(
                "stability is lost so near the end of the history of temperature that nothing can "
                "be said of what follows; run the heat problem for longer"
            )
        self.recorded(instant, uncertainty, modes, time, structure, source, after, rate is not None)

    def recorded(
        self, instant: float, uncertainty: float, modes: Array, time: float, structure: Any,
        source: Balanced, after: Balanced, continued: bool,
    ) -> None:  # fmt: skip
        """Put an event into the history, and go on behind it."""
        before = self.balanced
        # Supports do no work between the two: time changes the strains of the plate, and nothing else.
        top = structure.evaluate(structure.adopt(source.state), NONE, 0).energy
        row = len(self.times)
        if self.times[-1] == self.time:  # recorded already, as a step
            row -= 1
            self.kinds[row] = "before snap" if self.kinds[row] == "step" else self.kinds[row]
        else:
            self.record("before snap")
        kept = self.equilibria[row]
        gentle = continued and distance(structure, before.state, after.state) < self.max_change
        self.time, self.memory = time, time
        self.balanced = after
        new = self.record("after snap")
        self.events.append(
            Snap(
                time=instant, uncertainty=uncertainty, memory=time, before=kept, after=new,
                modes=modes[:1], energy_released=top - after.energy, row=row,
                kind="loss of symmetry" if gentle else "snap",
            )
        )  # fmt: skip
        self.last = None
        self.size = min(self.step, max(time - instant, 1e-3 * self.step))
        self.keep()
