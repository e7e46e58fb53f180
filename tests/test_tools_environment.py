"""tools/environment.sh: reuses, refreshes, and leaves no stamp after an interrupted installation."""

import shutil
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")

FAKE = """#!/bin/sh
case "$*" in
  -V) echo "Python {version}" ;;
  *sys.version_info*) exit {old} ;;
  "-m ensurepip "*) touch "$(dirname "$0")/pip" ;;
  *ensurepip*) exit {no_venv} ;;
  "-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && {pip} "$3/bin/pip" ;;
  "-m pip --version") test -e "$(dirname "$0")/pip" ;;
  *"pip install"*) echo install >>log && exit {fails} ;;
  "-m pip check") exit {clash} ;;
esac
"""


@pytest.fixture
def place(tmp_path, root):
    """A repository, in a folder with a space in its name, without any real Python."""
    here = tmp_path / "a folder"
    (here / "tools").mkdir(parents=True)
    shutil.copy(root / "tools" / "environment.sh", here / "tools")
    (here / "requirements.txt").write_text("numpy==2\n")
    (here / "pyproject.toml").write_text("")
    return here


def python(place, *, version="3.11.9", old=0, no_venv=0, fails=0, clash=0, pip="touch"):
    fake = place / "fake python"
    fake.write_text(
        FAKE.format(version=version, old=old, no_venv=no_venv, fails=fails, clash=clash, pip=pip)
    )
    fake.chmod(0o755)
    return str(fake)


def run(place, interpreter, venv="my env"):
    command = ["sh", "tools/environment.sh", interpreter, venv]
    return subprocess.run(command, cwd=place, capture_output=True, text=True)


def installs(place):
    log = place / "log"
    return log.read_text().count("install") if log.exists() else 0


def test_second_run_reuses_and_changed_requirements_reinstall(place):
    fake = python(place)
    assert run(place, fake).returncode == 0
    assert installs(place) == 1
    done = run(place, fake)
    assert (done.returncode, done.stdout, installs(place)) == (0, "", 1)
    (place / "requirements.txt").write_text("numpy==2.1\n")
    assert run(place, fake).returncode == 0
    assert installs(place) == 2


def test_interrupted_installation_is_taken_up_again(place):
    assert run(place, python(place, fails=1)).returncode != 0
    assert not (place / "my env" / ".lissome-stamp").exists()
    shutil.copy(python(place), place / "my env" / "bin" / "python")
    assert run(place, python(place)).returncode == 0
    assert installs(place) == 2


def test_environment_whose_creation_was_interrupted_gets_its_pip(place):
    assert run(place, python(place, pip="test -d")).returncode != 0  # the creation fails half way
    assert not (place / "my env" / "bin" / "pip").exists()
    assert run(place, python(place)).returncode == 0
    assert (place / "my env" / "bin" / "pip").exists()
    assert installs(place) == 1


def test_packages_that_do_not_fit_together_are_refused(place):
    done = run(place, python(place, clash=1))
    assert done.returncode != 0
    assert "do not fit together" in done.stderr
    assert not (place / "my env" / ".lissome-stamp").exists()


@pytest.mark.parametrize("line", ["numpy=2.4.6", "<<<<<<< HEAD"])
def test_damaged_line_of_the_requirements_is_named_with_a_remedy(place, line):
    """The real pip looks at all lines before it asks anybody for anything."""
    real = place / "real python"
    venv = '[ "$1 $2" = "-m venv" ] && mkdir -p "$3/bin" && exec cp "$0" "$3/bin/python"\n'
    index = "export PIP_NO_INDEX=1 PIP_CONFIG_FILE=/dev/null\n"
    real.write_text(
        f'#!/bin/sh\n{venv}{index}unset PIP_REQUIRE_VIRTUALENV\nexec "{sys.executable}" "$@"\n'
    )
    real.chmod(0o755)
    (place / "requirements.txt").write_text(f"tqdm\n{line}\n")
    done = run(place, str(real))
    assert done.returncode != 0
    assert "restore\n       the file from version control" in done.stderr
    assert not (place / "my env" / ".lissome-stamp").exists()


def test_failed_refresh_does_not_count_as_installed(place):
    assert run(place, python(place)).returncode == 0
    (place / "requirements.txt").write_text("numpy==3\n")
    shutil.copy(python(place, fails=1), place / "my env" / "bin" / "python")
    assert run(place, python(place, fails=1)).returncode != 0
    (place / "requirements.txt").write_text("numpy==2\n")  # as it was when it was installed
    shutil.copy(python(place), place / "my env" / "bin" / "python")
    assert run(place, python(place)).returncode == 0
    assert installs(place) == 3


def test_moved_repository_is_installed_anew(place):
    assert run(place, python(place)).returncode == 0
    elsewhere = place.rename(place.with_name("another folder"))
    assert run(elsewhere, python(elsewhere)).returncode == 0
    assert installs(elsewhere) == 2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"version": "3.10.1", "old": 1}, ["3.10.1", "3.11 or newer", "make PYTHON="]),
        ({"no_venv": 1}, ["without venv", "python3-venv"]),
    ],
)
def test_unfit_python_is_named_with_a_remedy(place, given, words):
    done = run(place, python(place, **given))
    assert done.returncode != 0
    assert not (place / "my env").exists()
    for word in words:
        assert word in done.stderr


def test_missing_python_is_named(place):
    done = run(place, "python-of-nowhere")
    assert done.returncode != 0
    assert "'python-of-nowhere' not found" in done.stderr
