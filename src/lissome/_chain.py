r"""Compiled symmetric factorization of a band with a dense border, and its inertia.

A chain of small blocks is a band matrix; closure constraints, neutral motions and the unknowns that
close a ring make a border of a few dense rows:

.. math:: K = \begin{pmatrix} A & B^T \\ B & C \end{pmatrix} = P L D L^T P^T .

Columns of the band are eliminated one after the other. A column is taken as a 1 x 1 pivot if it
passes the threshold test of Duff and Reid. If it does not (zero diagonal of a multiplier, singular
leading block) it is *delayed*: it joins the border, and leaves it again as soon as it makes an
acceptable pivot, alone or with a later column. What is left at the end is factored densely with
complete pivoting. All multipliers in L stay below 1/threshold in size, so that the factorization is
backward stable for any regular K, whatever its leading blocks.

Most matrices need none of this: `eliminate_plainly` goes as far as columns are good pivots, and only
from the first that is none does `factorize_chain` take over. So what most first calls do not need is
not compiled by them.

Storage: ``band[j, k]`` is the entry (j + k, j), k = 0 ... w, padded with zeros at the end;
``border[j, r]`` is the entry of border row r in column j. Arrays are C-contiguous float64.
"""

from __future__ import annotations

import math

import numpy as np

from lissome._compile import jit as _jit

jit = _jit(no_cfunc_wrapper=True)
# Called by compiled code only: less to compile.
inner = _jit(no_cfunc_wrapper=True, no_cpython_wrapper=True)

#: Largest sum of the entries of a scaled border row.
_BORDER = 0.0625

#: Columns whose part of entries is more than one over this are eliminated as if they were full.
_FULL = 1.5

#: Kinds of events in the record of an elimination.
_ONE, _DELAY, _SLOT, _PAIR = 1, 2, 3, 4


@jit
def list_entries(band, columns, at, count):
    """Write where the first columns of the band have entries below the diagonal.

    Bands are wide where a few unknowns reach far, and mostly empty then.

    Parameters
    ----------
    band : ndarray (n, w + 1)
    columns : int
        Their number.
    at : ndarray (n, w + 1) of uint32
        Overwritten: the first ``count[j]`` of row j are the offsets k of entries ``band[j, k]``.
    count : ndarray (n,) of uint32
        Overwritten.
    """
    n, width = band.shape
    for j in range(columns):
        c = 0
        for k in range(1, min(width, n - j)):
            at[j, c] = k
            c += 1 if band[j, k] != 0.0 else 0
        count[j] = c


@jit
def scale_chain(band, at, count, border, corner, nb, passes, scale, largest):
    """Write factors (powers of two) that make all rows of similar size (Ruiz' iteration).

    Rows of the border are made smaller still: what eliminated columns leave there adds up along the
    chain, and is not to delay those that follow. Border rows are no pivots before the end, where their
    scale does not matter.

    ``at`` and ``count`` are those of `list_entries`; ``largest``, like ``scale`` (n + nb,), is overwritten.

    Returns
    -------
    norm : float
        Largest entry of band and border; NaN or infinity if an entry of the matrix is not finite.
    """
    n = band.shape[0]
    for j in range(n + nb):
        scale[j] = 1.0
    norm = 0.0
    poison = 0.0  # zero times every entry: NaN unless all are finite
    for r in range(nb):
        for s in range(nb):
            poison += 0.0 * corner[r, s]
    for p in range(passes):
        for j in range(n + nb):
            largest[j] = 0.0
        for j in range(n):
            sj = scale[j]
            big = largest[j]
            for a in range(-1, count[j]):
                k = at[j, a] if a >= 0 else 0
                v = abs(band[j, k])
                if p == 0:
                    poison += 0.0 * v
                    if v > norm:
                        norm = v
                u = v * scale[j + k]
                if u > big:
                    big = u
                if a >= 0:
                    v *= sj
                    if v > largest[j + k]:
                        largest[j + k] = v
            for r in range(n, n + nb):
                v = abs(border[j, r - n])
                if p == 0:
                    poison += 0.0 * v
                    if v > norm:
                        norm = v
                u = v * scale[r]
                if u > big:
                    big = u
                v *= sj
                if v > largest[r]:
                    largest[r] = v
            largest[j] = big
        if math.isnan(poison):
            return poison
        for r in range(n, n + nb):
            for s in range(n, n + nb):
                v = abs(corner[r - n, s - n]) * scale[s]
                if v > largest[r]:
                    largest[r] = v
        for j in range(n + nb):
            if largest[j] > 0.0:
                scale[j] /= math.sqrt(largest[j] * scale[j])
    # What columns leave in a border row adds up along the chain: its sum counts, not its largest entry.
    for r in range(nb):
        total = 0.0
        for j in range(n):
            total += abs(border[j, r]) * scale[j]
        total *= scale[n + r]
        if total > _BORDER:
            scale[n + r] *= _BORDER / total
    for j in range(n + nb):
        mantissa, exponent = math.frexp(scale[j])
        scale[j] = math.ldexp(1.0, exponent - (1 if mantissa < math.sqrt(0.5) else 0))
    return norm


@jit
def scaled_copy(band, at, count, border, corner, nb, scale, band_out, border_out, corner_out):
    """Write the scaled matrix to work arrays; the columns of the slots are set to zero."""
    n = band.shape[0]
    band_out[:] = 0.0
    border_out[:] = 0.0
    corner_out[:] = 0.0
    for j in range(n):
        sj = scale[j]
        band_out[j, 0] = band[j, 0] * (sj * sj)
        for a in range(count[j]):
            k = at[j, a]
            band_out[j, k] = band[j, k] * (sj * scale[j + k])
        for r in range(nb):
            border_out[j, r] = border[j, r] * (sj * scale[n + r])
    for r in range(nb):
        for s in range(nb):
            corner_out[r, s] = corner[r, s] * (scale[n + r] * scale[n + s])


@jit
def apply_chain(band, at, count, border, corner, nb, x, out):
    """Write the matrix times ``x`` (k, n + nb) to ``out``."""
    n = band.shape[0]
    for c in range(x.shape[0]):
        for j in range(n + nb):
            out[c, j] = 0.0
        for j in range(n):
            xj = x[c, j]
            total = band[j, 0] * xj
            for a in range(count[j]):
                k = at[j, a]
                total += band[j, k] * x[c, j + k]
                out[c, j + k] += band[j, k] * xj
            for r in range(nb):
                total += border[j, r] * x[c, n + r]
                out[c, n + r] += border[j, r] * xj
            out[c, j] += total
        for r in range(nb):
            for s in range(nb):
                out[c, n + r] += corner[r, s] * x[c, n + s]


@jit
def magnitude_chain(band, at, count, border, corner, nb, x, out):
    """Write absolute values of the matrix times those of ``x`` (n + nb,) to ``out``."""
    n = band.shape[0]
    for j in range(n + nb):
        out[j] = 0.0
    for j in range(n):
        xj = abs(x[j])
        total = abs(band[j, 0]) * xj
        for a in range(count[j]):
            k = at[j, a]
            v = abs(band[j, k])
            total += v * abs(x[j + k])
            out[j + k] += v * xj
        for r in range(nb):
            v = abs(border[j, r])
            total += v * abs(x[n + r])
            out[n + r] += v * xj
        out[j] += total
    for r in range(nb):
        for s in range(nb):
            out[n + r] += abs(corner[r, s]) * abs(x[n + s])


@inner
def _residual(band, at, count, border, corner, nb, b, z, left, sizes):
    """Write b - K z and |b| + |K| |z|; return the largest ratio of their entries."""
    n = band.shape[0]
    for j in range(n + nb):
        left[j] = b[j]
        sizes[j] = abs(b[j])
    for j in range(n):
        zj = z[j]
        v = band[j, 0] * zj
        total = v
        weight = abs(v)
        for i in range(count[j]):
            k = at[j, i]
            a = band[j, k]
            v = a * z[j + k]
            total += v
            weight += abs(v)
            v = a * zj
            left[j + k] -= v
            sizes[j + k] += abs(v)
        for r in range(nb):
            a = border[j, r]
            v = a * z[n + r]
            total += v
            weight += abs(v)
            v = a * zj
            left[n + r] -= v
            sizes[n + r] += abs(v)
        left[j] -= total
        sizes[j] += weight
    for r in range(nb):
        for s in range(nb):
            v = corner[r, s] * z[n + s]
            left[n + r] -= v
            sizes[n + r] += abs(v)
    worst = 0.0
    for j in range(n + nb):
        if left[j] != 0.0:
            ratio = abs(left[j]) / sizes[j]
            if not ratio <= worst:  # lets no NaN go
                worst = ratio
    return worst


@inner
def _coupling(border, corner, j, s, top, reach):
    """Return the largest entry that a delayed column shares with what is left after column j."""
    big = 0.0
    for k in range(1, reach + 1):
        big = max(big, abs(border[j + k, s]))
    for r in range(top):
        if r < s:
            big = max(big, abs(corner[s, r]))
        elif r > s:
            big = max(big, abs(corner[r, s]))
    return big


@inner
def _eliminate(band, border, corner, weight, i, j, s, top, reach, pii, pij, pjj, pair):
    """Eliminate the delayed column i of slot s, alone or with column j; j is the last that is gone.

    The pivot's inverse is [[pii, pij], [pij, pjj]]. Column i moves from its slot back to its place
    in the band.
    """
    w = band.shape[1] - 1
    for k in range(1, w + 1):
        band[i, k] = 0.0
    for k in range(1, reach + 1):
        band[i, k] = border[j + k, s]
        border[j + k, s] = 0.0
    for r in range(top):
        if r < s:
            border[i, r] = corner[s, r]
            corner[s, r] = 0.0
        elif r > s:
            border[i, r] = corner[r, s]
            corner[r, s] = 0.0
    border[i, s] = 0.0
    corner[s, s] = 0.0
    if pair:
        border[j, s] = 0.0
    for k in range(1, reach + 1 + top):
        # Rows of the window first, then those of the border.
        inside = k <= reach
        r = k - reach - 1
        u = band[i, k] if inside else border[i, r]
        v = 0.0
        if pair:
            v = band[j, k] if inside else border[j, r]
        fi = pii * u + pij * v
        fj = pij * u + pjj * v
        if fi == 0.0 and fj == 0.0:
            continue
        if inside:
            for q in range(reach - k + 1):
                band[j + k, q] -= fi * band[i, k + q]
            for t in range(top):
                border[j + k, t] -= fi * border[i, t]
            if pair:
                for q in range(reach - k + 1):
                    band[j + k, q] -= fj * band[j, k + q]
                for t in range(top):
                    border[j + k, t] -= fj * border[j, t]
        else:
            for t in range(r + 1):
                corner[r, t] -= fi * border[i, t]
            weight[r] += abs(fi * border[i, r])
            if pair:
                for t in range(r + 1):
                    corner[r, t] -= fj * border[j, t]
                weight[r] += abs(fj * border[j, r])
    for k in range(1, reach + 1 + top):
        inside = k <= reach
        r = k - reach - 1
        u = band[i, k] if inside else border[i, r]
        v = 0.0
        if pair:
            v = band[j, k] if inside else border[j, r]
        if inside:
            band[i, k] = pii * u + pij * v
        else:
            border[i, r] = pii * u + pij * v
        if pair:
            if inside:
                band[j, k] = pij * u + pjj * v
            else:
                border[j, r] = pij * u + pjj * v


@jit
def eliminate_plainly(band, border, corner, nb, threshold, floor, pivots, weight):
    """Factor in place the columns before the first that makes no good pivot.

    Almost every chain needs nothing else. The inner loops stand again in `factorize_chain`, which
    takes several times as long to compile and is compiled only when a pivot must wait; one callee
    for both would double the time of a factorization, since compiled calls count references.

    Arguments are those of `factorize_chain`.

    Returns
    -------
    columns : int
        Their number.
    positive, negative : int
        Of pivots.
    smallest, largest : float
        Extreme sizes of pivots.
    growth : float
        Largest pivot or pivot column met.
    """
    n, width = band.shape
    for r in range(nb):
        weight[r] = abs(corner[r, r])
    positive = 0
    smallest = np.inf
    largest = 0.0
    growth = 0.0
    columns = n
    for j in range(n):
        reach = min(width - 1, n - 1 - j)
        a = band[j, 0]
        size = abs(a)
        big = 0.0
        for k in range(1, reach + 1):
            big = max(big, abs(band[j, k]))
        for r in range(nb):
            big = max(big, abs(border[j, r]))
        if not (size >= threshold * big and size > floor):
            columns = j
            break
        d = 1.0 / a
        for k in range(1, reach + 1):
            factor = band[j, k] * d
            if factor != 0.0:
                for q in range(reach - k + 1):
                    band[j + k, q] -= factor * band[j, k + q]
                for r in range(nb):
                    border[j + k, r] -= factor * border[j, r]
        for r in range(nb):
            factor = border[j, r] * d
            if factor != 0.0:
                for s in range(r + 1):
                    corner[r, s] -= factor * border[j, s]
                weight[r] += abs(factor * border[j, r])
        for k in range(1, reach + 1):
            band[j, k] *= d
        for r in range(nb):
            border[j, r] *= d
        pivots[j, 0] = d
        if a > 0.0:
            positive += 1
        smallest = min(smallest, size)
        largest = max(largest, size)
        growth = max(growth, big, size)
    return columns, positive, columns - positive, smallest, largest, growth


@jit
def factorize_chain(
    band, at, count, border, corner, nb, slots, threshold, floor, pivots, weight, events, links,
    occupant, done,
):  # fmt: skip
    """Go on where `eliminate_plainly` stopped; ``border`` is (n, nb + slots), ``corner`` square.

    Parameters
    ----------
    band, border, corner : ndarray
        Overwritten by the factors. Columns and rows of the slots must be zero.
    at, count : ndarray (n, w + 1) and (n,) of uint32
        Overwritten: offsets and numbers of the entries below the diagonal that columns of the band have
        when they are eliminated.
    nb, slots : int
        Number of border rows, and of places for delayed columns.
    threshold : float
        Smallest ratio of a pivot to its column, at most 1/2.
    floor : float
        Pivots up to this size, relative to the terms that are summed in them, are zero.
    pivots : ndarray (n + nb + slots, 3)
        Overwritten: entries of the inverse pivots.
    weight : ndarray (nb + slots,)
        Sizes of what is summed in the diagonal entries of the corner.
    events : ndarray (2 n, 3) of int64
        Overwritten: kind, column, slot.
    links : ndarray (n, 2) of int64
        Overwritten: for each column the last row of the band that was gone when it was eliminated,
        and its partner in a 2 x 2 pivot (or -1).
    occupant : ndarray (slots,) of int64
        Overwritten: column in each slot at the end, or -1.
    done : tuple
        What `eliminate_plainly` returned.

    Returns
    -------
    status : int
        0, or 1 if the slots did not suffice.
    number : int
        Of events.
    top : int
        Number of border rows and slots that may be in use.
    positive, negative : int
        Of pivots so far.
    smallest, largest : float
        Extreme sizes of pivots.
    growth : float
        Largest pivot or pivot column met.
    """
    n, width = band.shape
    w = width - 1
    occupant[:] = -1
    row = np.empty(width)
    top = nb  # border rows in use are below this
    used = 0
    number, positive, negative, smallest, largest, growth = done
    first = number
    list_entries(band, first, at, count)
    for j in range(first):
        links[j, 0] = j
        links[j, 1] = -1
        events[j, 0] = _ONE
        events[j, 1] = j
        events[j, 2] = nb
    for j in range(first, n):
        reach = min(w, n - 1 - j)
        a = band[j, 0]
        size = abs(a)
        big = 0.0
        c = 0
        for k in range(1, reach + 1):
            at[j, c] = k
            c += 1 if band[j, k] != 0.0 else 0
        count[j] = c
        for i in range(c):
            row[i] = band[j, at[j, i]]
            big = max(big, abs(row[i]))
        rows = 0  # of the border that this column has to do with
        for r in range(top):
            if border[j, r] != 0.0:
                big = max(big, abs(border[j, r]))
                rows = r + 1
        growth = max(growth, big, size)
        done = size >= threshold * big and size > floor
        if done:
            d = 1.0 / a
            full = _FULL * c > reach
            for i in range(c):
                k = at[j, i]
                factor = row[i] * d
                if full:
                    for q in range(reach - k + 1):
                        band[j + k, q] -= factor * band[j, k + q]
                else:
                    jk = np.uint64(j) + k
                    for p in range(i, c):
                        band[jk, at[j, p] - k] -= factor * row[p]
                for r in range(rows):
                    border[j + k, r] -= factor * border[j, r]
            for r in range(rows):
                factor = border[j, r] * d
                if factor != 0.0:
                    for s in range(r + 1):
                        corner[r, s] -= factor * border[j, s]
                    weight[r] += abs(factor * border[j, r])
            for i in range(c):
                band[j, at[j, i]] = row[i] * d
            for r in range(rows):
                border[j, r] *= d
            pivots[j, 0] = d
            links[j, 0] = j
            links[j, 1] = -1
            events[number, 0] = _ONE
            events[number, 1] = j
            events[number, 2] = top
            number += 1
            if a > 0.0:
                positive += 1
            else:
                negative += 1
            smallest = min(smallest, abs(a))
            largest = max(largest, abs(a))
        # Delayed columns: one may go with column j, or column j joins them; then any that has become
        # a good pivot goes.
        while True:
            best = -1
            if not done:
                quality = 0.0
                for s in range(nb, top):
                    if occupant[s - nb] < 0:
                        continue
                    b = border[j, s]
                    c = corner[s, s]
                    det = a * c - b * b
                    if abs(det) <= floor * max(abs(b), abs(a), abs(c)):
                        continue
                    big_s = _coupling(border, corner, j, s, top, reach)
                    big_j = 0.0
                    for k in range(1, reach + 1):
                        big_j = max(big_j, abs(band[j, k]))
                    for r in range(top):
                        if r != s:
                            big_j = max(big_j, abs(border[j, r]))
                    size = max(abs(a) * big_s + abs(b) * big_j, abs(b) * big_s + abs(c) * big_j)
                    value = abs(det) / max(size, 1e-300)
                    if value >= threshold and value > quality:
                        quality = value
                        best = s
                if best < 0:
                    for t in range(slots):
                        if occupant[t] < 0:
                            best = nb + t
                            break
                    if best < 0:
                        return 1, number, top, positive, negative, smallest, largest, growth
                    s = best
                    occupant[s - nb] = j
                    used += 1
                    top = max(top, s + 1)
                    corner[s, s] = a
                    weight[s] = max(1.0, abs(a))  # rows of the scaled matrix are of size 1
                    for r in range(top):
                        if r < s:
                            corner[s, r] = border[j, r]
                        elif r > s:
                            corner[r, s] = border[j, r]
                        border[j, r] = 0.0
                    for k in range(1, reach + 1):
                        border[j + k, s] = band[j, k]
                    events[number, 0] = _DELAY
                    events[number, 1] = j
                    events[number, 2] = s
                    number += 1
                    done = True
                    continue
            elif used > 0:
                for s in range(nb, top):
                    i = occupant[s - nb]
                    if i < 0 or i == j or abs(corner[s, s]) <= floor:
                        continue
                    big = _coupling(border, corner, j, s, top, reach)
                    if abs(corner[s, s]) >= threshold * big:
                        growth = max(growth, big, abs(corner[s, s]))
                        best = s
                        break
            if best < 0:
                break
            pair = not done
            done = True
            s = best
            i = occupant[s - nb]
            c = corner[s, s]
            pii = 0.0
            pij = 0.0
            pjj = 0.0
            if pair:  # the inverse of the pivot [[c, b], [b, a]] of columns (i, j)
                b = border[j, s]
                det = a * c - b * b
                pii = a / det
                pij = -b / det
                pjj = c / det
                links[i, 1] = j
                links[j, 0] = j
                links[j, 1] = i
                events[number, 0] = _PAIR
                events[number, 1] = j
                middle = 0.5 * (a + c)
                radius = math.sqrt(0.25 * (a - c) ** 2 + b * b)
                outer = max(abs(middle + radius), abs(middle - radius))
                smallest = min(smallest, abs(det) / outer)
                largest = max(largest, outer)
                if det < 0.0:
                    positive += 1
                    negative += 1
                elif a + c > 0.0:
                    positive += 2
                else:
                    negative += 2
            else:
                pii = 1.0 / c
                links[i, 1] = -1
                events[number, 0] = _SLOT
                events[number, 1] = i
                smallest = min(smallest, abs(c))
                largest = max(largest, abs(c))
                if c > 0.0:
                    positive += 1
                else:
                    negative += 1
            _eliminate(band, border, corner, weight, i, j, s, top, reach, pii, pij, pjj, pair)
            pivots[i, 0] = pii
            pivots[i, 1] = pij
            pivots[i, 2] = pjj
            links[i, 0] = j
            events[number, 2] = s
            number += 1
            occupant[s - nb] = -1
            used -= 1
        if used == 0:
            top = nb
        else:
            while top > nb and occupant[top - 1 - nb] < 0:
                top -= 1
    return 0, number, top, positive, negative, smallest, largest, growth


#: Size of a matrix from which on LAPACK finds its eigenvalues. Its threads would have to wait for one
#: another for each smaller one.
_SMALL = 12


@jit
def _eigen_of_small(a, values, vectors):
    """Write eigenvalues and eigenvectors (columns) of a symmetric matrix by Jacobi's rotations.

    Overwrites ``a``.
    """
    n = values.size
    vectors[:] = 0.0
    nothing = 1e-18 * np.max(np.abs(a))
    for i in range(n):
        vectors[i, i] = 1.0
    for _ in range(60):
        rest = 0.0
        for p in range(n - 1):
            for q in range(p + 1, n):
                apq = a[p, q]
                if abs(apq) <= nothing:
                    continue
                rest = max(rest, abs(apq))
                theta = 0.5 * (a[q, q] - a[p, p]) / apq
                t = 1.0 / (abs(theta) + math.hypot(theta, 1.0))
                t = -t if theta < 0.0 else t
                c = 1.0 / math.hypot(t, 1.0)
                s = t * c
                a[p, p] -= t * apq
                a[q, q] += t * apq
                a[p, q] = 0.0
                a[q, p] = 0.0
                for k in range(n):
                    if k != p and k != q:
                        u, v = a[k, p], a[k, q]
                        a[k, p] = a[p, k] = c * u - s * v
                        a[k, q] = a[q, k] = s * u + c * v
                    u, v = vectors[k, p], vectors[k, q]
                    vectors[k, p] = c * u - s * v
                    vectors[k, q] = s * u + c * v
        if rest == 0.0:
            break
    for i in range(n):
        values[i] = a[i, i]


@jit
def invert_corner(corner, nb, top, occupant, weight, floor, inverse):
    """Write the generalized inverse of what is left: border rows and columns still delayed.

    Returns
    -------
    positive, negative, zero : int
        Its inertia.
    smallest : float
        Size of its smallest eigenvalue, relative to the terms that are summed in it.
    """
    positive = 0
    negative = 0
    zero = 0
    smallest = np.inf
    size = 0
    rows = np.empty(top, dtype=np.int64)
    for r in range(top):
        if r < nb or occupant[r - nb] >= 0:
            rows[size] = r
            size += 1
    small = np.empty((size, size))
    for r in range(size):
        for s in range(r + 1):
            small[r, s] = corner[rows[r], rows[s]]
            small[s, r] = small[r, s]
    inverse[:] = 0.0
    if size > 0:
        # A congruence that makes the rows of similar size; it leaves the inertia as it is.
        turn = np.ones(size)
        for _ in range(3):
            for r in range(size):
                big = 0.0
                for s in range(size):
                    big = max(big, abs(small[r, s]) * turn[s])
                if big > 0.0:
                    turn[r] = 1.0 / math.sqrt(big / turn[r])
        for r in range(size):
            for s in range(size):
                small[r, s] *= turn[r] * turn[s]
        values, vectors = np.empty(size), np.empty((size, size))
        if size <= _SMALL:
            _eigen_of_small(small, values, vectors)
        else:
            values, vectors = np.linalg.eigh(small)
        most = np.max(np.abs(values))
        for r in range(size):
            v = values[r]
            # Rounding errors of the sums that made this eigenvalue, relative to floor.
            noise = 0.0
            for p in range(size):
                noise += (vectors[p, r] * turn[p]) ** 2 * weight[rows[p]]
            noise = max(noise, most)
            smallest = min(smallest, abs(v) / noise if noise > 0.0 else 0.0)
            if abs(v) <= floor * noise:
                zero += 1
                continue
            if v > 0.0:
                positive += 1
            else:
                negative += 1
            for p in range(size):
                for q in range(size):
                    inverse[rows[p], rows[q]] += (
                        vectors[p, r] * turn[p] * (vectors[q, r] * turn[q] / v)
                    )
    return positive, negative, zero, smallest


@inner
def _solve_plainly(factors, nb, y, x, z):
    """Overwrite ``z`` (n + nb,) by the solution, with the factors of `eliminate_plainly`."""
    band, _, _, border, pivots, inverse, _, _ = factors
    n, width = band.shape
    for r in range(nb):
        y[r] = z[n + r]
    for j in range(n):
        v = z[j]
        reach = n - 1 - j
        if reach > width - 1:
            reach = width - 1
        for k in range(1, reach + 1):
            z[j + k] -= band[j, k] * v
        for r in range(nb):
            y[r] -= border[j, r] * v
    for r in range(nb):
        v = 0.0
        for s in range(nb):
            v += inverse[r, s] * y[s]
        x[r] = v
        z[n + r] = v
    for j in range(n - 1, -1, -1):
        v = z[j] * pivots[j, 0]
        reach = n - 1 - j
        if reach > width - 1:
            reach = width - 1
        for k in range(1, reach + 1):
            v -= band[j, k] * z[j + k]
        for r in range(nb):
            v -= border[j, r] * x[r]
        z[j] = v


@inner
def _solve_with_delays(factors, nb, y, x, z):
    """Overwrite ``z`` (n + nb,) by the solution, with the factors of `factorize_chain`."""
    band, at, count, border, pivots, inverse, events, links = factors
    n, width = band.shape
    w = width - 1
    total = border.shape[1]
    number = events.shape[0]
    for r in range(nb):
        y[r] = z[n + r]
    for r in range(nb, total):
        y[r] = 0.0
    for e in range(number):
        kind = events[e, 0]
        j = events[e, 1]
        s = events[e, 2]
        if kind == _ONE:
            v = z[j]
            for p in range(count[j]):
                k = at[j, p]
                z[j + k] -= band[j, k] * v
            for r in range(s):
                y[r] -= border[j, r] * v
        elif kind == _DELAY:
            y[s] = z[j]
        elif kind == _SLOT:
            v = y[s]
            z[j] = v
            y[s] = 0.0
            base = links[j, 0]
            for k in range(1, min(w, n - 1 - base) + 1):
                z[base + k] -= band[j, k] * v
            for r in range(total):
                y[r] -= border[j, r] * v
        else:
            i = links[j, 1]
            u = y[s]
            v = z[j]
            z[i] = u
            y[s] = 0.0
            for k in range(1, min(w, n - 1 - j) + 1):
                z[j + k] -= band[i, k] * u + band[j, k] * v
            for r in range(total):
                y[r] -= border[i, r] * u + border[j, r] * v
    for r in range(total):
        x[r] = 0.0
        for s in range(total):
            x[r] += inverse[r, s] * y[s]
    for e in range(number - 1, -1, -1):
        kind = events[e, 0]
        j = events[e, 1]
        s = events[e, 2]
        if kind == _ONE:
            v = z[j] * pivots[j, 0]
            for p in range(count[j]):
                k = at[j, p]
                v -= band[j, k] * z[j + k]
            for r in range(s):
                v -= border[j, r] * x[r]
            z[j] = v
        elif kind == _DELAY:
            z[j] = x[s]
            x[s] = 0.0
        elif kind == _SLOT:
            v = z[j] * pivots[j, 0]
            base = links[j, 0]
            for k in range(1, min(w, n - 1 - base) + 1):
                v -= band[j, k] * z[base + k]
            for r in range(total):
                v -= border[j, r] * x[r]
            z[j] = v
            x[s] = v
        else:
            i = links[j, 1]
            u = pivots[i, 0] * z[i] + pivots[i, 1] * z[j]
            v = pivots[i, 1] * z[i] + pivots[i, 2] * z[j]
            for k in range(1, min(w, n - 1 - j) + 1):
                u -= band[i, k] * z[j + k]
                v -= band[j, k] * z[j + k]
            for r in range(total):
                u -= border[i, r] * x[r]
                v -= border[j, r] * x[r]
            z[i] = u
            z[j] = v
            x[s] = u
    for r in range(nb):
        z[n + r] = x[r]


def _refined_with(solve):
    """Return a compiled solution with refinement, by one of the two pairs of substitutions."""

    @jit
    def solve_refined(matrix, nb, norm, scale, factors, enough, refinements, b, z, work):
        """Solve for the rows of ``b`` (k, n + nb), with iterative refinement; write to ``z``.

        Parameters
        ----------
        matrix : (band, at, count, border, corner)
            The matrix that was factored, before scaling, and the places of its entries.
        nb : int
            Number of border rows.
        norm : float
            Largest entry of the matrix.
        scale : ndarray (n + nb,)
        factors : (band, at, count, border, pivots, inverse, events, links)
            Of the scaled matrix.
        enough : float
            Refinement ends when the residual of each row is this small against its terms (LAPACK's
            componentwise backward error).
        refinements : int
            Their largest number.
        b, z : ndarray (k, n + nb)
        work : ndarray (6, l)
            Overwritten; l at least n + nb and as many as there are border rows and slots.

        Returns
        -------
        left : float
            Largest residual, relative to the largest right-hand side, plus the largest entry of the
            matrix times that of the solution. Infinite if the solution is not finite.
        """
        band, at, count, border, corner = matrix
        total = scale.size
        trial = work[0]
        left = work[1]
        sizes = work[2]
        again = work[3]
        result = 0.0
        for c in range(b.shape[0]):
            rhs = b[c]
            found = z[c]
            error = np.inf
            for j in range(total):
                found[j] = 0.0
                left[j] = rhs[j]
            for attempt in range(refinements + 1):  # the first is the solution itself
                for j in range(total):
                    trial[j] = scale[j] * left[j]
                solve(factors, nb, work[4], work[5], trial)
                for j in range(total):
                    trial[j] = found[j] + scale[j] * trial[j]
                new = _residual(band, at, count, border, corner, nb, rhs, trial, again, sizes)
                if attempt > 0 and not new < error:
                    break
                slow = new > 0.5 * error
                error = new
                for j in range(total):
                    found[j] = trial[j]
                    left[j] = again[j]
                if slow or error <= enough:
                    break
            most = 0.0
            bound = 0.0
            largest = 0.0
            for j in range(total):
                v = abs(found[j])
                if not v < np.inf:
                    return np.inf
                largest = v if v > largest else largest
                v = abs(left[j])
                most = v if v > most else most
                v = abs(rhs[j])
                bound = v if v > bound else bound
            if most > 0.0:
                v = most / (bound + norm * largest)
                result = v if v > result else result
        return result

    return solve_refined


solve_plainly = _refined_with(_solve_plainly)
solve_with_delays = _refined_with(_solve_with_delays)


@jit
def blocks_to_band(diagonal, lower, w, band):
    """Write a block chain to band storage.

    ``diagonal`` is (K, b, b); ``lower[i, q]``, (K, reach, b, b), is the block in rows of block
    i + q + 1 and columns of block i. Entries outside half bandwidth ``w`` must be zero; the largest
    of them is returned, so that the caller can check.
    """
    count, b, _ = diagonal.shape
    reach = lower.shape[1]
    outside = 0.0
    for i in range(count):
        for c in range(b):
            j = i * b + c
            for k in range(w + 1):
                band[j, k] = 0.0
            for r in range(c, b):
                if r - c <= w:
                    band[j, r - c] = diagonal[i, r, c]
                else:
                    outside = max(outside, abs(diagonal[i, r, c]))
            for q in range(reach):
                if i + q + 1 >= count:
                    break
                for r in range(b):
                    k = (q + 1) * b + r - c
                    if k <= w:
                        band[j, k] = lower[i, q, r, c]
                    else:
                        outside = max(outside, abs(lower[i, q, r, c]))
    return outside
