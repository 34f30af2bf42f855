"""Walks in several processes of this machine."""

import pickle
import queue
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Self

from drake_gait.errors import SettingsError
from drake_gait.execution.base import RemoteWorkers, Timed
from drake_gait.execution.worker_process import WalkFunction, WorkerProcess
from drake_gait.problem import Trial


class LocalProcesses(RemoteWorkers):
    """Walks in processes of this machine: `with LocalProcesses(walk, count=4) as executor`.

    Args:
        walk: What a worker runs, importable by its name (or a functools.partial of such).
        count: Number of processes.
        time_limit: Computing time, or standing still, after which a walk is given up and its
            process replaced [s].
    """

    def __init__(self, walk: WalkFunction, *, count: int, time_limit: float = 120.0) -> None:
        if not count >= 1:
            raise SettingsError(f"workers must be >= 1, got {count}")
        super().__init__()
        function = pickle.dumps(walk)
        self._processes = [WorkerProcess(function, time_limit=time_limit) for _ in range(count)]
        self._idle: queue.SimpleQueue[WorkerProcess] = queue.SimpleQueue()
        for process in self._processes:
            self._idle.put(process)
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="worker")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        for process in self._processes:
            process.stop()
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            process.close()

    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have the next idle process walk a trial."""
        return self._threads.submit(self._walk, trial)

    def _walk(self, trial: Trial) -> Timed:
        process = self._idle.get()
        try:
            return process.walk(trial)
        finally:
            self._idle.put(process)
