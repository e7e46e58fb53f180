"""Compiled assembly of the membrane energy of a Foeppl-von Karman plate, with exact derivatives."""

from __future__ import annotations

import numpy as np

from lissome._compile import jit


@jit
def membrane(
    order,
    local,
    place,
    gradients,
    tilts,
    weights,
    stiffness,
    poisson_ratio,
    natural,
    x,
    force,
    data,
):
    r"""Add the membrane energy of all triangles; return it.

    The strain is :math:`\epsilon = \mathrm{sym} \nabla u + \frac12 g \otimes g`, with a slope g that is
    linear in the unknowns (the gradient of w, or a field that stands for it), and the energy density

    .. math:: \tfrac12 (\epsilon - \epsilon_m) : \mathbb{A} (\epsilon - \epsilon_m).

    Parameters
    ----------
    order : int
        0: energy; 1: also the gradient; 2: also the Hessian.
    local : ndarray (T, l) of int64
        Unknowns of a triangle: n of u_x, n of u_y, m of the slope, and others.
    place : ndarray (T, l, l) of int64
        Place in `data`, or -1.
    gradients : ndarray (T, Q, n, 2)
        Of the basis of u.
    tilts : ndarray (T, Q, m, 2)
        g of each unknown of the slope.
    weights : ndarray (T, Q)
    stiffness, poisson_ratio : ndarray (T, Q)
        Stretching modulus C and Poisson's ratio.
    natural : ndarray (T, Q, 3)
        Spontaneous strain, xx, yy, xy.
    x : ndarray (size,)
    force : ndarray (size,)
        Added to.
    data : ndarray
        Entries of the Hessian; added to.
    """
    triangles, points, n, _ = gradients.shape
    m = tilts.shape[2]
    size = 2 * n + m
    energy = 0.0
    f = np.empty(size)
    h = np.empty((size, size))
    b = np.empty((size, 3))
    db = np.empty((size, 3))
    for t in range(triangles):
        f[:] = 0.0
        h[:] = 0.0
        for q in range(points):
            uxx = uxy = uyx = uyy = gx = gy = 0.0
            for i in range(n):
                px, py = gradients[t, q, i, 0], gradients[t, q, i, 1]
                u, v = x[local[t, i]], x[local[t, n + i]]
                uxx += u * px
                uxy += u * py
                uyx += v * px
                uyy += v * py
            for i in range(m):
                w = x[local[t, 2 * n + i]]
                gx += w * tilts[t, q, i, 0]
                gy += w * tilts[t, q, i, 1]
            exx = uxx + 0.5 * gx * gx - natural[t, q, 0]
            eyy = uyy + 0.5 * gy * gy - natural[t, q, 1]
            gamma = uxy + uyx + gx * gy - 2.0 * natural[t, q, 2]
            nu = poisson_ratio[t, q]
            a = stiffness[t, q] / (1.0 - nu * nu) * weights[t, q]
            shear = 0.5 * (1.0 - nu) * a
            sxx = a * (exx + nu * eyy)
            syy = a * (eyy + nu * exx)
            sxy = shear * gamma
            energy += 0.5 * (sxx * exx + syy * eyy + sxy * gamma)
            if order == 0:
                continue
            for i in range(n):
                px, py = gradients[t, q, i, 0], gradients[t, q, i, 1]
                f[i] += sxx * px + sxy * py
                f[n + i] += sxy * px + syy * py
            for i in range(m):
                px, py = tilts[t, q, i, 0], tilts[t, q, i, 1]
                f[2 * n + i] += sxx * gx * px + syy * gy * py + sxy * (gx * py + gy * px)
            if order == 1:
                continue
            for i in range(n):
                px, py = gradients[t, q, i, 0], gradients[t, q, i, 1]
                b[i, 0], b[i, 1], b[i, 2] = px, 0.0, py
                b[n + i, 0], b[n + i, 1], b[n + i, 2] = 0.0, py, px
            for i in range(m):
                px, py = tilts[t, q, i, 0], tilts[t, q, i, 1]
                b[2 * n + i, 0], b[2 * n + i, 1] = gx * px, gy * py
                b[2 * n + i, 2] = gx * py + gy * px
            for i in range(size):
                db[i, 0] = a * (b[i, 0] + nu * b[i, 1])
                db[i, 1] = a * (b[i, 1] + nu * b[i, 0])
                db[i, 2] = shear * b[i, 2]
            for i in range(size):
                for j in range(i + 1):
                    h[i, j] += db[i, 0] * b[j, 0] + db[i, 1] * b[j, 1] + db[i, 2] * b[j, 2]
            for i in range(m):
                px, py = tilts[t, q, i, 0], tilts[t, q, i, 1]
                tx, ty = sxx * px + sxy * py, sxy * px + syy * py
                for j in range(i + 1):
                    h[2 * n + i, 2 * n + j] += tx * tilts[t, q, j, 0] + ty * tilts[t, q, j, 1]
        if order == 0:
            continue
        for i in range(size):
            force[local[t, i]] += f[i]
        if order == 1:
            continue
        for i in range(size):
            for j in range(i + 1):
                at = place[t, i, j]
                if at >= 0:
                    data[at] += h[i, j]
                    if i != j:
                        data[place[t, j, i]] += h[i, j]
    return energy
