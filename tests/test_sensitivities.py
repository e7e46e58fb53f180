"""Derivatives of equilibria: direct against adjoint, closed forms, and solving again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from models import (
    Column,
    HangingChain,
    Strip,
    Truss,
    balloon_pressure,
    balloons_sharing,
    column_tip_angle,
    fold,
    pitchfork,
)

from lissome import Output, equilibrate, sensitivity
from lissome.errors import FactorizationError, InvalidInput
from lissome.factorization import DenseKKT
from lissome.structure import BaseStructure, DenseStructure, Evaluation, VectorState


def fourth_order(function, h):
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)


def test_closed_form_of_the_pitchfork():
    found = equilibrate(pitchfork(2.0))
    result = sensitivity(pitchfork, 2.0, found, {"x": lambda state, mult, p: state.x[0]})
    slope = np.sign(found.state.x[0]) / (2 * np.sqrt(2.0))
    assert result.state == pytest.approx([slope], rel=1e-11)
    assert result.outputs["x"] == pytest.approx(slope, rel=1e-11)
    assert result.parameter == 2.0


def test_truss_height_follows_the_stiffness():
    truss = Truss(0.5)
    load = 0.7 * truss.limit_load()
    found = equilibrate(truss.under(load))
    y = found.state.x[0]
    stiffness = 2 * (truss.rest / np.hypot(1, y) ** 3 - 1)  # d(load)/dy
    result = sensitivity(truss.under, load, found)
    assert result.state[0] == pytest.approx(1 / stiffness, rel=1e-9)


def test_pressure_of_a_balloon_is_its_multiplier():
    """dp/dV of one balloon with given volume, from the curve p(s)."""
    s = 1.2
    found = equilibrate(balloons_sharing(s**3, count=1))
    result = sensitivity(lambda v: balloons_sharing(v, count=1), s**3, found)
    slope = 4 / 3 * (-1 / s**2 + 7 / s**8) / (3 * s**2)
    assert result.multipliers == pytest.approx([-slope], rel=1e-9)
    assert -found.multipliers[0] == pytest.approx(balloon_pressure(s))


OUTPUTS = {
    "tip": Output(
        lambda state, mult, p: np.sum(np.sin(state.x) ** 2),
        lambda state, mult, p: np.sin(2 * state.x),
        lambda state, mult, p: np.zeros_like(mult),
        lambda state, mult, p: np.zeros(np.shape(p)),
    ),
    "work": Output(
        lambda state, mult, p: np.sum(mult * np.ravel(p)[0]) + state.x[3] ** 2,
        lambda state, mult, p: 2 * state.x[3] * (np.arange(state.x.size) == 3),
        lambda state, mult, p: np.full_like(mult, np.ravel(p)[0]),
        lambda state, mult, p: (
            np.sum(mult) if np.ndim(p) == 0 else np.sum(mult) * (np.arange(len(p)) == 0)
        ),
    ),
}
PLAIN = {name: output.function for name, output in OUTPUTS.items()}

FAMILIES = {
    "column": (lambda p: Column(p, 30), 4.0),
    "dense column": (lambda p: Column(p, 30, kind="dense"), 4.0),
    "strip": (lambda p: Strip(p, 40), 0.7),
    "chain": (lambda p: HangingChain(p, 12), 0.6),
    "column of two": (lambda p: Column(p[0], 30, tilt=p[1]), np.array([4.0, 0.3])),
    "saddle": (lambda p: Strip(p, 40, mode=2), 0.7),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_direct_equals_adjoint_and_both_equal_solving_again(name):
    family, parameter = FAMILIES[name]
    require = "any" if name == "saddle" else "stable"
    found = equilibrate(family(parameter), require=require)
    assert (found.index > 0) == (name == "saddle")
    direct = sensitivity(family, parameter, found, OUTPUTS)
    adjoint = sensitivity(family, parameter, found, OUTPUTS, "adjoint")
    assert adjoint.state is None
    k = np.size(parameter)
    for i in range(k):
        unit = np.eye(k)[i] if np.ndim(parameter) else 1.0

        def solved(h, unit=unit):
            p = parameter + h * unit
            return equilibrate(
                family(p), found.state, found.multipliers, require=require, tolerance=1e-12
            )

        def value(output, h, unit=unit):
            again = solved(h)
            return output.function(again.state, again.multipliers, parameter + h * unit)

        exact = fourth_order(lambda h: solved(h).state.x, 1e-3)
        mine = direct.state if k == 1 else direct.state[:, i]
        np.testing.assert_allclose(mine, exact, atol=2e-7 * np.abs(exact).max())
        for key, output in OUTPUTS.items():
            a = np.ravel(direct.outputs[key])[i]
            b = np.ravel(adjoint.outputs[key])[i]
            assert a == pytest.approx(b, rel=1e-10, abs=1e-12)
            again = fourth_order(lambda h, o=output: value(o, h), 1e-3)
            assert a == pytest.approx(again, rel=2e-6, abs=1e-9)


@pytest.mark.parametrize("mode", ["direct", "adjoint"])
def test_outputs_without_gradients(mode):
    family, parameter = FAMILIES["strip"]
    found = equilibrate(family(parameter))
    with_gradients = sensitivity(family, parameter, found, OUTPUTS, mode)
    without = sensitivity(family, parameter, found, PLAIN, mode)
    for name, value in with_gradients.outputs.items():
        assert without.outputs[name] == pytest.approx(value, rel=1e-8)


def test_the_energy_of_a_strip_falls_by_force_times_distance():
    """Envelope theorem: the derivative of the energy by the span is minus the multiplier."""
    found = equilibrate(Strip(0.7, 40))

    def energy(state, multipliers, span):
        return Strip(span, 40).evaluate(state, multipliers, 0).energy

    for mode in ("direct", "adjoint"):
        result = sensitivity(lambda s: Strip(s, 40), 0.7, found, {"energy": energy}, mode)
        assert result.outputs["energy"] == pytest.approx(-found.multipliers[0], rel=1e-9)


def test_the_slope_of_the_elliptic_integral():
    """d(tip angle)/d(load) of the column, extrapolated, against the closed form."""
    exact = fourth_order(lambda h: column_tip_angle(4.0 + h), 1e-3)
    slopes = []
    for n in (80, 160):
        found = equilibrate(Column(4.0, n, tip_angle=1.5))
        assert found.state.x[-1] > 0
        slopes.append(sensitivity(lambda p, n=n: Column(p, n), 4.0, found).state[-1])
    assert (4 * slopes[1] - slopes[0]) / 3 == pytest.approx(exact, rel=1e-6)


def test_given_derivatives_are_used():
    family, parameter = FAMILIES["strip"]
    found = equilibrate(family(parameter))

    def derivative(p, state, multipliers):
        return np.zeros(39), np.array([-1.0, 0.0])

    a = sensitivity(family, parameter, found)
    b = sensitivity(family, parameter, found, residual_derivative=derivative)
    np.testing.assert_allclose(a.state, b.state, rtol=1e-9, atol=1e-12)


@dataclass(frozen=True)
class Pulled(BaseStructure):
    """Two springs in a row; the state holds both nodes, and the second is prescribed."""

    end: float
    size = 1

    def start(self):
        return VectorState([0.0, self.end])

    def retract(self, state, dx):
        return VectorState(state.x + np.array([dx[0], 0.0]))

    def difference(self, a, b):
        return (b.x - a.x)[:1]

    def adopt(self, state):
        return VectorState([state.x[0], self.end])

    def evaluate(self, state, multipliers, order=2):
        a, b = state.x[0], state.x[1] - state.x[0]
        energy = 1.5 * a**2 + 0.5 * b**2 + b**4
        gradient = np.array([3 * a - b - 4 * b**3])
        return Evaluation(energy, np.zeros(0), gradient, DenseKKT([[4 + 12 * b**2]]))


def test_prescribed_values_move_along():
    """The support moves with the parameter; what it moves directly is in the outputs."""
    found = equilibrate(Pulled(1.0))
    a, b = found.state.x[0], 1.0 - found.state.x[0]
    stiffness = 1 + 12 * b**2
    slope = stiffness / (3 + stiffness)
    force = {"force": lambda state, mult, end: 3 * state.x[0]}
    stretch = {"stretch": lambda state, mult, end: state.x[1] - state.x[0]}
    for mode in ("direct", "adjoint"):
        result = sensitivity(Pulled, 1.0, found, force | stretch, mode)
        assert result.outputs["force"] == pytest.approx(3 * slope, rel=1e-9)
        assert result.outputs["stretch"] == pytest.approx(1 - slope, rel=1e-9)
    assert 3 * a == pytest.approx(b + 4 * b**3)


def test_at_a_fold_there_is_no_derivative():
    regular = equilibrate(fold(1.0))
    critical = replace(regular, structure=fold(0.0), state=VectorState([0.0]), stable=False)
    with pytest.raises(FactorizationError, match="critical"):
        sensitivity(fold, 0.0, critical)


def test_a_parameter_that_is_nearly_zero():
    """Within a step in proportion to 5e-17, rounding hides what the parameter changes."""

    def spring(p):
        soft, _ = p
        return DenseStructure(
            initial=[1.0],
            energy=lambda x: (1 + soft) * x[0] ** 2 / 2 - x[0],
            gradient=lambda x: (1 + soft) * x - 1,
            hessian=lambda x: np.array([[1 + soft]]),
        )

    for soft in (5e-17, -1e-13):
        found = equilibrate(spring((soft, 0.0)))
        with pytest.raises(InvalidInput, match="pass `step`"):
            sensitivity(spring, (soft, 0.0), found)
        given = sensitivity(spring, (soft, 0.0), found, step=1e-3)
        assert given.state == pytest.approx(np.array([[-1.0, 0.0]]), abs=1e-10)
    # A parameter that changes nothing has the derivative zero, however small it is.
    found = equilibrate(spring((0.0, 1e-15)))
    assert sensitivity(spring, (0.0, 1e-15), found).state == pytest.approx(
        np.array([[-1.0, 0.0]]), abs=1e-10
    )


def test_bad_arguments():
    family, parameter = FAMILIES["strip"]
    found = equilibrate(family(parameter))
    with pytest.raises(InvalidInput, match="mode"):
        sensitivity(family, parameter, found, mode="forward")
    with pytest.raises(InvalidInput, match="not balanced"):
        sensitivity(family, 0.5, found)
    with pytest.raises(InvalidInput, match="unknowns"):
        sensitivity(lambda p: Strip(p, 20), parameter, found)
    with pytest.raises(InvalidInput, match="parameter"):
        sensitivity(family, np.nan, found)
    with pytest.raises(InvalidInput, match="step"):
        sensitivity(family, parameter, found, step=-1.0)
    with pytest.raises(InvalidInput, match="a number"):
        sensitivity(family, parameter, found, {"bad": lambda state, m, p: state.x})
    wrong = Output(lambda s, m, p: s.x[0], lambda s, m, p: np.ones(3))
    with pytest.raises(InvalidInput, match="state_gradient"):
        sensitivity(family, parameter, found, {"bad": wrong})
    with pytest.raises(InvalidInput, match="residual_derivative"):
        sensitivity(
            family, parameter, found, residual_derivative=lambda p, s, m: (np.ones(2), np.ones(2))
        )
