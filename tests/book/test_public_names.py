"""Links from listings of sources back to the reference."""

import runpy

import pytest


@pytest.fixture(scope="module")
def extension(root):
    return runpy.run_path(str(root / "book" / "_ext" / "public_names.py"))


@pytest.fixture(scope="module")
def mended(extension):
    return extension["mended"]


def listing(anchor):
    return f'<a class="viewcode-back" href="../api/rods.html#{anchor}">[docs]</a>'


@pytest.mark.parametrize(
    ("anchor", "right"),
    [
        ("package.known", "package.known"),  # documented as a name of the package
        ("package.Kind.method", "package.part.Kind.method"),  # documented as a name of the module
        ("package.unknown", "package.unknown"),  # left as it is: the check of the pages tells
    ],
)
def test_links_point_to_what_is_documented(mended, anchor, right):
    documented = {"package.known", "package.part.Kind", "package.part.Kind.method"}
    assert mended(listing(anchor), "package.part", documented) == listing(right)


@pytest.mark.parametrize(
    ("module", "name", "full"),
    [
        ("rods.topology", "writhe", "lissome.rods.writhe"),
        ("rods.topology", "Crossings", "lissome.rods.topology.Crossings"),
        ("", "rods.centerline.State.move", "lissome.rods.State.move"),
        ("rods.topology", "unknown", None),
    ],
)
def test_names_that_a_package_shows_are_found_from_their_module(extension, module, name, full):
    documented = {"lissome.rods.writhe", "lissome.rods.State.move"}
    found = extension["of_package"](module, name, documented)
    assert found == (full if full in documented else None)
