"""Lists and rows that stay in a device's memory hold what those of the host do, and let it wait as seldom as they say."""

import gc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.counting import counted
from taichi_cloth.backend.device_arrays import Copies, Mirror, array
from taichi_cloth.backend.device_lists import DeviceLists, PrefixSums, lists
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.rows import Lists, read, write
from taichi_cloth.contact.cloth.candidate_rows import DeviceRows, HostRows
from taichi_cloth.contact.geometry import EDGE_EDGE, VERTEX_FACE
from taichi_cloth.system.constraints import Filter
from taichi_cloth.system.held import Held

KINDS = [(3, np.int32), (4, np.float64), (1, np.int32), (2, np.float64)]


@pytest.fixture(autouse=True)
def on_device(monkeypatch):
    runtime.start("cpu", "f64", 1)
    monkeypatch.setenv(runtime.LAYOUT, "device")


def filled(rng, pieces: int, room: int) -> Lists:
    """Lists of the host with rows in them."""
    host = Lists(pieces, room, KINDS)
    host.count[:] = rng.integers(0, room + 1, size=pieces)
    for to in host.arrays:
        to[:] = rng.integers(-99, 99, size=to.shape)
    return host


def put(device: DeviceLists, host: Lists) -> None:
    """A device's lists are as the host's."""
    device.count.from_numpy(host.count)
    for to, column in zip(device.arrays, host.arrays):
        to.from_numpy(column)


@pytest.mark.parametrize("pieces", [1, 7, 128, 1000])
def test_prefix_sums(rng, pieces):
    sums, count = PrefixSums(pieces), rng.integers(0, 9, size=pieces).astype(np.int32)
    sums.count.from_numpy(count)
    assert sums.make() == (count.max(), count.sum())
    assert (sums.first.to_numpy() == np.cumsum(count) - count).all()


@pytest.mark.parametrize("pieces, room", [(1, 5), (300, 4), (40, 30)])
def test_lists_are_as_the_hosts(rng, pieces, room):
    """On the device, or handed over by one launch; more than are expected by a second."""
    host = filled(rng, pieces, room)
    stays, goes = DeviceLists(pieces, room, KINDS, stay=True), DeviceLists(pieces, room, KINDS)
    for each in (stays, goes):
        put(each, host)
    with counted() as counts:
        assert not stays.grow()
    assert counts.waits == 1 and stays.total == host.count.sum()
    for _ in range(2):
        with counted() as counts:
            assert not goes.grow()
            found = goes.handed_over()
    assert counts.with_arrays == 1 and counts.waits == 2
    for wanted, there, handed in zip(host.joined(), stays.joined(), found):
        assert (there.to_numpy() == wanted).all() and (handed == wanted).all() and handed.dtype == wanted.dtype


def test_lists_get_room(rng):
    """As the host's do; a kernel writes again then."""
    host = filled(rng, 20, 4)
    host.count[3] = 9
    device = DeviceLists(20, 4, KINDS)
    put(device, host)
    assert device.grow() and host.grow() and [a.shape for a in device.arrays] == [a.shape for a in host.arrays]
    put(device, host)
    assert not device.grow() and device.total == host.count.sum()


def test_owners(rng):
    """The piece of each row, also where there is no row."""
    for most in (6, 0):
        host = Lists(90, 6, [(10, np.float64)])
        host.count[:] = rng.integers(0, most + 1, size=90)
        host.arrays[0][:] = rng.normal(size=host.arrays[0].shape)
        device = lists(90, 6, [(10, np.float64)])
        put(device, host)
        for ours, theirs in zip(device.owned(), host.owned()):
            assert ours.shape == theirs.shape and (ours == theirs).all()


def rows(rng, count: int) -> tuple:
    """Pairs, distances and radii."""
    pairs = np.column_stack([rng.integers(0, 9999, size=(count, 2)), rng.integers(0, 2, size=count)]).astype(np.int32)
    return pairs, *rng.uniform(size=(2, count)).astype(np.float32)


@pytest.mark.parametrize("known, found, part", [(5000, 70, 0.8), (9, 40, 0.3), (30, 0, 0.5), (30, 0, 0.0), (30, 12, 0.0)])
def test_candidates_that_stay_and_new_ones(rng, known, found, part):
    old, new = rows(rng, known), rows(rng, found)
    stays = (rng.uniform(size=known) < part).astype(np.int8)
    there = DeviceRows.none()
    for k in range(3):
        there.put(k, old[k])
    more = DeviceRows.none()
    for k in range(3 if found else 0):
        more.put(k, new[k])
    flags = there.numbers()
    flags.from_numpy(stays)
    with counted() as counts:
        there.replace(flags, more)
    assert counts.waits == 1
    assert there.read()[1].dtype == np.float32
    for mine, one, other in zip(there.read(), old, new):
        assert (mine == np.concatenate([one[stays == 1], other])).all() and len(mine) == len(there)


@pytest.mark.parametrize("kind", [HostRows, DeviceRows])
def test_candidates_as_they_are_stored(rng, kind):
    """16 bytes each. Numbers of earlier checkpoints, in f64, are rounded to where no pair is missed."""
    pairs, *numbers = rows(rng, 500)
    for exact in (rng.uniform(size=(2, 500)), numbers):
        there = kind.none()
        for k, values in enumerate((pairs, *exact)):
            there.put(k, values)
        mine, distances, radii = there.read()
        assert (mine == pairs).all() and set(pairs[:, 2]) == {VERTEX_FACE, EDGE_EDGE}
        rounds = exact[0].dtype == np.float64
        assert (distances < exact[0]).all() == rounds and (radii > exact[1]).all() == rounds
        assert np.abs(distances - exact[0]).max() < 1e-6 and np.abs(radii - exact[1]).max() < 1e-6
    widths = [2, 1, 1]
    assert [np.dtype(a.to_numpy().dtype if kind is DeviceRows else a.dtype).itemsize * w
            for a, w in zip(there.arrays, widths)] == [8, 4, 4]


def test_the_least_part(rng):
    """And the pairs that it is of, which alone come to the host."""
    known, part = rows(rng, 3000), np.ones(3000)
    there, host = DeviceRows.none(), HostRows.none()
    for k in range(3):
        there.put(k, known[k])
        host.put(k, known[k])
    for some in ([], [7], [0, 5, 2999]):
        part[some] = rng.uniform(size=len(some))
        numbers = there.numbers(np.float64)
        numbers.from_numpy(part)
        with counted() as counts:
            least, ids = there.least(numbers)
        assert counts.waits == (4 if some else 1)
        wanted = host.least(part)
        assert least == wanted[0] and (ids == wanted[1]).all() and len(ids) == np.count_nonzero(part < 1)


def test_a_mirror_is_written_where_it_changed(rng):
    mirror, numbers = Mirror(), rng.normal(size=(4, 3))
    for change, waits in ((0.0, 2), (0.0, 0), (1.0, 2)):
        numbers[1, 2] += change
        with counted() as counts:
            copy = mirror.of(numbers)
        assert counts.waits == waits and (copy.to_numpy() == numbers).all()
    assert (mirror.of(numbers[:2]).to_numpy() == numbers[:2]).all()
    assert (Mirror().of(np.arange(5.0)).to_numpy() == np.arange(5.0)).all()


def test_the_host_has_no_copies(monkeypatch):
    monkeypatch.setenv(runtime.LAYOUT, "cpu")
    numbers = np.zeros(3)
    assert Mirror().of(numbers) is numbers and type(lists(1, 1, KINDS)) is Lists


def test_what_is_held_crosses_over_once(rng, monkeypatch):
    """All of it; what follows from it has copies of its own."""
    held = Held.of([5, 7], rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3)), True, rng.normal(size=(2, 3)), np.float64)
    hold = Filter(None, SimpleNamespace(exchange=np.float64), None)
    host = held.arrays
    with counted() as counts:
        for _ in range(2):
            hold.bring(held)
    assert counts.waits == 2 and host[0] is held.index
    for copy, rows in zip(held.arrays, host):
        assert copy is not rows and (copy.to_numpy() == rows).all()
    assert replace(held, moving=False).arrays[1] is held.projector
    same, moved = (Held.of(held.index, held.projector, held.target + by, True, held.y, np.float64) for by in (0.0, 0.1))
    for other, waits in ((same, 0), (moved, 2), (held, 0)):
        with counted() as counts:
            hold.bring(other)
        assert counts.waits == waits and (other.arrays[2].to_numpy() == other.target).all()
    monkeypatch.setenv(runtime.LAYOUT, "cpu")
    other = replace(held, moving=False)
    Filter(None, SimpleNamespace(exchange=np.float64), None).bring(other)
    assert other.arrays[0] is held.index


def test_copies_live_as_long_as_their_originals():
    copies, host, other = Copies(), np.zeros(3), np.zeros(3)
    copies.keep(host, "there")
    assert copies.of(host) == "there" and copies.of(other) is other
    del host
    gc.collect()
    assert not copies._of


def test_a_number_goes_with_a_launch(monkeypatch):
    fields = Fields(np.float64)
    real, whole = fields.real(1, data=np.zeros(1)), fields.integer(1, data=np.zeros(1))
    fields.allocate()
    monkeypatch.setattr(runtime, "direct", False)
    with counted() as counts:
        write(real, np.array([0.1]))
        write(whole, np.array([7], dtype=np.int32))
    assert counts.waits == 0 and read(real)[0] == 0.1 and read(whole)[0] == 7
    fields.free()


def test_arrays_are_zero():
    for kind in (np.int8, np.int32, np.float32, np.float64):
        made = array(kind, 5, 2)
        assert made.shape == (5, 2) and (made.to_numpy() == 0).all() and made.to_numpy().dtype == kind
