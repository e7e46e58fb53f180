"""Tables of the pages, and what a failed assertion says."""

import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from lissome.errors import InvalidInput
from lissome.notebook import table

BOOK = Path(__file__).parents[1] / "book"
BEGIN = "from lissome.notebook import explain_assertions\nexplain_assertions()\n"
NOTE = "After a change of parameters the statement need not hold"


def test_cells_stand_under_their_titles():
    text = table(
        [("one", 1, 2.5), ("two", 2, None)], ("name", "$n$", "x"), "Numbers", "tab-a1"
    ).markdown
    lines = text.splitlines()
    assert lines[0] == ":::{table} Numbers" and lines[1] == ":name: tab-a1" and lines[-1] == ":::"
    assert [re.split(r" *\| *", line)[1:-1] for line in lines[3:-1]] == [
        ["name", "$n$", "x"], [":---", ":---:", ":---:"], ["one", "1", "2.5"], ["two", "2", "None"],
    ]  # fmt: skip


def test_numbers_stand_in_the_middle_and_columns_where_one_wants_them():
    assert "\n| :---: | :---: |\n" in table([(1, 2)], ("a", "b"), "c", "n").markdown
    assert (
        "\n| ---: | :--- |\n" in table([(1, 2)], ("a", "b"), "c", "n", ("right", "left")).markdown
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rows": []}, "`rows` is empty"),
        ({"rows": [(1, 2), (1, 2, 3)]}, "3 cells in row 1"),
        ({"header": ()}, "`header` is empty"),
        ({"caption": " "}, "`caption`"),
        ({"caption": "two\nlines"}, "`caption`"),
        ({"name": "Tab 1"}, "`name` is 'Tab 1'"),
        ({"align": ("left",)}, "`align` has 1 entries"),
        ({"align": ("left", "middle")}, "`align`"),
    ],
)
def test_what_cannot_stand_in_a_table_is_named(change, words):
    right = {"rows": [(1, 2)], "header": ("a", "b"), "caption": "c", "name": "tab-n"}
    with pytest.raises(InvalidInput, match=re.escape(words)):
        table(**right | change)


def run(*cells):
    """Execute a notebook of these cells, and return the error that stopped it."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    with pytest.raises(CellExecutionError) as stopped:
        NotebookClient(notebook, kernel_name="python3", timeout=120).execute()
    return stopped.value


def test_a_failed_assertion_of_a_notebook_says_what_it_means_and_stops_it():
    error = run(
        BEGIN, "length = 3\nassert length < 2, 'too long'", "raise ValueError('not reached')"
    )
    assert error.ename == "AssertionError"
    assert "too long" in str(error)
    assert NOTE in str(error)


def test_assertions_of_libraries_and_other_errors_are_left_alone():
    far = "import unittest\nunittest.TestCase().assertEqual(1, 2)"
    assert NOTE not in str(run(BEGIN, far))
    assert NOTE not in str(run(BEGIN, "1 / 0"))


def test_a_script_says_the_same(tmp_path):
    script = tmp_path / "page.py"
    script.write_text(BEGIN + BEGIN + "assert 1 > 2\n", encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "assert 1 > 2" in done.stderr
    assert done.stderr.count(NOTE) == 1


def test_pages_that_assert_explain_it():
    places = {}
    for page in BOOK.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        if first := re.search(r"^\s*assert ", text, re.MULTILINE):
            places[page.stem] = (text.find("\nexplain_assertions()\n"), first.start())
    assert len(places) > 10
    assert [page for page, (told, first) in places.items() if not 0 <= told < first] == []
