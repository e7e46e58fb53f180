"""Build the book, strictly: build_book.py [BUILD]; run it through `make book`.

Any warning, any exception in a cell and anything that a cell writes to stderr fail the build; every
build starts from nothing, since unchanged pages would not be looked at again and a second run would
then turn a failure green. The result is BUILD/html/index.html; the folder has this name only when
all of it is built and right (until then it is BUILD/html.unfinished).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent

#: What earlier builds leave behind, below BUILD. Nothing else there is touched.
LEFTOVERS = ("html", "html.unfinished", "jupyter_execute", ".doctrees", "scoreboard")

#: Sums have one order, whatever the number of processors: verdicts are the same to the last digit.
#: Sweeps use all processors, by processes.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

#: Compiles something, and says why it cannot be stored if that is so.
PROBE = """
import warnings
from lissome._compile import jit
from lissome.errors import CacheWarning
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    jit(lambda: 1)()
for warning in told:
    if issubclass(warning.category, CacheWarning):
        print(warning.message)
"""


def stop(message: str) -> NoReturn:
    sys.exit(f"error: {message}")


def open_build(build: Path) -> None:
    """Make the folder, and see that it is ours: kernels and Sphinx execute what they find in it."""
    try:
        build.mkdir(parents=True, exist_ok=True)
        status = build.stat()
        with tempfile.TemporaryFile(dir=build) as probe:
            probe.write(b"x" * 4096)
    except OSError as error:
        stop(
            f"the book cannot be built in {build} ({error}): choose another folder, make BUILD=..."
        )
    if hasattr(os, "geteuid"):
        foreign = status.st_uid not in (0, os.geteuid())
        if foreign or status.st_mode & stat.S_IWOTH:
            stop(
                f"{build} belongs to another user, or all may write it, and a build executes files "
                "there: choose another folder, make BUILD=..."
            )


@contextlib.contextmanager
def alone(build: Path) -> Iterator[None]:
    """Let no second build into the folder. The system frees the lock of a process that is killed."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with open(build / ".lock", "a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stop(f"another build is running in {build}: wait for it, or choose make BUILD=...")
        yield


def prepare(build: Path) -> None:
    """Start from nothing, and let no file of the user's account take part."""
    for name in LEFTOVERS:
        shutil.rmtree(build / name, ignore_errors=True)
        if (build / name).exists():
            stop(f"{build / name} cannot be deleted: check who owns it")
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
    os.environ.update(dict.fromkeys(THREADS, "1"))
    os.environ["PYTHONHASHSEED"] = "0"  # sets have one order, too
    for name in ("MPLBACKEND", "PYTHONSTARTUP"):
        os.environ.pop(name, None)  # MPLBACKEND=Agg would turn every figure off
    os.environ["JUPYTER_PATH"] = str(own_kernel(private / "kernel"))
    place_for_compiled_functions(private / "lissome")


def check_data() -> None:
    """Look at all stored data now: a page would meet damage only after minutes."""
    from lissome import literature
    from lissome.errors import LissomeError

    try:
        for name in literature.tables():
            literature.load(name)
    except LissomeError as error:
        stop(str(error))


def own_kernel(folder: Path) -> Path:
    """Describe the kernel `python3` as this very interpreter, whatever else the account offers."""
    target = folder / "kernels" / "python3" / "kernel.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    command += ["--log-level=ERROR"]  # else each kernel warns that it talks over a local socket
    kernel = {"argv": command, "display_name": "Python 3", "language": "python"}
    target.write_text(json.dumps(kernel | {"metadata": {"debugger": False}}), encoding="utf-8")
    return folder


def place_for_compiled_functions(substitute: Path) -> None:
    """Keep compiled functions below BUILD where their usual folder cannot be written.

    Every page would compile them anew, and the warning that says so fails the build.
    """
    # In a process of its own: numba leaves objects behind that sphinx-external-toc trips over.
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True)
    if done.returncode:
        stop(f"the library does not work: {done.stderr}")
    if done.stdout:
        print(f"{done.stdout.strip()}. This build keeps them in {substitute}")
        substitute.mkdir(parents=True, exist_ok=True)
        os.environ["LISSOME_CACHE"] = str(substitute)


def warm_fonts() -> None:
    """Let matplotlib scan the fonts now: in a cell it would say so on stderr."""
    import matplotlib.font_manager

    matplotlib.font_manager.fontManager.findfont("DejaVu Sans")


def stoppable(work: Callable[[], Any]) -> Any:
    """Do the work; SIGINT, SIGTERM and SIGHUP end it, and every kernel that it has started.

    nbclient catches these signals, but only to close the kernel of one page: the build would go on
    with the next one. In another thread than the first it cannot.
    """
    outcome: list[Any] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            outcome.append(work())
        except BaseException as error:
            raised.append(error)

    def end(number: int, _: object) -> None:
        print(f"\nThe book is NOT built: {signal.Signals(number).name}. Run it again.", flush=True)
        kill_children()
        os._exit(128 + number)

    names = ("SIGINT", "SIGTERM", "SIGHUP")
    for number in (getattr(signal, name) for name in names if hasattr(signal, name)):
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup
            signal.signal(number, end)
    before = threading.stack_size(64 * 2**20)  # doctrees are deep; macOS gives threads 512 KiB
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    threading.stack_size(before)
    while thread.is_alive():
        thread.join(0.5)  # handlers run between
    if raised:
        raise raised[0]
    return outcome[0]


def kill_children() -> None:
    """Kill the kernels and the workers of their sweeps; what they compute belongs to no result."""
    import psutil

    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            # The tracker removes the semaphores of its workers when they are gone, then itself.
            if not any("resource_tracker" in part for part in child.cmdline()):
                child.kill()


def build_pages(build: Path) -> Any:
    from jupyter_book.sphinx import build_sphinx

    return build_sphinx(
        ROOT / "book",
        build / "html.unfinished",
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


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", nargs="?", default="_build", type=Path)
    build = parser.parse_args(arguments).build.absolute()
    began = time.monotonic()
    os.chdir(ROOT)
    open_build(build)
    with alone(build):
        try:
            check_data()
            prepare(build)
            warm_fonts()
            status = stoppable(lambda: build_pages(build))
        except OSError as error:
            stop(f"the book cannot be built in {build}: {error}")
        minutes, seconds = divmod(round(time.monotonic() - began), 60)
        unfinished = build / "html.unfinished"
        if status != 0:
            if isinstance(status, OSError):  # Sphinx has shown it, and asks for a report
                print(f"\n{status}: is there space in {build}? Other folders: make BUILD=...")
            print(f"\nThe book FAILED after {minutes} min {seconds} s: see the messages above.")
            print(f"What there is of it lies in {unfinished}")
            return 1
        if not (unfinished / "index.html").is_file():
            print(f"\nThe book FAILED: {unfinished / 'index.html'} was not written.")
            return 1
        unfinished.rename(build / "html")
        page = build / "html" / "index.html"
        print(f"\nThe book is built ({minutes} min {seconds} s). Open {page}")
        return 0


if __name__ == "__main__":
    sys.exit(main())
