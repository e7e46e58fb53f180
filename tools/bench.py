"""Run the benchmarks and write benchmarks/results.json; run it through `make bench`.

The file says what was measured (median, quartiles, rounds), the ratio to what it is held against,
measured in the same run, and where all of this happened: machine, versions, commit, and a
fingerprint of the library's sources, by which the book tells whether they have changed since.
`at_most` bounds time / time of the other; `at_least` bounds the speed-up over the other; `within`
bounds the seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lissome", "numpy", "scipy", "numba", "llvmlite", "pyelastica")


def fingerprint(root: Path = ROOT) -> str:
    """Return a checksum of the library's sources."""
    digest = hashlib.sha256()
    for path in sorted((root / "src").rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0")
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def processor() -> str:
    """Return the name of the processor, as well as it can be told."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def commit(root: Path = ROOT) -> str:
    """Return the commit, marked if files differ from it; 'unknown' outside a repository.

    What an earlier run has left in benchmarks/results.json is no difference.
    """

    def said(*command: str) -> str:
        done = subprocess.run(
            ["git", *command], cwd=root, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    try:
        name = said("rev-parse", "--short=12", "HEAD")
        changed = said(
            "status", "--porcelain", "--untracked-files=no",
            "--", ".", ":(exclude)benchmarks/results.json",
        )  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{name}-dirty" if changed else name


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that are installed."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def summary(raw: dict) -> list[dict]:
    """Return one row per benchmark, with its ratio to what it is held against."""
    rows = []
    medians = {}
    for entry in raw["benchmarks"]:
        info, stats = entry["extra_info"], entry["stats"]
        if "what" not in info:
            raise SystemExit(f"error: {entry['name']} does not call `measure`: see benchmarks/")
        key = (entry["group"], info["what"])
        if key in medians:
            raise SystemExit(f"error: two benchmarks are called {info['what']!r} in {key[0]!r}")
        medians[key] = stats["median"]
        rows.append(
            {
                "group": entry["group"],
                "what": info["what"],
                "median_seconds": stats["median"],
                "quartile_1_seconds": stats["q1"],
                "quartile_3_seconds": stats["q3"],
                "rounds": stats["rounds"],
                "against": info["against"],
                "at_most": info["at_most"],
                "at_least": info["at_least"],
                "within": info.get("within"),
                "note": info["note"],
            }
        )
    for row in rows:
        row["ratio"] = row["met"] = None
        if row["within"] is not None:
            row["met"] = row["median_seconds"] <= row["within"]
        if row["against"] is None:
            continue
        other = medians.get((row["group"], row["against"]))
        if other is None:
            raise SystemExit(
                f"error: {row['what']!r} is held against {row['against']!r}, "
                f"which was not measured in {row['group']!r}"
            )
        if row["at_least"] is None:
            row["ratio"] = row["median_seconds"] / other
            if row["at_most"] is not None:
                row["met"] = row["ratio"] <= row["at_most"]
        else:
            row["ratio"] = other / row["median_seconds"]
            row["met"] = row["ratio"] >= row["at_least"]
    return rows


def line(row: dict) -> str:
    """Return a measurement, what it is held against, and whether its bound is met."""
    text = f"{row['group']}: {row['what']}: {row['median_seconds']:.3g} s"
    bounds = []
    if row["against"] is not None:
        times = " times faster than" if row["at_least"] is not None else " of"
        text += f", {row['ratio']:.3g}{times} {row['against']}"
    for name, words in (("at_most", "at most"), ("at_least", "at least"), ("within", "within")):
        if row[name] is not None:
            bounds.append(f"{words} {row[name]:g}{' s' if name == 'within' else ''}")
    if bounds:
        text += f" ({', '.join(bounds)}: {'met' if row['met'] else 'MISSED'})"
    return text


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=ROOT / "benchmarks" / "results.json")
    given, more = parser.parse_known_args(arguments)
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.json"
        command = [sys.executable, "-m", "pytest", "benchmarks", "--benchmark-only"]
        command += ["--benchmark-disable-gc", f"--benchmark-json={raw}", *more]
        status = subprocess.run(command, cwd=ROOT, env=os.environ | threads).returncode
        if status:
            print("the benchmarks FAILED: nothing was written")
            return status
        rows = summary(json.loads(raw.read_text(encoding="utf-8")))
    result = {
        "taken": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "sources": fingerprint(),
        "machine": {
            "processor": processor(),
            "cores": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "threads": 1,
        },
        "versions": versions(),
        "benchmarks": rows,
    }
    given.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    missed = 0
    for row in rows:
        print(line(row))
        missed += row["met"] is False
    print(f"written: {given.output}")
    if missed:
        print(f"{missed} of the bounds MISSED")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
