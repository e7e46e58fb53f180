"""Rolling ring: closed forms against sums and quadrature, collocation against the linear limit."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from lissome.errors import InvalidInput
from lissome.references import rolling


@pytest.mark.parametrize("order", [0, 1, -1, 2, 3, -4, 6, 7])
def test_light_coefficients_by_quadrature(order):
    angle = 0.37

    def part(function):
        return quad(
            lambda w: np.cos(w - angle) * function(order * w), angle - np.pi / 2, angle + np.pi / 2
        )[0]

    expected = part(np.cos) - 1j * part(np.sin)
    assert rolling.light_coefficient(order, angle) == pytest.approx(expected, abs=1e-12)


def _sum(angle, speed, function, terms=3000):
    total = 0.0
    for k in range(2, terms):
        total += function(k, rolling.light_coefficient(k, angle) / (1 - 2j * np.pi * k * speed))
    return total


@pytest.mark.parametrize(
    ("angle", "speed"),
    [(0.3, 0.04), (0.7, 0.2), (1.2, 0.05), (1.2, -0.05), (-0.5, 1.0), (0.1, 0.01)],
)
def test_closed_forms_are_the_fourier_sums(angle, speed):
    direct = _sum(angle, speed, lambda k, z: k / (k * k - 1) * z.imag)
    assert rolling.selection(angle, speed) == pytest.approx(direct, abs=1e-12)
    direct = -_sum(angle, speed, lambda k, z: k * k / (k * k - 1) * z.real) / np.pi
    assert rolling.contact_sum(angle, speed) == pytest.approx(direct, abs=2e-7)  # tail ~ 1/n^2
    step = 1e-5
    slope = rolling.selection(angle + step, speed) - rolling.selection(angle - step, speed)
    assert rolling.contact_sum(angle, speed) == pytest.approx(
        slope / (2 * step) / np.pi, rel=1e-7, abs=1e-9
    )


def test_speed_at_small_angles():
    for angle in (1e-2, 2e-2, 4e-2):
        scaled = 2 * np.pi * rolling.linear_speed(angle).speed / angle - 1
        assert scaled == pytest.approx(angle**2, rel=0.02)
    assert rolling.linear_speed(0.0).speed == 0.0
    assert rolling.linear_speed(np.pi / 2).speed == 0.0
    near = np.pi / 2 - 1e-2
    assert rolling.linear_speed(near).speed == pytest.approx(-1e-2 / (2 * np.pi), rel=1e-2)


def test_speed_is_odd_in_the_angle():
    for angle in (0.1, 0.6, 1.1):
        assert rolling.linear_speed(-angle).speed == -rolling.linear_speed(angle).speed


def test_speed_diverges_at_the_breakdown_angle():
    critical = rolling.breakdown_angle()
    series = sum(
        (-1) ** n * np.cos(2 * n * critical) / (4 * n * n - 1) ** 2 for n in range(1, 2000)
    )
    assert abs(series) < 1e-10
    for gap in (1e-3, 1e-5, 1e-7):
        below, above = (rolling.linear_speed(critical + s * gap) for s in (-1, 1))
        assert below.speed * gap == pytest.approx(0.04029353, rel=2 * gap + 1e-6)
        assert above.speed * gap == pytest.approx(-0.04029353, rel=20 * gap + 1e-6)
        assert (below.stable_response, above.stable_response) == (-1, 1)


def test_speed_and_contact_on_the_whole_range():
    """V > 0 and a stable contact for negative response below the breakdown angle, reversed above."""
    critical = rolling.breakdown_angle()
    for angle in np.linspace(0.02, np.pi / 2 - 0.02, 40):
        found = rolling.linear_speed(angle)
        assert abs(rolling.selection(angle, found.speed)) < 1e-12
        below = angle < critical
        assert found.speed > 0 if below else found.speed < 0
        assert found.stable_response == (-1 if below else 1)


@pytest.mark.parametrize("side", ["lower", "upper"])
@pytest.mark.parametrize("speed", [0.03, 0.5, -0.04, 40.0, 1e-3, 0.0])
def test_linear_natural_curvature_solves_its_equation(side, speed):
    angle = 0.3
    shift = np.pi if side == "upper" else 0.0
    s = np.linspace(-0.7, 1.3, 17)
    values = rolling.linear_natural_curvature(s, angle, speed, side=side)
    later = rolling.linear_natural_curvature(s + speed, angle, speed, side=side)
    # a material point had the light of s + V u a time u ago: add up one relaxation time
    for position, value, old in zip(s, values, later, strict=True):
        phase = 2 * np.pi * position - angle - shift
        turn = 2 * np.pi * speed
        span = sorted([phase, phase + turn])
        kinks = np.pi / 2 + np.pi * np.arange(-200, 200)
        inside = [k for k in kinks if span[0] < k < span[1]]
        ends = [0.0, *sorted((k - phase) / turn for k in inside), 1.0] if inside else [0.0, 1.0]
        nodes, weights = np.polynomial.legendre.leggauss(24)
        received = 0.0
        for a, b in pairwise(ends):
            u = a + (b - a) * (nodes + 1) / 2
            light = np.maximum(0.0, np.cos(phase + turn * u))
            received += (b - a) / 2 * weights @ (np.exp(-u) * light)
        assert value == pytest.approx(received + np.exp(-1.0) * old, abs=1e-12)
    again = rolling.linear_natural_curvature(s + 1, angle, speed, side=side)
    assert np.allclose(values, again, atol=1e-12)


def test_wave_tends_to_the_linear_theory_at_first_order():
    angle = 0.3
    linear = rolling.linear_speed(angle).speed
    errors = [
        [
            rolling.rolling_wave(response, angle, side=side).speed - linear
            for response in (-0.02, -0.01)
        ]
        for side in ("upper", "lower")
    ]
    errors = np.array(errors)
    assert np.allclose(errors[:, 0] / errors[:, 1], 2.0, rtol=0.01)
    # the sides differ at first order only through terms odd in the first harmonic
    assert abs(errors[0, 1]) < 2e-4 * linear


@pytest.mark.parametrize(("response", "side"), [(-1.0, "upper"), (-1.0, "lower"), (0.5, "upper")])
def test_wave_is_resolved_and_satisfies_the_model(response, side):
    angle = 0.4
    wave = rolling.rolling_wave(response, angle, side=side, nodes=32)
    fine = rolling.rolling_wave(response, angle, side=side, nodes=48)
    assert wave.speed == pytest.approx(fine.speed, rel=1e-8)
    assert wave.contact_stiffness == pytest.approx(fine.contact_stiffness, rel=1e-7)
    # gravity holds the contact for negative response only, whichever half is lit
    assert (fine.contact_stiffness > 0) == (response < 0)
    # the same wave by integration against the motion, where the natural curvature relaxes
    shift = np.pi if side == "upper" else 0.0
    fx, fy = fine.force

    def right(s, y):
        theta, x, height, moment_of_x, k = y
        light = max(0.0, np.cos(theta - angle - shift))
        return [
            k + fine.moment + fx * height - fy * x,
            np.cos(theta),
            np.sin(theta),
            x,
            (k - 2 * np.pi - response * light) / fine.speed,
        ]

    start = [2 * np.pi, 0.0, 0.0, 0.0, fine.natural_curvature[-1]]
    end = solve_ivp(right, (1, 0), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.allclose(end, [0, 0, 0, 0, fine.natural_curvature[0]], atol=1e-7)


def test_wave_is_odd_in_the_angle():
    left, right = (rolling.rolling_wave(-1.0, angle) for angle in (-0.3, 0.3))
    assert left.speed == pytest.approx(-right.speed, rel=1e-9)
    assert left.contact_stiffness == pytest.approx(right.contact_stiffness, rel=1e-8)


def test_contact_stiffness_is_the_curvature_of_the_height():
    """Height of the center of mass over the tangent at neighboring points, by finite differences."""
    wave = rolling.rolling_wave(-1.0, 0.4, nodes=48)
    weights = np.concatenate(
        [
            (wave.position[j * 48 + 47] - wave.position[j * 48]) * rolling._quadrature(48)
            for j in range(3)
        ]
    )
    center = np.array([weights @ wave.x, weights @ wave.y])
    assert abs(center[0]) < 1e-10
    # support function at nodes next to the contact, on the first arc
    at = slice(0, 12)
    height = (center[0] - wave.x[at]) * -np.sin(wave.angle[at]) + (center[1] - wave.y[at]) * np.cos(
        wave.angle[at]
    )
    fit = np.polynomial.Polynomial.fit(wave.position[at], height, 7).convert().coef
    assert abs(fit[1]) < 1e-6
    assert 2 * fit[2] == pytest.approx(wave.contact_stiffness, rel=1e-3)


def test_bad_input():
    with pytest.raises(InvalidInput, match="angle"):
        rolling.linear_speed(1.6)
    with pytest.raises(InvalidInput, match="angle"):
        rolling.rolling_wave(-1.0, 0.0)
    with pytest.raises(InvalidInput, match="response"):
        rolling.rolling_wave(0.0, 0.3)
    with pytest.raises(InvalidInput, match="side"):
        rolling.rolling_wave(-1.0, 0.3, side="left")
    wave = rolling.rolling_wave(-0.1, 0.3, nodes=20)
    with pytest.raises(InvalidInput, match="start"):
        rolling.rolling_wave(-0.1, 0.3, nodes=24, start=wave)
    with pytest.raises(InvalidInput, match="infinite"):
        rolling.linear_speed(rolling.breakdown_angle())
