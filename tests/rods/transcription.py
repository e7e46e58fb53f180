"""The equations of chapter 4.2-4.3 and appendix A.2 as plain numpy, one function each.

Slow and literal: third-order tensors where the thesis has them, one node or segment at a time. All
functions are analytic, without absolute values or conjugated numbers, so that complex arguments
give exact derivatives. ``printed=True`` gives a formula as printed where that is wrong.

Degrees of freedom of one segment: (x_j, phi^j, x_{j+1}), 7 numbers. Of one hinge: (x_{i-1},
phi^{i-1}, x_i, phi^i, x_{i+1}), 11 numbers. Second variations are arrays B[:, m, n] with
delta^2 y = B : (dX (x) dX), symmetric in m and n.
"""

import numpy as np

CROSS = np.zeros((3, 3, 3))  # (a x u)_i = CROSS[i, j, k] a_j u_k
for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    CROSS[i, j, k], CROSS[i, k, j] = 1.0, -1.0


def product(q1, q2):  # (4.4)
    s1, v1, s2, v2 = q1[0], q1[1:], q2[0], q2[1:]
    return np.concatenate([[s1 * s2 - v1 @ v2], s1 * v2 + s2 * v1 + np.cross(v1, v2)])


def bar(q):
    return q * np.array([1, -1, -1, -1])


def pure(v):
    return np.concatenate([[0.0], v])


def act(r, w):
    return product(product(r, pure(w)), bar(r))[1:]


def vector_part(q):
    return ((q - bar(q)) / 2)[1:]


def turn(n, theta):  # (4.5)
    return np.concatenate([[np.cos(theta / 2)], n * np.sin(theta / 2)])


def exp(n_theta):  # (4.5)
    angle = np.sqrt(n_theta @ n_theta)
    return turn(n_theta / angle, angle)


def transport(a, b):  # (4.6)
    c = np.sqrt((1 + a @ b) / 2)
    return np.concatenate([[c], np.cross(a, b) / 2 / c])


def tangent(x0, x1):  # (4.9)
    e = x1 - x0
    return e / np.sqrt(e @ e)


def frame(dof, T, D):  # (4.11), (4.12)
    x0, phi, x1 = dof[:3], dof[3], dof[4:]
    return product(product(transport(T, tangent(x0, x1)), turn(T, phi)), D)


def rotation_gradient(d_left, d_right):  # (4.14)
    return product(bar(d_left), d_right)


def strain(q):  # (4.16)
    return (q - bar(q))[1:]


def stretching(x0, x1, length):  # (4.17)
    e = x1 - x0
    return (e @ e / length - length) / 2


def psi(t):  # (4.18)
    return np.arcsin(t / 2) / (t / 2)


def adjusted(kappa):  # (4.19)
    return psi(np.sqrt(kappa @ kappa)) * kappa


# ---- variations -----------------------------------------------------------------------------------


def operator(a):  # (4.24)
    return np.einsum("ijk,j->ik", CROSS, a)


def binormal(T, t):  # (4.25)
    return 2 * np.cross(T, t) / (1 + T @ t)


def transposed(mu, *permutation):
    """The generalized transpose below (4.22): mu^T(n1 n2 n3)_{i1 i2 i3} = mu_{i_n1 i_n2 i_n3}."""
    result = np.zeros_like(mu)
    for place in np.ndindex(3, 3, 3):
        result[place] = mu[tuple(place[n - 1] for n in permutation)]
    return result


def segment_difference():
    """x_{j+1} - x_j as a linear form of the seven numbers of a segment."""
    form = np.zeros((3, 7))
    form[:, :3], form[:, 4:] = -np.eye(3), np.eye(3)
    return form


def tangent_variations(dof, printed=False):  # (4.22)
    e = dof[4:] - dof[:3]
    size = np.sqrt(e @ e)
    t = e / size
    dE = segment_difference()
    first = (np.eye(3) - np.outer(t, t)) @ dE / size
    tau = np.einsum("ij,k->ijk", np.eye(3) - np.outer(t, t), t)
    if printed:
        total = -tau + transposed(tau, 1, 3, 2) + transposed(tau, 2, 3, 1)
    else:
        total = tau + transposed(tau, 1, 3, 2) + transposed(tau, 2, 3, 1)
    second = -np.einsum("ijk,jm,kn->imn", total, dE, dE) / size**2
    return t, first, (second + np.swapaxes(second, 1, 2)) / 2


def transport_variations(dof, T, printed=False):  # (4.23)
    t, dt, ddt = tangent_variations(dof, printed)
    k = binormal(T, t)
    linear = operator(t) - np.outer(t, k) / 2
    middle = (np.outer(k, T) + np.outer(T, k)) / (4 * (1 + T @ t))
    second = np.einsum("ij,jmn->imn", linear, ddt)
    second = second + np.einsum("i,mn->imn", t, dt.T @ middle @ dt)
    last = np.einsum("im,jn,j->imn", dt, dt, k / 2)
    return linear @ dt, second - (last + np.swapaxes(last, 1, 2)) / 2


def frame_variations(dof, T, printed=False):  # (4.26)
    t, dt, _ = tangent_variations(dof)
    dp, ddp = transport_variations(dof, T, printed)
    dphi = np.eye(7)[3]
    mixed = np.einsum("m,in->imn", dphi, dt)
    return np.outer(t, dphi) + dp, (mixed + np.swapaxes(mixed, 1, 2)) / 2 + ddp


def hinge_variations(dof, T, D, printed=False):
    """(4.27), (4.28): q_i, kappa_i, and first and second variations of kappa_i; T, D of both sides."""
    parts = (dof[:7], dof[4:])
    places = (np.eye(11)[:7], np.eye(11)[4:])
    d = [frame(parts[s], T[s], D[s]) for s in (0, 1)]
    dd = [np.zeros(0)] * 2
    ddd = [np.zeros(0)] * 2
    for s in (0, 1):
        first, second = frame_variations(parts[s], T[s], printed)
        dd[s] = first @ places[s]
        ddd[s] = np.einsum("imn,ma,nb->iab", second, places[s], places[s])

    turned = np.stack([act(bar(d[0]), axis) for axis in np.eye(3)], axis=1)

    def back(columns):  # conj(d^{i-1}) * (...)
        return np.tensordot(turned, columns, 1)

    q = rotation_gradient(d[0], d[1])
    dq = back(dd[1] - dd[0])
    mixed = np.einsum("ijk,jm,kn->imn", CROSS, dq, back(dd[0]))
    ddq = back(ddd[1] - ddd[0]) + (mixed + np.swapaxes(mixed, 1, 2)) / 2
    # vector part of (a quaternion) times q, as a matrix
    times_q = np.stack([vector_part(product(one, q)) for one in np.eye(4)], axis=1)
    dkappa = times_q[:, 1:] @ dq
    scalar = -np.einsum("im,in->mn", dq, dq) / 2
    ddkappa = np.einsum("ij,jmn->imn", times_q, np.concatenate([scalar[None], ddq]))
    return q, strain(q), dkappa, ddkappa


def stretching_variations(dof, length):  # (4.29)
    dE = segment_difference()
    return (dof[4:] - dof[:3]) @ dE / length, dE.T @ dE / length


# ---- a whole rod ----------------------------------------------------------------------------------


def pack(nodes, twists):  # (4.13)
    X = np.zeros(4 * len(twists) + 3, dtype=np.result_type(nodes, twists))
    for j, phi in enumerate(twists):
        X[4 * j : 4 * j + 3], X[4 * j + 3] = nodes[j], phi
    X[-3:] = nodes[-1]
    return X


def frames(X, T, D):
    return np.array([frame(X[4 * j : 4 * j + 7], T[j], D[j]) for j in range(len(T))])


def strains(X, T, D):
    d = frames(X, T, D)
    return np.array([strain(rotation_gradient(d[i - 1], d[i])) for i in range(1, len(T))])


def kirchhoff_energy(X, T, D, lengths, moduli, natural):  # (4.30), (4.31), first sum of (4.32)
    """Moduli (3,), natural strain densities (hinges, 3); Voronoi lengths."""
    voronoi = (lengths[1:] + lengths[:-1]) / 2
    density = strains(X, T, D) / voronoi[:, None] - natural
    return np.sum(voronoi * (density**2 @ (moduli / 2)))


def kirchhoff_gradient(X, T, D, lengths, moduli, natural):  # first sum of (4.34)
    """By the printed variations of the strains; the sum is over all hinges."""
    gradient = np.zeros(X.size, dtype=X.dtype)
    for i in range(1, len(T)):
        length = (lengths[i - 1] + lengths[i]) / 2
        rows = slice(4 * i - 4, 4 * i + 7)
        _, kappa, dkappa, _ = hinge_variations(X[rows], T[i - 1 : i + 1], D[i - 1 : i + 1])
        gradient[rows] += (moduli * (kappa / length - natural[i - 1])) @ dkappa
    return gradient


def kirchhoff_hessian(X, T, D, lengths, moduli, natural, printed=False):  # second sum of (4.34)
    hessian = np.zeros((X.size, X.size), dtype=X.dtype)
    for i in range(1, len(T)):
        length = (lengths[i - 1] + lengths[i]) / 2
        rows = slice(4 * i - 4, 4 * i + 7)
        pair = slice(i - 1, i + 1)
        _, kappa, dkappa, ddkappa = hinge_variations(X[rows], T[pair], D[pair], printed)
        stress = moduli * (kappa / length - natural[i - 1])
        hessian[rows, rows] += dkappa.T @ np.diag(moduli / length) @ dkappa
        hessian[rows, rows] += np.einsum("i,imn->mn", stress, ddkappa)
    return hessian


# ---- appendix A.2 ---------------------------------------------------------------------------------


def transport_first(a, b, db):  # (A.9)
    return (operator(b) - np.outer(b, binormal(a, b)) / 2) @ db


def binormal_variation(a, b, db, printed=False):  # below (A.10)
    denominator = (1 + b) ** 2 if printed else (1 + a @ b) ** 2  # printed: a number plus a vector
    return 2 * np.cross(a, db) / (1 + a @ b) - 2 * np.cross(a, b) / denominator * (a @ db)


def transport_second_once(a, b, d1b, d2b, d12b):  # (A.10)
    k, d2k = binormal(a, b), binormal_variation(a, b, d2b)
    first = (operator(d2b) - (np.outer(d2b, k) + np.outer(b, d2k)) / 2) @ d1b
    return first + (operator(b) - np.outer(b, k) / 2) @ d12b


def transport_second(a, b, d1b, d2b, d12b):  # (A.11)
    k = binormal(a, b)
    middle = (np.outer(k, a) + np.outer(a, k)) / (4 * (1 + a @ b))
    last = (np.outer(d1b, d2b) + np.outer(d2b, d1b)) / 2 @ k / 2
    return (operator(b) - np.outer(b, k) / 2) @ d12b + (d1b @ middle @ d2b) * b - last
