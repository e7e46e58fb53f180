"""tools/reproduce.py: one file for each panel that is computed, none silently left out."""

import base64
import hashlib
import json
import runpy

import pytest

from lissome import plotting


@pytest.fixture(scope="module")
def tool(root):
    return runpy.run_path(str(root / "tools" / "reproduce.py"))


@pytest.fixture
def build(tool, tmp_path):
    """A finished build whose pictures, all different, are only said to be pictures."""
    pages = {}
    for row in tool["panels"]():
        if tool["drawn"](row):
            pages.setdefault(row["page"], {})[row["label"]] = f"{row['page']} {row['label']}"
    for name in ("jupyter_execute", "vectors", "html"):
        (tmp_path / name).mkdir()
    for page, labels in pages.items():
        cells = [{"cell_type": "markdown", "metadata": {}, "source": ["text"]}]
        for label, still in labels.items():
            data = {"text/html": "", "image/png": base64.b64encode(still.encode()).decode()}
            cells.append(
                {
                    "cell_type": "code",
                    "metadata": {"mystnb": {"figure": {"name": label}}},
                    "outputs": [{"output_type": "stream"}, {"data": data}],
                }
            )
            name = hashlib.sha256(still.encode()).hexdigest()
            (tmp_path / "vectors" / f"{name}.pdf").write_text(f"PDF of {still}")
        notebook = tmp_path / "jupyter_execute" / f"{page}.ipynb"
        notebook.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    (tmp_path / "html" / "scoreboard.csv").write_text("id,verdict\nlambda-typical,reproduced\n")
    return tmp_path


def test_every_drawn_panel_has_its_own_picture_as_png_and_pdf(tool, build):
    assert tool["main"](["--gather", str(build)]) == 0
    target = build / "reproduction"
    report = json.loads((target / "report.json").read_text(encoding="utf-8"))
    assert report["claims"] == [{"id": "lambda-typical", "verdict": "reproduced"}]
    drawn = [row for row in tool["panels"]() if tool["drawn"](row)]
    assert len(drawn) > 20
    for row in drawn:
        still = f"{row['page']} {row['label']}"
        assert (target / "figures" / f"{row['id']}.png").read_text() == still
        assert (target / "figures" / f"{row['id']}.pdf").read_text() == f"PDF of {still}"
    for entry in report["figures"]:
        for name, digest in entry.get("files", {}).items():
            assert hashlib.sha256((target / name).read_bytes()).hexdigest() == digest


def test_what_is_missing_is_named_and_fails(tool, build, capsys):
    row = next(row for row in tool["panels"]() if tool["drawn"](row))
    (build / "jupyter_execute" / f"{row['page']}.ipynb").unlink()
    assert tool["main"](["--gather", str(build)]) == 1
    assert f"MISSING {row['panel']}" in capsys.readouterr().out


def test_a_pdf_is_written_where_it_is_asked_for_under_the_name_of_its_png(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LISSOME_FIGURES", raising=False)
    fig, _ = plotting.figure(size=(1, 1))
    plotting.show(fig, alt="an empty pair of axes")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("LISSOME_FIGURES", str(tmp_path / "vectors"))
    still = plotting.show(fig, alt="an empty pair of axes").still
    (path,) = (tmp_path / "vectors").iterdir()
    assert path.name == f"{hashlib.sha256(still).hexdigest()}.pdf"
    assert path.read_bytes().startswith(b"%PDF-")


def test_the_manifest_is_in_step_with_the_figure_map(tool, root):
    assert (root / "codecheck.yml").read_text(encoding="utf-8") == tool["manifest"](), (
        "run `python tools/reproduce.py --manifest`"
    )
