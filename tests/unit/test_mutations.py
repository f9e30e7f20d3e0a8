"""The lists of one-line bugs in scripts/mutations/ fit the code, and the runner tells what is noticed from what is not."""

import importlib.util
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]


def load_runner():
    """scripts/mutate.py as a module."""
    spec = importlib.util.spec_from_file_location("mutate", ROOT / "scripts" / "mutate.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutate"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


mutate = load_runner()


@pytest.mark.parametrize("area", mutate.areas())
def test_each_bug_has_its_place_in_the_code(area):
    rows = mutate.read_list(area)
    assert rows
    for m in rows:
        text = (ROOT / m.file).read_text(encoding="utf-8")
        assert text.count(m.old) == 1 and m.new != m.old, f"{m.file}: {m.old!r} occurs {text.count(m.old)} times"
        for test in m.tests:
            there = test.startswith("tests/") and (ROOT / test.split("::")[0]).exists()
            assert there or test.startswith("-") or " " in test, test


def test_the_runner_tells_noticed_from_survived_and_stale(tmp_path):
    (tmp_path / "test_it.py").write_text("from it import add\ndef test_add():\n    assert add(2, 2) == 4\n")
    (tmp_path / "it.py").write_text("def add(a, b):\n    return a + b  # a sum\n")
    copy = object.__new__(mutate.Copy)
    copy.folder, copy.environment = tmp_path, {"PATH": "", "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}

    def outcome(old, new, tests=("test_it.py",)):
        return copy.try_out(mutate.Mutation("it", "it.py", old, new, "wrong", tests), 60).outcome

    assert outcome("a + b", "a - b") == "noticed"
    assert outcome("a + b", "b + a") == "survived"
    assert outcome("a + c", "b") == "stale"
    assert outcome("a + b", "a - b", ("-k", "nothing")) == "stale"
    assert "return a + b  # a sum" in (tmp_path / "it.py").read_text()  # as it was
