"""Walks on the machines of a Dask cluster, or on one such cluster of local processes.

A Dask worker starts, for each of its threads, a process of its own that walks (worker_process).
So a walk that aborts, hangs or grows costs neither the Dask worker nor its other walks. Its time
limit holds. Dask gives the walks of a lost worker to another one.
"""

import json
import logging
import pickle
import platform
import re
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Self

from drake_gait.errors import SettingsError, WorkerError
from drake_gait.execution.base import RemoteWorkers, Timed
from drake_gait.execution.worker_process import (
    WalkFunction,
    WorkerDiedError,
    WorkerProcess,
)
from drake_gait.problem import Trial
from drake_gait.provenance import source_sha256

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

Identity = Callable[[], Mapping[str, str]]
"""Tells what decides the numbers of a walk on the machine where it is called."""

_CONNECTING_TIME = 10.0  # For a scheduler to answer [s].
_PATIENCE = 120.0  # For workers to come: at the beginning, and when all are lost [s].
_WATCH_INTERVAL = 2.0  # How often to look whether workers are left [s].
_STOPPING_TIME = 1.0  # For workers to hear that they may stop walking [s].
_CLOSING_TIME = 0.4  # For the client, and for a cluster of our own, to end: all of it in 2 s [s].


def identity() -> dict[str, str]:
    """Return all that decides a walk's numbers on this machine, but for its processor.

    The robot is not among it: its content comes with the walks.
    """
    return {
        "python": ".".join(platform.python_version_tuple()[:2]),
        **{package: version(package) for package in ("drake", "numpy")},
        "drake_gait": source_sha256()[:12],
    }


_LOG = logging.getLogger("distributed")


class DaskCluster(RemoteWorkers):
    """Walks on a Dask cluster: `with DaskCluster(walk, "tcp://10.0.0.1:8786") as executor`.

    Args:
        walk: What a worker runs, importable by its name (or a functools.partial of such).
        address: A scheduler's address, the JSON file that one has written, or "local" for a
            cluster on this machine.
        count: Number of that one's workers.
        time_limit: Computing time, or standing still, after which a walk is given up [s].
        identity: What has to be the same here and on every worker; by default the versions of
            Python, Drake, NumPy and this package.

    Raises:
        SettingsError: dask.distributed is not installed, or there is no such file.
        WorkerError: no scheduler answers, it has no workers, or those have something else
            installed than this machine.
    """

    def __init__(
        self,
        walk: WalkFunction,
        address: str,
        *,
        count: int = 1,
        time_limit: float = 120.0,
        identity: Identity = identity,
    ) -> None:
        super().__init__()
        self._address, self._owner = address, uuid.uuid4().hex
        self._task = (pickle.dumps(walk), time_limit, identity, dict(identity()))
        self._promises: set[Future[Timed]] = set()
        self._closed = threading.Event()
        self._log_level = _LOG.level
        self._client, self._cluster = _connected(address, count)
        try:
            self._wait_for_workers()
            self._check_workers()
        except BaseException:
            self._close()
            raise
        self._executor = self._client.get_executor(pure=False)
        threading.Thread(target=self._watch, name="cluster", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closed.set()
        with suppress(Exception):  # A scheduler that is gone has nothing to forget.
            self._executor.shutdown(wait=False)
        # In a thread, because a worker that does not answer must not hold up the end.
        release = threading.Thread(target=self._release, daemon=True)
        release.start()
        release.join(_STOPPING_TIME)
        self._close()

    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have the cluster walk a trial."""
        promise: Future[Timed] = Future()
        self._promises.add(promise)
        task = self._executor.submit(walk_on_worker, trial, self._owner, *self._task)
        task.add_done_callback(lambda task: self._keep(promise, task))
        return promise

    def _keep(self, promise: "Future[Timed]", task: "Future[Timed | Exception]") -> None:
        """Pass on what became of a task, in this package's words."""
        from distributed import KilledWorker

        self._promises.discard(promise)
        with suppress(InvalidStateError):  # Nobody waits for it any more.
            if task.cancelled():
                promise.set_exception(self._lost("the scheduler is gone"))
            elif isinstance(error := task.exception(), KilledWorker):
                deaths = error.allowed_failures + 1
                promise.set_exception(WorkerDiedError(f"its Dask workers died, {deaths} of them"))
            elif error is not None:
                promise.set_exception(error)
            elif isinstance(found := task.result(), Exception):
                promise.set_exception(found)
            else:
                promise.set_result(found)

    def _watch(self) -> None:
        """Break all promises when no worker is left to keep them."""
        seen = time.monotonic()
        while not self._closed.wait(_WATCH_INTERVAL):
            with suppress(Exception):
                if self._client.nthreads():
                    seen = time.monotonic()
            if time.monotonic() - seen > _PATIENCE:
                for promise in list(self._promises):
                    with suppress(InvalidStateError):
                        promise.set_exception(
                            self._lost(f"it has had no worker for {_PATIENCE:g} s")
                        )

    def _lost(self, what: str) -> WorkerError:
        return WorkerError(
            f"Dask cluster {self._address}: {what}; every finished walk is safe: start it again, "
            "and run the command again"
        )

    def _wait_for_workers(self) -> None:
        from distributed import TimeoutError as DaskTimeoutError

        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except DaskTimeoutError:
            raise WorkerError(
                f"Dask scheduler {self._address} has had no worker for {_PATIENCE:g} s; start some "
                "with `dask worker`, and see docs/howto/run_on_a_cluster.md"
            ) from None

    def _check_workers(self) -> None:
        """Refuse workers that would not walk as this machine does."""
        _, _, identity, wanted = self._task
        answers = self._client.run(identity, on_error="return")
        for worker, found in answers.items():
            if isinstance(found, Exception):
                raise WorkerError(f"Dask worker {worker}: {found}; {_CURE}")
            _require_same(worker, found, wanted)

    def _release(self) -> None:
        """End the walks that nobody waits for."""
        with suppress(Exception):
            self._client.run(stop_walks, self._owner)

    def _close(self) -> None:
        # What of a cluster elsewhere does not end in time is not ours to end.
        with suppress(Exception):
            self._client.close(timeout=_CLOSING_TIME)
        if self._cluster is not None:
            with suppress(Exception):
                self._cluster.close(timeout=_CLOSING_TIME)
            _LOG.setLevel(self._log_level)


def _connected(address: str, count: int) -> "tuple[Client, LocalCluster | None]":
    """A client of a scheduler, and the cluster if it was made for it."""
    if find_spec("distributed") is None:
        raise SettingsError("--dask needs dask.distributed: pip install 'drake-gait[cluster]'")
    from distributed import Client, LocalCluster

    if address == "local":
        # Dask silences its own handler only; another library's root handler hears its loggers too.
        _LOG.setLevel(logging.CRITICAL)
        # Its workers are threads: the processes that walk are theirs, and end with them.
        cluster = LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=False,
            protocol="tcp",
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,  # It warns of every walk that a Ctrl-C breaks off.
        )
        return Client(cluster), cluster
    scheduler = _address_in(address) if address.endswith(".json") else address
    if not re.fullmatch(r"(tcp|tls)://\S+:\d+", scheduler):
        raise SettingsError(
            "--dask must be tcp://HOST:PORT, a scheduler file that ends in .json, or local, got "
            f"{scheduler}"
        )
    try:
        return Client(scheduler, timeout=_CONNECTING_TIME), None
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else "no answer"
        raise WorkerError(
            f"no Dask scheduler answers at {address} ({reason}); start one with `dask scheduler`, "
            "and see docs/howto/run_on_a_cluster.md"
        ) from None


def _address_in(scheduler_file: str) -> str:
    """The address in a file that `dask scheduler --scheduler-file` has written."""
    try:
        address: str = json.loads(Path(scheduler_file).read_bytes())["address"]
    except FileNotFoundError:
        raise SettingsError(
            f"no scheduler file {scheduler_file}; `dask scheduler --scheduler-file "
            f"{scheduler_file}` writes it"
        ) from None
    except (OSError, ValueError, KeyError, TypeError):
        raise SettingsError(
            f"{scheduler_file} is no scheduler file; `dask scheduler --scheduler-file` writes one"
        ) from None
    return address


_CURE = "install the same on every machine, and start its workers again"


def _require_same(worker: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    """Refuse a worker on which something else is installed than here."""
    for name, ours in wanted.items():
        if found.get(name) != ours:
            raise WorkerError(
                f"Dask worker {worker} has {name} {found.get(name)}, not {ours}; {_CURE}"
            )


# What follows runs on a Dask worker.

_PROCESSES: dict[tuple[str, int], WorkerProcess] = {}
"""The walking process of each study and thread."""


def walk_on_worker(
    trial: Trial,
    owner: str,
    function: bytes,
    time_limit: float,
    identity: Identity,
    wanted: Mapping[str, str],
) -> Timed | Exception:
    """Walk a trial in the process that belongs to this thread.

    Returns what was raised where something was: Dask writes what is raised into its log, and a
    worker's death is the driver's to tell. WorkerDiedError: the process died of the walk, or was
    killed; WorkerError: what is installed here is not what the driver has.
    """
    key = (owner, threading.get_ident())
    try:
        if key not in _PROCESSES:
            _require_same(platform.node(), identity(), wanted)  # It may have joined since.
            _PROCESSES[key] = WorkerProcess(function, time_limit=time_limit)
        return _PROCESSES[key].walk(trial)
    except Exception as error:
        return error


def stop_walks(owner: str) -> None:
    """Kill the processes of a study."""
    for key in [key for key in _PROCESSES if key[0] == owner]:
        _PROCESSES.pop(key).stop()
