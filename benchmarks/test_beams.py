"""A time step of the photomechanical strip against LAPACK's band solve and a general optimizer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg.lapack import dgtsv
from scipy.optimize import minimize

from lissome.beams import ClampedStrip, ParallelLight, flapping
from lissome.beams import _kernel as kernel
from lissome.beams._motion import SCHEMES, Runner

STEPS = 100
STEP = 0.005
FEW = 20
LIGHT = ParallelLight(10.0, angle=math.pi / 4)
FLOOR = f"{STEPS} solves by LAPACK dgtsv, 3 right-hand sides"


class Strip:
    """A strip at t = 0.1 that can be set back and advanced by equal steps."""

    def __init__(self, segments: int, scheme: str) -> None:
        self.runner = Runner(ClampedStrip(0.95, segments), LIGHT, SCHEMES[scheme], STEP)
        self.table = np.zeros((1, kernel.SCALARS + 2 * segments + 3))
        self.runner.begin()
        self.runner.advance(0.1, 0, self.table)
        self.saved = [a.copy() for a in self.arrays]

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        r = self.runner
        return (r.clock, r.angles, r.curvature, r.multipliers)

    def back(self) -> None:
        for array, saved in zip(self.arrays, self.saved, strict=True):
            array[:] = saved

    def advance(self, steps: int) -> None:
        self.runner.advance(0.1 + steps * STEP, 0, self.table)

    def steps_taken(self) -> float:
        return self.runner.clock[kernel.STEPS] - self.saved[0][kernel.STEPS]


def band(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.full(n - 1, -1.0), np.full(n, 2.5), np.asfortranarray(np.ones((n, 3)))


def solve_often(n: int) -> None:
    off, diagonal, right = band(n)
    for _ in range(STEPS):
        dgtsv(off, diagonal, off, right)


@pytest.mark.parametrize("segments", [100, 1000, 10000])
def test_floor(benchmark, measure, segments):
    measure(FLOOR, group=f"time steps of a strip, N = {segments}")
    benchmark.pedantic(solve_often, (segments,), rounds=max(5, 30000 // segments), warmup_rounds=1)


@pytest.mark.parametrize("segments", [100, 1000, 10000])
@pytest.mark.parametrize(("scheme", "bound"), [("exponential-1", 5.0), ("exponential-2", 10.0)])
def test_steps(benchmark, measure, segments, scheme, bound):
    measure(
        f"{STEPS} steps, {scheme}",
        group=f"time steps of a strip, N = {segments}",
        against=FLOOR,
        at_most=bound,
        note="equilibrium, inertia, light and natural curvature; the same ratio at every N: linear",
    )
    strip = Strip(segments, scheme)
    benchmark.pedantic(
        strip.advance,
        (STEPS,),
        setup=strip.back,
        rounds=max(5, 30000 // segments),
        warmup_rounds=1,
    )
    assert strip.steps_taken() == STEPS


def test_steps_by_slsqp(benchmark, measure):
    """From an old shape to equilibrium under the new curvature, with gradients, again and again."""
    segments = 100
    strip = Strip(segments, "exponential-1")
    old = strip.runner.angles[1:-1].copy()
    strip.advance(1)
    new = strip.runner.angles[1:-1].copy()
    curvature = strip.runner.curvature.copy()
    h = 1.0 / segments

    def moment(x):
        return np.diff(np.concatenate([[0.0], x, [0.0]])) / h - curvature

    def closure(x):
        return np.array([h * (1.0 + np.cos(x).sum()) - 0.95, h * np.sin(x).sum()])

    def step():
        result = minimize(
            lambda x: 0.5 * h * np.sum(moment(x) ** 2),
            old,
            jac=lambda x: -np.diff(moment(x)),
            method="SLSQP",
            constraints={
                "type": "eq",
                "fun": closure,
                "jac": lambda x: h * np.stack([-np.sin(x), np.cos(x)]),
            },
            options={"ftol": 1e-12, "maxiter": 200},
        )
        return result.x

    def steps():
        return [step() for _ in range(FEW)][-1]

    measure(
        f"{FEW} steps by SLSQP with gradients",
        group=f"{FEW} time steps of a strip, N = 100",
        note="scipy.optimize.minimize from the old shape, ftol 1e-12; the same step every time",
    )
    found = benchmark.pedantic(steps, rounds=3)
    assert np.abs(found - new).max() < 1e-3


def test_few_steps(benchmark, measure):
    measure(
        f"{FEW} steps, exponential-1",
        group=f"{FEW} time steps of a strip, N = 100",
        against=f"{FEW} steps by SLSQP with gradients",
        at_least=1000.0,
    )
    strip = Strip(100, "exponential-1")
    benchmark.pedantic(strip.advance, (FEW,), setup=strip.back, rounds=300, warmup_rounds=3)


def test_a_point_of_the_phase_diagram(benchmark, measure):
    measure("one point: does it flap, how fast", group="phase diagram of a strip, N = 100")
    strip = ClampedStrip(0.95, 100)
    benchmark.pedantic(flapping, (strip, LIGHT), rounds=10, warmup_rounds=1)
