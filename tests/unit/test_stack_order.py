"""The order of layers between surfaces that close on them."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.contact.stack_order import GAP, StackOrder
from taichi_cloth.scene.mesh import face_edges

KEEPS = 0.003  # m between two layers


def sheets(count: int, cells: int = 4) -> tuple[SimpleNamespace, np.ndarray]:
    """(Flat sheets as contact knows them, their particles (n, 3), all in the plane y = 0, each turned a little)."""
    mesh, faces, x = tc.grid(0.1, cells), [], []
    for k in range(count):
        c, s = np.cos(0.2 * k), np.sin(0.2 * k)
        flat = (mesh.x - mesh.x.mean(axis=0)) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        faces.append(mesh.faces + len(mesh.x) * k)
        x.append(flat + [0.003 * k, 0, 0.001 * k])
    f, x = np.concatenate(faces), np.concatenate(x)
    edges = np.unique(np.sort(face_edges(f), axis=1), axis=0)
    n = len(x)
    return SimpleNamespace(faces=f, edges=edges, half_thickness=np.full(n, KEEPS / 2), cluster_ids=np.arange(n),
                           particles_may_meet=lambda i, j: np.ones(len(i), dtype=bool)), x


def heights(count: int, n: int, gap: float) -> np.ndarray:
    """(n, 3) by which sheet k is k gaps up."""
    return np.repeat(np.arange(count), n // count)[:, None] * np.array([0.0, gap, 0.0])


def led(order: StackOrder, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Where targets of all particles go on to, by their order across y."""
    up = np.tile([0.0, 1.0, 0.0], (len(x), 1))
    return target + order.shift(x, np.arange(len(x)), target, up)[:, None] * up


@pytest.mark.parametrize("count", [2, 3])
def test_targets_in_one_place_are_led_apart_in_order(count):
    mesh, x = sheets(count)
    order = StackOrder(mesh, len(x))
    out = led(order, x + heights(count, len(x), KEEPS), x)
    y = out[:, 1].reshape(count, -1)
    inner = np.abs(x[: len(x) // count, [0, 2]]).max(axis=1) < 0.03
    assert (np.diff(y[:, inner], axis=0) > 0.9 * GAP * KEEPS).all() and np.abs(out[:, [0, 2]] - x[:, [0, 2]]).max() == 0
    assert np.abs(y.sum(axis=0)[inner]).max() < count * KEEPS, "all went to one side"


def test_targets_that_are_in_order_stay():
    mesh, x = sheets(2)
    apart = x + heights(2, len(x), KEEPS)
    assert (led(StackOrder(mesh, len(x)), apart, apart) == apart).all()


def test_sides_are_remembered_from_step_to_step_and_by_checkpoints():
    """Sheets that have come through each other are led back to where they were; without memory they stay."""
    mesh, x = sheets(2)
    order = StackOrder(mesh, len(x))
    first, through = x + heights(2, len(x), KEEPS), x + heights(2, len(x), -KEEPS / 3)
    order.shift(first, np.arange(len(x)), first, np.tile([0.0, 1.0, 0.0], (len(x), 1)))
    order.commit(first, np.arange(len(x)))
    resumed = StackOrder(mesh, len(x))
    resumed.resume(order.checkpoint())
    inner = np.abs(x[: len(x) // 2, [0, 2]]).max(axis=1) < 0.03
    for one in (order, resumed):
        y = led(one, through, through)[:, 1].reshape(2, -1)
        assert (y[1] - y[0])[inner].min() > 0.9 * GAP * KEEPS
    order.commit(through, np.zeros(0, dtype=np.int64))  # nothing is pinched any more
    y = led(order, through, through)[:, 1].reshape(2, -1)
    assert (y[1] - y[0])[inner].max() < 0


def test_what_does_not_meet_has_no_order():
    mesh, x = sheets(2)
    mesh.particles_may_meet = lambda i, j: np.zeros(len(i), dtype=bool)
    assert (led(StackOrder(mesh, len(x)), x + heights(2, len(x), KEEPS), x) == x).all()
    mesh, x = sheets(2)
    mesh.half_thickness[: len(x) // 2] = 0.0  # cloth without contact
    assert (led(StackOrder(mesh, len(x)), x + heights(2, len(x), KEEPS), x) == x).all()
