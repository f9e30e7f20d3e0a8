"""Number of CPU cores that a process may use: those that it may run on, and its container's share of their time."""

import math
import os
import pathlib

GROUPS, OWN = pathlib.Path("/sys/fs/cgroup"), pathlib.Path("/proc/self/cgroup")


def cores() -> int:
    """CPU cores that the process may use: more threads than that would wait for each other."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(there, math.ceil(min(_given(GROUPS, OWN), there))))


def _given(groups: pathlib.Path, own: pathlib.Path) -> float:
    """Cores' time that the process's control groups, and those above them, are given; infinite where nothing bounds it."""
    least = math.inf
    for line in _text(own).splitlines():
        _, _, rest = line.partition(":")
        kinds, _, path = rest.partition(":")
        if kinds and "cpu" not in kinds.split(","):
            continue
        base = groups / kinds if kinds else groups
        inside = base / path.lstrip("/")
        for folder in (inside, *inside.parents):
            least = min(least, _of(folder))
            if folder == base:
                break
    return min(least, _of(groups), _of(groups / "cpu"))  # in a container the path may be that outside


def _of(group: pathlib.Path) -> float:
    """Cores' time of one group: `cpu.max` of version 2, `cpu.cfs_quota_us` of version 1."""
    words = _text(group / "cpu.max").split() or [_text(group / "cpu.cfs_quota_us"), _text(group / "cpu.cfs_period_us")]
    try:
        time, period = map(float, words)
    except ValueError:  # "max", or no such file
        return math.inf
    return time / period if time > 0 and period > 0 else math.inf


def _text(file: pathlib.Path) -> str:
    try:
        return file.read_text()
    except (OSError, UnicodeDecodeError):
        return ""
