"""Ribbons against general optimizers on the same discrete Möbius band, and what a band costs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import NonlinearConstraint, minimize

import lissome as ls
from lissome import ribbons

WIDTHS = [k / math.pi for k in (0.1, 0.2, 0.5, 0.8, 1.0, 1.5)]


def band(width, segments=150):
    return ribbons.band(1.0, segments, ribbons.Wunderlich(width=width, rigidity=1.0 / width))


# -- through the widths -----------------------------------------------------------------------------


def through_all_widths():
    """From a circle, turn the end by half a turn, join it, and go through the six widths."""
    found = ls.equilibrate(band(WIDTHS[0]))
    for width in WIDTHS[1:]:
        found = ls.equilibrate(band(width), start=found)
    return found


def bench_from_a_circle_through_six_widths(benchmark, measure):
    measure("circle, twisted band, six widths", group="Möbius band, N = 150", within=5.0)
    found = benchmark.pedantic(through_all_widths, rounds=3, warmup_rounds=1)
    assert found.energy == pytest.approx(173.79, abs=0.1)


def bench_a_warm_change_of_width(benchmark, measure):
    measure("warm change of width", group="Möbius band, N = 150", within=0.3)
    start = ls.equilibrate(band(WIDTHS[1]))
    wider = start.structure.with_width(WIDTHS[2])
    benchmark(ls.equilibrate, wider, start=start)


# -- cost against the number of segments --------------------------------------------------------------


@pytest.fixture(scope="module")
def coarse():
    return ls.equilibrate(band(0.2))


@pytest.mark.parametrize("segments", [100, 200, 500, 1000, 2500, 5000])
def bench_one_iteration(benchmark, measure, coarse, segments):
    """One Newton iteration at the equilibrium: evaluate, factor, solve."""
    against = None if segments <= 1000 else "one iteration, N = 1000"
    measure(
        f"one iteration, N = {segments}", group="cost of an iteration", against=against,
        at_most=None if against is None else 2.0 * segments / 1000,
        note="linear cost: the ratio of the segments, with room for swings",
    )  # fmt: skip
    ribbon = band(0.2, segments)
    found = ls.equilibrate(ribbon, start=ribbon.adapted(coarse))
    metric = ribbon.metric(found.state)

    def iteration():
        here = ribbon.evaluate(found.state, found.multipliers, 2)
        factor = here.kkt.factorize(0.0, ribbon.gauge(found.state), metric)
        return factor.solve(-here.gradient, -here.constraints)

    iteration()
    benchmark.pedantic(iteration, rounds=10)


# -- general optimizers -----------------------------------------------------------------------------

SEGMENTS = 150
OURS = "lissome"
GROUP = "Möbius band, N = 150, from width 0.2/pi to 0.5/pi"


def product(p, q):
    import casadi

    s, v, t, w = p[0], p[1:], q[0], q[1:]
    return casadi.vertcat(s * t - casadi.dot(v, w), s * w + t * v + casadi.cross(v, w))


def conjugated(q):
    import casadi

    return casadi.vertcat(q[0], -q[1:])


def written_out(start, width):
    """Return the same problem as symbols: quaternions, rulings and folds, and where they start."""
    import casadi

    n, span = SEGMENTS, 1.0 / SEGMENTS
    frames = np.array(start.state.quaternions)
    for j in range(1, n):  # neighbors with the same sign
        frames[j] *= np.sign(frames[j - 1] @ frames[j])
    first = casadi.DM(frames[0])
    free = casadi.SX.sym("q", 4, n - 1)
    rulings = casadi.SX.sym("eta", n - 1)
    folds = casadi.SX.sym("a", n)
    q = [first, *(free[:, j] for j in range(n - 1))]
    eta = [0, *(rulings[j] for j in range(n - 1)), 0]
    half_turn = casadi.DM([0.0, 0.0, 0.0, 1.0])
    energy, rows = 0, []
    for i in range(n):
        if i < n - 1:
            hinge = product(conjugated(q[i]), q[i + 1])
        else:
            last = product(conjugated(q[i]), q[0])
            sign = 1.0
            value = casadi.Function("h", [free], [product(last, half_turn)[0]])(frames[1:].T)
            sign = 1.0 if float(value) > 0 else -1.0
            hinge = sign * product(last, half_turn)
        kappa = 2 * hinge[1:]
        mean = 0.5 * (eta[i] + eta[i + 1])
        slope = (eta[i + 1] - eta[i]) / span
        a = folds[i]
        energy += 0.5 / span * kappa[0] ** 2 * (1 + mean**2) ** 2 * a / casadi.tanh(a)
        rows += [kappa[1], kappa[2] - mean * kappa[0], 0.5 * width * slope - casadi.tanh(a)]
    closed = 0
    for p in q:
        s, v = p[0], p[1:]
        closed += casadi.vertcat(
            2 * (v[0] * v[2] + s * v[1]),
            2 * (v[1] * v[2] - s * v[0]),
            1 - 2 * (v[0] ** 2 + v[1] ** 2),
        )
    rows.append(span * closed)
    rows += [casadi.dot(free[:, j], free[:, j]) - 1 for j in range(n - 1)]
    x = casadi.vertcat(casadi.reshape(free, -1, 1), rulings, folds)
    x0 = np.concatenate([frames[1:].ravel(), start.state.rulings[1:], start.state.folds])
    return x, energy, casadi.vertcat(*rows), x0


@pytest.fixture(scope="module")
def task():
    start = ls.equilibrate(band(WIDTHS[1], SEGMENTS))
    ribbon = band(WIDTHS[2], SEGMENTS)
    return start, ribbon, ls.equilibrate(ribbon, start=start).energy


def bench_lissome(benchmark, measure, task):
    measure(OURS, group=GROUP)
    start, ribbon, energy = task
    found = benchmark(ls.equilibrate, ribbon, start=start)
    assert found.energy == pytest.approx(energy, rel=1e-12)


def bench_ipopt(benchmark, measure, task):
    casadi = pytest.importorskip("casadi")
    measure("Ipopt (CasADi), exact derivatives", group=GROUP, against=OURS)
    start, _, energy = task
    x, f, g, x0 = written_out(start, WIDTHS[2])
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    solver = casadi.nlpsol("solver", "ipopt", {"x": x, "f": f, "g": g}, options)
    found = benchmark.pedantic(lambda: solver(x0=x0, lbg=0, ubg=0), rounds=3)
    assert float(found["f"]) == pytest.approx(energy, rel=1e-7)


def bench_trust_constr(benchmark, measure, task):
    casadi = pytest.importorskip("casadi")
    measure("SciPy trust-constr, exact derivatives", group=GROUP, against=OURS)
    start, _, energy = task
    x, f, g, x0 = written_out(start, WIDTHS[2])
    weights = casadi.SX.sym("w", g.shape[0])
    functions = {
        "f": casadi.Function("f", [x], [f]),
        "df": casadi.Function("df", [x], [casadi.gradient(f, x)]),
        "ddf": casadi.Function("ddf", [x], [casadi.hessian(f, x)[0]]),
        "g": casadi.Function("g", [x], [g]),
        "dg": casadi.Function("dg", [x], [casadi.jacobian(g, x)]),
        "ddg": casadi.Function("ddg", [x, weights], [casadi.hessian(casadi.dot(weights, g), x)[0]]),
    }

    def dense(name, *args):
        return np.array(functions[name](*args)).ravel()

    def matrix(name, *args):
        return sparse.csc_matrix(functions[name](*args).sparse())

    held = NonlinearConstraint(
        lambda y: dense("g", y), 0.0, 0.0, jac=lambda y: matrix("dg", y),
        hess=lambda y, v: matrix("ddg", y, v),
    )  # fmt: skip

    def solve():
        return minimize(
            lambda y: float(functions["f"](y)), x0, jac=lambda y: dense("df", y),
            hess=lambda y: matrix("ddf", y), constraints=[held], method="trust-constr",
            options={"maxiter": 400, "initial_tr_radius": 0.1, "gtol": 1e-7},
        )  # fmt: skip

    found = benchmark.pedantic(solve, rounds=1)
    benchmark.extra_info["note"] = (
        f"{found.nit} iterations; energy off by {abs(found.fun / energy - 1):.1e}, "
        f"constraints by {found.constr_violation:.1e}"
    )
