"""The rule of contact with solids, against the law that its fixed points obey."""

import numpy as np
import pytest

from taichi_cloth.contact.solid.coulomb import SMOOTH, Rows, project_to_coulomb, smoothed
from taichi_cloth.contact.solid.vertices import VertexContacts

MU, M, C = 0.4, 2e-3, 0.01


def contact(gap: float = 0.0) -> VertexContacts:
    """One, on a floor."""
    one = np.zeros(1, dtype=np.int64)
    up, nowhere = np.array([[0.0, 1, 0]]), np.zeros((1, 3))
    return VertexContacts(one, one, up, np.array([gap]), np.zeros(1), nowhere, np.array([MU]), one)


def state(stick: bool, normal: float = 0.0, push: tuple = (0, 0, 0), drag: float = 0.0) -> Rows:
    return Rows(np.zeros(1, dtype=np.int64), np.array([stick]), np.array([normal]), np.array([push], dtype=float),
                np.array([drag]))


def ruled(f, was, slip, impulse):
    rows, p, bears = project_to_coulomb(f, was, np.array([slip], dtype=float), np.array([impulse], dtype=float),
                                        np.array([impulse[1]]), np.array([M]), np.array([M]), C)
    return rows, p[0], bool(bears[0])


def test_what_sticks_within_its_cone_stays():
    rows, p, bears = ruled(contact(), state(True), (0, 0, 0), (0.3 * MU, 1.0, 0))
    assert bears and rows.stick[0] and np.allclose(p, (0.3 * MU, 1, 0), atol=1e-15)


def test_what_shears_beyond_slides_with_all_that_its_cone_bears():
    rows, p, bears = ruled(contact(), state(True), (0, 0, 0), (3 * MU, 1.0, 4 * MU))
    assert bears and not rows.stick[0] and np.allclose(p, (0.6 * MU, 1, 0.8 * MU), atol=1e-15)
    assert np.allclose(rows.push[0], (0.6, 0, 0.8)) and rows.drag[0] > 0


def test_what_slides_is_braked_against_its_slip():
    slip = (0.5, 0, 0)
    rows, p, _ = ruled(contact(), state(False, 1.0, (-1, 0, 0), 1e-3), slip, (0, 1.0, 0))
    assert not rows.stick[0] and np.allclose(p, (-MU, 1, 0), atol=1e-15)
    drag = rows.drag[0]
    assert drag == pytest.approx(M * MU / (M * 0.5), rel=1e-9), "Newton's: the cone over the slip"


def test_what_friction_has_turned_round_sticks():
    rows, _, _ = ruled(contact(), state(False, 1.0, (-1, 0, 0)), (-0.2, 0, 0), (0, 0.9, 0))  # its cone has shrunk meanwhile
    assert rows.stick[0]


@pytest.mark.parametrize("gap, pull, bears", [(0.0, -0.1, False), (1e-3, 1e-4, False), (-1e-3, 0.0, True), (1e-3, 5e-4, True)])
def test_nothing_pulls_and_what_is_inside_bears(gap, pull, bears):
    """p_n = max(0, p_n - m g/c); m g/c is 2e-4 N s here."""
    _, p, does = ruled(contact(gap), state(True), (0, 0, 0), (0, pull, 0))
    assert does == bears and p[1] == pytest.approx(max(0.0, pull - M * gap / C), abs=1e-18)


def test_smooth_friction_is_coulombs_beyond_its_slip_and_less_below():
    slips = np.array([[0.5, 0, 0], [1e-3, 0, 0]])
    key, normal = np.arange(2), np.ones(2)
    rows = smoothed(key, MU * normal, normal, slips, SMOOTH)
    force = rows.push * MU - rows.drag[:, None] * (slips - rows.push * np.einsum("ki,ki->k", slips, rows.push)[:, None])
    assert np.allclose(force[0], (-MU, 0, 0)) and np.allclose(force[1], (-MU * 1e-3 / SMOOTH, 0, 0))
    assert not rows.stick.any()
