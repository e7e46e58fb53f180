"""What the README says holds: its code prints what is printed, its commands and files exist."""

import ast
import contextlib
import io
import re
import subprocess
import sys
import tomllib

import pytest

from lissome import literature


@pytest.fixture(scope="module")
def readme(root):
    return (root / "README.md").read_text(encoding="utf-8")


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_code_prints_what_is_printed(readme, number):
    codes, outputs = blocks(readme, "python"), blocks(readme, "text")
    assert len(codes) == len(outputs) == 3
    code, printed = codes[number], outputs[number]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(code, "README.md", "exec"), {})
    assert said.getvalue() == printed


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "book/index.md"])
def test_make_targets_exist(root, name):
    text = (root / name).read_text(encoding="utf-8")
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"(?:^|`)make ([a-z-]+)", text, re.MULTILINE))
    assert targets, "the page names no target"
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_files_exist(root, name):
    text = (root / name).read_text(encoding="utf-8")
    named = set(re.findall(r"\]\(([^):]+)\)", text))
    named |= set(re.findall(r"`((?:[\w.-]+/)*[\w-]+\.(?:md|txt|toml|csv|cff|py|json|yml))`", text))
    built = {"_build/html/scoreboard.csv"}
    missing = [n for n in named - built if "*" not in n and not (root / n).exists()]
    made_by_a_command = {"benchmarks/results.json"}
    assert set(missing) <= made_by_a_command


def test_pip_steps_are_those_of_make(root, readme):
    (steps,) = [block for block in blocks(readme, "") if "requirements.txt" in block]
    script = (root / "tools" / "environment.sh").read_text(encoding="utf-8")
    assert "-m pip install" in script
    assert "--requirement requirements.txt" in script
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    for line in steps.splitlines():
        what = line.removeprefix(".venv/bin/python ").removeprefix("python3 ")
        if what.startswith(("-m pytest", "tools/")):
            assert f"$(RUN) {what}" in makefile, line


def test_quick_start_installs_what_its_example_imports(root, readme):
    """The first example needs the library and what it requires, and no extra."""
    section = readme.split("## The library in two minutes")[1].split("\n## ")[0]
    assert "-m pip install .\n" in section
    (code,) = blocks(section, "python")
    imported = {
        (node.module if isinstance(node, ast.ImportFrom) else node.names[0].name).split(".")[0]
        for node in ast.walk(ast.parse(code))
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    required = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {re.match(r"[\w-]+", entry).group().lower() for entry in required["dependencies"]}
    assert imported <= names | {required["name"]}


def test_awaited_slots_are_those_that_are_awaited(readme):
    section = readme.split("## What is awaited")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `([a-z-]+)`", section, re.MULTILINE)) == set(literature.awaited())


def test_picture_is_small_and_described(root, readme):
    text, path = re.search(r"!\[([^]]+)\]\(([^)]+)\)", readme).groups()
    assert len(text.split()) > 10
    assert (root / path).stat().st_size < 100_000


def test_awaited_slots_can_be_described(root, readme):
    command = re.search(r"`python (-m lissome\.literature describe [a-z-]+)`", readme).group(1)
    done = subprocess.run([sys.executable, *command.split()], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "slinky" in done.stdout
