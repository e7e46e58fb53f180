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
    assert report["claims"] == [{"id": "lambda-typical", "verdict": "reproduced", "why": ""}]
    assert not (build / "reproduction.unfinished").exists()
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


def test_a_build_that_is_not_there_is_named_with_a_remedy(tool, tmp_path):
    with pytest.raises(SystemExit, match=r"cannot be gathered.*scoreboard\.csv.*make reproduce"):
        tool["main"](["--gather", str(tmp_path)])


def test_two_builds_are_compared_to_the_last_digit_and_word(tool, build, tmp_path, capsys):
    (build / "html" / "scoreboard.csv").write_text(
        "id,computed,verdict\nlambda-typical,1.1193,differs\npsi-function,,reproduced\n"
    )
    (build / "scoreboard").mkdir()
    assert tool["main"](["--gather", str(build)]) == 0
    path = build / "reproduction" / "report.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    other = tmp_path / "other.json"

    def differences(change):
        changed = json.loads(json.dumps(content))
        change(changed)
        other.write_text(json.dumps(changed), encoding="utf-8")
        capsys.readouterr()
        status = tool["main"](["--compare", str(build), str(other)])
        return status, capsys.readouterr().out

    def digit(report):
        report["claims"][0]["computed"] = "1.1194"

    def word(report):
        report["claims"][1]["why"] = "in other words"

    def lost(report):
        del report["claims"][1]

    def picture(report):
        files = next(row["files"] for row in report["figures"] if "files" in row)
        files[min(name for name in files if name.endswith(".png"))] = "0"
        report["machine"] = {"cores": 128}

    assert differences(lambda report: None) == (0, "2 and 2 claims, 0 differ\n")
    status, said = differences(digit)
    assert (status, said.splitlines()[:3]) == (
        1,
        ["lambda-typical: computed", "  1.1193", "  1.1194"],
    )
    status, said = differences(word)
    assert status == 1 and "psi-function: why" in said and "1 differ" in said
    status, said = differences(lost)
    assert status == 1 and f"psi-function: only in {build}" in said
    status, said = differences(picture)
    assert status == 0 and "not the same to the last bit" in said and "'cores': 128" in said
    for wrong in ("{", "[]", '{"claims": [{}], "figures": []}'):
        other.write_text(wrong)
        with pytest.raises(SystemExit, match=r"other\.json is no report of `make reproduce`"):
            tool["main"](["--compare", str(build), str(other)])


def test_a_build_that_fails_leaves_no_reproduction_of_an_earlier_one(tool, build, monkeypatch):
    assert tool["main"](["--gather", str(build)]) == 0
    monkeypatch.setattr(tool["runpy"], "run_path", lambda path: {"main": lambda arguments: 1})
    monkeypatch.setenv("LISSOME_FIGURES", "")
    assert tool["main"]([str(build)]) == 1
    assert not (build / "reproduction").exists()


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
