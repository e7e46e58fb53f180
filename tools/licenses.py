"""Licenses of everything that is installed: licenses.py writes DEPENDENCIES.md, --check compares.

What requirements.txt pins is looked up in the metadata of the installed packages. A license that is
unknown here, or that does not go with BSD-3-Clause, is an error: add it to the tables below after
reading it, or do without the package.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
TABLE = "DEPENDENCIES.md"

#: Permissive: the code may be used and passed on under terms like our own.
PERMISSIVE = frozenset(
    {
        *("0BSD", "Apache-2.0", "Artistic-1.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0"),
        *("ISC", "Matplotlib", "MIT", "MIT-CMU", "PSF-2.0", "Public-Domain", "Unlicense", "Zlib"),
    }
)
#: Copyleft of files or of the library itself: imported as it is, it asks nothing of whoever imports.
LIBRARY = frozenset({"LGPL-3.0-or-later", "MPL-2.0"})

CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
FIELDS = {
    "Apache 2.0": "Apache-2.0",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
}
#: Whose metadata are not plain, and why they stand here.
READ_BY_US = {
    # the only files under the GPL are a mode for Emacs and no part of the wheel
    "docutils": "Public-Domain AND BSD-2-Clause AND PSF-2.0",
    "matplotlib": "Matplotlib",  # the text of it, which is that of Python with another name
    "sphinx-mathjax-offline": "MIT AND Apache-2.0",  # MathJax is the second
    "text-unidecode": "Artistic-1.0 OR GPL-2.0-or-later",
}
#: What is installed on other systems only.
ELSEWHERE = {
    "appnope": "BSD-2-Clause",
    "cffi": "MIT",
    "colorama": "BSD-3-Clause",
    "pycparser": "BSD-3-Clause",
}


class UnknownLicense(Exception):
    """No license can be told, or one that does not go with ours."""


def stated(name: str, metadata: Any) -> str:
    """Return the license expression of a package, given what its metadata say."""
    if name in READ_BY_US:
        return READ_BY_US[name]
    if expression := metadata.get("License-Expression"):
        return str(expression)
    field = (metadata.get("License") or "").strip()
    if set(re.split(r" (?:AND|OR) ", field)) <= PERMISSIVE | LIBRARY:
        return field
    if field in FIELDS:
        return FIELDS[field]
    prefix = "License :: OSI Approved :: "
    found = [c for c in metadata.get_all("Classifier", []) if c.startswith(prefix)]
    names = [CLASSIFIERS.get(c.removeprefix(prefix), c) for c in found]
    if not names:
        raise UnknownLicense(f"{name}: no license in its metadata (License: {field[:60]!r})")
    return " AND ".join(names)


def agrees(expression: str) -> bool:
    """Tell whether a license expression goes with ours: one of the choices, and all parts of it."""
    return any(
        all(
            part.partition(" WITH ")[0].strip("() ") in PERMISSIVE | LIBRARY
            for part in choice.split(" AND ")
        )
        for choice in expression.split(" OR ")
    )


def pinned(root: Path = ROOT) -> list[Requirement]:
    """Return the packages of the lock."""
    lines = (root / "requirements.txt").read_text(encoding="utf-8").splitlines()
    return [Requirement(line) for line in lines if re.match(r"[a-zA-Z0-9]", line)]


def licenses(requirements: list[Requirement]) -> dict[str, str]:
    """Return the license expression of every package; raise where one is unknown or disagrees."""
    found: dict[str, str] = {}
    wrong = []
    for requirement in requirements:
        name = canonicalize_name(requirement.name)
        try:
            if requirement.marker is not None and not requirement.marker.evaluate():
                if name not in ELSEWHERE:
                    raise UnknownLicense(f"{name}: not installed here; add it to ELSEWHERE")
                found[name] = ELSEWHERE[name]
            else:
                found[name] = stated(name, importlib.metadata.metadata(name))
            if not agrees(found[name]):
                raise UnknownLicense(f"{name}: {found[name]} is not known to go with ours")
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{name}: not installed; run `make env`")
        except UnknownLicense as error:
            wrong.append(str(error))
    if wrong:
        raise UnknownLicense("; ".join(wrong))
    return found


def uses(root: Path = ROOT) -> dict[str, str]:
    """Return what the project itself asks each package for: the library, or an extra."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = {}
    for extra, wanted in [*project["optional-dependencies"].items(), ("", project["dependencies"])]:
        for requirement in map(Requirement, wanted):
            found[canonicalize_name(requirement.name)] = f"extra `{extra}`" if extra else "library"
    return found


def table(root: Path = ROOT) -> str:
    """Return the text of DEPENDENCIES.md."""
    asked = uses(root)
    lines = [
        "# What Lissome stands on",
        "",
        "Every package that `requirements.txt` pins, with the license that its metadata state. They are",
        "installed beside Lissome, not passed on with it; packages under the MPL or LGPL are used as they",
        "are, as libraries. A built book carries MathJax (Apache-2.0), plotly.js (MIT), the theme",
        "(BSD-3-Clause) and its icons (Font Awesome Free: CC BY 4.0, OFL and MIT).",
        "",
        "Packages without a use are needed by others. `make licenses` writes this file, and a test fails",
        "on a license that is unknown or that does not go with BSD-3-Clause.",
        "",
        "| package | license | use |",
        "| --- | --- | --- |",
    ]
    for name, license in sorted(licenses(pinned(root)).items()):
        lines.append(f"| {name} | {license} | {asked.get(name, '')} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing, only compare")
    options = parser.parse_args(arguments)
    path = ROOT / TABLE
    try:
        text = table()
    except UnknownLicense as error:
        print(f"error: {error}")
        return 1
    if not options.check:
        path.write_text(text, encoding="utf-8")
    elif not path.is_file() or path.read_text(encoding="utf-8") != text:
        print(f"error: {TABLE} is not in step: run `make licenses`")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
