"""tools/check_pages.py finds what it is there to find, and lets a good page pass."""

import pytest

pytest.importorskip("playwright")

FRAME = """<!doctype html><html lang="en" data-theme="light"><head><meta charset="utf-8">
<title>Page</title><script>
const dusk = matchMedia("(prefers-color-scheme: dark)");
const turn = () => { document.documentElement.dataset.theme = dusk.matches ? "dark" : "light"; };
turn();
dusk.onchange = turn;
</script></head><body><main><article><h1 id="top-of-it">Page</h1>{body}</article></main></body></html>
"""
PIXEL = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"
GOOD = f"""<p>Text <span class="math"><mjx-container>x</mjx-container></span>
<a href="other.html#here">there</a> <a href="#top-of-it">up</a> <a href="https://example.org">out</a>
<img src="{PIXEL}" alt="a dot"> <code>\\(raw in code\\)</code></p>"""

BAD = {
    "untypeset": ('<span class="math">x</span>', "equations not typeset: x"),
    "raw": (r"<p>\(a = b\)</p>", r"raw TeX: \(a = b\)"),
    "merror": (
        '<span class="math"><mjx-container><mjx-merror>bad</mjx-merror></mjx-container></span>',
        "equations with an error: bad",
    ),
    "macro": (
        '<mjx-container><mjx-mtext style="color: red">\\foo</mjx-mtext></mjx-container>',
        "unknown TeX macros: \\foo",
    ),
    "undrawn": ('<div class="plotly-graph-div" id="p1"></div>', "figures not drawn: p1"),
    "blank": (
        '<div class="plotly-graph-div" id="p2"><canvas width="300" height="200"></canvas></div>',
        "figure is blank: p2",
    ),
    "held": (
        '<div class="plotly-graph-div" id="p3" style="height: 300px; background: linear-gradient('
        '90deg, red, blue)" ontouchmove="event.preventDefault()"><canvas></canvas></div>'
        '<p style="height: 2000px">below</p>',
        "a finger cannot scroll past: p3",
    ),
    "stiff": ('<div class="plotly-graph-div" id="p4"></div>', "a finger cannot turn: p3"),
    "low": (
        '<div class="lissome-drawing"><button>thin</button></div>',
        "controls lower than 40 px: ",
    ),
    "picture": ('<img src="gone.png" alt="a loss">', "broken pictures: gone.png"),
    "mute": (f'<img src="{PIXEL}">', "no alternative text"),
    "script": ("<script>throw new Error('tripped')</script>", "the console says: tripped"),
    "complaint": ("<script>console.error('odd')</script>", "the console says: odd"),
    "remote": (
        '<script src="https://example.org/far.js"></script>',
        "asks for what is not in the book: https://example.org/far.js",
    ),
    "link": ('<a href="nowhere.html">x</a>', "dead links: nowhere.html"),
    "anchor": ('<a href="other.html#gone">x</a>', "dead links: other.html#gone"),
    "wide": ('<div style="width: 700px">wide</div>', "wider than a phone: 7"),
    "traceback": ('<div class="output traceback">Error</div>', "errors shown: Error"),
    "headings": ("<h1>Again</h1>", "headings of the first level: 2"),
}


@pytest.fixture(scope="module")
def verdicts(tools, tmp_path_factory):
    """Look once at a small book with two good pages and two that hold every fault."""
    import check_pages

    executable = check_pages.find_browser()
    if executable is None:
        pytest.skip("no Chromium on this machine")
    book = tmp_path_factory.mktemp("a book")
    (book / "other.html").write_text(FRAME.replace("{body}", '<p id="here">x</p>'))
    (book / "good.html").write_text(FRAME.replace("{body}", GOOD))
    loads = ("picture", "remote")  # apart, since each load that fails is a complaint as well
    for name, chosen in (("loads", loads), ("rest", BAD.keys() - loads)):
        bodies = "".join(BAD[fault][0] for fault in sorted(chosen))
        (book / f"{name}.html").write_text(FRAME.replace("{body}", bodies))
    # one does not turn dark, one does, but its own script spoils what begins dark
    still = FRAME.replace("dusk.onchange = turn;", "").replace("{body}", "<p>still</p>")
    (book / "still.html").write_text(still)
    spoiled = "<script>if (dusk.matches) console.error('spoiled')</script>"
    (book / "spoiled.html").write_text(FRAME.replace("{body}", spoiled))
    pages = check_pages.pages_of(book)
    check_pages.check_links(pages)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(check_pages, "PATIENCE", 2)
        seen = list(check_pages.look(pages, executable))
    return {page.name.removesuffix(".html"): page for page in seen}


@pytest.mark.parametrize("name", ["good", "other"])
def test_good_page_passes(verdicts, name):
    assert verdicts[name].problems == []


@pytest.mark.parametrize("name", BAD)
def test_fault_is_found(verdicts, name):
    what, case = BAD[name][1].split(": ", 1) if ": " in BAD[name][1] else (BAD[name][1], "")
    found = [p for page in ("loads", "rest") for p in verdicts[page].problems]
    assert any(p.startswith(what) and case in p for p in found), found


def test_a_page_is_looked_at_in_the_dark(verdicts):
    assert verdicts["still"].problems == ["theme: light where dark was asked for"]
    assert verdicts["spoiled"].problems == ["the console says: spoiled"]


def test_heavy_page_and_heavy_book_are_found(tools, tmp_path, monkeypatch):
    import check_pages

    (tmp_path / "index.html").write_text("x" * 1000)
    monkeypatch.setattr(check_pages, "PAGE_LIMIT", 500)
    monkeypatch.setattr(check_pages, "BOOK_LIMIT", 800)
    pages = check_pages.pages_of(tmp_path)
    assert check_pages.check_weight(pages, tmp_path)
    assert pages[0].problems[0].startswith("too heavy")


def test_missing_book_is_named_with_a_remedy(tools, tmp_path, capsys):
    import check_pages

    assert check_pages.main([str(tmp_path)]) == 2
    assert "make book" in capsys.readouterr().out
