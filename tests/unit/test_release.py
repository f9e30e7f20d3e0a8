"""A release: versions agree, nothing is missing from the wheel, old names go when they should, and each fault is named."""

import pathlib
import re
import shutil
import sys
import zipfile

import pytest

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import release  # noqa: E402


def test_this_checkout_may_be_released():
    import taichi_cloth as tc

    assert set(release.versions().values()) == {tc.__version__}
    assert release.disagreements() == release.old_names() == []


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The places of versions, elsewhere."""
    for name in release.PLACES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tmp_path / name)
    monkeypatch.setattr(release, "ROOT", tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", [name for name in release.PLACES if name != "pyproject.toml"])
def test_a_place_with_another_version_is_named(copied, name):
    found = re.search(release.PLACES[name], (copied / name).read_text(), re.MULTILINE)
    changed = found[0].replace(found[1], "0, 1, 7" if "," in found[1] else "0.1.7")
    (copied / name).write_text((copied / name).read_text().replace(found[0], changed, 1))
    faults = release.disagreements()
    assert faults[0] == f"{name} states version 0.1.7, pyproject.toml {release.versions()['pyproject.toml']}"
    (copied / name).write_text("")
    assert release.disagreements()[0].startswith(f"{name} states version none, ")


def test_another_date_is_named(copied):
    cited = copied / "CITATION.cff"
    cited.write_text(cited.read_text().replace("date-released: 20", "date-released: 19"))
    assert len(release.disagreements()) == 1 and "CITATION.cff is of 19" in release.disagreements()[0]


def test_old_names_go_with_the_release_that_was_told(copied):
    from taichi_cloth.renamed import UNTIL

    file = copied / "pyproject.toml"
    file.write_text(file.read_text().replace(f'version = "{release.versions()["pyproject.toml"]}"', f'version = "{UNTIL}.0"'))
    assert release.old_names() == [f"taichi_cloth/renamed.py has names to be dropped in {UNTIL}"]


def test_files_under_version_control_are_found_in_a_wheel(tmp_path):
    """Whole, with one file left out, one changed and one too many."""
    files = ["taichi_cloth/errors.py", "taichi_cloth/output/report_template.html", "scenes/hang.py",
             "scenes/patterns/skirt.json"]
    inside = {name.replace("scenes/", "taichi_cloth/bundled_scenes/"): (ROOT / name).read_bytes() for name in files}

    def faults(content: dict[str, bytes], license: str = "x-1.dist-info/licenses/LICENSE") -> list[str]:
        with zipfile.ZipFile(tmp_path / "x.whl", "w") as wheel:
            for name, data in {**content, license: b"", "x-1.dist-info/RECORD": b""}.items():
                wheel.writestr(name, data)
        return release.faults_of_wheel(tmp_path / "x.whl", files)

    assert faults(inside) == []
    pattern = "taichi_cloth/bundled_scenes/patterns/skirt.json"
    assert faults({k: v for k, v in inside.items() if k != pattern}) == ["x.whl lacks scenes/patterns/skirt.json"]
    assert faults({**inside, pattern: b"{}"}) == [f"x.whl has another {pattern}"]
    left = "taichi_cloth/notes.txt"
    assert faults({**inside, left: b""}) == [f"x.whl has {left}, which is not under version control"]
    assert faults(inside, "x-1.dist-info/METADATA") == ["x.whl lacks LICENSE"]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no checkout under version control")
def test_files_of_data_count_too():
    assert {"taichi_cloth/output/report_template.html", "scenes/patterns/dress.json", "taichi_cloth/errors.py",
            "scenes/hang.py"} <= set(release.tracked())
