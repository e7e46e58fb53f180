"""Stability: smallest eigenvalues and modes of the constrained second variation.

The eigenvalues :math:`\\mu` are those of

.. math:: H v + J^T \\nu = \\mu M v, \\qquad J v = 0, \\qquad G v = 0,

with the Hessian H of the Lagrangian, the Jacobian J of the constraints, the generators G of neutral
motions and the diagonal metric M of the structure. When M holds quadrature weights, the eigenvalues
are those of the second variation per unit length (or area), and converge as the mesh is refined.

Where multipliers are forces in yielding parts (moments as unknowns of a ribbon), J v = 0 becomes
:math:`J v = C \\nu`, with their compliance C, which stands as -C in the corner of the KKT matrix and is
semidefinite. A motion is admissible if some forces answer to it; eliminated, they add their energy
:math:`\\nu \\cdot C\\nu`, so that

.. math:: \\mu = \\frac{v\\cdot(H v + J^T\\nu)}{v\\cdot M v} ,

and the eigenvalues are the finite ones of the pencil of the KKT matrix and diag(M, 0). Only
multipliers without compliance take motions away.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._validate import PLAIN, finite_array, integer_at_least, structure_like
from .errors import FactorizationError, InvalidInput, NotConverged
from .factorization import Factorization, KKTMatrix

__all__ = [
    "Spectrum",
    "admissible_motions",
    "lowest_mode",
    "smallest_eigenvalue",
    "softest_mode",
    "yielding_multipliers",
]

Array = NDArray[np.float64]


class Spectrum(NamedTuple):
    """The lowest eigenvalues of a second variation.

    Attributes
    ----------
    values : ndarray, shape (count,)
        Eigenvalues, in ascending order.
    modes : ndarray, shape (count, n)
        Modes, orthonormal in the metric; the entry of largest size is positive.
    floor : float
        Round-off error of the lowest eigenvalue. A value that does not exceed it in size has no sign.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> well = ls.DenseStructure(
    ...     initial=[1.0, 1.0],
    ...     energy=lambda x: x[0] ** 2 + 3 * x[1] ** 2,
    ...     gradient=lambda x: np.array([2 * x[0], 6 * x[1]]),
    ...     hessian=lambda x: np.diag([2.0, 6.0]),
    ... )
    >>> spectrum = ls.smallest_eigenvalue(ls.equilibrate(well), count=2)
    >>> print(spectrum.values.round(9), spectrum.modes.round(6) + 0.0, spectrum.floor < 1e-12)
    [2. 6.] [[1. 0.]
     [0. 1.]] True
    """

    values: Array
    modes: Array
    floor: float


@lru_cache(maxsize=16)
def _start_vector(n: int, seed: int = 0) -> Array:
    # Fixed, so that results repeat; irregular, so that no symmetry makes it blind to a mode.
    vector = np.random.default_rng(20 + seed).standard_normal(n)
    vector.flags.writeable = False
    return vector


def yielding_multipliers(kkt: KKTMatrix) -> NDArray[np.bool_]:
    """Return which multipliers have a compliance, shape (m,): forces in parts that yield.

    Parameters
    ----------
    kkt : KKTMatrix
        The matrix.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import ChainKKT
    >>> from lissome.stability import yielding_multipliers
    >>> corner = np.diag([-0.5, 0.0])  # of a spring and of a rigid link
    >>> yielding_multipliers(ChainKKT(np.zeros((2, 1)), np.eye(2), corner))
    array([ True, False])
    """
    return np.asarray(kkt.magnitude(np.zeros(kkt.n), np.ones(kkt.m))[1] > 0.0)


def admissible_motions(kkt: KKTMatrix, neutral: int = 0) -> int:
    """Return the number of admissible motions, which is that of the eigenvalues.

    Parameters
    ----------
    kkt : KKTMatrix
        The matrix, of independent constraints. Multipliers with a compliance forbid no motion.
    neutral : int
        Number of neutral motions, which are not counted.

    Returns
    -------
    int

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> from lissome.stability import admissible_motions
    >>> admissible_motions(DenseKKT(np.eye(3), jacobian=[[1.0, 1.0, 0.0]]))
    2
    """
    return kkt.n - neutral - int(np.count_nonzero(~yielding_multipliers(kkt)))


def softest_mode(
    kkt: KKTMatrix, factor: Factorization, metric: Array
) -> tuple[float, Array, Array]:
    """Return a bound of the size of the eigenvalue nearest to zero, its mode and its multipliers.

    Three inverse iterations: the bound is sharp when the eigenvalue is far below the others, which
    is when it matters, and never smaller than the eigenvalue itself.

    Parameters
    ----------
    kkt : KKTMatrix
        The matrix.
    factor : Factorization
        Of `kkt`, not singular; with gauge rows if there are neutral motions.
    metric : ndarray, shape (n,)
        The diagonal metric.

    Returns
    -------
    size : float
        Not less than the size of the eigenvalue.
    mode : ndarray, shape (n,)
        Of unit length in the metric.
    multipliers : ndarray, shape (m,)
        Forces of the constraints that go with the mode.

    Raises
    ------
    FactorizationError
        If the matrix is singular.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> from lissome.stability import softest_mode
    >>> kkt = DenseKKT(np.diag([-0.001, 5.0, 9.0]))
    >>> size, mode, _ = softest_mode(kkt, kkt.factorize(), np.ones(3))
    >>> print(round(size, 9), np.abs(mode).round(6))
    0.001 [1. 0. 0.]
    """
    v = _start_vector(kkt.n)
    v = v / math.sqrt(float(v @ (metric * v)))
    norm, mult = math.inf, np.zeros(kkt.m)
    for _ in range(3):
        w, mult = factor.solve(metric * v, refine=False)
        norm = math.sqrt(float(w @ (metric * w)))
        if norm == 0.0:
            return math.inf, np.zeros(kkt.n), mult  # the constraints leave no motion
        v, mult = w / norm, mult / norm
    return 1.0 / norm, v, mult


def _lanczos(
    factor: Factorization, metric: Array, count: int, known: Array, seed: int, tolerance: float
) -> tuple[Array, Array]:
    """Return the largest Ritz values of the inverse on the complement of `known`, and vectors."""
    n = factor.n
    limit = min(n, 300)

    def clean(v: Array, basis: Array) -> Array:
        for _ in range(2):  # twice is enough (Kahan)
            v = v - known.T @ (known @ (metric * v))
            v = v - basis.T @ (basis @ (metric * v))
        return v

    basis = np.zeros((0, n))
    v, _ = factor.solve(metric * _start_vector(n, seed))  # into the admissible motions
    v = clean(v, basis)
    norm = math.sqrt(float(v @ (metric * v)))
    alpha: list[float] = []
    beta: list[float] = []
    values, vectors = np.zeros(0), np.zeros((0, n))
    if norm == 0.0:
        return values, vectors
    first = norm
    v /= norm
    while len(basis) < limit:
        basis = np.vstack([basis, v])
        w, _ = factor.solve(metric * v)
        alpha.append(float(v @ (metric * w)))
        w = clean(w, basis)
        norm = math.sqrt(float(w @ (metric * w)))
        # A remainder near round-off is noise, and need not be admissible: stop before it.
        exhausted = norm <= 1e-9 * max(abs(alpha[0]), first, *map(abs, alpha))
        size = len(basis)
        if exhausted or size == limit or size % 4 == 0:
            ritz, u = np.linalg.eigh(
                np.diag(alpha) + np.diag(beta, 1) + np.diag(beta, -1) if beta else np.diag(alpha)
            )
            take = min(count, size)
            ritz, u = ritz[::-1][:take], u[:, ::-1][:, :take]
            settled = np.all(np.abs(norm * u[-1]) <= tolerance * np.abs(ritz))
            if exhausted or (size >= min(take + 2, limit) and settled and take == count):
                return ritz, u.T @ basis
        beta.append(norm)
        v = w / norm
    if limit < n:
        raise NotConverged(
            f"the Lanczos iteration did not resolve {count} eigenvalues with {limit} vectors; ask "
            "for fewer"
        )
    return ritz, u.T @ basis


def _admissible(
    kkt: KKTMatrix, factor: Factorization, metric: Array, modes: Array
) -> tuple[Array, Array]:
    """Return a basis, orthonormal in the metric, of what one inverse iteration makes of `modes`.

    It purges what rounding errors left of motions that the constraints forbid. With the forces, shape
    (k, m), that yielding parts answer with; they are zero if there are none.
    """
    images, forces = (columns.T for columns in factor.solve((metric * modes).T))
    if not np.any(yielding_multipliers(kkt)):
        forces = np.zeros_like(forces)
    size = np.sqrt(np.sum(images * metric * images, axis=1))[:, None]
    images, forces = images / size, forces / size
    sizes, turn = np.linalg.eigh(images @ (metric * images).T)
    keep = sizes > 1e-6  # two copies of one mode leave only noise
    weights = (turn[:, keep] / np.sqrt(sizes[keep])).T
    return weights @ images, weights @ forces


def _rayleigh(kkt: KKTMatrix, metric: Array, modes: Array, forces: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of the second variation on the span of `modes`, ascending."""
    small = np.zeros((len(modes), len(modes)))
    for i, (v, f) in enumerate(zip(modes, forces, strict=True)):
        bent, gaps = kkt.apply(v, f)
        small[:, i] = modes @ bent + forces @ gaps
    values, turn = np.linalg.eigh(0.5 * (small + small.T))
    modes = turn.T @ modes
    modes /= np.sqrt(np.sum(modes * metric * modes, axis=1))[:, None]
    for v in modes:
        if v[np.argmax(np.abs(v))] < 0:
            v *= -1.0
    return values, modes


def lowest_mode(kkt: KKTMatrix, factor: Factorization, metric: Array) -> tuple[float, Array]:
    """Return the lowest eigenvalue and its mode, roughly, given factors with right inertia.

    Parameters
    ----------
    kkt, factor, metric
        As in :func:`softest_mode`; `factor` has the inertia of a minimum.

    Returns
    -------
    value : float
        The eigenvalue, to some 1e-6 of its size.
    mode : ndarray, shape (n,)
        Its mode, of unit length in the metric.

    Raises
    ------
    FactorizationError
        If the entries of the matrix differ so much in size that no mode can be told.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> from lissome.stability import lowest_mode
    >>> kkt = DenseKKT(np.diag([2.0, 5.0, 9.0]))
    >>> value, mode = lowest_mode(kkt, kkt.factorize(), np.ones(3))
    >>> print(round(value, 6), mode.round(3) + 0.0)
    2.0 [1. 0. 0.]
    """
    _, modes = _lanczos(factor, metric, 1, np.zeros((0, kkt.n)), 0, 1e-3)
    forces = np.zeros((len(modes), kkt.m))
    if np.any(yielding_multipliers(kkt)):
        modes, forces = _admissible(kkt, factor, metric, modes)
    values, modes = _rayleigh(kkt, metric, modes, forces)
    if values.size == 0:
        raise FactorizationError(
            "no mode of the second variation can be told from rounding errors: its entries differ too "
            "much in size; check the units of loads and stiffnesses"
        )
    return float(values[0]), modes[0]


def _positive_shift(kkt: KKTMatrix, gauge: Array, metric: Array) -> tuple[Factorization, float]:
    """Return factors with a shift that makes every eigenvalue positive; zero if they are."""
    try:
        factor = kkt.factorize(0.0, gauge, metric)
        if factor.is_minimum:
            return factor, 0.0
    except FactorizationError:
        pass
    stiffness = kkt.magnitude(np.ones(kkt.n), np.zeros(kkt.m))[0] / metric
    scale = float(np.median(stiffness))
    scale = scale if scale > 0 else 1.0
    shift = 1e-7 * scale
    while shift < 1e10 * scale:
        try:
            factor = kkt.factorize(shift, gauge, metric)
            if factor.is_minimum:
                return factor, shift
        except FactorizationError:
            pass
        shift *= 4.0
    raise FactorizationError(
        "no shift makes the second variation positive: the constraints are redundant, or a Hessian "
        "entry is not finite"
    )


def smallest_eigenvalue(
    structure: Any,
    state: Any = None,
    multipliers: ArrayLike | None = None,
    *,
    count: int = 1,
    tolerance: float = 1e-9,
) -> Spectrum:
    """Return the lowest eigenvalues and modes of the constrained second variation.

    Shift-and-invert Lanczos iteration on the KKT factorization; the count of eigenvalues below the
    result is verified by the inertia at a shift, so that none is missed, not even a multiple one.

    Parameters
    ----------
    structure : Equilibrium or Structure
        An equilibrium, or a structure (then with `state` and `multipliers`).
    state : state, optional
        Where to evaluate a structure.
    multipliers : array_like, shape (m,), optional
        The multipliers there; needed when the structure has constraints.
    count : int
        How many eigenvalues.
    tolerance : float
        Relative error of the modes in the Lanczos iteration; eigenvalues are exact to its square.

    Returns
    -------
    Spectrum
        ``values`` (count,), ``modes`` (count, n), and the round-off ``floor``. Eigenvalues are in
        units of energy over the unit of ``structure.metric``.

    Raises
    ------
    InvalidInput
        If fewer motions than `count` are admissible, or an argument is missing, or `state` or
        `multipliers` come with an Equilibrium, which has its own.
    NotConverged
        If the inertia does not confirm the eigenvalues.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> spring = ls.DenseStructure(
    ...     initial=[1.0, 0.0],
    ...     energy=lambda x: x[0] ** 2 + 3 * x[1] ** 2,
    ...     gradient=lambda x: np.array([2 * x[0], 6 * x[1]]),
    ...     hessian=lambda x: np.diag([2.0, 6.0]),
    ... )
    >>> ls.smallest_eigenvalue(ls.equilibrate(spring), count=2).values
    array([2., 6.])
    """
    from .equilibrium import Equilibrium

    factor: Factorization | None = None
    shift = 0.0
    if isinstance(structure, Equilibrium):
        equilibrium = structure
        if state is not None or multipliers is not None:
            raise InvalidInput(
                "arguments `state` and `multipliers` are those of the Equilibrium; pass its "
                "`structure` to evaluate another state"
            )
        structure, state = equilibrium.structure, equilibrium.state
        kkt, metric, gauge = equilibrium.evaluation.kkt, equilibrium.metric, equilibrium.gauge
        if equilibrium.stable:
            factor = equilibrium.factorization
    else:
        if state is None:
            raise InvalidInput("argument `state` is missing; pass the state, or an Equilibrium")
        structure = structure_like("structure", structure)
        plain = isinstance(state, PLAIN) and not isinstance(state, type(structure.start()))
        if plain or isinstance(state, Equilibrium):
            raise InvalidInput(
                f"argument `state` is of type {type(state).__name__}; pass a state, such as "
                "`structure.start()` or the `state` of an Equilibrium"
            )
        m = structure.constraints_count
        if multipliers is None and m:
            raise InvalidInput(
                f"argument `multipliers` is missing; the {m} constraints are curved, and their "
                "multipliers are part of the second variation"
            )
        given = () if multipliers is None else multipliers
        mult = finite_array("multipliers", given, shape=(m,))
        kkt = structure.evaluate(state, mult, 2).kkt
        metric = np.asarray(structure.metric(state), dtype=float)
        gauge = np.asarray(structure.gauge(state), dtype=float).reshape(-1, structure.size)
    assert kkt is not None
    free = admissible_motions(kkt, len(gauge))
    count = integer_at_least("count", count, 1)
    if free < 1:
        raise InvalidInput(
            "the constraints leave no admissible motion, and there is no eigenvalue: nothing can be "
            "unstable; use more segments or elements to see what can move"
        )
    if not 1 <= count <= free:
        raise InvalidInput(
            f"argument `count` is {count}; there are {free} admissible motions: it must lie in "
            f"[1, {free}]"
        )
    if factor is None or not factor.is_minimum:
        factor, shift = _positive_shift(kkt, gauge, metric)
    yielding = bool(np.any(yielding_multipliers(kkt)))
    noise = float(structure.noise(state))

    def rounding(value: float, mode: Array) -> float:
        """Return the round-off error of an eigenvalue: of the terms that its mode sums."""
        _, forces = factor.solve(metric * mode)  # multipliers over the shifted eigenvalue
        forces = forces * (value + shift)
        terms, gaps = kkt.magnitude(mode, forces)
        size = float(np.abs(mode) @ terms)
        if yielding:
            size += float(np.abs(forces) @ gaps)
        return noise * size

    modes = np.zeros((0, kkt.n))
    for seed in range(count + 8):
        _, new = _lanczos(factor, metric, count, modes, seed, tolerance)
        modes, answers = _admissible(kkt, factor, metric, np.vstack([modes, new]))
        values, modes = _rayleigh(kkt, metric, modes, answers)
        values, modes = values[:count], modes[:count]
        if len(values) < count:
            continue
        # Residual and rounding of the last value bound how far below it one has to look.
        floor = rounding(float(values[-1]), modes[-1])
        margin = 1e-6 * max(abs(values[-1]), abs(values[0]), 1e-3 * abs(values[-1] + shift))
        margin = max(margin, 4 * floor)
        below = values[-1] - margin
        try:
            index = kkt.factorize(-below, gauge, metric).index
        except FactorizationError:
            index = kkt.factorize(-(below - margin), gauge, metric).index
        if index == np.count_nonzero(values < below):
            return Spectrum(values, modes, rounding(float(values[0]), modes[0]))
    if len(values) < count:  # multipliers with compliances that depend on each other
        raise InvalidInput(
            f"argument `count` is {count}; there are {len(values)} admissible motions: it must lie in "
            f"[1, {len(values)}]"
        )
    raise NotConverged(
        f"the inertia finds eigenvalues below the {count} smallest of the Lanczos iteration "
        f"({values}); they are too near to each other, or below the round-off floor"
    )
