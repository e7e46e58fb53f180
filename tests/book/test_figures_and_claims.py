"""The written chapters keep their promises: every claim is recorded, every panel has a figure."""

import re
from pathlib import Path

import pytest

from lissome import literature, scoreboard

BOOK = Path(__file__).resolve().parents[2] / "book"
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in BOOK.glob("[0-9a-z]-*.md")}
CELL = re.compile(r"^```\{code-cell\}.*?^```$", re.DOTALL | re.MULTILINE)


def _labels(text):
    """Return all labels that a page defines: figures, tables, equations, sections."""
    found = set(re.findall(r"^\s*:?name: *([\w.-]+)", text, re.MULTILINE))
    found |= set(re.findall(r"^\$\$ *\(([\w.-]+)\)", text, re.MULTILINE))
    found |= set(re.findall(r"^\(([\w.-]+)\)=", text, re.MULTILINE))
    found |= set(re.findall(r'"((?:tab|fig)-[\w.-]+)"', text))  # names passed to a table's maker
    return found


@pytest.mark.parametrize("page", sorted(PAGES))
def test_every_claim_of_a_page_is_recorded_there_once(page):
    cells = "\n".join(CELL.findall(PAGES[page]))
    recorded = re.findall(r'scoreboard\.record\(\s*"([\w-]+)"', cells)
    wanted = sorted(claim.id for claim in scoreboard.claims().values() if claim.page == page)
    assert sorted(recorded) == wanted


def test_every_panel_of_a_written_page_has_its_figure():
    frame = literature.load("figures").frame
    rows = frame[frame["page"].isin(list(PAGES))]

    for row in rows.itertuples():
        assert row.label in _labels(PAGES[row.page]), f"{row.panel}: {row.label} on {row.page}"


def test_evidence_of_the_errata_exists():
    frame = literature.load("errata").frame
    for row in frame.itertuples():
        page, _, label = row.evidence.partition("#")
        if label:
            assert label in _labels(PAGES[page]), row.evidence


@pytest.mark.parametrize("page", sorted(PAGES))
def test_no_outputs_are_committed_and_no_cell_is_hidden(page):
    text = PAGES[page]
    assert text.startswith("---\n")
    assert "format_name: myst" in text.split("---")[1]
    assert "remove-" not in text  # folded, never hidden
    assert "hide-cell" not in text


@pytest.mark.parametrize("page", sorted(PAGES))
def test_every_figure_carries_words(page):
    for cell in CELL.findall(PAGES[page]):
        shown = len(re.findall(r"plotting\.(?:show|show3d|animate)\(", cell))
        assert cell.count("alt=") >= shown


def test_errata_of_every_chapter_are_shown():
    shown = re.findall(r":chapter: (\S+)", (BOOK / "errata.md").read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(set(literature.load("errata").columns["chapter"]))
