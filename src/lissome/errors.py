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
    """An argument is wrong; the message names it, its value and what to pass instead.

    Examples
    --------
    >>> from lissome.structure import VectorState
    >>> VectorState([[1.0, 2.0]])
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `x` has shape (1, 2); a VectorState holds a vector...
    """


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

    Examples
    --------
    The energy :math:`-x` has no minimum; the last state tells where the search was given up:

    >>> import lissome as ls
    >>> slope = ls.DenseStructure([0.0], lambda x: -x[0], lambda x: [-1.0], lambda x: [[0.0]])
    >>> try:
    ...     ls.equilibrate(slope, max_iterations=10)
    ... except ls.NotConverged as error:
    ...     print(error.state.x[0] > 1e3, len(error.history))
    True 10
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

    Examples
    --------
    A Hessian of the wrong sign, with its check switched off, makes a saddle of a minimum. No step
    leaves it, since the energy grows on all sides:

    >>> import lissome as ls
    >>> well = ls.DenseStructure(
    ...     [0.0], lambda x: x[0] ** 2, lambda x: 2 * x, lambda x: [[-2.0]], check=False
    ... )
    >>> try:
    ...     ls.equilibrate(well)
    ... except ls.Unstable as error:
    ...     print(error.state.x)
    [0.]
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

    Examples
    --------
    At the bottom of :math:`x^4` the second variation vanishes, and with it the verdict:

    >>> import lissome as ls
    >>> flat = ls.DenseStructure(
    ...     [0.0], lambda x: x[0] ** 4, lambda x: 4 * x**3, lambda x: [[12 * x[0] ** 2]]
    ... )
    >>> try:
    ...     ls.equilibrate(flat)
    ... except ls.StabilityNotResolvable as error:
    ...     print(error.state.x)
    [0.]
    """

    def __init__(self, message: str = "", *, state: Any = None, history: Any = None) -> None:
        super().__init__(message)
        self.state = state
        self.history = history


class FactorizationError(LissomeError, ArithmeticError):
    """A matrix could not be factored: it is singular, not finite, or its factors grow too much.

    Examples
    --------
    Two constraints that say the same leave the forces of constraint undetermined:

    >>> from lissome.factorization import DenseKKT
    >>> DenseKKT([[1.0]], jacobian=[[1.0], [1.0]]).factorize().solve([1.0])
    Traceback (most recent call last):
        ...
    lissome.errors.FactorizationError: the KKT matrix is singular to working precision...
    """


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

    Examples
    --------
    >>> import lissome as ls
    >>> def reciprocal(x):
    ...     return {"value": 1 / x}
    >>> try:
    ...     ls.sweep(reciprocal, {"x": [1, 0]}, executor="serial")
    ... except ls.SweepFailed as error:
    ...     print(error.point, type(error.__cause__).__name__)
    {'x': 0} ZeroDivisionError
    """

    def __init__(self, message: str = "", *, point: Any = None, finished: Any = None) -> None:
        super().__init__(message)
        self.point = point
        self.finished = finished


class DataError(LissomeError):
    """Stored data are unknown, damaged, or do not match their description.

    Examples
    --------
    >>> from lissome import literature
    >>> literature.load("thesis-tabel-3-1")
    Traceback (most recent call last):
        ...
    lissome.errors.DataError: ...there is no table 'thesis-tabel-3-1'; did you mean 'thesis-table-3-1'...
    """


class DataAwaited(DataError):
    """A documented slot for data that nobody has registered yet.

    Examples
    --------
    Points that nobody has read off a figure yet are no damage; the message says how to add them:

    >>> from lissome import literature
    >>> from lissome.errors import DataAwaited
    >>> def points(slot):
    ...     try:
    ...         return len(literature.load(slot).frame)
    ...     except DataAwaited:
    ...         return 0
    >>> sum(points(slot) for slot in literature.awaited())
    0
    """


class LissomeWarning(UserWarning):
    """Base class of every warning of the library.

    Examples
    --------
    All warnings of the library, and no others, become errors:

    >>> import warnings
    >>> from lissome.errors import CacheWarning, LissomeWarning
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", LissomeWarning)
    ...     warnings.warn("the folder is read-only", CacheWarning)
    Traceback (most recent call last):
        ...
    lissome.errors.CacheWarning: the folder is read-only
    """


class CacheWarning(LissomeWarning):
    """A cache cannot be used; results are right, but are computed anew.

    Examples
    --------
    On a machine without a folder to write to this is known, and may be left unsaid:

    >>> import warnings
    >>> from lissome.errors import CacheWarning, LissomeWarning
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     warnings.simplefilter("ignore", CacheWarning)
    ...     warnings.warn("no folder can be written to", CacheWarning)
    ...     warnings.warn("the ring crosses itself", LissomeWarning)
    >>> [str(warning.message) for warning in told]
    ['the ring crosses itself']
    """
