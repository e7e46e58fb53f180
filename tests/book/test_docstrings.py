"""What the reference says of every public name: parameters, errors, and an example that runs."""

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import textwrap
from collections import Counter
from functools import cached_property

from numpydoc.docscrape import NumpyDocString

import lissome
from lissome import evolution, rods, structure

#: Classes whose methods say what is passed: those of the same name need not say it again.
PROTOCOLS = (structure.Structure, evolution.Evolving, rods.Law)

DIRECTIVE = re.compile(r"^\.\. automodule:: (\S+)\n((?:[ ]+:.*\n)*)", re.MULTILINE)


def shown(root):
    """Yield the names that the pages of the reference show, as (module, name)."""
    for page in sorted((root / "book" / "api").glob("*.md")):
        for module, options in DIRECTIVE.findall(page.read_text(encoding="utf-8") + "\n"):
            given = dict(re.findall(r":([a-z-]+): *(.*)", options))
            if "members" in given:
                left_out = re.findall(r"\w+", given.get("exclude-members", ""))
                every = importlib.import_module(module).__all__
                names = re.findall(r"\w+", given["members"]) or every
                yield from ((module, name) for name in names if name not in left_out)


def full_name(thing):
    """Return where a class or function is defined, or None for anything else."""
    if inspect.isclass(thing) or inspect.isfunction(inspect.unwrap(thing)):
        return f"{thing.__module__}.{thing.__qualname__}"
    return None


def objects(root):
    """Return every class and function that the reference shows, by its full name."""
    things = (getattr(importlib.import_module(module), name) for module, name in shown(root))
    return {full_name(thing): thing for thing in things if full_name(thing)}


def members(kind):
    """Yield the public methods and properties that a class defines, as (name, function)."""
    for name, value in vars(kind).items():
        if isinstance(value, (classmethod, staticmethod)):
            value = value.__func__
        elif isinstance(value, property):
            value = value.fget
        elif isinstance(value, cached_property):
            value = value.func
        if not name.startswith("_") and inspect.isfunction(value):
            yield name, value


def parameters(function):
    """Return the names of the parameters, with their stars."""
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    every = list(inspect.signature(function).parameters.values())
    if every and every[0].name in ("self", "cls"):
        del every[0]
    return [stars.get(p.kind, "") + p.name for p in every]


def documented(docstring, *sections):
    """Return the names that the sections describe, in their order."""
    return [
        name.strip() for s in sections for entry in docstring[s] for name in entry.name.split(",")
    ]


def raised(function):
    """Return the names of the exceptions of the library that a function raises in its own body."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    checks = vars(importlib.import_module("lissome._validate"))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            names.add(ast.unparse(node.exc.func).rpartition(".")[2])
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func).rpartition(".")[2]
            if inspect.isfunction(checks.get(called)):
                names.add("InvalidInput")
    caught = {
        ast.unparse(h.type) for n in ast.walk(tree) if isinstance(n, ast.Try) for h in n.handlers
        if h.type is not None
    }  # fmt: skip
    errors = vars(importlib.import_module("lissome.errors"))
    return {n for n in names if n in errors} - caught


def unsaid_errors(docstring, function):
    said = {entry.type or entry.name for entry in docstring["Raises"]}
    return sorted(raised(function) - said)


def faults_of_method(owner, name, function):
    yield from ()
    text = inspect.getdoc(function)
    if not text:
        yield f"{name}: no docstring"
        return
    docstring = NumpyDocString(text)
    for error in unsaid_errors(docstring, function):
        yield f"{name}: raises {error}, which `Raises` does not say"
    bases = [*owner.__mro__[1:], *(p for p in PROTOCOLS if p is not owner)]
    if any(name in vars(base) for base in bases):
        return
    names = documented(docstring, "Parameters", "Other Parameters")
    expected = parameters(function)
    if names and sorted(names) != sorted(expected):
        yield f"{name}: documents {names}, takes {expected}"
    for parameter in [] if names else expected:
        if f"`{parameter.lstrip('*')}`" not in text:
            yield f"{name}: says nothing of `{parameter}`"


def faults_of_class(kind):
    docstring = NumpyDocString(inspect.getdoc(kind))
    values = documented(docstring, "Parameters", "Attributes")
    if dataclasses.is_dataclass(kind):
        bases = [vars(base).get("__dataclass_fields__", {}) for base in kind.__mro__[1:]]
        new = [f for f in dataclasses.fields(kind) if not any(f.name in base for base in bases)]
        expected = [f.name for f in new if f.init]
        expected = [name for name in expected if not name.startswith("_")]
    elif hasattr(kind, "_fields"):
        expected = list(kind._fields)
    else:
        own = "__init__" in vars(kind) and not getattr(kind, "_is_protocol", False)
        expected = parameters(kind.__init__) if own else []
    for name in expected:
        if name not in values:
            yield f"says nothing of `{name}`"
    taken = {*expected, *(parameters(kind.__init__) if "__init__" in vars(kind) else ())}
    for name in documented(docstring, "Parameters"):
        if name not in taken:
            yield f"documents a parameter `{name}` that it does not take"
    generated = "__init__" if dataclasses.is_dataclass(kind) else ""
    made = [vars(kind).get(n) for n in ("__init__", "__post_init__") if n != generated]
    for function in filter(inspect.isfunction, made):
        for error in unsaid_errors(docstring, function):
            yield f"raises {error}, which `Raises` does not say"
    for name, function in members(kind):
        yield from faults_of_method(kind, name, function)


def faults_of_function(function):
    docstring = NumpyDocString(inspect.getdoc(function))
    names = documented(docstring, "Parameters", "Other Parameters")
    if sorted(names) != sorted(parameters(function)):
        yield f"documents {names}, takes {parameters(function)}"
    for error in unsaid_errors(docstring, function):
        yield f"raises {error}, which `Raises` does not say"


def faults(thing):
    """Yield what the docstring of a public class or function lacks."""
    if not inspect.getdoc(thing):
        yield "no docstring"
        return
    if not NumpyDocString(inspect.getdoc(thing))["Examples"]:
        yield "no example"
    yield from (faults_of_class if inspect.isclass(thing) else faults_of_function)(thing)


def public_modules():
    """Yield the modules without an underscore in their name."""
    for info in pkgutil.walk_packages(lissome.__path__, "lissome."):
        if not any(part.startswith("_") for part in info.name.split(".")):
            yield importlib.import_module(info.name)


def test_the_reference_shows_every_public_name_once(root):
    count = Counter(
        full_name(getattr(importlib.import_module(module), name)) for module, name in shown(root)
    )
    del count[None]
    assert [name for name, times in count.items() if times > 1] == []
    public = {
        full_name(getattr(module, name))
        for module in public_modules()
        for name in getattr(module, "__all__", ())
    }
    assert public - {None} <= set(count)


def test_every_public_name_says_what_it_takes_and_shows_it(root):
    found = {name: list(faults(thing)) for name, thing in objects(root).items()}
    assert len(found) > 300
    lines = [f"{name}: {fault}" for name, list_ in found.items() for fault in list_]
    assert not lines, "\n".join(["docstrings lack:", *lines])
