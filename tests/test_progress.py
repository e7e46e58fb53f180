"""Long work says how far it is, if one asks or sits at a terminal."""

import io

import numpy as np
import pytest

import lissome as ls
from lissome import _progress
from lissome.errors import InvalidInput


def fork(p):
    return ls.DenseStructure(
        initial=[0.0], energy=lambda x: x[0] ** 4 / 4 + (1 - p) * x[0] ** 2 / 2,
        gradient=lambda x: x**3 + (1 - p) * x, hessian=lambda x: np.diag(3 * x**2 + 1 - p),
    )  # fmt: skip


class Tilted:
    def structure(self, tilt):
        return ls.DenseStructure(
            initial=[-1.0], energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 - tilt * x[0],
            gradient=lambda x: x**3 - x - tilt, hessian=lambda x: np.diag(3 * x**2 - 1),
        )  # fmt: skip

    def advance(self, tilt, time, step, before, after):
        return tilt + step


def followed(**options):
    return ls.follow(fork, start=0.0, stop=2.0, **options)


def switched(**options):
    branch = followed(progress=False)
    return branch.switch(branch.events[0], **options)


def evolved(**options):
    start = ls.equilibrate(Tilted().structure(0.0))
    return ls.evolve(Tilted(), 0.0, start, until=0.75, step=0.05, **options)


def swept(**options):
    return ls.sweep(lambda a: {"b": a}, {"a": [1, 2]}, executor="serial", **options)


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def at_once(monkeypatch):
    """Show bars without the delay that spares short work one."""
    monkeypatch.setattr(_progress, "_DELAY", 0.0)


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (followed, ["follow", "steps", "parameter 2"]),
        (switched, ["follow", "steps", "parameter"]),
        (evolved, ["evolve", "100%", "0.75 of 0.75"]),
        (swept, ["100%", "2/2"]),
    ],
)
def test_who_asks_sees_how_far_the_work_is(work, words, at_once, capsys):
    work(progress=True)
    shown = capsys.readouterr().err
    assert all(word in shown for word in words)


@pytest.mark.parametrize("work", [followed, switched, evolved, swept])
def test_bars_are_for_terminals_and_can_be_turned_off(work, at_once, monkeypatch):
    for stream, options, shown in (
        (Terminal(), {}, True), (io.StringIO(), {}, False), (Terminal(), {"progress": False}, False),
    ):  # fmt: skip
        monkeypatch.setattr("sys.stderr", stream)
        work(**options)
        assert bool(stream.getvalue()) is shown


def test_short_work_shows_nothing(capsys):
    followed(progress=True)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("work", [followed, switched, evolved, swept])
def test_progress_is_yes_no_or_none(work):
    with pytest.raises(InvalidInput, match="`progress` is 'yes'"):
        work(progress="yes")
