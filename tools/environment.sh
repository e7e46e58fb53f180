#!/bin/sh
# Create or refresh the environment: environment.sh PYTHON VENV (run from the repository root).
#
# The stamp inside the environment names what was installed: a checksum of the requirements, the
# place of the repository (it is installed editable) and the interpreter. It is removed before an
# installation and written after it, so an interrupted one is taken up again.
set -eu
python=$1
venv=$2
stamp=$venv/.lissome-stamp

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

[ -f requirements.txt ] || fail "requirements.txt not found: run make in the root of the repository"

want="$(cat requirements.txt pyproject.toml | cksum)
$(pwd -P)
$("$venv/bin/python" -V 2>/dev/null || true)"
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$want" ]; then
    exit 0
fi

if [ ! -x "$venv/bin/python" ]; then
    command -v "$python" >/dev/null 2>&1 ||
        fail "'$python' not found: install Python 3.11 or newer, or name it: make PYTHON=/path/to/python3"
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        fail "$("$python" -V 2>&1) is too old: Lissome needs 3.11 or newer; name one: make PYTHON=python3.12"
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        fail "$("$python" -V 2>&1) comes without venv: install it (Debian, Ubuntu: apt-get install python3-venv)"
    echo "creating the environment $venv with $("$python" -V 2>&1)"
    "$python" -m venv "$venv"
fi
"$venv/bin/python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    fail "$venv holds $("$venv/bin/python" -V 2>&1), Lissome needs 3.11 or newer: delete it, or name another: make VENV=..."

rm -f "$stamp"
echo "installing requirements.txt into $venv (about 1.7 GB; some minutes)"
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_REQUIRE_VIRTUALENV=1
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || # its creation was interrupted
    "$venv/bin/python" -m ensurepip --upgrade --default-pip >/dev/null ||
    fail "$venv is broken: delete it and run make again"
"$venv/bin/python" -m pip install --quiet --requirement requirements.txt ||
    fail "requirements.txt could not be installed into $venv, see above. If a line of it is damaged, restore
       the file from version control; if the network or the disk failed, mend that; then run make again"
"$venv/bin/python" -m pip check ||
    fail "packages in $venv do not fit together, see above: delete it and run make again"
want="$(cat requirements.txt pyproject.toml | cksum)
$(pwd -P)
$("$venv/bin/python" -V)"
printf '%s\n' "$want" >"$stamp.new"
mv "$stamp.new" "$stamp"
