r"""Sparse symmetric indefinite factorization with inertia, in NumPy, SciPy and BLAS alone.

A nested dissection of the graph makes a tree of small dense *fronts*: the matrix is eliminated front
by front, leaves first, and each front passes its Schur complement to its parent (the multifrontal
method). Inside a front the own unknowns are eliminated as one block,

.. math:: F = \begin{pmatrix} F_{11} & F_{21}^T \\ F_{21} & F_{22} \end{pmatrix}, \qquad
    S = F_{22} - F_{21} F_{11}^{-1} F_{21}^T,

by LAPACK's factors of :math:`F_{11}` (Cholesky, or LU with the signs of Bunch-Kaufman's). Where that
would make entries grow (multipliers before their unknowns, a singular part of the structure),
:math:`F_{11} = Q \Lambda Q^T` is diagonalized instead, and the directions with too small an
eigenvalue are *delayed*: they become unknowns of the parent. Both are congruences, so that the
inertia adds up over the fronts (Haynsworth, Sylvester).
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import lapack
from scipy.sparse import csgraph

from .errors import FactorizationError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
EPS = float(np.finfo(float).eps)

#: Parts of the graph up to this size are not divided further.
LEAF = 96
#: Growth of entries beyond which a front is diagonalized and directions are delayed.
GROWTH = 1e2
#: Least ratio of an eigenvalue to its coupling for an elimination.
THRESHOLD = 1e-2


@dataclass(frozen=True, eq=False)
class Front:
    """One node of the tree: own columns first ... last - 1, rows of later fronts, children."""

    first: int
    last: int
    border: Index
    children: tuple[int, ...]
    source: Index  # entries of the permuted lower triangle that are assembled here
    target: Index  # where they go in the flat front (own, border)
    into: Index  # where the border goes in the parent front


@dataclass(frozen=True, eq=False)
class Plan:
    """What depends on the pattern alone."""

    order: Index
    fronts: tuple[Front, ...]  # children before parents
    gather: Index  # entry of the data of the full matrix for each entry of the lower triangle


def _levels(graph: Any, start: int) -> Index:
    """Return the distance of each vertex from `start` in a connected graph."""
    order, before = csgraph.breadth_first_order(graph, start, directed=False)
    depth = np.zeros(graph.shape[0], dtype=np.int64)
    # Parents come before children: resolve generations until nothing changes.
    rank = np.empty(graph.shape[0], dtype=np.int64)
    rank[order] = np.arange(len(order))
    parent = rank[before[order[1:]]]
    generation = np.zeros(len(order), dtype=np.int64)
    last, level = 1, 0  # end of the current generation, which is contiguous
    while last < len(order):
        level += 1
        end = int(np.searchsorted(parent, last)) + 1  # parents are in ascending order
        generation[last:end] = level
        last = end
    depth[order] = generation
    return depth


def _split(graph: Any) -> tuple[Index, Index, Index]:
    """Divide a connected graph by a level set: two parts and the separator between them."""
    depth = _levels(graph, 0)
    depth = _levels(graph, int(np.argmax(depth)))
    count = np.bincount(depth)
    below = np.cumsum(count)
    n = graph.shape[0]
    if len(count) < 3:  # every vertex sees nearly every other: do not divide
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.arange(n)
    allowed = np.flatnonzero((below[:-1] >= 0.3 * n) & (below[:-1] <= 0.7 * n))
    if len(allowed) == 0:
        allowed = np.array([int(np.argmin(np.abs(below[:-1] - n / 2)))])
    # Small separators, and balance.
    cost = count[allowed] * (1 + 2 * np.abs(below[allowed] / n - 0.5))
    level = int(allowed[np.argmin(cost)])
    inside = np.flatnonzero(depth == level)
    ahead = (depth == level + 1).astype(float)
    touches = graph[inside] @ ahead > 0
    separator = inside[touches]
    left = np.concatenate([np.flatnonzero(depth < level), inside[~touches]])
    return left, np.flatnonzero(depth > level), separator


def _dissect(pattern: Any) -> list[tuple[Index, tuple[int, ...]]]:
    """Return a tree, children before parents: the vertices of each node, and its children."""
    nodes: list[tuple[Index, tuple[int, ...]]] = []

    def visit(vertices: Index, graph: Any) -> list[int]:
        """Place a part; return the roots of its tree."""
        if len(vertices) > LEAF:
            parts, label = csgraph.connected_components(graph, directed=False)
            if parts > 1:
                # Many small parts make one leaf each; large ones are divided.
                roots: list[int] = []
                sizes = np.bincount(label)
                group = np.cumsum(np.where(sizes > LEAF, LEAF + 1, sizes)) // (LEAF + 1)
                small = sizes[label] <= LEAF
                for part in np.flatnonzero(sizes > LEAF):
                    chosen = np.flatnonzero(label == part)
                    roots += visit(vertices[chosen], graph[chosen][:, chosen])
                for bundle in np.unique(group[label[small]]) if np.any(small) else []:
                    chosen = np.flatnonzero(small & (group[label] == bundle))
                    roots += visit_leaf(vertices[chosen])
                return roots
            left, right, separator = _split(graph)
            if len(left) and len(right):
                roots = visit(vertices[left], graph[left][:, left])
                roots += visit(vertices[right], graph[right][:, right])
                return place(vertices[separator], tuple(roots))
        return visit_leaf(vertices)

    def visit_leaf(vertices: Index) -> list[int]:
        return place(vertices, ())

    def place(vertices: Index, children: tuple[int, ...]) -> list[int]:
        nodes.append((vertices, children))
        return [len(nodes) - 1]

    n = pattern.shape[0]
    roots = visit(np.arange(n), pattern)
    if len(roots) > 1:  # one root, so that delayed directions meet
        place(np.zeros(0, dtype=np.int64), tuple(roots))
    return nodes


def make_plan(matrix: Any, unknowns: int, last: int) -> Plan:
    """Analyze a symmetric CSC pattern.

    The first rows are unknowns, which are dissected; then come multipliers, each of which is
    eliminated together with the last of its unknowns; the last rows are dense, for the root.
    """
    total = matrix.shape[0]
    n = total - last
    ones = np.ones(len(matrix.data), dtype=np.int8)
    whole = sparse.csr_matrix((ones, matrix.indices, matrix.indptr), shape=matrix.shape)
    graph = whole[:unknowns, :unknowns]
    couples = whole[unknowns:n, :unknowns]
    if n > unknowns:  # unknowns of one constraint are neighbors
        wide = couples.astype(np.int32)
        graph = (graph.astype(np.int32) + wide.T @ wide).tocsr()
    tree = _dissect(graph)
    home = np.empty(unknowns, dtype=np.int64)
    for i, (vertices, _) in enumerate(tree):
        home[vertices] = i
    last_home = np.full(n - unknowns, len(tree) - 1)
    filled = np.flatnonzero(np.diff(couples.indptr))
    if len(filled):
        last_home[filled] = np.maximum.reduceat(home[couples.indices], couples.indptr[filled])
    by_home = np.argsort(last_home, kind="stable")
    bounds = np.searchsorted(last_home[by_home], np.arange(len(tree) + 1))
    parts, nodes, placed = [], [], 0
    for i, (vertices, children) in enumerate(tree):
        own = [vertices, unknowns + by_home[bounds[i] : bounds[i + 1]]]
        if i == len(tree) - 1:
            own.append(np.arange(n, total))
        parts += own
        size = sum(len(part) for part in own)
        nodes.append((placed, placed + size, children))
        placed += size
    order = np.concatenate(parts).astype(np.int64)

    # Lower triangle in the new order, with the place of each entry in the data of the matrix.
    tagged = sparse.csc_matrix(
        (np.arange(1, len(matrix.data) + 1, dtype=float), matrix.indices, matrix.indptr),
        shape=matrix.shape,
    )
    lower = sparse.tril(tagged[order][:, order], format="csc")
    lower.sort_indices()
    gather = lower.data.astype(np.int64) - 1
    borders: list[Index] = []
    for first, end, children in nodes:
        rows = lower.indices[lower.indptr[first] : lower.indptr[end]]
        later = [rows[rows >= end]] + [borders[c][borders[c] >= end] for c in children]
        borders.append(np.unique(np.concatenate(later)).astype(np.int64))
    into: list[Index] = [np.zeros(0, np.int64)] * len(nodes)
    fronts = []

    def local(rows: Index, first: int, end: int, border: Index) -> Index:
        own = rows < end
        return np.where(own, rows - first, end - first + np.searchsorted(border, rows))

    for i, (first, end, children) in enumerate(nodes):
        border = borders[i]
        size = end - first + len(border)
        entries = np.arange(lower.indptr[first], lower.indptr[end])
        rows = local(lower.indices[entries].astype(np.int64), first, end, border)
        columns = np.repeat(np.arange(end - first), np.diff(lower.indptr[first : end + 1]))
        for c in children:
            into[c] = local(borders[c], first, end, border)
        fronts.append((first, end, border, children, entries, rows * size + columns))
    return Plan(
        order,
        tuple(Front(*front[:4], front[4], front[5], into[i]) for i, front in enumerate(fronts)),
        gather,
    )


_PLANS: OrderedDict[bytes, Plan] = OrderedDict()
_LOCK = threading.Lock()


def plan_for(matrix: Any, unknowns: int, last: int) -> Plan:
    """Return the plan of a pattern; the eight patterns used last are remembered."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(np.array([matrix.shape[0], unknowns, last]).tobytes())
    digest.update(np.ascontiguousarray(matrix.indptr).tobytes())
    digest.update(np.ascontiguousarray(matrix.indices).tobytes())
    key = digest.digest()
    with _LOCK:
        if key in _PLANS:
            _PLANS.move_to_end(key)
            return _PLANS[key]
    plan = make_plan(matrix, unknowns, last)
    with _LOCK:
        _PLANS[key] = plan
        while len(_PLANS) > 8:
            _PLANS.popitem(last=False)
    return plan


def _block_eigenvalues(factors: Array, pivots: Any) -> Array:
    """Return the eigenvalues of the 1 x 1 and 2 x 2 pivots of LAPACK's lower Bunch-Kaufman form."""
    values = np.diagonal(factors).copy()
    doubles = np.flatnonzero(pivots < 0)[::2]
    if len(doubles):
        a, c, b = values[doubles], values[doubles + 1], factors[doubles + 1, doubles]
        middle, radius = (a + c) / 2, np.hypot((a - c) / 2, b)
        values[doubles], values[doubles + 1] = middle - radius, middle + radius
    return values


class Multifrontal:
    """Factors of a symmetric sparse matrix, whose last rows may be dense.

    Parameters
    ----------
    matrix : csc_matrix
        Both triangles, sorted indices, no duplicates; rows of similar size (scaled).
    unknowns : int
        Number of rows, at the beginning, that are not multipliers.
    last : int
        Number of dense rows at the end.
    """

    def __init__(self, matrix: Any, unknowns: int, last: int) -> None:
        plan = plan_for(matrix, unknowns, last)
        self.plan = plan
        data = matrix.data[plan.gather]
        rounding = EPS * max(64.0, 8.0 * float(np.sqrt(matrix.shape[0])))
        terms = 1.0  # largest terms that were subtracted: their rounding errors hide pivots
        positive = negative = zero = 0
        smallest, largest = np.inf, 0.0
        self.delayed_count = 0
        nothing = (np.zeros((0, 0)), 0)
        passed: list[tuple[Array, int]] = [nothing] * len(plan.fronts)
        self._parts: list[tuple[Any, ...]] = []
        for i, front in enumerate(plan.fronts):
            k, r = front.last - front.first, len(front.border)
            d = sum(passed[c][1] for c in front.children)
            f = k + r + d
            full = np.zeros((f, f))
            if d:
                small = np.zeros((k + r) * (k + r))
                small[front.target] = data[front.source]
                full[: k + r, : k + r] = small.reshape(k + r, k + r)
            else:
                full.reshape(-1)[front.target] = data[front.source]
            # Entries are in the lower triangle, columns of the own unknowns.
            full[:k, : k + r] += np.tril(full[: k + r, :k], -1).T
            place = k + r
            for c in front.children:
                block, late_count = passed[c]
                where = plan.fronts[c].into
                if late_count:
                    where = np.concatenate([where, np.arange(place, place + late_count)])
                    place += late_count
                full[where[:, None], where] += block
                passed[c] = nothing
            own = np.concatenate([np.arange(k), np.arange(k + r, f)]) if d else slice(0, k)
            if d:
                f11, f21 = full[own[:, None], own], full[k : k + r][:, own]  # type: ignore[index]
            else:
                f11, f21 = full[:k, :k], full[k:, :k]
            f22 = full[k : k + r, k : k + r]
            if k + d == 0:
                self._parts.append(("empty",))
                passed[i] = (f22, 0)
                continue
            factors, info = lapack.dpotrf(f11, lower=1, clean=1)
            if info == 0:
                root = np.diagonal(factors) ** 2
                # Rows of the scaled matrix are of size one: smaller pivots are looked at closely.
                if np.all(root > 1e-10):
                    half, _ = lapack.dtrtrs(factors, f21.T, lower=1) if r else (f21.T, 0)
                    if not r or np.max(np.abs(half), initial=0.0) <= GROWTH * np.sqrt(root.max()):
                        terms = max(terms, float(np.max(half * half, initial=0.0)))
                        positive += k + d
                        smallest, largest = min(smallest, root.min()), max(largest, root.max())
                        self._parts.append(("root", factors, half, d))
                        passed[i] = (f22 - half.T @ half if r else f22, 0)
                        continue
            factors, pivots, info = lapack.dsytrf(f11, lower=1)
            values = _block_eigenvalues(factors, pivots)
            sizes = np.abs(values)
            good = info == 0 and bool(np.all(sizes > 1e-10 * max(1.0, float(np.max(sizes)))))
            if good:
                # LAPACK solves many right-hand sides with these factors slowly; LU is faster.
                factors, pivots, info = lapack.dgetrf(f11)
                good = info == 0
                if good and r:
                    x, _ = lapack.dgetrs(factors, pivots, f21.T)
                    growth = float(np.max(np.abs(x)))
                    good = growth <= GROWTH
                    if good:
                        terms = max(terms, growth * float(np.max(np.abs(f21))))
            if good:
                positive += int(np.count_nonzero(values > 0))
                negative += int(np.count_nonzero(values < 0))
                smallest, largest = min(smallest, sizes.min()), max(largest, sizes.max())
                self._parts.append(("block", factors, pivots, f21, d))
                passed[i] = (f22 - f21 @ x if r else f22, 0)
                continue
            values, q = np.linalg.eigh(0.5 * (f11 + f11.T))
            coupling = f21 @ q
            reach = np.max(np.abs(coupling), axis=0, initial=0.0)
            sizes = np.abs(values)
            tiny = rounding * max(terms, float(np.max(sizes)))
            taken = (sizes >= THRESHOLD * reach) & (sizes > tiny)
            is_root = i == len(plan.fronts) - 1
            late = np.zeros(0, dtype=np.int64) if is_root else np.flatnonzero(~taken)
            if is_root:
                zero += int(np.count_nonzero(~taken))
                smallest = 0.0 if np.any(~taken) else smallest
            positive += int(np.count_nonzero(values[taken] > 0))
            negative += int(np.count_nonzero(values[taken] < 0))
            if np.any(taken):
                smallest = min(smallest, sizes[taken].min())
                largest = max(largest, sizes[taken].max())
            ca = coupling[:, taken]
            if r and np.any(taken):
                terms = max(terms, float(np.max(ca * ca / sizes[taken])))
            self._parts.append(("turn", q[:, taken], values[taken], ca, q[:, late], d))
            self.delayed_count += len(late)
            schur = np.empty((r + len(late), r + len(late)))
            schur[:r, :r] = f22 - (ca / values[taken]) @ ca.T
            schur[r:, r:] = np.diag(values[late])
            schur[:r, r:] = coupling[:, late]
            schur[r:, :r] = coupling[:, late].T
            passed[i] = (schur, len(late))
        self.inertia = (positive, negative, zero)
        self.relative_smallest_pivot = float(smallest / largest) if largest > 0 else 0.0
        if not np.isfinite(largest):
            raise FactorizationError("the sparse factorization is not finite")

    def solve(self, rhs: Array) -> Array:
        """Return the solution for columns (n, k); zero pivots are left out."""
        order, fronts = self.plan.order, self.plan.fronts
        y = rhs[order]
        late: list[Array] = []
        middle: list[Any] = []
        empty = np.zeros((0, rhs.shape[1]))
        for front, part in zip(fronts, self._parts, strict=True):
            if part[0] == "empty":
                late.append(empty)
                middle.append(None)
                continue
            own = y[front.first : front.last]
            received = [late[c] for c in front.children if len(late[c])]
            if received:
                own = np.concatenate([own, *received])
            if part[0] == "root":
                _, factors, half, _ = part
                z, _ = lapack.dtrtrs(factors, own, lower=1)
                if len(front.border):
                    y[front.border] -= half.T @ z
                late.append(empty)
                middle.append(z)
            elif part[0] == "block":
                _, factors, pivots, f21, _ = part
                z, _ = lapack.dgetrs(factors, pivots, own)
                if len(front.border):
                    y[front.border] -= f21 @ z
                late.append(empty)
                middle.append(own)
            else:
                _, qa, values, ca, ql, _ = part
                z = (qa.T @ own) / values[:, None]
                if len(front.border):
                    y[front.border] -= ca @ z
                late.append(ql.T @ own)
                middle.append(z)
        back: list[Any] = [empty] * len(fronts)
        for i in range(len(fronts) - 1, -1, -1):
            front, part = fronts[i], self._parts[i]
            if part[0] == "empty":
                x = empty
            elif part[0] == "root":
                _, factors, half, _ = part
                z = middle[i]
                if len(front.border):
                    z = z - half @ y[front.border]
                x, _ = lapack.dtrtrs(factors, z, lower=1, trans=1)
            elif part[0] == "block":
                _, factors, pivots, f21, _ = part
                own = middle[i]
                if len(front.border):
                    own = own - f21.T @ y[front.border]
                x, _ = lapack.dgetrs(factors, pivots, own)
            else:
                _, qa, values, ca, ql, _ = part
                z = middle[i]
                if len(front.border):
                    z = z - (ca.T @ y[front.border]) / values[:, None]
                x = qa @ z
                if ql.shape[1]:
                    x = x + ql @ back[i]
            k = front.last - front.first
            y[front.first : front.last] = x[:k]
            place = k
            for c in front.children:
                size = len(late[c])
                if size:
                    back[c] = x[place : place + size]
                    place += size
        result = np.empty_like(rhs)
        result[order] = y
        return result
