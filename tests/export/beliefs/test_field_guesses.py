"""Guesses of a field: as spread as what is not known, and right where enough was read."""

import numpy as np
import pytest

from export.beliefs import field_guesses
from export.beliefs.field_guesses import BUMPS, HALF_WIDTH_M, LEAST, MOST, FieldGuesses

ALONG_M = np.linspace(-HALF_WIDTH_M, HALF_WIDTH_M, 21)
SQUARE = np.stack(np.meshgrid(ALONG_M, ALONG_M, indexing="ij"), -1)
FIELDS = 5


def density(place_m, centre_m):
    """Sum of bumps around (..., 3, 2), at (..., P, 2)."""
    return np.exp(-np.square(place_m[..., None, :] - centre_m[..., None, :, :]).sum(-1) / 0.1).sum(-1)


@pytest.fixture
def fields():
    """Centres, and the greatest density of each."""
    centre = np.random.default_rng(4).uniform(-HALF_WIDTH_M, HALF_WIDTH_M, (FIELDS, BUMPS, 2))
    return centre, density(SQUARE.reshape(1, -1, 2), centre).max(1)


def read(fields, guesses, places_m):
    centre, densest = fields
    for place in places_m:
        around = place + 0.05 * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
        around = np.tile(around, (FIELDS, 1, 1))
        guesses.read(around, density(around, centre) / densest[:, None])


def truth(fields):
    centre, densest = fields
    values = density(SQUARE.reshape(1, -1, 2), centre) / densest[:, None]
    return values.reshape(FIELDS, *SQUARE.shape[:2])


def test_who_has_read_everywhere_knows_the_field(fields):
    guesses = FieldGuesses(FIELDS)
    steps = np.linspace(-0.8, 0.8, 5)
    read(fields, guesses, [np.array((x, y)) for x in steps for y in steps])
    error = np.abs(guesses.expected(ALONG_M) - truth(fields))
    assert np.median(error) < 0.01
    assert error.max() < 0.25


def test_readings_of_one_corner_leave_the_other_open(fields):
    guesses = FieldGuesses(FIELDS)
    before = guesses.expected(ALONG_M)
    read(fields, guesses, [np.array((-0.8, y)) for y in (-0.8, -0.7, -0.6, -0.5)])
    after, true = guesses.expected(ALONG_M), truth(fields)
    near = (slice(None), slice(0, 5), slice(0, 5))
    assert np.abs(after - true)[near].mean() < 0.2 * np.abs(before - true)[near].mean()
    assert (after[:, 11:].max((1, 2)) > 0.1).all()


def test_zeros_tell_only_of_empty_cells():
    guesses, untold = FieldGuesses(FIELDS), FieldGuesses(FIELDS)
    for place in ((0.0, 0.0), (0.5, 0.5)):
        guesses.read(np.full((FIELDS, 8, 2), place), np.zeros((FIELDS, 8)))
    spread, usual = (each.expected(ALONG_M) for each in (guesses, untold))
    assert (spread == spread[0]).all()
    assert abs(spread.mean() - usual.mean()) < 0.1


def test_what_a_tick_costs_is_bounded(fields, monkeypatch):
    monkeypatch.setattr(field_guesses, "READINGS", 12)
    forgetful, fresh = FieldGuesses(FIELDS), FieldGuesses(FIELDS)
    read(fields, forgetful, [np.array((0.1 * n, 0.0)) for n in range(6)])
    assert forgetful._value.shape == (FIELDS, 12)
    assert forgetful._place.shape == (FIELDS, 2, 12)
    assert fresh._value.shape == (FIELDS, 0)


def test_guesses_stay_possible_whatever_is_read():
    guesses, draw = FieldGuesses(3), np.random.default_rng(0)
    for _ in range(10):
        guesses.read(draw.uniform(-1.0, 1.0, (3, 8, 2)), draw.uniform(0.0, 5.0, (3, 8)))
    assert (guesses._guess >= LEAST).all()
    assert (guesses._guess <= MOST).all()
    assert np.isfinite(guesses.expected(ALONG_M)).all()
    np.testing.assert_allclose(guesses._weight.sum(1), 1.0, rtol=1e-5)
