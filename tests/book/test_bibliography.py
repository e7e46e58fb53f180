"""The bibliography builds without a warning, and says how each record was verified."""

import re
from pathlib import Path

import pybtex.errors
import pytest
from pybtex.backends.plaintext import Backend
from pybtex.database import parse_file
from pybtex.plugin import find_plugin

BIBLIOGRAPHY = Path(__file__).resolve().parents[2] / "book" / "references.bib"
PRINTED = {
    **{"article": {"author", "title", "journal", "year"}},
    **{"book": {"author", "title", "publisher", "year"}},
    **{"phdthesis": {"author", "title", "school", "year"}, "misc": {"title", "howpublished"}},
}


@pytest.fixture(scope="module")
def entries():
    with pybtex.errors.capture() as problems:
        parsed = parse_file(str(BIBLIOGRAPHY), "bibtex").entries
    assert problems == []
    return parsed


@pytest.mark.parametrize("style", ["plain", "unsrt", "alpha"])
def test_every_entry_can_be_formatted(entries, style):
    formatter = find_plugin("pybtex.style.formatting", style)()
    with pybtex.errors.capture() as problems:
        formatted = list(formatter.format_entries(entries.values()))
        texts = [entry.text.render(Backend()) for entry in formatted]
    assert problems == []
    assert len(texts) == len(entries)
    assert all(len(text) > 30 for text in texts)


def test_no_required_field_is_missing(entries):
    for key, entry in entries.items():
        have = set(entry.fields) | set(entry.persons)
        missing = PRINTED[entry.type] - have
        assert not missing, (key, missing)


def test_every_entry_says_how_it_was_verified(entries):
    for key, entry in entries.items():
        how = entry.fields.get("verification", "")
        assert len(how) > 8, key
        assert not re.search(r"https?:|(?<!\w)/\w|memory", how), key  # no address, no path
        if "not seen" in how:
            assert entry.fields["note"].startswith("record "), key  # the reader is told, too


def test_addresses_are_dois(entries):
    dois = [entry.fields["doi"] for entry in entries.values() if "doi" in entry.fields]
    assert len(dois) == len(set(dois)) > 10
    assert all(re.fullmatch(r"10\.\d{4,9}/\S+", doi) for doi in dois)
    assert not any("url" in entry.fields for entry in entries.values())
