"""Data and loops laid out for a device give the same steps, here on the CPU; no loop over a mesh is one thread's."""

import ast
import pathlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.counting import counted
from taichi_cloth.backend.rows import read
from taichi_cloth.errors import BackendError
from taichi_cloth.system.assembler import HostReport, Report

PACKAGE = pathlib.Path(__file__).parents[2] / "taichi_cloth"
FABRIC = tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100, 0.1), tc.Bend(5e-5))


def thrown() -> tc.Scene:
    """A sheet that nothing holds, at rest nowhere."""
    mesh, scene = tc.grid(1.0, 9), tc.Scene()
    scene.add_cloth(mesh, FABRIC, velocities=np.random.default_rng(3).normal(size=mesh.x.shape))
    return scene


def blown() -> tc.Scene:
    """A pillow with air in it, sewn round its rim: sums over all of the cloth, and a level that is solved exactly."""
    sheet, scene = tc.grid(0.3, 6), tc.Scene(gravity=None)
    n, x = sheet.vertex_count, np.concatenate([sheet.x, sheet.x - [0, 0.02, 0]])
    cloth = scene.add_cloth(tc.TriMesh(x, np.concatenate([sheet.faces, sheet.faces + n]), np.tile(sheet.uv, (2, 1))), FABRIC)
    scene.sew(cloth, sheet.groups["border"], sheet.groups["border"] + n)
    scene.inflate(cloth, 700.0, "isothermal", 0.001)
    return scene


def layered() -> tc.Scene:
    """Two sheets that lie on a ball and on each other."""
    mesh, scene = tc.grid(0.4, 8), tc.Scene()
    for k in range(2):
        scene.add_cloth(mesh, FABRIC, mesh.x + [-0.2, 0.2 + 0.006 + 0.008 * k, 0.2], contact=tc.ClothContact(0.01, 0.3))
    scene.add_solid(tc.Sphere(0.2), friction=0.3, thickness=0.005)
    return scene


def propped() -> tc.Scene:
    """A sheet that lies on edges and corners of a box."""
    mesh, scene = tc.grid(0.4, 8), tc.Scene()
    scene.add_cloth(mesh, FABRIC, mesh.x + [-0.21, 0.106, 0.19])
    scene.add_solid(tc.Box((0.2, 0.2, 0.2)), friction=0.3, thickness=0.005)
    return scene


CASES = {"thrown": (thrown, 2), "blown": (blown, 1), "layered": (layered, 3), "propped": (propped, 5)}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.slow
def test_steps_are_the_same(monkeypatch, case):
    """From the same state, to what sums in another order leave."""
    make, steps = CASES[case]
    out = {}
    for layout in ("cpu", "device"):
        monkeypatch.setenv(runtime.LAYOUT, layout)
        sim = tc.Simulation(make(), h=1 / 100, cg_tol=1e-13, integrator="backward_euler", preconditioner="multilevel")
        assert sim.model.blocks.serial == (layout == "cpu") and (sim.model.blocks.count > 8) == (layout == "device")
        records = [sim.step() for _ in range(steps)]
        out[layout] = sim.positions(), sim.velocities(), [(r.solves, r.contacts, r.layers, r.status) for r in records]
        sim.close()
    (x, v, told), (x_d, v_d, told_d) = out["cpu"], out["device"]
    assert told == told_d
    assert np.abs(x - x_d).max() < 1e-12 and np.abs(v - v_d).max() < 1e-10


@pytest.mark.slow
def test_pairs_with_edges_of_solids_are_looked_for_in_one_wait(monkeypatch):
    """Rows stay on a device, in as much room as they need; the host asks whether anything moved, and gets the pairs."""
    out = {}
    for layout in ("cpu", "device"):
        monkeypatch.setenv(runtime.LAYOUT, layout)
        sim = tc.Simulation(propped(), h=1 / 100, cg_tol=1e-13, integrator="backward_euler")
        for _ in range(4):
            sim.step()
        solids = sim.contacts.detector
        near = solids.pairs.near
        near.forget()
        near._room = near._array(3, 2)
        out[layout] = solids.find_pairs()
        assert near._room.shape[0] > 3
        with counted() as counts:
            again = solids.find_pairs()
        assert (counts.waits, counts.arrays) == (3, 2 if layout == "device" else 4)
        assert (again.key == out[layout].key).all() and (again.distance == out[layout].distance).all()
        sim.close()
    assert len(out["cpu"].key) > 10 and (out["cpu"].key == out["device"].key).all()
    assert np.abs(out["cpu"].distance - out["device"].distance).max() < 1e-12


def drawn() -> tc.Scene:
    """A sheet in a rising wind whose one side is led, pinned at the other side's ends, and drawn there between them."""
    mesh, scene = tc.grid(1.0, 16), tc.Scene(air=tc.Air(normal=0.5, wind=lambda t: (2 + 30 * t, 0.5, 1)))
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.move(cloth, "left", lambda t: (-0.5 * t, 0.2 * t, 3 * t * t), relative=True)
    middle = np.setdiff1d(mesh.groups["right"], mesh.groups["corners"])
    scene.move(cloth, middle, lambda t: (t, 0.3 * t, 0), relative=True, stiffness=40.0)
    scene.pin(cloth, "top_right")
    return scene


@pytest.mark.parametrize("integrator", ["tr_bdf2", "verlet"])
@pytest.mark.slow
def test_work_of_led_particles_and_errors_are_the_same(monkeypatch, integrator):
    """Sums over particles and over held ones, by one piece and by many: energies and the estimated error are those of the
    CPU's layout to rounding, and the same bit for bit from run to run."""
    out = []
    for layout in ("cpu", "device", "device"):
        monkeypatch.setenv(runtime.LAYOUT, layout)
        sim = tc.Simulation(drawn(), h=1 / 200, integrator=integrator, preconditioner="block_jacobi",
                            **({"tolerance": 1e-2, "cg_tol": 1e-12} if integrator == "tr_bdf2" else {"h_min": 1 / 400}))
        assert sim.model.blocks.pieces == (1 if layout == "cpu" else sim.model.blocks.count)
        records = [sim.step() for _ in range(4)]
        out.append((sim.positions(), [r.ledger for r in records], [r.error for r in records]))
        sim.close()
    (x, ledgers, errors), (x_d, ledgers_d, errors_d), again = out
    assert np.abs(x - x_d).max() < 1e-12
    assert (again[0] == x_d).all() and again[1:] == (ledgers_d, errors_d)
    for one, other in zip(ledgers, ledgers_d):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)
    assert min(abs(ledger["pins"]) for ledger in ledgers) > 1e-3
    if integrator == "tr_bdf2":
        assert errors_d == pytest.approx(errors, rel=1e-9) and min(errors) > 1e-6


MOVES = {"Clusters._settle", "Filter.lead", "ParticleState._restore", "System._go_to_guess", "System._place", "System._shift",
         "TRBDF2._base", "Verlet.lead", "Verlet.move"}  # who launches these tells the model: see `ParticleState.moved`


def sets_places(node: ast.AST) -> bool:
    """Whether it assigns to rows of x or v of a model."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
    rows = [t.value for t in targets if isinstance(t, ast.Subscript)]
    return any(isinstance(r, ast.Attribute) and r.attr in ("x", "v") and ast.unparse(r.value).endswith("model") for r in rows)


def test_all_that_moves_is_known():
    """By syntax: `ParticleState` is their owner, and names them `self`."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for owner in (n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ClassDef)):
            for made in (n for n in owner.body if isinstance(n, ast.FunctionDef)):
                mine = owner.name == "ParticleState" and "self.x[i] = " in ast.unparse(made)
                if mine or any(map(sets_places, ast.walk(made))):
                    found.add(f"{owner.name}.{made.name}")
    assert found == MOVES


@pytest.mark.parametrize("case", ["blown", "layered", "drawn", "explicit"])
@pytest.mark.slow
def test_places_that_the_host_knows_are_those_of_the_device(monkeypatch, case):
    """They cross over where anything moved alone. Those of the saved state are known with them."""
    monkeypatch.setenv(runtime.LAYOUT, "device")
    given = {"integrator": {"drawn": "tr_bdf2", "explicit": "verlet"}.get(case, "backward_euler")}
    sim = tc.Simulation({"blown": blown, "layered": layered}.get(case, drawn)(), h=1 / 100, **given)
    model, asked = sim.model, []
    for name, fields in (("read_particles", (model.x, model.v)), ("read_saved", (model.x_saved, model.v_saved))):
        def checked(name=name, fields=fields):
            known = getattr(type(model), name)(model)
            asked.append(name)
            assert all((a == read(field)).all() for a, field in zip(known, fields)), name
            known[0][:] = np.nan  # a copy
            return getattr(type(model), name)(model)

        monkeypatch.setattr(model, name, checked)
    for _ in range(3):
        sim.step()
    sim.model.restore()
    assert np.isfinite(model.read_particles()[0]).all() and np.isfinite(model.read_saved()[0]).all() and len(asked) > 2
    with counted() as counts:
        for _ in range(3):
            type(model).read_particles(model)
    assert counts.waits == 0
    sim.close()


def test_a_report_of_many_blocks(rng):
    """Sums and largest numbers, also of negative ones, by as many groups and by more than there are rows."""
    run = runtime.start("cpu", "f64", 1)
    for blocks in (1, 7, 700):
        numbers = rng.normal(size=(blocks, 40)) - np.tile([0.0, 9.0, 0.0, 99.0], 10)
        host, device, some = (made(blocks, 40, peaks, run) for made, peaks in ((HostReport, []), (Report, list(range(40))),
                                                                              (Report, [3, 31])))
        host.rows[:] = numbers
        device.rows.from_numpy(numbers)
        some.rows.from_numpy(numbers)
        with counted() as counts:
            sums, peaks = some.columns()
        assert (counts.with_arrays, counts.waits) == (0, 2)  # 42 numbers, of which 32 come at once
        assert np.abs(host.columns()[0] - sums).max() < 1e-10 and (device.columns()[0] == sums).all()
        assert (device.columns()[1] == numbers.max(axis=0)).all() and (host.columns()[1] == numbers.max(axis=0)).all()
        assert (peaks[[3, 31]] == numbers.max(axis=0)[[3, 31]]).all() and np.count_nonzero(peaks) == 2


@pytest.mark.slow
def test_the_level_that_is_solved_exactly_is_inverted_on_a_device(monkeypatch):
    """As the host inverts it, with particles held in some directions, in all or in none; not again where all is as before."""
    monkeypatch.setenv(runtime.LAYOUT, "device")
    scene = blown()
    scene.pin(scene.cloths[0], [0, 3], "x")
    scene.pin(scene.cloths[0], 24)
    sim = tc.Simulation(scene, h=1 / 100, integrator="backward_euler", preconditioner="multilevel")
    sim.step()
    coarse = sim.integrator.system.preconditioner.coarsest
    k = coarse.count

    def blocks() -> np.ndarray:
        return read(coarse.inverse).reshape(k, k, 3, 3).transpose(0, 2, 1, 3).reshape(3 * k, 3 * k)

    wanted = coarse._inverted()
    assert coarse.pressed.any() and np.abs(blocks() - wanted).max() < 1e-9 * np.abs(wanted).max()
    with counted() as counts:
        coarse.make(coarse.span, None)
        assert (counts.waits, counts.kernels["DeviceCoarse._eliminate"]) == (1, 0)
        coarse._hold(None, True)
    assert (counts.waits, counts.kernels["DeviceCoarse._eliminate"]) == (3, -(-k // 4))
    bad = coarse.matrix.copy()
    bad[7, 7] = -10 * np.abs(bad).max()
    coarse.matrix = bad  # then the host leaves a direction out
    coarse._hold(None, True)
    assert np.abs(blocks()).max() > 0 and np.abs(blocks() - coarse._inverted()).max() < 1e-9 * np.abs(blocks()).max()
    sim.close()


def test_no_other_layout(monkeypatch):
    monkeypatch.setenv(runtime.LAYOUT, "gpu")
    with pytest.raises(BackendError, match=f"{runtime.LAYOUT} 'gpu'.*known: cpu, device"):
        tc.Simulation(thrown())


ONE_THREAD = {  # functions with a loop that one thread goes through, and over what
    "backend/bvh.py: merge": "the nodes of a tree, on a CPU alone",
    "backend/phases.py: start": "blocks, on a CPU alone",
    "solver/pcg.py: _step": "nothing: a sum's groups within it",
    "solver/pcg.py: residual": "the same",
    "solver/recurrences.py: total": "groups of blocks on a device, blocks on a CPU"}


def one_thread(function: ast.FunctionDef) -> bool:
    """Whether a kernel or a function of kernels asks for a loop on one thread, by one of the ways to write that."""
    for node in ast.walk(function):
        if isinstance(node, ast.For) and ast.unparse(node.iter) == "range(1)":
            return True
        if isinstance(node, ast.keyword) and node.arg == "serialize" and not isinstance(node.value, ast.Attribute):
            return True  # also a comparison: a compiler may take it for an expression, which is true
    kernel = any(ast.unparse(d) == "ti.kernel" for d in function.decorator_list)
    branches = [s for s in function.body if isinstance(s, (ast.If, ast.While)) and "ti.static" not in ast.unparse(s.test)]
    return kernel and any(isinstance(inner, (ast.For, ast.While)) for s in branches for inner in ast.walk(s))


def functions(text: str) -> list[ast.FunctionDef]:
    """Those that are compiled."""
    return [f for f in ast.walk(ast.parse(text)) if isinstance(f, ast.FunctionDef)
            and {ast.unparse(d) for d in f.decorator_list} & {"ti.kernel", "ti.func"}]


def test_no_loop_over_a_mesh_is_one_threads():
    """On a GPU such a loop takes longer than all others together."""
    texts = {path.relative_to(PACKAGE).as_posix(): path.read_text() for path in PACKAGE.rglob("*.py")}
    found = {f"{name}: {f.name}" for name, text in texts.items() for f in functions(text) if one_thread(f)}
    assert sum(len(functions(text)) for text in texts.values()) > 400
    assert found == set(ONE_THREAD)


@pytest.mark.parametrize("loop", ["ti.loop_config(serialize=n == 1)\n    for i in range(n):\n        x[i] = 0",
                                  "ti.loop_config(serialize=True)\n    for i in range(n):\n        x[i] = 0",
                                  "for _ in range(1):\n        for i in range(n):\n            x[i] = 0",
                                  "if n > 3:\n        for i in range(n):\n            x[i] = 0"])
def test_ways_to_write_one(loop):
    [made] = functions(f"@ti.kernel\ndef f(n: int):\n    {loop}\n")
    [free] = functions("@ti.kernel\ndef f(n: int):\n    ti.loop_config(serialize=a.s)\n    for i in range(n):\n        x()\n")
    assert one_thread(made) and not one_thread(free)
