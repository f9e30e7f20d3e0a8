"""Plugin of pytest for `perturb.py`: what every simulation of a test starts from is moved by a rounding, on so many threads.

    python -m pytest -n 0 -p perturbing --perturb-start 3 --perturb-threads 2 --perturb-results out.jsonl tests/hard

Every vertex that is not held goes by up to `SIZE` in each direction, both sides of a seam as one. How far depends on the
start and the number of vertices alone, so that runs which a test compares are perturbed alike. Start 0 moves nothing.
Tests with a result in the file are left out; each of the others adds a line as it begins, and one as it ends.
"""

import json
import pathlib

import numpy as np
import pytest
from perturb import read_rows

SIZE = 1e-9  # m
PATIENCE = 10  # times as long as a test may take else: these runs are made in the background


def pytest_addoption(parser: pytest.Parser) -> None:
    """What `perturb.py` asks for."""
    group = parser.getgroup("perturbing")
    group.addoption("--perturb-start", type=int, default=0, help="number of the start; 0 is the test's own")
    group.addoption("--perturb-threads", type=int, default=1, help="CPU threads where a test asks for no number")
    group.addoption("--perturb-longest", type=float, default=1e9, help="s that a test may have taken in a result so far")
    group.addoption("--perturb-results", type=pathlib.Path, required=True, help="file of results, a JSON object a line")


def pytest_configure(config: pytest.Config) -> None:
    """Results are kept only where the plugin is asked for."""
    config.pluginmanager.register(Recorder(config), "perturbing-recorder")


def noise(sim, start: int) -> np.ndarray:
    """(n, 3) [m] by which the particles of a simulation that is about to begin are moved."""
    model = sim.model
    size = max(SIZE, sim.runtime.epsilon * np.abs(model.read_particles()[0]).max())  # in f32, what it can tell apart
    moved = np.random.default_rng([start, sim.vertex_count]).uniform(-size, size, (sim.vertex_count, 3))[model.user]
    cluster = _cluster_ids(model)
    moved, held = moved[cluster], sim.prescribed.held(0.0)
    if held is not None:
        moved[np.isin(cluster, cluster[held.index])] = 0.0
    return moved


def _cluster_ids(model) -> np.ndarray:
    """(n,) one particle for all that seams join, open ones too: their sides may touch, and are to start as near."""
    from taichi_cloth.system.seams import connected

    cluster = np.arange(model.n)
    if model.sewn is not None:
        label = connected(model.n, model.sewn.a, model.sewn.b)
        first = np.unique(label, return_index=True)[1][int(label.min() < 0):]  # -1 is what no seam joins
        cluster[label >= 0] = first[label[label >= 0]]
    return cluster


class Recorder:
    """Perturbs the simulations of a session's tests, and writes down what comes of each test."""

    def __init__(self, config: pytest.Config) -> None:
        self.file = config.getoption("--perturb-results")
        self.start, self.threads = config.getoption("--perturb-start"), config.getoption("--perturb-threads")
        self.config, self.used = config, []

    def write(self, **row: object) -> None:
        """Adds a line to the file."""
        with open(self.file, "a", encoding="utf-8") as file:
            file.write(json.dumps({**row, "start": self.start, "threads": self.threads}) + "\n")

    def pytest_sessionstart(self) -> None:
        """Simulations start perturbed from now on; conftest.py has set Taichi's environment by now."""
        from taichi_cloth.simulation.parts import Parts

        settle = Parts._resolve_initial_overlap

        def perturbed(sim) -> None:
            if self.start:
                x, v = sim.model.read_particles()
                sim.model.write_particles(x + noise(sim, self.start), v)
            self.used.append([sim.runtime.threads, sim.model.blocks.count])
            settle(sim)

        Parts._resolve_initial_overlap = perturbed
        for plugin in self.config.pluginmanager.get_plugins():
            if hasattr(plugin, "LONGEST"):
                plugin.LONGEST, plugin.THREADS = PATIENCE * plugin.LONGEST, self.threads

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Only tests without a result of this start and number of threads are left."""
        longest = self.config.getoption("--perturb-longest")
        done = {row["test"] for row in read_rows(self.file) if row["outcome"] != "begun" and
                ((row["start"], row["threads"]) == (self.start, self.threads) or row["seconds"] > longest)}
        items[:] = [item for item in items if item.nodeid not in done]

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test that ends the process is known by this line."""
        self.used.clear()
        self.write(test=nodeid, outcome="begun")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """The call's outcome, or the set-up's or tear-down's where it did not pass."""
        if report.when == "call" or (report.when == "setup" and not report.passed) or report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            said = crash.message if crash is not None else str(report.longrepr or "")
            self.write(test=report.nodeid, outcome=report.outcome, seconds=round(report.duration, 2), message=said[:600],
                       used=sorted(map(list, {tuple(pair) for pair in self.used})))
