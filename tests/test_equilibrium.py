"""Equilibria of structures with known answers; saddles, critical points and bad input."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from models import (
    BALLOON_PEAK,
    HYSTERESIS_FOLD,
    Column,
    HangingChain,
    Ring,
    Strip,
    Truss,
    balloon_pressure,
    balloon_under_pressure,
    balloons_sharing,
    barrier,
    column_tip_angle,
    fold,
    hysteresis,
    pitchfork,
    strip_exact,
)

from lissome import DenseStructure, Equilibrium, equilibrate
from lissome.equilibrium import relative_residual
from lissome.errors import (
    InvalidInput,
    LissomeError,
    NotConverged,
    StabilityNotResolvable,
)
from lissome.structure import BaseStructure, Corrected, Evaluation, VectorState

# ---- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("p", [0.01, 1.0, 30.0])
def test_pitchfork_leaves_the_saddle_by_itself(p):
    found = equilibrate(pitchfork(p))
    assert found.stable
    assert abs(found.state.x[0]) == pytest.approx(np.sqrt(p), rel=1e-12)
    assert any(line.kind == "curvature" for line in found.history)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("start", [0.2, 0.01, 1e-4])
def test_a_start_beside_a_saddle_falls_to_its_own_side(start, side):
    """-2e-6 x^2/2 - x^4/4 + x^6/6: nearly flat at the top, with minima close to 1 and -1."""
    hill = DenseStructure(
        initial=[side * start],
        energy=lambda x: -1e-6 * x[0] ** 2 - x[0] ** 4 / 4 + x[0] ** 6 / 6,
        gradient=lambda x: -2e-6 * x - x**3 + x**5,
        hessian=lambda x: np.diag(-2e-6 - 3 * x**2 + 5 * x**4),
    )
    exact = np.sqrt(0.5 + np.sqrt(0.25 + 2e-6))
    assert equilibrate(hill).state.x[0] == pytest.approx(side * exact, rel=1e-12)


def test_pitchfork_saddle_on_request():
    found = equilibrate(pitchfork(1.0), require="any")
    assert (found.state.x[0], found.index, found.stable) == (0.0, 1, False)


def test_fold():
    assert equilibrate(fold(0.49)).state.x[0] == pytest.approx(0.7, rel=1e-13)
    other = equilibrate(fold(0.49, start=-0.6), require="any")
    assert other.state.x[0] == pytest.approx(-0.7, rel=1e-13)
    assert other.index == 1
    with pytest.raises(NotConverged, match="no minimum") as caught:
        equilibrate(fold(-0.49))
    assert len(caught.value.history) > 0
    assert isinstance(caught.value.state, VectorState)


@settings(max_examples=40, deadline=None)
@given(load=st.floats(-5, 5), start=st.floats(-50, 50))
def test_hysteresis_ends_in_a_minimum_from_anywhere(load, start):
    assume(abs(abs(load) - HYSTERESIS_FOLD) > 1e-6)
    x = equilibrate(hysteresis(load, start)).state.x[0]
    assert x**3 - x == pytest.approx(load, rel=1e-9, abs=1e-9)
    assert 3 * x**2 > 1


def test_von_mises_truss_up_to_and_beyond_its_limit_load():
    truss = Truss(height=0.5)
    limit = truss.limit_load()
    for part in (0.0, 0.5, 0.99, 1 - 1e-8):
        found = equilibrate(truss.under(part * limit))
        # Near the limit load the height is as uncertain as the square root of round-off.
        assert found.state.x[0] == pytest.approx(truss.height_at(part * limit), rel=1e-8)
    for part in (1 + 1e-6, 1.01, 3.0, 30.0):
        found = equilibrate(truss.under(part * limit))
        assert found.stable
        assert found.state.x[0] == pytest.approx(truss.inverted_height_at(part * limit), rel=1e-12)


def test_tall_truss_sways_before_its_limit_load():
    truss = Truss(height=3.0, sway=True)
    sway = truss.sway_height()
    load = 2 * sway * (truss.rest / np.hypot(1, sway) - 1)
    assert load < truss.limit_load()
    upright = equilibrate(truss.under(0.99 * load))
    assert upright.state.x[0] == pytest.approx(0.0, abs=1e-12)
    beyond = truss.under(1.01 * load)
    symmetric = equilibrate(beyond, require="any")
    assert symmetric.index == 1
    assert symmetric.mode() == pytest.approx([1.0, 0.0], abs=1e-9)
    fallen = equilibrate(beyond)
    assert fallen.stable
    assert fallen.energy < symmetric.energy


def test_balloon_below_its_greatest_pressure():
    pressure = 0.9 * balloon_pressure(BALLOON_PEAK)
    s = equilibrate(balloon_under_pressure(pressure)).state.x[0]
    assert balloon_pressure(s) == pytest.approx(pressure, rel=1e-12)
    assert 1 < s < BALLOON_PEAK
    with pytest.raises(NotConverged):
        equilibrate(balloon_under_pressure(1.01 * balloon_pressure(BALLOON_PEAK)))


@pytest.mark.parametrize("s", [1.1, 1.37, 1.39, 2.0])
def test_connected_balloons_become_unequal_beyond_the_pressure_peak(s):
    """Only the curvature of the volume constraint makes the difference."""
    found = equilibrate(balloons_sharing(2 * s**3))
    equal = found.state.x[0] == pytest.approx(found.state.x[1], rel=1e-9)
    assert equal == (s < BALLOON_PEAK)
    assert balloon_pressure(found.state.x) == pytest.approx(-found.multipliers[0] * np.ones(2))
    both = equilibrate(balloons_sharing(2 * s**3), require="any")
    assert both.index == (0 if s < BALLOON_PEAK else 1)


@settings(max_examples=25, deadline=None)
@given(
    force=st.floats(-1e4, 1e4).filter(lambda f: abs(f) > 1e-3),
    start=st.floats(-0.99, 0.99),
    guarded=st.booleans(),
)
def test_barrier(force, start, guarded):
    found = equilibrate(barrier(force, start, guarded))
    exact = force / (np.sqrt(1 + force**2) + 1)
    assert found.state.x[0] == pytest.approx(exact, rel=1e-9)


# ---- elastica -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["dense", "chain"])
def test_straight_column_buckles_by_itself(kind):
    n = 40
    critical = 4 * n**2 * np.sin(np.pi / (4 * n)) ** 2  # of the discrete column, exactly
    below = equilibrate(Column(0.999 * critical, n, kind=kind))
    assert np.all(below.state.x == 0.0)
    above = Column(1.001 * critical, n, kind=kind)
    straight = equilibrate(above, require="any")
    assert (straight.index, straight.stable) == (1, False)
    buckled = equilibrate(above)
    assert buckled.stable
    assert buckled.energy < straight.energy
    second = equilibrate(Column(9.5 * critical, n, kind=kind), require="any")
    assert second.index == 2


@pytest.mark.parametrize("load", [3.0, 10.0, 60.0])
def test_column_converges_to_the_elliptic_integral_with_second_order(load):
    exact = column_tip_angle(load)
    errors = np.array(
        [abs(equilibrate(Column(load, n)).state.x[-1]) - exact for n in (40, 80, 160, 320)]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(np.abs(orders - 2) < 0.05)
    # One step of Richardson's extrapolation leaves the fourth order.
    assert abs((4 * errors[3] - errors[2]) / 3) < 2e-2 * abs(errors[3])


@pytest.mark.parametrize("span", [0.95, 0.6, 0.2])
def test_strip_converges_to_the_elliptic_integral_with_second_order(span):
    compression, slope = strip_exact(span)
    errors = []
    for n in (40, 80, 160, 320):
        found = equilibrate(Strip(span, n))
        errors.append((found.multipliers[0] - compression, found.state.x[n // 4 - 1] - slope))
        assert abs(found.multipliers[1]) < 1e-9 * compression
    orders = np.log2(np.abs(np.array(errors[:-1]) / np.array(errors[1:])))
    assert np.all(np.abs(orders - 2) < 0.1)


def test_strip_leaves_the_second_mode():
    second = Strip(0.7, mode=2)
    saddle = equilibrate(second, require="any")
    assert saddle.index == 2
    found = equilibrate(second)
    assert found.stable
    assert found.energy == pytest.approx(equilibrate(Strip(0.7)).energy, rel=1e-12)


@pytest.mark.parametrize("kind", ["dense", "chain"])
def test_convergence_is_quadratic_at_the_end(kind):
    found = equilibrate(Strip(0.7, amplitude=0.9, kind=kind))
    sizes = [line.correction for line in found.history if line.kind != "curvature"]
    last = [s for s in sizes if s < 0.1]
    assert len(last) >= 3
    for a, b in itertools.pairwise(last):
        assert b < 10 * a**2 + 1e-14


def test_closed_ring_with_a_neutral_rotation():
    found = equilibrate(Ring(48, disturbance=0.5))
    assert found.stable
    assert found.inertia == (48, 3, 0)
    turn = np.diff(found.state.x)
    assert np.max(np.abs(turn)) < 1e-10  # a regular polygon, turned by any angle
    assert found.energy == pytest.approx(2 * np.pi**2, rel=1e-12)


def test_without_its_gauge_the_ring_is_not_resolvable():
    class Loose(Ring):
        def gauge(self, state):
            return np.zeros((0, self.size))

    with pytest.raises(StabilityNotResolvable, match="gauge"):
        equilibrate(Loose(24, disturbance=0.1))


@pytest.mark.parametrize("span", [0.3, 0.7, 0.99])
@pytest.mark.parametrize("free", [9, 100])
def test_hanging_chain(span, free):
    chain = HangingChain(span, free)
    found = equilibrate(chain)
    np.testing.assert_allclose(found.state.x[1::2], chain.exact(), atol=1e-10)
    assert np.max(np.abs(found.evaluation.constraints)) < 1e-14


@pytest.mark.parametrize("seed", range(8))
def test_hanging_chain_from_a_heap(seed):
    """Random nodes: links up to twenty times too long."""
    chain = HangingChain(0.5, 30)
    heap = VectorState(np.random.default_rng(seed).standard_normal(chain.size))
    found = equilibrate(chain, heap)
    np.testing.assert_allclose(found.state.x[1::2], chain.exact(), atol=1e-10)


# ---- criteria -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "critical",
    [
        pitchfork(0.0),
        pitchfork(0.0, start=0.4),
        fold(0.0, start=0.5),
        hysteresis(HYSTERESIS_FOLD, start=-0.8),
        hysteresis(HYSTERESIS_FOLD, start=-(3**-0.5) - 1e-9),
        Column(4 * 40**2 * np.sin(np.pi / 160) ** 2),
        balloons_sharing(2 * BALLOON_PEAK**3),
    ],
    ids=["pitchfork", "quartic", "fold", "hysteresis", "warm", "column", "balloons"],
)
def test_critical_points_have_no_verdict(critical):
    for require in ("stable", "any"):
        found = None
        try:
            found = equilibrate(critical, require=require)
        except StabilityNotResolvable as error:
            state = error.state
        if found is None:
            assert state is not None
        else:  # from afar a minimizer may pass by and end in another, regular, minimum
            assert require == "stable"
            assert found.smallest_eigenvalue() > 0.1


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6, 1e12])
def test_units_of_energy_do_not_matter(unit):
    reference = Strip(0.6)

    class Scaled(Strip):
        def evaluate(self, state, multipliers, order=2):
            from lissome.factorization import TridiagonalKKT

            e = super().evaluate(state, multipliers / unit, 2)
            kkt = TridiagonalKKT(e.kkt.band[:, 0] * unit, e.kkt.band[:-1, 1] * unit, e.kkt.border.T)
            return Evaluation(e.energy * unit, e.constraints, e.gradient * unit, kkt)

    a, b = equilibrate(reference), equilibrate(Scaled(0.6))
    assert b.iterations == a.iterations
    np.testing.assert_allclose(b.state.x, a.state.x, atol=1e-12)
    np.testing.assert_allclose(b.multipliers[0] / unit, a.multipliers[0], rtol=1e-10)


def test_a_long_chain_reaches_its_round_off_floor():
    found = equilibrate(Strip(0.7, segments=10_000))
    assert found.stable
    assert found.iterations <= 10
    assert found.residual < 1e-14
    assert found.multipliers[0] == pytest.approx(strip_exact(0.7)[0], rel=1e-7)


def test_warm_start_uses_state_and_multipliers():
    first = equilibrate(Strip(0.7))
    again = equilibrate(Strip(0.7), first.state, first.multipliers)
    assert again.iterations == 0
    near = equilibrate(Strip(0.699), first.state, first.multipliers)
    assert near.iterations <= 4


def test_an_equilibrium_is_a_warm_start():
    first = equilibrate(Strip(0.7))
    assert equilibrate(Strip(0.7), first).iterations == 0
    near = equilibrate(Strip(0.699), first)
    cold = equilibrate(Strip(0.699))
    np.testing.assert_allclose(near.state.x, cold.state.x, atol=1e-12)
    assert near.iterations < cold.iterations
    free = equilibrate(Column(1.0, 39), first)  # of another structure: only its state fits
    assert abs(free.state.x).max() < 1e-12


def test_the_start_is_adopted():
    class Moved(Strip):
        def adopt(self, state):
            return VectorState(0.5 * state.x)

    seen = []
    structure = Moved(0.7)
    original = structure.evaluate

    class Spy(Moved):
        def evaluate(self, state, multipliers, order=2):
            seen.append(state.x.copy())
            return original(state, multipliers, order)

    equilibrate(Spy(0.7), VectorState(np.full(39, 0.25)))
    np.testing.assert_array_equal(seen[0], np.full(39, 0.125))


def test_local_corrector_is_used_and_checked():
    calls = []

    class Quick(Column):
        def correct(self, state, multipliers, tolerance):
            calls.append(tolerance)
            return Corrected(VectorState(np.zeros(self.size)), multipliers)

    stable = equilibrate(Quick(1.0, tip_angle=0.3))
    assert calls == [1e-9]
    assert stable.history[0].kind == "fast"
    buckled = equilibrate(Quick(4.0, tip_angle=0.3))  # its answer is a saddle: refused
    assert abs(buckled.state.x[-1]) > 0.5
    assert equilibrate(Quick(4.0, tip_angle=0.3), require="any").index == 1


def newton_corrector(cls):
    """Return a class of structures with a corrector that hands over evaluation and factors.

    The orders of the evaluations that others ask for are listed in ``orders``.
    """
    orders = []

    class Quick(cls):
        def evaluate(self, state, multipliers, order=2):
            orders.append(order)
            return super().evaluate(state, multipliers, order)

        def correct(self, state, multipliers, tolerance):
            for number in range(20):
                evaluation = super().evaluate(state, multipliers, 2)
                factors = evaluation.kkt.factorize()
                dx, dm = factors.solve(-evaluation.gradient, -evaluation.constraints)
                if np.abs(dx).max() <= tolerance:
                    return Corrected(state, multipliers, evaluation, factors, number)
                state, multipliers = VectorState(state.x + dx), multipliers + dm
            return None

    Quick.orders = orders
    return Quick


def test_a_corrector_hands_over_what_it_has_made():
    reference = equilibrate(Strip(0.7))
    quick = newton_corrector(Strip)
    near = VectorState(reference.state.x + 1e-3)
    found = equilibrate(quick(0.7), near, reference.multipliers)
    assert found.history[0].kind == "fast"
    assert found.iterations == 1
    np.testing.assert_allclose(found.state.x, reference.state.x, atol=1e-13)
    # One matrix at most, for how the softest eigenvalue moves.
    assert quick.orders.count(2) <= 1
    assert np.abs(found.evaluation.gradient).max() < 1e-11


def test_a_corrector_at_a_saddle_is_not_believed():
    buckled = newton_corrector(Column)(4.0)
    found = equilibrate(buckled, VectorState(np.full(40, 1e-6)))  # Newton's method goes to zero
    assert found.stable
    assert abs(found.state.x[-1]) == pytest.approx(column_tip_angle(4.0), rel=1e-2)
    assert all(line.kind != "fast" for line in found.history)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 0.95), st.integers(8, 60), st.floats(-0.4, 0.4))
def test_with_and_without_a_corrector_the_same_shape_is_found(span, segments, disturbance):
    plain, quick = Strip(span, segments), newton_corrector(Strip)(span, segments)
    start = VectorState(plain.start().x + disturbance * np.cos(np.arange(segments - 1)))
    for structure in (plain, quick):
        found = equilibrate(structure, start)
        assert found.stable
        assert found.residual < 1e-12
        balance = structure.evaluate(found.state, found.multipliers, 1)
        assert np.abs(balance.constraints).max() < 1e-13
        assert np.abs(balance.gradient).max() < 1e-9


def test_present_makes_the_structures_own_result():
    class Shape(Equilibrium):
        @property
        def tip(self):
            return self.state.x[-1]

    class Shown(Column):
        def present(self, equilibrium):
            return equilibrium.as_type(Shape)

    found = equilibrate(Shown(3.0))
    assert isinstance(found, Shape)
    assert abs(found.tip) == pytest.approx(column_tip_angle(3.0), rel=1e-3)
    assert found.smallest_eigenvalue() > 0


def test_history_is_reported_as_it_grows():
    seen = []
    found = equilibrate(Strip(0.7), on_iteration=seen.append)
    assert tuple(seen) == found.history
    assert [line.number for line in seen] == list(range(len(seen)))
    assert found.iterations == len(seen) - 1


def test_a_result_is_frozen():
    found = equilibrate(Strip(0.7))
    with pytest.raises(AttributeError):
        found.energy = 0.0
    with pytest.raises(ValueError):
        found.multipliers[0] = 1.0
    with pytest.raises(ValueError):
        found.state.x[0] = 1.0


def test_no_iterations_left():
    with pytest.raises(NotConverged, match="2 iterations") as caught:
        equilibrate(Strip(0.3, amplitude=0.1), max_iterations=2)
    assert len(caught.value.history) == 2


# ---- bad input ------------------------------------------------------------------------------------


def quadratic(**changes):
    parts = {
        "initial": [1.0, 2.0],
        "energy": lambda x: x @ x / 2,
        "gradient": lambda x: x,
        "hessian": lambda x: np.eye(2),
    } | changes
    return DenseStructure(**parts)


def test_energy_that_is_not_finite_at_the_start():
    bad = quadratic(energy=lambda x: np.nan, check=False)
    with pytest.raises(InvalidInput, match="not finite at the starting state"):
        equilibrate(bad)


def test_energy_that_is_not_finite_further_on_is_avoided():
    """The full Newton step leaves the domain: it is shortened."""
    log = DenseStructure(
        initial=[3.9],
        energy=lambda x: x[0] - 2 * np.log(x[0]) if x[0] > 0 else np.nan,
        gradient=lambda x: 1 - 2 / x,
        hessian=lambda x: np.diag(2 / x**2),
    )
    assert equilibrate(log, VectorState([30.0])).state.x[0] == pytest.approx(2.0)


def test_hessian_that_is_not_finite_is_reported():
    bad = quadratic(hessian=lambda x: np.full((2, 2), np.nan), check=False)
    with pytest.raises(LissomeError, match="Hessian"):
        equilibrate(bad)


def test_a_residual_that_is_not_a_number_is_not_small():
    terms = np.ones(2), np.ones(1)
    for place in range(2):
        gradient = np.zeros(2)
        gradient[place] = np.nan
        assert np.isnan(relative_residual(gradient, np.ones(1), terms))
    assert np.isnan(relative_residual(np.zeros(2), np.array([np.nan]), terms))
    assert relative_residual(np.array([0.0, 1e-3]), np.zeros(1), terms) == pytest.approx(
        1e-3, rel=2e-3
    )


@pytest.mark.parametrize("require", ["stable", "any"])
def test_a_state_that_is_right_needs_other_multipliers(require):
    """A load on what a constraint holds: nothing moves, and the reaction is its opposite."""

    def held(force):
        return DenseStructure(
            initial=[0.0, 0.0],
            energy=lambda x: 0.5 * float(x @ x) - force * x[0],
            gradient=lambda x: x - np.array([force, 0.0]),
            hessian=lambda x: np.eye(2),
            constraints=lambda x: x[:1],
            jacobian=lambda x: np.array([[1.0, 0.0]]),
        )

    found = equilibrate(held(5.0), equilibrate(held(0.0)), require=require)
    assert found.state.x.tolist() == [0.0, 0.0]
    assert found.multipliers == pytest.approx([5.0])


def test_redundant_constraints_are_named():
    twice = quadratic(
        constraints=lambda x: [x[0] + x[1] - 1, x[0] - 3, 2 * x[0] + 2 * x[1] - 2],
        jacobian=lambda x: [[1.0, 1.0], [1.0, 0.0], [2.0, 2.0]],
        constraint_names=("sum", "first", "sum again"),
    )
    with pytest.raises(InvalidInput, match=r"constraint 2 \(sum again\)"):
        equilibrate(twice)


def test_a_straight_strip_cannot_be_shortened():
    """Its closure constraints are singular: said, with a remedy."""
    with pytest.raises(LissomeError, match="distance"):
        equilibrate(Strip(0.9, amplitude=0.0))


def test_wrong_gradient_does_not_pass_silently():
    wrong = quadratic(gradient=lambda x: 0.1 - x, hessian=lambda x: np.eye(2), check=False)
    with pytest.raises(NotConverged, match="gradient"):
        equilibrate(wrong)


def test_max_step_outside_its_range():
    class Backward(BaseStructure):
        size = 1

        def start(self):
            return VectorState([1.0])

        def evaluate(self, state, multipliers, order=2):
            from lissome.factorization import DenseKKT

            return Evaluation(0.5 * state.x[0] ** 2, np.zeros(0), state.x, DenseKKT([[1.0]]))

        def max_step(self, state, dx):
            return -1.0

    with pytest.raises(InvalidInput, match="max_step"):
        equilibrate(Backward())


def test_arguments_are_checked():
    with pytest.raises(InvalidInput, match="require"):
        equilibrate(fold(1.0), require="maximum")
    with pytest.raises(InvalidInput, match="tolerance"):
        equilibrate(fold(1.0), tolerance=0.0)
    with pytest.raises(InvalidInput, match="max_iterations"):
        equilibrate(fold(1.0), max_iterations=0)
    with pytest.raises(InvalidInput, match="max_iterations"):
        equilibrate(fold(1.0), max_iterations=2.7)
    with pytest.raises(InvalidInput, match="multipliers"):
        equilibrate(Strip(0.7), multipliers=[1.0])
    with pytest.raises(InvalidInput, match="unknowns"):
        equilibrate(fold(1.0), VectorState([1.0, 2.0]))


# ---- never unbalanced, never unstable -------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 7), m=st.integers(0, 2))
def test_random_landscapes(seed, n, m):
    """Quartic energies with many saddles under a curved and a linear constraint."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((n, n))
    a = 3 * (a + a.T)
    b = rng.standard_normal(n)
    direction = rng.standard_normal(n)
    curved = m >= 1

    def constraints(x):
        return np.array([x @ x / 2 - 2.0, direction @ x])[:m]

    structure = DenseStructure(
        initial=rng.standard_normal(n),
        energy=lambda x: np.sum(x**4) / 4 - x @ a @ x / 2 + b @ x,
        gradient=lambda x: x**3 - a @ x + b,
        hessian=lambda x: np.diag(3 * x**2) - a,
        constraints=constraints if m else None,
        jacobian=(lambda x: np.array([x, direction])[:m]) if m else None,
        constraint_hessian=(lambda x, mult: mult[0] * np.eye(n)) if curved else None,
    )
    if n - m < 1:
        return
    found = equilibrate(structure)
    x = found.state.x
    jacobian = np.array([x, direction])[:m]
    gradient = x**3 - a @ x + b + jacobian.T @ found.multipliers
    assert np.max(np.abs(gradient)) < 1e-9
    assert np.max(np.abs(constraints(x)), initial=0.0) < 1e-10
    hessian = np.diag(3 * x**2) - a + (found.multipliers[0] * np.eye(n) if curved else 0)
    if m:
        tangent = np.linalg.svd(jacobian)[2][m:]
        hessian = tangent @ hessian @ tangent.T
    lowest = np.linalg.eigvalsh(hessian)[0]
    assert lowest > 0
    assert found.smallest_eigenvalue() == pytest.approx(lowest, rel=1e-8)
