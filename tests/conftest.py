"""Fixtures and paths that the tests of the repository share."""

import os
import sys
from pathlib import Path

import hypothesis
import pytest

# How long an example takes says nothing about whether it is right.
# A run that decides on a change draws the same examples each time; others look further.
hypothesis.settings.register_profile(
    "lissome", deadline=None, print_blob=True, derandomize=bool(os.environ.get("CI"))
)
hypothesis.settings.load_profile("lissome")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def root():
    """Folder of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def tools():
    """Make the scripts in tools/ importable; return their folder."""
    folder = ROOT / "tools"
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))
