"""Input checks: what passes comes back exactly, everything else is named and refused."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lissome import _validate as check
from lissome.errors import InvalidInput

moderate_floats = st.floats(-1e60, 1e60)
not_numbers = st.one_of(
    st.none(),
    st.booleans(),
    st.text(),
    st.binary(),
    st.complex_numbers(),
    st.lists(st.integers()),
    st.just(np.bool_(True)),
    st.just(np.array([1.0])),
    st.just(float("nan")),
    st.sampled_from([float("inf"), -float("inf"), np.float32("inf"), 10**400, Fraction(10) ** 400]),
)


@given(moderate_floats)
def test_numbers_pass_unchanged(value):
    assert check.finite("x", value) == value
    assert type(check.finite("x", np.float64(value))) is float
    assert check.finite("x", np.array(value)) == value


@given(st.floats(1.001e60, allow_infinity=False).flatmap(lambda x: st.sampled_from([x, -x])))
def test_absurd_numbers_are_refused(value):
    for function in (check.finite, check.nonnegative, check.positive):
        with pytest.raises(InvalidInput, match="argument `x` is "):
            function("x", value)


@given(not_numbers)
def test_what_is_not_a_finite_number_is_refused_by_name(value):
    functions = [
        check.finite,
        check.positive,
        check.nonnegative,
        lambda name, v: check.in_open_interval(name, v, -np.inf, np.inf),
    ]
    if type(value) is not int:  # an integer, though too large for a float
        functions.append(lambda name, v: check.integer_at_least(name, v, 0))
    for function in functions:
        with pytest.raises(InvalidInput, match="argument `width` is "):
            function("width", value)


@given(moderate_floats)
def test_sign_checks_split_the_line_at_zero(value):
    for function, passes in (
        (check.positive, value >= 1e-60),
        (check.nonnegative, value >= 0),
        (lambda n, v: check.in_open_interval(n, v, 0, 1), 0 < value < 1),
    ):
        if passes:
            assert function("x", value) == value
        else:
            with pytest.raises(InvalidInput, match="argument `x` is "):
                function("x", value)


def test_messages_name_argument_value_unit_and_remedy():
    with pytest.raises(InvalidInput) as caught:
        check.positive("thickness", -0.25, unit="mm")
    assert str(caught.value) == "argument `thickness` is -0.25; it must be greater than 0 mm"
    with pytest.raises(InvalidInput) as caught:
        check.in_open_interval("span", 1, 0, 1, "clamps nearer than the strip is long")
    assert str(caught.value) == (
        "argument `span` is 1; it must lie in (0, 1): clamps nearer than the strip is long"
    )


@given(st.integers(-5, 5), st.integers(-5, 5))
def test_integers(value, minimum):
    if value >= minimum:
        assert check.integer_at_least("n", np.int32(value), minimum) == value
    else:
        with pytest.raises(InvalidInput, match=f"at least {minimum}"):
            check.integer_at_least("n", value, minimum)


def test_whole_floats_are_not_integers():
    with pytest.raises(InvalidInput, match=r"`segments` is 100\.0"):
        check.integer_at_least("segments", 100.0, 2)


@given(st.text() | st.integers() | st.none())
def test_names_are_exact_and_suggestions_are_choices(value):
    choices = ["above", "below"]
    if value in choices:
        assert check.one_of("side", value, choices) == value
    else:
        with pytest.raises(InvalidInput, match="'above', 'below'"):
            check.one_of("side", value, choices)
    with pytest.raises(InvalidInput, match="did you mean 'below'"):
        check.one_of("side", "Belows", choices)


@given(hnp.arrays(float, hnp.array_shapes(max_dims=3, max_side=4)))
def test_arrays_are_copied_exactly_or_refused_at_the_place(values):
    if np.isfinite(values).all():
        result = check.finite_array("x", values)
        assert np.array_equal(result, values)
        assert not np.shares_memory(result, values)
        assert result.flags.c_contiguous
        assert np.array_equal(check.finite_array("x", values.tolist()), values)
    else:
        place = tuple(np.argwhere(~np.isfinite(values))[0])
        with pytest.raises(InvalidInput) as caught:
            check.finite_array("x", values)
        assert f"argument `x`[{', '.join(map(str, place))}]" in str(caught.value)


@given(
    hnp.array_shapes(min_dims=0, max_dims=3, max_side=3),
    st.lists(st.none() | st.integers(1, 3), max_size=3),
)
def test_shapes(actual, wanted):
    values = np.zeros(actual)
    fits = len(actual) == len(wanted) and all(
        w is None or w == a for w, a in zip(wanted, actual, strict=True)
    )
    if fits:
        assert check.finite_array("x", values, wanted).shape == actual
    else:
        with pytest.raises(InvalidInput, match="must have shape"):
            check.finite_array("x", values, wanted)


@pytest.mark.parametrize(
    "value",
    [
        [[1, 2], [3]],
        ["1", "2"],
        "12",
        [1, None],
        [1 + 0j],
        [True, False],
        [1.0, True],
        [[0.0, 1.0], [True, 2.0]],
        np.array([True]),
        [10**400],
        np.array(["2020-01-01"], dtype="datetime64[D]"),
        {"a": 1},
        object(),
    ],
    ids=lambda value: repr(value).partition(" at 0x")[0],
)
def test_what_is_not_an_array_of_real_numbers_is_refused(value):
    with pytest.raises(InvalidInput, match="argument `values`"):
        check.finite_array("values", value)


def test_integer_arrays_hold_whole_numbers_only():
    assert check.finite_array("index", [1.0, 2.0], dtype=np.int64).dtype == np.int64
    for value in ([0.5], [2.0**63], [-1e300]):
        with pytest.raises(InvalidInput, match="cannot hold exactly"):
            check.finite_array("index", value, dtype=np.int64)
    with pytest.raises(InvalidInput, match="exceeds the range"):
        check.finite_array("x", [1e300], dtype=np.float32)


def test_objects_that_are_real_numbers_pass():
    assert check.finite_array("x", [Fraction(1, 4), 2**70]).tolist() == [0.25, 2.0**70]


def test_empty_arrays_keep_their_shape():
    assert check.finite_array("x", [], shape=(None,)).shape == (0,)
    assert check.finite_array("x", np.zeros((0, 3)), shape=(None, 3)).shape == (0, 3)
