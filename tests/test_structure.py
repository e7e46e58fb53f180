"""Structures made of plain functions, their checks, and saved states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import Column, Ring, Strip, Truss, balloons_sharing

from lissome import DenseStructure, Structure
from lissome.errors import DataError, InvalidInput
from lissome.structure import BaseStructure, VectorState, load_state, save_state


def make(**changes):
    parts = {
        "initial": [1.0, 2.0],
        "energy": lambda x: np.sum(x**4),
        "gradient": lambda x: 4 * x**3,
        "hessian": lambda x: np.diag(12 * x**2),
        "constraints": lambda x: [x[0] * x[1] - 2],
        "jacobian": lambda x: [[x[1], x[0]]],
        "constraint_hessian": lambda x, m: m[0] * np.array([[0.0, 1.0], [1.0, 0.0]]),
    } | changes
    return DenseStructure(**parts)


@pytest.mark.parametrize("structure", [make(), Column(1.0), Strip(0.5), Ring()])
def test_the_protocol_is_met(structure):
    assert isinstance(structure, Structure)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
@pytest.mark.parametrize(
    "structure",
    [make(), Column(7.0, 8, tilt=0.2), Strip(0.6, 9), Ring(8), balloons_sharing(5.0, 3)],
)
def test_derivatives_are_those_of_the_lagrangian(structure, seed):
    """Central differences of energy and constraints, along a random direction."""
    rng = np.random.default_rng(seed)
    n, m = structure.size, structure.constraints_count
    state = structure.retract(structure.start(), 0.2 * rng.standard_normal(n))
    mult, d = rng.standard_normal(m), rng.standard_normal(n)
    e = structure.evaluate(state, mult, 2)
    h = 1e-5

    def at(step, order):
        return structure.evaluate(structure.retract(state, step * d), mult, order)

    def slope(value):
        near = (value(at(h, 1)) - value(at(-h, 1))) / (2 * h)
        far = (value(at(2 * h, 1)) - value(at(-2 * h, 1))) / (4 * h)
        return (4 * near - far) / 3

    scale = np.max(e.kkt.magnitude(np.abs(d), np.abs(mult))[0]) + np.max(np.abs(e.gradient))
    assert e.gradient @ d == pytest.approx(
        slope(lambda v: v.energy + mult @ v.constraints), abs=1e-8 * scale
    )
    force, moved = e.kkt.apply(d, np.zeros(m))
    np.testing.assert_allclose(slope(lambda v: v.gradient), force, atol=1e-8 * scale)
    np.testing.assert_allclose(slope(lambda v: v.constraints), moved, atol=1e-8 * scale)
    np.testing.assert_allclose(
        structure.difference(state, structure.retract(state, d)), d, rtol=1e-12, atol=1e-12
    )


def test_orders_agree():
    structure = make()
    state, mult = structure.start(), np.array([0.7])
    full = structure.evaluate(state, mult, 2)
    for order in (0, 1):
        part = structure.evaluate(state, mult, order)
        assert part.energy == full.energy
        np.testing.assert_array_equal(part.constraints, full.constraints)
        assert part.kkt is None
        assert (part.gradient is None) == (order == 0)
    np.testing.assert_allclose(full.gradient, [4 + 1.4, 32 + 0.7])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gradient": lambda x: 3.9 * x**3}, "not the derivative of `energy"),
        ({"hessian": lambda x: np.diag(11 * x**2)}, "not the derivative of `gradient"),
        ({"jacobian": lambda x: [[x[0], x[1]]]}, "not the derivative"),
        ({"constraint_hessian": lambda x, m: np.zeros((2, 2))}, "not the derivative"),
        ({"constraint_hessian": None}, "constraint_hessian` is missing|not the derivative"),
        ({"hessian": lambda x: np.diag(12 * x**2) + np.eye(2, k=1)}, "not symmetric"),
        ({"hessian": lambda x: np.ones((2, 3))}, r"`hessian` returned .*\(2, 3\)"),
        ({"gradient": lambda x: np.ones(3)}, r"`gradient` returned .*\(3,\)"),
        ({"jacobian": lambda x: np.ones((2, 2))}, r"`jacobian` returned .*\(2, 2\)"),
        ({"constraints": lambda x: x[0]}, r"`constraints` returned .*\(m,\)"),
        ({"constraint_hessian": lambda x, m: np.ones(2)}, "`constraint_hessian` returned"),
        ({"energy": lambda x: x}, "`energy` returned"),
        ({"energy": lambda x: np.nan}, "`energy` returned nan"),
        ({"gradient": lambda x: np.full(2, np.nan)}, "`gradient` returned NaN"),
        ({"jacobian": None}, "given together"),
        ({"initial": [np.inf, 1.0]}, "`initial`.*finite"),
        ({"initial": []}, "`initial` is empty"),
        ({"masses": [1.0, -1.0]}, "`masses`"),
        ({"masses": [1.0]}, "`masses`"),
        ({"size_of_unknowns": 0.0}, "`size_of_unknowns`"),
        ({"constraint_names": ("a", "b")}, "`constraint_names` has 2"),
        ({"neutral": lambda x: np.ones((1, 3))}, "`neutral` returned"),
    ],
)
def test_mistakes_are_named(change, message):
    def use():
        structure = make(**change)
        return structure.gauge(structure.start())

    with pytest.raises(InvalidInput, match=message):
        use()


def test_step_limit_is_checked():
    structure = make(step_limit=lambda x, dx: 0.0, check=False)
    with pytest.raises(InvalidInput, match="step_limit"):
        structure.max_step(structure.start(), np.ones(2))


def test_right_derivatives_of_steep_functions_pass_the_check():
    """Truncation errors of the check's own differences are not held against the user."""
    Truss(0.5).under(0.01)
    for power in (1e-3, 1.0, 1e3):
        DenseStructure(
            initial=[0.1],
            energy=lambda x, p=power: np.sin(p * x[0]),
            gradient=lambda x, p=power: p * np.cos(p * x),
            hessian=lambda x, p=power: np.diag(-(p**2) * np.sin(p * x)),
        )


def test_evaluate_checks_its_arguments():
    structure = make()
    with pytest.raises(InvalidInput, match="unknowns"):
        structure.evaluate(VectorState([1.0]), np.zeros(1))
    with pytest.raises(InvalidInput, match="multipliers"):
        structure.evaluate(structure.start(), np.zeros(2))


def test_base_class_says_what_is_missing():
    for call in (lambda b: b.size, lambda b: b.start(), lambda b: b.evaluate(None, np.zeros(0))):
        with pytest.raises(NotImplementedError, match="BaseStructure must define"):
            call(BaseStructure())


def test_vector_state_is_a_value():
    x = np.ones(3)
    state = VectorState(x)
    x[0] = 5.0
    assert state.x[0] == 1.0
    with pytest.raises(ValueError):
        state.x[0] = 2.0
    with pytest.raises(InvalidInput, match="shape"):
        VectorState(np.ones((2, 2)))


@dataclass(frozen=True)
class Frames:
    positions: np.ndarray
    turns: int
    closed: bool
    name: str
    angle: float


@dataclass(frozen=True)
class OtherFrames:
    positions: np.ndarray


def test_states_are_saved_and_loaded(tmp_path):
    state = Frames(np.arange(6.0).reshape(3, 2) / 7, 2, True, "loop", np.pi)
    save_state(tmp_path / "a.npz", state)
    again = load_state(tmp_path / "a.npz", Frames)
    np.testing.assert_array_equal(again.positions, state.positions)
    assert (again.turns, again.closed, again.name, again.angle) == (2, True, "loop", np.pi)
    assert [type(v) for v in (again.turns, again.closed, again.name)] == [int, bool, str]
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:  # no pickle inside
        assert set(file.files) == {"__class__", "positions", "turns", "closed", "name", "angle"}


def test_damaged_or_foreign_files_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    save_state(path, VectorState([1.0, 2.0]))
    with pytest.raises(DataError, match="VectorState; OtherFrames"):
        load_state(path, OtherFrames)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="damaged"):
        load_state(path, VectorState)
    changed = bytearray(whole)
    changed[whole.index(b"NUMPY") + 80] ^= 0xFF
    path.write_bytes(bytes(changed))
    with pytest.raises(DataError):
        load_state(path, VectorState)
    np.savez(path, __class__="VectorState", y=np.ones(2))
    with pytest.raises(DataError, match="fields"):
        load_state(path, VectorState)
    np.savez(path, __class__="VectorState", x=np.ones((2, 2)))
    with pytest.raises(DataError, match="do not make"):
        load_state(path, VectorState)
    np.savez(path, __class__="VectorState", x=np.array([object()]))
    with pytest.raises(DataError):
        load_state(path, VectorState)
    with pytest.raises(FileNotFoundError):
        load_state(tmp_path / "nowhere.npz", VectorState)
    with pytest.raises(InvalidInput, match="dataclass"):
        save_state(path, np.ones(3))

    @dataclass
    class Strange:
        x: object

    with pytest.raises(InvalidInput, match="`x`"):
        save_state(path, Strange({"a": 1}))
