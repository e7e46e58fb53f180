"""Compiled kernels of the photomechanical elastica: energy, light, rolling contact, time loop.

One chain serves strips and rings.  It has M angles and M - 1 springs of length ``spacing``
between them; the spontaneous curvature lives on the springs.  Angles carry quadrature weights
for the closure integrals: ``spacing`` inside, and at the two ends

* ``spacing / 2`` (trapezoid: the ends of the chain are the clamps, second order), or
* ``spacing`` (the angles are those of rigid segments, of which the first and the last are frozen:
  the scheme of the thesis's appendix A.1, first order).

A ring is a chain whose last angle is the first plus a turn, and whose end-to-end vector is zero.
Its overall rotation is neutral: the first angle is pinned, which takes nothing from the set of
shapes, and the rotation follows from rolling.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lissome._tridiagonal import (
    CONVERGED,
    DIAGONAL,
    GRADIENT,
    OFF_DIAGONAL,
    chain_work,
    jit,
    make_solvers,
    newton_step,
    smallest_eigenpair,
)

__all__ = [
    "DONE",
    "ENCLOSED",
    "FAILED",
    "FULL",
    "Chain",
    "Lamp",
    "Options",
    "Space",
    "chain_work",
    "correct",
    "descend",
    "eigenvalues_of",
    "evaluate",
    "illuminate",
    "look_at_lamp",
    "march",
    "roll",
    "smallest_eigenpair",
    "space_for",
]

DONE, ENCLOSED, FULL, FAILED = range(4)

EXPLICIT_EULER = 0
EXPONENTIAL_1 = 1
EXPONENTIAL_2 = 2

# Entries of the mutable record `clock`.
TIME, TRIAL, ENERGY, RESIDUAL, STEPS, REJECTED = range(6)
CONTACT, COS, SIN, SHIFT_X, SHIFT_Y = range(6, 11)
CLOCK_SIZE = 11
# Columns of a recorded row: time, energy, contact and pose; then multipliers, angles, curvature.
SCALARS = 7

# Of a step beside the longest one, where the light bends: a contact that jumps would stop the clock.
SHORTEST = 0.02
# Longest step times the rate at which light and shape restore each other; beyond 2 it is unstable.
STIFF = 1.0

# Rows of `Space.nodes` and `Space.springs`.
SINE, COSINE, OLD_ANGLES, X, Y, LEAN, ANGLE, PREDICTED, CORRECTION = range(9)
NODE_ROWS = 9
TARGET, TARGET_NEXT, NEW, OLD, SLOPE, BEFORE = range(6)
SPRING_ROWS = 6


class Chain(NamedTuple):
    """Discrete elastica: spacing, end weights, end-to-end vector, range of the unknown angles."""

    spacing: float
    weight_start: float
    weight_end: float
    chord_x: float
    chord_y: float
    first: int
    last: int
    ring: bool


class Lamp(NamedTuple):
    """Steady light as the kernels see it.

    ``gain`` is intensity times response times face; (``toward_x``, ``toward_y``) the unit vector
    to the source; ``face`` +1 (the face to the left of the tangent is lit) or -1; ``width`` 0 for
    uniform light, else that of a Gaussian beam whose axis passes through (``center``, 0).
    """

    gain: float
    toward_x: float
    toward_y: float
    face: float
    center: float
    width: float


class Options(NamedTuple):
    """Of the time loop. ``turn``: the largest change of an angle in a step."""

    until: float
    step: float
    scheme: int
    bending: float
    tolerance: float
    resolution: float
    hold: float
    turn: float
    record_every: int


class Space(NamedTuple):
    """Scratch arrays of the time loop.

    ``nodes`` (9, M): sines, cosines, old angles, positions, lean, angles, first guess at the new time
    and how far it was off. ``springs`` (6, M - 1): what the light asks for now and at the end of the
    step, new and old curvature, the rate of what the light asks for, and what it asked for before the
    last stage. ``masses`` and ``mode`` (n,). ``saved``: clock and multipliers at the start of the
    step.
    """

    nodes: np.ndarray
    springs: np.ndarray
    masses: np.ndarray
    mode: np.ndarray
    saved: np.ndarray


def space_for(chain: Chain, size: int) -> Space:
    """Allocate the scratch arrays for a chain of ``size`` angles."""
    weights = np.full(size, chain.spacing)
    weights[0], weights[-1] = chain.weight_start, chain.weight_end
    masses = weights[chain.first : chain.last].copy()
    return Space(
        np.zeros((NODE_ROWS, size)),
        np.zeros((SPRING_ROWS, size - 1)),
        masses,
        np.zeros(masses.size),
        np.zeros(CLOCK_SIZE + 2),
    )


@jit
def evaluate(data, x, multipliers, work):
    r"""Derivatives of the Lagrangian of the elastica; returns the bending energy.

    .. math:: E = \sum_j \tfrac{h}{2}\Big(\frac{\theta_{j+1} - \theta_j}{h} - K_{0,j}\Big)^2,\qquad
              c = \sum_j w_j (\cos\theta_j, \sin\theta_j) - d .

    ``data`` is (chain, angles, curvature, trigonometry); ``x`` is a view of the unknown angles.
    Sines and cosines are left in ``data`` for the light.
    """
    chain, angles, curvature, trig = data
    band = work.band
    rows = work.rows
    size = angles.size
    h = chain.spacing
    inverse = 1.0 / h
    first = chain.first
    last = chain.last
    fx = multipliers[0]
    fy = multipliers[1]
    for j in range(size):
        trig[SINE, j] = math.sin(angles[j])
        trig[COSINE, j] = math.cos(angles[j])
    cx = (
        chain.weight_start * trig[COSINE, 0]
        + chain.weight_end * trig[COSINE, size - 1]
        - chain.chord_x
    )
    cy = (
        chain.weight_start * trig[SINE, 0] + chain.weight_end * trig[SINE, size - 1] - chain.chord_y
    )
    sum_c = 0.0
    sum_s = 0.0
    for j in range(1, size - 1):
        sum_c += trig[COSINE, j]
        sum_s += trig[SINE, j]
    work.constraints[0] = cx + h * sum_c
    work.constraints[1] = cy + h * sum_s
    energy = 0.0
    left = 0.0
    for j in range(size):
        right = 0.0
        if j < size - 1:
            right = (angles[j + 1] - angles[j]) * inverse - curvature[j]
        energy += right * right
        if first <= j < last:
            w = h
            stiffness = 2.0 * inverse
            if j == 0:
                w = chain.weight_start
                stiffness = inverse
            elif j == size - 1:
                w = chain.weight_end
                stiffness = inverse
            i = j - first
            s = w * trig[SINE, j]
            c = w * trig[COSINE, j]
            band[GRADIENT, i] = left - right - fx * s + fy * c
            band[DIAGONAL, i] = stiffness - fx * c - fy * s
            rows[0, i] = -s
            rows[1, i] = c
            if j < last - 1:
                band[OFF_DIAGONAL, i] = -inverse
        left = right
    return 0.5 * h * energy


correct, descend = make_solvers(evaluate)


@jit
def _mean_flux(a, b, nodes, j, change):
    """Mean of the positive part of a cos + b sin between the angles j and j + 1, ``change`` apart.

    The angle is taken as linear in between, so that the terminator crosses a spring without a jump;
    (a, b) is a unit vector.
    """
    here = a * nodes[COSINE, j] + b * nodes[SINE, j]
    there = a * nodes[COSINE, j + 1] + b * nodes[SINE, j + 1]
    if here > 0.0 and there > 0.0:
        # (sin x2 - sin x1) / (x2 - x1) = mean of the cosines times tan(d) / d
        d = 0.5 * change
        if abs(d) < 0.1:
            q = d * d
            ratio = 1.0 + q * (
                1.0 / 3.0
                + q
                * (2.0 / 15.0 + q * (17.0 / 315.0 + q * (62.0 / 2835.0 + q * 1382.0 / 155925.0)))
            )
        else:
            ratio = math.tan(d) / d
        return 0.5 * (here + there) * ratio
    if here <= 0.0 and there <= 0.0:
        return 0.0
    # The integral of a cos + b sin is +-1 at the terminator.
    edge = 1.0 if change > 0.0 else -1.0
    if here > 0.0:
        return (edge - (a * nodes[SINE, j] - b * nodes[COSINE, j])) / change
    return (a * nodes[SINE, j + 1] - b * nodes[COSINE, j + 1] + edge) / change


@jit
def illuminate(lamp, chain, angles, pose, natural, nodes, springs):
    r"""Write the curvature that each spring relaxes to: :math:`K_r + \Lambda f`.

    The flux on a face is the positive part of the cosine between its normal and the direction of
    the source (3.11), averaged over the spring.  ``pose`` holds cosine and sine of the rigid rotation
    and the translation that take the chain to the laboratory; the result goes to
    ``springs[TARGET_NEXT]``.
    """
    size = nodes.shape[1]
    turn_c = pose[COS]
    turn_s = pose[SIN]
    # face * (toward . normal) as a combination of the cosine and sine of the angle in the chain.
    a = lamp.face * (lamp.toward_y * turn_c - lamp.toward_x * turn_s)
    b = -lamp.face * (lamp.toward_x * turn_c + lamp.toward_y * turn_s)
    h = chain.spacing
    px = chain.weight_start * nodes[COSINE, 0]
    py = chain.weight_start * nodes[SINE, 0]
    scale = -0.5 / (lamp.width * lamp.width) if lamp.width > 0.0 else 0.0
    for j in range(size - 1):
        flux = _mean_flux(a, b, nodes, j, angles[j + 1] - angles[j])
        if scale < 0.0:
            if j > 0:
                px += h * nodes[COSINE, j]
                py += h * nodes[SINE, j]
            if flux > 0.0:
                lab_x = turn_c * px - turn_s * py + pose[SHIFT_X]
                lab_y = turn_s * px + turn_c * py + pose[SHIFT_Y]
                # Distance from the axis of the beam.
                r = (lab_x - lamp.center) * lamp.toward_y - lab_y * lamp.toward_x
                flux *= math.exp(scale * r * r)
        springs[TARGET_NEXT, j] = natural[j] + lamp.gain * flux


@jit
def _interpolate(nodes, cell, fraction, turn):
    """Sixth-order interpolation of a ring between nodes ``cell`` and ``cell + 1``.

    Returns lean, angle (which grows by ``turn`` per turn), and position.
    """
    n = nodes.shape[1] - 1
    lean = 0.0
    angle = 0.0
    x = 0.0
    y = 0.0
    for p in range(-2, 4):
        weight = 1.0
        for q in range(-2, 4):
            if q != p:
                weight *= (fraction - q) / (p - q)
        turns = math.floor((cell + p) / n)
        index = cell + p - turns * n
        lean += weight * nodes[LEAN, index]
        angle += weight * (nodes[ANGLE, index] + turn * turns)
        x += weight * nodes[X, index]
        y += weight * nodes[Y, index]
    return lean, angle, x, y


@jit
def roll(clock, free, chain, angles, nodes):
    """Move the contact of a ring downhill to where its center of mass is lowest, and set the pose.

    With contact at S the center of mass is ``lean`` = (x_m - x(S)) . t(S) ahead of it and
    the derivative of its height along S is - K lean, so that a stable contact is a root
    where ``lean`` falls (3.17, 3.18).  Nodal values are interpolated to sixth order, which makes
    the root a continuous function of the shape.  ``clock[CONTACT]`` is the unwrapped arc
    length; it is kept if not ``free``, and while the ring is round to rounding errors (then no
    contact is preferred).
    """
    n = angles.size - 1
    h = chain.spacing
    turn = angles[n] - angles[0]
    nodes[X, 0] = 0.0
    nodes[Y, 0] = 0.0
    nodes[LEAN, n] = 0.0
    nodes[ANGLE, n] = angles[n]
    mean_x = 0.0
    mean_y = 0.0
    for j in range(n):
        nodes[X, j + 1] = nodes[X, j] + 0.5 * h * (nodes[COSINE, j] + nodes[COSINE, j + 1])
        nodes[Y, j + 1] = nodes[Y, j] + 0.5 * h * (nodes[SINE, j] + nodes[SINE, j + 1])
        mean_x += nodes[X, j]
        mean_y += nodes[Y, j]
    mean_x /= n
    mean_y /= n
    largest = 0.0
    for j in range(n):
        nodes[ANGLE, j] = angles[j]
        nodes[LEAN, j] = (mean_x - nodes[X, j]) * nodes[COSINE, j] + (mean_y - nodes[Y, j]) * nodes[
            SINE, j
        ]
        largest = max(largest, abs(nodes[LEAN, j]))
    position = clock[CONTACT] / h
    cell = math.floor(position)
    if free and largest > 1e-14 * n:
        # Downhill: forward if the center of mass lies ahead, to the end of a cell that holds the root.
        value, _, _, _ = _interpolate(nodes, cell, position - cell, turn)
        sign = 1.0 if value >= 0.0 else -1.0
        k = cell + 1 if sign > 0.0 else cell
        for _ in range(n + 1):
            if sign * nodes[LEAN, k - math.floor(k / n) * n] <= 0.0:
                break
            k += 1 if sign > 0.0 else -1
        cell = k - 1 if sign > 0.0 else k
        low = max(position, float(cell)) if sign > 0.0 else float(cell)
        high = float(cell + 1) if sign > 0.0 else min(position, float(cell + 1))
        f_low = 0.0
        f_high = 0.0
        side = 0
        position = low
        for trial in range(60):  # regula falsi, Illinois: `lean` is positive at low
            if trial == 1:
                position = high
            elif trial > 1:
                if f_low == f_high or high - low <= 1e-13 * n:
                    break
                position = (low * f_high - high * f_low) / (f_high - f_low)
            value, _, _, _ = _interpolate(nodes, cell, position - cell, turn)
            if trial > 1 and abs(value) <= 1e-15 * largest:
                break
            if trial == 0 or (trial > 1 and value > 0.0):
                if side == 1:
                    f_high *= 0.5
                side = 1 if trial > 1 else 0
                low = position
                f_low = value
            else:
                if side == -1:
                    f_low *= 0.5
                side = -1 if trial > 1 else 0
                high = position
                f_high = value
        clock[CONTACT] = position * h
        cell = math.floor(position)
    _, angle, px, py = _interpolate(nodes, cell, position - cell, turn)
    clock[COS] = math.cos(angle)
    clock[SIN] = -math.sin(angle)
    clock[SHIFT_X] = clock[CONTACT] - (clock[COS] * px - clock[SIN] * py)
    clock[SHIFT_Y] = -(clock[SIN] * px + clock[COS] * py)


@jit
def march(
    clock, angles, curvature, multipliers, natural, chain, lamp, look, options, work, space, table
):
    """Advance curvature and equilibrium in time until something happens.

    The state (``clock``, ``angles``, ``curvature``, ``multipliers``) must be a stable equilibrium;
    it is updated in place and is one on return.  ``look`` is `look_at_lamp` or a function with its
    signature (the uncompiled ``march.py_func`` takes Python functions).

    Every accepted step ends at an equilibrium with as many negative pivots as constraints.  A
    step that does not is halved, until the time at which the stable equilibrium is lost is
    enclosed so tightly that the natural curvature changes by no more than ``options.resolution``
    (a loss cannot be located better than the equilibrium equations are solved).

    Steps are shortened where what the light asks for bends in time: in the mean over the springs
    its second derivative, times the square of the step, may not exceed ``options.bending`` times
    the square of ``options.step`` times its mean distance from the natural curvature.  In the
    square-root approach to a fold the error would else be of order 3/2 in the step.

    They are also shortened where the light opposes what the natural curvature does to the shape, so
    strongly that a long step overshoots: near a fold a soft shape answers to small changes of
    curvature, and equilibrium under light is approached at a rate that grows without bound. The rate
    is the Rayleigh quotient of the change of what the light asks for over a stage.

    Returns
    -------
    reason : int
        DONE, ENCLOSED (a step that cannot be made), FULL (the table) or FAILED (no stable equilibrium
        at the start).
    rows : int
        Rows of the table that were written.
    """
    m = multipliers.size
    x = angles[chain.first : chain.last]
    data = (chain, angles, curvature, space.nodes)
    nodes = space.nodes
    springs = space.springs
    saved = space.saved
    capacity = table.shape[0]
    stages = 2 if options.scheme == EXPONENTIAL_2 else 1
    rows = 0
    since = 0
    failed_at = np.inf
    last_dt = 0.0
    begun = False
    stale = True  # the factors in `work` do not belong to the current state
    raised = 0.0
    stiffness = 0.0
    reach = 2.0 * options.turn  # of a correction
    if clock[TRIAL] <= 0.0:
        clock[TRIAL] = options.step
    while True:
        if stale:
            status, _, _, _, raised, _, negative, zero, _ = correct(
                x,
                multipliers,
                data,
                np.inf if begun else options.tolerance,
                12.0,
                reach,
                work,
            )
            if status != CONVERGED or negative != m or zero != 0:
                return FAILED, rows
            if not begun:
                look(clock, clock[TIME] >= options.hold, natural, chain, lamp, angles, space)
                for j in range(curvature.size):
                    springs[TARGET, j] = springs[TARGET_NEXT, j]
                begun = True
            stale = False
        remaining = options.until - clock[TIME]
        if remaining <= 1e-13 * max(1.0, abs(options.until)):
            return DONE, rows
        dt = min(clock[TRIAL], remaining)
        if clock[TIME] < options.hold < clock[TIME] + dt:
            dt = options.hold - clock[TIME]
        if remaining - dt <= 1e-6 * dt:
            dt = remaining
        new_time = options.until if dt == remaining else clock[TIME] + dt
        for j in range(angles.size):
            nodes[OLD_ANGLES, j] = angles[j]
        for j in range(curvature.size):
            springs[OLD, j] = curvature[j]
        for j in range(clock.size):
            saved[j] = clock[j]
        for j in range(m):
            saved[clock.size + j] = multipliers[j]
        a = dt if options.scheme == EXPLICIT_EULER else -math.expm1(-dt)
        good = True
        energy = 0.0
        residual = 0.0
        for stage in range(stages):
            if stage == 0:
                for j in range(curvature.size):
                    springs[NEW, j] = curvature[j] + a * (springs[TARGET, j] - curvature[j])
            else:
                b = 1.0 - a / dt  # exact for a target that is linear in time
                for j in range(curvature.size):
                    springs[NEW, j] = curvature[j] + b * (
                        springs[TARGET_NEXT, j] - springs[TARGET, j]
                    )
            # The residual is affine in the curvature: the first step, with the old factors, needs
            # no evaluation.
            for j in range(curvature.size):
                change = springs[NEW, j] - curvature[j]
                curvature[j] = springs[NEW, j]
                if chain.first <= j < chain.last:
                    work.band[GRADIENT, j - chain.first] += change
                if chain.first <= j + 1 < chain.last:
                    work.band[GRADIENT, j + 1 - chain.first] -= change
            newton_step(work, raised, x, multipliers)
            if stage == 0:
                # What this guess missed in the last step, it will miss again, as the step squared.
                again = (dt / last_dt) ** 2 if last_dt > 0.0 else 0.0
                for j in range(angles.size):
                    nodes[PREDICTED, j] = angles[j]
                for j in range(chain.first, chain.last):
                    angles[j] += again * nodes[CORRECTION, j]
            status, _, energy, residual, raised, _, negative, zero, _ = correct(
                x, multipliers, data, options.tolerance, 12.0, reach, work
            )
            if stage == 0:
                for j in range(angles.size):
                    nodes[PREDICTED, j] = angles[j] - nodes[PREDICTED, j]
            good = status == CONVERGED and negative == m and zero == 0
            if not good:
                break
            for j in range(curvature.size):
                springs[BEFORE, j] = springs[TARGET if stage == 0 else TARGET_NEXT, j]
            # Contact and light at the new time, from the contact at the old one.
            clock[CONTACT] = saved[CONTACT]
            clock[TIME] = new_time
            look(
                clock,
                new_time > options.hold * (1.0 + 1e-12),
                natural,
                chain,
                lamp,
                angles,
                space,
            )
        turned = 0.0
        for j in range(angles.size):
            turned = max(turned, abs(angles[j] - nodes[OLD_ANGLES, j]))
        due = False
        if good and turned <= options.turn:
            clock[ENERGY] = energy
            clock[RESIDUAL] = residual
            clock[STEPS] += 1.0
            for j in range(angles.size):
                nodes[CORRECTION, j] = nodes[PREDICTED, j]
            change = 0.0
            size = 0.0
            along = 0.0
            moved = 0.0
            for j in range(curvature.size):
                # What the last stage did to the curvature, and what the light answers to it.
                move = curvature[j] - springs[OLD, j]
                if stages == 2:
                    move = springs[BEFORE, j] - springs[TARGET, j]  # times 1 - a / dt
                moved += move * move
                along += move * (springs[TARGET_NEXT, j] - springs[BEFORE, j])
                slope = (springs[TARGET_NEXT, j] - springs[TARGET, j]) / dt
                change += abs(slope - springs[SLOPE, j])
                size += abs(springs[TARGET_NEXT, j] - natural[j])
                springs[SLOPE, j] = slope
                springs[TARGET, j] = springs[TARGET_NEXT, j]
            next_step = options.step
            if options.scheme != EXPLICIT_EULER and last_dt > 0.0:
                second = change / (0.5 * (dt + last_dt))
                if second > options.bending * size:
                    next_step *= max(math.sqrt(options.bending * size / second), SHORTEST)
            if options.scheme != EXPLICIT_EULER:
                count = curvature.size
                share = 1.0 - a / dt if stages == 2 else 1.0
                moved *= share * share
                along *= share
                sure = moved > (1e-11 * (1.0 + size / count)) ** 2 * count  # not rounding errors
                stiffness = max(-along / moved if sure else 0.0, 0.9 * stiffness)
                if stiffness * next_step > STIFF:
                    next_step = max(STIFF / stiffness, SHORTEST * options.step)
            last_dt = dt
            next_step = min(next_step, 2.0 * max(dt, clock[TRIAL]))
            if failed_at < np.inf:
                # The loss of stability is enclosed: halve the interval.
                next_step = min(next_step, 0.5 * (failed_at - new_time))
            clock[TRIAL] = next_step
            since += 1
            due = options.record_every > 0 and since >= options.record_every
        else:
            for j in range(angles.size):
                angles[j] = nodes[OLD_ANGLES, j]
            for j in range(curvature.size):
                curvature[j] = springs[OLD, j]
            for j in range(clock.size):
                clock[j] = saved[j]
            for j in range(m):
                multipliers[j] = saved[clock.size + j]
            clock[REJECTED] += 1.0
            stale = True
            failed_at = new_time
            clock[TRIAL] = 0.5 * dt
        if due:
            since = 0
            k = angles.size
            table[rows, 0] = clock[TIME]
            table[rows, 1] = clock[ENERGY]
            for j in range(CONTACT, SHIFT_Y + 1):
                table[rows, 2 + j - CONTACT] = clock[j]
            for j in range(m):
                table[rows, SCALARS + j] = multipliers[j]
            for j in range(k):
                table[rows, SCALARS + m + j] = angles[j]
            for j in range(k - 1):
                table[rows, SCALARS + m + k + j] = curvature[j]
            rows += 1
        if failed_at < np.inf:
            rate = 0.0
            for j in range(curvature.size):
                rate = max(rate, abs(springs[TARGET, j] - curvature[j]))
            if (failed_at - clock[TIME]) * rate <= options.resolution:
                return ENCLOSED, rows
        if rows == capacity:
            return FULL, rows


@jit
def look_at_lamp(clock, free, natural, chain, lamp, angles, space):
    """Find contact and pose (of a ring; ``free`` to roll or held) and what the light asks for."""
    if chain.ring:
        roll(clock, free, chain, angles, space.nodes)
    illuminate(lamp, chain, angles, clock, natural, space.nodes, space.springs)


@jit
def eigenvalues_of(chain, angles, curvature, multipliers, masses, work, nodes, out):
    """Write the smallest eigenvalue of the second variation of each row of ``angles`` to ``out``."""
    mode = np.empty(masses.size)
    for row in range(out.size):
        data = (chain, angles[row], curvature[row], nodes)
        x = angles[row, chain.first : chain.last]
        evaluate(data, x, multipliers[row], work)
        out[row] = smallest_eigenpair(masses, work, mode)
