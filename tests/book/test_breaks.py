"""book/_ext/breaks.py: where names in code may break."""

import re
import runpy

import pytest


@pytest.fixture(scope="module")
def extension(root):
    return runpy.run_path(str(root / "book" / "_ext" / "breaks.py"))


@pytest.fixture(scope="module")
def broken(extension):
    return extension["broken"]


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


def pygmentized(source):
    from pygments import highlight
    from pygments.formatters import HtmlFormatter
    from pygments.lexers import PythonLexer

    return highlight(source, PythonLexer(), HtmlFormatter())


def test_a_line_of_code_knows_how_far_in_it_begins(extension):
    source = 'def f(x):\n    """Two\n\n      lines."""\n    return x < 1  # done\n'
    page = pygmentized(source)
    said = extension["listed"](page)
    assert re.findall(r"--indent:(\d+)", said) == ["0", "4", "0", "6", "4"]
    assert re.sub(r'<span class="line"[^>]*>', "", said).replace("\n</span>", "\n") == page


@pytest.mark.parametrize("mark", [".", ",", ");", ""])
@pytest.mark.parametrize("bracket", ["(", ""])
def test_a_formula_keeps_the_marks_that_touch_it(extension, bracket, mark):
    formula = r'<span class="math notranslate nohighlight">\(x &lt; 1\)</span>'
    whole = f"{bracket}{formula}{mark}"
    held = f'<span class="held">{whole}</span>' if bracket or mark else whole
    assert extension["held"](f"<p>so {whole} holds</p>") == f"<p>so {held} holds</p>"


def test_a_listing_whose_lines_are_not_whole_stays_as_it_is(extension):
    """Sphinx puts a block around each function of a module's source."""
    source = '<div class="viewcode-block"><span class="k">def</span> f():\n    pass</div>\n'
    page = f'<div class="highlight"><pre>{source}</pre></div>'
    assert extension["listed"](page) == page
