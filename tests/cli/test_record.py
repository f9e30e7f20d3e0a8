"""What a run records, against what is worked out here from the scene: times, solids, contact forces, log and manifest."""

import json
import pathlib
import re
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import read_png

from taichi_cloth.app import cli
from taichi_cloth.output.recording import Recording
from taichi_cloth.recording.recorded import Recording as Reported

SCENE = '''"""A sheet lies on a box, another falls freely, and a ball goes by."""
import taichi_cloth as tc

def build(cells: int = 4):
    scene = tc.Scene(view=tc.View(ground=-3.0, reach=0.25, camera=tc.Camera((1, 2, 3), (0, 0.5, 0), 40)))
    fabric = tc.Fabric(0.2, tc.Stretch(100), tc.Shear(30), tc.Bend(1e-4))
    scene.add_cloth(tc.grid(0.4, cells), fabric, name="lying", color=(0.1, 0.2, 0.3))
    scene.add_cloth(tc.grid(0.4, cells), fabric, positions=tc.grid(0.4, cells).x + [0, 0.5, 3], name="falling")
    scene.add_solid(tc.Box((2.0, 0.2, 2.0)), friction=0.4, thickness=0.01, position=(0.2, -0.11, -0.2), name="box")
    scene.add_solid(tc.Sphere(0.2), friction=0.4, thickness=0.01, position=lambda t: (2 + 3 * t, t * t, 5), name="ball")
    scene.add_prop(tc.Box((0.1, 1.0, 0.1)), position=lambda t: (0.2, t, -0.2), name="post")  # through the sheet that lies
    return scene
'''
FPS, FRAMES, G, WEIGHT = 20, 6, 9.81, 0.2 * 0.4 * 0.4 * 9.81


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("record")
    (folder / "lying.py").write_text(SCENE)
    code = cli.main(["run", str(folder / "lying.py"), "--out", str(folder / "out"), "--fps", str(FPS), "--duration",
                     str(FRAMES / FPS), "--size", "48x32", "--integrator", "backward_euler", "--threads", "1",
                     "--checkpoint-every", "4", "--set", "cells=3"])
    assert code == 0
    recording = Recording(folder / "out")
    return SimpleNamespace(out=folder / "out", recording=recording, g=recording.geometry, log=recording.telemetry(),
                           frames=[recording.frame(k) for k in recording.frames()], manifest=recording.manifest)


@pytest.mark.slow
def test_frames_are_at_their_times_with_positions_and_velocities(run):
    assert [float(f["t"]) for f in run.frames] == pytest.approx([k / FPS for k in range(FRAMES + 1)], abs=1e-12)
    falling = slice(16, 32)
    for f in run.frames:
        assert f["v"][falling, 1] == pytest.approx(-G * float(f["t"]), abs=1e-3)
        assert f["x"].dtype == f["v"].dtype == f["contact"].dtype == np.float32 and f["x"].shape == (32, 3)
    t, h = FRAMES / FPS, run.log[0]["h"]
    assert (run.frames[0]["x"][falling, 1] - run.frames[-1]["x"][falling, 1]) == pytest.approx(G * t * (t + h) / 2, rel=1e-3)
    assert (run.frames[0]["x"] == run.g["x"].astype(np.float32)).all()


@pytest.mark.slow
def test_contact_forces_carry_the_sheet(run):
    """They act on the cloth: upwards, and as large as its weight; on what touches nothing there are none."""
    force = run.frames[-1]["contact"]
    assert force[:16].sum(axis=0) == pytest.approx([0, WEIGHT, 0], abs=0.01 * WEIGHT)
    assert (force[:16, 1] > -1e-9).all() and (force[16:] == 0).all()


def test_moving_solids_are_where_the_script_says(run):
    ball = slice(*run.g["solid_start"][1:3])
    assert run.g["solid_names"].tolist() == ["box", "ball", "post"] and run.manifest["model"]["solids"] == 2
    assert (run.g["solid_thickness"][:2] > 0).all() and run.g["solid_thickness"][2] == 0, "nothing touches a prop"
    for f in run.frames:
        t = float(f["t"])
        ring = f["solid_x"][ball].astype(float)
        assert (ring.min(axis=0) + ring.max(axis=0)) / 2 == pytest.approx([2 + 3 * t, t * t, 5], abs=2e-3)
        assert np.linalg.norm(ring - [2 + 3 * t, t * t, 5], axis=1) == pytest.approx(0.2, abs=1e-5)
        assert f["solid_x"][ball.stop:, 1].min() == pytest.approx(t - 0.5, abs=1e-6)
        box = f["solid_x"][: run.g["solid_start"][1]]
        assert box.max(axis=0) == pytest.approx([1.2, -0.01, 0.8]) and box.min(axis=0) == pytest.approx([-0.8, -0.21, -1.2])
    assert (run.g["solid_x"].astype(np.float32) == run.frames[0]["solid_x"]).all()
    assert (run.g["solid_faces"] >= 0).all() and run.g["solid_faces"].max() == len(run.g["solid_x"]) - 1
    assert run.g["solid_faces"][run.g["solid_faces"].max(axis=1) >= ball.start].min() == ball.start


def test_geometry_is_that_of_the_scene(run):
    g = run.g
    assert g["cloth_start"].tolist() == [0, 16, 32] and g["cloth_faces"].tolist() == [0, 18, 36]
    assert g["cloth_names"].tolist() == ["lying", "falling"] and g["cloth_colors"][0].tolist() == [0.1, 0.2, 0.3]
    assert np.isnan(g["cloth_colors"][1]).all()
    assert g["faces"][:18].max() == 15 and g["faces"][18:].min() == 16 and g["faces"].max() == 31
    corners = g["x"][g["faces"]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    a, b = (g["uv"][:, k] - g["uv"][:, 0] for k in (1, 2))
    assert area == pytest.approx(0.32) and np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 == pytest.approx(0.32)
    assert g["camera"].tolist() == [1, 2, 3, 0, 0.5, 0, 40, 0, 1, 0] and float(g["ground"]) == -3 and float(g["reach"]) == 0.25
    inner = 2 * (2 * 3 * 2 + 9)  # of 3 x 3 cells: edges within the mesh along both sides, and diagonals
    assert g["hinges"].shape == (inner, 4) and (g["hinge_k"] > 0).all() and np.abs(g["hinge_rest"]).max() < 1e-12


def test_telemetry_says_what_happened(run):
    t = np.array([r["t"] for r in run.log])
    h = np.array([r["h"] for r in run.log])
    assert np.cumsum(h) == pytest.approx(t) and t[-1] == pytest.approx(FRAMES / FPS)
    assert all(r["status"] == "CONVERGED" and 0 <= r["residual"] <= 1e-4 and r["solves"] >= 1 for r in run.log)
    last, f = run.log[-1], run.frames[-1]
    kinetic = 0.5 * (WEIGHT / G) * (G * t[-1]) ** 2  # of the sheet that falls; the other one lies
    assert last["energies"]["kinetic"] == pytest.approx(kinetic, rel=1e-3)
    assert 0 < last["contacts"] <= 16 and last["stretch"] == pytest.approx(1, abs=0.01)
    touching = (np.linalg.norm(f["contact"], axis=1) > 0).sum()
    assert touching <= last["contacts"]
    assert set(last["seconds"]) == {"EVAL", "CG", "C-C", "C-S", "total", "compiling"}
    assert all(sum(v for k, v in r["seconds"].items() if k not in ("total", "compiling")) <= r["seconds"]["total"] * 1.001
               and r["seconds"]["compiling"] <= r["seconds"]["total"] for r in run.log)


def test_the_manifest_sums_it_up(run):
    m, log = run.manifest, run.log
    assert m["status"] == "finished" and m["scene"] == "lying" and m["fps"] == FPS and m["duration"] == FRAMES / FPS
    assert m["settings"] == {"cells": 3} and m["size"] == [48, 32] and m["frames"] == [0, FRAMES]
    assert m["simulation"]["integrator"] == "backward_euler" and m["simulation"]["h_max"] == pytest.approx(1 / 60)
    assert m["runtime"]["arch"] == "cpu" and m["runtime"]["precision"] == "f64" and m["runtime"]["threads"] == 1
    assert {k: m["model"][k] for k in ("vertices", "triangles", "solids")} == {"vertices": 32, "triangles": 36, "solids": 2}
    s = m["summary"]
    assert s["steps"] == len(log) and s["smallest_h"] == min(r["h"] for r in log)
    assert s["worst_residual"] == max(r["residual"] for r in log)
    assert s["cg_iterations"] == sum(r["iterations"] for r in log) > 0 and s["solves"] == sum(r["solves"] for r in log)
    assert s["contacts"] == max(r["contacts"] for r in log) and s["largest_stretch"] == max(r["stretch"] for r in log)
    assert s["solid_intersections"] == max(r["solid_intersections"] for r in log) and s["not_converged"] == 0
    rejected = {}
    for r in log:
        for name, count in r["rejections"].items():
            rejected[name] = rejected.get(name, 0) + count
    assert s["rejections"] == rejected
    assert s["seconds"]["total"] == pytest.approx(sum(r["seconds"]["total"] for r in log), abs=1e-3)
    assert m["simulated_s"] == pytest.approx(FRAMES / FPS) and m["wall_s"] > 0 and m["output_seconds"]["write"] > 0


def test_files_are_there_for_every_frame(run):
    assert [p.name for p in sorted((run.out / "images").iterdir())] == [f"{k:05d}.png" for k in range(FRAMES + 1)]
    assert read_png(run.out / "images" / "00003.png").shape == (32, 48, 3)
    assert [p.name for p in sorted((run.out / "checkpoints").iterdir())] == ["00000.npz", "00004.npz", "00006.npz"]
    assert run.recording.last_checkpoint()[0] == FRAMES, "of the run's end"
    frame, state = run.recording.last_checkpoint(FRAMES - 1)
    at = [r["t"] for r in run.log].index(pytest.approx(4 / FPS))
    assert frame == 4 and int(state["records"]) == at + 1 and float(state["time"]) == pytest.approx(4 / FPS)


@pytest.mark.slow
def test_the_report_tells_the_same(run, tmp_path, monkeypatch):
    file = tmp_path / "report.html"
    log = [{**r, "contacts": r["contacts"] + k % 3} for k, r in enumerate(run.log)]  # it has 16 in each step
    monkeypatch.setattr(Recording, "telemetry", lambda recording: log)
    assert cli.main(["report", str(run.out), "--to", str(file)]) == 0
    text = file.read_text()
    assert Reported(run.out).report(tmp_path / "again.html").read_text() == text
    for name, value in (("vertices", "32"), ("triangles", "36"), ("hinges", str(len(run.g["hinges"]))), ("solids", "2"),
                        ("most contacts in a step", str(max(r["contacts"] for r in log))), ("steps", str(len(log))),
                        ("worst residual of a solve", f"{max(r['residual'] for r in log):.2g}"),
                        ("solves not converged", "0"), ("largest stretch", f"{max(r['stretch'] for r in log):.4f}")):
        assert f"<td>{name}</td><td>{value}</td>" in text, name
    shares = dict(re.findall(r"<td>([\w-]+)</td><td>[\d.]+</td><td>[\d.]+</td><td>([\d.]+)%</td>", text))
    assert set(shares) >= {"EVAL", "CG", "C-C", "C-S", "other", "total"}
    assert sum(float(v) for k, v in shares.items() if k != "total") == pytest.approx(100, abs=0.3)
    data = json.loads(text.split("const data = ", 1)[1].split(";\n", 1)[0])
    import base64

    low, span = np.array(data["low"]), np.array(data["span"])
    for k, f in enumerate(run.frames):
        x = np.frombuffer(base64.b64decode(data["frames"][k]), "<u2").reshape(-1, 3) / 65535 * span + low
        assert np.abs(x - f["x"]).max() <= span.max() / 65535
        y = np.frombuffer(base64.b64decode(data["solidFrames"][k]), "<u2").reshape(-1, 3) / 65535 * span + low
        assert np.abs(y - f["solid_x"]).max() <= span.max() / 65535
    faces = np.frombuffer(base64.b64decode(data["faces"]), "<u4").reshape(-1, 3)
    assert (faces == run.g["faces"]).all() and data["times"] == [float(f["t"]) for f in run.frames]
    assert data["fps"] == FPS and data["numbers"] == list(range(FRAMES + 1))


@pytest.mark.parametrize("change, words", [("run.g", "geometry.npz"), ("telemetry", "telemetry.jsonl is damaged")])
def test_a_damaged_run_has_no_report(run, tmp_path, change, words, capsys):
    import shutil

    out: pathlib.Path = shutil.copytree(run.out, tmp_path / "out")
    file = out / ("geometry.npz" if change == "run.g" else "telemetry.jsonl")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    assert cli.main(["report", str(out)]) == 2 and words in capsys.readouterr().err
    assert not (out / "report.html").exists()
