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
    chain_work,
    jit,
    make_solvers,
    newton_step,
    smallest_eigenpair,
)

__all__ = [
    "BIFURCATED",
    "DONE",
    "FAILED",
    "FULL",
    "LOST_STABILITY",
    "Chain",
    "Lamp",
    "Options",
    "Space",
    "chain_work",
    "correct",
    "descend",
    "escape",
    "evaluate",
    "illuminate",
    "look_at_lamp",
    "march",
    "roll",
    "smallest_eigenpair",
    "space_for",
]

DONE = 0
LOST_STABILITY = 1
FULL = 2
FAILED = 3
BIFURCATED = 4

EXPLICIT_EULER = 0
EXPONENTIAL_1 = 1
EXPONENTIAL_2 = 2

# Entries of the mutable record `clock`.
TIME, CONTACT, TRIAL, ENERGY, RESIDUAL, STEPS, REJECTED, COS, SIN, SHIFT_X, SHIFT_Y, EIGENVALUE = (
    range(12)
)
CLOCK_SIZE = 12


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
    """Of the time loop."""

    until: float
    step: float
    scheme: int
    turning: float
    tolerance: float
    event_tolerance: float
    hold: float
    record_every: int
    eigenvalues: bool


class Space(NamedTuple):
    """Scratch arrays of the time loop."""

    sine: np.ndarray
    cosine: np.ndarray
    target: np.ndarray
    target_next: np.ndarray
    new_curvature: np.ndarray
    old_angles: np.ndarray
    old_curvature: np.ndarray
    old_multipliers: np.ndarray
    x: np.ndarray
    y: np.ndarray
    lean: np.ndarray
    masses: np.ndarray
    mode: np.ndarray


@jit
def space_for(chain, size):
    """Allocate the scratch arrays for a chain of ``size`` angles."""
    n = chain.last - chain.first
    masses = np.full(n, chain.spacing)
    if chain.first == 0:
        masses[0] = chain.weight_start
    if chain.last == size:
        masses[n - 1] = chain.weight_end
    return Space(
        np.zeros(size),
        np.zeros(size),
        np.zeros(size - 1),
        np.zeros(size - 1),
        np.zeros(size - 1),
        np.zeros(size),
        np.zeros(size - 1),
        np.zeros(2),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        masses,
        np.zeros(n),
    )


@jit
def _copy(source, target):
    # An assignment to a slice compiles into much more code (messages about shapes).
    for j in range(source.size):
        target[j] = source[j]


@jit
def evaluate(data, x, multipliers, gradient, diagonal, off_diagonal, constraints, rows):
    r"""Derivatives of the Lagrangian of the elastica; returns the bending energy.

    .. math:: E = \sum_j \tfrac{h}{2}\Big(\frac{\theta_{j+1} - \theta_j}{h} - K_{0,j}\Big)^2,\qquad
              c = \sum_j w_j (\cos\theta_j, \sin\theta_j) - d .

    ``data`` is (chain, angles, curvature, sine, cosine); ``x`` is a view of the unknown angles.
    Sines and cosines are left in ``data`` for the light.
    """
    chain, angles, curvature, sine, cosine = data
    size = angles.size
    h = chain.spacing
    inverse = 1.0 / h
    first = chain.first
    last = chain.last
    fx = multipliers[0]
    fy = multipliers[1]
    for j in range(size):
        sine[j] = math.sin(angles[j])
        cosine[j] = math.cos(angles[j])
    cx = chain.weight_start * cosine[0] + chain.weight_end * cosine[size - 1] - chain.chord_x
    cy = chain.weight_start * sine[0] + chain.weight_end * sine[size - 1] - chain.chord_y
    sum_c = 0.0
    sum_s = 0.0
    for j in range(1, size - 1):
        sum_c += cosine[j]
        sum_s += sine[j]
    constraints[0] = cx + h * sum_c
    constraints[1] = cy + h * sum_s
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
            s = w * sine[j]
            c = w * cosine[j]
            gradient[i] = left - right - fx * s + fy * c
            diagonal[i] = stiffness - fx * c - fy * s
            rows[0, i] = -s
            rows[1, i] = c
            if j < last - 1:
                off_diagonal[i] = -inverse
        left = right
    return 0.5 * h * energy


correct, descend = make_solvers(evaluate)


@jit
def illuminate(time, lamp, chain, angles, sine, cosine, pose, natural, x, y, target):
    r"""Write the curvature that each spring relaxes to: :math:`K_r + \Lambda f`.

    The flux on a face is the positive part of the cosine between its normal and the direction of
    the source (3.11).  ``pose`` holds cosine and sine of the rigid rotation and the translation
    that take the chain to the laboratory; ``x`` and ``y`` are scratch.
    """
    size = angles.size
    turn_c = pose[COS]
    turn_s = pose[SIN]
    # face * (toward . normal) as a combination of the cosine and sine of the angle in the chain.
    a = lamp.face * (lamp.toward_y * turn_c - lamp.toward_x * turn_s)
    b = -lamp.face * (lamp.toward_x * turn_c + lamp.toward_y * turn_s)
    gain = lamp.gain
    if lamp.width == 0.0:
        for j in range(size - 1):
            u = cosine[j] + cosine[j + 1]
            v = sine[j] + sine[j + 1]
            # (u, v) / |(u, v)| is the direction at the mean of the two angles.
            flux = (a * u + b * v) / math.sqrt(u * u + v * v)
            target[j] = natural[j] + gain * max(flux, 0.0)
    else:
        h = chain.spacing
        px = chain.weight_start * cosine[0]
        py = chain.weight_start * sine[0]
        scale = -0.5 / (lamp.width * lamp.width)
        for j in range(size - 1):
            if j > 0:
                px += h * cosine[j]
                py += h * sine[j]
            lab_x = turn_c * px - turn_s * py + pose[SHIFT_X]
            lab_y = turn_s * px + turn_c * py + pose[SHIFT_Y]
            # Distance from the axis of the beam.
            r = (lab_x - lamp.center) * lamp.toward_y - lab_y * lamp.toward_x
            u = cosine[j] + cosine[j + 1]
            v = sine[j] + sine[j + 1]
            flux = (a * u + b * v) / math.sqrt(u * u + v * v)
            target[j] = natural[j]
            if flux > 0.0:
                target[j] += gain * flux * math.exp(scale * r * r)


@jit
def _interpolate(values, cell, fraction, slope):
    """Sixth-order interpolation between nodes ``cell`` and ``cell + 1`` of a periodic array.

    ``slope`` is added per turn (for angles, which grow by it along the array).
    """
    n = values.size
    total = 0.0
    for p in range(-2, 4):
        weight = 1.0
        for q in range(-2, 4):
            if q != p:
                weight *= (fraction - q) / (p - q)
        index = cell + p
        turns = math.floor(index / n)
        total += weight * (values[index - turns * n] + slope * turns)
    return total


@jit
def roll(clock, free, chain, angles, sine, cosine, x, y, lean):
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
    x[0] = 0.0
    y[0] = 0.0
    mean_x = 0.0
    mean_y = 0.0
    for j in range(n - 1):
        x[j + 1] = x[j] + 0.5 * h * (cosine[j] + cosine[j + 1])
        y[j + 1] = y[j] + 0.5 * h * (sine[j] + sine[j + 1])
    for j in range(n):
        mean_x += x[j]
        mean_y += y[j]
    mean_x /= n
    mean_y /= n
    largest = 0.0
    for j in range(n):
        lean[j] = (mean_x - x[j]) * cosine[j] + (mean_y - y[j]) * sine[j]
        largest = max(largest, abs(lean[j]))
    leans = lean[:n]
    position = clock[CONTACT] / h
    if free and largest > 1e-14 * n:
        cell = math.floor(position)
        here = _interpolate(leans, cell, position - cell, 0.0)
        low = position
        high = position
        if here > 0.0:  # the center of mass lies ahead: roll forward
            k = cell + 1
            for _ in range(n + 1):
                if leans[k % n] <= 0.0:
                    break
                k += 1
            cell = k - 1
            low = max(position, float(cell))
            high = float(k)
        elif here < 0.0:
            k = cell
            for _ in range(n + 1):
                if leans[k % n] >= 0.0:
                    break
                k -= 1
            cell = k
            low = float(k)
            high = min(position, float(k + 1))
        if high > low:
            f_low = _interpolate(leans, cell, low - cell, 0.0)
            f_high = _interpolate(leans, cell, high - cell, 0.0)
            side = 0
            for _ in range(60):  # regula falsi, Illinois
                if f_low == f_high:
                    break
                new = (low * f_high - high * f_low) / (f_high - f_low)
                value = _interpolate(leans, cell, new - cell, 0.0)
                if value > 0.0:
                    low = new
                    f_low = value
                    if side == 1:
                        f_high *= 0.5
                    side = 1
                elif value < 0.0:
                    high = new
                    f_high = value
                    if side == -1:
                        f_low *= 0.5
                    side = -1
                position = new
                if abs(value) <= 1e-15 * largest or high - low <= 1e-13 * n:
                    break
        clock[CONTACT] = position * h
    cell = math.floor(position)
    fraction = position - cell
    turn = angles[n] - angles[0]
    angle = _interpolate(angles[:n], cell, fraction, turn)
    clock[COS] = math.cos(angle)
    clock[SIN] = -math.sin(angle)
    px = _interpolate(x[:n], cell, fraction, 0.0)
    py = _interpolate(y[:n], cell, fraction, 0.0)
    clock[SHIFT_X] = clock[CONTACT] - (clock[COS] * px - clock[SIN] * py)
    clock[SHIFT_Y] = -(clock[SIN] * px + clock[COS] * py)


@jit
def _settle(
    chain, angles, curvature, new_curvature, multipliers, tolerance, raised, work, sine, cosine
):
    """Move to the equilibrium for a new curvature: one step with the old factors, then Newton.

    The residual is affine in the curvature, so the first step needs no evaluation.
    """
    first = chain.first
    for j in range(new_curvature.size):
        change = new_curvature[j] - curvature[j]
        curvature[j] = new_curvature[j]
        if first <= j < chain.last:
            work.gradient[j - first] += change
        if first <= j + 1 < chain.last:
            work.gradient[j + 1 - first] -= change
    x = angles[first : chain.last]
    newton_step(work, raised, x, multipliers)
    return correct(
        x,
        multipliers,
        (chain, angles, curvature, sine, cosine),
        tolerance,
        12,
        0.5,
        work,
    )


@jit
def _record(row, clock, angles, curvature, multipliers, table):
    times, all_angles, all_curvature, all_multipliers, scalars = table
    times[row] = clock[TIME]
    for j in range(angles.size):
        all_angles[row, j] = angles[j]
    for j in range(curvature.size):
        all_curvature[row, j] = curvature[j]
    for j in range(multipliers.size):
        all_multipliers[row, j] = multipliers[j]
    scalars[row, 0] = clock[ENERGY]
    scalars[row, 1] = clock[CONTACT]
    scalars[row, 2] = clock[EIGENVALUE]
    scalars[row, 3] = clock[COS]
    scalars[row, 4] = clock[SIN]
    scalars[row, 5] = clock[SHIFT_X]
    scalars[row, 6] = clock[SHIFT_Y]


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
    enclosed within ``options.event_tolerance``.  Steps are shortened where the shape turns faster
    than ``options.turning`` per unit of time: the square-root approach to a fold would else spoil
    the order of the scheme.

    Returns
    -------
    reason : int
        DONE, LOST_STABILITY, FULL (the table) or FAILED (no equilibrium at the start).
    rows : int
        Rows of the table that were written.
    """
    m = multipliers.size
    x = angles[chain.first : chain.last]
    data = (chain, angles, curvature, space.sine, space.cosine)
    capacity = table[0].size
    old_pose = np.empty(clock.size)
    stages = 2 if options.scheme == EXPONENTIAL_2 else 1
    rows = 0
    since = 0
    failed_at = np.inf
    begun = False
    stale = True  # the factors in `work` do not belong to the current state
    raised = 0.0
    if clock[TRIAL] <= 0.0:
        clock[TRIAL] = options.step
    while True:
        if stale:
            status, _, _, _, raised, _, negative, zero, _ = correct(
                x,
                multipliers,
                data,
                np.inf if begun else options.tolerance,
                12,
                0.5,
                work,
            )
            if status != CONVERGED or negative != m or zero != 0:
                return FAILED, rows
            if not begun:
                look(
                    clock,
                    clock[TIME] >= options.hold,
                    natural,
                    chain,
                    lamp,
                    angles,
                    space,
                    space.target,
                )
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
        _copy(angles, space.old_angles)
        _copy(curvature, space.old_curvature)
        _copy(multipliers, space.old_multipliers)
        _copy(clock, old_pose)
        a = dt if options.scheme == EXPLICIT_EULER else -math.expm1(-dt)
        good = True
        energy = 0.0
        residual = 0.0
        for stage in range(stages):
            if stage == 0:
                for j in range(curvature.size):
                    space.new_curvature[j] = curvature[j] + a * (space.target[j] - curvature[j])
            else:
                b = 1.0 - a / dt  # exact for a target that is linear in time
                for j in range(curvature.size):
                    space.new_curvature[j] = curvature[j] + b * (
                        space.target_next[j] - space.target[j]
                    )
            status, _, energy, residual, raised, _, negative, zero, _ = _settle(
                chain,
                angles,
                curvature,
                space.new_curvature,
                multipliers,
                options.tolerance,
                raised,
                work,
                space.sine,
                space.cosine,
            )
            good = status == CONVERGED and negative == m and zero == 0
            if not good:
                break
            # Contact and light at the new time, from the contact at the old one.
            clock[CONTACT] = old_pose[CONTACT]
            clock[TIME] = new_time
            look(
                clock,
                new_time > options.hold * (1.0 + 1e-12),
                natural,
                chain,
                lamp,
                angles,
                space,
                space.target_next,
            )
        turned = 0.0
        for j in range(angles.size):
            turned = max(turned, abs(angles[j] - space.old_angles[j]))
        due = False
        if good and turned <= 0.3:
            clock[ENERGY] = energy
            clock[RESIDUAL] = residual
            clock[STEPS] += 1.0
            _copy(space.target_next, space.target)
            next_step = options.step
            if options.scheme != EXPLICIT_EULER and turned > options.turning * dt:
                next_step = options.step * options.turning * dt / turned
            next_step = min(next_step, 2.0 * max(dt, clock[TRIAL]))
            if failed_at < np.inf:
                # The loss of stability is enclosed: halve the interval.
                next_step = min(next_step, 0.5 * (failed_at - new_time))
            clock[TRIAL] = next_step
            since += 1
            due = options.record_every > 0 and since >= options.record_every
        else:
            _copy(space.old_angles, angles)
            _copy(space.old_curvature, curvature)
            _copy(space.old_multipliers, multipliers)
            _copy(old_pose, clock)
            clock[REJECTED] += 1.0
            stale = True
            failed_at = new_time
            clock[TRIAL] = 0.5 * dt
        enclosed = failed_at - clock[TIME] <= options.event_tolerance
        if enclosed or (due and options.eigenvalues):
            if stale:
                _, _, _, _, raised, _, _, _, _ = correct(x, multipliers, data, np.inf, 0, 0.5, work)
            clock[EIGENVALUE] = smallest_eigenpair(space.masses, work, space.mode)
            stale = True
        if due:
            since = 0
            if not options.eigenvalues:
                clock[EIGENVALUE] = np.nan
            _record(rows, clock, angles, curvature, multipliers, table)
            rows += 1
        if enclosed:
            # Is stability lost here, or did a long step merely lead astray?
            if not clock[EIGENVALUE] > 0.3:
                clock[TRIAL] = options.step
                return LOST_STABILITY, rows
            failed_at = np.inf
            clock[TRIAL] = max(clock[TRIAL], options.event_tolerance)
        if rows == capacity:
            return FULL, rows


@jit
def look_at_lamp(clock, free, natural, chain, lamp, angles, space, target):
    """Find contact and pose (of a ring; ``free`` to roll or held) and what the light asks for."""
    if chain.ring:
        roll(clock, free, chain, angles, space.sine, space.cosine, space.x, space.y, space.lean)
    illuminate(
        clock[TIME],
        lamp,
        chain,
        angles,
        space.sine,
        space.cosine,
        clock,
        natural,
        space.x,
        space.y,
        target,
    )


@jit
def escape(
    clock, angles, curvature, multipliers, target, chain, tolerance, delay, push, work, space
):
    """Leave an equilibrium that has just lost its stability, at frozen curvature.

    The curvature is first advanced by ``delay`` (the event tolerance), which takes it past the
    loss; then the energy descends from the old shape pushed by ``push`` (radians at most, with
    its sign) along the critical mode in ``space.mode``, then to the other side, then farther.

    Returns
    -------
    status : int
        0 if a stable equilibrium was reached.
    released : float
        Energy released at frozen curvature.
    distance : float
        Largest change of an angle.
    """
    x = angles[chain.first : chain.last]
    data = (chain, angles, curvature, space.sine, space.cosine)
    a = -math.expm1(-delay)
    for j in range(curvature.size):
        curvature[j] += a * (target[j] - curvature[j])
    clock[TIME] += delay
    old = angles.copy()
    before = evaluate(
        data,
        x,
        multipliers,
        work.gradient,
        work.diagonal,
        work.off_diagonal,
        work.constraints,
        work.rows,
    )
    largest = 1e-300
    for i in range(x.size):
        largest = max(largest, abs(space.mode[i]))
    old_multipliers = multipliers.copy()
    status = 1
    energy = before
    residual = np.inf
    size = push
    for _ in range(6):
        # At a fold one side of the mode leads back to where the minimum vanished.
        for j in range(angles.size):
            angles[j] = old[j]
        for i in range(x.size):
            x[i] += size * space.mode[i] / largest
        _copy(old_multipliers, multipliers)
        for stage in range(2):
            status, _, energy, residual = descend(
                x,
                multipliers,
                data,
                space.masses,
                tolerance,
                20 if stage == 0 else 2000,
                0.3,
                work,
            )
            distance = 0.0
            for j in range(angles.size):
                distance = max(distance, abs(angles[j] - old[j]))
            if status == CONVERGED or distance < 0.7 * abs(size):
                break  # done, or on the way back to where the minimum vanished
        if status == CONVERGED:
            break
        size = -size if size * push > 0.0 else -3.0 * size
    distance = 0.0
    for j in range(angles.size):
        distance = max(distance, abs(angles[j] - old[j]))
    clock[ENERGY] = energy
    clock[RESIDUAL] = residual
    clock[TRIAL] = 0.0
    return status, before - energy, distance
