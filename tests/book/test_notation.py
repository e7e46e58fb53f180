"""The table of the notation names what exists."""

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

from lissome import literature

BOOK = Path(__file__).resolve().parents[2] / "book"
ROWS = literature.load("notation").frame.to_dict("records")


def resolved(name):
    """Return the object of a dotted name; a field of a dataclass counts as its attribute."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        break
    for part in parts[count:]:
        if dataclasses.is_dataclass(found) and part in {f.name for f in dataclasses.fields(found)}:
            found = part
        else:
            found = getattr(found, part)
    return found


@pytest.mark.parametrize("name", sorted({row["name"] for row in ROWS}))
def test_names_exist_and_are_public(name):
    assert name.startswith("lissome.")
    assert not any(part.startswith("_") for part in name.split("."))
    assert resolved(name) is not None


def test_names_that_do_not_exist_are_noticed():
    with pytest.raises(AttributeError):
        resolved("lissome.beams.ClampedStrip.no_such_name")


def test_equations_exist():
    pages = "\n".join(path.read_text("utf-8") for path in BOOK.glob("[0-9a-z]-*.md"))
    labels = set(re.findall(r"^\$\$ *\(([\w.-]+)\)", pages, re.MULTILINE))
    for row in ROWS:
        assert not row["equation"] or row["equation"] in labels, row


def test_a_part_has_a_symbol_once_and_says_its_unit():
    for part in {row["part"] for row in ROWS}:
        symbols = [row["symbol"] for row in ROWS if row["part"] == part and row["symbol"]]
        assert len(symbols) == len(set(symbols))
    for row in ROWS:
        assert row["measured_in"]
        assert row["symbol"].count("$") % 2 == 0
