"""Sphinx extension: long names in code may break after a dot, a slash, a colon or an underscore.

Browsers break code only at spaces; a column of names such as ``lissome.references.rolling`` would
push its table off the page, or be cut in the middle of a word.
"""

from __future__ import annotations

import re

CODE = re.compile(r"(<span class=\"pre\">)([^<]{12,})(</span>)")
#: Behind a word and its mark, never within ``__name__`` nor before a single letter.
PLACE = re.compile(r"(?:(?<=[A-Za-z0-9][./_])|(?<=::))(?=[A-Za-z0-9]{2})")


def broken(body):
    """Return HTML with places to break in the long names within it."""
    return CODE.sub(lambda name: name[1] + PLACE.sub("<wbr>", name[2]) + name[3], body)


def _break(app, pagename, templatename, context, doctree):
    if "body" in context:
        context["body"] = broken(context["body"])


def setup(app):
    app.connect("html-page-context", _break)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
