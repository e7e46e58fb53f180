"""The rolling ring: contact, speed, symmetries, against collocation and linear theory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lissome.beams import ParallelLight, Ring
from lissome.errors import InvalidInput
from lissome.references import rolling


def rolled(intensity, angle, *, until=25.0, segments=60, step=0.02, response=1.0, **options):
    ring = Ring(segments=segments, response=response)
    light = ParallelLight(intensity, angle=angle, **options)
    return ring.under(light).run(until=until, step=step, record_every=1)


@pytest.mark.parametrize("side", ["upper", "lower"])
@pytest.mark.parametrize(("intensity", "error"), [(1.0, 2e-6), (10.0, 3e-5)])
def test_steady_speed_against_collocation(side, intensity, error):
    """At N = 100, and to five digits when extrapolated in h: against traveling waves."""
    angle = 0.3
    exact = rolling.rolling_wave(-intensity, angle, side=side).speed
    # The reference lights the lower half from the direction opposite to the one above; here the
    # angle of light from below is measured to the left as well.
    lamp = angle if side == "upper" else -angle

    def speed(segments):
        coarse, fine = (
            rolled(intensity, lamp, segments=segments, step=step, side=side).speed
            for step in (0.04, 0.02)
        )
        return fine + (fine - coarse) / 3

    rough, good = speed(50), speed(100)
    assert abs(good - exact) < error
    assert abs((good + (good - rough) / 3) / exact - 1) < 2e-5


def test_speed_is_of_second_order_in_time():
    speeds = [rolled(1.0, 0.4, step=0.1 / 2**k, until=15.0).speed for k in range(4)]
    changes = np.abs(np.diff(speeds))
    np.testing.assert_allclose(np.log2(changes[:-1] / changes[1:]), 2.0, atol=0.2)


def test_linear_theory_is_approached_with_vanishing_light():
    linear = rolling.linear_speed(0.3).speed
    deviations = []
    for intensity in (1.0, 0.1):
        coarse, fine = (
            rolled(intensity, 0.3, segments=100, step=step).speed for step in (0.04, 0.02)
        )
        deviations.append(fine + (fine - coarse) / 3 - linear)
    assert deviations[0] * deviations[1] > 0
    order = math.log10(deviations[0] / deviations[1])
    assert 0.9 < order < 1.1


def test_vertical_light_does_not_roll():
    history = rolled(5.0, 0.0, until=10.0)
    assert abs(history.speed) < 1e-12
    assert np.abs(history.distance).max() < 1e-9


def test_speed_is_odd_in_the_angle():
    left, right = rolled(3.0, 0.25), rolled(3.0, -0.25)
    assert abs(left.speed + right.speed) < 1e-10
    assert left.speed > 0.03  # away from light from the upper left


def test_the_contact_touches_and_carries():
    """At the contact: on the ground, level, lowest point, center of mass above and lowest."""
    history = rolled(5.0, 0.4, until=8.0, segments=120)
    row = -1
    x, y = history.positions[row, :-1].T
    contact = history.contact[row]
    assert abs(np.mean(x) - contact) < 1e-10
    assert y.min() > -1e-5
    assert y.min() < 2e-4  # nodes beside the contact
    # Support function: the height of the center of mass when the ring touches at another angle.
    angles = history.angles[row, :-1] + history.rotation[row]
    centered = np.stack([x - x.mean(), y - y.mean()])
    heights = -(centered[1] * np.cos(angles) - centered[0] * np.sin(angles))
    lowest = np.argmin(heights)
    s = history.structure.angle_arclength[lowest]
    gap = (contact - s + 0.5) % 1.0 - 0.5
    assert min(abs(gap), abs(abs(gap) - 0.5)) < 2.0 / 120  # an ellipse has two lowest contacts


def test_rings_stay_closed_and_stable():
    history = rolled(10.0, 0.6, until=5.0)
    ends = [history.structure.positions(history.state(i))[-1] for i in range(len(history))]
    np.testing.assert_allclose(ends, 0, atol=1e-10)
    assert np.all(history.smallest_eigenvalue > 0)
    # A round ring rolls at once to the stable contact when it is released, then without jumps.
    assert np.all(np.abs(np.diff(history.contact[history.times > 0.05])) < 0.01)


def test_hold_shifts_the_distance_but_not_the_speed():
    speeds, distances = [], []
    for hold in (0.02, 0.1):
        history = (
            Ring(segments=60, hold=hold)
            .under(ParallelLight(1.0, angle=0.3))
            .run(until=25.0, step=0.02)
        )
        speeds.append(history.speed)
        distances.append(history.distance[-1])
        assert np.all(history.contact[history.times <= hold] == 0)
    assert abs(speeds[0] - speeds[1]) < 2e-6
    assert abs(distances[0] - distances[1]) > 1e-4


def test_speed_is_refused_where_there_is_none():
    history = rolled(1.0, 0.3, until=1.0)
    with pytest.raises(InvalidInput, match="`window`"):
        history.find_speed(window=0.8)
    with pytest.raises(InvalidInput, match="`window`"):
        history.find_speed(window=-1.0)
