"""Equilibria in files: arrays only. Their structures are made anew by whoever reads them."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _archive
from ._corrector import typical_size
from .equilibrium import Equilibrium, present, relative_residual
from .errors import DataError


def pack_equilibria(equilibria: Sequence[Equilibrium]) -> dict[str, Any]:
    """Return arrays that hold the equilibria."""
    return {
        **_archive.pack_values("state", [e.state for e in equilibria]),
        "multipliers": np.array([e.multipliers for e in equilibria]),
        "energy": np.array([e.energy for e in equilibria]),
        "residual": np.array([e.residual for e in equilibria]),
        "inertia": np.array([e.inertia for e in equilibria], dtype=int),
        "iterations": np.array([e.iterations for e in equilibria], dtype=int),
    }


def unpack_equilibria(
    arrays: dict[str, Any], structures: Sequence[Any], path: Any
) -> list[Equilibrium]:
    """Return the equilibria that were packed, given their structures."""
    count = len(structures)
    states = _archive.unpack_values("state", arrays, structures[0].start(), count)
    result = []
    for i, structure in enumerate(structures):
        inertia = tuple(int(k) for k in arrays["inertia"][i])
        n = structure.size
        if arrays["multipliers"][i].shape != (structure.constraints_count,):
            raise DataError(
                f"the saved states have {arrays['multipliers'][i].size} multipliers; the structure "
                f"has {structure.constraints_count} constraints"
            )
        result.append(
            present(
                Equilibrium(
                    structure=structure, state=states[i], multipliers=arrays["multipliers"][i],
                    energy=float(arrays["energy"][i]), residual=float(arrays["residual"][i]),
                    inertia=(inertia[0], inertia[1], inertia[2]),
                    iterations=int(arrays["iterations"][i]),
                    stable=inertia == (n, sum(inertia) - n, 0), history=(),
                )
            )
        )  # fmt: skip
    return result


def fits(equilibrium: Equilibrium) -> bool:
    """Whether a stored equilibrium is balanced for the structure that it was given."""
    structure, state = equilibrium.structure, equilibrium.state
    here = structure.evaluate(state, equilibrium.multipliers, 2)
    assert here.kkt is not None
    assert here.gradient is not None
    terms = here.kkt.magnitude(typical_size(structure, state), equilibrium.multipliers)
    found = relative_residual(here.gradient, here.constraints, terms)
    noise = float(structure.noise(state))
    return found <= max(100 * equilibrium.residual, 1e3 * noise, 1e-9)


def without_what_cannot_travel(reduced: tuple[Any, ...], *names: str) -> tuple[Any, ...]:
    """Return how to pickle an exception, with None for attributes that cannot be pickled.

    Results hold the user's functions, which may be local ones. A sweep must receive the exception
    all the same.
    """
    rebuild, (kind, arguments, attributes) = reduced
    kept = dict(attributes)
    for name in (*names, "history", "state"):
        try:
            pickle.dumps(kept.get(name))
        except Exception:  # whatever the user's objects raise
            kept[name] = None
    return rebuild, (kind, arguments, kept)
