"""How many processes a machine, or a container on it, has room for."""

import os

import pytest

from drake_gait.execution.machine import (
    DRIVER_MEMORY,
    WORKER_MEMORY,
    cores,
    default_workers,
    memory_limit,
)

GIB = 2**30


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Makes the files that tell of a system: its groups, and what it has set for them."""
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(64)), raising=False)
    monkeypatch.delattr(os, "process_cpu_count", raising=False)
    pages = {"SC_PHYS_PAGES": 256 * GIB // 4096, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(os, "sysconf", pages.__getitem__)

    def make(groups, files):
        (tmp_path / "proc/self").mkdir(parents=True)
        (tmp_path / "proc/self/cgroup").write_text(groups)
        for name, text in files.items():
            path = tmp_path / "sys/fs/cgroup" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return make


VERSION_1 = "5:memory:/docker/abc\n4:cpu,cpuacct:/docker/abc\n1:name=systemd:/\n"


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("", {}, 64),
        ("0::/\n", {"cpu.max": "max 100000\n"}, 64),
        ("0::/\n", {"cpu.max": "250000 100000\n"}, 3),
        ("0::/\n", {"cpu.max": "50000 100000\n"}, 1),
        ("0::/a/b\n", {"a/b/cpu.max": "800000 100000", "a/cpu.max": "400000 100000"}, 4),
        ("0::/../x\n", {"cpu.max": "700000 100000"}, 7),
        (
            VERSION_1,
            {"cpu,cpuacct/cpu.cfs_quota_us": "200000", "cpu,cpuacct/cpu.cfs_period_us": "100000"},
            2,
        ),
        (
            VERSION_1,
            {
                "cpu/docker/abc/cpu.cfs_quota_us": "500000",
                "cpu/docker/abc/cpu.cfs_period_us": "100000",
            },
            5,
        ),
        (VERSION_1, {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, 64),
        ("0::/\n", {"cpu.max": "nonsense"}, 64),
        ("nonsense", {}, 64),
    ],
)
def test_a_container_s_quota_counts(system, groups, files, expected):
    assert cores(system(groups, files)) == expected


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("", {}, 256 * GIB),
        ("0::/\n", {"memory.max": "max\n"}, 256 * GIB),
        ("0::/a/b\n", {"a/memory.max": str(2 * GIB), "a/b/memory.max": "max"}, 2 * GIB),
        ("0::/a\n", {"a/memory.high": str(3 * GIB), "a/memory.max": str(4 * GIB)}, 3 * GIB),
        (VERSION_1, {"memory/memory.limit_in_bytes": str(GIB)}, GIB),
        (VERSION_1, {"memory/memory.limit_in_bytes": "9223372036854771712"}, 256 * GIB),
    ],
)
def test_a_container_s_memory_counts(system, groups, files, expected):
    assert memory_limit(system(groups, files)) == expected


def test_the_number_of_workers_is_what_cores_memory_and_work_allow(system):
    files = {"memory.max": str(int(DRIVER_MEMORY + 5.5 * WORKER_MEMORY)), "cpu.max": "9 1"}
    here = system("0::/\n", files)
    assert default_workers(100, system=here) == 5
    assert default_workers(3, system=here) == 3
    assert default_workers(100, memory=WORKER_MEMORY / 10, system=here) == 9
    assert default_workers(100, memory=100 * WORKER_MEMORY, system=here) == 1


def test_a_system_without_affinity_tells_its_cores(system, monkeypatch):
    here = system("", {})
    monkeypatch.delattr(os, "sched_getaffinity")
    assert cores(here) == 64
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert cores(here) == 1
    monkeypatch.setattr(os, "process_cpu_count", lambda: 7, raising=False)
    assert cores(here) == 7


@pytest.mark.parametrize("error", [ValueError, OSError])
def test_a_system_that_does_not_tell_its_memory_has_enough(system, monkeypatch, error):
    def refuse(name):
        raise error

    here = system("", {})
    monkeypatch.setattr(os, "sysconf", refuse)
    assert memory_limit(here) == float("inf")
    assert default_workers(12, system=here) == 12


def test_this_machine_has_room_for_a_worker():
    assert 1 <= default_workers(1000) <= cores() <= (os.cpu_count() or 1)
