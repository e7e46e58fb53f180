# Needs python3 (3.11 or newer, with venv) and make; the rest is installed into $(VENV).
#
#   make book         build the book, strictly and offline     -> $(BUILD)/html/index.html
#   make reproduce    the book, and its figures, scoreboard and report as files -> $(BUILD)/reproduction
#   make test         the test suite on all cores; more for pytest: ARGS="-x -k clamp", JOBS=1
#   make lint         ruff and mypy
#   make bench        benchmarks -> benchmarks/results.json
#   make check-pages  look at every built page in a real browser, network cut
#   make licenses     list the licenses of all packages -> DEPENDENCIES.md
#   make lock         compile requirements.txt anew and check it on every supported Python
#   make clean        delete $(BUILD) and caches (the environment stays; `make distclean` takes it too)
#
# Other places: make book VENV=/path/to/env BUILD=/path/to/build PYTHON=python3.12

PYTHON ?= python3
VENV   ?= .venv
BUILD  ?= _build
JOBS   ?= auto

# Nothing of the caller's own Python may leak in. MPLBACKEND=Agg would even silence every figure.
unexport PYTHONPATH PYTHONHOME PYTHONSTARTUP MPLBACKEND
export PYTHONNOUSERSITE := 1
export PYTHONUTF8 := 1
# Below a folder with letters beyond ASCII, Python 3.11 and 3.12 do not even start under LC_ALL=C;
# without it they turn the locale C into one of UTF-8 by themselves.
ifneq ($(filter C POSIX,$(LC_ALL)),)
unexport LC_ALL
endif

# Scripts in bin/ carry the absolute path of their interpreter, which breaks on long paths and on
# paths with spaces: `python -m` does not. The environment itself is no target either: a name with
# a space cannot be one. `exec`: whoever ends make ends Python, not a shell in between.
RUN := exec "$(VENV)/bin/python"

.PHONY: all env book reproduce test lint bench check-pages licenses lock lock-check clean distclean
all: test book

env:
	@exec sh tools/environment.sh "$(PYTHON)" "$(VENV)"

book: env
	$(RUN) tools/build_book.py "$(BUILD)"

reproduce: env
	$(RUN) tools/reproduce.py "$(BUILD)"

test: env
	export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1; \
	$(RUN) -m pytest -n $(JOBS) --dist worksteal -p no:benchmark $(ARGS)

lint: env
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

bench: env
	$(RUN) tools/bench.py

check-pages: env
	$(RUN) tools/check_pages.py "$(BUILD)/html" --screenshots "$(BUILD)/screenshots"

licenses: env
	$(RUN) tools/licenses.py

lock: env
	$(RUN) tools/lock.py

lock-check: env
	$(RUN) tools/lock.py --check

clean:
	rm -rf -- "$(BUILD)" build dist .pytest_cache .ruff_cache .mypy_cache .hypothesis .benchmarks

distclean: clean
	rm -rf -- "$(VENV)"
