"""Sphinx extension: the scoreboard of the claims, and the table of errata.

Pages record facts while they run (``lissome.scoreboard``); pages are read in the order of their
names, so everything that shows a verdict is a placeholder until all of them have run.

* ``{scoreboard}`` is the table of all claims; ``:chapter:``, ``:page:`` and ``:verdict:`` select.
* ``{scoreboard-line}`` is the score in one sentence.
* The role ``{result}`` shows one recorded number: ``{result}`strip-best-angle-095```, and with
  ``:printed``, ``:independent``, ``:difference``, ``:verdict`` or ``:why`` behind the id another
  part of the record.
* ``{errata}`` is the table of errata, ``:chapter:`` selects; a row is the target ``erratum-<id>``.

A target ``(claim-<id>)=`` on a page is where the tables link to. The build folder gets
``scoreboard.csv``. A claim whose page is in the book but that has no record is a warning, which
fails a strict build.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from sphinx.errors import ExtensionError
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective, SphinxRole

from lissome import literature, scoreboard
from lissome._datapackage import data_folder
from lissome.errors import DataError, LissomeError
from lissome.scoreboard import FOLDER_VARIABLE, PAGE_VARIABLE, Row, Verdict

logger = logging.getLogger(__name__)

PARTS = ("computed", "printed", "independent", "difference", "verdict", "why")
CHAPTERS = {
    "1": "Introduction",
    "2": "Rods and plates",
    "3": "Photomechanical beams",
    "4": "Discrete rods and ribbons",
    "5": "Leaping plates",
    "A": "Appendix",
}
UNITS = {"": "", "1": "", "degree": "°", "B/L^2": " B/L²", "B/L^3": " B/L³"}
NOTHING = "–"  # where a claim has no number
PHRASES = {  # of one claim, of several
    Verdict.REPRODUCED: ("is reproduced", "are reproduced"),
    Verdict.CORRECTED: ("is reproduced after correction", "are reproduced after correction"),
    Verdict.DIFFERS: ("differs", "differ"),
    Verdict.UNDETERMINED: ("is not determined by the text", "are not determined by the text"),
    Verdict.AWAITS: ("awaits data", "await data"),
}


class Board(nodes.General, nodes.Element):
    """Where the table of claims will stand."""


class Line(nodes.General, nodes.Element):
    """Where the score will stand."""


class Result(nodes.Inline, nodes.TextElement):
    """Where one recorded number will stand."""


PLACEHOLDERS = (Board, Line, Result)


def _remember(env):
    env.metadata[env.docname]["scoreboard"] = True


class BoardDirective(SphinxDirective):
    option_spec: ClassVar = {
        "chapter": directives.unchanged_required,
        "page": directives.unchanged_required,
        "verdict": directives.unchanged_required,
    }

    def run(self):
        chapter, page = self.options.get("chapter"), self.options.get("page")
        verdict = self.options.get("verdict")
        claims = scoreboard.claims().values()
        for name, wanted, known in (
            ("chapter", chapter, {claim.chapter for claim in claims}),
            ("page", page, {claim.page for claim in claims}),
            ("verdict", verdict, {one.value for one in Verdict}),
        ):
            if wanted is not None and wanted not in known:
                raise self.error(f"no claim has the {name} {wanted!r}; known: {sorted(known)}")
        _remember(self.env)
        return [Board("", chapter=chapter, page=page, verdict=verdict)]


class LineDirective(SphinxDirective):
    def run(self):
        _remember(self.env)
        return [Line("")]


class ResultRole(SphinxRole):
    def run(self):
        claim, _, part = self.text.partition(":")
        part = part or "computed"
        known = scoreboard.claims()
        if claim not in known or part not in PARTS:
            wrong = f"claim {claim!r}" if claim not in known else f"part {part!r}"
            message = self.inliner.reporter.error(
                f"role result: unknown {wrong}; write claim or claim:part with one of {PARTS}",
                line=self.lineno,
            )
            return [self.inliner.problematic(self.rawtext, self.rawtext, message)], [message]
        _remember(self.env)
        return [Result("", "", claim=claim, part=part)], []


class ErrataDirective(SphinxDirective):
    option_spec: ClassVar = {"chapter": directives.unchanged_required}

    def run(self):
        try:
            columns = literature.load("errata").columns
        except DataError as error:
            raise self.error(str(error)) from error
        cells = zip(*columns.values(), strict=True)
        rows = [dict(zip(columns, row, strict=True)) for row in cells]
        self.env.note_dependency(str(data_folder() / "errata.csv"))
        chapter = self.options.get("chapter")
        if chapter is not None:
            if chapter not in CHAPTERS:
                raise self.error(f"no chapter {chapter!r}; known: {sorted(CHAPTERS)}")
            rows = [row for row in rows if row["chapter"] == chapter]
        container = nodes.container(classes=["errata"])
        if not rows:
            container += nodes.paragraph("", "No error has been entered here yet.")
            return [container]
        lines = [":::{list-table}", ":header-rows: 1", ":widths: 16 44 40", ""]
        for index, cell in enumerate(
            ("Place", "As printed, and as corrected", "Why, and evidence")
        ):
            lines.append(("* - " if index == 0 else "  - ") + cell)
        for row in rows:
            lines.append(f"* - [{row['place']}]{{#erratum-{row['id']}}}")
            lines += [f"  - *Printed:* {row['printed']}", ""]
            lines.append(f"    *Corrected:* {row['corrected']}")
            lines += [f"  - {row['why']}", "", f"    {evidence(row['evidence'])}"]
        lines.append(":::")
        self.state.nested_parse(StringList(lines, "data/errata.csv"), 0, container)
        return [container]


def evidence(text):
    """Return the Markdown of a piece of evidence: a test, or a label of a page."""
    if text.startswith("tests/"):
        return f"Test: `{text}`."
    _, _, label = text.partition("#")
    if label.startswith("eq-"):
        return f"Derived in equation {{eq}}`{label}`."
    return f"Shown {{ref}}`here <{label}>`."


# ------------------------------------------------------------------------------------ records


def _folder(app):
    return Path(os.environ[FOLDER_VARIABLE])


def _start(app):
    """Name the folder of the records; kernels inherit the variable."""
    if not os.environ.get(FOLDER_VARIABLE):
        os.environ[FOLDER_VARIABLE] = str(Path(app.outdir).parent / "scoreboard")


def _forget(app, env, docnames):
    """Delete the records of the pages that are about to run, and of pages that are gone."""
    for path in _folder(app).glob("*.json"):
        try:
            page = scoreboard._read_json(path)["page"]
        except DataError:
            page = None
        if page in docnames or page not in env.found_docs:
            path.unlink()


def _page_begins(app, docname, source):
    os.environ[PAGE_VARIABLE] = docname


def _page_ends(app, doctree):
    os.environ.pop(PAGE_VARIABLE, None)


def _judge(app, env):
    """Read and judge all records, after every page has run; return the pages to write again."""
    try:
        board = scoreboard.board(_folder(app), env.found_docs)
    except LissomeError as error:
        raise ExtensionError(f"scoreboard: {error}") from error
    rows = []
    for row in board.rows:
        try:
            _ = row.verdict, row.why
        except LissomeError as error:
            logger.warning("scoreboard: %s", error, location=row.claim.page)
            row = Row(row.claim, None)
        rows.append(row)
    for claim in board.missing:
        logger.warning(
            "scoreboard: the claim '%s' has no record; call scoreboard.record(%r, ...) on its page",
            claim.id,
            claim.id,
            location=claim.page,
        )
    app.lissome_board = scoreboard.Board(tuple(rows), board.missing)
    return [name for name, about in env.metadata.items() if about.get("scoreboard")]


def _write_csv(app, error):
    if error is None and app.builder.format == "html":
        text = app.lissome_board.to_csv()
        (Path(app.outdir) / "scoreboard.csv").write_text(text, encoding="utf-8")


# ------------------------------------------------------------------------------------ rendering


def _resolve(app, doctree, docname):
    board = app.lissome_board
    for node in list(doctree.findall(Board)):
        node.replace_self(_tables(app, docname, board, node))
    for node in list(doctree.findall(Line)):
        node.replace_self(_line(app, docname, board))
    for node in list(doctree.findall(Result)):
        node.replace_self(nodes.inline("", _part(board[node["claim"]], node["part"])))


def _part(row, part):
    unit = unit_of(row.claim)
    if part == "printed":
        return row.claim.printed + unit if row.claim.printed else "no number"
    if part == "verdict":
        return row.verdict.value
    if row.record is None:
        return "pending"
    if part == "why":
        return row.why
    methods = {
        "computed": row.record.computed,
        "independent": row.record.independently,
        "difference": row.record.difference,
    }
    text = methods[part]("unicode")
    return text + unit if text else "no number"


def unit_of(claim):
    """Return the unit as it stands behind a number."""
    return UNITS.get(claim.unit, f" {claim.unit}")


def _line(app, docname, board):
    counts = board.counts()
    said = [f"{counts[v]} {PHRASES[v][counts[v] > 1]}" for v in PHRASES if counts[v]]
    text = f"Of {len(board.rows)} claims of the thesis, "
    text += (", ".join(said) if said else "none has been judged") + "; "
    pending = counts[Verdict.PENDING]
    text += f"{pending} wait for chapters to come." if pending else "none is left."
    paragraph = nodes.paragraph("", text + " ", classes=["scoreboard-line"])
    if "scoreboard" in app.env.found_docs and docname != "scoreboard":
        address = app.builder.get_relative_uri(docname, "scoreboard")
        paragraph += nodes.reference("", "The scoreboard", refuri=address, internal=True)
        paragraph += nodes.Text(" says which, and why.")
    return paragraph


def _tables(app, docname, board, wanted):
    rows = [
        row
        for row in board.rows
        if wanted["chapter"] in (None, row.claim.chapter)
        and wanted["page"] in (None, row.claim.page)
        and wanted["verdict"] in (None, row.verdict.value)
    ]
    if not rows:
        return [nodes.paragraph("", "There is none.")]
    parts = []
    whole = wanted["chapter"] is wanted["page"] is wanted["verdict"] is None
    if whole:
        parts.append(_line(app, docname, board))
        parts.append(_download(app, docname))
    for name, title in CHAPTERS.items():
        own = [row for row in rows if row.claim.chapter == name]
        if not own:
            continue
        if whole:
            label = f"Chapter {name}: {title}" if name.isdigit() else f"{title} {name}"
            parts.append(nodes.rubric("", label))
        parts.append(_table(app, docname, own))
    return parts


def _download(app, docname):
    paragraph = nodes.paragraph("", "The same as a table for programs: ")
    if app.builder.format != "html":
        return nodes.paragraph("", "The HTML edition brings the same as scoreboard.csv.")
    address = "../" * docname.count("/") + "scoreboard.csv"
    paragraph += nodes.reference("", "scoreboard.csv", refuri=address, internal=False)
    paragraph += nodes.Text(
        ". The figure in parentheses is the uncertainty of the last digits shown."
    )
    return paragraph


def _table(app, docname, rows):
    table = nodes.table(classes=["scoreboard"])
    group = nodes.tgroup(cols=5)
    table += group
    for width in (34, 9, 13, 13, 31):
        group += nodes.colspec(colwidth=width)
    head = nodes.thead()
    group += head
    titles = ("Claim", "Printed", "Computed", "Independent", "Verdict")
    head += _row([nodes.paragraph("", title) for title in titles])
    body = nodes.tbody()
    group += body
    for row in rows:
        body += _row(
            [
                _claim(app, docname, row),
                nodes.paragraph("", _or_dash(row.claim.printed, row)),
                *_numbers(row),
                _verdict(row),
            ]
        )
    return table


def _row(cells):
    row = nodes.row()
    for cell in cells:
        parts = cell if isinstance(cell, list) else [cell]
        nothing = ["scoreboard-nothing"] if parts[0].astext() == NOTHING else []
        row += nodes.entry("", *parts, classes=nothing)
    return row


def _or_dash(text, row):
    return text + unit_of(row.claim) if text else NOTHING


def _numbers(row):
    if row.record is None:
        return [nodes.paragraph("", NOTHING), nodes.paragraph("", NOTHING)]
    return [
        nodes.paragraph("", _or_dash(row.record.computed("unicode"), row)),
        nodes.paragraph("", _or_dash(row.record.independently("unicode"), row)),
    ]


def _claim(app, docname, row):
    claim = row.claim
    paragraph = nodes.paragraph()
    address = _address(app, docname, claim)
    if address is None:
        paragraph += nodes.strong("", claim.place)
    else:
        paragraph += nodes.reference("", claim.place, refuri=address, internal=True)
    paragraph += nodes.Text(f": {claim.text}")
    test = nodes.paragraph("", f"Test: {_sentence(claim.test)}", classes=["scoreboard-small"])
    return [paragraph, test]


def _address(app, docname, claim):
    labels = app.env.get_domain("std").anonlabels
    target, label = labels.get(f"claim-{claim.id}", (claim.page, ""))
    if target not in app.env.found_docs:
        return None
    address = app.builder.get_relative_uri(docname, target)
    return f"{address}#{label}" if label else address


def _verdict(row):
    verdict = row.verdict
    paragraph = nodes.paragraph()
    paragraph += nodes.inline(
        "",
        f"{verdict.glyph}\u00a0{verdict.value}",
        classes=["verdict", f"verdict-{verdict.name.lower()}"],
    )
    cells = [paragraph]
    if row.why:
        cells.append(nodes.paragraph("", row.why, classes=["scoreboard-small"]))
    said_above = verdict is Verdict.AWAITS
    if row.claim.slot and not said_above and not literature.is_available(row.claim.slot):
        said = "The measured or published points are awaited."
        cells.append(nodes.paragraph("", said, classes=["scoreboard-small"]))
    return cells


def _sentence(text):
    if text[:2].isalpha():  # not a symbol
        text = text[0].upper() + text[1:]
    return text if text.endswith(".") else text + "."


def setup(app):
    for node in PLACEHOLDERS:
        app.add_node(node)
    app.add_directive("scoreboard", BoardDirective)
    app.add_directive("scoreboard-line", LineDirective)
    app.add_directive("errata", ErrataDirective)
    app.add_role("result", ResultRole())
    app.connect("builder-inited", _start)
    app.connect("env-before-read-docs", _forget)
    app.connect("source-read", _page_begins)
    app.connect("doctree-read", _page_ends)
    app.connect("env-updated", _judge)
    app.connect("doctree-resolved", _resolve)
    app.connect("build-finished", _write_csv)
    # Records are files, and the environment variables belong to the process that reads a page.
    return {"parallel_read_safe": True, "parallel_write_safe": True, "version": "1"}
