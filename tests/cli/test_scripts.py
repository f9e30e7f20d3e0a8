"""The benchmarks in scripts/ run, on meshes far too small to say anything, and write tables that can be laid side by side."""

import json

import pytest
from test_cli import ROOT, call_script

pytestmark = pytest.mark.slow

BENCHES = {
    "bench_product": ["--sizes", "9", "--precision", "f64", "--rounds", "1"],
    "bench_solver": ["--sizes", "9", "--meshes", "sheet", "slit", "--rounds", "1", "--direct-rounds", "1"],
    "bench_scaling": ["--sizes", "9", "13", "--steps", "1", "--threads", "1", "2"],
    "bench_contact": ["--cells", "8", "--scenes", "sphere_drape", "--until", "0.05", "--rounds", "1"],
    "bench_layers": ["--scenes", "fold", "--until", "0.05", "--cells", "6", "--rounds", "1"],
    "study_cg_tol": ["--scenes", "swing", "--tolerances", "1e-1", "1e-3", "--until", "0.1"],
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
