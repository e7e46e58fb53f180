"""Compile requirements.txt anew, or check it; run it through `make lock` or `make lock-check`.

    lock.py            compile requirements.in with uv, then check the result
    lock.py --check    only check

The check asks pip to resolve the lock, from wheels alone, for every supported Python. Both need a
package index; nothing of its address is written.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13")


def compile_lock() -> None:
    command = [sys.executable, "-m", "pip", "install", "--quiet", "uv"]
    subprocess.run(command, check=True, cwd=ROOT)
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal", "--upgrade"]
    # one version of each package for every Python: published figures do not depend on it
    command += ["--python-version", PYTHONS[0], "--fork-strategy", "fewest"]
    command += ["--no-emit-index-url", "--no-annotate"]
    command += ["requirements.in", "-o", "requirements.txt"]
    environment = os.environ | {"UV_CUSTOM_COMPILE_COMMAND": "make lock"}
    subprocess.run(command, check=True, cwd=ROOT, env=environment)


def pins(text: str) -> str:
    """Return the lock without the library itself, which is no wheel."""
    kept = [line for line in text.splitlines() if not line.startswith(("-e ", "#"))]
    return "\n".join(kept) + "\n"


def check() -> int:
    text = (ROOT / "requirements.txt").read_text(encoding="utf-8")
    if foreign := re.findall(r"(?m)^(?:--|.*://).*$", text):
        print("requirements.txt names a place of this machine:", *foreign, sep="\n  ")
        return 1
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        lock = Path(folder) / "pins.txt"
        lock.write_text(pins(text), encoding="utf-8")
        for python in PYTHONS:
            command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet"]
            command += ["--ignore-installed", "--only-binary=:all:", "--python-version", python]
            command += ["--target", f"{folder}/{python}", "--requirement", str(lock)]
            result = subprocess.run(command, capture_output=True, text=True)
            print(f"Python {python}:", "resolves from wheels" if not result.returncode else "FAILS")
            if result.returncode:
                print(result.stderr)
                failed += 1
    return int(failed > 0)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compile nothing, only check")
    if not parser.parse_args(arguments).check:
        compile_lock()
    return check()


if __name__ == "__main__":
    sys.exit(main())
