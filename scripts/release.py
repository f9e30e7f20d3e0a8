"""Builds a release, and checks it as a user gets it: wheel, source archive and site.

    python scripts/release.py                  # in a folder that goes away
    python scripts/release.py --out dist       # keeps wheel, source archive and site there
    python scripts/release.py --quick          # versions, pages and names alone: nothing is built

Versions agree in all places. The wheel has every file of the package and of scenes/, byte for byte, and nothing else. It
installs without an index into a fresh virtual environment, is imported from there, and its command lists the scenes.
Packages that it needs come from the environment that runs this script. The site is built as strictly as its test does.
To build, pip gets the build system that pyproject.toml names.
"""

import argparse
import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import venv
import zipfile
from collections.abc import Iterable

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]
import site_pages  # noqa: E402

PACKAGE, SCENES, BUNDLED = "taichi_cloth/", "scenes/", "taichi_cloth/bundled_scenes/"
PLACES = {  # file: the version in it, once
    "pyproject.toml": r'^version = "([\d.]+)"$',
    "taichi_cloth/__init__.py": r'^__version__ = "([\d.]+)"$',
    "CITATION.cff": r"^version: ([\d.]+)$",
    "CHANGELOG.md": r"^## (\d[\d.]+) \(\d{4}-\d\d-\d\d\)$",
    "taichi_cloth/app/blender_addon.py": r'"version": \((\d+, \d+, \d+)\)',
}


def versions() -> dict[str, str]:
    """The version that each place states; of the changelog, that of the newest release."""
    out = {}
    for name, pattern in PLACES.items():
        found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
        out[name] = found[1].replace(", ", ".") if found else "none"
    return out


def disagreements() -> list[str]:
    """Places whose version is not that of pyproject.toml, and a date that is another in CITATION.cff."""
    stated = versions()
    wanted = stated["pyproject.toml"]
    out = [f"{name} states version {other}, pyproject.toml {wanted}" for name, other in stated.items() if other != wanted]
    dated = re.search(rf"^## {re.escape(wanted)} \((.*)\)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    cited = re.search(r"^date-released: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    if dated and (cited is None or cited[1] != dated[1]):
        out.append(f"CITATION.cff is of {cited[1] if cited else 'no date'}, CHANGELOG.md has {wanted} on {dated[1]}")
    return out


def old_names() -> list[str]:
    """Old names that this release should no longer know."""
    from taichi_cloth.renamed import UNTIL

    now, until = (tuple(map(int, text.split(".")[:2])) for text in (versions()["pyproject.toml"], UNTIL))
    return [f"taichi_cloth/renamed.py has names to be dropped in {UNTIL}"] if now >= until else []


def pages() -> list[str]:
    """Pages whose tables are not those of the code."""
    return [f"{page.relative_to(ROOT)} is out of date: python scripts/site_pages.py --write"
            for page in site_pages.with_tables() if page.read_text() != site_pages.filled(page.read_text())]


def tracked() -> list[str]:
    """Files of the package and of scenes/ that are under version control."""
    return [name for name in _run("git", "ls-files", "-z", PACKAGE, SCENES).split("\0") if name]


def faults_of_wheel(wheel: pathlib.Path, files: Iterable[str]) -> list[str]:
    """Files that a wheel lacks, has changed, or should not have.

    Args:
        files: from the checkout's root; those of scenes/ are in `bundled_scenes` of the wheel.
    """
    wanted = {name.replace(SCENES, BUNDLED, 1) if name.startswith(SCENES) else name: name for name in files}
    with zipfile.ZipFile(wheel) as archive:
        has = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}
        licensed = any(name.endswith("/LICENSE") for name in archive.namelist())
    out = [f"{wheel.name} lacks {wanted[name]}" for name in sorted(wanted.keys() - has.keys())]
    out += [f"{wheel.name} has {name}, which is not under version control" for name in sorted(has.keys() - wanted.keys())]
    out += [f"{wheel.name} has another {name}" for name in sorted(wanted.keys() & has.keys())
            if has[name] != (ROOT / wanted[name]).read_bytes()]
    return out + ([] if licensed else [f"{wheel.name} lacks LICENSE"])


def faults_of_source(archive: pathlib.Path, files: Iterable[str]) -> list[str]:
    """Files that the source archive lacks: those of the wheel, and all that it is built and tested with."""
    with tarfile.open(archive) as made:
        has = {name.partition("/")[2] for name in made.getnames()}
    wanted = {*files, "pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "tests/conftest.py"}
    return [f"{archive.name} lacks {name}" for name in sorted(wanted - has)]


def build(folder: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """(wheel, source archive), built in a virtual environment of its own."""
    python = _fresh(folder / "tools")
    text = (ROOT / "pyproject.toml").read_text()
    needed = json.loads(re.search(r"^requires = (\[.*\])$", text, re.MULTILINE)[1])  # type: ignore[index]
    _run(python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *needed)
    _run(python, "-m", "hatchling", "build", "-d", folder / "dist")
    return next((folder / "dist").glob("*.whl")), next((folder / "dist").glob("*.tar.gz"))


def faults_of_installation(wheel: pathlib.Path, folder: pathlib.Path) -> list[str]:
    """Installs the wheel into a fresh environment, imports it there, and lists the scenes by its command."""
    python = _fresh(folder / "user")
    place = pathlib.Path(_run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    _run(python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-index", "--no-deps", wheel)
    (place / "needed.pth").write_text(sysconfig.get_path("purelib") + "\n")  # behind its own: Taichi and numpy
    version = versions()["pyproject.toml"]
    said = _run(python, "-c", "import taichi_cloth as tc; tc.Scene(); tc.Simulation; print(tc.__version__, tc.__file__)",
                cwd=folder)
    listed = _run(python.with_name("taichi-cloth"), "list", cwd=folder)
    out = [] if said.startswith(version) and str(place) in said else [f"the wheel is not what is imported: {said.strip()}"]
    names = [path.stem for path in (ROOT / "scenes").glob("*.py")]
    return out + [f"`taichi-cloth list` does not know the scene {name}" for name in sorted(names)
                  if not re.search(rf"^{name}\b", listed, re.MULTILINE)]


def _fresh(folder: pathlib.Path) -> pathlib.Path:
    """The interpreter of a new virtual environment."""
    venv.create(folder, with_pip=True)
    return next(folder.glob("bin/python")) if (folder / "bin").is_dir() else folder / "Scripts" / "python.exe"


def _run(*command: object, cwd: pathlib.Path = ROOT) -> str:
    """Its output; it finds modules as any program of its environment does.

    Raises:
        SystemExit: it failed.
    """
    words = [str(word) for word in command]
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(words, cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def make(folder: pathlib.Path) -> list[str]:
    """Builds all into a folder; the faults that were found."""
    wheel, archive = build(folder)
    files = tracked()
    out = faults_of_wheel(wheel, files) + faults_of_source(archive, files) + faults_of_installation(wheel, folder)
    _run(sys.executable, "-m", "mkdocs", "build", "-q", "--strict", "--site-dir", folder / "site")
    for made in (wheel, archive):
        print(f"{hashlib.sha256(made.read_bytes()).hexdigest()}  {made.name}")
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, help="folder that keeps wheel, source archive and site")
    parser.add_argument("--quick", action="store_true", help="builds nothing")
    args = parser.parse_args()
    faults = disagreements() + old_names() + pages()
    if not args.quick:
        with tempfile.TemporaryDirectory() as folder:
            faults += make(pathlib.Path(folder))
            if args.out and not faults:
                for kept in ("dist", "site"):
                    shutil.copytree(pathlib.Path(folder) / kept, args.out if kept == "dist" else args.out / kept,
                                    dirs_exist_ok=True)
    for fault in faults:
        print(fault)
    print(f"taichi_cloth {versions()['pyproject.toml']}: {len(faults)} faults" if faults else
          f"taichi_cloth {versions()['pyproject.toml']}: ready")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
