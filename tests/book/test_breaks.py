"""book/_ext/breaks.py: where names in code may break."""

import runpy

import pytest


@pytest.fixture(scope="module")
def broken(root):
    return runpy.run_path(str(root / "book" / "_ext" / "breaks.py"))["broken"]


def code(text):
    return f'<td><code class="docutils literal"><span class="pre">{text}</span></code></td>'


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("lissome.references.rolling", ["lissome.", "references.", "rolling"]),
        ("tests/errata/test_a.py::test_of_b", ["tests/", "errata/", "test_a.", "py::", "test_", "of_b"]),
        ("lissome.__version__", ["lissome.__version__"]),
        ("a.b", ["a.b"]),
    ],
)  # fmt: skip
def test_a_name_breaks_between_its_words(broken, name, parts):
    said = broken(code(name))
    assert said == code("<wbr>".join(parts))
    assert said.replace("<wbr>", "") == code(name)


def test_other_text_is_left_alone(broken):
    page = "<p>lissome.references.rolling</p><pre>lissome.references.rolling</pre>"
    assert broken(page) == page
    assert broken(code("&quot;staggered&quot;")) == code("&quot;staggered&quot;")
