"""Measurements and stitches in CSV, patterns in JSON: read in all guises that there are, refused by name where damaged."""

import json
import pathlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.fitting import data
from taichi_cloth.io.jsonfile import parse_json
from taichi_cloth.io.table import read_table

GUISES = {
    "as it is": b"length,drop\n0.1,0.02\n0.2,0.05\n", "byte order mark": b"\xef\xbb\xbflength,drop\n0.1,0.02\n0.2,0.05\n",
    "semicolons": b"length;drop\n0.1;0.02\n0.2;0.05\n", "tabs": b"length\tdrop\n0.1\t0.02\n0.2\t0.05",
    "quotes": b'"length","drop"\r\n"0.1","0.02"\r\n0.2,"0.05"\r\n',
    "spaces": b" length , drop \n 0.1, 2e-2\n\n+.2 ,0.05\n   \n",
    "quotes after spaces": b'"length", "drop"\n"0.1", "0.02"\n0.2, 0.05\n',
    "comments": b"# in m\nlength,drop\n# once\n.1,.02\n.2,.05",
    "carriage returns": b"length,drop\r.1,.02\r.2,.05\r"}
WRONG = {
    b"": "is empty: needs names of columns", b"\n\n# nothing\n": "is empty", b"length,drop\n": "at least one",
    b"length,drop\n.1,x\n": "line 2: drop = 'x': must be a number", b"length,drop\n\n.1,nan\n": "line 3: drop = 'nan'",
    b"length,drop\n.1,-inf\n": "line 2: drop = '-inf'", b"length,drop\n.1,1e400\n": "line 2: drop = '1e400'",
    b"length,drop\n.1,1_0\n": "line 2: drop = '1_0'", b"length,drop\n.1,\n": "line 2: drop = ''",
    b"length,drop\n.1,.2,.3\n": "line 2: has 3 values, not 2", b"length,drop\n.1\n": "line 2: has 1 values, not 2",
    b"length,drop\n0,1,0,02\n": "line 2: has 4 values, not 2",
    b"length;drop\n0,1;0,02\n": "'0,1': must be a number, with a point",
    b"length,length\n.1,.1\n": "line 1: needs a name for each column, each once",
    b"length,,drop\n": "line 1: needs a name for each", b"length," + b"x" * 200 + b"\n": "of at most 60 characters",
    b'length,drop\n".1,.2\n': "line 2: is not a line of a table",
    b'length,drop\n".1"2,.2\n': "line 2: is not a line of a table",
    b"length,drop\n" + b"1" * 200_000 + b",.1\n": "line 2: is not a line",
    b"length,drop\n.1,.2\xff\n": "is not text in UTF-8",
    "length,drop\n.1,.2\n".encode("utf-16"): "line 1 or later: is not text",
    b"\x89PNG\r\n\x1a\n\x00\x00": "is not text in UTF-8", b"length,drop\n.1,\x00\n": "line 2"}


@pytest.mark.parametrize("guise", GUISES)
def test_measurements_are_read_in_every_guise(tmp_path, guise):
    path = tmp_path / "data.csv"
    path.write_bytes(GUISES[guise])
    found = data.read(path, ("length",), ("drop", "angle"))
    assert found["length"].tolist() == [0.1, 0.2] and found["drop"].tolist() == [0.02, 0.05]


@pytest.mark.parametrize("text, words", WRONG.items())
def test_what_is_wrong_with_measurements_is_named_by_its_line(tmp_path, text, words):
    path = tmp_path / "data.csv"
    path.write_bytes(text)
    with pytest.raises(tc.SceneError, match=words) as error:
        data.read(path, ("length",), ("drop", "angle"))
    assert str(path) in str(error.value) and len(str(error.value)) < 400


def test_tables_end_where_there_are_too_many_rows(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("a\n" + "1\n" * 3 + "no number\n")
    with pytest.raises(tc.SceneError, match="line 4: has more than 2 rows"):
        read_table(path, 2)
    with pytest.raises(tc.SceneError, match="did you mean .*data.csv"):
        read_table(tmp_path / "dat.csv", 2)
    with pytest.raises(tc.SceneError, match="cannot be read"):
        read_table(tmp_path, 2)


PANELS = "".join(f"v {x} 0 {z}\nvt {x} {z}\n" for x in (0, 1, 3, 4) for z in (0, 1)) + (
    "f 1/1 3/3 4/4\nf 1/1 4/4 2/2\nf 5/5 7/7 8/8\nf 5/5 8/8 6/6\n")


def test_stitches_are_read_by_the_names_of_their_columns(tmp_path):
    path, table = tmp_path / "panels.obj", tmp_path / "stitches.csv"
    path.write_text(PANELS)
    pairs = []
    for text in (b"vertex,edge_a,edge_b,t\n2,4,5,0\n3,4,5,1\n",
                 b"\xef\xbb\xbfvertex;t;edge_b;edge_a\r\n2;0.0;5;4\r\n3;1;5;4\r\n"):
        table.write_bytes(text)
        seams = tc.load_stitched(path, table).seams
        pairs.append({tuple(sorted(pair)) for seam in seams for pair in zip(seam[0].tolist(), seam[1].tolist())})
    assert pairs[0] == pairs[1] and {(2, 4), (3, 5)} <= pairs[0]
    for text, words in ((b"2,4,5,0\n3,4,5,1\n", "needs four columns, vertex, edge_a, edge_b, t"), (b"vertex,edge_a,edge_b,t\n",
                                                                                                  "has no stitches"),
                        (b"vertex,edge_a,edge_b,t\n2.5,4,5,0\n", "line 2: vertex = 2.5: must be a whole number"),
                        (b"vertex,edge_a,edge_b,t\n2,4,5,0\n3,-1,5,1\n", "line 3: edge_a = -1"),
                        (b"vertex,edge_a,edge_b,t\n2,4,5,nan\n", "line 2: t = 'nan'"), (b"", "is empty")):
        table.write_bytes(text)
        with pytest.raises(tc.SceneError, match=words) as error:
            tc.load_stitched(path, table)
        assert str(table) in str(error.value)


def test_json_is_read_or_one_error_says_why():
    assert parse_json(b'\xef\xbb\xbf{"a": [1, 2.5]}') == {"a": [1, 2.5]}
    assert parse_json("12345678901234567890") == 12345678901234567890
    assert parse_json("1" + "0" * 5000) == np.inf == parse_json("1e400")  # for the checks of what they are for
    for text, words in ((b"", "Expecting value"), (b"{'a': 1}", "line 1 column 2"), (b"\xff\xfe{}", "not text in UTF-8"),
                        (b"[" * 100_000, "nested too deeply"), (b'{"a":' * 100_000, "nested too deeply"),
                        (b"\x00", "Expecting value")):
        with pytest.raises(ValueError, match=words):
            parse_json(text)


@pytest.mark.parametrize("place, value, words", [
    ("units_in_meter", "1" + "0" * 5000, "units_in_meter"), ("units_in_meter", "NaN", "units_in_meter"),
    ("end", "1" + "0" * 5000, "GarmentCode"), ("end", "Infinity", "GarmentCode"), ("end", "[" * 100_000, "nested too deeply"),
    ("corner", "1e400", "vertices of panel 'front'"), ("corner", "1" + "0" * 5000, "vertices of panel 'front'"),
    ("edge", "-Infinity", "GarmentCode"), ("turn", "NaN", "rotation of panel 'front'")])
def test_patterns_with_extreme_numbers_are_refused_by_name(tmp_path, place, value, words):
    numbers = {"units_in_meter": 100, "end": 1, "corner": 40, "edge": 0, "turn": 0} | {place: "HERE"}
    panel = {"vertices": [[0, 0], [numbers["corner"], 0], [40, 40]], "rotation": [numbers["turn"], 0, 0],
             "edges": [{"endpoints": [0, numbers["end"]]}, {"endpoints": [1, 2]}, {"endpoints": [2, 0]}]}
    pattern = {"panels": {"front": panel, "back": panel},
               "stitches": [[{"panel": "front", "edge": numbers["edge"]}, {"panel": "back", "edge": 0}]]}
    text = json.dumps({"pattern": pattern, "properties": {"units_in_meter": numbers["units_in_meter"]}})
    path = tmp_path / "pattern.json"
    path.write_text(text.replace('"HERE"', value))
    with pytest.raises(tc.SceneError, match=words) as error:
        tc.load_pattern(path)
    assert str(path) in str(error.value) and len(str(error.value)) < 400


def test_manifests_that_are_nested_too_deeply_are_damaged(tmp_path):
    from taichi_cloth.output.recording import Recording

    for text in ("[" * 100_000, json.dumps({"checksum": "0"}), "1" + "0" * 5000):
        (tmp_path / "manifest.json").write_text(text)
        with pytest.raises(tc.OutputError, match="manifest.json is damaged"):
            Recording(tmp_path)


@pytest.mark.parametrize("seed", range(4007, 4047))
def test_random_tables_load_or_are_refused(seed, monkeypatch):
    monkeypatch.syspath_prepend(str(pathlib.Path(__file__).parents[2] / "scripts"))
    from fuzzing.tables import trial

    outcome = trial(seed, "f64")
    assert outcome.verdict == "ok", outcome.text
