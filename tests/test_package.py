"""The top level: what it lists exists, and loads only when it is used."""

import importlib
import importlib.resources
import pkgutil
import subprocess
import sys
import tomllib

import pytest

import lissome


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_alone_loads_no_heavy_module():
    loaded = run("import lissome, sys; print(*sys.modules)").split()
    heavy = {"numba", "llvmlite", "matplotlib", "pandas", "scipy", "numpy", "plotly", "pint"}
    assert not heavy & set(loaded)


@pytest.mark.parametrize("module", ["errors", "_validate", "_fingerprint", "sweeps"])
def test_light_modules_do_not_load_the_compiler(module):
    loaded = run(f"import lissome.{module}, sys; print(*sys.modules)").split()
    assert not {"numba", "matplotlib"} & set(loaded)


@pytest.mark.parametrize("name", lissome.__all__)
def test_every_public_name_resolves(name):
    assert getattr(lissome, name) is not None
    assert name in dir(lissome)


@pytest.mark.parametrize(("name", "module"), lissome._EXPORTS.items())
def test_names_are_public_where_they_are_defined(name, module):
    home = importlib.import_module(f"lissome.{module}")
    assert getattr(lissome, name) is getattr(home, name)
    assert name in home.__all__


def test_every_public_module_is_reached_from_the_top_level():
    modules = {module.name for module in pkgutil.iter_modules(lissome.__path__)}
    assert {name for name in modules if not name.startswith("_")} == set(lissome._SUBMODULES)


def test_rooms_come_with_their_first_use():
    code = "import lissome as ls; print(ls.references.__name__, ls.plotting.figure.__name__)"
    assert run(code).split() == ["lissome.references", "figure"]


def test_type_checkers_find_the_marker(root):
    assert importlib.resources.files("lissome").joinpath("py.typed").is_file()
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    assert "py.typed" in settings["tool"]["setuptools"]["package-data"]["lissome"]


def test_star_import_is_what_all_says():
    names = run("from lissome import *; print(*dir())").split()
    assert set(lissome.__all__) <= set(names)


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="no attribute 'strut'"):
        lissome.strut  # noqa: B018


def test_no_public_function_has_the_name_of_a_module():
    # Importing the module would put it in the place of the function.
    modules = {module.name for module in pkgutil.iter_modules(lissome.__path__)}
    assert not modules & set(lissome._EXPORTS)
    assert set(lissome._SUBMODULES) <= modules


@pytest.mark.parametrize("first", ["lissome.sweeps", "lissome"])
def test_sweep_is_a_function_whatever_is_imported_first(first):
    code = f"import {first}; import lissome, lissome.sweeps; print(callable(lissome.sweep))"
    assert run(code).strip() == "True"
