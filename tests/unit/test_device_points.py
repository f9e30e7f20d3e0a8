"""Points of contact that a device has are taken from there, beside others that cross over."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.counting import counted
from taichi_cloth.backend.device_arrays import array
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.rows import read
from taichi_cloth.contact.device_points import DevicePoints, Resident
from taichi_cloth.contact.points import CORNERS, ContactRows

pytestmark = pytest.mark.restarts
ENTRIES, BLOCKS = 40, 5


@pytest.fixture
def there(monkeypatch):
    """Fields as a `ContactForce` has them."""
    monkeypatch.setenv(runtime.LAYOUT, "device")
    runtime.start("cpu", "f64", 1)
    fields = Fields(np.float64)
    made = {"first": fields.integer(BLOCKS + 1), "vertices": fields.integer(ENTRIES, CORNERS)}
    widths = {"weights": CORNERS, "A": 6, "rhs": 3, "normal": 3, "rotation_coupling": 3 * CORNERS}
    made |= {name: fields.real(ENTRIES, width) for name, width in widths.items()}
    fields.allocate()
    yield SimpleNamespace(**made, layered=True, exchange=np.float64)
    fields.free()


def some(rng, k: int) -> ContactRows:
    return ContactRows(rng.integers(0, 99, size=(k, CORNERS)), *(rng.normal(size=shape) for shape in (
        (k, CORNERS), (k, 6), (k, 3), (k, 3), (k, CORNERS, 3))))


def on_device(p: ContactRows) -> ContactRows:
    """The same, with copies there, and nothing to be read here."""
    copies = []
    for rows, kind in ((p.vertices, np.int32), *((rows, np.float64) for rows in (
            p.weights, p.block, p.rhs, p.normal, p.rotation_coupling))):
        copies.append(array(kind, *rows.shape))
        copies[-1].from_numpy(np.ascontiguousarray(rows, dtype=kind))
    return replace(p, resident=Resident(tuple(copies), len(p.rhs)))


@pytest.mark.parametrize("before, after", [(0, 0), (0, 3), (2, 0), (2, 3)])
def test_points_that_a_device_has_stay_there(rng, there, before, after):
    """Wherever they are among others, as if all crossed over; less crosses over."""
    hands = DevicePoints(there, CORNERS)
    mine, *others = some(rng, 7), some(rng, before), some(rng, after)
    first, entries = np.array([0, 9, 9, 20, 31, ENTRIES]), rng.integers(0, 7 + before + after, size=ENTRIES)
    out, size = [], []
    for middle in (mine, on_device(mine)):
        with counted() as counts:
            hands.put(ContactRows.join([others[0], middle, others[1]]), entries, first)
        assert counts.waits == 2
        out.append([read(f) for f in vars(there).values() if hasattr(f, "rows")])
        size.append(counts.size)
    assert len(out[0]) == 7 and all((a == b).all() for a, b in zip(*out)) and size[1] < 0.7 * size[0]
    assert (out[0][0] == first).all() and (out[0][1] == np.concatenate(
        [others[0].vertices, mine.vertices, others[1].vertices])[entries]).all()


def test_no_points_take_no_launch(there):
    with counted() as counts:
        DevicePoints(there, CORNERS).put(ContactRows.none(), np.zeros(0, dtype=int), np.zeros(BLOCKS + 1, dtype=int))
    assert counts.launches == 0 and not read(there.first).any()
