"""The site: tables taken from the code are whole, and it is built without a warning and asks for nothing from elsewhere."""

import inspect
import pathlib
import re
import subprocess
import sys
from dataclasses import fields

import pytest

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import site_pages  # noqa: E402


def rows(table: str) -> dict[str, list[str]]:
    """First cell without its quotes -> the other cells."""
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in table.splitlines() if line.startswith("| `")]
    return {cells[0].strip().strip("`"): [cell.strip() for cell in cells[1:]] for cells in lines}


def test_every_option_has_its_row():
    import taichi_cloth as tc

    table = rows(site_pages.options())
    wanted = inspect.signature(tc.Simulation).parameters
    assert set(table) == set(wanted) - {"scene"}
    for name, (default, flag, meaning) in table.items():
        assert default == f"`{wanted[name].default!r}`" and len(meaning) > 5, name
        assert not flag or re.fullmatch(r"`--[a-zA-Z-]+`", flag), name
    assert table["adaptive"][1] == "`--fixed-step`" and table["h"][1] == "`--h`"


def test_every_number_of_a_step_is_explained():
    from taichi_cloth.step.records import StepRecord

    table = rows(site_pages.record())
    assert list(table) == [f.name for f in fields(StepRecord)]
    assert all(len(meaning) > 5 for (meaning,) in table.values()), table


def test_every_command_and_scene_is_listed():
    from taichi_cloth.app import recorded as cli_recorded
    from taichi_cloth.app import scenefile
    from taichi_cloth.app import studies as cli_study

    text = site_pages.commands()
    for name in ("run", "check", "list", "doctor", *cli_recorded.COMMANDS, *cli_study.COMMANDS):
        assert f"## taichi-cloth {name}\n" in text
    assert set(rows(site_pages.scenes())) == {path.stem for path in scenefile.available().values()}


@pytest.mark.parametrize("page", site_pages.with_tables(), ids=lambda page: page.stem)
def test_tables_on_disk_are_those_of_the_code(page):
    assert page.read_text() == site_pages.filled(page.read_text()), "run: python scripts/site_pages.py --write"


def test_the_pages_with_tables_are_found():
    assert {page.stem for page in site_pages.with_tables()} == {"api", "command-line", "options", "scenes", "output",
                                                                  "deprecations"}


def test_every_public_name_has_its_line():
    import taichi_cloth as tc

    table = rows(site_pages.names())
    assert list(table) == [f"tc.{name}" for name in tc.__all__ if name != "__version__"]
    assert all(len(meaning) > 5 for (meaning,) in table.values()), table
    assert table["tc.render"] == [tc.render.__doc__.split("\n")[0]]


def test_every_public_name_has_its_place():
    import taichi_cloth as tc

    named = set(re.findall(r"^::: taichi_cloth\.([\w.]+)$", (ROOT / "docs/reference/api.md").read_text(), re.MULTILINE))
    assert {f"{where}.{name}" for name, where in tc._WHERE.items()} <= named
    errors = {line.split("`")[1] for line in (ROOT / "docs/troubleshooting.md").read_text().splitlines() if "Error` |" in line}
    assert errors == {name for name in tc._WHERE if name.endswith("Error") and name != "ClothError"}


def test_help_names_types_and_does_not_spell_them_out():
    import taichi_cloth as tc

    names = [name for name in tc.__all__ if name != "Constraint" and not name.endswith("Error")]  # whose file has kernels
    for public in (getattr(tc, name) for name in names):
        for what in [public, *(f for n, f in inspect.getmembers(public, inspect.isfunction) if not n.startswith("_"))]:
            assert not callable(what) or "_SupportsArray" not in str(inspect.signature(what)), what


def test_every_rejection_is_explained():
    from taichi_cloth.step.stepper import ADVICE

    assert set(ADVICE) <= {line.split("|")[1].strip() for line in (ROOT / "docs/troubleshooting.md").read_text().splitlines()
                           if line.startswith("| ")}


@pytest.mark.slow
def test_site_is_built_from_what_is_here(tmp_path):
    for package in ("mkdocs", "material", "mkdocstrings", "latex2mathml"):
        pytest.importorskip(package)
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path], cwd=ROOT,
                          capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 25
    for page in pages:
        text = page.read_text()
        assert not re.search(r"<(script|img|iframe)[^>]*src=.?https?:", text), page
        assert not re.search(r"<link[^>]*rel=.?(stylesheet|preconnect|preload)[^>]*https?:", text), page
        assert "arithmatex" not in text and "<!-- table" not in text, page
    assert (tmp_path / "theory/time/index.html").read_text().count("<math") > 20
