"""Errors of chapter 4.2-4.4 and appendix A.2 that derivatives of the formulas themselves show.

Each test takes exact derivatives by complex steps of the formula that comes before: what is printed
fails, what is said to be right agrees to round-off.
"""

import numpy as np
import pytest
from rods import transcription as plain

from lissome.errors import InvalidInput
from lissome.rods.centerline import CenterlineState

random = np.random.default_rng(22)
H = 1e-40


def unit(array):
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


def slope(function, at, direction):
    return np.imag(function(at + 1j * H * direction)) / H


def close(a, b):
    return np.max(np.abs(a - b)) < 1e-13 * max(np.max(np.abs(b)), 1.0)


SEGMENT = random.standard_normal(7)
T = unit(random.standard_normal(3))
STEP = random.standard_normal(7)


def test_first_variation_of_the_tangent():
    t, dt, _ = plain.tangent_variations(SEGMENT)
    exact = slope(lambda x: plain.tangent(x[:3], x[4:]), SEGMENT, STEP)
    assert close(dt @ STEP, exact)  # (4.22) with I - t (x) t
    assert abs(t @ dt @ STEP) < 1e-14  # what keeps the tangent a unit vector


@pytest.mark.parametrize("printed", [True, False])
def test_second_variation_of_the_tangent(printed):
    *_, ddt = plain.tangent_variations(SEGMENT, printed)
    exact = slope(lambda x: plain.tangent_variations(x)[1] @ STEP, SEGMENT, STEP)
    assert close(np.einsum("imn,m,n->i", ddt, STEP, STEP), exact) is not printed


def test_what_the_printed_second_variation_of_the_tangent_loses():
    # t = (u, 0, 1 + v)/sqrt(u^2 + (1 + v)^2) to second order in (u, v): (-2 u v, 0, -u^2). With the
    # printed sign of the first tau the product u v is gone.
    dof, e = np.array([0, 0, 0, 0, 0, 0, 1.0]), np.array([0, 0, 0, 0, 0.3, 0, 0.5])
    right, printed = (plain.tangent_variations(dof, which)[2] for which in (False, True))
    np.testing.assert_allclose(np.einsum("imn,m,n->i", right, e, e), [-0.3, 0, -0.09], atol=1e-15)
    np.testing.assert_allclose(np.einsum("imn,m,n->i", printed, e, e), [0, 0, -0.09], atol=1e-15)


def test_variations_of_transport_frames_strains_and_stretching():
    """(4.23) and (4.25) to (4.29) are right as printed, and so is the first of (4.22)."""
    dp, ddp = plain.transport_variations(SEGMENT, T)

    def rotation_vector(quaternion, dquaternion):  # (A.4): 2 ds conj(s)
        return 2 * plain.product(dquaternion, plain.bar(quaternion))[1:]

    p = plain.transport(T, plain.tangent(SEGMENT[:3], SEGMENT[4:]))
    dq = slope(lambda x: plain.transport(T, plain.tangent(x[:3], x[4:])), SEGMENT, STEP)
    assert close(dp @ STEP, rotation_vector(p, dq))
    # delta_1 (delta_1 p^), which is delta^2 p^ by (A.5)
    exact = slope(lambda x: plain.transport_variations(x, T)[0] @ STEP, SEGMENT, STEP)
    assert close(np.einsum("imn,m,n->i", ddp, STEP, STEP), exact)

    dof, step = random.standard_normal(11), random.standard_normal(11)
    tangents, frames = unit(random.standard_normal((2, 3))), unit(random.standard_normal((2, 4)))
    _, _, dk, ddk = plain.hinge_variations(dof, tangents, frames)
    assert close(
        dk @ step, slope(lambda x: plain.hinge_variations(x, tangents, frames)[1], dof, step)
    )
    exact = slope(lambda x: plain.hinge_variations(x, tangents, frames)[2] @ step, dof, step)
    assert close(np.einsum("imn,m,n->i", ddk, step, step), exact)

    de, dde = plain.stretching_variations(SEGMENT, 0.7)
    stretching = lambda x: plain.stretching(x[:3], x[4:], 0.7)  # noqa: E731
    assert close(de @ STEP, slope(stretching, SEGMENT, STEP))
    exact = slope(lambda x: plain.stretching_variations(x, 0.7)[0] @ STEP, SEGMENT, STEP)
    assert close(STEP @ dde @ STEP, exact)


def test_rotation_vectors_of_second_order():
    """(A.4) and (A.5) as printed, for a quaternion that depends on two parameters."""
    a, b, c = random.standard_normal((3, 3))

    def s(x, y):
        return plain.product(plain.exp(a + x * b), plain.exp(b * y + c))

    d1 = lambda x, y: np.imag(s(x + 1j * H, y)) / H  # noqa: E731
    d2 = lambda x, y: np.imag(s(x, y + 1j * H)) / H  # noqa: E731
    hat = lambda ds, q: 2 * plain.product(ds, plain.bar(q))  # noqa: E731
    q, v1, v2 = s(0, 0), hat(d1(0, 0), s(0, 0)), hat(d2(0, 0), s(0, 0))
    assert abs(v1[0]) < 1e-14  # a pure vector
    assert abs(v2[0]) < 1e-14
    # d12 s by central differences of the exact first derivative, extrapolated
    steps = [(d1(0, h) - d1(0, -h)) / (2 * h) for h in (2e-3, 1e-3)]
    d12 = (4 * steps[1] - steps[0]) / 3
    vector = 2 * plain.product(d12, plain.bar(q))
    vector[0] += v1[1:] @ v2[1:] / 2  # (A.4)
    assert abs(vector[0]) < 1e-9
    hats = [(hat(d1(0, h), s(0, h)) - hat(d1(0, -h), s(0, -h))) / (2 * h) for h in (2e-3, 1e-3)]
    d2_of_1 = ((4 * hats[1] - hats[0]) / 3)[1:]
    hats = [(hat(d2(h, 0), s(h, 0)) - hat(d2(-h, 0), s(-h, 0))) / (2 * h) for h in (2e-3, 1e-3)]
    d1_of_2 = ((4 * hats[1] - hats[0]) / 3)[1:]
    np.testing.assert_allclose(vector[1:], (d2_of_1 + d1_of_2) / 2, atol=1e-9)  # (A.5)
    assert np.max(np.abs(d2_of_1 - d1_of_2)) > 1e-2  # neither alone is symmetric


@pytest.mark.parametrize("printed", [True, False])
def test_variation_of_the_binormal(printed):
    a, b = unit(random.standard_normal((2, 3)))
    d = random.standard_normal(3)
    exact = slope(lambda x: plain.binormal(a, x), b, d)
    assert close(plain.binormal_variation(a, b, d, printed), exact) is not printed


def test_second_variation_of_transport():
    """(A.6) to (A.11): as printed, with the variation of the binormal corrected."""
    a, b = unit(random.standard_normal((2, 3)))
    d1, d2 = (np.cross(b, random.standard_normal(3)) for _ in range(2))  # b . db = 0
    d12 = np.cross(b, random.standard_normal(3)) - (d1 @ d2) * b  # b . d12 b = - d1 b . d2 b
    dq = slope(lambda x: plain.transport(a, x), b, d1)
    p = plain.transport(a, b)
    rotation_vector = 2 * plain.product(dq, plain.bar(p))
    assert close(rotation_vector[1:], plain.transport_first(a, b, d1))  # (A.9)
    assert abs(rotation_vector[0]) < 1e-14
    # (A.6) to (A.8): the same by the holonomy
    turned = -plain.binormal(a, b) @ d1 / 2 * plain.act(p, a)
    assert close(np.cross(b, d1) + turned, rotation_vector[1:])
    # (A.10): d2 acts on b and on the vector d1 b, which changes by d12 b
    exact = slope(
        lambda x: plain.transport_first(a, x[:3], x[3:]),
        np.concatenate([b, d1]),
        np.concatenate([d2, d12]),
    )
    assert close(plain.transport_second_once(a, b, d1, d2, d12), exact)
    both = plain.transport_second_once(a, b, d1, d2, d12)
    both = both + plain.transport_second_once(a, b, d2, d1, d12)
    assert close(plain.transport_second(a, b, d1, d2, d12), both / 2)  # (A.11)


def test_variation_of_an_inverse_rotation():
    """Appendix A.2, below 'Rotation gradient': the third line lost a bar and a factor."""
    s, ds_hat = unit(random.standard_normal(4)), random.standard_normal(3)
    u, du = random.standard_normal((2, 3))
    ds = plain.product(plain.pure(ds_hat), s) / 2  # (A.4)

    def turned(x):
        return plain.act(plain.bar(x[:4]), x[4:])

    exact = slope(turned, np.concatenate([s, u]), np.concatenate([ds, du]))
    back = plain.bar(s)
    chain = lambda *q: plain.product(q[0], chain(*q[1:])) if len(q) > 1 else q[0]  # noqa: E731
    hat, vector = plain.pure(ds_hat), plain.pure(u)
    right = -chain(back, hat, vector, s) + chain(back, vector, hat, s)
    printed = -chain(back, hat, vector, back) + chain(vector, hat, s)
    rest = plain.act(back, du)
    assert close(right[1:] / 2 + rest, exact)
    assert not close(printed[1:] / 2 + rest, exact)
    last = -np.cross(plain.act(back, ds_hat), plain.act(back, u)) + rest  # the last line is right
    assert close(last, exact)


def rod(segments=4):
    frames = unit(random.standard_normal((segments, 4)))
    tangents = np.array([plain.act(q, np.array([0, 0, 1.0])) for q in frames])
    arguments = (np.ones(segments), np.array([1.0, 2.0, 0.7]), np.zeros((segments - 1, 3)))
    return random.standard_normal(4 * segments + 3), tangents, frames, *arguments


def test_the_sums_run_over_all_hinges():
    """(4.34): with sums that end at N - 2 and N - 1 the last hinge and the last node are lost."""
    X, tangents, frames, *rest = rod()
    exact = np.array(
        [slope(lambda x: plain.kirchhoff_energy(x, tangents, frames, *rest), X, e)
         for e in np.eye(X.size)]
    )  # fmt: skip
    assert close(plain.kirchhoff_gradient(X, tangents, frames, *rest), exact)
    shorter = [part[:-1] for part in (tangents, frames, rest[0])], rest[1], rest[2][:-1]
    printed = np.zeros_like(X)
    printed[:-4] = plain.kirchhoff_gradient(X[:-4], *shorter[0], *shorter[1:])
    assert not close(printed, exact)


def test_left_and_right_pull_back():
    """After (4.19): the expression that is called q_right is q_left as it was defined, and back."""
    before, after, rotation = unit(random.standard_normal((3, 4)))
    bar, product = plain.bar, plain.product
    left = lambda r: product(product(bar(before), r), before)  # noqa: E731 (definitions above (4.15))
    right = lambda r: product(product(bar(after), r), after)  # noqa: E731
    assert not close(left(rotation), right(rotation))  # they differ for any other rotation ...
    between = product(after, bar(before))
    q = product(bar(before), after)
    assert close(left(between), q) and close(right(between), q)  # ... but not for this one (4.15)
    printed_as_right = product(product(bar(before), between), before)
    assert np.array_equal(printed_as_right, left(between))


def test_what_must_not_reach_pi_is_the_turn_of_the_tangent():
    """Below (4.10) the whole rotation between the frames is said to have to stay away from pi."""
    nodes = np.array([[0.0, 0, 0], [0, 0, 1]])
    reference = np.array([[1.0, 0, 0, 0]])
    twisted = CenterlineState(nodes, [np.pi], reference)  # a rotation by pi
    np.testing.assert_allclose(twisted.directors[0, 2], [0, 0, 1])
    np.testing.assert_allclose(twisted.directors[0, 0], [-1, 0, 0], atol=1e-15)
    with pytest.raises(InvalidInput, match="opposite"):
        CenterlineState(-nodes, [0.0], reference)
