"""What blocks the way of cloth holds back its own particles, and what loses its room is stopped by its own load."""

import numpy as np
import pytest

from taichi_cloth.contact.cloth.contact_pairs import ContactPairs
from taichi_cloth.contact.cloth.firmness import Firmness
from taichi_cloth.contact.cloth.islands import Blocked, bound

NONE = np.zeros(0, dtype=np.int64)
R = 0.01


def beads(start: np.ndarray, keep: float):
    """What looks for beads on a line that come nearer than `keep` on their way: in closed form."""
    def look(end: np.ndarray) -> Blocked:
        rows, part = [], []
        for i in range(len(start) - 1):
            d_0, d_1 = start[i + 1, 0] - start[i, 0], end[i + 1, 0] - end[i, 0]
            if d_1 < keep:
                rows.append([i, i + 1, i + 1, i + 1])
                part.append((d_0 - keep) / (d_0 - d_1))
        return Blocked(np.zeros((len(rows), 3), dtype=np.int64), np.array(rows, dtype=np.int64).reshape(-1, 4), np.array(part))

    return look


def test_a_blocked_pair_goes_on_together_and_the_rest_does_not_wait():
    start = np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]])
    motion = np.array([[3.0, 0, 0], [0.4, 0, 0], [5, 0, 0]])
    look = beads(start, 0.2)
    x, part = bound(start, start + motion, look(start + motion), look, (NONE, NONE))
    assert part == pytest.approx(0.8 / 2.6)
    assert x[2].tolist() == [14, 0, 0] and x[1, 0] - x[0, 0] == pytest.approx(0.2)
    assert x[:2].mean(axis=0) == pytest.approx((start + motion)[:2].mean(axis=0))  # momentum of the two


def test_an_island_takes_in_what_it_is_led_against():
    """The first pushes the second on, further than that goes by itself, and so against the third."""
    start = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [20, 0, 0]])
    motion = np.array([[4.0, 0, 0], [0, 0, 0], [0, 0, 0], [-1, 0, 0]])
    look = beads(start, 0.2)
    x, part = bound(start, start + motion, look(start + motion), look, (NONE, NONE))
    assert (np.diff(x[:, 0]) >= 0.2 - 1e-12).all() and part == pytest.approx(0.1) and x[3, 0] == 19
    assert x[:3].mean(axis=0) == pytest.approx((start + motion)[:3].mean(axis=0))


def test_what_is_tied_moves_as_one():
    start = np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]])
    motion = np.array([[3.0, 0, 0], [0.4, 0, 0], [3, 0, 0]])
    look = beads(start, 0.2)
    x, part = bound(start, start + motion, look(start + motion), look, (np.array([2]), np.array([0])))
    assert x[2, 0] - start[2, 0] == pytest.approx(x[0, 0] - start[0, 0]) and x[1, 0] - x[0, 0] >= 0.2 - 1e-12


def pairs(end: np.ndarray) -> ContactPairs:
    """Pairs of their own four particles at distances end (k,)."""
    k = len(end)
    vertices = np.arange(4 * k).reshape(k, 4)
    return ContactPairs(np.zeros((k, 3), dtype=np.int64), vertices, np.tile([1.0, -1, 0, 0], (k, 1)), end, end,
                        np.tile([0.0, 1, 0], (k, 1)), np.ones(k), np.full(k, R))


def test_only_what_loses_more_than_half_of_its_room_is_stopped_more_firmly():
    room = np.array([0.30, 0.049, 0.051, 0.004, 0.12, -0.15])  # as parts of what is above the floor, a fifth of r
    began = np.array([0.70, 0.100, 0.100, 0.020, 0.80, -0.10])
    firmness = Firmness(24)
    assert firmness.rise(pairs((0.2 + 0.8 * room) * R), (0.2 + 0.8 * began) * R)
    raised = firmness.factor.reshape(6, 4)
    assert (raised == raised[:, :1]).all() and (raised[:, 0] > 1).tolist() == [False, True, False, True, False, False]
    firmness.reset()
    assert (firmness.factor == 1).all()
    assert not firmness.rise(pairs((0.2 + 0.8 * began) * R), (0.2 + 0.8 * began) * R)  # what rests as it began


def test_a_load_is_carried_after_one_more_solve():
    """A stop k (began - d) under a load that brings it to where it is: so much firmer, it keeps .7 of its room."""
    began, left = 0.1, 0.02
    firmness = Firmness(4)
    firmness.rise(pairs(np.array([(0.2 + 0.8 * left) * R])), np.array([(0.2 + 0.8 * began) * R]))
    now = began - (began - left) / firmness.factor[0]
    assert now == pytest.approx(0.7 * began)
