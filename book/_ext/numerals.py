"""Sphinx extension: in sentences and tables a number reads −2 × 10⁻⁶, where Python writes -2e-06.

Numbers are not broken over two lines, nor parted from their units. Code and what it prints stay as
they are, and so do the reference pages.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx import addnodes

SCIENTIFIC = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?(?:\(\d+\))?)e([-+]?\d+)(?!\w)")
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS = re.compile(r"(?<![^\s(])-(?=\d)")
TIED = re.compile(r"(?<=[\d)]) (?=× 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹])|(?<=[\d)] ×) (?=10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹])")
UNIT = re.compile(r"(?<=\d) (?=(?:%|°C|nm|[μµ]m|mm|cm|m|[μµ]s|ms|s|K|mN|Pa|MPa|GPa)(?![\w/]))")
KEPT = (
    nodes.literal,
    nodes.FixedTextElement,
    nodes.math,
    nodes.raw,
    nodes.reference,
    nodes.citation,
    addnodes.desc_signature,
)


def _power(number):
    power = "10" + str(int(number[2])).translate(SUPERSCRIPTS)
    return power if number[1] == "1" else f"{number[1]} × {power}"


def numerals(text):
    """Return text with its numbers set."""
    if text.strip() == "-":  # a cell without a value
        return text.replace("-", "–")
    text = MINUS.sub("−", SCIENTIFIC.sub(_power, text))
    return UNIT.sub("\N{NO-BREAK SPACE}", TIED.sub("\N{NO-BREAK SPACE}", text))


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
        if _kept(node.parent):
            continue
        # behind a formula or a reference a hyphen joins: it is no minus, and no empty cell
        joint = "" if node.parent.index(node) == 0 else "\N{WORD JOINER}"
        said = numerals(joint + str(node)).removeprefix(joint)
        if said != str(node):
            node.parent.replace(node, nodes.Text(said))


def setup(app):
    app.connect("doctree-resolved", _apply)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
