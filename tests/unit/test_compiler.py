"""The compiler of kernels is chosen by the environment; each gives the same positions and keeps its kernels by itself."""

import os
import subprocess
import sys
import types

import numpy as np
import pytest
from conftest import shared_data

import taichi_cloth as tc
from taichi_cloth.backend import compiler, kernel_cache, taichi_patches
from taichi_cloth.forces import build_forces
from taichi_cloth.sweeps import plan

FORKS = ("taichi_forge", "quadrants")
SMOKE = """
import json
import pathlib
import sys
import numpy as np
import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.system import assembler

assembler.FUSED = False  # less to compile
out, folder = {}, sys.argv[2]
for name, settings in (("hang", {}), ("swing", {}), ("sphere_drape", {"height": 0.001})):
    scene = scenefile.read(name)
    options = {key: value for key, value in scene.run.items() if key not in ("duration", "fps")}
    sim = tc.Simulation(scene.build(cells=8, **settings), threads=1, **options)
    for _ in range(4):
        sim.step()
    assert name != "sphere_drape" or max(r.contacts for r in sim.log) > 0
    out[f"{name}_x"], out[f"{name}_v"], out["notes"] = sim.positions(), sim.velocities(), sim.notes
if folder:
    case = json.loads((pathlib.Path(folder) / "validation" / "golden" / "grid_small.json").read_text())
    p = case["params"]
    fabric = tc.Fabric(p["density"], tc.Stretch(tuple(p["k_stretch"]), tuple(p["kd_stretch"])),
                       tc.Shear(p["k_shear"], p["kd_shear"]), tc.Bend(p["k_bend"], p["kd_bend"]))
    scene = tc.Scene(gravity=p["gravity"])
    scene.add_cloth(tc.TriMesh(case["x"], case["triangles"], case["uv"]), fabric, velocities=case["v"])
    sim = tc.Simulation(scene, K="gauss_newton", cg_tol=1e-13, adaptive=False, threads=1)
    held = [tc.Constraint(c["vertex"], c["prohibited"], c["z"], c.get("y", (0, 0, 0))) for c in case["constraints"]]
    out["golden"], out["wanted"] = sim.solve(case["h"], held), np.array(case["step_gauss_newton"]["dv"])
np.savez(sys.argv[1], **out)
"""
OUTGROWN = """
import sys
import numpy as np
from taichi_cloth import ti
from taichi_cloth.backend import runtime, shared_kernels
from taichi_cloth.backend.fields import Fields

@ti.data_oriented
class First:
    def take(self, value):
        fields = Fields(np.float64, pooled=True)
        self.field = fields.real(1, data=np.array([value]))
        fields.allocate()
        self.all = getattr(self, "all", []) + [fields]

    @ti.kernel
    def add(self, numbers: ti.types.ndarray(), times: float) -> float:
        out = times * self.field[0]
        for i in range(numbers.shape[0]):
            out += numbers[i]
        return out

runtime.start("cpu", "f64", 1)
first, seen, numbers = First(), [], np.ones(4)
for value in (1.0, 2.0):
    first.take(value)
    shared_kernels.look_again()
    seen += [first.add(numbers, np.float64(2.0)), first.add(numbers, 3.0)]
numbers.resize(400, refcheck=False)  # as pairs of layers are
np.savez(sys.argv[1], seen=seen)
"""
FREE = """
import sys
import numpy as np
import taichi_cloth as tc
from taichi_cloth.backend import compiler

def drop():
    scene = tc.Scene()
    scene.pin(scene.add_cloth(tc.grid(0.3, 3), tc.Fabric(0.2, tc.Stretch(300.0))), "top_left")
    return tc.Simulation(scene, h=1 / 200, integrator="verlet", threads=1)

if "public" in sys.argv:
    compiler.private = lambda *places: [None] * len(places)
first, second = drop(), drop()
for _ in range(3):
    first.step()
    second.step()
assert np.array_equal(first.positions(), second.positions())
np.savez(sys.argv[1], x=first.positions(), notes=first.notes)
"""


def run(folder, code: str, *words: str, cache=None, **environment: str) -> dict[str, np.ndarray]:
    """Arrays that a process of its own leaves behind."""
    out, script = folder / "out.npz", folder / "code.py"  # Taichi reads kernels from files
    script.write_text(code)
    environment |= {"TI_OFFLINE_CACHE_FILE_PATH": str(cache)} if cache else {}
    done = subprocess.run([sys.executable, str(script), str(out), *words], env=os.environ | environment, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(np.load(out))


def choose(monkeypatch, name: str) -> None:
    """The compiler is another from now on, for those that ask for its name."""
    monkeypatch.setattr(compiler, "chosen", lambda: compiler.COMPILERS[name])


def chosen(monkeypatch, name: str, *installed: str) -> compiler.Compiler:
    """The compiler that is chosen by name where these are installed."""
    monkeypatch.setenv("TAICHI_CLOTH_COMPILER", name)
    monkeypatch.setattr(compiler.importlib.util, "find_spec", lambda package: package in installed or None)
    return compiler.chosen.__wrapped__()


def test_the_environment_chooses(monkeypatch):
    assert chosen(monkeypatch, "", "taichi").name == "taichi"
    assert chosen(monkeypatch, "quadrants", "taichi", "quadrants").name == "quadrants"
    with pytest.raises(tc.BackendError, match="^TAICHI_CLOTH_COMPILER: .*'taichi_forg'; did you mean 'taichi_forge'"):
        chosen(monkeypatch, "taichi_forg", "taichi")
    with pytest.raises(tc.BackendError, match=r"taichi_forge is not installed: pip install 'taichi-cloth\[forge\]', or set"
                                              " it to taichi or quadrants$"):
        chosen(monkeypatch, "taichi_forge", "taichi", "quadrants")
    with pytest.raises(tc.BackendError, match="taichi is not installed: pip install taichi$"):
        chosen(monkeypatch, "taichi")


def test_a_wrong_choice_is_one_line_on_the_command_line(tmp_path):
    done = subprocess.run([sys.executable, "-m", "taichi_cloth", "run", "hang", "--out", str(tmp_path / "out")], check=False,
                          env=os.environ | {"TAICHI_CLOTH_COMPILER": "numba"}, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "TAICHI_CLOTH_COMPILER" in done.stderr
    assert not (tmp_path / "out").exists()


def test_runs_of_different_compilers_are_told_apart(monkeypatch):
    def build() -> tc.Scene:
        return tc.Scene()

    def key() -> str:
        return plan.runs_of(build, {}, {}, {})[0].key

    def version() -> str:
        return compiler.version(types.SimpleNamespace(__version__=(1, 2, 3)))

    keys, versions, folders = set(), set(), set()
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", "somewhere")
    for name in ("taichi", *FORKS):
        choose(monkeypatch, name)
        keys.add(key())
        versions.add(version())
        folders.add(kernel_cache._folder(name))
    assert len(keys) == len(versions) == len(folders) == 3 and "1.2.3" in versions


def test_arguments_that_a_compiler_does_not_know_are_left_out(monkeypatch):
    choose(monkeypatch, "taichi")
    assert compiler.options({"cfg_optimization": False, "not_there": 1}) == {"cfg_optimization": False}
    choose(monkeypatch, "taichi_forge")
    assert compiler.options({"not_there": 1})["compile_tier"] == "full"


def test_a_law_in_the_language_of_another_compiler_is_refused(monkeypatch):
    @tc.ti.data_oriented
    class Pull:
        def __init__(self, fields, model, scene, mode) -> None: ...

        @tc.ti.func
        def force(self, x: float) -> float:
            return x

    scene = tc.Scene(gravity=(0, 0, 0))
    scene.add_force(Pull)
    assert compiler.foreign(Pull) == "" and build_forces(None, None, scene, "gauss_newton")
    name = compiler.chosen().name
    choose(monkeypatch, next(other for other in compiler.COMPILERS if other != name))
    with pytest.raises(tc.SceneError, match=f"^Pull: is written in {name}'s language.*from taichi_cloth import ti"):
        build_forces(None, None, scene, "gauss_newton")


@pytest.mark.parametrize("patches", ["0", "1"])
def test_kernels_are_compiled_for_fields_that_replace_others(tmp_path, patches):
    assert run(tmp_path, OUTGROWN, TAICHI_CLOTH_PATCHES=patches)["seen"].tolist() == [6, 7, 8, 10]


@pytest.mark.slow
def test_no_private_part_of_a_compiler_is_needed(tmp_path):
    usual, bare = run(tmp_path, FREE), run(tmp_path, FREE, "public")
    assert np.array_equal(usual["x"], bare["x"]) and len(usual["notes"]) == bool(taichi_patches.LACKS)
    assert "launches are slower" in bare["notes"][0] and "lang.snode:get_addr" in bare["notes"][0]


@pytest.fixture(scope="module")
def ours(tmp_path_factory) -> dict[str, np.ndarray]:
    """The smoke set by Taichi."""
    if not compiler.COMPILERS["taichi"].installed:
        pytest.skip("taichi is not installed")
    return smoke(tmp_path_factory.mktemp("taichi"), "taichi")


def smoke(folder, name: str) -> dict[str, np.ndarray]:
    """Two free scenes, one in contact and, where there is reference data, a step of a golden case; by a compiler."""
    quick = {compiler.COMPILERS[name].prefix + "OPT_LEVEL": "0"}
    return run(folder, SMOKE, str(shared_data() or ""), cache=folder / "cache", TAICHI_CLOTH_COMPILER=name, **quick)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORKS)
def test_a_fork_runs_the_smoke_set(tmp_path, name, ours):
    """Positions and velocities are Taichi's but for rounding, a step is the reference's, and kernels are kept apart."""
    if not compiler.COMPILERS[name].installed:
        pytest.skip(f"{name} is not installed")
    assert run(tmp_path, OUTGROWN, TAICHI_CLOTH_COMPILER=name)["seen"].tolist() == [6, 7, 8, 10]
    theirs = smoke(tmp_path, name)
    for key in (key for key in ours if key[-2:] in ("_x", "_v")):
        assert np.abs(theirs[key] - ours[key]).max() < (1e-12 if key.endswith("_x") else 1e-10), key
    for found in (ours, theirs):
        if "golden" in found:
            assert np.abs(found["golden"] - found["wanted"]).max() < 1e-9 * np.abs(found["wanted"]).max()
    assert [entry.name for entry in (tmp_path / "cache").iterdir()] == [name]
