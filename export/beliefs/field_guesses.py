"""Guesses of a field of bumps, each moved towards what a robot has read of it.

A field is the sum of three bumps of a known width, relative to its densest place. A guess is one such field:
it goes by Gauss-Newton steps to where it explains all readings, and is held, weakly, where it was drawn. So
what no reading tells of stays spread as it was, and guesses differ by as much as is not known. Those that
explain less are drawn anew, as better ones with one bump elsewhere: bumps that are not there go so.
"""

import numpy as np

from edge_runtime.common.arrays import Floats

HALF_WIDTH_M = 1.0
"""The field of VMAS Sampling is a square around the origin."""
BUMPS = 3
VARIANCE_M2 = 0.05
"""Of each bump, along each axis."""
READINGS = 240
"""The last so many count, those of 15 s at 10 Hz: what a tick may cost has a bound."""
GUESSES = 16
"""Of each robot. Twice as many choose no better a place, at twice the cost."""
STEPS = 2
"""Of the guesses, each time; those drawn anew take one more."""
ERROR = 0.01
"""Deviation of readings from what a guess explains: they are exact, and guesses are not."""
SCALE = 0.85
"""Mean inverse of the greatest density over all fields; 0.18 is its deviation."""
SPREAD = np.array([0.4] * 2 * BUMPS + [0.18], np.float32)
"""Of the numbers of a guess around those drawn: places in m, and the inverse of the greatest density."""
LEAST = np.array([-HALF_WIDTH_M] * 2 * BUMPS + [1.0 / BUMPS], np.float32)
MOST = np.array([HALF_WIDTH_M] * 2 * BUMPS + [1.0], np.float32)
FARTHEST = 0.25
"""Of one step, along each number: bumps look like parabolas no farther than their width."""
DAMPING = 0.02
"""Of a step, as a share of the curvature."""


class FieldGuesses:
    """What B robots guess, each for itself; the draws are the same for all.

    Args:
        robots: B.
    """

    def __init__(self, robots: int) -> None:
        self._draw = np.random.default_rng(0)
        drawn = self._draw.uniform(LEAST, MOST, (GUESSES, len(MOST))).astype(np.float32)
        drawn[:, -1] = SCALE
        self._drawn = np.tile(drawn, (robots, 1, 1))
        """(B, G, 7): the bumps' x, their y, and the inverse of the greatest density."""
        self._guess = self._drawn.copy()
        self._weight = np.full((robots, GUESSES), 1.0 / GUESSES, np.float32)
        self._place = np.zeros((robots, 2, 0), np.float32)
        self._value = np.zeros((robots, 0), np.float32)

    def read(self, place_m: Floats, values: Floats) -> None:
        """Learn from values (B, R) at (B, R, 2); a zero only tells of an empty cell."""
        place = np.concatenate([self._place, place_m.swapaxes(1, 2).astype(np.float32)], 2)
        value = np.concatenate([self._value, values.astype(np.float32)], 1)
        self._place, self._value = place[..., -READINGS:], value[:, -READINGS:]
        for _ in range(STEPS):
            self._guess = self._moved(self._guess, self._drawn)
        missed = self._missed(self._guess)
        self._renew(missed)
        evidence = np.exp((missed.min(1, keepdims=True) - missed) / 2.0)
        self._weight = evidence / evidence.sum(1, keepdims=True)

    def expected(self, along_m: Floats) -> Floats:
        """The mean of all guesses at a grid's places, (P,) along each axis: (B, P, P), by x, then y."""
        x, y, scale = np.split(self._guess, (BUMPS, 2 * BUMPS), -1)
        along_x, along_y = (
            np.exp(np.square(each.reshape(len(each), -1, 1) - along_m) / (-2.0 * VARIANCE_M2))
            for each in (x, y)
        )
        share = np.repeat(self._weight * scale[..., 0], BUMPS, 1)[..., None]
        mean: Floats = (share * along_x).swapaxes(1, 2) @ along_y
        return mean

    def _renew(self, missed: Floats) -> None:
        """Try better guesses, one bump elsewhere, in place of the worse half; ``missed`` (B, G) follows."""
        half, rows = GUESSES // 2, np.arange(len(missed))[:, None]
        order = missed.argsort(1, kind="stable")
        better, worse = order[:, :half], order[:, half:]
        drawn, bump = self._guess[rows, better], self._draw.integers(BUMPS, size=half)
        for axis in (0, 1):
            place = self._draw.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, half)
            drawn[:, np.arange(half), bump + axis * BUMPS] = place
        guess = drawn
        for _ in range(STEPS + 1):
            guess = self._moved(guess, drawn)
        now, before = self._missed(guess), missed[rows, worse]
        taken = now < before + 1.0  # as good, by what the readings can tell
        missed[rows, worse] = np.where(taken, now, before)
        for kept, new in ((self._guess, guess), (self._drawn, drawn)):
            kept[rows, worse] = np.where(taken[..., None], new, kept[rows, worse])

    def _moved(self, guess: Floats, drawn: Floats) -> Floats:
        """A damped Gauss-Newton step of guesses (B, G, 7)."""
        away, near, left = self._compare(guess)
        scale = guess[..., -1, None, None] / VARIANCE_M2
        slope = (
            np.concatenate([scale * near * each for each in away] + [near.sum(2, keepdims=True)], 2) / ERROR
        )
        curvature = slope @ slope.swapaxes(-1, -2)
        told = (slope @ left[..., None])[..., 0] + (drawn - guess) / SPREAD**2
        steep = np.einsum("...ii->...i", curvature)
        steep += SPREAD**-2.0 + DAMPING * steep
        step = np.linalg.solve(curvature, told[..., None])[..., 0]
        return np.clip(guess + np.clip(step, -FARTHEST, FARTHEST), LEAST, MOST)

    def _missed(self, guess: Floats) -> Floats:
        """Sum of the squared deviations (B, G) of the readings, in units of their error."""
        missed: Floats = np.square(self._compare(guess)[2]).sum(-1)
        return missed

    def _compare(self, guess: Floats) -> tuple[list[Floats], Floats, Floats]:
        """How far bumps lie from readings along x and y, how near they are, and what is left to explain."""
        away = [
            self._place[:, None, axis, None] - guess[..., axis * BUMPS : (axis + 1) * BUMPS, None]
            for axis in (0, 1)
        ]
        read = self._value[:, None] > 0.0
        near = np.exp((np.square(away[0]) + np.square(away[1])) / (-2.0 * VARIANCE_M2)) * read[:, :, None]
        left = (self._value[:, None] - guess[..., -1:] * near.sum(2)) / ERROR
        return away, near, left
