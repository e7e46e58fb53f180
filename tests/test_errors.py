"""The exceptions: their built-in kin, and that they cross process boundaries whole."""

import inspect
import pickle

import numpy as np
import pytest

from lissome import errors

KINDS = [
    kind
    for _, kind in inspect.getmembers(errors, inspect.isclass)
    if kind.__module__ == errors.__name__
]


@pytest.mark.parametrize("kind", KINDS)
def test_every_class_is_public_documented_and_derived(kind):
    assert kind.__name__ in errors.__all__
    assert kind.__doc__
    assert issubclass(kind, (errors.LissomeError, errors.LissomeWarning))


@pytest.mark.parametrize(
    ("kind", "builtin"),
    [
        (errors.InvalidInput, ValueError),
        (errors.NotConverged, RuntimeError),
        (errors.Unstable, RuntimeError),
        (errors.StabilityNotResolvable, RuntimeError),
        (errors.FactorizationError, ArithmeticError),
        (errors.SweepFailed, RuntimeError),
        (errors.DataAwaited, errors.DataError),
        (errors.CacheWarning, UserWarning),
    ],
)
def test_callers_can_catch_the_builtin_class(kind, builtin):
    with pytest.raises(builtin, match="reason"):
        raise kind("reason")


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("kind", KINDS)
def test_pickling_keeps_class_message_and_attributes(kind, protocol):
    error = kind("argument `span` is 1.2")
    for name in vars(error):
        setattr(error, name, {"residual": np.array([1.0, 1e-3])})
    error.remark = "added later"
    copy = pickle.loads(pickle.dumps(error, protocol))
    assert type(copy) is kind
    assert str(copy) == str(error)
    assert vars(copy).keys() == vars(error).keys()
    for name in set(vars(error)) - {"remark"}:
        np.testing.assert_array_equal(
            getattr(copy, name)["residual"], getattr(error, name)["residual"]
        )


@pytest.mark.parametrize(
    "kind", [errors.NotConverged, errors.Unstable, errors.StabilityNotResolvable]
)
def test_solver_errors_carry_state_and_history(kind):
    error = kind("no", history=[1.0, 0.5], state="last")
    assert error.history == [1.0, 0.5]
    assert error.state == "last"
    assert kind("no").state is None


def test_attributes_of_subclasses_survive():
    copy = pickle.loads(pickle.dumps(Refined("message", index=3)))
    assert copy.index == 3
    assert str(copy) == "message"


class Refined(errors.NotConverged):
    def __init__(self, message, *, index):
        super().__init__(message, history=[1])
        self.index = index
