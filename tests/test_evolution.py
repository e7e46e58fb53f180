"""Quasi-static evolution against closed forms: snaps, periods, orders, reports, bad input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from models import HYSTERESIS_FOLD, RandomFamily, Strip, Truss, fold, hysteresis, pitchfork

import lissome as ls
from lissome.errors import DataError, InvalidInput
from lissome.evolution import EvolutionInterrupted, History, Marched, evolve
from lissome.structure import DenseStructure, VectorState


def unknown(equilibrium):
    return equilibrium.state.x[0]


X = {"x": lambda time, memory, equilibrium: unknown(equilibrium)}


@dataclass(frozen=True)
class Driven:
    """A family of structures whose parameter is the memory, and grows at a given rate."""

    family: object
    rate: float = 1.0

    def structure(self, memory):
        return self.family(memory)

    def advance(self, memory, time, step, before, after):
        return memory + self.rate * step


class Oscillator:
    """x^3 - x = y and y' = -x (van der Pol's oscillator without inertia).

    On a stable branch (3 x^2 - 1) x' = -x, so that the time from one x to another is F(start) -
    F(end), F = 3 x^2 / 2 - log x. It leaves x = 1/sqrt(3) for -2/sqrt(3): the period is 3 - 2 log 2.
    """

    period = 3 - 2 * np.log(2)

    def structure(self, memory):
        return hysteresis(memory)

    def advance(self, memory, time, step, before, after):
        return memory - 0.5 * step * (unknown(before) + unknown(after))

    def begin(self, x=1.5):
        y = x**3 - x
        return y, ls.equilibrate(hysteresis(y, x))

    @staticmethod
    def time_to_fold(x=1.5):
        return 1.5 * x**2 - np.log(x) - 0.5 - np.log(np.sqrt(3))


class Decay:
    """x = y and y' = -x: exponential decay without any event."""

    def structure(self, memory):
        return DenseStructure(
            initial=[memory],
            energy=lambda x: 0.5 * (x[0] - memory) ** 2,
            gradient=lambda x: x - memory,
            hessian=lambda x: np.eye(1),
            check=False,
        )

    advance = Oscillator.advance


def run(family, start, until, step, memory=0.0, **options):
    driven = Driven(family)
    first = ls.equilibrate(family(memory), start)
    return evolve(driven, memory, first, until, step, outputs=X, **options)


# ---- snaps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.5, 0.1, 0.013])
def test_a_driven_fold_snaps_on_time(step):
    # The drive does not depend on the shape, so that no step size errs.
    history = run(hysteresis, VectorState([-1.0]), 1.0, step)
    (snap,) = history.events
    assert abs(snap.time - HYSTERESIS_FOLD) <= snap.uncertainty <= 1e-7 * step
    assert snap.energy_released == pytest.approx(0.75, abs=1e-4)  # from 1/12 to -2/3
    assert unknown(snap.before) == pytest.approx(-1 / np.sqrt(3), abs=1e-3)
    assert unknown(snap.after) == pytest.approx(2 / np.sqrt(3), abs=1e-4)
    assert snap.mode == pytest.approx([1.0])
    assert history.kinds[snap.row] == "before snap"
    assert history.kinds[snap.row + 1] == "after snap"
    assert history.equilibria[snap.row] is snap.before
    assert history.equilibria[snap.row + 1] is snap.after
    assert history.reason == "until"
    table = history.table
    assert table.time.iloc[-1] == 1.0
    assert np.all(np.diff(table.time) > 0)
    assert (table.x**3 - table.x).to_numpy() == pytest.approx(table.time.to_numpy(), abs=1e-9)
    assert all(e.stable for e in history.equilibria)


def on_a_moving_support(place):
    """The same fold, driven by a support that loads a stiff spring besides."""
    stiffness = 1e4
    return DenseStructure(
        initial=[-1.0, place],
        energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - x[0] * x[1] + stiffness * x[1] ** 2 / 2,
        gradient=lambda x: np.array([x[0] ** 3 - x[0] - x[1], stiffness * x[1] - x[0]]),
        hessian=lambda x: np.array([[3 * x[0] ** 2 - 1, -1.0], [-1.0, stiffness]]),
        constraints=lambda x: np.array([x[1] - place]),
        jacobian=lambda x: np.array([[0.0, 1.0]]),
        check=False,
    )


def test_what_a_moving_support_does_is_not_released():
    """It moves a little from the last stable state to where the snap is computed, against the spring."""
    history = run(on_a_moving_support, VectorState([-1.0, 0.0]), 1.0, 0.1)
    (snap,) = history.events
    assert abs(snap.time - HYSTERESIS_FOLD) <= snap.uncertainty
    assert snap.energy_released == pytest.approx(0.75, abs=1e-4)


def test_backward_drive_is_the_mirror_image():
    driven = Driven(hysteresis, rate=-1.0)
    first = ls.equilibrate(hysteresis(0.0, 1.0))
    history = evolve(driven, 0.0, first, 1.0, 0.1)
    assert history.events[0].time == pytest.approx(HYSTERESIS_FOLD, abs=1e-7)
    assert unknown(history.equilibrium) < -1
    assert history.events[0].mode == pytest.approx([-1.0])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_symmetric_loss_of_stability(sign):
    history = run(pitchfork, None, 1.0, 0.05, memory=-1.0, time=-1.0, sign=sign)
    (snap,) = history.events
    assert abs(snap.time) <= snap.uncertainty <= 1e-8
    assert 0 <= snap.energy_released < 1e-9
    after = history.table[snap.row + 1 :]
    assert after.x.to_numpy() == pytest.approx(sign * np.sqrt(after.time.to_numpy()), rel=1e-6)
    before = history.table[: snap.row + 1]
    assert np.all(before.x == 0)


def test_a_truss_snaps_through():
    truss = Truss(height=0.5)
    history = run(truss.under, None, 2.0, 0.01)
    (snap,) = history.events
    limit = truss.limit_load()
    assert abs(snap.time - limit) <= snap.uncertainty
    assert unknown(snap.after) == pytest.approx(truss.inverted_height_at(limit), abs=1e-4)


def test_a_strip_with_constraints_has_no_event():
    history = run(lambda pull: Strip(0.9 - pull), None, 0.4, 0.05, time=0.0)
    assert history.events == ()
    direct = ls.equilibrate(Strip(0.5), history.equilibria[-2].state)
    assert history.equilibrium.energy == pytest.approx(direct.energy, rel=1e-9)


def test_without_another_minimum_the_history_is_kept():
    driven = Driven(fold, rate=-1.0)
    with pytest.raises(EvolutionInterrupted, match="no stable state") as caught:
        evolve(driven, 1.0, ls.equilibrate(fold(1.0)), 3.0, 0.07)
    history = caught.value.history
    assert history.time == pytest.approx(1.0, abs=1e-7)
    assert history.reason == "interrupted"
    assert unknown(history.equilibrium) == pytest.approx(0.0, abs=1e-3)


# ---- the oscillator ---------------------------------------------------------------------------------


def test_the_period_of_a_relaxation_oscillator_converges():
    oscillator, errors = Oscillator(), []
    for step in (0.04, 0.02, 0.01):
        history = evolve(oscillator, *oscillator.begin(), until=6.0, step=step, report_at=[3.0])
        times = np.array([snap.time for snap in history.events])
        assert len(times) == 6
        released = [snap.energy_released for snap in history.events]
        assert released == pytest.approx([0.75] * 6, abs=1e-4)
        errors.append(abs((times[-1] - times[1]) / 2 - oscillator.period))
    # The order is between 3/2, the contribution of the fold, and 2.
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.2)
    assert errors[-1] < 4e-4


def test_adapted_steps_hold_the_tolerance():
    oscillator = Oscillator()
    exact = oscillator.time_to_fold()
    errors, steps = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        history = evolve(
            oscillator, *oscillator.begin(), until=2.0, step=0.01, tolerance=tolerance,
            report_at=[1.0],
        )  # fmt: skip
        errors.append(abs(history.events[0].time - exact))
        steps.append(history.steps)
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 2e-5
    assert steps[0] < steps[1] < steps[2]


@pytest.mark.parametrize(("corrections", "order"), [(0, 1), (1, 2), (2, 2)])
def test_the_order_of_the_march(corrections, order):
    decay, errors = Decay(), []
    first = ls.equilibrate(decay.structure(1.0))
    for step in (0.1, 0.05, 0.025):
        history = evolve(decay, 1.0, first, 1.0, step, corrections=corrections)
        errors.append(abs(unknown(history.equilibrium) - np.exp(-1)))
        assert len(history) == round(1 / step) + 1
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(order, abs=0.15)


# ---- the same by continuation ---------------------------------------------------------------------


@pytest.mark.parametrize("seed", [2, 5, 7, 9, 20, 282])
def test_a_driven_evolution_snaps_where_the_branch_does(seed):
    family = RandomFamily(seed)
    branch = ls.follow(family, -1.0, 1.0, on_fold="snap")
    history = evolve(Driven(family), -1.0, branch.equilibria[0], 1.0, 0.05, time=-1.0)
    snaps = [event for event in branch.events if event.kind == "snap"]
    assert len(snaps) == len(history.events)
    for one, other in zip(snaps, history.events, strict=True):
        assert one.parameter == pytest.approx(other.time, abs=1e-7)
        assert one.energy_released == pytest.approx(other.energy_released, rel=1e-3, abs=1e-6)
        assert one.after.energy == pytest.approx(other.after.energy, abs=1e-5)
    assert history.equilibrium.energy == pytest.approx(branch.equilibria[-1].energy, abs=1e-9)


# ---- times ------------------------------------------------------------------------------------------


def test_reported_times_are_hit_exactly():
    times = [0.1, 1 / 3, 0.35, 0.7]
    history = run(hysteresis, VectorState([-1.0]), 1.0, 0.03, report_at=times)
    assert history.table[history.table.kind == "reported"].time.tolist() == times
    assert history.kinds == (
        "start", "reported", "reported", "reported", "before snap", "after snap", "reported", "end",
    )  # fmt: skip
    exact = [np.max(np.real(np.roots([1, 0, -1, -t]))) for t in (0.7, 1.0)]
    assert history.table.x.to_numpy()[-2:] == pytest.approx(exact)


def test_the_ends_may_be_reported_too():
    history = run(hysteresis, VectorState([-1.0]), 0.2, 0.03, report_at=[0.0, 0.1, 0.2])
    assert history.times.tolist() == [0.0, 0.1, 0.2]
    assert history.kinds == ("start", "reported", "end")


@pytest.mark.parametrize("beyond", [-1e-9, 0.0, 1e-9])
def test_a_snap_at_a_reported_time_takes_its_place(beyond):
    times = [0.1, HYSTERESIS_FOLD + beyond, 0.5]
    history = run(hysteresis, VectorState([-1.0]), 1.0, 0.02, report_at=times)
    (snap,) = history.events
    assert abs(snap.time - HYSTERESIS_FOLD) <= snap.uncertainty + 1e-15  # rounding of the times
    before, after = history.times[snap.row], history.times[snap.row + 1]
    assert before == pytest.approx(times[1], abs=1e-6)
    assert after == pytest.approx(times[1], abs=1e-6)
    assert history.times[-2:].tolist() == [0.5, 1.0]


def test_going_on_from_a_history_is_going_on():
    oscillator = Oscillator()
    whole = evolve(oscillator, *oscillator.begin(), until=2.5, step=0.05, outputs=X)
    first = evolve(oscillator, *oscillator.begin(), until=1.0, step=0.05, outputs=X)
    second = evolve(
        oscillator, first.memory, first.equilibrium, 2.5, 0.05, time=first.time, outputs=X
    )
    joined = first.joined(second)
    assert len(joined) == len(whole)
    assert joined.table.x.to_numpy() == pytest.approx(whole.table.x.to_numpy(), abs=1e-6)
    assert [s.row for s in joined.events] == [s.row for s in whole.events]
    assert joined.steps == whole.steps
    with pytest.raises(InvalidInput, match="begins at"):
        second.joined(first)


def test_a_limit_of_steps_keeps_what_was_found():
    oscillator = Oscillator()
    with pytest.raises(EvolutionInterrupted, match="max_steps") as caught:
        evolve(oscillator, *oscillator.begin(), until=2.5, step=0.05, max_steps=10)
    assert caught.value.history.time == pytest.approx(0.5)
    assert len(caught.value.history) == 11


def test_stop_when_ends_with_its_reason():
    oscillator = Oscillator()
    history = evolve(
        oscillator, *oscillator.begin(), until=9.0, step=0.05,
        stop_when=lambda time, memory, equilibrium: "left" if unknown(equilibrium) < 0 else None,
    )  # fmt: skip
    assert history.reason == "left"
    assert len(history.events) == 1
    assert history.time < 2.0


def test_save_and_load(tmp_path):
    oscillator = Oscillator()
    history = evolve(oscillator, *oscillator.begin(), until=2.5, step=0.05, outputs=X)
    path = tmp_path / "history.npz"
    history.save(path)
    again = History.load(path, oscillator, 0.0)
    assert again.table.equals(history.table)
    assert again.memories == history.memories
    assert again.events[0].time == history.events[0].time
    assert again.events[0].after.state.x == pytest.approx(history.events[0].after.state.x, abs=0)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(DataError, match="damaged"):
        History.load(path, oscillator, 0.0)


# ---- compiled marches -------------------------------------------------------------------------------


class Marching(Oscillator):
    """The same with a march of its own, which stops before the first step that fails."""

    fault = ""

    def __init__(self):
        self.calls = 0

    def march(self, memory, equilibrium, time, until, step):
        self.calls += 1
        state, steps = equilibrium, 0
        while time < until:
            length = until - time if time + step >= until - 1e-9 * step else step
            after, new = state, memory
            for _ in range(2):
                new = self.advance(memory, time, length, state, after)
                try:
                    after = ls.equilibrate(
                        self.structure(new), after.state, after.multipliers, require="any"
                    )
                except ls.LissomeError:
                    break
                if not after.stable or abs(unknown(after) - unknown(state)) > 0.25:
                    break
            else:
                time = until if length != step else time + length
                memory, state, steps = new, after, steps + 1
                continue
            return Marched(time, memory, state.state, state.multipliers, "unstable", steps)
        if self.fault == "unbalanced":
            memory += 1.0
        if self.fault == "late":
            time += 0.1
        return Marched(time, memory, state.state, state.multipliers, "until", steps)


def test_a_compiled_march_gives_the_same_history():
    plain, marching = Oscillator(), Marching()
    options = {"until": 3.0, "step": 0.05, "report_at": [0.5, 1.0, 2.2], "outputs": X}
    one = evolve(plain, *plain.begin(), **options)
    two = evolve(marching, *marching.begin(), **options)
    assert marching.calls >= 4
    assert one.kinds == two.kinds
    assert len(one.events) == 2
    assert two.times == pytest.approx(one.times, abs=1e-5)
    assert two.table.x.to_numpy() == pytest.approx(one.table.x.to_numpy(), abs=1e-3)
    asked = marching.calls
    evolve(marching, *marching.begin(), compiled=False, **options)
    assert marching.calls == asked


@pytest.mark.parametrize(
    ("fault", "message"), [("unbalanced", "off balance"), ("late", "ended at")]
)
def test_a_faulty_march_is_not_trusted(fault, message):
    marching = Marching()
    marching.fault = fault
    with pytest.raises(EvolutionInterrupted, match=message):
        evolve(marching, *marching.begin(), until=1.0, step=0.05)


# ---- bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"until": -1.0}, "until"),
        ({"until": np.nan}, "until"),
        ({"step": 0.0}, "step"),
        ({"corrections": -1}, "corrections"),
        ({"corrections": 0, "tolerance": 1e-3}, "corrections"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"time_tolerance": 0}, "time_tolerance"),
        ({"max_change": 0.0}, "max_change"),
        ({"max_steps": 0}, "max_steps"),
        ({"sign": 0}, "sign"),
        ({"report_at": [[1.0]]}, "report_at"),
        ({"report_at": [0.5, 1.5]}, "report_at"),
        ({"report_at": [-0.1]}, "report_at"),
        ({"stop_when": lambda t, m, e: True}, "stop_when"),
        ({"memory": 5.0}, "equilibrium"),
        ({"equilibrium": 3}, "equilibrium"),
        ({"outputs": {"x": lambda t, m, e: e.state.x}}, "must return a number"),
    ],
)
def test_bad_arguments(arguments, message):
    memory, equilibrium = Oscillator().begin()
    values = {"memory": memory, "equilibrium": equilibrium, "until": 1.0, "step": 0.1, **arguments}
    with pytest.raises(InvalidInput, match=message):
        evolve(Oscillator(), **values)


def test_an_unstable_beginning_is_refused():
    saddle = ls.equilibrate(hysteresis(0.0), require="any")
    assert saddle.index == 1
    with pytest.raises(InvalidInput, match="not stable"):
        evolve(Oscillator(), 0.0, saddle, 1.0, 0.1)
