"""Small structures with known answers, for the tests of the core."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from lissome.factorization import (
    ChainKKT,
    ChainLayout,
    DenseKKT,
    SparseKKT,
    TridiagonalKKT,
)
from lissome.structure import BaseStructure, DenseStructure, Evaluation, VectorState

# ---- normal forms ---------------------------------------------------------------------------------


def pitchfork(parameter, imperfection=0.0, start=0.0):
    """Energy x^4/4 - p x^2/2 - q x: branches x = 0 and x = +-sqrt(p) for q = 0."""
    p, q = float(parameter), float(imperfection)
    return DenseStructure(
        initial=[start],
        energy=lambda x: x[0] ** 4 / 4 - p * x[0] ** 2 / 2 - q * x[0],
        gradient=lambda x: x**3 - p * x - q,
        hessian=lambda x: np.diag(3 * x**2 - p),
    )


def hysteresis(load, start=0.0):
    """Energy x^4/4 - x^2/2 - p x: folds at x = -+1/sqrt(3), p = +-2/(3 sqrt(3))."""
    return pitchfork(1.0, load, start)


HYSTERESIS_FOLD = 2 / (3 * np.sqrt(3))


def fold(parameter, start=1.0):
    """Energy x^3/3 - p x: stable at sqrt(p), unstable at -sqrt(p), nothing for p < 0."""
    p = float(parameter)
    return DenseStructure(
        initial=[start],
        energy=lambda x: x[0] ** 3 / 3 - p * x[0],
        gradient=lambda x: x**2 - p,
        hessian=lambda x: np.diag(2 * x),
    )


# ---- von Mises truss ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truss:
    """Two springs of stiffness 1 from (-1, 0) and (1, 0) to an apex under a downward load.

    The apex (x, y) rests at (0, height). By symmetry x = 0 and load = 2 y (L0 / L - 1).
    """

    height: float
    sway: bool = False  # whether the apex may move sideways

    @property
    def rest(self):
        return np.hypot(1.0, self.height)

    def limit_height(self):
        """Height at the limit load, from d(load)/dy = 0: L^3 = L0."""
        return np.sqrt(self.rest ** (2 / 3) - 1)

    def limit_load(self):
        y = self.limit_height()
        return 2 * y * (self.rest / np.hypot(1, y) - 1)

    def sway_height(self):
        """Height at which sideways stiffness vanishes: L^3 = L0 y^2."""
        return brentq(
            lambda y: (1 + y * y) ** 1.5 - self.rest * y * y, self.limit_height(), self.height
        )

    def height_at(self, load):
        """Height of the stable upright equilibrium."""
        return brentq(
            lambda y: 2 * y * (self.rest / np.hypot(1, y) - 1) - load,
            self.limit_height(),
            self.height + 1,
        )

    def inverted_height_at(self, load):
        return brentq(
            lambda y: 2 * y * (self.rest / np.hypot(1, y) - 1) - load,
            -self.height - 5,
            -self.limit_height(),
        )

    def under(self, load, start=None):
        feet = np.array([[-1.0, 0.0], [1.0, 0.0]])
        rest, load = self.rest, float(load)

        def bars(v):
            d = v - feet
            return d, np.hypot(d[:, 0], d[:, 1])

        def energy(v):
            return 0.5 * np.sum((bars(v)[1] - rest) ** 2) + load * v[1]

        def gradient(v):
            d, length = bars(v)
            return ((length - rest) / length) @ d + np.array([0.0, load])

        def hessian(v):
            total = np.zeros((2, 2))
            for d, length in zip(*bars(v), strict=True):
                t = d / length
                total += np.outer(t, t) + (1 - rest / length) * (np.eye(2) - np.outer(t, t))
            return total

        if self.sway:
            first = [0.0, self.height] if start is None else start
            return DenseStructure(first, energy, gradient, hessian)
        apex = np.array([0.0, 1.0])
        return DenseStructure(
            initial=[self.height] if start is None else start,
            energy=lambda y: energy(y[0] * apex),
            gradient=lambda y: gradient(y[0] * apex)[1:],
            hessian=lambda y: hessian(y[0] * apex)[1:, 1:],
        )


# ---- balloons -------------------------------------------------------------------------------------

# Neo-Hookean sphere, U = 2 s^2 + s^-4 with s the stretch; volume s^3; U' = p (s^3)', so that the
# pressure is p = (4/3) (1/s - 1/s^7), which is greatest at s = 7^(1/6).
BALLOON_PEAK = 7 ** (1 / 6)


def balloon_pressure(s):
    return 4 / 3 * (1 / s - 1 / s**7)


def _membrane(s):
    return 2 * s**2 + s**-4, 4 * s - 4 * s**-5, 4 + 20 * s**-6


def _inside(s, ds):
    """Stretches stay positive: at most nine tenths of the way to zero."""
    shrinking = ds < 0
    return float(min(1.0, np.min(0.9 * s[shrinking] / -ds[shrinking], initial=1.0)))


def balloon_under_pressure(pressure, start=1.0):
    p = float(pressure)
    return DenseStructure(
        initial=[start],
        energy=lambda s: _membrane(s[0])[0] - p * s[0] ** 3,
        gradient=lambda s: _membrane(s)[1] - 3 * p * s**2,
        hessian=lambda s: np.diag(_membrane(s)[2] - 6 * p * s),
        step_limit=_inside,
    )


def balloons_sharing(volume, count=2, start=None):
    """Connected balloons that share a volume: the multiplier is minus the pressure."""
    volume = float(volume)
    first = np.full(count, (volume / count) ** (1 / 3)) if start is None else start
    return DenseStructure(
        initial=first,
        energy=lambda s: np.sum(_membrane(s)[0]),
        gradient=lambda s: _membrane(s)[1],
        hessian=lambda s: np.diag(_membrane(s)[2]),
        constraints=lambda s: [np.sum(s**3) - volume],
        jacobian=lambda s: 3 * s[None] ** 2,
        constraint_hessian=lambda s, m: np.diag(6 * m[0] * s),
        step_limit=_inside,
        constraint_names=("volume",),
    )


# ---- barrier --------------------------------------------------------------------------------------


def barrier(force, start=0.0, guarded=True):
    """Energy -log(1 - x^2) - f x on |x| < 1; the minimum is (sqrt(1 + f^2) - 1) / f."""
    f = float(force)

    def fraction(x, dx):
        room = np.where(dx > 0, 1 - x, 1 + x) / np.maximum(np.abs(dx), 1e-300)
        return float(min(1.0, 0.95 * np.min(room)))

    def energy(x):
        inside = 1 - x[0] ** 2
        return -np.log(inside) - f * x[0] if inside > 0 else np.inf

    def gradient(x):
        inside = 1 - x**2
        return 2 * x / np.where(inside == 0, np.nan, inside) - f

    return DenseStructure(
        initial=[start],
        energy=energy,
        gradient=gradient,
        hessian=lambda x: np.diag(2 * (1 + x**2) / (1 - x**2) ** 2),
        step_limit=fraction if guarded else None,
    )


# ---- planar elastica ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Column(BaseStructure):
    """Inextensible column of length and stiffness 1: clamped below, dead load on the free end.

    Unknowns are the angles at nodes 1 ... N (the angle at node 0 is zero); the load is integrated
    by the trapezoidal rule: second order.
    """

    load: float
    segments: int = 40
    tilt: float = 0.0  # direction of the load from the axis
    kind: str = "chain"
    tip_angle: float = 0.0  # of the start

    @property
    def size(self):
        return self.segments

    def weights(self):
        w = np.full(self.segments, 1.0 / self.segments)
        w[-1] /= 2
        return w

    def start(self):
        s = np.arange(1, self.segments + 1) / self.segments
        return VectorState(self.tip_angle * np.sin(np.pi * s / 2))

    def metric(self, state):
        return self.weights()

    def evaluate(self, state, multipliers, order=2):
        n, w, p = self.segments, self.weights(), self.load
        angle = state.x + self.tilt
        bend = np.diff(state.x, prepend=0.0) * n
        energy = 0.5 * np.sum(bend**2) / n - p * np.sum(w * (1 - np.cos(angle)))
        if order == 0:
            return Evaluation(energy, np.zeros(0))
        gradient = bend - np.append(bend[1:], 0.0) - p * w * np.sin(angle)
        if order == 1:
            return Evaluation(energy, np.zeros(0), gradient)
        diagonal = np.full(n, 2.0 * n)
        diagonal[-1] = n
        diagonal -= p * w * np.cos(angle)
        off = np.full(n - 1, -float(n))
        kkt = TridiagonalKKT(diagonal, off)
        if self.kind == "dense":
            kkt = DenseKKT(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
        return Evaluation(energy, np.zeros(0), gradient, kkt)


def column_tip_angle(load):
    """Tip angle of the buckled column: load = K(sin(angle / 2))^2."""
    if load <= np.pi**2 / 4:
        return 0.0
    return 2 * np.arcsin(brentq(lambda k: ellipk(k * k) ** 2 - load, 1e-12, 1 - 1e-12))


@dataclass(frozen=True)
class Strip(BaseStructure):
    """Elastica of length and stiffness 1 between two clamps at a given distance (span).

    Unknowns are the angles at nodes 1 ... N - 1, constraints the closure of the chain.
    """

    span: float
    segments: int = 40
    amplitude: float = 0.5
    mode: int = 1
    kind: str = "chain"

    constraint_names = ("distance", "offset")

    @property
    def size(self):
        return self.segments - 1

    @property
    def constraints_count(self):
        return 2

    def start(self):
        s = np.arange(1, self.segments) / self.segments
        return VectorState(self.amplitude * np.sin(2 * np.pi * self.mode * s))

    def metric(self, state):
        return np.full(self.size, 1.0 / self.segments)

    def evaluate(self, state, multipliers, order=2):
        n, x = self.segments, state.x
        h = 1.0 / n
        bend = np.diff(x, prepend=0.0, append=0.0) * n
        energy = 0.5 * h * np.sum(bend**2)
        # Trapezoidal rule; both ends have angle 0 and weight h / 2.
        constraints = np.array([h * np.sum(np.cos(x)) + h - self.span, h * np.sum(np.sin(x))])
        if order == 0:
            return Evaluation(energy, constraints)
        rows = h * np.array([-np.sin(x), np.cos(x)])
        gradient = bend[:-1] - bend[1:] + multipliers @ rows
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        diagonal = 2.0 * n + h * (-multipliers[0] * np.cos(x) - multipliers[1] * np.sin(x))
        off = np.full(self.size - 1, -float(n))
        if self.kind == "dense":
            hessian = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
            return Evaluation(energy, constraints, gradient, DenseKKT(hessian, rows))
        return Evaluation(energy, constraints, gradient, TridiagonalKKT(diagonal, off, rows))


def strip_exact(span):
    """Compression, and slope at the inflection points, of the buckled strip.

    Four equal quarters: span = 2 E(k) / K(k) - 1, compression = 16 K(k)^2, slope = 2 asin(k).
    """
    k = brentq(lambda k: 2 * ellipe(k * k) / ellipk(k * k) - 1 - span, 1e-9, 1 - 1e-9)
    return 16 * ellipk(k * k) ** 2, 2 * np.arcsin(k)


@dataclass(frozen=True)
class Ring(BaseStructure):
    """A closed elastica of length 1, free in the plane: rotation is neutral.

    Unknowns are the angles at N nodes; the last one closes the ring and sits in the border.
    """

    segments: int = 24
    disturbance: float = 0.0

    @property
    def size(self):
        return self.segments

    @property
    def constraints_count(self):
        return 2

    def _angle(self, x):
        return x + 2 * np.pi * np.arange(self.segments) / self.segments

    def start(self):
        k = np.arange(self.segments)
        return VectorState(self.disturbance * np.sin(3.0 + 1.7 * k + 0.2 * k**2))

    def metric(self, state):
        return np.full(self.size, 1.0 / self.segments)

    def gauge(self, state):
        return np.ones((1, self.size))

    def evaluate(self, state, multipliers, order=2):
        n = self.segments
        h, x = 1.0 / n, state.x
        angle = self._angle(x)
        turn = np.roll(x, -1) - x + 2 * np.pi / n
        energy = 0.5 * n * np.sum(turn**2)
        c, s = np.cos(angle), np.sin(angle)
        constraints = h * np.array([c.sum(), s.sum()])
        if order == 0:
            return Evaluation(energy, constraints)
        rows = h * np.array([-s, c])
        gradient = n * (np.roll(turn, 1) - turn) + multipliers @ rows
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        band = np.zeros((n - 1, 2))
        curved = -h * (multipliers[0] * c + multipliers[1] * s)
        band[:, 0] = 2.0 * n + curved[:-1]
        band[:-1, 1] = -n
        border = np.zeros((3, n - 1))
        border[0, [0, -1]] = -n
        border[1:] = rows[:, :-1]
        corner = np.zeros((3, 3))
        corner[0, 0] = 2.0 * n + curved[-1]
        corner[0, 1:] = corner[1:, 0] = rows[:, -1]
        layout = ChainLayout(n - 1, np.arange(n), np.array([n, n + 1]), 3)
        kkt = ChainKKT(band, border, corner, layout=layout)
        return Evaluation(energy, constraints, gradient, kkt)


# ---- hanging chain --------------------------------------------------------------------------------


@dataclass(frozen=True)
class HangingChain(BaseStructure):
    """Rigid links between two points at the same height: all stiffness comes from the constraints.

    Node i = 0 ... N + 1, unit weights at the free nodes; the ends are at (0, 0) and (span, 0).
    Multipliers (one a link) are interleaved with positions: link i comes before node i + 1.
    """

    span: float
    free: int = 9

    @property
    def links(self):
        return self.free + 1

    @property
    def size(self):
        return 2 * self.free

    @property
    def constraints_count(self):
        return self.links

    @property
    def layout(self):
        step = 3 * np.arange(self.free)
        unknowns = np.stack([step + 1, step + 2], axis=1).ravel()
        return ChainLayout(3 * self.free + 1, unknowns, 3 * np.arange(self.links))

    def start(self):
        x = np.linspace(0, self.span, self.links + 1)[1:-1]
        y = -0.4 * np.sqrt(1 - self.span**2) * np.sin(np.pi * x / self.span)
        return VectorState(np.stack([x, y], axis=1).ravel())

    def nodes(self, state):
        inner = state.x.reshape(-1, 2)
        return np.vstack([[0.0, 0.0], inner, [self.span, 0.0]])

    def evaluate(self, state, multipliers, order=2):
        edges = np.diff(self.nodes(state), axis=0)
        length = 1.0 / self.links
        constraints = 0.5 * (np.sum(edges**2, axis=1) / length - length)
        energy = float(np.sum(state.x[1::2]))
        if order == 0:
            return Evaluation(energy, constraints)
        weight = np.tile([0.0, 1.0], self.free)
        pull = multipliers[:, None] * edges / length
        gradient = weight + (pull[:-1] - pull[1:]).ravel()
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        n = self.free
        band = np.zeros((3 * n + 1, 5))
        m = multipliers / length
        band[1:-1:3, 0] = band[2::3, 0] = m[:-1] + m[1:]
        # Distance 3 along the chain: the same coordinate of the next node.
        band[1:-4:3, 3] = band[2:-4:3, 3] = -m[1:-1]
        e = edges / length
        band[0:-1:3, 1], band[0:-1:3, 2] = e[:-1].T  # link i with its node i + 1
        band[1:-1:3, 2], band[2::3, 1] = -e[1:].T  # node i + 1 with the next link
        return Evaluation(energy, constraints, gradient, ChainKKT(band, layout=self.layout))

    def exact(self):
        """Heights of the nodes: the slopes of the links are in arithmetic progression."""
        k = np.arange(self.links) - (self.links - 1) / 2
        width = lambda a: np.sum(np.cos(np.arctan(a * k))) / self.links - self.span  # noqa: E731
        angle = np.arctan(brentq(width, 1e-9, 1e6) * k)
        return np.cumsum(np.sin(angle))[:-1] / self.links


# ---- plate ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PressedPlate(BaseStructure):
    """Simply supported square plate on a hardening foundation, pressed along x (differences).

    Energy: the integral of (lap w)^2 / 2 - P (dw/dx)^2 / 2 + w^4 / 4. The flat state loses stability
    at the least P = (a_i + a_j)^2 / a_i with a_k = (2 - 2 cos(k pi h)) / h^2.
    """

    load: float
    cells: int = 16

    @property
    def size(self):
        return (self.cells - 1) ** 2

    def start(self):
        return VectorState(np.zeros(self.size))

    def metric(self, state):
        return np.full(self.size, 1.0 / self.cells**2)

    def _operators(self):
        n, h = self.cells - 1, 1.0 / self.cells
        line = sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)) / h**2
        eye = sparse.eye_array(n)
        along = sparse.kron(line, eye).tocsc()
        both = along + sparse.kron(eye, line)
        return h**2 * (both @ both - self.load * along)

    def evaluate(self, state, multipliers, order=2):
        w, area, linear = state.x, 1.0 / self.cells**2, self._operators()
        force = linear @ w
        energy = 0.5 * w @ force + area * np.sum(w**4) / 4
        if order == 0:
            return Evaluation(energy, np.zeros(0))
        gradient = force + area * w**3
        if order == 1:
            return Evaluation(energy, np.zeros(0), gradient)
        kkt = SparseKKT(linear + sparse.diags_array(3 * area * w**2))
        return Evaluation(energy, np.zeros(0), gradient, kkt)

    def flat_eigenvalues(self):
        """All eigenvalues of the flat state, ascending."""
        a = (2 - 2 * np.cos(np.arange(1, self.cells) * np.pi / self.cells)) * self.cells**2
        return np.sort(((a[:, None] + a) ** 2 - self.load * a[:, None]).ravel())

    def critical_load(self):
        a = (2 - 2 * np.cos(np.arange(1, self.cells) * np.pi / self.cells)) * self.cells**2
        return np.min((a[:, None] + a) ** 2 / a[:, None])


# ---- random ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RandomFamily:
    """Three unknowns, one linear constraint, a coercive energy, loads that grow with p."""

    seed: int

    def parts(self):
        generator = np.random.default_rng(self.seed)
        a, b = generator.normal(size=(2, 3, 3))
        return a + a.T, b + b.T, generator.normal(size=3), generator.normal(size=(1, 3))

    def __call__(self, p):
        a, b, force, row = self.parts()
        matrix = a - p * b
        return DenseStructure(
            initial=np.zeros(3),
            energy=lambda x: (x @ x) ** 2 / 4 + x @ matrix @ x / 2 - p * force @ x,
            gradient=lambda x: (x @ x) * x + matrix @ x - p * force,
            hessian=lambda x: 2 * np.outer(x, x) + (x @ x) * np.eye(3) + matrix,
            constraints=lambda x: row @ x - 0.1,
            jacobian=lambda x: row,
            check=False,
        )

    def index(self, p, x):
        a, b, _, row = self.parts()
        free = np.linalg.svd(row)[2][1:]
        hessian = 2 * np.outer(x, x) + (x @ x) * np.eye(3) + a - p * b
        return int(np.sum(np.linalg.eigvalsh(free @ hessian @ free.T) < 0))
