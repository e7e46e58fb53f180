"""Build the book, strictly: build_book.py [BUILD]; run it through `make book`.

Any warning, any exception in a cell and anything that a cell writes to stderr fail the build; every
build starts from nothing, since unchanged pages would not be looked at again and a second run would
then turn a failure green. The result is BUILD/html/index.html.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: What earlier builds leave behind, below BUILD. Nothing else there is touched.
LEFTOVERS = ("html", "jupyter_execute", ".doctrees", "scoreboard")


def prepare(build: Path) -> None:
    """Start from nothing, and let no file of the user's account take part."""
    for name in LEFTOVERS:
        shutil.rmtree(build / name, ignore_errors=True)
        if (build / name).exists():
            sys.exit(f"error: {build / name} cannot be deleted: check who owns it")
    private = build / "cache"
    settings = {
        "LISSOME_SCOREBOARD": build / "scoreboard",
        "IPYTHONDIR": private / "ipython",
        "JUPYTER_CONFIG_DIR": private / "jupyter" / "config",
        "JUPYTER_DATA_DIR": private / "jupyter" / "data",
        "JUPYTER_RUNTIME_DIR": private / "jupyter" / "runtime",
        "MPLCONFIGDIR": private / "matplotlib",
    }
    for name, folder in settings.items():
        folder.mkdir(parents=True, exist_ok=True)
        os.environ[name] = str(folder)
    os.environ["JUPYTER_NO_CONFIG"] = "1"
    os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"  # else the kernel warns on stderr
    for name in ("MPLBACKEND", "PYTHONSTARTUP"):
        os.environ.pop(name, None)  # MPLBACKEND=Agg would turn every figure off
    os.environ["JUPYTER_PATH"] = str(own_kernel(private / "kernel"))


def own_kernel(folder: Path) -> Path:
    """Describe the kernel `python3` as this very interpreter, whatever else the account offers."""
    target = folder / "kernels" / "python3" / "kernel.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    command += ["--log-level=ERROR"]  # else each kernel warns that it talks over a local socket
    kernel = {"argv": command, "display_name": "Python 3", "language": "python"}
    target.write_text(json.dumps(kernel | {"metadata": {"debugger": False}}), encoding="utf-8")
    return folder


def warm_fonts() -> None:
    """Let matplotlib scan the fonts now: in a cell it would say so on stderr."""
    import matplotlib.font_manager

    matplotlib.font_manager.fontManager.findfont("DejaVu Sans")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", nargs="?", default="_build", type=Path)
    build = parser.parse_args(arguments).build.absolute()
    began = time.monotonic()
    os.chdir(ROOT)
    prepare(build)
    warm_fonts()

    from jupyter_book.sphinx import build_sphinx

    status = build_sphinx(
        ROOT / "book",
        build / "html",
        path_config=ROOT / "_config.yml",
        noconfig=True,
        confoverrides={
            "external_toc_path": str(ROOT / "book" / "_toc.yml"),
            "latex_individualpages": False,
            "nitpicky": True,
            # A failing cell is a warning here, hence an error at the end: all pages get their turn,
            # and the traceback is shown. (Other ways to build the book stop at the first one.)
            "nb_execution_raise_on_error": False,
            "nb_execution_show_tb": True,
        },
        freshenv=True,
        force_all=True,
        warningiserror=True,
        keep_going=True,
    )
    minutes, seconds = divmod(round(time.monotonic() - began), 60)
    if status != 0:
        print(f"\nThe book FAILED after {minutes} min {seconds} s: see the messages above.")
        return 1
    page = build / "html" / "index.html"
    if not page.is_file():
        print(f"\nThe book FAILED: {page} was not written.")
        return 1
    print(f"\nThe book is built ({minutes} min {seconds} s). Open {page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
