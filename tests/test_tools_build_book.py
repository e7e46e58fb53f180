"""tools/build_book.py: any fault fails the build, again and again; numbers are the thesis's."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

from lissome._datapackage import Descriptor

pytest.importorskip("jupyter_book")

HEADER = """---
jupytext: {text_representation: {extension: .md, format_name: myst}}
kernelspec: {display_name: Python 3, language: python, name: python3}
---
"""


def cell(code):
    return f"```{{code-cell}} python\n{code}\n```\n"


class Book:
    """A small book with the configuration, the extensions and the tools of the real one."""

    def __init__(self, folder, root):
        self.root = folder
        for part in ("tools", "book/_ext", "book/_static"):
            shutil.copytree(root / part, folder / part)
        config = yaml.safe_load((root / "_config.yml").read_text(encoding="utf-8"))
        kept = ("offline", "chapter_numbers", "citations")
        local = config["sphinx"]["local_extensions"]
        config["sphinx"]["local_extensions"] = {name: local[name] for name in kept}
        (folder / "_config.yml").write_text(yaml.safe_dump(config), encoding="utf-8")
        self.write(
            "references.bib",
            "@book{a, author={A. Bee and C. Dee}, title={T}, publisher={P}, year=1973}",
        )
        self.write("index.md", "# Front\n")

    def write(self, name, text):
        (self.root / "book" / name).write_text(text, encoding="utf-8")

    def contents(self, *chapters):
        toc = {"format": "jb-book", "root": "index"}
        toc["parts"] = [{"caption": "All", "numbered": 3, "chapters": list(chapters)}]
        self.write("_toc.yml", yaml.safe_dump(toc))

    def start(self, *, build="out put", **changes):
        command = [sys.executable, "tools/build_book.py", str(build)]
        values = {**os.environ, **changes}
        return subprocess.Popen(
            command,
            cwd=self.root,
            env={name: value for name, value in values.items() if value is not None},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
        )

    def build(self, **changes):
        process = self.start(**changes)
        said, _ = process.communicate()
        return process.returncode, re.sub(r"\x1b\[[0-9;]*m", "", said)

    def page(self, name):
        return (self.root / "out put" / "html" / f"{name}.html").read_text(encoding="utf-8")


@pytest.fixture
def book(tmp_path, root):
    return Book(tmp_path / "ein Bücherregal", root)


FAULTS = {
    "exception": cell("def f(): raise ValueError('tripped')") + cell("f()"),
    "stderr": cell("import sys; print('odd', file=sys.stderr)"),
    "reference": "See {eq}`eq-nowhere`.\n",
    "citation": "See {cite}`nobody`.\n",
    "function": "See {py:func}`lissome.nothing`.\n",
}


def test_every_fault_fails_the_build_also_the_second_time(book):
    book.contents(*({"file": f"1-{name}"} for name in FAULTS))
    for name, text in FAULTS.items():
        book.write(f"1-{name}.md", f"{HEADER}# Page\n\n{text}")
    for _ in range(2):
        status, said = book.build()
        assert status == 1
        assert "FAILED" in said
        for name in FAULTS:
            assert re.search(rf"1-{name}\.md.*(?:WARNING|ERROR)", said), (name, said)
        assert "ValueError: tripped" in said
        assert not (book.root / "out put" / "html").exists(), "no book where there is none"


def test_good_book(book):
    nested = {"file": "3-chapter", "sections": [{"file": "3-part"}]}
    book.contents(nested, {"file": "a-appendix"})
    code = "import os, sys; print(os.environ['LISSOME_SCOREBOARD']); print('by', sys.executable)"
    plot = (
        "from IPython.display import HTML; import plotly.graph_objects as go\n"
        "HTML(go.Figure().to_html(full_html=False, include_plotlyjs=False))"
    )
    drawing = (
        "from lissome import plotting; fig, ax = plotting.figure(size=(1, 1))\n"
        "plotting.show(fig, alt='an empty pair of axes')"
    )
    math = "\n$$ a = b $$ (eq-{0})\n\nAs {{eq}}`eq-{0}` says.\n\n## Section\n"
    book.write("3-chapter.md", f"{HEADER}# Chapter\n{math.format('one')}\n{cell(code)}")
    book.write("3-part.md", f"{HEADER}# Part\n{math.format('two')}\n{cell(plot)}\n{cell(drawing)}")
    bibliography = "```{bibliography}\n```\n"
    book.write(
        "a-appendix.md",
        f"# Appendix\n{math.format('three')}\n{{cite}}`a` {{cite:t}}`a`\n\n{bibliography}",
    )
    stale = book.root / "out put" / "scoreboard" / "old.json"
    stale.parent.mkdir(parents=True)
    stale.write_text("{}")
    kept = book.root / "out put" / "mine.txt"
    kept.write_text("not the build's")

    status, said = book.build()
    assert status == 0, said
    assert not stale.exists(), "records of an earlier build are deleted"
    assert kept.exists(), "files of others are not"

    # numbers
    chapter, part, appendix = (book.page(n) for n in ("3-chapter", "3-part", "a-appendix"))
    numbers = [re.findall(r'"eqno">\(([^)]+)\)', page) for page in (chapter, part, appendix)]
    assert numbers == [["3.1"], ["3.2"], ["A.1"]]
    headings = [re.findall(r'<h[12]><span class="section-number">([^<]+)\.\s', p) for p in (part,)]
    assert headings == [["3.2", "3.2.1"][: len(headings[0])]]
    assert 'class="section-number">A.' in appendix
    assert "As" in part
    assert '">(3.2)</a>' in part

    # one label, in the text and in the list
    assert "Bee and Dee, 1973</a>]" in appendix
    assert re.search(r"\[</span>Bee and Dee, 1973<span", appendix)

    # offline, and plotly only where it is needed
    static = book.root / "out put" / "html" / "_static"
    assert (static / "mathjax" / "tex-chtml.js").is_file()
    assert (static / "plotly.min.js").is_file()
    assert not list(static.rglob("*.map"))
    assert "plotly.min.js" in part
    assert "plotly.min.js" not in chapter
    for page in (chapter, part, appendix):
        assert not re.findall(
            r'(?:<script[^>]+src|<link[^>]+href|<img[^>]+src)="(?:https?:)?//', page
        )

    # the environment of the cells, and the downloads
    assert f"by {sys.executable}" in chapter
    assert str(book.root / "out put" / "scoreboard") in chapter
    sources = book.root / "out put" / "html" / "_sources"
    for suffix in ("md", "py", "ipynb"):
        assert (sources / f"3-chapter.{suffix}").is_file()
        assert f"_sources/3-chapter.{suffix}" in chapter
    assert (
        "by " in (sources / "3-chapter.ipynb").read_text(encoding="utf-8").split('"outputs"', 1)[1]
    )
    assert not (sources / "a-appendix.ipynb").exists()
    offered = (sources / "3-part.ipynb").read_text(encoding="utf-8")
    assert 'class="lissome-drawing' in part
    assert '"image/png"' in offered and "lissome-drawing" not in offered


SLOW = """
import os, pathlib, time
import lissome
import numpy
import threadpoolctl
from lissome._compile import jit

@jit
def double(x):
    return 2 * x

def nap(n):
    import os, pathlib, time
    pathlib.Path(f"../process-{os.getpid()}").write_text("")
    while not pathlib.Path("../go").exists():
        time.sleep(0.1)
    return 2.0 * n

pathlib.Path(f"../process-{os.getpid()}").write_text("")
table = lissome.sweep(nap, {"n": [1, 2]})
print(f"sum {table['value'].sum() + double(0.5)}, cache {double.stats.cache_path}")
threads = {pool["num_threads"] for pool in threadpoolctl.threadpool_info()}
print(f"threads {threads}, order of sets {hash('a') == int(os.environ['HASH_OF_A'])}")
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals of this system are others")
def test_a_build_that_is_killed_leaves_nothing_that_is_believed_and_nothing_that_runs(book):
    book.contents({"file": "1-slow"})
    book.write("1-slow.md", f"{HEADER}# Slow\n\n{cell(SLOW)}")
    out = book.root / "out put"
    for number in (signal.SIGTERM, signal.SIGKILL):
        build = book.start(LOKY_MAX_CPU_COUNT="2")
        deadline = time.monotonic() + 300
        while len(processes := list(book.root.glob("process-*"))) < 3:  # a kernel, two workers
            assert build.poll() is None, build.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.1)
        assert (out / "html.unfinished").is_dir()
        status, said = book.build()
        assert (status, said.count("\n")) == (1, 1)
        assert "another build is running" in said
        build.send_signal(number)
        said, _ = build.communicate()
        assert build.returncode == {signal.SIGTERM: 143, signal.SIGKILL: -9}[number]
        assert ("The book is NOT built: SIGTERM" in said) == (number == signal.SIGTERM)
        for path in processes:
            while runs(int(path.name.removeprefix("process-"))):
                assert time.monotonic() < deadline, "a process goes on for nobody"
                time.sleep(0.1)
            path.unlink()
        assert not (out / "html").exists()

    # Again, on a machine where little is as it should be.
    (book.root / "go").write_text("")
    (book.root / "file").write_text("")
    lost = str(book.root / "file" / "below a file")
    nowhere = {"HOME": lost, "XDG_CACHE_HOME": None, "TZ": "", "LC_ALL": "C", "LANG": "C"}
    one_order = {**os.environ, "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-c", "print(hash('a'))"]
    hashed = subprocess.run(command, capture_output=True, text=True, env=one_order).stdout.strip()
    more = {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "HASH_OF_A": hashed}
    status, said = book.build(**nowhere, **more, LISSOME_CACHE=lost, PYTHONUTF8=None)
    assert status == 0, said
    assert f"This build keeps them in {out / 'cache' / 'lissome'}" in said
    page = book.page("1-slow")
    assert "sum 7.0, cache" in page
    assert "threads {1}, order of sets True" in page, "sums have one order whatever is asked for"
    assert f"{out / 'cache' / 'lissome' / 'compiled'}" in page.replace("\n", "")
    assert not (out / "html.unfinished").exists()


def runs(process):
    """Tell whether a process runs; one that has ended and whose parent has not asked does not."""
    import psutil

    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_damaged_data_are_named_before_any_page_runs(book):
    data = book.root / "data"
    shutil.copytree(Descriptor().folder, data)
    path = data / "thesis-table-3-1.csv"
    path.write_bytes(path.read_bytes().replace(b"0.56", b"0.57"))
    status, said = book.build(LISSOME_DATA=str(data))
    assert (status, said.count("\n")) == (1, 1), said
    assert str(path) in said and "restore it" in said
    assert not (book.root / "out put" / "jupyter_execute").exists()


def test_a_folder_that_no_book_can_be_built_in_is_refused_with_a_remedy(book):
    (book.root / "file").write_text("")
    (book.root / "open to all").mkdir()
    (book.root / "open to all").chmod(0o777)
    for build, words in (("file", "cannot be built"), ("file/below", "cannot be built")):
        status, said = book.build(build=build)
        assert (status, said.count("\n")) == (1, 1), said
        assert words in said and "make BUILD=" in said
    if hasattr(os, "geteuid"):
        status, said = book.build(build="open to all")
        assert (status, said.count("\n")) == (1, 1), said
        assert "all may write it" in said and "make BUILD=" in said
