"""Branches against closed forms: folds, bifurcations, snaps, switching, checkpoints, bad input."""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from models import (
    BALLOON_PEAK,
    HYSTERESIS_FOLD,
    Column,
    RandomFamily,
    Strip,
    Truss,
    balloon_pressure,
    balloon_under_pressure,
    column_tip_angle,
    fold,
    hysteresis,
    pitchfork,
    strip_exact,
)

import lissome as ls
from lissome._corrector import CorrectionFailed, adopted
from lissome.branch import Branch, BranchInterrupted, follow
from lissome.errors import DataError, InvalidInput
from lissome.structure import BaseStructure, DenseStructure, VectorState


def polynomial(gradient, start=0.0):
    """One unknown, with an energy whose derivative is a polynomial (numpy order of coefficients)."""
    g = np.polynomial.Polynomial(gradient)
    energy, slope = g.integ(), g.deriv()
    return DenseStructure(
        initial=[start],
        energy=lambda x: energy(x[0]),
        gradient=lambda x: g(x),
        hessian=lambda x: np.array([[slope(x[0])]]),
        check=False,
    )


def subcritical(p, start=0.0):
    """x (-p - x^2 + x^4): branches x = 0 and p = x^4 - x^2, which turns at x^2 = 1/2, p = -1/4."""
    return polynomial([0, -p, 0, -1, 0, 1], start)


def unknown(equilibrium):
    return equilibrium.state.x[0]


X = {"x": unknown}


def kinds(branch):
    return [event.kind for event in branch.events]


def assert_balanced(branch):
    for equilibrium in branch.equilibria:
        here = equilibrium.structure.evaluate(equilibrium.state, equilibrium.multipliers, 1)
        assert np.max(np.abs(here.gradient)) < 1e-8
        assert np.max(np.abs(here.constraints), initial=0.0) < 1e-8


# ---- pitchforks -----------------------------------------------------------------------------------


def test_the_trivial_branch_of_a_pitchfork():
    branch = follow(pitchfork, -1.0, 2.0, outputs=X)
    (event,) = branch.events
    assert event.kind == "bifurcation"
    assert abs(event.parameter) <= event.uncertainty <= 1e-8
    assert (event.index_before, event.index_after) == (0, 1)
    assert event.mode == pytest.approx([1.0])
    table = branch.table
    assert table.parameter.iloc[0] == -1.0
    assert table.parameter.iloc[-1] == 2.0
    assert np.all(table.x == 0.0)
    assert table.smallest_eigenvalue.to_numpy() == pytest.approx(-table.parameter.to_numpy())
    assert np.array_equal(table.stable, table.parameter < event.parameter)
    assert np.array_equal(table["index"], (table.parameter > event.parameter).astype(int))
    # On the trivial branch only the parameter moves: its arclength is p over the interval.
    assert table.arclength.to_numpy() == pytest.approx((table.parameter.to_numpy() + 1) / 3)


@pytest.mark.parametrize("sign", [1, -1])
def test_switching_at_a_supercritical_pitchfork(sign):
    branch = follow(pitchfork, -1.0, 2.0, outputs=X)
    other = branch.switch(branch.events[0], sign)
    table = other.table
    assert np.all(table.stable[1:])
    assert table.x[1:].to_numpy() == pytest.approx(
        sign * np.sqrt(table.parameter[1:].to_numpy()), abs=1e-9
    )
    assert table.parameter.iloc[-1] == 2.0
    assert other.finished
    assert kinds(other) == ["end"]


@pytest.mark.parametrize("sign", [1, -1])
def test_switching_at_a_subcritical_pitchfork_goes_back_and_turns(sign):
    branch = follow(subcritical, -1.0, 1.0)
    event = branch.events[0]
    other = branch.switch(event, sign, outputs=X, report_at=[-0.2])
    assert kinds(other) == ["fold", "end"]
    turn = other.events[0]
    assert turn.parameter == pytest.approx(-0.25, abs=1e-12)
    assert abs(turn.parameter + 0.25) <= turn.uncertainty
    assert unknown(turn.equilibrium) == pytest.approx(sign * np.sqrt(0.5), abs=1e-7)
    assert (turn.index_before, turn.index_after) == (1, 0)
    table = other.table
    assert table.parameter.to_numpy() == pytest.approx(
        (table.x**4 - table.x**2).to_numpy(), abs=1e-8
    )
    off = table[(table.x.abs() - np.sqrt(0.5)).abs() > 1e-6][1:]
    assert np.array_equal(off.stable, off.x.abs() > np.sqrt(0.5))
    # The reported parameter is passed on the way back and again after the turn.
    reported = table[table.kind == "reported"]
    assert np.all(reported.parameter == -0.2)
    roots = np.sqrt((1 + np.array([-1, 1]) * np.sqrt(1 - 0.8)) / 2)
    assert (sign * reported.x).to_numpy() == pytest.approx(roots)


def test_snap_at_a_subcritical_pitchfork():
    branch = follow(subcritical, -1.0, 1.0, on_fold="snap", outputs=X)
    assert kinds(branch) == ["bifurcation", "snap"]
    snap = branch.events[1]
    # At p = 0 the energy is -x^4/4 + x^6/6, with minima -1/12 at x = +-1.
    assert snap.energy_released == pytest.approx(1 / 12, abs=1e-5)
    assert unknown(snap.before) == 0.0
    assert unknown(snap.after) == pytest.approx(1.0, abs=1e-5)
    assert np.all(branch.table.stable)
    downward = follow(subcritical, -1.0, 1.0, on_fold="snap", sign=-1)
    assert unknown(downward.events[1].after) == pytest.approx(-1.0, abs=1e-5)


def test_backward_on_the_far_branch_of_a_subcritical_pitchfork():
    branch = follow(subcritical, 1.0, -1.0, on_fold="snap", initial=VectorState([1.2]), outputs=X)
    assert kinds(branch) == ["fold", "snap"]
    assert branch.events[0].parameter == pytest.approx(-0.25, abs=1e-10)
    # From x^2 = 1/2 at p = -1/4, where the energy is 1/48, to x = 0.
    assert branch.events[1].energy_released == pytest.approx(1 / 48, abs=1e-6)
    assert branch.table.x.iloc[-1] == 0.0
    assert branch.table.parameter.iloc[-1] == -1.0
    assert np.all(branch.table.stable)


def test_snap_at_a_supercritical_pitchfork_goes_over_smoothly():
    branch = follow(pitchfork, -1.0, 2.0, on_fold="snap", outputs=X)
    assert kinds(branch) == ["bifurcation", "snap"]
    assert 0 <= branch.events[1].energy_released < 1e-9
    table = branch.table
    after = table[branch.events[1].after_row :]
    assert after.x.to_numpy() == pytest.approx(np.sqrt(after.parameter.to_numpy()), rel=1e-6)


@pytest.mark.parametrize("imperfection", [1e-1, 1e-3, 1e-5])
def test_perturbed_pitchfork(imperfection):
    # p = x^2 - q/x: the branch with x < 0 turns where x^3 = -q/2, at p = 3 (q/2)^(2/3).
    critical = 3 * (imperfection / 2) ** (2 / 3)

    def family(p):
        return pitchfork(p, imperfection)

    connected = follow(family, -1.0, 2.0, outputs=X)
    assert kinds(connected) == []
    assert np.all(connected.table.stable)
    assert connected.table.x.iloc[-1] > np.sqrt(2)
    other = follow(family, 2.0, -1.0, initial=VectorState([-1.5]), outputs=X, bounds=(-1.0, 2.5))
    assert kinds(other) == ["fold", "end"]
    assert other.events[0].parameter == pytest.approx(critical, abs=1e-9)
    x = other.table.x
    assert np.all(x < 0)
    assert other.table.parameter.iloc[-1] == 2.5  # turned at the fold, and left on the other side
    p = other.table.parameter.to_numpy()
    assert p == pytest.approx((x**2 - imperfection / x).to_numpy(), abs=1e-7)


def test_transcritical_point_both_ways():
    def family(p):  # x (x - p): branches x = 0 and x = p exchange their stability
        return polynomial([0, -p, 1])

    branch = follow(family, -1.0, 1.0, outputs=X)
    (event,) = branch.events
    assert event.kind == "bifurcation"
    assert abs(event.parameter) <= 1e-8
    ends = []
    for sign in (1, -1):
        other = branch.switch(event, sign)
        table = other.table[1:]
        assert table.x.to_numpy() == pytest.approx(table.parameter.to_numpy(), abs=1e-9)
        assert np.array_equal(table.stable, table.parameter > 0)
        ends.append(table.parameter.iloc[-1])
    assert ends == [1.0, -1.0]


# ---- folds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("on_fold", ["turn", "stop"])
def test_a_fold(on_fold):
    branch = follow(
        fold, 1.0, -1.0, on_fold=on_fold, outputs=X, report_at=[0.25, 1e-6], bounds=(-2, 4)
    )
    event = branch.events[0]
    assert event.kind == "fold"
    assert abs(event.parameter) <= event.uncertainty < 1e-12
    assert event.mode == pytest.approx([-1.0])  # along the direction of travel
    reported = branch.table[branch.table.kind == "reported"]
    exact = [0.5, 1e-3] if on_fold == "stop" else [0.5, 1e-3, -1e-3, -0.5]
    assert reported.x.to_numpy() == pytest.approx(exact, rel=1e-6)
    assert np.array_equal(reported.parameter, np.abs(reported.x.round(3)) ** 2)
    if on_fold == "stop":
        assert len(branch.events) == 1
        assert np.all(branch.table.stable)
        assert branch.table.kind.iloc[-1] == "event"
    else:
        assert branch.table.x.iloc[-1] == pytest.approx(-2.0)  # at the bound, p = 4
        assert branch.events[-1].kind == "end"
    assert_balanced(branch)


def test_hysteresis_turned_and_snapped():
    turned = follow(hysteresis, -1.0, 1.0, initial=VectorState([-1.3]), outputs=X)
    assert kinds(turned) == ["fold", "fold"]
    assert turned.events[0].parameter == pytest.approx(HYSTERESIS_FOLD, abs=1e-12)
    assert turned.events[1].parameter == pytest.approx(-HYSTERESIS_FOLD, abs=1e-12)
    table = turned.table
    assert table.parameter.to_numpy() == pytest.approx((table.x**3 - table.x).to_numpy(), abs=1e-8)
    inner = table[(3 * table.x**2 - 1).abs() > 1e-6]
    assert np.array_equal(inner.stable, 3 * inner.x**2 > 1)
    for start, stop in ((-1.0, 1.0), (1.0, -1.0)):
        snapped = follow(hysteresis, start, stop, on_fold="snap", outputs=X)
        assert kinds(snapped) == ["fold", "snap"]
        snap = snapped.events[1]
        assert snap.parameter == pytest.approx(np.sign(stop) * HYSTERESIS_FOLD, abs=1e-12)
        assert snap.energy_released == pytest.approx(0.75, abs=1e-5)  # from 1/12 to -2/3
        assert unknown(snap.after) == pytest.approx(np.sign(stop) * 2 / np.sqrt(3), abs=1e-5)
        assert np.all(snapped.table.stable)
        assert snapped.table.parameter.iloc[-1] == stop


@settings(max_examples=10, deadline=None)
@given(st.floats(0.1, 10), st.floats(-3, 3), st.floats(0.2, 3), st.sampled_from(["turn", "snap"]))
def test_any_cubic_turns_where_it_should(stretch, shift, height, on_fold):
    # p = a ((x - s)^3 - h^2 (x - s)) turns at x - s = -+ h / sqrt(3).
    def family(p):
        return polynomial((np.poly1d([1, -shift]) ** 3 * stretch - np.poly1d([1, -shift]) * (
            stretch * height**2) - p).coeffs[::-1], shift - 2 * height)  # fmt: skip

    critical = stretch * height**3 * HYSTERESIS_FOLD
    branch = follow(family, -2 * critical, 2 * critical, on_fold=on_fold, eigenvalues=False)
    assert kinds(branch) == (["fold", "fold"] if on_fold == "turn" else ["fold", "snap"])
    assert branch.events[0].parameter == pytest.approx(critical, rel=1e-8)
    assert branch.table.parameter.iloc[-1] == 2 * critical


def test_two_folds_close_together_are_not_stepped_over():
    # p = x^3 - e x turns at x = -+ sqrt(e / 3), and back: unseen by a step across both.
    for e in (1e-1, 1e-2, 1e-3, 1e-4):
        branch = follow(lambda p, e=e: polynomial([-p, -e, 0.0, 1.0], -1.0), -1.0, 1.0)
        assert kinds(branch) == ["fold", "fold"]
        exact = 2 * (e / 3) ** 1.5
        assert [event.parameter for event in branch.events] == pytest.approx([exact, -exact])


@pytest.mark.parametrize("n", [20, 60])
@pytest.mark.parametrize("beyond", [-1e-12, 0.0, 1e-12])
def test_an_interval_that_ends_in_a_critical_state_has_no_event(n, beyond):
    """A clamped column in `n` unknowns: rounding hides on which side of buckling the last state is."""
    second = np.diff(np.eye(n + 2), 2, axis=0)[:, 1:-1] * (n + 1.0) ** 2
    stiff = second.T @ second
    critical = np.linalg.eigvalsh(stiff)[0]

    def family(p):
        return DenseStructure(
            np.zeros(n),
            lambda x: 0.5 * x @ stiff @ x - 0.5 * p * x @ x + 0.25 * np.sum(x**4),
            lambda x: stiff @ x - p * x + x**3,
            lambda x: stiff - p * np.eye(n) + 3 * np.diag(x**2),
            check=False,
        )

    branch = follow(family, 0.0, critical * (1 + beyond))
    assert branch.finished
    assert kinds(branch) == []
    assert branch.table.parameter.iloc[-1] == critical * (1 + beyond)
    past = follow(family, 0.0, critical * (1 + 1e-6))
    assert kinds(past) == ["bifurcation"]
    assert past.events[0].parameter == pytest.approx(critical, rel=1e-8)


def test_a_closed_branch_is_closed_and_both_folds_are_found():
    def family(p):  # x^2 + p^2 = 1
        return polynomial([p * p - 1, 0, 1], 1.0)

    branch = follow(family, 0.0, 2.0, outputs=X, max_step=0.1)
    assert kinds(branch) == ["fold", "fold", "end"]
    assert branch.events[0].parameter == pytest.approx(1.0, abs=1e-12)
    assert branch.events[1].parameter == pytest.approx(-1.0, abs=1e-12)
    assert "come back" in branch.events[2].detail
    assert branch.table.x.iloc[-1] == pytest.approx(1.0)
    assert branch.table.parameter.iloc[-1] == 0.0


@pytest.mark.parametrize("center", [0.0, 0.3, -0.6])
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_loop_that_begins_at_a_bifurcation_is_closed(center, which, sign):
    """x = 0 is crossed twice by the circle (x - c)^2 + p^2 = 1: pitchforks if c = 0, else aslant."""

    def family(p):
        return polynomial([0, center**2 + p * p - 1, -2 * center, 1])

    trunk = follow(family, -2.0, 2.0, max_step=0.1)
    place = np.sqrt(1 - center**2) * (2 * which - 1)
    event = trunk.events[which]
    assert event.parameter == pytest.approx(place, abs=1e-8)
    wanted = [0.0, 0.98 * place]
    loop = trunk.switch(event, sign, outputs=X, report_at=wanted, max_step=0.4, max_steps=100)
    assert loop.events[-1].kind == "end"
    assert "come back" in loop.events[-1].detail
    passed = ["fold"] if center == 0 else ["bifurcation", "fold", "fold"]
    assert sorted(kinds(loop)[:-1]) == passed
    table = loop.table
    assert table.x.to_numpy()[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert table.parameter.to_numpy()[[0, -1]] == pytest.approx([place, place], abs=1e-6)
    # Once around, and no more; every value is passed twice.
    angle = np.unwrap(np.arctan2(table.x - center, table.parameter))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi, abs=1e-5)
    for value in wanted:
        assert np.count_nonzero(table.kind[table.parameter == value] == "reported") == 2


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("step", [0.03, 0.1, 0.4])
def test_half_of_a_lemniscate_ends_where_it_crosses_itself(sign, step):
    """p^2 = x^2 - x^4: the branch comes back to its first state across its own beginning."""

    def family(p):
        return polynomial([p * p, 0, -1, 0, 1], -0.5)

    trunk = follow(family, np.sqrt(3) / 4, -0.45, max_step=step)
    assert kinds(trunk) == ["bifurcation"]
    assert trunk.events[0].parameter == pytest.approx(0.0, abs=1e-7)
    loop = trunk.switch(trunk.events[0], sign, outputs=X, max_step=step, bounds=(-1, 1))
    assert kinds(loop) == ["fold", "fold", "end"]
    assert [e.parameter for e in loop.events[:2]] == pytest.approx([sign / 2, -sign / 2])
    x, p = loop.table.x.to_numpy(), loop.table.parameter.to_numpy()
    assert x[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert p[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert np.all(sign * x[1:-1] > 0)
    assert np.max(np.abs(x)) > 0.99


def test_a_loop_through_curved_space_is_closed():
    """The circle bent upward, y = x^2 + x/2, in two unknowns."""

    def family(p):
        k = p * p - 1

        def parts(x):
            off = x[1] - x[0] ** 2 - 0.5 * x[0]
            return off, 2 * x[0] + 0.5

        def gradient(x):
            off, slope = parts(x)
            return np.array([x[0] ** 3 + k * x[0] - off * slope, off])

        def hessian(x):
            off, slope = parts(x)
            return np.array([[3 * x[0] ** 2 + k + slope**2 - 2 * off, -slope], [-slope, 1.0]])

        return DenseStructure(
            [0.0, 0.0],
            lambda x: x[0] ** 4 / 4 + k * x[0] ** 2 / 2 + parts(x)[0] ** 2 / 2,
            gradient,
            hessian,
        )

    trunk = follow(family, -2.0, 2.0, max_step=0.1)
    loop = trunk.switch(trunk.events[0], outputs=X, max_step=0.4, max_steps=100)
    assert "come back" in loop.events[-1].detail
    angle = np.unwrap(np.arctan2(loop.table.x, loop.table.parameter))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi, abs=1e-5)


# ---- trusses, balloons, columns ---------------------------------------------------------------------


def test_von_mises_truss():
    truss = Truss(height=0.5)
    limit = truss.limit_load()
    branch = follow(truss.under, 0.0, 1.5 * limit, outputs=X, report_at=[0.0, 0.5 * limit])
    assert kinds(branch) == ["fold", "fold"]
    up, down = branch.events
    assert up.parameter == pytest.approx(limit, rel=1e-11)
    assert unknown(up.equilibrium) == pytest.approx(truss.limit_height(), rel=1e-6)
    assert down.parameter == pytest.approx(-limit, rel=1e-11)
    at_half = branch.table[branch.table.parameter == 0.5 * limit].x.to_numpy()
    assert len(at_half) == 3
    assert at_half[0] == pytest.approx(truss.height_at(0.5 * limit))
    assert at_half[2] == pytest.approx(truss.inverted_height_at(0.5 * limit))
    snapped = follow(truss.under, 0.0, 1.5 * limit, outputs=X, on_fold="snap")
    after = truss.inverted_height_at(limit)
    assert unknown(snapped.events[1].after) == pytest.approx(after, rel=1e-5)
    y = truss.limit_height()

    def energy(y):
        return (np.hypot(1, y) - truss.rest) ** 2 + limit * y

    assert snapped.events[1].energy_released == pytest.approx(energy(y) - energy(after), rel=1e-5)


def test_a_steep_truss_sways_before_its_limit_load():
    truss = Truss(height=3.0, sway=True)
    branch = follow(truss.under, 0.0, 1.2 * truss.limit_load(), report_at=[0.1])
    first, second = branch.events[:2]
    y = truss.sway_height()
    assert first.kind == "bifurcation"
    assert first.parameter == pytest.approx(2 * y * (truss.rest / np.hypot(1, y) - 1), abs=1e-7)
    assert np.abs(first.mode) == pytest.approx([1.0, 0.0], abs=1e-6)
    assert (first.index_before, first.index_after) == (0, 1)
    assert second.kind == "fold"
    assert second.parameter == pytest.approx(truss.limit_load(), rel=1e-10)
    assert (second.index_before, second.index_after) == (1, 2)
    stopped = follow(truss.under, 0.0, truss.limit_load(), on_fold="stop")
    assert kinds(stopped) == ["bifurcation"]
    snapped = follow(truss.under, 0.0, 1.2 * truss.limit_load(), on_fold="snap")
    assert kinds(snapped)[:2] == ["bifurcation", "snap"]
    after = snapped.events[1].after
    # It swings through: the only stable state under that load hangs below the supports.
    assert after.state.x[0] == pytest.approx(0.0, abs=1e-8)
    assert after.state.x[1] == pytest.approx(truss.inverted_height_at(first.parameter), abs=1e-4)


def test_both_swayed_branches_of_the_truss_are_mirror_images():
    truss = Truss(height=3.0, sway=True)
    branch = follow(truss.under, 0.0, truss.limit_load(), on_fold="stop")
    right, left = (branch.switch(branch.events[0], sign, max_steps=200) for sign in (1, -1))
    assert right.events[-1].parameter == pytest.approx(left.events[-1].parameter, abs=1e-9)
    a = np.array([e.state.x for e in right.equilibria])
    b = np.array([e.state.x for e in left.equilibria])
    assert a == pytest.approx(b * [-1, 1], abs=1e-6)
    assert np.max(np.abs(a[:, 0])) > 0.1


def test_balloon_under_pressure():
    peak = balloon_pressure(BALLOON_PEAK)
    branch = follow(
        balloon_under_pressure, 0.3, 2 * peak, outputs=X, bounds=(0.25, None), report_at=[0.5]
    )  # fmt: skip
    assert kinds(branch) == ["fold", "end"]
    assert branch.events[0].parameter == pytest.approx(peak, rel=1e-11)
    assert unknown(branch.events[0].equilibrium) == pytest.approx(BALLOON_PEAK, rel=1e-6)
    assert balloon_pressure(branch.table.x.to_numpy()) == pytest.approx(
        branch.table.parameter.to_numpy(), rel=1e-8
    )
    # There is no other equilibrium above the peak: the balloon bursts, and says so.
    with pytest.raises(BranchInterrupted, match="no minimum") as caught:
        follow(balloon_under_pressure, 0.3, 2 * peak, on_fold="snap")
    assert caught.value.branch.events[0].parameter == pytest.approx(peak, rel=1e-11)
    assert len(caught.value.branch) > 3


def test_column_buckling_and_its_post_buckling():
    angles, loads = {}, {}
    p = 3.0
    for n in (20, 40, 80):

        def family(load, n=n):
            return Column(load, segments=n)

        straight = follow(family, 1.0, 4.0, eigenvalues=False)
        event = straight.events[0]
        loads[n] = event.parameter
        buckled = straight.switch(
            event, report_at=[p], outputs={"tip": lambda e: e.state.x[-1]}, eigenvalues=True
        )
        assert np.all(buckled.table.stable[1:])
        angles[n] = buckled.table.tip[buckled.table.parameter == p].to_numpy()[0]
        other = straight.switch(event, -1, report_at=[p], outputs={"tip": lambda e: e.state.x[-1]})
        assert other.table.tip[other.table.parameter == p].to_numpy()[0] == pytest.approx(
            -angles[n], abs=1e-8
        )
    exact = column_tip_angle(p)
    for found, truth in ((loads, np.pi**2 / 4), (angles, exact)):
        errors = np.abs(np.array([found[n] for n in (20, 40, 80)]) - truth)
        assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(2.0, abs=0.05)
        assert (4 * found[80] - found[40]) / 3 == pytest.approx(truth, abs=2e-6)


def test_a_clamped_strip_with_constraints_against_elliptic_integrals():
    spans = [0.9, 0.7, 0.5]
    found = {}
    for n in (40, 80):
        branch = follow(
            lambda span, n=n: Strip(span, segments=n), 0.95, 0.5, report_at=spans,
            outputs={"compression": lambda e: abs(e.multipliers[0])},
        )  # fmt: skip
        assert np.all(branch.table.stable)
        rows = branch.table[branch.table.kind == "reported"]
        assert rows.parameter.tolist() == spans
        found[n] = rows.compression.to_numpy()
        assert_balanced(branch)
    exact = [strip_exact(span)[0] for span in spans]
    assert (4 * found[80] - found[40]) / 3 == pytest.approx(exact, rel=1e-5)


def test_a_rotating_pendulum_with_a_constraint():
    # A bead at (x, y) on the unit circle: energy y - p x^2 / 2; it leaves the bottom at p = 1, and
    # then hangs at height -1/p.
    def family(p):
        return DenseStructure(
            initial=[0.0, -1.0],
            energy=lambda v: v[1] - p * v[0] ** 2 / 2,
            gradient=lambda v: np.array([-p * v[0], 1.0]),
            hessian=lambda v: np.diag([-p, 0.0]),
            constraints=lambda v: [v @ v - 1],
            jacobian=lambda v: 2 * v[None],
            constraint_hessian=lambda v, m: 2 * m[0] * np.eye(2),
        )

    branch = follow(family, 0.0, 3.0)
    assert branch.events[0].parameter == pytest.approx(1.0, abs=1e-8)
    other = branch.switch(branch.events[0], outputs={"y": lambda e: e.state.x[1]})
    assert other.table.y.to_numpy() == pytest.approx(
        -1 / other.table.parameter.to_numpy(), abs=1e-8
    )
    assert np.all(other.table.stable[1:])


def test_neutral_motions_do_not_disturb_the_index():
    # Two beads on a line: the energy depends on their distance only.
    def family(p):
        flip = np.array([1.0, -1.0])
        return DenseStructure(
            initial=[3.0, 3.0],
            energy=lambda x: (x @ flip) ** 4 / 4 - p * (x @ flip) ** 2 / 2,
            gradient=lambda x: ((x @ flip) ** 3 - p * (x @ flip)) * flip,
            hessian=lambda x: (3 * (x @ flip) ** 2 - p) * np.outer(flip, flip),
            neutral=lambda x: np.ones((1, 2)),
        )

    branch = follow(family, -1.0, 1.0)
    assert branch.events[0].parameter == pytest.approx(0.0, abs=1e-8)
    other = branch.switch(branch.events[0])
    last = other.equilibria[-1]
    assert abs(last.state.x[0] - last.state.x[1]) == pytest.approx(1.0)
    assert np.sum(last.state.x) == pytest.approx(6.0)
    assert last.stable


def test_the_critical_load_of_a_fine_chain_is_exact():
    # The chain buckles at (4 / h^2) sin^2(pi h / 4), h = 1 / segments.
    for n in (50, 2000):
        exact = 4 * n**2 * np.sin(np.pi / (4 * n)) ** 2
        branch = follow(lambda load, n=n: Column(load, segments=n), 1.0, 4.0, eigenvalues=False)
        (event,) = branch.events
        assert abs(event.parameter - exact) <= event.uncertainty < 1e-7
        shape = np.sin(np.pi * np.arange(1, n + 1) / (2 * n))
        assert event.mode == pytest.approx(event.mode[-1] * shape, abs=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["turn", "snap", "stop"]))
def test_random_structures_are_followed_faithfully(seed, on_fold):
    family = RandomFamily(seed)
    branch = follow(family, -1.0, 1.0, on_fold=on_fold, bounds=(-3, 3), eigenvalues=False)
    assert branch.finished
    assert_balanced(branch)
    events = {event.row for event in branch.events} | {e.after_row for e in branch.events}
    for i, row in enumerate(branch.table.itertuples()):
        if i not in events:  # next to an event the sign is a matter of rounding
            exact = family.index(row.parameter, branch.equilibria[i].state.x)
            assert row.index == exact
            assert row.stable == (exact == 0)
    # Every change of the index has its event.
    if on_fold == "turn":
        steps = np.diff(branch.table["index"])
        changes = sum(e.index_after - e.index_before for e in branch.events)
        assert np.sum(steps) == changes
    else:
        assert np.all(branch.table["index"] == 0)
    for event in branch.events:
        if event.kind == "snap":
            assert event.energy_released > -1e-12
            assert event.after.stable


# ---- several events in one step ---------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.1, 1e-3, 1e-6])
def test_two_bifurcations_in_one_step(gap):
    def family(p):
        stiffness = np.array([-p, gap - p])
        return DenseStructure(
            initial=[0.0, 0.0],
            energy=lambda x: np.sum(x**4) / 4 + stiffness @ x**2 / 2,
            gradient=lambda x: x**3 + stiffness * x,
            hessian=lambda x: np.diag(3 * x**2 + stiffness),
        )

    branch = follow(family, -1.0, 1.2, step=0.9, max_step=0.9)
    assert kinds(branch) == ["bifurcation"] * 2
    for event, exact in zip(branch.events, (0.0, gap), strict=True):
        assert event.parameter == pytest.approx(exact, abs=1e-8)
    assert [e.index_after for e in branch.events] == [1, 2]
    assert np.abs(branch.events[0].mode) == pytest.approx([1, 0], abs=1e-6)
    assert np.abs(branch.events[1].mode) == pytest.approx([0, 1], abs=1e-6)


def test_a_double_bifurcation_has_two_modes():
    def family(p):
        return DenseStructure(
            initial=[0.0, 0.0],
            energy=lambda x: np.sum(x**4) / 4 - p * x @ x / 2,
            gradient=lambda x: x**3 - p * x,
            hessian=lambda x: np.diag(3 * x**2 - p),
        )

    branch = follow(family, -1.0, 1.0)
    (event,) = branch.events
    assert (event.index_before, event.index_after) == (0, 2)
    assert event.modes @ event.modes.T == pytest.approx(np.eye(2))
    for direction in ([1, 0], [0, 1], [1, 1], [1, -1]):
        end = branch.switch(event, mode=direction).equilibria[-1].state.x
        assert end == pytest.approx(direction, abs=1e-9)
    for k in (0, 1):  # arbitrary within the plane: some branch is found
        end = branch.switch(event, mode=k).equilibria[-1].state.x
        assert end**3 == pytest.approx(end, abs=1e-9)
        assert np.linalg.norm(end) > 0.9


def test_a_fold_and_a_bifurcation_in_one_step():
    # x turns at p = 1; y loses its stability on the way, at x = 0.1, which is p = 0.99.
    def family(p):
        return DenseStructure(
            initial=[1.0, 0.0],
            energy=lambda v: v[0] ** 3 / 3 - (1 - p) * v[0] + v[1] ** 4 / 4
            + (v[0] - 0.1) * v[1] ** 2 / 2,
            gradient=lambda v: np.array(
                [v[0] ** 2 - (1 - p) + v[1] ** 2 / 2, v[1] ** 3 + (v[0] - 0.1) * v[1]]
            ),
            hessian=lambda v: np.array([[2 * v[0], v[1]], [v[1], 3 * v[1] ** 2 + v[0] - 0.1]]),
        )  # fmt: skip

    branch = follow(family, 0.0, 2.0, max_step=0.8, step=0.8, bounds=(-0.5, 2.0))
    assert kinds(branch) == ["bifurcation", "fold", "end"]
    assert branch.events[0].parameter == pytest.approx(0.99, abs=1e-8)
    assert branch.events[1].parameter == pytest.approx(1.0, abs=1e-12)


# ---- the walk ---------------------------------------------------------------------------------------


def test_reported_values_are_hit_exactly_forward_and_backward():
    values = [0.1, 1 / 3, 0.7, 2.0]
    exact = np.sqrt(values)
    for start, stop, order in ((0.05, 2.0, 1), (2.0, 0.05, -1)):
        branch = follow(
            pitchfork, start, stop, report_at=values, initial=VectorState([1.0]), outputs=X
        )
        rows = branch.table[branch.table.kind == "reported"]
        assert rows.parameter.tolist() == values[::order]
        assert rows.x.to_numpy() == pytest.approx(exact[::order], abs=1e-12)


def test_a_critical_reported_value_is_marked_not_judged():
    branch = follow(pitchfork, -1.0, 1.0, report_at=[0.0])
    row = branch.table[branch.table.kind == "reported"].iloc[0]
    assert not row.stable
    assert np.isnan(row.smallest_eigenvalue)
    assert kinds(branch) == ["bifurcation"]
    ended = follow(pitchfork, -1.0, 0.0)  # the end itself is critical
    assert not ended.table.stable.iloc[-1]
    assert np.all(ended.table.stable[:-1])


def test_an_unstable_equilibrium_is_followed_when_it_is_given():
    saddle = ls.equilibrate(pitchfork(1.0), require="any")
    assert saddle.index == 1
    branch = follow(pitchfork, 1.0, -1.0, initial=saddle)
    assert branch.events[0].parameter == pytest.approx(0.0, abs=1e-8)
    assert (branch.events[0].index_before, branch.events[0].index_after) == (1, 0)
    assert branch.table.stable.iloc[-1]


def test_steps_do_not_depend_on_the_mesh():
    counts, lengths = [], []
    for n in (20, 80, 320):
        branch = follow(
            lambda load, n=n: Column(load, segments=n, tilt=0.3), 0.0, 6.0, eigenvalues=False
        )
        counts.append(len(branch))
        lengths.append(branch.table.arclength.iloc[-1])
    assert max(counts) - min(counts) <= 1
    assert lengths[1] == pytest.approx(lengths[2], rel=1e-2)  # sums of chords


def test_corrections_are_few():
    branch = follow(
        lambda load: Column(load, segments=100, tilt=0.3), 0.0, 6.0, eigenvalues=False,
        report_at=np.linspace(0, 6, 31),
    )  # fmt: skip
    iterations = np.array([e.iterations for e in branch.equilibria[1:]])
    assert np.mean(iterations) <= 4


@dataclass(frozen=True)
class _HeldState:
    x: np.ndarray
    end: float


@dataclass(frozen=True)
class _HeldChain(BaseStructure):
    """Springs in a row, with quartic parts, from 0 to a support whose place is in the state."""

    place: float
    count: int = 6

    @property
    def size(self):
        return self.count - 1

    def start(self):
        return _HeldState(np.zeros(self.count - 1), self.place)

    def adopt(self, state):
        return _HeldState(state.x, self.place)

    def retract(self, state, dx):
        return _HeldState(state.x + dx, state.end)

    def difference(self, a, b):
        assert a.end == b.end == self.place
        return b.x - a.x

    def evaluate(self, state, multipliers, order=2):
        assert state.end == self.place
        stretch = np.diff(state.x, prepend=0.0, append=state.end)
        energy = np.sum(stretch**2 / 2 + stretch**4 / 4)
        force, stiffness = stretch + stretch**3, 1 + 3 * stretch**2
        gradient = force[:-1] - force[1:]
        hessian = np.diag(stiffness[:-1] + stiffness[1:])
        hessian -= np.diag(stiffness[1:-1], 1) + np.diag(stiffness[1:-1], -1)
        from lissome.factorization import DenseKKT
        from lissome.structure import Evaluation

        return Evaluation(energy, np.zeros(0), gradient, DenseKKT(hessian))


def test_a_moving_support_is_adopted():
    branch = follow(_HeldChain, 0.0, 3.0, report_at=[1.0, 2.5])
    for row, equilibrium in zip(branch.table.itertuples(), branch.equilibria, strict=True):
        assert equilibrium.state.end == row.parameter
        exact = row.parameter * np.arange(1, 6) / 6
        assert equilibrium.state.x == pytest.approx(exact, abs=1e-9)


def test_the_exact_derivative_gives_the_same_branch():
    def slope(p, state, multipliers):
        return -state.x, np.zeros(0)

    by_differences = follow(subcritical, -1.0, 1.0)
    exact = follow(subcritical, -1.0, 1.0, residual_derivative=slope)
    assert exact.table.equals(by_differences.table)
    one, other = (b.switch(b.events[0], outputs=X).table for b in (by_differences, exact))
    assert one.x.to_numpy() == pytest.approx(other.x.to_numpy(), abs=1e-6)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_a_family_may_refuse_what_lies_beyond_its_ends(offset):
    def family(p):
        q = p - offset
        if not 0 <= q <= 1:
            raise InvalidInput(f"argument `p` is {p}; it must lie in [0, 1]")
        return polynomial([-q, 1.0, 0.0, 1.0])

    branch = follow(family, offset, offset + 1.0, outputs=X)
    x = branch.table.x.to_numpy()
    assert x + x**3 == pytest.approx(branch.table.parameter.to_numpy() - offset, abs=1e-9)
    assert branch.table.parameter.iloc[-1] == offset + 1.0
    back = follow(family, offset + 1.0, offset, outputs=X)
    assert back.table.x.iloc[-1] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(BranchInterrupted, match="no structure at"):
        follow(family, offset, offset + 1.5)


# ---- interruptions ----------------------------------------------------------------------------------


def test_too_few_steps_keep_what_was_found():
    with pytest.raises(BranchInterrupted, match="max_steps") as caught:
        follow(fold, 1.0, -1.0, max_steps=30)  # turns, and goes on for ever
    branch = caught.value.branch
    assert len(branch) > 30
    assert not branch.finished
    assert kinds(branch) == ["fold"]


def test_a_family_that_breaks_off_names_the_place():
    def family(p):
        return polynomial([-p if p < 0.5 else 5 - p, 1.0])

    with pytest.raises(BranchInterrupted, match=r"parameter 0\.49999") as caught:
        follow(family, 0.0, 1.0)
    assert caught.value.branch.table.parameter.max() == pytest.approx(0.5, abs=1e-6)


def test_an_interruption_goes_through_a_process_boundary():
    with pytest.raises(BranchInterrupted) as caught:
        follow(lambda p: fold(p), 1.0, -1.0, max_steps=5)
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value)
    assert copy.branch is None  # a function without a name does not travel
    with pytest.raises(BranchInterrupted) as caught:
        follow(_HeldChain, 0.0, 3.0, max_steps=5)
    copy = pickle.loads(pickle.dumps(caught.value))
    assert copy.branch.table.equals(caught.value.branch.table)


def test_save_and_load(tmp_path):
    branch = follow(subcritical, -1.0, 1.0, on_fold="snap", outputs=X, report_at=[0.5])
    path = tmp_path / "branch.npz"
    branch.save(path)
    again = Branch.load(path, subcritical)
    assert again.table.equals(branch.table)
    assert again.events[1].energy_released == branch.events[1].energy_released
    assert again.events[1].after.state.x == pytest.approx(branch.events[1].after.state.x, abs=0)
    trivial = follow(subcritical, -1.0, 1.0)
    trivial.save(path)
    again = Branch.load(path, subcritical)
    one = again.switch(again.events[0]).table
    assert one.equals(trivial.switch(trivial.events[0]).table)


def test_a_damaged_file_or_another_family_is_refused(tmp_path):
    path = tmp_path / "branch.npz"
    follow(hysteresis, -1.0, 1.0, initial=VectorState([-1.3])).save(path)
    with pytest.raises(DataError, match="no equilibrium of the family"):
        Branch.load(path, subcritical)
    with pytest.raises(DataError, match="multipliers"):
        Branch.load(path, lambda p: Strip(0.9))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(DataError, match="damaged"):
        Branch.load(path, hysteresis)
    path.write_bytes(b"")
    with pytest.raises(DataError, match="damaged"):
        follow(hysteresis, -1.0, 1.0, checkpoint=path)


_SCRIPT = """
import sys, time
import numpy as np
from lissome import DenseStructure, follow
from lissome.structure import VectorState

def family(p):
    time.sleep({pause} if p < 0.5 else {stop})
    return DenseStructure([0.0], lambda x: x[0]**4 / 4 - x[0]**2 / 2 - p * x[0],
        lambda x: x**3 - x - p, lambda x: np.diag(3 * x**2 - 1), check=False)

branch = follow(family, -1.0, 1.0, report_at=[0.0, 0.9], initial=VectorState([-1.3]),
    max_step=0.05, outputs={{"x": lambda e: e.state.x[0]}}, checkpoint={path!r}, checkpoint_every=1e-3)
branch.table.to_csv({table!r}, index=False)
print(len(branch.events), branch.events[1].parameter)
"""


def test_a_killed_run_goes_on_from_its_checkpoint(tmp_path):
    whole = tmp_path / "whole.csv"
    script = _SCRIPT.format(pause=0, stop=0, path=str(tmp_path / "whole.npz"), table=str(whole))
    plain = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    checkpoint, table = tmp_path / "run.npz", tmp_path / "run.csv"
    slow = _SCRIPT.format(pause=0.002, stop=600, path=str(checkpoint), table=str(table))
    process = subprocess.Popen([sys.executable, "-c", slow])
    family = lambda p: hysteresis(p)  # noqa: E731
    deadline = time.monotonic() + 120
    rows = 0
    while rows < 20 and time.monotonic() < deadline:
        time.sleep(0.02)
        if checkpoint.exists():
            rows = len(Branch.load(checkpoint, family))
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not table.exists()
    part = Branch.load(checkpoint, family)
    assert len(part) >= 20
    assert not part.finished
    fast = _SCRIPT.format(pause=0, stop=0, path=str(checkpoint), table=str(table))
    resumed = subprocess.run(
        [sys.executable, "-c", fast], capture_output=True, text=True, check=True
    )
    assert resumed.stdout == plain.stdout
    a, b = (np.genfromtxt(f, delimiter=",", names=True, dtype=None, encoding="utf8")
            for f in (whole, table))  # fmt: skip
    assert len(a) == len(b) > len(part)
    for name in ("parameter", "energy", "arclength", "x"):
        assert a[name] == pytest.approx(b[name], abs=1e-9)
    assert np.array_equal(a["kind"], b["kind"])
    # A third call finds everything done.
    done = follow(
        family, -1.0, 1.0, report_at=[0.0, 0.9], initial=VectorState([-1.3]), max_step=0.05,
        outputs=X, checkpoint=checkpoint,
    )  # fmt: skip
    assert done.finished
    assert len(done) == len(a)


def test_a_checkpoint_of_another_call_is_refused(tmp_path):
    path = tmp_path / "run.npz"
    with pytest.raises(BranchInterrupted):
        follow(fold, 1.0, -1.0, max_steps=5, checkpoint=path)
    with pytest.raises(InvalidInput, match="stop"):
        follow(fold, 1.0, -2.0, checkpoint=path)
    with pytest.raises(DataError, match="no equilibrium of the family"):
        follow(lambda p: polynomial([1 - p, 1.0]), 1.0, -1.0, checkpoint=path)
    with pytest.raises(BranchInterrupted) as longer:
        follow(fold, 1.0, -1.0, max_steps=9, checkpoint=path)
    assert len(longer.value.branch) == 10


def test_a_checkpoint_of_another_beginning_is_refused(tmp_path):
    path = tmp_path / "run.npz"
    left, right = (ls.equilibrate(hysteresis(0.0, x)) for x in (-1.0, 1.0))
    options = {"start": 0.0, "stop": 0.3, "checkpoint": path}
    branch = follow(hysteresis, initial=left, **options)
    again = follow(hysteresis, initial=left, **options)
    assert unknown(again.equilibria[-1]) == unknown(branch.equilibria[-1]) < 0
    for other in (right, right.state, None):
        with pytest.raises(InvalidInput, match="initial"):
            follow(hysteresis, initial=other, **options)


# ---- bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": np.nan}, "start"),
        ({"stop": -1.0}, "nothing to follow"),
        ({"on_fold": "jump"}, "on_fold"),
        ({"report_at": [[0.0]]}, "report_at"),
        ({"report_at": [np.inf]}, "report_at"),
        ({"step": 0.0}, "step"),
        ({"max_step": -1}, "max_step"),
        ({"max_steps": 0}, "max_steps"),
        ({"sign": 2}, "sign"),
        ({"outputs": {"energy": unknown}}, "energy"),
        ({"outputs": {"x": 3}}, "outputs"),
        ({"outputs": {"x": lambda e: e.state.x}}, "must return a number"),
        ({"bounds": (0.0, 2.0)}, "bounds"),
        ({"scale": -1.0}, "scale"),
        ({"family": 3}, "family"),
        ({"initial": "near"}, "initial"),
    ],
)
def test_bad_arguments(arguments, message):
    values = {"family": pitchfork, "start": -1.0, "stop": 1.0, **arguments}
    if message == "initial":
        values["initial"] = ls.equilibrate(polynomial([0.0, 1.0, 0.0, 3.0]))
        values["family"] = lambda p: polynomial([p - 5, 1.0, 0.0, 1.0])
        values["initial"] = ls.equilibrate(polynomial([100.0, 1.0, 0.0, 1.0]))
    with pytest.raises(InvalidInput, match=message):
        follow(**values)


def test_switching_needs_a_bifurcation_of_the_same_branch():
    one = follow(fold, 1.0, -1.0, on_fold="stop")
    with pytest.raises(InvalidInput, match="bifurcation"):
        one.switch(one.events[0])
    a, b = follow(pitchfork, -1.0, 1.0), follow(pitchfork, -1.0, 1.0)
    with pytest.raises(InvalidInput, match="same branch"):
        a.switch(b.events[0])
    with pytest.raises(InvalidInput, match="sign"):
        a.switch(a.events[0], 0)
    with pytest.raises(InvalidInput, match="mode"):
        a.switch(a.events[0], mode=1)
    with pytest.raises(InvalidInput, match="unknown options"):
        a.switch(a.events[0], stopp=1)


def test_a_structure_whose_constraints_leave_nothing_free_is_followed():
    """A softening spring that is held: its force, the multiplier, falls beyond the limit point."""

    def held(length):
        return DenseStructure(
            initial=[0.5],
            energy=lambda x: x[0] ** 2 / 2 - x[0] ** 3 / 6,
            gradient=lambda x: x - x**2 / 2,
            hessian=lambda x: [[1 - x[0]]],
            constraints=lambda x: [length - x[0]],
            jacobian=lambda x: [[-1.0]],
        )

    branch = follow(held, 0.5, 1.5, outputs={"force": lambda e: e.multipliers[0]})

    length = branch.table.parameter
    np.testing.assert_allclose(branch.table.force, length - length**2 / 2, rtol=0, atol=1e-12)
    assert branch.table.stable.all()
    assert not branch.events
    assert branch.table.smallest_eigenvalue.isna().all()


def test_a_branch_turns_where_it_crosses_another_one_at_a_pitchfork():
    # From x = 1 to its mirror image x = -1, both stable: at p = 0 the parameter turns, the index not.
    branch = follow(pitchfork, 1.0, -1.0, initial=VectorState([1.0]), bounds=(None, 1.0), outputs=X)
    turn = branch.events[0]
    assert (turn.kind, turn.index_before, turn.index_after) == ("fold", 0, 0)
    assert abs(turn.parameter) <= turn.uncertainty < 1e-8
    assert kinds(branch) == ["fold", "end"]
    assert branch.table.x.iloc[-1] == pytest.approx(-1.0, abs=1e-9)
    off = branch.table[branch.table.x.abs() > 1e-3]
    assert off.parameter.to_numpy() == pytest.approx((off.x**2).to_numpy(), abs=1e-9)


@pytest.mark.parametrize(("cubic", "quartic"), [(0.0, 3.0), (0.3, 0.5), (-0.55, 0.5)])
def test_a_branch_that_turns_aslant_turns_at_the_crossing(cubic, quartic):
    """p = x^2 + a x^3 + b x^4 crosses x = 0 at p = 0; neither parabola nor cubic, so it is searched."""

    def family(p):
        return polynomial([0, -p, 0, 1, cubic, quartic])

    top = 1.0 + cubic + quartic
    for max_step in (0.2, 0.4):
        branch = follow(family, top, -1.0, initial=VectorState([1.0]), bounds=(None, top),
                        max_step=max_step)  # fmt: skip
        assert kinds(branch) == ["fold", "end"]
        turn = branch.events[0]
        assert abs(turn.parameter) <= turn.uncertainty < 1e-8


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    cubic=st.floats(-0.6, 0.6),
    quartic=st.sampled_from([0.0, 0.3, 0.8]),
    begin=st.floats(0.3, 1.0),
    stop=st.floats(-2.0, -0.2),
)
@example(cubic=-0.3, quartic=0.0, begin=1.0, stop=-1.0)
@example(cubic=-0.37041, quartic=0.0, begin=1.08888, stop=-0.44969)
@example(cubic=0.3645, quartic=0.0, begin=0.39, stop=-0.21)
def test_long_steps_do_not_leave_a_branch_where_it_turns_on_another_one(
    cubic, quartic, begin, stop
):
    """p = x^2 + a x^3 + b x^4 turns on x = 0, where a step that is long may end beyond the turn."""
    branch_of = np.polynomial.Polynomial([0.0, 0.0, 1.0, cubic, quartic])
    assume(np.all(branch_of.deriv()(np.linspace(1e-3, begin, 50)) > 0.0))  # no fold before
    top = branch_of(begin)

    def family(p):
        return polynomial([0, -p, 0, 1, cubic, quartic])

    branch = follow(family, top, stop, initial=VectorState([begin]), bounds=(None, top),
                    outputs=X, max_step=1.0)  # fmt: skip
    table = branch.table
    off = table.parameter - branch_of(table.x.to_numpy())
    assert off.abs().max() < 1e-8
    assert branch.events[0].kind == "fold"
    assert abs(branch.events[0].parameter) < 1e-6


def test_brackets_are_as_short_as_asked_for():
    wide = follow(pitchfork, -1.0, 2.0, event_tolerance=1e-3).events[0]
    narrow = follow(pitchfork, -1.0, 2.0).events[0]
    assert abs(wide.parameter) <= wide.uncertainty <= 3e-3
    assert abs(narrow.parameter) <= narrow.uncertainty <= 1e-7


def test_accuracy_does_not_depend_on_where_corrections_end():
    # Each state is x = sqrt(p), whether its last correction was found small or foretold to be.
    branch = follow(pitchfork, 0.05, 2.0, initial=VectorState([1.0]), outputs=X)
    table = branch.table
    assert table.x.to_numpy() == pytest.approx(np.sqrt(table.parameter.to_numpy()), abs=1e-12)
    assert max(e.history[-1].correction for e in branch.equilibria) <= 1e-6


def test_energy_released_where_the_parameter_moves_a_support():
    """Of x^4/4 - x^2/2 + k (y - x)^2/2 with y = p: fold at x^2 = (1 - k)/3, beyond it the root -2x."""
    k = 0.5

    def pulled(p):
        return DenseStructure(
            initial=[-1.0, p],
            energy=lambda z: z[0] ** 4 / 4 - z[0] ** 2 / 2 + k * (z[1] - z[0]) ** 2 / 2,
            gradient=lambda z: np.array([z[0] ** 3 - z[0] - k * (z[1] - z[0]), k * (z[1] - z[0])]),
            hessian=lambda z: np.array([[3 * z[0] ** 2 - 1 + k, -k], [-k, k]]),
            constraints=lambda z: np.array([z[1] - p]),
            jacobian=lambda z: np.array([[0.0, 1.0]]),
        )

    x = -np.sqrt((1 - k) / 3)
    p = x + (x**3 - x) / k
    total = lambda z: z**4 / 4 - z**2 / 2 + k * (p - z) ** 2 / 2  # noqa: E731
    for overshoot in (1e-2, 1e-3):
        found = follow(pulled, -1.0, 2.0, on_fold="snap", overshoot=overshoot)
        (snap,) = [event for event in found.events if event.kind == "snap"]
        beyond = found.table.parameter[snap.after_row] - p
        assert beyond > 0.5 * overshoot
        # The forces of the two states differ by k times the difference of x.
        exact = total(x) - total(-2 * x) - 3 * k * x * beyond
        assert snap.energy_released == pytest.approx(exact, abs=3 * beyond**2)


def test_a_trial_beyond_what_a_structure_can_be_is_a_step_that_failed():
    """Supports farther apart than the rod is long: found out when a state is taken over, not before."""
    rod = ls.rods.straight(1.0, 20, ls.rods.Kirchhoff((1.0, 1.0), 1.0)).clamped("start")
    family = lambda p: rod.clamped("end", (0.0, 0.0, p))  # noqa: E731
    bent = ls.equilibrate(family(0.7)).state
    structure, state = adopted(family, 0.8, bent)
    assert structure.positions(state)[-1, 2] != 0.8  # constraints are for the solver
    with pytest.raises(
        CorrectionFailed, match=r"no structure at 1\.2: the supports of nodes 0 and 20"
    ):
        adopted(family, 1.2, bent)
