"""Execution of a sweep's runs: one after the other in this process, or as tasks of Dask distributed."""

import contextlib
import logging
import multiprocessing
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import checks
from ..backend.quota import cores
from ..errors import BackendError, SceneError, near, shown
from .task import LOST, Outcome, Task, perform

TRIES = 3  # workers that may die of a run before it is given up
QUIET = {"distributed.scheduler.allowed-failures": TRIES, "distributed.scheduler.worker-saturation": 1.0,
         "distributed.worker.memory.pause": False, "distributed.worker.memory.terminate": False}
NO_PAGES: dict[str, Any] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
TLS = ("ca", "cert", "key")


@dataclass(frozen=True)
class Where:
    """The workers of a sweep: processes here, jobs of Slurm, or a cluster that runs.

    Attributes:
        workers: processes with one core each, or one GPU each where `gpu`; not used with `scheduler`.
        scheduler: address of one that runs, such as "tcp://10.0.0.5:8786".
        slurm: arguments of dask_jobqueue's SLURMCluster.
        tls: files by the names of `TLS`, with which both ends of every connection prove who they are; None if there are
            none, or where Dask's configuration names them.
        dashboard: address at which Dask shows its pages, such as "127.0.0.1:8787"; None has none.
    """

    workers: int
    scheduler: str | None = None
    slurm: Mapping[str, Any] | None = None
    gpu: bool = False
    tls: Mapping[str, str] | None = None
    dashboard: str | None = None


def serially(tasks: Sequence[Task]) -> Iterator[tuple[int, Outcome]]:
    """(number, outcome) of each task, in this process."""
    for k, task in enumerate(tasks):
        yield k, perform(task)


def on_workers(tasks: Sequence[Task], where: Where) -> Iterator[tuple[int, Outcome]]:
    """(number, outcome) of each task as it is done; a run whose worker dies is done again by another.

    Raises:
        BackendError: no Dask, no scheduler at the address, workers with several threads, or a scheduler that goes away.
    """
    distributed = needs("distributed", "sweeps on several workers; --workers 0 (workers=0) runs one after the other")
    _forbid_import_loop()
    import dask

    with dask.config.set(QUIET if where.dashboard else QUIET | NO_PAGES), contextlib.ExitStack() as stack:
        local, security = where.scheduler is None and where.slurm is None, _security(where.tls)
        place = where.scheduler if where.scheduler is not None else stack.enter_context(
            _here(where, security) if where.slurm is None else _slurm(where, security))
        try:
            client = stack.enter_context(distributed.Client(place, security=security))
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise BackendError(f"no Dask scheduler answers at {where.scheduler or 'its own address'}: {error}") from None
        threads = {w["nthreads"] for w in client.scheduler_info(n_workers=-1)["workers"].values()}
        if threads - {1}:
            raise BackendError(f"the scheduler's workers have {max(threads)} threads: Taichi runs once in a process, so start "
                               "them with one (dask worker --nthreads 1)")
        futures = {client.submit(_perform_there, task, local, where.gpu, pure=False): k for k, task in enumerate(tasks)}
        for future in distributed.as_completed(list(futures)):
            yield futures.pop(future), _result(future, distributed)
            future.release()


def _result(future, distributed) -> Outcome:
    try:
        return future.result()
    except distributed.KilledWorker:
        return Outcome(LOST, "WORKER", f"its worker died {TRIES + 1} times: is there enough memory?", {}, 0.0)
    except distributed.CancelledError:
        raise BackendError("the Dask scheduler went away; rows that were done are kept; the same command goes on") from None
    except Exception as error:  # Dask could not send it, or a worker could not import it
        return Outcome(LOST, type(error).__name__, f"the worker could not take the run: {shown(error, 300)}", {}, 0.0)


def _perform_there(task: Task, local: bool, gpu: bool) -> Outcome:
    """On a worker: with a core or a GPU of its own where all workers are on this machine."""
    if local:
        import distributed

        number = distributed.get_worker().name
        if gpu:
            os.environ["CUDA_VISIBLE_DEVICES"] = str(number)
        elif hasattr(os, "sched_setaffinity"):
            there = _cores()
            os.sched_setaffinity(0, {there[int(number) % len(there)]})
    return perform(task)


_seen: list[int] = []


def _cores() -> list[int]:
    """Those that the process had when it began."""
    if not _seen:
        _seen.extend(sorted(os.sched_getaffinity(0)))
    return _seen


def places(gpu: bool) -> int:
    """How many workers fit this machine: its cores, or its GPUs."""
    if gpu:
        try:
            found = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, timeout=30, check=False).stdout
        except OSError:
            found = ""
        return max(1, sum(line.startswith("GPU ") for line in found.splitlines()))
    return cores()


def needs(package: str, what: str, install: str = '"taichi-cloth[sweep]"'):
    """A package that is not among those that are always there.

    Raises:
        BackendError: it is not installed.
    """
    import importlib

    try:
        return importlib.import_module(package)
    except ImportError:
        raise BackendError(f"{package} is not installed: pip install {install} for {what}") from None


def checked_tls(given: object) -> dict[str, str] | None:
    """Files by the names of `TLS`: ca and cert must be there, and key where cert does not hold it.

    Raises:
        SceneError: another name, a name that is missing, or no such file.
    """
    if given is None:
        return None
    out = {}
    for name, file in checks.instance("sweep: tls", given, Mapping).items():  # type: ignore[type-abstract]
        path = checks.path(f"sweep: tls {checks.choice('name in tls', name, TLS)}", file)
        if not path.is_file():
            raise SceneError(f"sweep: tls {name}: no such file: {path}{near(path)}")
        out[name] = str(path.resolve())
    for name in TLS[:2]:
        if name not in out:
            raise SceneError(f"sweep: tls needs {name}, a file in PEM format")
    return out


def _security(tls: Mapping[str, str] | None):
    """Dask's own, of one certificate for all parts; None leaves it to Dask's configuration."""
    if tls is None:
        return None
    from distributed.security import Security

    parts = {f"tls_{part}_{name}": file for part in ("client", "scheduler", "worker")
             for name, file in tls.items() if name != "ca"}
    return Security(require_encryption=True, tls_ca_file=tls["ca"], **parts)


def _here(where: Where, security: Any):
    """A cluster of processes of this machine, which listens to this machine only. Dask asserts that its event loop begins
    within 10 s, which it may not where the machine is busy: it is asked twice."""
    try:
        return _local(where, security)
    except AssertionError:
        return _local(where, security)


def _local(where: Where, security: Any):
    """One try at `_here`."""
    import distributed

    pages = {"dashboard": where.dashboard is not None, "dashboard_address": where.dashboard or "127.0.0.1:0"}
    try:
        return distributed.LocalCluster(
            n_workers=where.workers, threads_per_worker=1, processes=True, memory_limit=0, host="127.0.0.1",
            dashboard_address=None, scheduler_kwargs=pages, security=security, protocol=None if security is None else "tls://",
            silence_logs=logging.CRITICAL)
    except (OSError, ValueError, RuntimeError) as error:
        raise BackendError(f"Dask's workers cannot be started: {error}") from None


def _slurm(where: Where, security: Any):
    """A cluster whose workers are jobs of Slurm."""
    jobqueue = needs("dask_jobqueue", "sweeps on Slurm")
    given: dict[str, Any] = {"cores": 1, "processes": 1, "memory": "2GB", **(where.slurm or {})}
    if security is not None:
        given["security"] = security
    pages = {"dashboard": where.dashboard is not None, "dashboard_address": where.dashboard}
    try:
        given["scheduler_options"] = {**pages, **given.get("scheduler_options", {})}
        if where.dashboard is None:
            given["worker_extra_args"] = [*given.get("worker_extra_args", ()), "--no-dashboard"]
        cluster = jobqueue.SLURMCluster(**given)
    except (TypeError, ValueError) as error:
        raise SceneError(f"slurm: {error}") from None
    cluster.scale(jobs=where.workers)
    return cluster


def _forbid_import_loop() -> None:
    """A worker's start imports the script that asked for it; without a guard that would ask for workers again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise BackendError('a script that calls tc.sweep needs `if __name__ == "__main__":` before the call: every worker '
                           "imports the script when it starts")
