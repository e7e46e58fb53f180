"""Sphinx extension: where lines may break, and where not.

Long names in code may break after a dot, a slash, a colon or an underscore: browsers break code
only at spaces, and a column of names such as ``lissome.references.rolling`` would push its table
off the page, or be cut in the middle of a word. A line of code that is too long for the page goes
on in the next line, further in than it began. A formula keeps the comma behind it, and the bracket
before it, in its own line.
"""

from __future__ import annotations

import re

CODE = re.compile(r"(<span class=\"pre\">)([^<]{12,})(</span>)")
#: Behind a word and its mark, never within ``__name__`` nor before a single letter.
PLACE = re.compile(r"(?:(?<=[A-Za-z0-9][./_])|(?<=::))(?=[A-Za-z0-9]{2})")


#: A listing, as Pygments writes it.
LISTING = re.compile(r"(<div class=\"highlight\"><pre>(?:<span></span>)?)(.*?)(</pre>)", re.DOTALL)
TAG = re.compile(r"<[^>]*>")
OPEN = re.compile(r"<(?!wbr)[a-z]")
#: A formula within a line, with the marks that touch it.
FORMULA = re.compile(r"([(\[“‘]*)(<span class=\"math[^>]*>[^<]*</span>)([.,;:!?)\]’”]*)")


def broken(body):
    """Return HTML with places to break in the long names within it."""
    return CODE.sub(lambda name: name[1] + PLACE.sub("<wbr>", name[2]) + name[3], body)


def _listed(listing):
    lines = listing[2].splitlines(keepends=True)
    if any(len(OPEN.findall(line)) != line.count("</") for line in lines):
        return listing[0]  # an element that spans lines, such as the link of a whole function
    rows = []
    for line in lines:
        text = TAG.sub("", line)
        indent = len(text) - len(text.lstrip(" "))
        rows.append(f'<span class="line" style="--indent:{indent}">{line}</span>')
    return listing[1] + "".join(rows) + listing[3]


def listed(body):
    """Return HTML whose listings have a block for each line, which knows how far in it begins."""
    return LISTING.sub(_listed, body)


def _held(formula):
    before, middle, behind = formula.groups()
    held = before or behind
    return f'<span class="held">{formula[0]}</span>' if held else middle


def held(body):
    """Return HTML in which formulas stay together with the marks that touch them."""
    return FORMULA.sub(_held, body)


def _break(app, pagename, templatename, context, doctree):
    if "body" in context:
        context["body"] = held(listed(broken(context["body"])))


def setup(app):
    app.connect("html-page-context", _break)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
