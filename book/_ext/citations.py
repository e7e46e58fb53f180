"""Sphinx extension: author and year, in the text and in the list of references alike."""

from __future__ import annotations

from collections import Counter

from pybtex.plugin import register_plugin
from pybtex.style.formatting.unsrt import Style as UnsrtStyle
from pybtex.style.labels import BaseLabelStyle
from sphinx.util import logging

logger = logging.getLogger(__name__)


def label_of(entry):
    """Return the label of an entry: names as the author-year references in the text write them."""
    people = entry.persons.get("author") or entry.persons.get("editor") or []
    names = [" ".join([*person.prelast_names, *person.last_names]) for person in people]
    if not names:
        names = [entry.fields.get("organization") or entry.fields.get("title", entry.key)]
    if len(names) == 1:
        who = names[0]
    elif len(names) == 2:
        who = f"{names[0]} and {names[1]}"
    else:
        who = f"{names[0]} et al."
    return f"{who}, {entry.fields.get('year', 'no year')}"


class AuthorYearLabels(BaseLabelStyle):
    """Labels such as ``Strang and Fix, 1973``; two entries of one label are a mistake."""

    def format_labels(self, sorted_entries):
        entries = list(sorted_entries)
        labels = [label_of(entry) for entry in entries]
        for label, count in Counter(labels).items():
            if count > 1:
                keys = ", ".join(e.key for e, x in zip(entries, labels, strict=True) if x == label)
                logger.warning(
                    "references %s are both [%s]: write year = {2001a}, {2001b} in references.bib",
                    keys,
                    label,
                )
        return labels


class Style(UnsrtStyle):
    """The plain entries, sorted by author, then year."""

    default_label_style = AuthorYearLabels
    default_sorting_style = "author_year_title"

    def __init__(self, label_style=None, **options):
        super().__init__(label_style=AuthorYearLabels, **options)


def setup(app):
    register_plugin("pybtex.style.formatting", "lissome", Style, force=True)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
