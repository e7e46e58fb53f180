"""Active rods, ribbons and plates: equilibria, their stability, and their motion through snaps.

Names of this level are loaded when they are first used (PEP 562), so that ``import lissome`` costs
next to nothing: the compiler, the plotting library and the submodules come with the first call.

A public function never has the name of a module of the package, since importing the module would
replace the function: :func:`lissome.sweep` therefore lives in :mod:`lissome.sweeps`.
"""

from __future__ import annotations

import importlib
from typing import Any

from ._version import __version__

# Public name -> module of the package that defines it.
_EXPORTS: dict[str, str] = {
    "Branch": "branch",
    "BranchInterrupted": "branch",
    "EvolutionInterrupted": "evolution",
    "Event": "branch",
    "History": "evolution",
    "Snap": "evolution",
    "evolve": "evolution",
    "follow": "branch",
    "BaseStructure": "structure",
    "DenseStructure": "structure",
    "Equilibrium": "equilibrium",
    "Structure": "structure",
    "Output": "sensitivities",
    "EdgeReaction": "reactions",
    "Reaction": "reactions",
    "Reactions": "reactions",
    "equilibrate": "equilibrium",
    "sensitivity": "sensitivities",
    "smallest_eigenvalue": "stability",
    "sweep": "sweeps",
    "LissomeError": "errors",
    "InvalidInput": "errors",
    "NotConverged": "errors",
    "Unstable": "errors",
    "StabilityNotResolvable": "errors",
    "FactorizationError": "errors",
    "SweepFailed": "errors",
    "DataError": "errors",
    "DataAwaited": "errors",
    "LissomeWarning": "errors",
    "CacheWarning": "errors",
}

# Public modules and packages.
_SUBMODULES: tuple[str, ...] = (
    "beams",
    "branch",
    "equilibrium",
    "errors",
    "evolution",
    "factorization",
    "judges",
    "literature",
    "notebook",
    "plates",
    "plotting",
    "reactions",
    "references",
    "ribbons",
    "rods",
    "scoreboard",
    "sensitivities",
    "stability",
    "structure",
    "sweeps",
)

__all__ = ["__version__", *_EXPORTS, *_SUBMODULES]


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        value = getattr(importlib.import_module(f"{__name__}.{_EXPORTS[name]}"), name)
        globals()[name] = value  # the next access does not come here
        return value
    if name in _SUBMODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"importlib", "Any", "annotations"})
