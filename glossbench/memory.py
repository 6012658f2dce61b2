"""The memory that this process may still use, so that work that would not fit is refused before it is allocated."""

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from glossbench.errors import InputError

_ALWAYS_FITS = 2**30  # bytes; below this the system is not asked
_CGROUPS = Path("/sys/fs/cgroup")


def read_size(text: str) -> int | None:
    """Bytes of a size such as 4 GB or 0.5 TB, in powers of 1000; None if it is not one."""
    stated = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?) ?([kMGT])B", text)
    return round(float(stated[1]) * 1000 ** ("kMGT".index(stated[2]) + 1)) if stated else None


def check_memory(what: str, n_bytes: int) -> None:
    """Raise InputError if something needs more memory than is available; the error gives both numbers."""
    if n_bytes <= _ALWAYS_FITS:
        return
    there = read_available()
    if there is not None and n_bytes > there:
        needs = f"needs about {n_bytes / 1e9:.1f} GB of memory, {max(there, 0) / 1e9:.1f} GB are available"
        raise InputError(f"{what} {needs}")


def read_available() -> int | None:
    """Bytes that this process may still use; None if the system does not say.

    It is the minimum of the memory that the machine has free or can free, of the memory that the control groups leave
    (containers, batch systems), and of the address space that its limit leaves (ulimit -v).
    """
    left = (limit - used for limit, used in _read_control_groups())
    return min((*_read_machine("MemAvailable"), *left, *_read_address_space()), default=None)


def read_capacity() -> int | None:
    """Bytes of memory for all processes of a run together, if nothing else uses any; None if the system does not say.

    It is the minimum of the memory of the machine and of the limits of the control groups.
    """
    limits = (limit for limit, _ in _read_control_groups())
    return min((*_read_machine("MemTotal"), *limits), default=None)


def read_peak() -> int:
    """The most bytes of memory that this process has taken; 0 if the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _read_machine(line: str) -> Iterator[int]:
    """A line of the system's account of memory [bytes]; if there is none, all memory."""
    lines = _read_lines(Path("/proc/meminfo"))
    yield from (1024 * int(each.split()[1]) for each in lines if each.startswith(f"{line}:"))
    if not lines and "SC_PHYS_PAGES" in getattr(os, "sysconf_names", ()):
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _read_control_groups() -> Iterator[tuple[int, int]]:
    """Limit and used bytes of each control group of this process, for versions 1 and 2 of control groups."""
    for line in _read_lines(Path("/proc/self/cgroup")):
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        root = _CGROUPS / controllers
        names = ("memory.max", "memory.current") if not controllers else (
            "memory.limit_in_bytes", "memory.usage_in_bytes")  # fmt: skip
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            if folder.is_relative_to(root):
                limit, used = ([*_read_lines(folder / name), ""][0] for name in names)
                if limit.isdigit() and used.isdigit():
                    cached = sum(
                        int(each.split()[1])
                        for each in _read_lines(folder / "memory.stat")
                        if each.split()[0] == "inactive_file"
                    )
                    yield int(limit), int(used) - cached


def _read_address_space() -> Iterator[int]:
    try:
        import resource
    except ImportError:  # Windows
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    pages = _read_lines(Path("/proc/self/statm"))
    if limit != resource.RLIM_INFINITY:
        yield limit - (int(pages[0].split()[0]) * resource.getpagesize() if pages else 0)


def _read_lines(path: Path) -> list[str]:
    """Lines of a system file; an empty list if the file does not exist."""
    try:
        return path.read_text().splitlines()
    except OSError:
        return []
