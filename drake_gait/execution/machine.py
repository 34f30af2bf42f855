"""The number of processes that this machine, or our part of it, has room for."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

DRIVER_MEMORY = 1000e6
"""What a search holds beside its workers when it writes its report [bytes]."""
WORKER_MEMORY = 220e6
"""What a worker may hold before it is replaced [bytes]."""

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a process whose libraries compute in one thread.

Two cores run two walks faster than two walks that each want two threads, and the matrices of a
search are small. A library reads it when it is loaded, so it is set before that.
"""

_ROOT = Path("/")


def default_workers(most: int, *, memory: float = WORKER_MEMORY, system: Path = _ROOT) -> int:
    """Return a number of processes: one per core, as far as there is memory and work for them.

    Args:
        most: How many can have something to do, 1 or more.
        memory: What each of them holds [bytes].
        system: The folder whose `proc` and `sys` tell.
    """
    room = (memory_limit(system) - DRIVER_MEMORY) / memory
    return int(max(1, min(cores(system), room, most)))


def cores(system: Path = _ROOT) -> int:
    """Return the number of cores that this process may keep busy.

    Its affinity and a container's quota count; a part of a core is one.

    Args:
        system: The folder whose `proc` and `sys` tell of quotas.
    """
    # From Python 3.13 on the first one; not every system has the second.
    process_cpu_count = getattr(os, "process_cpu_count", None)
    if process_cpu_count is not None:
        found = process_cpu_count() or 1
    elif hasattr(os, "sched_getaffinity"):
        found = len(os.sched_getaffinity(0))
    else:
        found = os.cpu_count() or 1
    for group in _groups("cpu", system):
        quota = _quota(group)
        if quota is not None:
            found = min(found, math.ceil(quota))
    return found


def memory_limit(system: Path = _ROOT) -> float:
    """Return the memory of this machine, or what a container may take of it [bytes].

    Infinite where the system does not tell.

    Args:
        system: The folder whose `proc` and `sys` tell of limits.
    """
    try:
        found = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError):
        found = float("inf")
    if found <= 0.0:
        found = float("inf")
    for group in _groups("memory", system):
        for name in ("memory.max", "memory.high", "memory.limit_in_bytes"):
            limits = _numbers(group / name)
            if limits:
                found = min(found, limits[0])
    return found


def _quota(group: Path) -> float | None:
    """Cores that a group may keep busy on average; None where it has no limit."""
    numbers = _numbers(group / "cpu.max")  # Version 2: time per period.
    if not numbers:
        numbers = _numbers(group / "cpu.cfs_quota_us") + _numbers(group / "cpu.cfs_period_us")
    if len(numbers) != 2 or not min(numbers) > 0.0 or numbers[0] == float("inf"):
        return None
    return numbers[0] / numbers[1]


def _numbers(path: Path) -> list[float]:
    """The numbers in a file of the system, `max` as infinite; none where there is no such file."""
    try:
        words = path.read_text(encoding="ascii").split()
        return [float("inf") if word == "max" else float(word) for word in words]
    except (OSError, ValueError):
        return []


def _groups(controller: str, system: Path) -> Iterator[Path]:
    """The control groups that this process is in, the outermost first (cgroups(7)).

    A container may show its own group as the root of all, and yet name it as its host does.
    """
    try:
        listed = system / "proc/self/cgroup"
        lines = listed.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return
    mounted = system / "sys/fs/cgroup"
    for line in lines:
        _, controllers, path = (*line.split(":", 2), "", "")[:3]
        if controllers == "":  # Version 2, and beside version 1.
            roots = [mounted, mounted / "unified"]
        elif controller in controllers.split(","):
            roots = [mounted / controllers, mounted / controller]
        else:
            continue
        for root in roots:
            group = root
            yield group
            for name in path.split("/"):
                if name and name != "..":
                    group = group / name
                    yield group
