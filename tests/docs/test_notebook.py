"""The notebook in docs/ runs from top to bottom without Jupyter, and what its cells end with is shown as it should be."""

import ast
import base64
import html
import json
import pathlib
import re

import numpy as np
import pytest

NOTEBOOK = pathlib.Path(__file__).parents[2] / "docs/tutorials/notebook.ipynb"


@pytest.fixture(scope="module")
def notebook():
    return json.loads(NOTEBOOK.read_text())


def cells_of(notebook, kind):
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == kind]


def test_it_is_a_notebook_of_format_4(notebook):
    assert notebook["nbformat"] == 4 and notebook["nbformat_minor"] >= 5 and "kernelspec" in notebook["metadata"]
    names = [cell["id"] for cell in notebook["cells"]]
    assert len(set(names)) == len(names) and all(re.fullmatch(r"[\w-]{1,64}", name) for name in names)
    for cell in notebook["cells"]:
        assert isinstance(cell["metadata"], dict) and all(isinstance(line, str) for line in cell["source"])
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None  # they would be in the way of every change
        else:
            assert cell["cell_type"] == "markdown" and set(cell) == {"cell_type", "id", "metadata", "source"}


def shown(code: str, space: dict):
    """Runs a cell; what it ends with, or None."""
    *body, last = ast.parse(code).body
    if not isinstance(last, ast.Expr):
        body, last = [*body, last], None
    exec(compile(ast.Module(body, []), str(NOTEBOOK), "exec"), space)
    return None if last is None else eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), space)


@pytest.mark.slow
@pytest.mark.restarts
def test_its_cells_run_in_order(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space: dict = {"__name__": "notebook"}
    html_of, pictures, plain = [], [], []
    for code in cells_of(notebook, "code"):
        what = shown(code, space)
        if hasattr(what, "_repr_html_"):
            html_of.append(what._repr_html_())
        elif hasattr(what, "_repr_png_"):
            pictures.append((what, what._repr_png_()))
        else:
            plain.append(what)
    scene, simulation, recording, sweep = html_of
    assert "121 vertices" in scene and "2 vertices held" in scene and "data:image/png;base64," in scene
    assert "t = 0.3 s" in simulation and "data:image/png;base64," in simulation and "no picture" not in simulation
    page = html.unescape(re.fullmatch(r'<iframe srcdoc="([^"]*)"[^>]*></iframe>', recording)[1])
    data = json.loads(re.search(r"const data = (\{.*\});", page)[1])
    first, last = (np.frombuffer(base64.b64decode(data["frames"][k]), "<u2").astype(int) for k in (0, -1))
    assert len(data["frames"]) == 16 and np.abs(first - last).max() > 100  # it moves
    assert "<svg" in sweep and "2 ok" in sweep
    for image, data in pictures:
        assert image.shape == (360, 480, 3) and data.startswith(b"\x89PNG") and np.ptp(np.asarray(image)) > 100
    assert len(pictures) == 2 and (tmp_path / "stretched.png").read_bytes() == pictures[0][1]
    (soft, stiff), = plain
    assert soft > stiff + 0.02 and stiff > 1  # the softer one is drawn out further
    assert pictures[0][0][0]._repr_png_() is None and (pictures[0][0] > 3)._repr_png_() is None  # no pictures


def test_pages_lead_to_it():
    docs = NOTEBOOK.parents[1]
    for page in ("index.md", "quickstart.md"):
        assert "(tutorials/notebook.ipynb)" in (docs / page).read_text(), page
