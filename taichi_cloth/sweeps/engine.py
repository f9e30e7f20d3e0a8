"""Where the runs of a sweep are done: one after the other in this process, or as tasks of Dask distributed."""

import contextlib
import logging
import multiprocessing
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..errors import BackendError, SceneError, shown
from .task import LOST, Outcome, Task, perform

TRIES = 3  # workers that may die of a run before it is given up
QUIET = {"distributed.scheduler.allowed-failures": TRIES, "distributed.scheduler.worker-saturation": 1.0,
         "distributed.worker.memory.pause": False, "distributed.worker.memory.terminate": False}


def serially(tasks: Sequence[Task]) -> Iterator[tuple[int, Outcome]]:
    """(number, outcome) of each task, in this process."""
    for k, task in enumerate(tasks):
        yield k, perform(task)


def on_workers(tasks: Sequence[Task], workers: int, scheduler: str | None, slurm: Mapping[str, Any] | None,
               gpu: bool) -> Iterator[tuple[int, Outcome]]:
    """(number, outcome) of each task as it is done; a run whose worker dies is done again by another.

    Args:
        workers: processes with one core each, or one GPU each where `gpu`; not used with `scheduler`.
        scheduler: address of one that runs, such as "tcp://10.0.0.5:8786".
        slurm: arguments of dask_jobqueue's SLURMCluster.

    Raises:
        BackendError: no Dask, no scheduler at the address, workers with several threads, or a scheduler that goes away.
    """
    distributed = needs("distributed", "sweeps on several workers; --workers 0 (workers=0) runs one after the other")
    _forbid_import_loop()
    import dask

    with dask.config.set(QUIET), contextlib.ExitStack() as stack:
        local = scheduler is None and slurm is None
        if scheduler is not None:
            place: Any = scheduler
        elif slurm is not None:
            place = stack.enter_context(_slurm(slurm, workers))
        else:
            place = stack.enter_context(distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0, dashboard_address=None,
                silence_logs=logging.CRITICAL))
        try:
            client = stack.enter_context(distributed.Client(place))
        except (OSError, ValueError) as error:
            raise BackendError(f"no Dask scheduler answers at {scheduler}: {error}") from None
        threads = {w["nthreads"] for w in client.scheduler_info(n_workers=-1)["workers"].values()}
        if threads - {1}:
            raise BackendError(f"the scheduler's workers have {max(threads)} threads: Taichi runs once in a process, so start "
                               "them with one (dask worker --nthreads 1)")
        futures = {client.submit(_perform_there, task, local, gpu, pure=False): k for k, task in enumerate(tasks)}
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
    except Exception as error:  # what Dask could not send, or a worker could not import
        return Outcome(LOST, type(error).__name__, f"the worker could not take the run: {shown(error, 300)}", {}, 0.0)


def _perform_there(task: Task, local: bool, gpu: bool) -> Outcome:
    """On a worker: with a core or a GPU of its own where all workers are on this machine."""
    if local:
        import distributed

        number = distributed.get_worker().name
        if gpu:
            os.environ["CUDA_VISIBLE_DEVICES"] = str(number)
        elif hasattr(os, "sched_setaffinity"):
            cores = _cores()
            os.sched_setaffinity(0, {cores[int(number) % len(cores)]})
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
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def needs(package: str, what: str):
    """A package of the extra `sweep`.

    Raises:
        BackendError: it is not installed.
    """
    import importlib

    try:
        return importlib.import_module(package)
    except ImportError:
        raise BackendError(f'{package} is not installed: pip install "taichi-cloth[sweep]" for {what}') from None


def _slurm(given: Mapping[str, Any], workers: int):
    """A cluster whose workers are jobs of Slurm."""
    jobqueue = needs("dask_jobqueue", "sweeps on Slurm")
    try:
        cluster = jobqueue.SLURMCluster(**{"cores": 1, "processes": 1, "memory": "2GB", **given})
    except (TypeError, ValueError) as error:
        raise SceneError(f"slurm: {error}") from None
    cluster.scale(jobs=workers)
    return cluster


def _forbid_import_loop() -> None:
    """A worker's start imports the script that asked for it; without a guard that would ask for workers again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise BackendError('a script that calls tc.sweep needs `if __name__ == "__main__":` before the call: every worker '
                           "imports the script when it starts")
