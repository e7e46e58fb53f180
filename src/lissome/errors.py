"""Exceptions and warnings of the library.

Every exception derives from :class:`LissomeError`, and also from the built-in class that a caller
who does not know the library would expect (``ValueError``, ``RuntimeError``, ...). All of them can
be pickled with everything they carry, since sweeps raise them in other processes.
"""

from __future__ import annotations

from typing import Any

__all__ = [
    "CacheWarning",
    "DataAwaited",
    "DataError",
    "FactorizationError",
    "InvalidInput",
    "LissomeError",
    "LissomeWarning",
    "NotConverged",
    "StabilityNotResolvable",
    "SweepFailed",
    "Unstable",
]


class LissomeError(Exception):
    """Base class of every exception that the library raises on purpose.

    Examples
    --------
    >>> from lissome.errors import InvalidInput, LissomeError
    >>> issubclass(InvalidInput, LissomeError) and issubclass(InvalidInput, ValueError)
    True
    """

    def __reduce__(self) -> tuple[Any, ...]:
        # Keyword-only attributes do not pass through ``args``: rebuild without calling __init__.
        return _rebuild, (type(self), self.args, dict(self.__dict__))


def _rebuild(
    kind: type[LissomeError], args: tuple[Any, ...], attributes: dict[str, Any]
) -> LissomeError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class InvalidInput(LissomeError, ValueError):
    """An argument is wrong; the message names it, its value and what to pass instead."""


class NotConverged(LissomeError, RuntimeError):
    """An iteration ended without a solution.

    Parameters
    ----------
    message : str
        What did not converge, how far it got, and what to try.
    history : object, optional
        Record of the iterations (residuals, steps, inertia), for diagnosis.
    state : object, optional
        The last iterate. It is not a solution.

    Attributes
    ----------
    history, state : object or None
        As passed.
    """

    def __init__(self, message: str = "", *, history: Any = None, state: Any = None) -> None:
        super().__init__(message)
        self.history = history
        self.state = state


class Unstable(LissomeError, RuntimeError):
    """A stationary point was found, but it is not a minimum.

    Parameters
    ----------
    message : str
        How many unstable directions there are, and what to try.
    state : object, optional
        The stationary point.
    history : object, optional
        Record of the iterations.

    Attributes
    ----------
    state, history : object or None
        As passed.
    """

    def __init__(self, message: str = "", *, state: Any = None, history: Any = None) -> None:
        super().__init__(message)
        self.state = state
        self.history = history


class StabilityNotResolvable(LissomeError, RuntimeError):
    """Rounding errors hide the sign of an eigenvalue, so that no verdict on stability is given.

    Parameters
    ----------
    message : str
        Which pivot or eigenvalue, its size, and the round-off floor that it does not exceed.
    state : object, optional
        The stationary point.
    history : object, optional
        Record of the iterations.

    Attributes
    ----------
    state, history : object or None
        As passed.
    """

    def __init__(self, message: str = "", *, state: Any = None, history: Any = None) -> None:
        super().__init__(message)
        self.state = state
        self.history = history


class FactorizationError(LissomeError, ArithmeticError):
    """A matrix could not be factored: it is singular, not finite, or its factors grow too much."""


class SweepFailed(LissomeError, RuntimeError):
    """A point of a sweep failed; the cache, if there is one, keeps the points that had finished.

    Parameters
    ----------
    message : str
        Which point failed and how.
    point : mapping, optional
        The arguments of the point.
    finished : pandas.DataFrame, optional
        The points that had finished, as `lissome.sweep` would have returned them.

    Attributes
    ----------
    point, finished : object or None
        As passed. The exception of the function itself is the ``__cause__``.
    """

    def __init__(self, message: str = "", *, point: Any = None, finished: Any = None) -> None:
        super().__init__(message)
        self.point = point
        self.finished = finished


class DataError(LissomeError):
    """Stored data are unknown, damaged, or do not match their description."""


class DataAwaited(DataError):
    """A documented slot for data that nobody has registered yet."""


class LissomeWarning(UserWarning):
    """Base class of every warning of the library."""


class CacheWarning(LissomeWarning):
    """A cache cannot be used; results are right, but are computed anew."""
