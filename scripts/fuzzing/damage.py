"""Trials of damaged runs: a small run, whole or stopped in its middle, is spoilt at random and then used.

Whatever is done with it, resumed, exported, drawn or reported, must give what the whole run gives, byte for byte, or be
refused by one of the project's own errors: exit code 2, one line, no traceback. What a run of its own made stays whole.
"""

import atexit
import contextlib
import hashlib
import io
import json
import pathlib
import shutil
import tempfile
import zipfile

import numpy as np
from fuzz import FAILED, OK, Outcome

SCENE = '''"""A sheet falls on a ball that moves."""
import taichi_cloth as tc

def build():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.4, 4), tc.Fabric(0.2, tc.Stretch(100), tc.Shear(30)))
    scene.add_solid(tc.Sphere(0.1), friction=0.3, thickness=0.01, position=lambda t: (0.2 + t, -0.12, -0.2))
    return scene
'''
FRAMES, STOPPED = 9, 6  # frames of the whole run; the one after which the other was stopped
FLAGS = ["--fps", "20", "--duration", str(FRAMES / 20), "--no-images", "--checkpoint-every", "2", "--threads", "1",
         "--integrator", "backward_euler"]
WAYS = ("bits", "cut", "noise", "delete", "swap", "numbers", "folder", "tail")
_made: dict[str, pathlib.Path] = {}
_results: dict[str, str] = {}


def call(*args: object) -> tuple[int, str]:
    """(exit code, everything printed) of a command in this process."""
    from taichi_cloth.app.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = main([str(a) for a in args])
        except SystemExit as end:
            code = int(end.code or 0)
    return code, said.getvalue()


def recorded() -> dict[str, pathlib.Path]:
    """Folders of the whole run, and of the same stopped as by kill -9, made once a process."""
    if not _made:
        root = pathlib.Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, root, ignore_errors=True)
        (root / "scene.py").write_text(SCENE)
        code, said = call("run", root / "scene.py", "--out", root / "whole", *FLAGS)
        assert code == 0, said
        stop(root / "whole", root / "stopped", root)
        _made.update(scene=root / "scene.py", whole=root / "whole", stopped=root / "stopped")
    return _made


def expected(action: str, kind: str) -> str:
    """Of what an action makes of a run that is not damaged; a resumed one is the whole run. Made when it is first asked for:
    pictures are drawn in f32, and a run after that compiles all of its kernels again."""
    if action == "resume":
        return fingerprint(action, _made["whole"])
    if (name := f"{action} {kind}") not in _results:
        out = shutil.copytree(_made[kind], _made["scene"].parent / name)
        code, said = use(action, out)
        assert code == 0, said
        _results[name] = fingerprint(action, out)
    return _results[name]


def stop(whole: pathlib.Path, folder: pathlib.Path, root: pathlib.Path) -> None:
    """What is in a run's folder when its process is killed after the frame STOPPED."""
    from taichi_cloth.output.folder import manifest_sum

    shutil.copytree(whole, folder)
    for file in [*folder.glob("frames/*"), *folder.glob("checkpoints/*")]:
        if int(file.stem) > STOPPED:
            file.unlink()
    lines = (folder / "telemetry.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "telemetry.jsonl").write_bytes(b"".join(x for x in lines if json.loads(x)["t"] < STOPPED / 20 + 1e-9))
    manifest = json.loads((folder / "manifest.json").read_text())
    of_the_end = ("checksum", "summary", "simulated_s", "wall_s", "output_seconds", "steps_before")
    running = {k: v for k, v in manifest.items() if k not in of_the_end}
    running |= {"status": "running", "frames": [0, None]}
    (folder / "manifest.json").write_text(json.dumps(running | {"checksum": manifest_sum(running)}))


def use(action: str, folder: pathlib.Path) -> tuple[int, str]:
    """One of the things that can be done with a run."""
    if action == "resume":
        return call("run", _made["scene"], "--out", folder, *FLAGS, "--resume")
    if action == "export":
        return call("export", folder, "--format", "vtu", "--to", folder / "made")
    if action == "report":
        return call("report", folder, "--to", folder / "made.html")
    return call("render", folder, "--to", folder / "made", "--size", "32x24", "--every", "4")


def fingerprint(action: str, folder: pathlib.Path) -> str:
    """Of all that an action made."""
    total = hashlib.sha256()
    if action == "resume":
        files = [*sorted(folder.glob("frames/*.npz")), folder / "geometry.npz"]  # an older checkpoint may stay damaged
        for line in (folder / "telemetry.jsonl").read_text().splitlines():
            record = {k: v for k, v in json.loads(line).items() if k not in ("seconds", "checksum")}
            total.update(json.dumps(record, sort_keys=True).encode())
    else:
        files = [folder / "made.html"] if action == "report" else sorted((folder / "made").iterdir())
    for file in files:
        total.update(file.name.encode() + (content(file) if file.suffix == ".npz" else file.read_bytes()))
    return total.hexdigest()


def content(file: pathlib.Path) -> bytes:
    """What numpy reads from a file of arrays; what follows behind its end is nothing."""
    with np.load(file) as arrays:
        return b"".join(f"{k} {a.dtype} {a.shape}".encode() + a.tobytes() for k, a in sorted(arrays.items()))


def spoil(folder: pathlib.Path, rng: np.random.Generator) -> str:
    """Damages one or two files of a run; a sentence about it."""
    said = []
    for _ in range(int(rng.integers(1, 3))):
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        if not files:
            break
        file, way = files[int(rng.integers(len(files)))], str(rng.choice(WAYS))
        said.append(f"{way} of {file.relative_to(folder)}")
        data = bytearray(file.read_bytes())
        at = int(rng.integers(max(len(data), 1)))
        if way == "bits" and data:
            data[at] ^= 1 << int(rng.integers(8))
        elif way == "noise":
            data[at: at + 20] = rng.integers(256, size=20, dtype=np.uint8).tobytes()
        elif way == "tail":
            data += rng.integers(256, size=30, dtype=np.uint8).tobytes()
        elif way == "cut":
            del data[at:]
        if way == "delete":
            file.unlink()
        elif way == "folder" and file.parent != folder:
            shutil.rmtree(file.parent)
        elif way == "swap":
            other = files[int(rng.integers(len(files)))]
            mine, its = file.read_bytes(), other.read_bytes()
            file.write_bytes(its)
            other.write_bytes(mine)
            said[-1] += f" with {other.relative_to(folder)}"
        elif way == "numbers":
            file.write_bytes(other_numbers(file, rng))
        else:
            file.write_bytes(data)
    return ", ".join(said)


def other_numbers(file: pathlib.Path, rng: np.random.Generator) -> bytes:
    """The file, well formed, with one number in it that is not what it was."""
    data = file.read_bytes()
    if file.suffix != ".npz":
        places = [k for k, c in enumerate(data) if chr(c).isdigit()]
        at = places[int(rng.integers(len(places)))] if places else 0
        return data[:at] + str((int(chr(data[at])) + 1) % 10).encode() + data[at + 1:] if places else data
    try:
        with np.load(file) as stored:
            arrays = dict(stored)
    except (ValueError, OSError, zipfile.BadZipFile):
        return data
    names = [k for k, a in arrays.items() if a.size and a.dtype.kind in "fiu"]
    name = names[int(rng.integers(len(names)))]
    flat = arrays[name].copy().reshape(-1)
    flat[int(rng.integers(flat.size))] = float(rng.choice([1e3, -7, np.nan])) if flat.dtype.kind == "f" else 3
    out = io.BytesIO()
    np.savez(out, **(arrays | {name: flat.reshape(arrays[name].shape)}))
    return out.getvalue()


def trial(seed: int, precision: str) -> Outcome:
    """One run, spoilt and used; `precision` makes no difference."""
    made, rng = recorded(), np.random.default_rng([seed, 101])
    kind = str(rng.choice(["whole", "stopped"]))
    action = str(rng.choice(["resume", "resume", "export", "report", "render"], p=[0.3, 0.25, 0.25, 0.15, 0.05]))
    with tempfile.TemporaryDirectory() as root:
        folder = shutil.copytree(made[kind], pathlib.Path(root) / kind)
        case = f"seed {seed}: the {kind} run, {spoil(folder, rng)}, then {action}"
        try:
            code, said = use(action, folder)
        except Exception as error:
            return Outcome(FAILED, f"{case}: {type(error).__name__}: {error}")
        if code == 2 and said.count("error: ") == 1 and "Traceback" not in said:
            return Outcome(OK)
        if code != 0:
            return Outcome(FAILED, f"{case}: exit code {code}: {said[-600:]}")
        wanted = expected(action, kind)
        try:
            same = fingerprint(action, folder) == wanted
        except (OSError, ValueError) as error:
            return Outcome(FAILED, f"{case}: exit code 0, and {type(error).__name__}: {error}")
        return Outcome(OK) if same else Outcome(FAILED, f"{case}: exit code 0, and another result. {said[-600:]}")
