"""Results that are computed when they are asked for, once, and that nobody can change."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from operator import is_
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["readonly", "readonly_property", "recalled"]

T = TypeVar("T")


class readonly_property(cached_property[T]):
    """A cached property whose arrays cannot be written: what is cached is shared by all who ask.

    Examples
    --------
    >>> class Square:
    ...     @readonly_property
    ...     def corners(self):
    ...         return np.zeros((4, 2))
    >>> square = Square()
    >>> square.corners is square.corners, square.corners.flags.writeable
    (True, False)
    """

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> Any:
        value = super().__get__(instance, owner)
        if instance is not None:
            _freeze(value)
        return value


def readonly(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of `array` that cannot be written.

    Examples
    --------
    >>> own = np.zeros(3)
    >>> readonly(own).flags.writeable, own.flags.writeable
    (False, True)
    """
    view = array.view()
    view.flags.writeable = False
    return view


def recalled(
    known: dict[str, Any], name: str, sources: tuple[Any, ...], make: Callable[[], T]
) -> T:
    """Return what `make` made last of the very same `sources`, objects that nobody changes; else make it.

    Parameters
    ----------
    known : dict
        What was made last, by name; structures that are made from one another share it.
    name : str
        Of the result.
    sources : tuple
        All that the result depends on. They are compared by identity.
    make : callable
        Makes the result.

    Examples
    --------
    >>> known, lengths = {}, np.array([1.0, 2.0])
    >>> ends = recalled(known, "ends", (lengths,), lambda: np.cumsum(lengths))
    >>> ends is recalled(known, "ends", (lengths,), lambda: np.cumsum(lengths))
    True
    """
    found = known.get(name)
    if found is None or not all(map(is_, found[0], sources)):
        found = known[name] = (sources, make())
    result: T = found[1]
    return result


def _freeze(value: Any) -> None:
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, tuple):
        for item in value:
            _freeze(item)
