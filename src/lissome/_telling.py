"""Warnings of one kind once for each call of the user, at the line of the user."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from contextvars import ContextVar
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

#: The kinds of warnings that the outermost call that runs has given; None outside of any.
_given: ContextVar[set[str] | None] = ContextVar("_given", default=None)
_PACKAGE = os.path.dirname(os.path.abspath(__file__)) + os.sep


def one_call(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function within which each kind of warning is given once.

    Examples
    --------
    >>> from lissome._telling import is_news, one_call
    >>> @one_call
    ... def search():
    ...     return [is_news("a band has passed through itself") for _ in range(3)]
    >>> search(), search()
    ([True, False, False], [True, False, False])
    """

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if _given.get() is not None:
            return function(*args, **kwargs)
        token = _given.set(set())
        try:
            return function(*args, **kwargs)
        finally:
            _given.reset(token)

    return call


def is_news(kind: str) -> bool:
    """Return whether the call that runs has not asked this before: always, outside of calls."""
    given = _given.get()
    if given is None:
        return True
    if kind in given:
        return False
    given.add(kind)
    return True


def user_level() -> int:
    """Return the `stacklevel` at which a warning of the caller shows the line of the user."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    return level
