"""Every erratum has evidence that exists."""

import ast
import re
from pathlib import Path

import pytest

from lissome import literature

ROOT = Path(__file__).resolve().parents[2]
ROWS = literature.load("errata").frame.to_dict("records")


def tests_of(path):
    """Names of the test functions of a file, methods as Class::method."""
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            names |= {f"{node.name}::{m.name}" for m in node.body if isinstance(m, ast.FunctionDef)}
    return {name for name in names if name.split("::")[-1].startswith("test_")}


def labels_of(path):
    """Labels that a page defines: targets, equations, figures, blocks."""
    text = path.read_text("utf-8")
    found = re.findall(r"^\(([\w-]+)\)=", text, re.M)
    found += re.findall(r"^\$\$ *\(([\w-]+)\)", text, re.M)
    found += re.findall(r":(?:label|name): *([\w-]+)", text)
    found += re.findall(r"\{#([\w-]+)", text)
    return set(found)


def test_there_are_errata():
    assert len(ROWS) >= 8


@pytest.mark.parametrize("row", ROWS, ids=[row["id"] for row in ROWS])
def test_evidence_exists(row):
    evidence = row["evidence"]
    if evidence.startswith("tests/"):
        file, _, name = evidence.partition("::")
        assert (ROOT / file).is_file(), f"no file {file}"
        assert name in tests_of(ROOT / file), f"no test {name} in {file}"
    else:
        page, _, label = evidence.partition("#")
        path = ROOT / "book" / f"{page}.md"
        assert path.is_file(), f"no page {page}"
        assert label in labels_of(path), f"no label {label} on {page}"


@pytest.mark.parametrize("row", ROWS, ids=[row["id"] for row in ROWS])
def test_mathematics_is_balanced(row):
    for name in ("printed", "corrected", "why"):
        text = row[name]
        assert "\n" not in text
        assert text.count("$") % 2 == 0
        for formula in re.findall(r"\$(.*?)\$", text):
            assert formula.count("{") == formula.count("}")
            assert formula.count(r"\left") == formula.count(r"\right")
