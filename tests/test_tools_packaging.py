"""What the packaging files say agrees: with each other, and with what the code imports."""

import ast
import importlib
import json
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import metadata, packages_distributions

import pytest
import yaml
from myst_nb.core.read import read_myst_markdown_notebook
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

import lissome


@pytest.fixture(scope="module")
def project(root):
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def lock(root):
    lines = (root / "requirements.txt").read_text(encoding="utf-8").splitlines()
    found = [Requirement(line) for line in lines if re.match(r"[a-zA-Z0-9]", line)]
    return {canonicalize_name(r.name): r for r in found}


def imported_modules(folder):
    """Return the top-level names that the Python files below a folder import, wherever they do."""
    names = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names) - {"lissome"}


def test_dependencies_are_what_the_library_imports(project, root):
    providers = packages_distributions()
    imported = set()
    for module in imported_modules(root / "src"):
        assert module in providers, f"{module} is imported but not installed"
        imported |= {canonicalize_name(name) for name in providers[module]}
    declared = {canonicalize_name(Requirement(d).name) for d in project["dependencies"]}
    assert imported - declared == set(), "imported by the library but not declared"
    assert declared - imported == set(), "declared but imported nowhere"


def test_lock_satisfies_every_requirement(project, lock):
    wanted = list(project["dependencies"])
    for extra in project["optional-dependencies"].values():
        wanted += extra
    for requirement in map(Requirement, wanted):
        pin = lock.get(canonicalize_name(requirement.name))
        assert pin is not None, f"{requirement} is not locked: run `make lock`"
        (version,) = [s.version for s in pin.specifier if s.operator == "=="]
        assert requirement.specifier.contains(version), f"{pin} does not satisfy {requirement}"


def test_lock_is_complete_consistent_and_minimal_for_every_python(project, lock, tools):
    """What pip would resolve, from the metadata of the installed packages, for each Python."""
    import lock as tool

    roots = [*project["dependencies"]]
    for extra in project["optional-dependencies"].values():
        roots += extra
    needed = set()
    for python in tool.PYTHONS:
        environment = default_environment() | {
            "python_version": python,
            "python_full_version": f"{python}.9",
        }
        waiting, seen = list(map(Requirement, roots)), set()
        while waiting:
            requirement = waiting.pop()
            name, extras = canonicalize_name(requirement.name), frozenset(requirement.extras)
            pin = lock.get(name)
            assert pin is not None, f"{requirement} is not locked: run `make lock`"
            (version,) = [s.version for s in pin.specifier]
            assert requirement.specifier.contains(version, prereleases=True), (
                f"{pin} does not satisfy {requirement} on Python {python}"
            )
            assert pin.marker is None or pin.marker.evaluate(environment), f"{pin} on {python}"
            if (name, extras) in seen:
                continue
            seen.add((name, extras))
            about = metadata(name)
            pythons = SpecifierSet(about.get("Requires-Python") or "")
            assert pythons.contains(f"{python}.9"), f"{pin} does not run on Python {python}"
            for line in about.get_all("Requires-Dist", []):
                further = Requirement(line)
                if further.marker is None or any(
                    further.marker.evaluate(environment | {"extra": extra})
                    for extra in ("", *extras)
                ):
                    waiting.append(further)
        needed |= {name for name, _ in seen}
    installed = {name for name, pin in lock.items() if not pin.marker or pin.marker.evaluate()}
    assert installed - needed == set(), "locked, but nobody needs it: run `make lock`"


def test_lock_pins_exactly_and_installs_the_library(root, lock):
    lines = (root / "requirements.txt").read_text(encoding="utf-8").splitlines()
    entries = [line for line in lines if line and not line.startswith("#")]
    assert entries[0] == "-e ."
    for requirement in lock.values():
        assert [s.operator for s in requirement.specifier] == ["=="], str(requirement)
    assert not [line for line in entries if "://" in line or line.startswith("--")]


def test_versions_agree(root):
    citation = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    assert str(citation["version"]) == lissome.__version__
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+)", changelog, re.MULTILINE).group(1) == lissome.__version__


def test_top_level_offers_no_place_of_this_machine(root):
    """Committed text names no folder and no index of the machine it was written on."""
    done = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True)
    if done.returncode:
        pytest.skip("not a git repository")
    suspicious = re.compile(r"/(?:home|root|Users)/\w|file:///\w|(?<![\w.$}])/(?:work|tmp)/\w")
    for name in done.stdout.splitlines():
        path = root / name
        if path.suffix in {".png", ".webp", ".svg"} or not path.is_file():
            continue
        found = suspicious.search(path.read_text(encoding="utf-8"))
        if found and name != "tests/test_tools_packaging.py":
            pytest.fail(f"{name} names a place of one machine: {found.group()}")


def test_classifiers_are_the_pythons_that_the_lock_is_checked_for(project, tools):
    import lock

    listed = [c.rsplit(" :: ", 1)[1] for c in project["classifiers"] if ":: 3." in c]
    assert tuple(listed) == lock.PYTHONS
    assert Requirement(f"python{project['requires-python']}").specifier.contains(lock.PYTHONS[0])


def test_binder_finds_what_it_reads(root, tools):
    """repo2docker takes `python-X.Y` from runtime.txt, and installs requirements.txt where it lies."""
    import lock

    found = re.fullmatch(r"python-(3\.\d+)\n", (root / "runtime.txt").read_text(encoding="utf-8"))
    assert found and found[1] in lock.PYTHONS
    for better in ("environment.yml", "Pipfile", "binder", ".binder", "Dockerfile"):
        assert not (root / better).exists(), "Binder would read this instead"


def without(*starts):
    """Return the environment without some variables, and without what a make above this run says."""
    left_out = (*starts, "MAKE", "MFLAGS")
    return {name: value for name, value in os.environ.items() if not name.startswith(left_out)}


@pytest.mark.parametrize("environment", [{"LC_ALL": "C"}, {"LC_ALL": "POSIX"}, {"LANG": "C"}, {}])
def test_make_starts_python_below_folders_of_any_name(root, tmp_path, environment):
    """Python 3.11 and 3.12 read .pth files in the encoding of the locale, or do not start at all."""
    make = shutil.which("make")
    if make is None:
        pytest.skip("needs make")
    here = tmp_path / "Büro 2"
    here.mkdir()
    (here / "names.pth").write_text(f"{here}\n", encoding="utf-8")
    code = f"import site; site.addsitedir({str(here)!r}); print('starts')"
    text = (root / "Makefile").read_text(encoding="utf-8")
    (here / "Makefile").write_text(
        text + f'\nstart:\n\t@"{sys.executable}" -c "{code}"\n', encoding="utf-8"
    )
    kept = without("LC_", "LANG", "PYTHON")
    done = subprocess.run(
        [make, "start"], cwd=here, env={**kept, **environment}, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "starts\n"), done.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals of this system are others")
def test_whoever_ends_make_ends_what_it_runs(root, tmp_path):
    make = shutil.which("make")
    if make is None:
        pytest.skip("needs make")
    text = (root / "Makefile").read_text(encoding="utf-8")
    (tmp_path / "Makefile").write_text(text, encoding="utf-8")
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "environment.sh").write_text("")
    script = (
        "import signal, sys, time\n"
        "def end(*_):\n"
        "    print('told', flush=True)\n"
        "    sys.exit(3)\n"
        "signal.signal(signal.SIGTERM, end)\n"
        "print('begun', flush=True)\n"
        "time.sleep(600)\n"
    )
    (tmp_path / "tools" / "build_book.py").write_text(script)
    (tmp_path / "venv" / "bin").mkdir(parents=True)
    (tmp_path / "venv" / "bin" / "python").symlink_to(sys.executable)
    process = subprocess.Popen(
        [make, "-s", "book", "VENV=venv"], cwd=tmp_path, env=without(), stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert process.stdout.readline() == "begun\n"
    process.terminate()
    assert process.communicate(timeout=60)[0] == "told\n"
    assert process.returncode != 0


def test_book_configuration_offers_no_remote_service(root):
    config = yaml.safe_load((root / "_config.yml").read_text(encoding="utf-8"))
    assert "repository" not in config
    assert not any(config["launch_buttons"][key] for key in ("binderhub_url", "colab_url", "thebe"))
    assert not any(value for key, value in config["html"].items() if key.startswith("use_"))


def test_notebooks_are_kept_without_outputs(root):
    assert not list((root / "book").rglob("*.ipynb"))
    for page in (root / "book").rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        if "{code-cell}" in text:
            header = yaml.safe_load(text.split("---")[1])
            assert header["kernelspec"]["name"] == "python3", page.name
            assert header["jupytext"]["text_representation"]["format_name"] == "myst", page.name


def test_every_cell_can_be_read(root):
    """Options of cells are YAML, in which a caption with a colon needs quotes."""
    for page in (root / "book").rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        if "{code-cell}" in text:
            assert read_myst_markdown_notebook(text, path=page).cells, page.name


def test_every_page_is_in_the_contents(root):
    contents = (root / "book" / "_toc.yml").read_text(encoding="utf-8")
    listed = set(re.findall(r"(?:file|root): (\S+)", contents))
    pages = {
        p.relative_to(root / "book").with_suffix("").as_posix()
        for p in (root / "book").rglob("*.md")
        if "_" not in p.relative_to(root / "book").parts[0][:1]
    }
    assert pages == listed


def test_stored_benchmarks_are_complete(root):
    stored = root / "benchmarks" / "results.json"
    if not stored.is_file():
        pytest.skip("no benchmark is stored yet")
    result = json.loads(stored.read_text(encoding="utf-8"))
    assert {"taken", "commit", "sources", "machine", "versions", "benchmarks"} <= set(result)
    for row in result["benchmarks"]:
        assert row["median_seconds"] > 0
        assert (row["against"] is None) == (row["ratio"] is None)


def public_modules():
    """Return the public modules of the library, but those that their package shows in full.

    The judges of single claims are shown by the scoreboard.
    """
    found = []
    for info in pkgutil.walk_packages(lissome.__path__, "lissome."):
        if any(part.startswith("_") for part in info.name.split(".")):
            continue
        if info.name.startswith("lissome.judges."):
            continue
        module = importlib.import_module(info.name)
        parent = importlib.import_module(info.name.rpartition(".")[0])
        names = getattr(module, "__all__", [])
        shown = parent is not lissome and set(names) <= set(getattr(parent, "__all__", []))
        if names and not shown:
            found.append(info.name)
    return found


def test_every_public_module_is_in_the_reference(root):
    pages = "".join(p.read_text(encoding="utf-8") for p in (root / "book" / "api").glob("*.md"))
    documented = set(re.findall(r"automodule:: (\S+)", pages))
    assert set(public_modules()) - documented == set()
