"""Cores that a process may use, by files as systems and containers have them."""

import math
import os

import pytest

from taichi_cloth.backend import quota


def files(folder, own, **given):
    """Control groups in a folder, and what the process says of its own; files by their paths, with "__" for "/"."""
    for name, text in given.items():
        path = folder / "groups" / name.replace("__", "/").replace("cpu_", "cpu.")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "own").write_text(own)
    return folder / "groups", folder / "own"


@pytest.mark.parametrize("own, given, cores", [
    ("0::/\n", {"cpu_max": "150000 100000\n"}, 1.5),
    ("0::/\n", {"cpu_max": "max 100000\n"}, math.inf),
    ("0::/a/b\n", {"a__cpu_max": "200000 100000\n", "a__b__cpu_max": "max 100000\n"}, 2.0),
    ("0::/a/b\n", {"a__cpu_max": "800000 100000\n", "a__b__cpu_max": "50000 100000\n"}, 0.5),
    ("0::/../outside\n", {"cpu_max": "300000 100000\n"}, 3.0),
    ("4:cpu:/x\n2:cpuset:/\n", {"cpu__x__cpu_cfs_quota_us": "400000\n", "cpu__x__cpu_cfs_period_us": "100000\n"}, 4.0),
    ("4:cpu:/outside\n", {"cpu__cpu_cfs_quota_us": "250000\n", "cpu__cpu_cfs_period_us": "100000\n"}, 2.5),
    ("4:cpu:/\n", {"cpu__cpu_cfs_quota_us": "-1\n", "cpu__cpu_cfs_period_us": "100000\n"}, math.inf),
    ("", {}, math.inf), ("nonsense", {"cpu_max": "what is this"}, math.inf),
])
def test_what_a_container_is_given(tmp_path, own, given, cores):
    assert quota._given(*files(tmp_path, own, **given)) == cores


@pytest.mark.parametrize("given, cores", [(0.3, 1), (1.0, 1), (1.2, 2), (1e6, None), (math.inf, None)])
def test_parts_of_a_core_count_as_one(monkeypatch, given, cores):
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    monkeypatch.setattr(quota, "_given", lambda groups, own: given)
    assert quota.cores() == (there if cores is None else min(cores, there))
