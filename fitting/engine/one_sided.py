"""Censored readings in the convex fit: residuals that count on one side only.

A slack muscle says F <= 0, a load cell at its limit F >= limit. Each adds max(0, s (F - limit))^2 / 2
to the sum of squares, s = 1 or -1, which is convex in the coefficients. At the optimum some of these
are on and the others are off, and the least squares of those that are on have the same gradient: so the
programme that is solved in the end, its multipliers and its certificate are those of the whole. The
others are set to what was read, with no derivative.

References:
    Tobin 1958; Madsen & Nielsen 1990, BIT 30 (Newton's method for piecewise quadratics).
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..convex.host_qp import solve_host_qps
from .point import Linear

if TYPE_CHECKING:
    from .stack import Stack

_ROUNDS = 60
_HALVINGS = 40  # of the interval in which the lowest point of a line lies
_ROUNDING = 1e-12  # of the largest residual: on or off makes no difference


def one_sided(
    stack: "Stack",
    members: Int[np.ndarray, " b"],
    linear: Sequence[Linear],
    guesses: Sequence[np.ndarray | None] | None,
) -> tuple[Linear, ...]:
    """The linear models with those censored readings that are off at the optimum set aside.

    Args:
        stack: of the problems.
        members: places of the problems.
        linear: models of all readings.
        guesses: rows of the constraint that may be active.

    Returns:
        The models; of a member whose readings do not settle they are nan, so that it has no fit.
    """
    side = stack.like.side
    rows = np.flatnonzero(side)
    A, b, _, _ = stack.programme(members, linear)
    A, b = side[rows, None] * A[:, rows], side[rows] * b[:, rows]
    on = np.zeros(b.shape, bool)
    x, settled = None, np.zeros(len(members), bool)
    for _ in range(_ROUNDS):
        programme = stack.programme(members, _set_aside(stack, members, linear, on))
        target = solve_host_qps(*programme, guesses).x
        excess = (A @ target[:, :, None])[:, :, 0] - b
        size = _ROUNDING * np.abs(excess).max(axis=1, keepdims=True)
        settled = ((excess > 0) == on) | ~(np.abs(excess) > size)
        settled = settled.all(axis=1) | ~np.isfinite(target).all(axis=1)
        if settled.all():
            break
        x = target if x is None else _lowest(stack, members, linear, x, target)
        reached = (A @ x[:, :, None])[:, :, 0] - b > 0
        on = np.where(settled[:, None], on, reached)
    found = _set_aside(stack, members, linear, on)
    if not settled.all():
        lost = np.where(settled, 0.0, np.nan)
        found = tuple(dataclasses.replace(one, force=one.force + lost[:, None]) for one in found)
    return found


def _lowest(
    stack: "Stack",
    members: np.ndarray,
    linear: Sequence[Linear],
    x: Float[np.ndarray, "b n"],
    target: Float[np.ndarray, "b n"],
) -> Float[np.ndarray, "b n"]:
    """Where the whole objective is lowest between two points, by halving on its slope."""
    A, b, _, _ = stack.programme(members, linear)
    side = np.zeros(b.shape[1], int)
    side[: stack.like.side.size] = stack.like.side
    start = (A @ x[:, :, None])[:, :, 0] - b
    along = (A @ (target - x)[:, :, None])[:, :, 0]
    low, high = np.zeros(len(x)), np.ones(len(x))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        residual = start + middle[:, None] * along
        residual = np.where((side == 0) | (side * residual > 0), residual, 0.0)
        falls = np.sum(residual * along, axis=1) < 0
        low, high = np.where(falls, middle, low), np.where(falls, high, middle)
    return x + high[:, None] * (target - x)


def _set_aside(
    stack: "Stack",
    members: np.ndarray,
    linear: Sequence[Linear],
    on: Bool[np.ndarray, "b rows"],
) -> tuple[Linear, ...]:
    """The models with the censored readings that are off as they were read, without derivatives."""
    found, first = [], 0
    for part, one, force in zip(stack.like.parts, linear, stack.force, strict=True):
        rows = np.flatnonzero(part.side)
        kept = np.ones((len(members), part.side.size), bool)
        kept[:, rows] = on[:, first : first + rows.size]
        first += rows.size
        found.append(
            dataclasses.replace(
                one,
                force=np.where(kept, one.force, force[members]),
                columns=np.where(kept[:, :, None], one.columns, 0.0),
                d_force=np.where(kept[:, None], one.d_force, 0.0),
                d_columns=np.where(kept[:, None, :, None], one.d_columns, 0.0),
            )
        )
    return tuple(found)
