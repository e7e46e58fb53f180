"""Look at every page of the built book in a real browser, with the network cut.

    check_pages.py BUILD/html [--screenshots FOLDER] [--only PART-OF-NAME]

A page fails when an equation is not typeset, a figure is not drawn, a picture or an internal link
is broken, a script raises or complains, anything is asked for that is not in the book, a cell shows
an error, a picture has no text for those who cannot see it, the page is wider than a phone, a
finger cannot scroll past a 3-D figure or cannot turn it, or the page or the book is too heavy. Run
it through `make check-pages`; it drives Chromium by Playwright.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path
from queue import Empty, SimpleQueue
from urllib.parse import unquote, urlsplit

PAGE_LIMIT = 8e6  # bytes of HTML
BOOK_LIMIT = 60e6  # bytes of everything
PATIENCE = 10  # half seconds until a page must show what it should: figures, the dark, a turn
PHONE = {"width": 390, "height": 844}
FINGER = 40  # pixels that a control must be high to be met
DESK = {"width": 1280, "height": 900}
OWN = ("file:", "data:", "blob:", "about:")
#: Browsers at work side by side: equations are typeset on one core, and figures need waiting.
WINDOWS = min((os.cpu_count() or 1) + 1, 4)
#: A picture of a long page takes a busy machine more than Playwright's half minute.
LIMIT_MS = 120_000
#: Pages that hold docstrings only. A picture shows their first screen: the longest is 100 screens.
REFERENCE = ("api/",)
#: Pages that Sphinx makes of its own accord.
LISTINGS = ("_modules/", "genindex", "py-modindex", "search")
#: What the pages with a figure in space have in their text.
PLOT = 'class="plotly-graph-div'
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--allow-file-access-from-files",
]

#: Gathers, inside the page, all that is judged outside.
LOOK = r"""
() => {
  const shown = (e) => e.getClientRects().length > 0;
  const text = (e) => (e.textContent || "").trim().slice(0, 60);
  const every = (selector) => [...document.querySelectorAll(selector)];
  const raw = [];
  const walk = document.createTreeWalker(document.querySelector("main") || document.body,
                                         NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const inside = node.parentElement;
    if (inside.closest("script, style, pre, code, mjx-container, textarea, noscript")) continue;
    if (/\\[(\[]|\\begin\{|\$\$/.test(node.data)) raw.push(node.data.trim().slice(0, 60));
  }
  const math = every("span.math, div.math");
  return {
    title: document.title,
    headings: every("article h1").length,
    theme: document.documentElement.dataset.theme,
    math: math.length,
    unset: math.filter((e) => !e.querySelector("mjx-container")).map(text),
    wrong: every("mjx-merror, [data-mjx-error]").map(text),
    unknown: every("mjx-mtext").filter((e) => /^\\/.test(text(e)) ||
        (/^(rgb\(255, 0, 0\)|red)$/.test(getComputedStyle(e).color))).map(text),
    raw: raw,
    plots: every(".plotly-graph-div").length,
    blank: every(".plotly-graph-div").filter((e) => !e.querySelector("canvas, svg.main-svg"))
        .map((e) => e.id),
    scripts: every("article script").filter((e) => !e.type.startsWith("text/")).length,
    images: every("img").length,
    broken: every("img").filter((e) => e.complete && e.naturalWidth === 0)
        .map((e) => (e.getAttribute("src") || "no src").slice(0, 80)),
    mute: every("article img, article video, article [role=img]").filter((e) =>
        !e.closest(".svg-inline--fa") &&
        !(e.getAttribute("alt") || e.getAttribute("aria-label") ||
          e.getAttribute("title") || "").trim() &&
        !e.closest("[aria-hidden=true]")).map((e) => (e.getAttribute("src") || e.tagName).slice(0, 80)),
    faults: every(".problematic, .system-message, .output.traceback, .output.stderr")
        .filter(shown).map(text),
  };
}
"""

#: What stands in a figure that is drawn.
DRAWN = "canvas, svg.main-svg"

WIDE = r"""
() => {
  const limit = document.documentElement.clientWidth + 1;
  if (document.documentElement.scrollWidth <= limit) return null;
  const scrolls = (e) => {
    for (let up = e.parentElement; up && up !== document.body; up = up.parentElement) {
      if (/auto|scroll|hidden/.test(getComputedStyle(up).overflowX)) return true;
    }
    return false;
  };
  const over = [...document.querySelectorAll("main *")].filter((e) =>
      e.getBoundingClientRect().right > limit && !scrolls(e));
  const last = over.filter((e) => !over.some((other) => other !== e && e.contains(other)));
  return document.documentElement.scrollWidth + " px: " +
      last.slice(0, 3).map((e) => e.tagName.toLowerCase() + "." + e.className).join(", ");
}
"""


#: Where a figure in space is looked at from.
CAMERAS = """
(plot) => JSON.stringify(Object.keys(plot._fullLayout || {}).filter((key) => /^scene/.test(key))
    .map((key) => plot._fullLayout[key].camera))
"""


class _Anchors(HTMLParser):
    """Collects what a page can be entered by, and where it leads."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        for key in ("id", "name"):
            if value := given.get(key):
                self.names.add(value)
        if tag == "a" and (href := given.get("href")):
            self.links.add(href)


@dataclass
class Page:
    """One built page and what is wrong with it."""

    path: Path
    name: str
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def blame(self, what: str, cases: object) -> None:
        """Note a problem, if there are any cases of it."""
        if not cases:
            return
        if isinstance(cases, (list, tuple, set)):
            listed = sorted({str(case) for case in cases})
            more = f" and {len(listed) - 3} more" if len(listed) > 3 else ""
            cases = "; ".join(listed[:3]) + more
        self.problems.append(f"{what}: {cases}")


def find_browser() -> str | None:
    """Return the path of Chromium: $CHROMIUM, or the first of the usual names."""
    candidates = [os.environ.get("CHROMIUM"), *map(shutil.which, BROWSERS)]
    return next((c for c in candidates if c and Path(c).exists()), None)


def pages_of(book: Path) -> list[Page]:
    """Return all pages of a built book, in order of their names."""
    found = (p for p in book.rglob("*.html") if "_static" not in p.relative_to(book).parts)
    return [Page(p, p.relative_to(book).as_posix()) for p in sorted(found)]


def check_links(pages: list[Page]) -> None:
    """Blame links that lead to a page, file or anchor that the book does not have."""
    anchors: dict[Path, _Anchors] = {}
    for page in pages:
        parser = anchors[page.path.resolve()] = _Anchors()
        parser.feed(page.path.read_text(encoding="utf-8"))
    for page in pages:
        dead = []
        for link in anchors[page.path.resolve()].links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = page.path.resolve()
            if parts.path:
                target = (page.path.parent / unquote(parts.path)).resolve()
            if not target.is_file():
                dead.append(link)
            elif parts.fragment and target in anchors:
                name = unquote(parts.fragment)
                if name not in anchors[target].names and name != "top":
                    dead.append(link)
        page.blame("dead links", dead)


def check_weight(pages: list[Page], book: Path) -> list[str]:
    """Blame heavy pages; return what is wrong with the book as a whole."""
    for page in pages:
        size = page.path.stat().st_size
        if size > PAGE_LIMIT:
            page.blame("too heavy", f"{size / 1e6:.1f} MB of HTML; {PAGE_LIMIT / 1e6:.0f} allowed")
    total = sum(p.stat().st_size for p in book.rglob("*") if p.is_file())
    print(f"the book weighs {total / 1e6:.1f} MB in {len(pages)} pages")
    if total > BOOK_LIMIT:
        return [f"the book weighs {total / 1e6:.1f} MB; {BOOK_LIMIT / 1e6:.0f} are allowed"]
    return []


def colors_in(png: bytes) -> int:
    """Return how many colors a picture has: a figure that was not drawn has one or two."""
    from PIL import Image

    picture = Image.open(BytesIO(png)).convert("RGB").resize((160, 120))
    colors = picture.getcolors(160 * 120)
    return len(colors) if colors else 160 * 120


def _comes(tab, ask: Callable[..., object], *about: object) -> bool:
    """Tell whether something comes true as long as there is patience: a machine may be busy."""
    for _ in range(PATIENCE):
        if ask(*about):
            return True
        tab.wait_for_timeout(500)
    return bool(ask(*about))


def _settle(tab) -> None:
    """Wait until fonts, equations and figures have come to rest."""
    tab.wait_for_load_state("load")
    tab.evaluate("() => document.fonts.ready.then(() => true)")
    tab.evaluate("() => window.MathJax?.startup?.promise?.then(() => true)")
    for figure in tab.query_selector_all(".plotly-graph-div"):
        figure.scroll_into_view_if_needed()
        tab.wait_for_timeout(600)
        _comes(tab, figure.query_selector, DRAWN)  # else it is blamed later
    tab.evaluate("() => window.scrollTo(0, 0)")
    tab.wait_for_timeout(350)  # side bars slide into place


def _check_figures(tab, page: Page) -> None:
    for figure in tab.query_selector_all(".plotly-graph-div"):
        if not figure.is_visible():
            continue
        name = figure.get_attribute("id")
        if not _comes(tab, lambda plot: colors_in(plot.screenshot()) > 20, figure):
            page.blame("figure is blank", f"{name}, {colors_in(figure.screenshot())} colors")


def _swipe(tab, x: float, y: float, by: float) -> None:
    """Draw a finger over the glass, down by so many pixels and a little to the right."""
    finger = tab.context.new_cdp_session(tab)

    def touch(kind: str, *points: dict[str, float]) -> None:
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})
        tab.wait_for_timeout(25)

    touch("touchStart", {"x": x, "y": y})
    for share in range(1, 9):
        touch("touchMove", {"x": x + 3 * share, "y": y + by * share / 8})
    touch("touchEnd")
    tab.wait_for_timeout(500)
    finger.detach()


def _check_touch(browser, page: Page) -> None:
    """Blame figures in space that hold a finger up, or do not turn once they are tapped."""
    context = browser.new_context(viewport=PHONE, has_touch=True, is_mobile=True, offline=True)
    context.set_default_timeout(LIMIT_MS)
    try:
        tab = context.new_page()
        tab.goto(page.path.resolve().as_uri(), wait_until="load")
        _settle(tab)
        for figure in tab.query_selector_all(".plotly-graph-div"):
            if not figure.is_visible():
                continue
            name = figure.get_attribute("id")
            figure.evaluate("(plot) => plot.scrollIntoView({block: 'center'})")
            tab.wait_for_timeout(300)
            box = figure.bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            began, camera = tab.evaluate("scrollY"), figure.evaluate(CAMERAS)
            _swipe(tab, x, y, -120)
            if not _comes(tab, lambda least: tab.evaluate("scrollY") >= least, began + 60):
                page.blame("a finger cannot scroll past", name)
            if figure.evaluate(CAMERAS) != camera:
                page.blame("turns under a finger that scrolls", name)
            box = figure.bounding_box()
            y = box["y"] + box["height"] / 2
            tab.touchscreen.tap(x, y)
            tab.wait_for_timeout(300)
            began = tab.evaluate("scrollY")
            _swipe(tab, x, y, 40)
            turned = _comes(tab, lambda plot, eye: plot.evaluate(CAMERAS) != eye, figure, camera)
            if not turned or tab.evaluate("scrollY") != began:
                page.blame("a finger cannot turn", name)
            tab.touchscreen.tap(x, y)
        controls = tab.query_selector_all(".lissome-drawing :is(button, input):not(.modebar *)")
        boxes = [control.bounding_box() for control in controls if control.is_visible()]
        low = [f"{box['height']:g} px" for box in boxes if box["height"] < FINGER]
        page.blame(f"controls lower than {FINGER} px", low)
    finally:
        context.close()


def _judge(tab, page: Page, theme: str) -> dict:
    """Blame what is wrong with the page that stands open; return what was seen."""
    seen = tab.evaluate(LOOK)
    if seen["theme"] != theme:
        page.blame("theme", f"{seen['theme']} where {theme} was asked for")
    page.blame("equations not typeset", seen["unset"])
    page.blame("equations with an error", seen["wrong"])
    page.blame("unknown TeX macros", seen["unknown"])
    page.blame("raw TeX", seen["raw"])
    page.blame("figures not drawn", seen["blank"])
    page.blame("broken pictures", seen["broken"])
    page.blame("no alternative text", seen["mute"])
    page.blame("errors shown", seen["faults"])
    if seen["headings"] != 1 and not page.name.startswith(LISTINGS):
        page.blame("headings of the first level", str(seen["headings"]))
    return seen


def _turn_dark(tab) -> None:
    """Ask for the dark theme, as a reader's system does at dusk, and wait until it is there."""
    tab.set_viewport_size(DESK)
    tab.emulate_media(color_scheme="dark")
    tab.wait_for_timeout(500)
    _comes(tab, lambda: tab.evaluate("document.documentElement.dataset.theme") == "dark")


def _visit(browser, page: Page, theme: str, shot: Path | None) -> bool:
    """Open one page in one theme; on the light one also as on a phone.

    A page without scripts of its own is turned dark where it stands. Return whether it has some:
    what they draw on a dark page shows only when they begin on one.
    """
    reference = page.name.startswith(REFERENCE)
    context = browser.new_context(viewport=DESK, color_scheme=theme, offline=True)
    context.set_default_timeout(LIMIT_MS)

    def picture(kind: str) -> None:
        if shot:
            tab.screenshot(path=f"{shot}.{kind}.png", full_page=not reference)

    try:
        tab = context.new_page()
        said: list[str] = []
        asked: list[str] = []
        missing: list[str] = []
        tab.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        tab.on("pageerror", lambda e: said.append(str(e)))
        tab.on("request", lambda r: asked.append(r.url) if not r.url.startswith(OWN) else None)
        tab.on("requestfailed", lambda r: missing.append(r.url) if "file:" in r.url else None)
        tab.goto(page.path.resolve().as_uri(), wait_until="load")
        _settle(tab)
        seen = _judge(tab, page, theme)
        picture(theme)
        if theme == "light":
            _check_figures(tab, page)
            tab.set_viewport_size(PHONE)
            tab.wait_for_timeout(400)
            _comes(tab, lambda: not tab.evaluate(WIDE))  # figures take up the new width
            page.blame("wider than a phone", tab.evaluate(WIDE))
            tab.evaluate("() => window.scrollTo(0, 0)")  # bars that stick belong at the top
            picture("phone")
            for count, what in (
                (seen["math"], "equations"),
                (seen["plots"], "3-D figures"),
                (seen["images"], "pictures"),
            ):
                if count:
                    page.notes.append(f"{count} {what}")
        scripted = seen["scripts"] > 0
        if theme == "light" and not scripted and not page.name.startswith(LISTINGS):
            _turn_dark(tab)
            _judge(tab, page, "dark")
            picture("dark")
        page.blame("the console says", said)
        page.blame("asks for what is not in the book", asked)
        page.blame("files missing", missing)
        return scripted
    finally:
        context.close()


def _look_at(browser, page: Page, shots: Path | None) -> None:
    """Open one page in every theme that it is to be seen in."""
    from playwright.sync_api import Error

    began = time.monotonic()
    listing = page.name.startswith(LISTINGS)
    shot = shots / page.name.removesuffix(".html") if shots and not listing else None
    if shot:
        shot.parent.mkdir(parents=True, exist_ok=True)
    try:
        if _visit(browser, page, "light", shot) and not listing:
            _visit(browser, page, "dark", shot)
        if PLOT in page.path.read_text(encoding="utf-8"):
            _check_touch(browser, page)
    except Error as error:
        page.blame("the browser failed", str(error).splitlines()[0])
    page.problems = list(dict.fromkeys(page.problems))  # light and dark share most
    page.seconds = time.monotonic() - began


def look(
    pages: list[Page], executable: str, shots: Path | None = None, windows: int = WINDOWS
) -> Iterator[Page]:
    """Open every page, light and dark; yield it when its problems are known.

    Each of the `windows` threads drives a browser of its own; heavy pages go first, so that none
    is left alone at the end.
    """
    from playwright.sync_api import sync_playwright

    waiting: SimpleQueue[Page] = SimpleQueue()
    for page in sorted(pages, key=lambda page: page.path.stat().st_size, reverse=True):
        waiting.put(page)
    done: SimpleQueue[Page | None] = SimpleQueue()

    def serve() -> None:
        try:
            with sync_playwright() as play:
                browser = play.chromium.launch(executable_path=executable, args=FLAGS)
                while True:
                    try:
                        page = waiting.get_nowait()
                    except Empty:
                        break
                    _look_at(browser, page, shots)
                    done.put(page)
                browser.close()
        finally:
            done.put(None)  # this window is closed

    windows = min(windows, len(pages))
    with ThreadPoolExecutor(max(windows, 1)) as crew:
        served = [crew.submit(serve) for _ in range(windows)]
        while windows:
            page = done.get()
            if page is None:
                windows -= 1
            else:
                yield page
        for each in served:
            each.result()  # raises what went wrong outside the pages


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("book", type=Path, help="folder of the built pages")
    parser.add_argument("--screenshots", type=Path, help="folder for pictures of every page")
    parser.add_argument("--only", help="look only at pages with this in their name")
    given = parser.parse_args(arguments)
    if not (given.book / "index.html").is_file():
        print(f"error: no built book in {given.book}: run `make book` first")
        return 2
    executable = find_browser()
    if executable is None:
        print(
            "error: no Chromium found: install it (Debian: apt-get install chromium) or name it, "
            "CHROMIUM=/path/to/chromium make check-pages"
        )
        return 2
    pages = pages_of(given.book)
    heavy = check_weight(pages, given.book)
    check_links(pages)
    chosen = [page for page in pages if not given.only or given.only in page.name]
    failed = len(heavy)
    for page in look(chosen, executable, given.screenshots):
        verdict = "FAILED" if page.problems else "ok"
        print(f"{verdict:7}{page.name}  ({page.seconds:.1f} s) {', '.join(page.notes)}", flush=True)
        for problem in page.problems:
            print(f"         {problem}", flush=True)
        failed += bool(page.problems)
    for problem in heavy:
        print(f"FAILED {problem}")
    if given.screenshots:
        print(f"screenshots are in {given.screenshots}")
    if failed:
        print(f"\nbrowser check: {failed} of {len(chosen)} pages FAILED")
    else:
        print(f"\nbrowser check: all {len(chosen)} pages are fine")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
