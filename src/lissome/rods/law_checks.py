"""The check of a law against finite differences, and of what user laws return."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite_array, positive
from ..errors import InvalidInput
from .laws import Law, LawValues

__all__ = ["check_law"]

Array = NDArray[np.float64]

# Steps, relative to the size of the strains, from coarse to fine: where truncation and rounding
# errors balance differs from law to law.
_STEPS = 10.0 ** -np.arange(1.0, 6.5, 0.5)
# A difference quotient agrees within a part of the value itself, or within the rounding error of the
# sum that it was taken from.
_RELATIVE_ERROR = 1e-6
_ERROR_OF_SUM = 1e-9
_ROWS_CHECKED = 8


def check_points(size: int, scale: float) -> Array:
    """Return strain densities, shape (8, size), at which a law is checked: small, large, mixed."""
    random = np.random.default_rng(20211201)
    points = random.uniform(0.2, 1.0, (_ROWS_CHECKED, size))
    points *= np.where(random.uniform(size=points.shape) < 0.5, -1.0, 1.0)
    return points * (scale * np.geomspace(0.1, 1.5, _ROWS_CHECKED)[:, None])


def check_law(law: Law, scale: float = 1.0, *, points: ArrayLike | None = None) -> None:
    """Compare a law with finite differences of its own energy and stress.

    Parameters
    ----------
    law : Law
        Any law. One that varies along the rod is checked at its first rows.
    scale : float
        Size of the strain densities (1/length) at which to check; eight points are chosen.
    points : array_like, shape (m, k), optional
        Strain densities at which to check instead.

    Raises
    ------
    InvalidInput
        If shapes are wrong, values are not finite, a row depends on the strains of another, the
        stress is not the derivative of the energy, or the stiffness not that of the stress. The message
        names the component that is off, where, and by how much.

    Examples
    --------
    >>> from lissome.rods.law_checks import check_law
    >>> from lissome.rods.laws import Kirchhoff
    >>> check_law(Kirchhoff((1.0, 2.0), 3.0))
    """
    name = type(law).__name__
    names = tuple(law.strains)
    size = len(names)
    if points is None:
        k = check_points(size, positive("scale", scale))
    else:
        k = finite_array("points", points, (None, size))
        if k.shape[0] == 0:
            raise InvalidInput(
                "argument `points` is empty; pass at least one row of strain densities"
            )
    rows = np.arange(k.shape[0]) % (law.count or 1)
    energy, stress, stiffness = _values(law, rows, k, name)
    _check_rows(law, rows, k, (energy, stress, stiffness), name)
    _check_symmetry(stiffness, names, name)
    reach = np.max(np.abs(k), axis=1, initial=0.0)
    reach[reach == 0.0] = scale
    for a, label in enumerate(names):
        slopes = _difference_quotients(law, rows, k, a, reach, name)
        worth = np.max(np.abs(stress), axis=1) + np.abs(energy) / reach
        _compare(
            f"stress component `{label}` (number {a})", "energy", label,
            slopes[0][..., None], stress[:, a : a + 1], worth, k, name,
        )  # fmt: skip
        worth = np.max(np.abs(stiffness), axis=(1, 2)) + np.max(np.abs(stress), axis=1) / reach
        for b, other in enumerate(names):
            _compare(
                f"stiffness component [`{other}`, `{label}`] (numbers {b}, {a})",
                f"stress component `{other}`", label,
                slopes[1][..., b : b + 1], stiffness[:, b, a : a + 1], worth, k, name,
            )  # fmt: skip


def checked_values(result: Any, n: int, strains: Sequence[str], order: int, name: str) -> LawValues:
    """Return what a law returned as arrays, or say what is wrong with type and shape."""
    m = len(strains)
    wanted = f"(W, stress, stiffness) of shapes ({n},), ({n}, {m}), ({n}, {m}, {m})"
    if not isinstance(result, (tuple, list)) or len(result) != 3:
        what = (
            f"{len(result)} values" if isinstance(result, (tuple, list)) else type(result).__name__
        )
        raise InvalidInput(f"{name} returned {what}; a law must return {wanted}")
    shapes = ((n,), (n, m), (n, m, m))
    arrays: list[Array | None] = []
    for level, (label, value, shape) in enumerate(
        zip(("energy W", "stress", "stiffness"), result, shapes, strict=True)
    ):
        if level > order:
            arrays.append(None)
            continue
        if value is None:
            raise InvalidInput(f"{name} returned None as its {label}; a law must return {wanted}")
        try:
            raw = np.asarray(value)
            if raw.dtype.kind == "c":
                raise TypeError("it is complex")
            array = np.ascontiguousarray(raw, dtype=float)
        except (TypeError, ValueError) as error:
            raise InvalidInput(
                f"{name} returned a {label} that is not an array of real numbers ({error})"
            ) from error
        if np.ndim(value) == 0 or array.shape != shape:
            raise InvalidInput(
                f"{name} returned a {label} of shape {np.shape(value)}; it must be {shape}, "
                f"one row for each row of strains"
            )
        arrays.append(array)
    assert arrays[0] is not None
    return arrays[0], arrays[1], arrays[2]


def refuse_not_finite(
    values: LawValues, k: Array, strains: Sequence[str], name: str, *, barrier: bool = False
) -> None:
    """Raise if a value is not finite; with `barrier`, rows of infinite energy are let through."""
    # One cheap look first: this is done in every iteration.
    if all(value is None or np.isfinite(value.sum()) for value in values):
        return
    allowed = np.isposinf(values[0]) if barrier else np.zeros(k.shape[0], dtype=bool)
    for label, value in zip(("energy W", "stress", "stiffness"), values, strict=True):
        if value is None:
            continue
        bad = ~np.isfinite(value)
        bad[allowed] = False
        if bad.any():
            place = tuple(int(i) for i in np.argwhere(bad)[0])
            which = ""
            if len(place) > 1:
                which = f", component [{', '.join(strains[i] for i in place[1:])}]"
            at = ", ".join(f"{s} = {v:.6g}" for s, v in zip(strains, k[place[0]], strict=True))
            raise InvalidInput(
                f"{name} returned {value[place]} as its {label}{which} in row {place[0]}, where {at}; "
                "every value of a law must be "
                "finite (+inf as the energy says that a strain is outside its domain)"
            )


def _values(law: Law, rows: Any, k: Array, name: str) -> tuple[Array, Array, Array]:
    values = law.at(rows).evaluate(k.copy(), 2)
    energy, stress, stiffness = checked_values(values, k.shape[0], law.strains, 2, name)
    refuse_not_finite((energy, stress, stiffness), k, law.strains, name)
    assert stress is not None and stiffness is not None
    return energy, stress, stiffness


def _check_rows(law: Law, rows: Any, k: Array, values: tuple[Array, ...], name: str) -> None:
    for i in range(k.shape[0]):
        alone = _values(law, rows[i : i + 1], k[i : i + 1], name)
        for label, one, all_ in zip(
            ("energy W", "stress", "stiffness"), alone, values, strict=True
        ):
            size = np.max(np.abs(all_))
            if not np.allclose(one[0], all_[i], rtol=1e-9, atol=1e-12 * size):
                raise InvalidInput(
                    f"the {label} that {name} returns in one row depends on the strains of other rows: "
                    "each row is a hinge of its own (reduce along the last axis only)"
                )


def _check_symmetry(stiffness: Array, names: Sequence[str], name: str) -> None:
    skew = np.abs(stiffness - stiffness.transpose(0, 2, 1)).max(axis=0)
    a, b = (int(i) for i in np.unravel_index(int(np.argmax(skew)), skew.shape))
    if skew[a, b] > 1e-8 * np.abs(stiffness).max():
        raise InvalidInput(
            f"the stiffness of {name} is not symmetric: its components [`{names[a]}`, `{names[b]}`] and "
            f"[`{names[b]}`, `{names[a]}`] differ by {skew[a, b]:.3g}"
        )


def _difference_quotients(
    law: Law, rows: Any, k: Array, a: int, reach: Array, name: str
) -> tuple[Array, Array]:
    """Return central differences of energy and stress, shapes (steps, m) and (steps, m, k)."""
    steps = _STEPS[:, None] * reach  # (steps, m)
    moved = np.broadcast_to(k, (2, _STEPS.size, *k.shape)).copy()
    moved[0, ..., a] += steps
    moved[1, ..., a] -= steps
    width = moved[0, ..., a] - moved[1, ..., a]  # the steps as they are after rounding
    flat = moved.reshape(-1, k.shape[1])
    energy, stress, _ = _values(law, np.tile(rows, 2 * _STEPS.size), flat, name)
    energy = energy.reshape(2, _STEPS.size, -1)
    stress = stress.reshape(moved.shape)
    return (energy[0] - energy[1]) / width, (stress[0] - stress[1]) / width[..., None]


def _compare(
    what: str,
    of: str,
    label: str,
    quotients: Array,
    values: Array,
    worth: Array,
    k: Array,
    name: str,
) -> None:
    """Raise unless, at each point, some step gives a difference quotient that agrees."""
    values, quotients = values[:, 0], quotients[..., 0]
    error = np.abs(quotients - values)
    best = np.argmin(error, axis=0)
    points = np.arange(values.size)
    quotient, error = quotients[best, points], error[best, points]
    own = np.maximum(np.abs(values), np.abs(quotient))
    excess = error - (_RELATIVE_ERROR * own + _ERROR_OF_SUM * worth)
    i = int(np.argmax(excess))
    if excess[i] > 0.0:
        raise InvalidInput(
            f"the {what} of {name} is {values[i]:.8g} at the strains "
            f"[{', '.join(f'{x:.4g}' for x in k[i])}], where the derivative of its {of} with respect to "
            f"`{label}` is {quotient[i]:.8g} (by finite differences)"
        )
