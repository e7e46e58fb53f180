"""The rooms of the house: imports go one way, and never in a circle."""

import ast
import graphlib
from pathlib import Path

import pytest

import lissome

ROOT = Path(lissome.__file__).parent

#: From the ground up. A room imports from rooms above it in this list, never from one below it;
#: those that share a line do not know each other.
FLOORS = [
    {"errors", "_version", "_compile", "_digits", "_archive", "_units", "_sources",
     "_fingerprint", "_validate", "_telling", "_progress", "_readonly", "_points", "_executors", "_work",
     "_datapackage"},
    {"sweeps", "literature", "_digitized", "factorization", "_chain", "_tridiagonal",
     "_multifrontal", "reactions"},
    {"structure", "_corrector", "_relaxation", "_descent", "stability", "equilibrium", "sensitivities",
     "_stored", "_branch_records", "_branch_file", "_follower", "branch", "evolution"},
    {"beams", "rods", "plates", "references"},
    {"ribbons"},
    {"judges"},
    {"scoreboard"},
    {"plotting", "notebook"},
]  # fmt: skip


def modules():
    """Return the name of every module with its path."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imported(name, *, anywhere):
    """Return the modules of the library that a module imports when it is loaded, or `anywhere`."""
    path = MODULES[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()

    def visit(node):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return  # for readers and checkers, not for the interpreter
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not anywhere:
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                up = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*up, base] if base else up)
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found.add(inner if inner in MODULES else base)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return {module for module in found if module in MODULES} - {name}


def room(module):
    return module.split(".")[1] if "." in module else "lissome"


def test_no_module_imports_itself_in_a_circle():
    # A package's own __init__ gathers its modules; a module that asks its package for a sibling
    # would close a circle.
    graph = {name: imported(name, anywhere=False) for name in MODULES}
    assert sum(map(len, graph.values())) > 200
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_every_room_has_its_floor():
    assert set().union(*FLOORS) == {room(name) for name in MODULES} - {"lissome"}
    assert sum(map(len, FLOORS)) == len(set().union(*FLOORS))


FLOOR = {name: floor for floor, rooms in enumerate(FLOORS) for name in rooms}


@pytest.mark.parametrize("name", [n for n in MODULES if n != "lissome"])
def test_nothing_imports_what_stands_above_it(name):
    own = FLOOR[room(name)]
    for other in imported(name, anywhere=True) - {"lissome"}:
        assert FLOOR[room(other)] <= own, f"{name} imports {other}"
        if own >= 3:  # kinds of structures and references do not know each other
            assert FLOOR[room(other)] < own or room(other) == room(name), f"{name}: {other}"


@pytest.mark.parametrize("name", [n for n in MODULES if room(n) == "references"])
def test_references_are_independent_of_what_they_judge(name):
    others = {room(other) for other in imported(name, anywhere=True)}
    assert not others & {"beams", "rods", "ribbons", "plates", "structure", "equilibrium"}
