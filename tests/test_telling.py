"""Warnings come once for each call of the user, and show the line of the user."""

import inspect
import warnings

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons, rods
from lissome._telling import is_news, one_call, user_level
from lissome.errors import LissomeWarning


def told(call):
    """Return the warnings of the library that a call gives."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        call()
    return [one for one in found if issubclass(one.category, LissomeWarning)]


def test_news_once_for_each_outermost_call():
    @one_call
    def inner():
        return is_news("crossing"), is_news("hinge"), is_news("crossing")

    @one_call
    def outer():
        return inner(), inner()

    assert outer() == ((True, True, False), (False, False, False))
    assert inner() == (True, True, False)  # another call

    @one_call
    def fails():
        is_news("crossing")
        raise ValueError

    with pytest.raises(ValueError):
        fails()
    assert is_news("crossing") and is_news("crossing")  # outside of calls all is news
    assert user_level() == 1  # the caller is no part of the library


def test_a_band_that_passed_through_itself_is_told_once():
    band = ribbons.band(1.0, 120, ribbons.Wunderlich(width=0.1, rigidity=1.0), 3)
    found = told(lambda: ls.equilibrate(band))
    assert len(found) == 1
    assert "passed through itself" in str(found[0].message)
    assert found[0].filename == __file__
    assert (
        found[0].lineno
        == inspect.getsourcelines(test_a_band_that_passed_through_itself_is_told_once)[1] + 2
    )


def test_a_branch_of_rods_that_cross_themselves_is_told_once():
    """Its family solves each time for a start: each is told of where it is asked for, here once."""
    law = rods.Kirchhoff((1.0, 1.0), 1.0)

    def coil(angle):
        made = rods.arc(1.0, 60, law, angle=angle).clamped("start").clamped("end")
        ls.equilibrate(made)
        return made

    found = told(
        lambda: ls.follow(coil, start=13.0, stop=14.0, report_at=np.linspace(13.0, 14.0, 5))
    )
    assert len(found) == 1
    assert "passes through itself" in str(found[0].message)
    assert found[0].filename == __file__
    assert len(told(lambda: [ls.equilibrate(coil(a)) for a in (13.0, 13.5)])) == 4
