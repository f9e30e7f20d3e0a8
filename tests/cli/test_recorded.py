"""Runs that were recorded: gone on with after a kill, exported, drawn again, compared, reported."""

import base64
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from inside import AS_HERE, ROOT, call
from test_cli import QUICK, read_png
from test_cli import call as call_apart

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.errors import OutputError
from taichi_cloth.output.export import export
from taichi_cloth.output.export.pc2 import read_pc2
from taichi_cloth.output.recording import Recording
from taichi_cloth.system.quantities import evaluate

RUN = ["--set", "cells=12", "--fps", "30", "--duration", "0.5", "--no-images", "--checkpoint-every", "4"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "whole"
    done = call("run", "sphere_drape", "--out", folder, *RUN)
    assert done.returncode == 0, done.stderr
    return folder


def killed(folder, when) -> None:
    """The same run, killed without warning as soon as `when()` holds."""
    command = [sys.executable, "-c", AS_HERE, "run", "sphere_drape", "--out", str(folder), *RUN]
    process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL)
    deadline = time.time() + 120
    while not when() and process.poll() is None and time.time() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "it was over before it could be killed"


@pytest.mark.slow
def test_a_killed_run_goes_on_bitwise(whole, tmp_path):
    """Killed in the middle of a frame; its last checkpoint cut short as if killed in the middle of that."""
    folder = tmp_path / "killed"
    killed(folder, lambda: (folder / "frames" / "00009.npz").exists())
    assert json.loads((folder / "manifest.json").read_text())["status"] == "running"
    checkpoints = sorted((folder / "checkpoints").glob("*.npz"))
    data = checkpoints[-1].read_bytes()
    checkpoints[-1].write_bytes(data[: len(data) // 2])
    (folder / "frames" / "00010.npz.partial").write_bytes(b"cut")
    done = call("run", "sphere_drape", "--out", folder, *RUN, "--resume")
    assert done.returncode == 0, done.stderr
    assert f"{checkpoints[-1].name} is damaged" in done.stderr and "going on from frame" in done.stderr
    names = sorted(p.name for p in (whole / "frames").iterdir())
    assert names == sorted(p.name for p in (folder / "frames").glob("*.npz")) and len(names) == 16
    for name in names:
        assert (whole / "frames" / name).read_bytes() == (folder / "frames" / name).read_bytes(), name
    logs = [[{k: v for k, v in r.items() if k != "seconds"} for r in Recording(f).telemetry()] for f in (whole, folder)]
    assert logs[0] == logs[1]
    said = call("diff", whole, folder)
    assert "the motion agrees in all 16 frames" in said.stdout and "settings" not in said.stdout


@pytest.mark.slow
def test_going_on_is_refused_where_things_changed(whole, tmp_path):
    folder = shutil.copytree(whole, tmp_path / "copy")
    done = call_apart("run", "sphere_drape", "--out", folder, *RUN, "--resume", "--precision", "f32")
    assert done.returncode == 2 and "runtime.precision was 'f64' and is 'f32'" in done.stderr
    done = call("run", "sphere_drape", "--out", folder, *RUN, "--from-frame", "9", "--set", "friction=0.0")
    assert done.returncode == 0 and "the nearest before it is frame 8" in done.stderr
    said = call("diff", whole, folder).stdout
    assert "settings.friction was 0.4 and is 0.0" in said and re.search(r"the motion parts at frame (9|1\d)", said)
    done = call("run", "sphere_drape", "--out", tmp_path / "none", "--resume")
    assert done.returncode == 2 and "not a run's folder" in done.stderr


@pytest.mark.parametrize("name, integrator", [("trampoline", "backward_euler"), ("swing", "verlet")])
@pytest.mark.slow
def test_checkpoints_hold_everything_that_decides(name, integrator):
    """Events, motions, rejections and step sizes included."""
    scene = scenefile.read(str(ROOT / "scenes" / f"{name}.py"))
    ended, state = [], None
    for _ in range(2):
        with tc.Simulation(scene.make(scene.small), h=1 / 60, integrator=integrator) as sim:
            if state is None:
                sim.run(0.5, 20)
                state = sim.checkpoint()
            else:
                sim.resume(state)
            sim.run(1.0, 20, resumed=10)
            ended.append((sim.positions(), sim.velocities(), sim.time))
    assert all(np.array_equal(one, other) for one, other in zip(*ended))


@pytest.mark.slow
def test_exports_hold_what_was_simulated(whole, tmp_path):
    import meshio

    recording = Recording(whole)
    g, numbers = recording.geometry, recording.frames()
    x = np.stack([recording.frame(k)["x"] for k in numbers])
    files = {f: export(recording, f, tmp_path / f) for f in ("pc2", "usda", "vtu", "ply")}
    assert (read_pc2(files["pc2"][1]) == x).all()
    again = tc.load(files["pc2"][0])
    assert (again.faces == g["faces"]).all() and np.abs(again.corner_uv - g["uv"]).max() < 1e-7
    grid = meshio.read(files["vtu"][-2])
    assert (grid.points == x[-1]).all() and (grid.cells_dict["triangle"] == g["faces"]).all()
    assert (grid.point_data["velocity"] == recording.frame(numbers[-1])["v"]).all()
    assert np.abs(grid.point_data["uv"][g["faces"]] - g["uv"]).max() == 0
    assert (grid.point_data["contact_force"] == recording.frame(numbers[-1])["contact"]).all()
    assert grid.point_data["stretch"] == pytest.approx(evaluate("stretch", g, recording.frame(numbers[-1])), rel=1e-6)
    assert grid.point_data["stretch"].max() > 1
    listed = re.findall(r'timestep="([^"]+)".*file="([^"]+)"', files["vtu"][-1].read_text())
    assert len(listed) == len(numbers) and float(listed[3][0]) == pytest.approx(0.1)
    points = meshio.read(files["ply"][-1])
    assert (points.points == x[-1]).all() and (points.cells_dict["triangle"] == g["faces"]).all()
    text = files["usda"][0].read_text()
    frame = re.search(rf"point3f\[\] points.timeSamples = {{.*?\n            {numbers[-1]}: \[(.*?)\],", text, re.DOTALL)
    values = np.array(re.findall(r"[-\d.e+]+", frame.group(1)), dtype=np.float32).reshape(-1, 3)
    assert (values == x[-1]).all() and 'upAxis = "Y"' in text and "metersPerUnit = 1" in text


def test_usd_is_read_by_its_own_library(whole, tmp_path):
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    from pxr import UsdGeom

    recording = Recording(whole)
    for format in ("usda", "usdc"):
        stage = Usd.Stage.Open(str(export(recording, format, tmp_path / format)[0]))
        mesh = next(UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
        for k in recording.frames():
            assert (np.array(mesh.GetPointsAttr().Get(k)) == recording.frame(k)["x"]).all()
        assert (np.array(mesh.GetFaceVertexIndicesAttr().Get()) == recording.geometry["faces"].ravel()).all()
        st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
        assert (st == recording.geometry["uv"].reshape(-1, 2)).all()


def test_blender_reads_the_cache(whole, tmp_path):
    bpy = pytest.importorskip("bpy", reason="Blender's module bpy is not installed")
    recording = Recording(whole)
    obj, pc2 = export(recording, "pc2", tmp_path)[:2]
    bpy.ops.wm.obj_import(filepath=str(obj), forward_axis="Y", up_axis="Z")
    cloth = bpy.context.selected_objects[0]
    cache = cloth.modifiers.new("cache", "MESH_CACHE")
    cache.cache_format, cache.filepath, cache.frame_start = "PC2", str(pc2), 0
    bpy.context.scene.frame_set(10)
    mesh = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    x = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", x)
    assert np.abs(x.reshape(-1, 3) - recording.frame(10)["x"]).max() < 1e-6


@pytest.mark.slow
def test_drawn_again_and_compared(whole, tmp_path):
    done = call_apart("render", whole, "--to", tmp_path / "again", "--size", "96x64", "--every", "5", "--heat", "stretch",
                      "--wire", "--quality", "standard", "--caption", "t = {t}", "--sheet", "4", "--apng", "--camera",
                      "1,1,1:0,0,0")
    assert done.returncode == 0, done.stderr
    names = sorted(p.name for p in (tmp_path / "again").iterdir())
    assert names == ["00000.png", "00005.png", "00010.png", "00015.png", "animation.png", "sheet.png"]
    sheet, last = read_png(tmp_path / "again" / "sheet.png"), read_png(tmp_path / "again" / "00015.png")
    assert sheet.shape == (128, 192, 3) and (sheet[64:, 96:] == last).all() and len(np.unique(last)) > 50
    data = (tmp_path / "again" / "animation.png").read_bytes()
    assert data.count(b"fcTL") == 4 and data.count(b"fdAT") == 3 and data[data.index(b"acTL") + 7] == 4
    done = call_apart("compare", whole, whole, "--to", tmp_path / "both.png", "--size", "64x48", "--frames", "3", "--movie")
    assert "in all 16 frames: RMS 0 m, largest 0 m" in done.stdout
    assert read_png(tmp_path / "both.png").shape == (3 * 48 + 20, 3 * 64, 3)  # with times below
    assert len((tmp_path / "both.csv").read_text().splitlines()) == 17
    assert any((tmp_path / f"both.{kind}").stat().st_size > 500 for kind in ("mp4", "apng") if
               (tmp_path / f"both.{kind}").exists())


def test_a_film_is_written(whole, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    done = call_apart("render", whole, "--to", tmp_path / "film", "--size", "96x64", "--every", "5", "--mp4")
    assert done.returncode == 0, done.stderr
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "film" / "film.mp4"))
    assert frames == 4
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "film" / "film.mp4"), pix_fmt="rgb24")
    assert next(reader)["size"] == (96, 64)
    shown = np.frombuffer(next(reader), dtype=np.uint8).reshape(64, 96, 3).astype(int)
    assert np.abs(shown - read_png(tmp_path / "film" / "00000.png")).mean() < 12


def test_what_cannot_be_done_with_a_run_is_named(whole, tmp_path):
    for args, words in ((("export", whole, "--format", "fbx"), "unknown format 'fbx'"),
                        (("export", tmp_path, "--format", "pc2"), "not a run's folder"),
                        (("render", whole, "--heat", "sped"), "did you mean 'speed'"),
                        (("render", whole, "--quality", "best"), "unknown quality"),
                        (("render", whole, "--range", "2:1"), "LOW:HIGH"),
                        (("render", whole, "--camera", "1,2:3"), "EYE:TARGET")):
        done = (call_apart if args[0] == "render" else call)(*args)  # which draws in f32
        assert done.returncode == 2 and words in done.stderr, (args, done.stderr)
    bare = shutil.copytree(whole, tmp_path / "bare")
    shutil.rmtree(bare / "frames")
    with pytest.raises(OutputError, match="no frames"):
        export(Recording(bare), "pc2", tmp_path / "x")
    data = (whole / "frames" / "00002.npz").read_bytes()
    (tmp_path / "frame.npz").write_bytes(data[:-200])
    broken = shutil.copytree(whole, tmp_path / "broken")
    (broken / "frames" / "00002.npz").write_bytes(data[:-200])
    with pytest.raises(OutputError, match="00002.npz is damaged"):
        export(Recording(broken), "pc2", tmp_path / "y")
    assert not (tmp_path / "y").exists()


@pytest.mark.parametrize("limit, culprit", [(6_000, "geometry.npz"), (30_000, "00000.png")])
def test_a_full_disk_leaves_what_is_written_whole(limit, culprit, tmp_path):
    """A limit on the size of files stands for the disk."""
    script = tmp_path / "full.py"
    script.write_text("import resource, sys\n"
                      "from taichi_cloth.app.cli import main\n"
                      "import taichi_cloth.output.folder as folder\n"
                      "whole = folder.write_whole\n"
                      "def limited(path, data):\n"
                      "    before = resource.getrlimit(resource.RLIMIT_FSIZE)\n"
                      f"    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, before[1]))\n"
                      "    try:\n"
                      "        whole(path, data)\n"
                      "    finally:\n"
                      "        resource.setrlimit(resource.RLIMIT_FSIZE, before)\n"
                      "folder.write_whole = limited\n"
                      "sys.exit(main(sys.argv[1:]))\n")
    folder = tmp_path / "out"
    done = subprocess.run([sys.executable, str(script), "run", "hang", "--out", str(folder), *QUICK, "--size", "640x480",
                           "--floor", "checker"],
                          capture_output=True, text=True, check=False, timeout=120, cwd=ROOT,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 2 and culprit in done.stderr and "File too large" in done.stderr, done.stderr
    assert Recording(folder).manifest["status"].startswith("failed")
    assert not list(folder.glob("**/*.partial")) and not list(folder.glob(f"**/{culprit}"))
    if culprit != "geometry.npz":
        assert Recording(folder).geometry["faces"].shape == (128, 3)


def test_report(whole, tmp_path):
    file = tmp_path / "report.html"
    done = call_apart("report", whole, "--to", file)
    assert done.returncode == 0, done.stderr
    text = file.read_text()
    assert all(word in text for word in ("How complex", "How often", "How real", "What cost the most", "EVAL", "C-S",
                                         "polyline", "data:image/png"))
    assert "http" not in re.sub(r"base64,[\w+/=]+", "", text)  # nothing is fetched
    data = json.loads(re.search(r"const data = (\{.*\});", text).group(1))
    assert len(data["frames"]) == 16 and len(data["times"]) == 16


DECODE = """async png => {
    const image = new Image(); image.src = 'data:image/png;base64,' + png; await image.decode();
    const canvas = new OffscreenCanvas(image.width, image.height), drawing = canvas.getContext('2d');
    drawing.drawImage(image, 0, 0);
    return Array.from(drawing.getImageData(0, 0, image.width, image.height).data); }"""


def test_report_plays_in_a_browser(whole, tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    file = tmp_path / "report.html"
    assert call_apart("report", whole, "--to", file).returncode == 0
    with api.sync_playwright() as p:
        try:
            browser = p.chromium.launch(args=["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"],
                                        executable_path=shutil.which("chromium") or shutil.which("google-chrome"))
        except api.Error as error:
            pytest.skip(f"no Chromium: {str(error).splitlines()[0]}")
        page, errors = browser.new_page(), []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(file.as_uri())
        page.fill("#frame", "7")
        page.wait_for_function("document.body.dataset.drawn === '7'")
        assert not errors
        view = page.locator("canvas").first

        def pixels():
            png = base64.b64encode(view.screenshot()).decode()
            return np.array(page.evaluate(DECODE, png), dtype=np.uint8).reshape(-1, 4)

        before, box = pixels(), view.bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2 + 80, box["y"] + box["height"] / 2, steps=3)
        page.mouse.up()
        page.wait_for_timeout(200)
        assert len(np.unique(before, axis=0)) > 30, "the cloth is not drawn"
        assert (before != pixels()).any(axis=1).mean() > 0.01, "dragging does not orbit"
        assert not errors
        browser.close()
