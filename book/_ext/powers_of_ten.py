"""Sphinx extension: in sentences and tables a number reads 2 × 10⁻⁶, where Python writes 2e-06.

Code and what it prints stay as they are, and so do the reference pages.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx import addnodes

NUMBER = re.compile(
    r"(?<![\w.])(?P<sign>(?:(?<=^)|(?<=[\s(]))-)?(?P<digits>\d+(?:\.\d+)?(?:\(\d+\))?)"
    r"e(?P<power>[-+]?\d+)(?!\w)"
)
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
KEPT = (nodes.literal, nodes.literal_block, nodes.FixedTextElement, nodes.math, nodes.math_block,
        nodes.raw, nodes.reference, nodes.citation, addnodes.desc_signature)  # fmt: skip


def _set(number):
    power = "10" + str(int(number["power"])).translate(SUPERSCRIPTS)
    sign = "\N{MINUS SIGN}" if number["sign"] else ""
    return sign + (power if number["digits"] == "1" else f"{number['digits']} × {power}")


def with_powers(text):
    """Return text with its numbers set, and none of them broken over two lines."""
    return re.sub(r"(?<=[\d)]) × (?=10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹])", "\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}",
                  NUMBER.sub(_set, text))  # fmt: skip


def _kept(node):
    while node is not None:
        if isinstance(node, KEPT):
            return True
        node = node.parent
    return False


def _apply(app, doctree, docname):
    if docname.startswith("api/"):
        return
    for node in list(doctree.findall(nodes.Text)):
        said = with_powers(str(node))
        if said != str(node) and not _kept(node.parent):
            node.parent.replace(node, nodes.Text(said))


def setup(app):
    app.connect("doctree-resolved", _apply)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
