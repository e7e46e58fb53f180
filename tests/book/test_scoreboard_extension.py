"""The Sphinx extension of the scoreboard, on a book of four pages that is really executed."""

import csv
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lissome import literature, scoreboard

EXTENSIONS = Path(__file__).resolve().parents[2] / "book" / "_ext"
CONF = f"""
import sys
sys.path.insert(0, {str(EXTENSIONS)!r})
project = "small"
extensions = ["myst_nb", "scoreboard"]
exclude_patterns = ["_*"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_inline"]
html_theme = "basic"
"""
NOTEBOOK = """---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  name: python3
  display_name: Python 3
---
"""
# 0-first is read before the chapter that records, index after it
INDEX = """# Index

```{scoreboard-line}
```

The angle is {result}`strip-best-angle-095`, printed {result}`strip-best-angle-095:printed`;
it is {result}`strip-best-angle-095:verdict`. Not yet: {result}`slinky-onset`.

```{toctree}
0-first
3-flapping-strip
scoreboard
```
"""
FIRST = """# First

```{scoreboard}
:page: 3-flapping-strip
```

Those that differ:

```{scoreboard}
:verdict: differs
```

Those that wait for data:

```{scoreboard}
:verdict: awaits data
:page: 3-flapping-strip
```

```{errata}
:chapter: 2
```

```{errata}
:chapter: 5
```

See {ref}`the unit <erratum-stretching-modulus-unit>`.
"""
# what the errata of these chapters link to: sections and equations
ERRATA = literature.load("errata").columns
FIRST += "".join(
    f"\n$$\nx = 1\n$$ ({label})\n" if label.startswith("eq-") else f"\n({label})=\n## {label}\n"
    for label in sorted(
        {
            text.partition("#")[2]
            for chapter, text in zip(ERRATA["chapter"], ERRATA["evidence"], strict=True)
            if str(chapter) in ("2", "5") and "#" in text
        }
    )
)
CHAPTER = (
    NOTEBOOK
    + """# Chapter

(claim-strip-best-angle-095)=
## Best angle

```{code-cell} ipython3
from lissome import literature, scoreboard

window = {"intensities": [3, 5, 10], "lower": [60, 50, 40], "upper": [70, 75, 80]}
window |= {"resolution": 0.1, "frequencies": [0.1, 0.2, 0.3], "angle": 65}
facts = {
    "strip-best-angle-095": {"value": 65.131234, "spread": 0.2},
    "strip-best-angle-0957": {"value": 61.0, "spread": 0.2},
    "strip-window": window,
    "strip-cycle": {
        "value": 2.5, "return_distance": 1e-8, "crest_drift": [0.2, 0.2], "snaps_per_period": 2,
        "side_difference": 1e-9,
    },
    "strip-eigenvalue": {"value": 1e-4, "exponents": [0.5, 0.51], "after": [3.0, 4.0]},
    "strip-reverse": {
        "crest_drift": [-0.2, -0.2], "orbit_difference": 0.1, "period_difference": 0.01
    },
    "strip-faces": {
        "angles": [60, 65], "planar": [0.3, 0.4], "homeotropic": [0.2, 0.3],
        "planar_window": [40, 80], "homeotropic_window": [50, 75],
    },
}
for claim, found in facts.items():
    if claim != OMIT:
        scoreboard.record(
            claim, as_printed=found, uncertainty=0.04 if "value" in found else None
        )
```
"""
)
BOARD = """# Scoreboard

```{scoreboard}
```
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """A kernel that is this interpreter, and a quiet one."""
    folder = tmp_path_factory.mktemp("kernel")
    kernel = folder / "kernels" / "python3" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    kernel.write_text(
        '{"display_name": "Python 3", "language": "python", "argv": '
        f'["{sys.executable}", "-m", "ipykernel_launcher", "-f", "{{connection_file}}"]}}'
    )
    clean = {k: v for k, v in os.environ.items() if not k.startswith("LISSOME_")}
    return clean | {"JUPYTER_PATH": str(folder), "PYDEVD_DISABLE_FILE_VALIDATION": "1"}


def build(folder, environment, omit="None", chapter=CHAPTER):
    source = folder / "source"
    source.mkdir(exist_ok=True)
    for name, text in {
        "conf.py": CONF,
        "index.md": INDEX,
        "0-first.md": FIRST,
        "3-flapping-strip.md": chapter.replace("OMIT", omit),
        "scoreboard.md": BOARD,
    }.items():
        (source / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    return subprocess.run(
        [*command, str(source), str(folder / "out" / "html")],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.fixture(scope="module")
def book(tmp_path_factory, environment):
    folder = tmp_path_factory.mktemp("book")
    result = build(folder, environment)
    assert result.returncode == 0, result.stderr
    return folder / "out"


def page(book, name):
    text = (book / "html" / f"{name}.html").read_text("utf-8")
    return re.sub(r"\s+", " ", text)


def plain(text):
    return re.sub(r"<[^>]+>", "", text)


def test_pages_read_before_the_chapter_show_what_it_recorded(book):
    text = plain(page(book, "index"))
    claims = len(scoreboard.claims())
    assert (
        f"Of {claims} claims of the thesis, 6 are reproduced, 1 differs; {claims - 7} wait" in text
    )
    assert "The angle is 65.13(4)°, printed 65.1°; it is reproduced. Not yet: pending." in text
    assert "65.13(4)°" in plain(page(book, "0-first"))


def test_the_board_links_to_the_claims(book):
    text = page(book, "scoreboard")
    assert 'href="3-flapping-strip.html#claim-strip-best-angle-095"' in text
    assert 'href="3-flapping-strip.html"' in text  # a claim without a target of its own
    assert 'href="scoreboard.csv"' in text
    for verdict in ("reproduced", "differs", "pending"):
        assert f'class="verdict verdict-{verdict}"' in text
    assert "≠ differs" in plain(text)
    assert "at most 0.5° allowed" in plain(text)
    assert "Test: Argmax to 0.1 degree within 0.5 of the printed value" in plain(text)
    slots = {claim.slot for claim in scoreboard.claims().values()} - {""}
    said = plain(text).count("The measured or published points are awaited.")
    assert (said > 0) == bool(slots & set(literature.awaited()))
    for claim in scoreboard.claims().values():
        assert claim.place in plain(text).replace("&lt;", "<").replace("&amp;", "&")


def test_a_selection_shows_nothing_else(book):
    text = page(book, "0-first")
    first, _, rest = text.partition("Those that differ")
    differing, _, awaiting = rest.partition("Those that wait for data")
    assert first.count('class="verdict ') == 7
    assert differing.count('class="verdict ') == 1
    assert 'class="verdict verdict-differs"' in differing
    assert "There is none." in awaiting


def test_the_table_for_programs_is_written(book):
    rows = list(csv.DictReader(io.StringIO((book / "html" / "scoreboard.csv").read_text("utf-8"))))
    assert [row["id"] for row in rows] == list(scoreboard.claims())
    best = next(row for row in rows if row["id"] == "strip-best-angle-095")
    assert best["computed"] == "65.13"
    assert best["verdict"] == "reproduced"


def test_records_tell_their_page(book):
    names = sorted(path.stem for path in (book / "scoreboard").glob("*.json"))
    assert len(names) == 7
    assert '"page": "3-flapping-strip"' in (book / "scoreboard" / "strip-window.json").read_text(
        "utf-8"
    )


def test_errata_are_targets(book):
    text = page(book, "0-first")
    assert 'id="erratum-stretching-modulus-unit"' in text
    assert 'href="#erratum-stretching-modulus-unit"' in text
    assert "test_unit_of_the_stretching_modulus" in text


def test_a_missing_record_fails_the_build_and_stale_ones_do_not_hide_it(
    book, environment, tmp_path
):
    first = build(tmp_path, environment, omit="None")
    assert first.returncode == 0, first.stderr
    second = build(tmp_path, environment, omit="'strip-window'")  # the page has changed: runs anew
    assert second.returncode != 0
    assert "the claim 'strip-window' has no record" in second.stderr
    assert not (tmp_path / "out" / "scoreboard" / "strip-window.json").exists()


def test_unknown_names_fail_the_build(environment, tmp_path):
    wrong = CHAPTER + (
        "\n{result}`strip-best`\n\n{result}`strip-window:digits`\n\n"
        "```{scoreboard}\n:chapter: 9\n```\n\n```{scoreboard}\n:verdict: fine\n```\n"
    )
    result = build(tmp_path, environment, chapter=wrong)
    assert result.returncode != 0
    assert "unknown claim 'strip-best'" in result.stderr
    assert "unknown part 'digits'" in result.stderr
    assert "no claim has the chapter '9'" in result.stderr
    assert "no claim has the verdict 'fine'" in result.stderr
