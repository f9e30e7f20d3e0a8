"""Where solids leave cloth no room, and where a solid is merely thin, or cloth merely near one."""

import numpy as np
import pytest

from taichi_cloth.contact.solid.room import Walls, has_room, walls
from taichi_cloth.contact.solid.vertices import VertexContacts

UP, DOWN = np.array([0.0, 1, 0]), np.array([0.0, -1, 0])
THICK = np.array([0.01, 0.01])
FACES = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6]])
X = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0.1], [0.1, 0, 0.1], [1, 0, 0], [1.1, 0, 0], [1, 0, 0.1]])


def room(contacts, yields=(False, False), pinned=(), row=(0, 1, 2)) -> bool:
    """contacts: (particle, solid, normal, distance from its surface [m])."""
    index, solid, normal, distance = (np.array(v) for v in zip(*contacts))
    none = np.zeros(len(index))
    found = VertexContacts(index, solid, normal, distance - THICK[solid], none, np.zeros((len(index), 3)), none, index)
    held = np.zeros(7, dtype=bool)
    held[list(pinned)] = True
    return bool(has_room(np.array([row]), FACES, walls(found, None, X, THICK), THICK, np.array(yields), held)[0])


@pytest.mark.parametrize("contacts, free", [
    ([(0, 0, UP, 0.001)], True),  # one surface
    ([(0, 0, UP, 0.001), (1, 1, DOWN, 0.001)], False),  # a floor and a ceiling, 2 mm apart
    ([(0, 0, UP, -0.003), (3, 1, DOWN, 0.001)], False),  # the same, past each other, at a neighbour
    ([(0, 0, UP, 0.001), (4, 1, DOWN, 0.001)], True),  # elsewhere on the cloth
    ([(0, 0, UP, 0.001), (1, 1, DOWN, 0.03)], True),  # a ceiling 31 mm above
    ([(0, 0, UP, 0.001), (1, 0, DOWN, 0.001)], False),  # a slot in one body
    ([(0, 0, UP, 0.001), (1, 0, DOWN, -0.004)], True),  # a blade between two sides of the cloth
    ([(0, 0, UP, 0.001), (1, 1, np.array([1.0, 0, 0]), 0.001)], True),  # a corner
])
def test_room(contacts, free):
    assert room(contacts) == free


def test_a_body_that_closes_on_itself_leaves_none():
    overlapping = [(0, 0, UP, 0.001), (1, 0, DOWN, -0.004)]
    assert room(overlapping) and not room(overlapping, (True, False))


def test_the_point_of_a_needle_leaves_room_round_it():
    """Cloth on a side of the needle and, from the other side, on its point: the point lies in the plane of the side, and the
    side below that of the contact with the point."""
    def sides(lean: float) -> bool:
        normal = np.array([[1.0, 0, 0], [-0.6, 0.8, 0]])
        point = np.array([[0.0, 0, 0], [lean, 0.001, 0]])
        around = Walls(np.array([[0, 0, 0], [0, 1, 2]]), np.zeros(2, dtype=int), point, normal)
        return bool(has_room(np.array([[0, 1, 2]]), FACES, around, THICK, np.zeros(2, dtype=bool), np.zeros(7, dtype=bool))[0])

    assert sides(0.0) and sides(1e-9) and sides(-1e-9) and sides(1e-5)
    assert not sides(0.004)  # the sides of a groove, 4 mm wide


def test_what_is_pinned_there_has_none():
    inside = [(0, 0, UP, -0.02)]
    assert room(inside, pinned=(0, 1)) and not room(inside, pinned=(0, 1, 2)) and not room(inside, pinned=(0,), row=(0, 0, 0))


def test_pins_that_leave_a_direction_free_hold_nothing():
    from taichi_cloth.system.held import Held, pinned_particles

    projectors = np.stack([np.eye(3), np.diag([1.0, 1, 0])])
    held = Held(np.array([1, 2], dtype=np.int32), projectors, np.zeros((2, 3)), False, np.zeros((2, 3)))
    assert pinned_particles(held, 4).tolist() == [False, True, False, False] and not pinned_particles(None, 4).any()
