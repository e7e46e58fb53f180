"""Build the book and gather what it reproduces: reproduce.py [BUILD]; run it through `make reproduce`.

    BUILD/reproduction/figures/PANEL.png, .pdf   one pair for each panel of the thesis that is computed
    BUILD/reproduction/scoreboard.csv            every claim: printed, computed, independent, verdict
    BUILD/reproduction/report.json               all of it for programs, with versions and checksums

    reproduce.py --gather [BUILD]    without building: from the last run of this tool
    reproduce.py --manifest          write codecheck.yml, the list of these files for a CODECHECK
    reproduce.py --compare A B       set the reports of two builds side by side: fails if the verdict,
                                     a printed digit or a word of any claim differs

The pictures are those that the pages show: the executed notebooks of the build hold them, and the
figure map (data/figures.csv) says which panel of the thesis each belongs to.
"""

from __future__ import annotations

import argparse
import base64
import csv
import hashlib
import json
import os
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ROOT / "tools"
BUILD = Path("_build")


def panels() -> list[dict[str, str]]:
    """Return the rows of the figure map that have a page."""
    with (ROOT / "data" / "figures.csv").open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if row["page"]]


def drawn(row: dict[str, str]) -> bool:
    """Tell whether a panel's counterpart is a picture; the others are tables and equations."""
    return row["label"].startswith("fig-")


def pictures(notebook: Path) -> dict[str, bytes]:
    """Return the first picture of every cell of an executed notebook that is a named figure."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    found = {}
    for cell in cells:
        name = cell["metadata"].get("mystnb", {}).get("figure", {}).get("name")
        for output in cell.get("outputs", []) if name else []:
            if content := output.get("data", {}).get("image/png"):
                text = content if isinstance(content, str) else "".join(content)
                found[name] = base64.b64decode(text)
                break
    return found


def forget(build: Path) -> None:
    """Delete what an earlier run gathered: nobody may take it for that of a run that failed."""
    for name in ("reproduction", "reproduction.unfinished"):
        shutil.rmtree(build / name, ignore_errors=True)
        if (build / name).exists():
            sys.exit(f"error: {build / name} cannot be deleted: check who owns it")


def reasons(records: Path) -> dict[str, str]:
    """Return the reason of each verdict in the words of the scoreboard."""
    from lissome import scoreboard

    return {row.claim.id: row.why for row in scoreboard.board(records, ()).rows}


def report_of(place: Path) -> dict[str, Any]:
    """Return the report of a build, given its folder or the file itself."""
    path = place / "reproduction" / "report.json" if place.is_dir() else place
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        _ = [row["id"] for row in content["claims"]], [row["id"] for row in content["figures"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        sys.exit(
            f"error: {path} is no report of `make reproduce` ({type(error).__name__}: {error})"
        )
    return dict(content)


def compare(first: Path, second: Path) -> int:
    """Print where two reports differ; return the number of claims that do."""
    one, two = report_of(first), report_of(second)
    mine, other = ({row["id"]: row for row in report["claims"]} for report in (one, two))
    differing = 0
    for name in dict.fromkeys([*mine, *other]):
        a, b = mine.get(name), other.get(name)
        if a == b:
            continue
        differing += 1
        if a is None or b is None:
            print(f"{name}: only in {first if b is None else second}")
            continue
        for key in dict.fromkeys([*a, *b]):
            if a.get(key) != b.get(key):
                print(f"{name}: {key}\n  {a.get(key)}\n  {b.get(key)}")
    shown = {row["id"]: row.get("files") for row in two["figures"]}
    other_pictures = [
        row["id"]
        for row in one["figures"]
        if (row.get("files") or {}).get(f"figures/{row['id']}.png")
        != (shown.get(row["id"]) or {}).get(f"figures/{row['id']}.png")
    ]
    for key in ("sources", "versions", "machine"):
        if one.get(key) != two.get(key):
            print(f"note: other {key}: {one.get(key)} and {two.get(key)}")
    if other_pictures:
        print("note: pictures that are not the same to the last bit:", *other_pictures)
    print(f"{len(mine)} and {len(other)} claims, {differing} differ")
    return differing


def gather(build: Path) -> int:
    """Write the reproduction from a finished build; return the number of missing files."""
    target, vectors = build / "reproduction.unfinished", build / "vectors"
    forget(build)
    (target / "figures").mkdir(parents=True)
    missing: list[str] = []
    entries: list[dict[str, Any]] = []
    known: dict[str, dict[str, bytes]] = {}
    for row in panels():
        entry: dict[str, Any] = {
            key: row[key] for key in ("id", "panel", "shows", "kind", "page", "label")
        }
        entries.append(entry)
        if not drawn(row):
            continue
        page = row["page"]
        if page not in known:
            notebook = build / "jupyter_execute" / f"{page}.ipynb"
            known[page] = pictures(notebook) if notebook.is_file() else {}
        png = known[page].get(row["label"])
        if png is None:
            missing.append(f"{row['panel']}: no picture `{row['label']}` on page {page}")
            continue
        pdf = vectors / f"{hashlib.sha256(png).hexdigest()}.pdf"
        if not pdf.is_file():
            missing.append(f"{row['panel']}: no PDF of `{row['label']}` on page {page}")
            continue
        files = {}
        for suffix, content in ((".png", png), (".pdf", pdf.read_bytes())):
            name = f"figures/{row['id']}{suffix}"
            (target / name).write_bytes(content)
            files[name] = hashlib.sha256(content).hexdigest()
        entry["files"] = files
    board = (build / "html" / "scoreboard.csv").read_bytes()
    claims = list(csv.DictReader(board.decode("utf-8").splitlines()))
    words = reasons(build / "scoreboard")
    (target / "scoreboard.csv").write_bytes(board)
    bench = runpy.run_path(str(TOOLS / "bench.py"))
    report = {
        "commit": bench["commit"](),
        "sources": bench["fingerprint"](),
        "machine": {"processor": bench["processor"](), "cores": os.cpu_count()},
        "versions": bench["versions"](),
        "claims": [row | {"why": words.get(row["id"], "")} for row in claims],
        "figures": entries,
        "missing": missing,
    }
    text = json.dumps(report, indent=1, ensure_ascii=False) + "\n"
    (target / "report.json").write_text(text, encoding="utf-8")
    target = target.rename(build / "reproduction")
    for line in missing:
        print(f"MISSING {line}")
    count = sum("files" in entry for entry in entries)
    print(f"{count} panels, {len(report['claims'])} claims: {target / 'report.json'}")
    return len(missing)


def manifest() -> str:
    """Return codecheck.yml: what a checker finds after `make reproduce`, and what it shows."""
    import yaml

    outputs = [{"file": "scoreboard.csv", "comment": "every claim: printed, computed, verdict"}]
    for row in panels():
        if drawn(row):
            comment = f"{row['panel']}: {row['shows']} (book page {row['page']})"
            outputs.append({"file": f"figures/{row['id']}.pdf", "comment": comment})
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    thesis = next(entry for entry in citation["references"] if entry["type"] == "thesis")
    (author,) = thesis["authors"]
    content = {
        "version": "https://codecheck.org.uk/spec/config/1.0/",
        "paper": {
            "title": thesis["title"],
            "authors": [{"name": f"{author['given-names']} {author['family-names']}"}],
        },
        "manifest": [
            {"file": f"{BUILD}/reproduction/{entry['file']}", "comment": entry["comment"]}
            for entry in outputs
        ],
        "summary": "`make reproduce` builds the book and writes the files of the manifest.",
    }
    head = "# Written by `tools/reproduce.py --manifest` from data/figures.csv and CITATION.cff.\n"
    return head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", nargs="?", default=BUILD, type=Path)
    parser.add_argument("--gather", action="store_true", help="from the last run, without building")
    parser.add_argument("--manifest", action="store_true", help="write codecheck.yml")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("A", "B"), help="two builds")
    options = parser.parse_args(arguments)
    if options.compare:
        return int(compare(*options.compare) > 0)
    if options.manifest:
        (ROOT / "codecheck.yml").write_text(manifest(), encoding="utf-8")
        return 0
    build = options.build.absolute()
    if not options.gather:
        forget(build)
        shutil.rmtree(build / "vectors", ignore_errors=True)
        os.environ["LISSOME_FIGURES"] = str(build / "vectors")
        if status := runpy.run_path(str(TOOLS / "build_book.py"))["main"]([str(build)]):
            return int(status)
    try:
        return int(gather(build) > 0)
    except OSError as error:  # no build there, no space
        sys.exit(
            f"error: the figures of {build} cannot be gathered ({error}): run `make reproduce`"
        )


if __name__ == "__main__":
    sys.exit(main())
