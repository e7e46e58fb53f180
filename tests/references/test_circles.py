"""Circles: the closed thresholds against a Galerkin method, nonlinear energies and limits."""

import numpy as np
import pint
import pytest

from lissome.errors import InvalidInput
from lissome.references import circles
from lissome.references.circles import RingSection

SLINKY = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
SECTIONS = [
    SLINKY,
    RingSection.rectangle(5.0, 2.0, 0.41),
    RingSection.rectangle(5.0, 2.0, 0.41, radial="thickness"),
    RingSection(1.0, 1.0, 0.7),
    RingSection(3.0, 0.4, 1.9),
    RingSection(0.5, 2.0, 0.3),
]


def test_thresholds_of_the_slinky_without_the_library():
    """Arithmetic from the printed constants; the radial width is what the printed 2.85 asks for."""
    w, t = 5.0, 2.0
    stiff, soft, c = w**3 * t / 12, w * t**3 / 12, 0.256 * w * t**3 / 2.82
    for inner, outer, radial in ((stiff, soft, "width"), (soft, stiff, "thickness")):
        section = RingSection.rectangle(w, t, 0.41, radial=radial, torsion_constant=0.256)
        total, product = outer + c, outer * c
        for turns, mode, sign in ((1, 2, 1), (3, 2, 1), (3, 4, 1)):
            root = np.roots([1.0, turns * total, -product * (mode**2 - turns**2)])
            found = circles.mode_threshold(section, turns, mode)
            assert found == pytest.approx(turns + sign * root.max() / inner, rel=1e-13)
    ends = [
        circles.mode_threshold(RingSection.rectangle(w, t, 0.41, radial=side), 3, 2)
        for side in ("width", "thickness")
    ]
    assert abs(ends[0] - 2.85) < 0.02 < abs(ends[1] - 2.85)


def test_overcurvature_of_the_flat_circle_is_one():
    """kappa_0 L / (2 pi) is the pure number 1 for kappa_0 = 2 pi/L; 2 pi kappa_0/L is none."""
    unit = pint.UnitRegistry()
    length = 314 * unit.mm
    natural = 2 * np.pi / length
    ratio = (natural * length / (2 * np.pi)).to_base_units()
    assert ratio.dimensionless
    assert ratio.magnitude == pytest.approx(1.0, rel=1e-15)
    assert not (2 * np.pi * natural / length).dimensionless
    # in these units the circle itself has no strain energy, at O = 1
    assert circles.circle_spectrum(SLINKY, 1, ratio.magnitude).min() > -1e-12


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("turns", [1, 2, 3, 4])
def test_circle_is_stable_exactly_between_its_thresholds(section, turns):
    """The Galerkin spectrum has three zeros inside, a new one at each end, a negative one outside."""
    low, high = circles.stable_range(section, turns)
    scale = max(section.out_of_plane, section.torsion) * turns**2
    width = high - low
    assert width > 0
    for place in (low + 1e-3 * width, 0.5 * (low + high), high - 1e-3 * width):
        values = circles.circle_spectrum(section, turns, place)
        assert np.all(np.abs(values[:3]) < 1e-11 * scale)
        assert values[3] > 1e-6 * scale
    for place in (low - 1e-3 * width, high + 1e-3 * width):
        assert circles.circle_spectrum(section, turns, place)[0] < -1e-6 * scale
    for place, extra in ((low, 1 if turns == 1 else 2), (high, 2)):
        values = circles.circle_spectrum(section, turns, place, count=7)
        assert np.sum(np.abs(values) < 1e-10 * scale) == 3 + extra
        assert values.min() > -1e-10 * scale


def test_every_mode_is_neutral_at_its_threshold():
    for turns in (1, 2, 3):
        for mode in range(0, 7):
            if mode == turns:
                continue
            place = circles.mode_threshold(SLINKY, turns, mode)
            values = circles.circle_spectrum(SLINKY, turns, place, count=20)
            assert np.sum(np.abs(values) < 1e-9) == 3 + (1 if mode == 0 else 2)


def test_equal_stiffnesses_space_the_thresholds_evenly():
    section = RingSection(5.0, 2.0, 2.0)
    for turns in (1, 3):
        for mode in (1, 2, 4, 5):
            if mode != turns:
                found = circles.mode_threshold(section, turns, mode)
                assert found == pytest.approx(turns + (mode - turns) * 2.0 / 5.0, rel=1e-14)


def test_straight_isotropic_rod_turns_freely_in_a_ring():
    """Bent to a ring, a straight rod of round section may spin about its tangent at no cost."""
    assert circles.stable_range(RingSection(1.0, 1.0, 0.7), 1)[0] == 0.0
    assert np.sum(np.abs(circles.circle_spectrum(RingSection(1.0, 1.0, 0.7), 1, 0.0)) < 1e-12) == 4


def _rotations(vectors):
    """Rodrigues' formula, one rotation a row."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    k = np.zeros((len(vectors), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    k -= k.transpose(0, 2, 1).copy()
    return np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * (k @ k)


def _energy(section, o, frames):
    """Energy of closed frames by trigonometric differentiation of the rotation matrices."""
    n = len(frames)
    order = np.fft.fftfreq(n, 1 / n)[:, None, None]
    slope = np.fft.ifft(1j * order * np.fft.fft(frames, axis=0), axis=0).real
    spin = frames.transpose(0, 2, 1) @ slope
    k1, k2, k3 = spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]
    density = (
        section.out_of_plane * k1**2 + section.in_plane * (k2 - o) ** 2 + section.torsion * k3**2
    )
    return np.pi * density.mean()


@pytest.mark.parametrize(("turns", "mode"), [(1, 2), (1, 3), (3, 2), (3, 4), (2, 1)])
def test_energy_bends_down_beyond_the_threshold(turns, mode):
    """Second differences of the full energy along the mode, which closes to first order."""
    n = 96
    s = 2 * np.pi * np.arange(n) / n
    circle = np.zeros((n, 3, 3))
    circle[:, 0, 0], circle[:, 1, 0] = -np.cos(turns * s), -np.sin(turns * s)
    circle[:, 0, 2], circle[:, 1, 2] = -np.sin(turns * s), np.cos(turns * s)
    circle[:, 2, 1] = 1.0
    p, c = SLINKY.out_of_plane, SLINKY.torsion
    place = circles.mode_threshold(SLINKY, turns, mode)
    mu = SLINKY.in_plane * (place - turns)
    # null vector of the symmetric 2 x 2 form
    a = mode * (turns * (p + c) + mu)
    b = mode**2 * p + turns**2 * c + turns * mu
    wave = np.stack([a * np.cos(mode * s), 0 * s, b * np.sin(mode * s)], axis=1) / np.hypot(a, b)
    step = 1e-3

    def bending(o):
        up, middle, down = (
            _energy(SLINKY, o, circle @ _rotations(amount * wave)) for amount in (step, 0.0, -step)
        )
        return (up - 2 * middle + down) / step**2

    assert _energy(SLINKY, 0.7, circle) == pytest.approx(
        np.pi * SLINKY.in_plane * (turns - 0.7) ** 2, rel=1e-12
    )
    assert abs(bending(place)) < 1e-4 * p
    outwards = 0.02 if mode > turns else -0.02
    assert bending(place + outwards) < -0.01 * p * 0.5
    assert bending(place - outwards) > 0.01 * p * 0.5


def test_turned_circle_is_the_minimum_over_even_turns():
    section = RingSection(4.0, 1.0, 1.0)
    angles = np.linspace(0, np.pi, 20001)
    for o in (-2.0, -0.75, -0.4, 0.0, 0.375, 0.7, 0.75, 1.0):
        energy = 4.0 * (np.cos(angles) - o) ** 2 + np.sin(angles) ** 2
        assert circles.turned_circle(section, o) == pytest.approx(
            angles[np.argmin(energy)], abs=2e-2
        )
        assert 4.0 * (np.cos(circles.turned_circle(section, o)) - o) ** 2 + np.sin(
            circles.turned_circle(section, o)
        ) ** 2 == pytest.approx(energy.min(), abs=1e-6)
    assert circles.turned_circle(section, circles.stable_range(section, 1)[0]) == 0.0
    assert circles.turned_circle(RingSection(1.0, 2.0, 1.0), -0.1) == np.pi


def test_turned_circle_is_stable():
    """Below the threshold of the flat ring its circle with a turned section takes over."""
    section, o = RingSection(4.0, 1.0, 1.0), 0.375
    turn = circles.turned_circle(section, o)
    n = 48
    s = 2 * np.pi * np.arange(n) / n
    frames = np.zeros((n, 3, 3))
    frames[:, 0, 0], frames[:, 1, 0] = -np.cos(s), -np.sin(s)
    frames[:, 0, 2], frames[:, 1, 2] = -np.sin(s), np.cos(s)
    frames[:, 2, 1] = 1.0
    about = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]]
    )
    strains = np.tile(about.T @ [0.0, 1.0, 0.0], (n, 1))
    values = circles.second_variation_spectrum(section, o, frames @ about, strains, modes=10)
    assert np.all(np.abs(values[:3]) < 1e-12)
    assert values[3] > 0.1
    assert circles.circle_spectrum(section, 1, o)[0] < -0.1


@pytest.mark.parametrize("aspect", [1.0, 2.5, 10.0])
def test_torsion_constant_by_the_double_series(aspect):
    """Prandtl's stress function in sines of both coordinates."""
    m = np.arange(1, 4001, 2.0)
    inner = np.array([np.sum(1 / (m * m * (k * k / aspect**2 + m * m))) / k**2 for k in m])
    found = 256 / np.pi**6 * inner.sum()
    assert circles.rectangle_torsion_constant(aspect) == pytest.approx(found, rel=1e-9)


def test_torsion_constant_of_a_strip():
    # (1/3)(1 - 0.630249.../aspect) up to exponentially small terms
    far = [circles.rectangle_torsion_constant(a) for a in (50.0, 100.0)]
    slope = np.array([(1 - 3 * far[0]) * 50, (1 - 3 * far[1]) * 100])
    assert slope[0] == pytest.approx(slope[1], rel=1e-12)
    assert circles.rectangle_torsion_constant(1e6) == pytest.approx(1 / 3, rel=1e-6)


def test_bad_input():
    with pytest.raises(InvalidInput, match="thickness"):
        RingSection.rectangle(2.0, 5.0, 0.3)
    with pytest.raises(InvalidInput, match="poisson_ratio"):
        RingSection.rectangle(5.0, 2.0, 0.6)
    with pytest.raises(InvalidInput, match="radial"):
        RingSection.rectangle(5.0, 2.0, 0.3, radial="w")
    with pytest.raises(InvalidInput, match="torsion"):
        RingSection(1.0, 1.0, 0.0)
    with pytest.raises(InvalidInput, match="rigid rotation"):
        circles.mode_threshold(SLINKY, 3, 3)
    with pytest.raises(InvalidInput, match="aspect"):
        circles.rectangle_torsion_constant(0.4)
    with pytest.raises(InvalidInput, match="modes"):
        circles.second_variation_spectrum(
            SLINKY, 1.0, np.zeros((8, 3, 3)), np.zeros((8, 3)), modes=4
        )
