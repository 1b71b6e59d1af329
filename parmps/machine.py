"""What the machine has left: memory and disk."""

import os
import shutil
from pathlib import Path

CGROUPS = Path("/sys/fs/cgroup")
LIMITS = {"": ("memory.max", "memory.current"), "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes")}
"""Files of a control group's limit and use, by its controllers in /proc/self/cgroup: version 2 names none there."""


def available_memory():
    """Memory that a process can still have without swapping, bytes; None where the system does not tell.

    The least of what the kernel says is available and of what the limits of the control groups leave, in which
    containers and batch systems put their processes. Files that are only cached count as free.
    """
    found = []
    try:
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        found.append(1024 * int(lines["MemAvailable"].split()[0]))
        groups = [line.split(":", 2) for line in Path("/proc/self/cgroup").read_text().splitlines()]
    except (OSError, KeyError, ValueError):
        groups = []
    for _, controllers, path in groups:
        if controllers in LIMITS:
            root = CGROUPS / controllers
            group = root / path.lstrip("/")
            # inside a container the path may be that of the host
            for place in [group, *group.parents] if group.is_dir() else [root]:
                if place == root or root in place.parents:
                    found.append(_left_in(place, *LIMITS[controllers]))
    return min((left for left in found if left is not None), default=None)


def _left_in(group, limit, use):
    """What the limit of a control group leaves, bytes; None without a limit."""
    try:
        most, used = int((group / limit).read_text()), int((group / use).read_text())
        stat = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):  # no such file, or the limit is "max"
        return None
    cached = int(stat.get("total_inactive_file", stat.get("inactive_file", 0)))
    return max(most - used + cached, 0)


def free_disk(path):
    """Space left where a directory is or would be made, bytes.

    Parameters
    ----------
    path : path-like
    """
    path = Path(path).absolute()
    while not os.path.isdir(path):
        path = path.parent
    return shutil.disk_usage(path).free
