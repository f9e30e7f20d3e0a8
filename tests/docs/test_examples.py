"""What the pages show is run: Python blocks of the tutorials, page by page, and of README, each by itself, small; commands are
parsed.

A line `<!-- small: A -> B -->` before a block says what is replaced in it so that the test is quick.
"""

import dataclasses
import gc
import os
import pathlib
import re
import shlex

import pytest

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.scene import primitives

ROOT = pathlib.Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SLOW = ("solids", "layers", "garments", "output", "live", "own_law")  # kernels of contact and pictures are many
RESTARTS = {"sweeps"}  # with threads of their own
SMALL = re.compile(r"<!-- small: (.*?) -> (.*?) -->")


def blocks(page: pathlib.Path, language: str):
    """(line of the page, text) of each of its blocks in a language, made small."""
    text, end = page.read_text(), 0
    for found in BLOCK.finditer(text):
        code, between = found[2], text[end:found.start()]
        end = found.end()
        if found[1] != language:
            continue
        for old, new in SMALL.findall(between):
            assert old in code, f"{page.name}: {old!r} is not in the block that it stands before"
            code = code.replace(old, new)
        yield text[:found.start()].count("\n") + 1, code


WITH_CODE = [page for page in PAGES if any(True for _ in blocks(page, "python"))]


def test_there_is_something_to_run():
    assert {"README.md", "first-scene.md", "solids.md", "layers.md"} <= {page.name for page in WITH_CODE}


def marks(page: pathlib.Path) -> list[pytest.MarkDecorator]:
    """Of the test that runs a page."""
    return [mark for names, mark in ((SLOW, pytest.mark.slow), (RESTARTS, pytest.mark.restarts)) if page.stem in names]


@pytest.mark.parametrize("page", [pytest.param(page, id=page.stem, marks=marks(page)) for page in WITH_CODE])
def test_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space: dict = {"__name__": "page"}
    for line, code in blocks(page, "python"):
        if page.name == "README.md":  # who reads no more copies one of them
            space = {"__name__": "page"}
        filled = "\n" * line + code  # so that a traceback names the page's own line
        exec(compile(filled, str(page), "exec"), space)
    space.clear()
    gc.collect()  # no fields are left: the next page's are numbered from the start, and known kernels come out of the cache


def commands(page: pathlib.Path):
    for line, code in blocks(page, ""):
        for k, text in enumerate(code.splitlines()):
            for part in text.split("&&"):
                yield line + 1 + k, shlex.split(part, comments=True)


ALL = [(page, line, words) for page in PAGES for line, words in commands(page) if words]


def test_commands_are_parsed(capsys):
    """Every `taichi-cloth ...` of a page is one that the command line takes."""
    from taichi_cloth.app.cli import _parser

    mine = [(page, line, words) for page, line, words in ALL if words[0] == "taichi-cloth"]
    assert len(mine) > 20
    for page, line, words in mine:
        try:
            _parser().parse_args(words[1:])
        except SystemExit:
            pytest.fail(f"{page.name}, line {line}: {' '.join(words)}: {capsys.readouterr().err}")


def test_lines_of_the_readme_need_nothing_that_they_do_not_name():
    """A file is in the clone, made by a line before, or said to be the reader's; an extra is named."""
    extras = {"view": "view", "blend": "blender", "sweep": "sweep", "fit": "fit", "dress": "garment", "look": "gltf"}
    lines = [line for _, block in blocks(ROOT / "README.md", "") for line in block.splitlines() if "taichi-cloth " in line]
    made, seen = {"out/hang"}, set()
    for line in lines:
        command, _, comment = line.partition("#")
        words = shlex.split(command.split("&&")[-1])[1:]
        if "--light" in words:  # another than the scene's own, or it shows nothing
            assert words[words.index("--light") + 1] != scenefile.read("hang").make({}).view.light, line
        if words[0] in extras:
            seen.add(words[0])
            assert f"extra `{extras[words[0]]}`" in comment, line
        for before, word in zip(words, words[1:]):
            if before in ("--to", "--out"):
                made.add(word)
            elif re.search(r"[a-z]/[a-z]|[a-z]\.[a-z]", word):
                own = (ROOT / word).exists() or any(pathlib.PurePath(word).is_relative_to(path) for path in made)
                assert own or "of yours" in comment, line
    assert seen == set(extras)


def test_the_readme_names_all_solids_and_the_default_method():
    text = (ROOT / "README.md").read_text()
    solids = [name for name, made in vars(primitives).items() if dataclasses.is_dataclass(made)]
    assert len(solids) == 5 and all(f"`{name}(" in text.replace("tc.", "") for name in [*solids, "SolidMesh"])
    assert f"`{tc.Options().integrator}`" in text


def test_scripts_are_there():
    """Every `python scripts/x.py --flag` of a page names a script, and flags that are in it."""
    mine = [(page, line, words) for page, line, words in ALL if words[:1] == ["python"]]
    mine += [(page, 0, shlex.split(found)) for page in PAGES
             for found in re.findall(r"`(python scripts/[^`\n]*)`", page.read_text())]
    assert len(mine) > 5
    for page, line, words in mine:
        if not words[1].startswith("scripts/"):
            continue
        script = ROOT / words[1]
        assert script.is_file(), f"{page.name}, line {line}: {words[1]}"
        text = script.read_text()
        for flag in (word for word in words[2:] if word.startswith("--")):
            assert f'"{flag}"' in text, f"{page.name}, line {line}: {words[1]} has no {flag}"


LINKED = [*PAGES, ROOT / "DESIGN.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]


def anchors(page: pathlib.Path) -> set[str]:
    """The names by which a page's headings are linked to: lower case, words joined by hyphens, as mkdocs makes them."""
    headings = re.findall(r"^#+ (.*)$", BLOCK.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()) for heading in headings}


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    """Files are there, and headings within them."""
    text = BLOCK.sub("", page.read_text())
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", text):
        if "://" in target:
            continue
        assert os.path.exists(page.parent / target), f"{page.name}: {target}"
        if anchor and (not target or target.endswith(".md")):
            assert anchor in anchors(page.parent / target if target else page), f"{page.name}: {target}#{anchor}"


def test_arrays_of_a_frame_are_those_that_are_recorded():
    page, code = (ROOT / "docs/tutorials/output.md").read_text(), ROOT / "taichi_cloth"
    table = page[page.index("| array | shape |"):].partition("\n\n")[0]
    told = re.findall(r"`(\w+)`", "".join(line.split("|")[1] for line in table.splitlines()[2:]))
    frame = (code / "recording/record.py").read_text().partition("def frame(")[2].partition("\ndef ")[0]
    kept = re.findall(r'out\["(\w+)"\]|[{ ]"(\w+)": ', frame)
    for path in (code / "forces").glob("*.py"):
        recorded = path.read_text().partition("def recorded(")[2].partition("\n    def ")[0]
        kept += re.findall(r'["{| ]+"(\w+)(?=": self)()', recorded)
    assert set(told) == {a or b for a, b in kept}


FILES = {path.relative_to(ROOT).as_posix(): path for folder in ("taichi_cloth", "scripts", "tests")
         for path in (ROOT / folder).rglob("*.py")}
EXPLAINS = [ROOT / "docs/glossary.md", *sorted((ROOT / "docs/theory").glob("*.md"))]


@pytest.mark.parametrize("page", EXPLAINS, ids=lambda page: page.stem)
def test_code_that_is_named_is_there(page):
    """Files (`contact/barrier.py`), classes (`solver/multilevel.Multilevel`, `Layers.bore`) and their members."""
    text = page.read_text()
    for name in re.findall(r"`([\w/]+\.py)`", text):
        assert any(f"/{path}".endswith(f"/{name}") for path in FILES), f"{page.name}: no file {name}"
    source = "".join(path.read_text() for path in FILES.values() if "taichi_cloth" in path.parts)
    named = re.findall(r"`(?:[a-z_/]+[./])?([A-Z][a-z]\w+)(?:\.([a-z_]\w*))?`", text)
    for name, member in named:
        assert re.search(rf"class {name}\b", source), f"{page.name}: no class {name}"
        assert not member or re.search(rf"\b{member}\b", source), f"{page.name}: nothing is called {name}.{member}"
    assert named or page.stem != "glossary"
