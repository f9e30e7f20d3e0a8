"""The benchmarks in scripts/ run, on meshes far too small to say anything, and write tables that can be laid side by side."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from inside import ROOT, call_script

import taichi_cloth as tc
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings
from taichi_cloth.system import assembler

pytestmark = pytest.mark.slow

BENCHES = {
    "bench_product": ["--sizes", "9", "--precision", "f64", "--rounds", "1"],
    "bench_solver": ["--sizes", "9", "--meshes", "slit", "--rounds", "1", "--direct-rounds", "1"],
    "bench_scaling": ["--sizes", "9", "13", "--steps", "1", "--threads", "1", "2"],
    "count_launches": ["--scenes", "hang cells=8", "--begin", "0", "--steps", "1", "--kernels", "3"],
    "bench_contact": ["--cells", "8", "--scenes", "sphere_drape", "--until", "0.05", "--rounds", "1"],
    "bench_growth": ["--cells", "6", "8", "--until", "0.05"],
    "bench_layers": ["--scenes", "fold", "--until", "0.05", "--cells", "6", "--drape", "8", "--rounds", "1"],
    "study_cg_tol": ["--scenes", "swing", "--tolerances", "1e-1", "1e-3", "--until", "0.1"],
    "study_impacts": ["--scenes", "sheets", "--steps", "60", "--parts", "4", "--tolerances", "1e-2", "--fine", "0.01",
                      "--until", "0.15"],
}


@pytest.mark.parametrize("name", BENCHES)
def test_a_benchmark_runs_and_its_tables_compare(name, tmp_path):
    pytest.importorskip("scipy", reason="the benchmarks need the extra bench")
    file = tmp_path / "table.json"
    done = call_script(ROOT / "scripts" / f"{name}.py", *BENCHES[name], "--json", file)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") >= 2 and json.loads(file.read_text())
    done = call_script(ROOT / "scripts" / "bench_compare.py", file, file)
    assert done.returncode == 0, done.stderr


def test_steps_are_timed_from_states_that_were_kept(tmp_path):
    script, states, file = ROOT / "scripts" / "bench_states.py", tmp_path / "states.npz", tmp_path / "table.json"
    done = call_script(script, "save", "layers", "--set", "cells=6", "--frames", "2", "4", "--file", states)
    assert done.returncode == 0, done.stderr
    done = call_script(script, "time", states, "--json", file)
    assert done.returncode == 0, done.stderr
    *rows, total = json.loads(file.read_text())["rows"]
    assert [row["frame"] for row in rows] == [2, 4] and total["frame"] == "all"
    assert total["steps"] == sum(row["steps"] for row in rows) >= 4 and total["wall"] >= total["CG"] > 0


def test_the_dance_names_what_is_absent_and_runs_where_it_is(tmp_path, shared):
    done = call_script(ROOT / "scripts" / "bench_dance.py", "--data", tmp_path)
    assert done.returncode == 1 and "skirt: left out" in done.stderr and f"{tmp_path / 'skirt.obj'}: not there" in done.stderr
    if not (shared / "data" / "body_dance.npz").is_file():
        pytest.skip("the dance of the reference data is not there")
    file = tmp_path / "table.json"
    done = call_script(ROOT / "scripts" / "bench_dance.py", "--data", shared / "data", "--garments", "skirt", "--frames", "2",
                       "--json", file)
    assert done.returncode == 0, done.stderr
    row, = json.loads(file.read_text())["rows"]
    assert row["frames"] == 2 and row["counted"] == 2 and row["smallest_h"] > 0 and not row["problem"]
    assert row["with_body"] == row["with_itself"] == 0 and "sim.log[" in done.stdout


def test_flat_panels_hang_clear_of_the_body_and_of_each_other(shared, monkeypatch):
    """The dress of the reference data, before it is put on: counted from positions."""
    if not (shared / "data" / "dress_pattern.obj").is_file():
        pytest.skip("the dress of the reference data is not there")
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import bench_dance

    made, body = bench_dance.hung(shared / "data"), tc.load_solid(shared / "data" / "body_dance.npz")
    x, faces = made.positions, made.mesh.faces
    assert count_self_crossings(x, faces) == 0 and count_crossings(x, faces, body.x[0], bench_dance.filled(body.faces)) == 0
    sleeve = x[made.mesh.groups["panel13"]]
    assert len(made.seams) == 1058 and made.gap() < 0.4 and np.ptp(sleeve[:, 1]) > 0.07  # round the arm, not above it


def test_peers_in_contact_name_who_is_absent(tmp_path):
    """Ours has a row with all columns; each peer has one too, or a line that says why not."""
    file = tmp_path / "table.json"
    done = call_script(ROOT / "scripts" / "bench_peers.py", "--contact", "--sizes", "9", "--until", "0.2", "--peers", "pyPBD",
                       "Blender", "--json", file)
    assert done.returncode == 0, done.stderr
    rows = {row["system"]: row for row in json.loads(file.read_text())["rows"]}
    columns = {"scene", "n", "about", "setup", "wall", "cpu", "crossings", "stretch", "gap", "height", "speed"}
    assert columns <= set(rows["ours"])
    assert rows["ours"]["crossings"] == 0 and rows["ours"]["wall"] > 0 and 0 < rows["ours"]["stretch"] < 5
    for name in ("pyPBD", "Blender"):
        assert (name in rows) != (f"{name}: left out, " in done.stderr)


def test_a_row_of_peers_in_contact_counts(monkeypatch):
    """A sheet folded through itself, one vertex inside the ball, one edge pulled to twice its length."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import peers_contact

    task = peers_contact.plan("drape", 5, 1.0)
    made = {"x": task["x"].copy(), "about": "", "setup": 0.0, "wall": 2.0, "cpu": 3.0}
    flat = peers_contact.row("drape", "none", task, made)
    assert flat["crossings"] == 0 and abs(flat["stretch"]) < 1e-9 and flat["wall"] == 2.0 and abs(flat["height"]) < 1e-12
    assert flat["gap"] == pytest.approx(0.055)
    made["x"][12] = 0, 0.28, 0  # the middle, over the centre of the ball
    made["x"][0] = made["x"][18] + [0.01, -0.1, 0.02]  # a corner through another cell
    bent = peers_contact.row("drape", "none", task, made)
    assert bent["crossings"] > 0 and bent["gap"] == pytest.approx(-0.02)
    assert bent["stretch"] > 50 and bent["height"] == pytest.approx(np.ptp(made["x"][:, 1]))
    assert len(peers_contact.plan("layers", 5, 1.0)["x"]) == 75


def test_peers_on_a_slope_are_held_against_coulombs_law(monkeypatch):
    """Ours keeps all of the speed that it allows, without friction and with some; of another sheet half of it is counted."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import peers_contact
    from baselines import contact

    for scene in ("slip", "slide"):
        task = peers_contact.plan(scene, 5, 0.4)
        row = peers_contact.row(scene, "ours", task, contact.timed(peers_contact.ours, task | {"until": 0.1}, task))
        assert row["speed"] == pytest.approx(100, abs=0.1) and row["gap"] == pytest.approx(0.005, abs=1e-6)
        assert row["crossings"] == 0 and row["stretch"] < 0.1
    angle = np.radians(20)
    half = 0.5 * 9.81 * (np.sin(angle) - 0.2 * np.cos(angle)) * np.array([np.cos(angle), -np.sin(angle), 0])
    t = np.arange(21)[:, None, None] * 0.02
    x = task["x"] + 0.5 * half * t**2
    made = {"x": x[20], "went": np.diff(x, axis=0)[[9, 19]], "frame": 0.02, "frames": 20, "about": "", "setup": 0.0,
            "wall": 1.0, "cpu": 1.0}
    assert peers_contact.row("slide", "half", task, made)["speed"] == pytest.approx(50)


def test_studies_of_contact_run(tmp_path):
    """Tables with a row for each way, on a scene too short to say anything; what changes nothing has all digits the same."""
    scripts, file = ROOT / "scripts", tmp_path / "rows.json"
    short = ["--scenes", "sphere_drape", "--until", "0.02", "--json", file]
    done = call_script(scripts / "study_rules.py", *short, "--without", "none: contact.step_start.OFTEN=2")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 5 and " | none | " in lines[3] and " | 0 | 16.0 | " in lines[3]
    assert [row["label"] for row in json.loads(file.read_text())["rows"]] == ["as it is", "none", "as it is, cg_tol 1e-6"]
    done = call_script(scripts / "study_converged.py", *short)
    assert done.returncode == 0, done.stderr
    assert len({row["label"] for row in json.loads(file.read_text())["rows"]}) == 4 == done.stdout.count("| sphere_drape |")


def test_laws_of_contact_are_a_table(tmp_path):
    file = tmp_path / "table.md"
    done = call_script(ROOT / "scripts" / "contact_laws.py", "plane_sticks", "--starts", "2", "--steps", "1/60", "1/30",
                       "--out", file)
    assert done.returncode == 0, done.stderr
    rows = file.read_text().splitlines()[2:]
    assert len(rows) == 4 and all(row.endswith("| 2 of 2 |") for row in rows) and rows[0] in done.stdout
    done = call_script(ROOT / "scripts" / "contact_laws.py", "no_such")
    assert done.returncode == 2 and "no case no_such; there are " in done.stderr


def test_changes_name_what_is_there_and_are_taken_back(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import study_converged
    import study_rules
    from changed import changed, digits, owner

    for changes in (*study_rules.RULES.values(), study_converged.TIGHT):
        before = [getattr(owner(where), name) for where, name, _ in changes]
        with changed(changes):
            assert [getattr(owner(where), name) for where, name, _ in changes] == [value for *_, value in changes]
        assert [getattr(owner(where), name) for where, name, _ in changes] == before
    label, changes = study_rules.read("both: contact.step_start.OFTEN=9, contact.cloth.layers.Layers.ROUNDS=8")
    assert label == "both"
    assert changes == [("contact.step_start", "OFTEN", 9), ("contact.cloth.layers.Layers", "ROUNDS", 8)]
    with pytest.raises(SystemExit, match="has no OFFTEN of its own"), changed([("contact.step_start", "OFTEN", 9),
                                                                              ("contact.step_start", "OFFTEN", 9)]):
        pass
    assert owner("contact.step_start").OFTEN != 9
    with pytest.raises(SystemExit, match="no module or class contact.nothing"):
        owner("contact.nothing")
    x = np.array([[0.0, 0, 0], [1, 0, 0]])
    assert digits(x, x) == 16 and digits(x, x + [1e-4, 0, 0]) == pytest.approx(4)


def test_damping_as_an_energy_and_a_matrix_by_state_converge_from_anywhere():
    """Of the ways of `study_newton.py` that one alone reaches 1e-6 in all cases, in 24 iterations; the product's does not."""
    done = call_script(ROOT / "scripts" / "study_newton.py", "--cells", "8")
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[2:-1] for line in done.stdout.splitlines() if line.startswith("| ")][1:]
    missed = [sum(row[k].split(",")[1].strip() == "-" for row in rows) for k in range(5)]
    assert len(rows) == 6 and missed[4] == 0 and min(missed[:4]) > 0 and missed[0] >= 2


def test_a_step_goes_through_no_more_than_the_page_on_architecture_states(monkeypatch):
    """No more files; functions and calls a solve, which rounding can change by a contact, within 2 % and a tenth."""
    monkeypatch.setattr(assembler, "FUSED", True)  # as outside of tests
    done = call_script(ROOT / "scripts" / "trace_step.py", "--calls")
    assert done.returncode == 0, done.stderr
    for wrapper in ("launches.py: call", "timing.py: part"):
        assert done.stdout.count(f"-> backend/{wrapper}") >= 3, f"{wrapper} is part of a step"
    now, stated = (rows_of_steps(text) for text in (done.stdout, (ROOT / "docs" / "architecture.md").read_text()))
    assert "upward" not in done.stdout and len(now) == 3 and now.keys() == stated.keys()
    for name, (solves, files, calls, functions) in now.items():
        at_most = stated[name]
        assert files <= at_most[1] and functions <= 1.02 * at_most[3], f"{name}: update docs/architecture.md, or call less"
        assert calls / solves <= 1.1 * at_most[2] / at_most[0], name


def rows_of_steps(text: str) -> dict[str, list[int]]:
    """Rows of the table of steps: solves, files, calls and functions by name."""
    table = text[text.index("| one step |"):].split("\n\n")[0].splitlines()[2:]
    cells = [line.strip("| ").split(" | ") for line in table if line.startswith("|")]
    return {name: [int(number) for number in numbers] for name, *numbers in cells}


def test_a_report_of_a_device_names_its_parts_and_keeps_to_its_budget(monkeypatch):
    """Each is a function; what layers start from is made before; one that takes too long, or fails, is a row that says so."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import device_report

    args = SimpleNamespace(small=False, large=True, arch="cpu", precision="f64", folder="")
    parts = device_report.parts(args)
    assert [name for name, *_ in parts[:2]] == ["bandwidth", "profile"] and parts[-1] == ("free", 1001)
    for k, (name, *values) in enumerate(parts):
        assert callable(getattr(device_report, name))
        if name == "layers" or (name, values[0]) == ("profile", "layers"):
            assert ("make_state", values[-1]) in parts[:k]
    late = device_report.run(("free", 301), args, 0.01)
    assert late["failed"] == "not within 0 s" and late["took_s"] < 30
    assert "KeyError" in device_report.run(("nothing",), args, 100.0)["failed"]
