"""Checks of user input, shared by every module.

Each function returns the checked value in its canonical type, or raises
:class:`~lissome.errors.InvalidInput` with the name of the argument, its value and the remedy.
Booleans, strings and complex numbers are not numbers here: they are always mistakes.
"""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InvalidInput

__all__ = [
    "PLAIN",
    "finite",
    "finite_array",
    "functions",
    "in_open_interval",
    "integer_at_least",
    "moderate",
    "nonnegative",
    "one_of",
    "positive",
    "structure_like",
]

_LONGEST_REPR = 80
#: Between these lie the quantities of a problem: products of powers of a few of
#: them, such as stiffnesses of ribbons, stay within the range of floats.
LARGEST, SMALLEST = 1e60, 1e-60
#: Kinds of values that are hardly ever states.
PLAIN = (numbers.Number, str, Sequence, Mapping, np.ndarray)


def _shown(value: Any) -> str:
    """Return a representation of `value` that fits into a message."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.ndim > 0 and value.size > 6:
        return f"an array of shape {value.shape} and type {value.dtype}"
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_REPR else text[: _LONGEST_REPR - 3] + "..."


def finite(name: str, value: Any, *, unit: str = "", largest: float = LARGEST) -> float:
    """Return `value` as a finite ``float``.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        A real number; numpy scalars and arrays of shape ``()`` will do.
    unit : str, optional
        Unit, for the message.
    largest : float, optional
        Refused beyond.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If `value` is not a real number, is not finite, or is absurdly large.

    Examples
    --------
    >>> finite("angle", 1)
    1.0
    >>> finite("angle", float("nan"))
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `angle` is nan; pass a finite number
    """
    # The usual case; false of what is not a number. `largest` may be infinite.
    if type(value) is float and abs(value) <= largest and math.isfinite(value):
        return value
    wanted = f"pass a finite number{f' ({unit})' if unit else ''}"
    item = value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        item = value[()]
    if isinstance(item, (bool, np.bool_)) or not isinstance(item, numbers.Real):
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)} of type {type(value).__name__}; {wanted}"
        )
    try:
        number = float(item)
    except (OverflowError, ValueError):
        number = math.inf
    if not math.isfinite(number):
        raise InvalidInput(f"argument `{name}` is {_shown(value)}; {wanted}")
    if abs(number) > largest:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; use units in which it is at most {largest:g}"
        )
    return number


def moderate(name: str, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return an array of finite numbers, or raise :class:`InvalidInput` if one is absurdly large.

    Examples
    --------
    >>> moderate("load", np.array([1.0, -1e300]))
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `load` holds -1e+300; use units in which it is at most 1e+60
    """
    if np.max(np.abs(values), initial=0.0) > LARGEST:
        worst = float(values.ravel()[np.argmax(np.abs(values))])
        raise InvalidInput(
            f"argument `{name}` holds {worst:g}; use units in which it is at most {LARGEST:g}"
        )
    return values


def positive(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite ``float`` greater than zero, or raise :class:`InvalidInput`.

    Examples
    --------
    >>> positive("length", -2, unit="m")
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `length` is -2; it must be greater than 0 m
    """
    number = finite(name, value, unit=unit)
    if number <= 0.0:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; it must be greater than 0{_space(unit)}"
        )
    if number < SMALLEST:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; use units in which it is at least {SMALLEST:g}"
        )
    return number


def nonnegative(name: str, value: Any, unit: str = "", largest: float = LARGEST) -> float:
    """Return `value` as a finite ``float`` that is zero or greater, or raise :class:`InvalidInput`.

    Examples
    --------
    >>> nonnegative("intensity", 0)
    0.0
    """
    number = finite(name, value, unit=unit, largest=largest)
    if number < 0.0:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; it must be at least 0{_space(unit)}"
        )
    return number


def in_open_interval(name: str, value: Any, low: float, high: float, remedy: str = "") -> float:
    """Return `value` as a ``float`` strictly between `low` and `high`, or raise :class:`InvalidInput`.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : object
        The number to check.
    low, high : float
        Ends of the interval, themselves excluded; they may be infinite.
    remedy : str, optional
        What the user should do, or what the bound means.

    Examples
    --------
    >>> in_open_interval("span", 1.2, 0, 1, "clamps nearer than the strip is long")
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `span` is 1.2; it must lie in (0, 1): clamps nearer than the strip is long
    """  # noqa: E501
    number = finite(name, value)
    if not low < number < high:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; it must lie in ({low:g}, {high:g})"
            f"{f': {remedy}' if remedy else ''}"
        )
    return number


def integer_at_least(name: str, value: Any, minimum: int) -> int:
    """Return `value` as an ``int`` not less than `minimum`, or raise :class:`InvalidInput`.

    A float is refused even if it is whole: ``segments=1e2`` is more often a slip than a wish.

    Examples
    --------
    >>> integer_at_least("segments", 100, 2)
    100
    >>> integer_at_least("segments", 1, 2)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `segments` is 1; it must be an integer of at least 2
    """
    item = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    if (
        isinstance(item, (bool, np.bool_))
        or not isinstance(item, numbers.Integral)
        or int(item) < minimum
    ):
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}; it must be an integer of at least {minimum}"
        )
    return int(item)


def one_of(name: str, value: Any, choices: Iterable[str]) -> str:
    """Return `value` if it is one of the strings `choices`, or raise :class:`InvalidInput`.

    Examples
    --------
    >>> one_of("side", "abov", ["above", "below"])
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `side` is 'abov'; it must be one of 'above', 'below' (did you mean 'above'?)
    """  # noqa: E501
    known = list(choices)
    if isinstance(value, str) and value in known:
        return str(value)
    message = (
        f"argument `{name}` is {_shown(value)}; it must be one of {', '.join(map(repr, known))}"
    )
    near = difflib.get_close_matches(value.lower(), known, 1) if isinstance(value, str) else []
    if near:
        message += f" (did you mean {near[0]!r}?)"
    raise InvalidInput(message)


def finite_array(
    name: str,
    value: Any,
    shape: Sequence[int | None] | None = None,
    dtype: npt.DTypeLike = float,
) -> npt.NDArray[Any]:
    """Return `value` as a new, contiguous array of finite numbers.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like
        Real numbers.
    shape : sequence of int or None, optional
        Required shape; ``None`` in it stands for any length. Without it any shape is taken.
    dtype : dtype, optional
        ``float`` (default) or an integer type; an integer type refuses numbers that are not whole.

    Returns
    -------
    numpy.ndarray
        A copy in C order, which the caller may freeze or change.

    Raises
    ------
    InvalidInput
        If `value` is ragged, holds anything but finite real numbers, or has another shape.

    Examples
    --------
    >>> finite_array("positions", [[0, 0], [1, 0]], shape=(None, 2))
    array([[0., 0.],
           [1., 0.]])
    >>> finite_array("positions", [1, 2, 3], shape=(None, 2))
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `positions` has shape (3,); it must have shape (any, 2)
    """
    try:
        raw = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}, which is not a regular array ({error}); "
            "pass nested sequences of equal lengths"
        ) from error
    if raw.dtype == object and raw.size:
        # Python integers beyond 64 bits and fractions arrive as objects: take them one by one.
        if not all(
            isinstance(item, numbers.Real) and not isinstance(item, (bool, np.bool_))
            for item in raw.flat
        ):
            raise InvalidInput(
                f"argument `{name}` is {_shown(value)}, which holds things that are not real "
                "numbers; pass an array of finite numbers"
            )
        try:
            raw = raw.astype(float)
        except (OverflowError, ValueError):
            raise InvalidInput(
                f"argument `{name}` is {_shown(value)}, which holds numbers that no float can "
                "hold; pass an array of finite numbers"
            ) from None
    if raw.size and raw.dtype.kind not in "iuf":
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)} of type {raw.dtype}; "
            "pass an array of finite real numbers"
        )
    if isinstance(value, (list, tuple)) and _holds_bool(value):
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}, which holds booleans; "
            "pass an array of finite real numbers"
        )
    if shape is not None:
        fits = raw.ndim == len(shape) and all(
            wanted is None or wanted == length
            for wanted, length in zip(shape, raw.shape, strict=True)
        )
        if not fits:
            named = ", ".join("any" if wanted is None else str(wanted) for wanted in shape)
            raise InvalidInput(
                f"argument `{name}` has shape {raw.shape}; it must have shape "
                f"({named}{',' if len(shape) == 1 else ''})"
            )
    if raw.dtype.kind == "f" and not np.isfinite(raw).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(raw))[0])
        where = f"[{', '.join(map(str, place))}]" if place else ""
        raise InvalidInput(
            f"argument `{name}`{where} is {_shown(raw[place])}; every entry must be finite"
        )
    target = np.dtype(dtype)
    if raw.dtype == target:
        return np.array(raw, order="C", copy=True)
    with np.errstate(over="ignore", invalid="ignore"):
        result = np.array(raw, dtype=target, order="C", copy=True)
    if target.kind in "iu" and not np.array_equal(result, raw):
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}, which {target} cannot hold exactly; "
            "pass whole numbers within its range"
        )
    if target.kind == "f" and not np.isfinite(result).all():
        raise InvalidInput(
            f"argument `{name}` is {_shown(value)}, which exceeds the range of {target}; "
            "rescale the numbers"
        )
    return result


def functions(name: str, value: Any) -> dict[str, Callable[..., Any]]:
    """Return a mapping of names to functions as a new ``dict``; None is the empty one.

    Examples
    --------
    >>> functions("outputs", {"one": float})
    {'one': <class 'float'>}
    >>> functions("outputs", float)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `outputs` is <class 'float'>; pass names with functions: {'name': function}
    """  # noqa: E501
    wanted = "pass names with functions: {'name': function}"
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InvalidInput(f"argument `{name}` is {_shown(value)}; {wanted}")
    for key, function in value.items():
        if not isinstance(key, str) or not callable(function):
            raise InvalidInput(
                f"argument `{name}` holds {_shown(key)}: {_shown(function)}; {wanted}"
            )
    return dict(value)


def structure_like(name: str, value: Any) -> Any:
    """Return `value` if it looks like a structure, or raise :class:`InvalidInput`.

    Examples
    --------
    >>> structure_like("structure", abs)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `structure` is <built-in function abs>, a function; pass the structure that it returns
    """  # noqa: E501
    if hasattr(value, "constraints_count") and hasattr(value, "evaluate"):
        return value
    remedy = "pass a structure, such as a rod, a ribbon or a plate"
    if callable(value):
        remedy = "a function; pass the structure that it returns"
    elif hasattr(value, "structure"):
        remedy = "which is no structure but has one; pass its `structure`"
    middle = "; " if remedy.startswith("pass") else ", "
    raise InvalidInput(f"argument `{name}` is {_shown(value)}{middle}{remedy}")


def _holds_bool(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return any(_holds_bool(item) for item in value)
    return isinstance(value, (bool, np.bool_))


def _space(unit: str) -> str:
    return f" {unit}" if unit else ""
