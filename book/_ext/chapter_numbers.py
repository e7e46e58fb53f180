"""Sphinx extension: chapters carry the thesis's numbers, whatever stands before them.

The number is the prefix of the file name: sections, figures and equations of
``3-photomechanical-beams.md`` are 3.1, 3.2, ..., those of ``a-strain-gradients.md`` A.1, A.2, ...
Pages nested below a chapter are sections of it; pages side by side that share a prefix continue one
another's sections.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.environment.collectors.toctree import TocTreeCollector

PREFIX = re.compile(r"(?:.*/)?(\d+|[a-z])-[^/]*$")


def chapter_of(docname):
    """Return the chapter that a page belongs to: an integer, a capital letter, or None."""
    match = PREFIX.match(docname)
    if match is None:
        return None
    label = match.group(1)
    return int(label) if label.isdigit() else label.upper()


def renumber(env):
    """Replace the running number of each numbered page by the number of its chapter."""
    sections = {}
    for docname, numbers in env.toc_secnumbers.items():
        chapter = chapter_of(docname)
        if chapter is None:
            continue
        nested = len(numbers.get("") or ()) > 1
        before = 0 if nested else sections.get(chapter, 0)

        def corrected(number, chapter=chapter, before=before):
            if not number:
                return number
            second = tuple(n + before for n in number[1:2])
            return (chapter, *second, *number[2:])

        env.toc_secnumbers[docname] = {a: corrected(n) for a, n in numbers.items()}
        used = [n[1] for n in env.toc_secnumbers[docname].values() if n and len(n) > 1]
        sections[chapter] = max([sections.get(chapter, 0), *used])
        for reference in env.tocs[docname].findall(nodes.reference):
            if reference.get("secnumber"):
                reference["secnumber"] = list(corrected(tuple(reference["secnumber"])))
        title = env.titles[docname]
        if title.get("secnumber"):
            title["secnumber"] = list(corrected(tuple(title["secnumber"])))


def setup(app):
    original = TocTreeCollector.assign_figure_numbers
    if not getattr(original, "by_chapter", False):

        def assign_figure_numbers(self, env):
            # Sections have just got their numbers, in ways that Jupyter Book's extensions replace
            # several times over; figures and equations get theirs now, from those of the sections.
            renumber(env)
            return original(self, env)

        assign_figure_numbers.by_chapter = True
        TocTreeCollector.assign_figure_numbers = assign_figure_numbers
    return {"parallel_read_safe": True, "parallel_write_safe": True}
