"""Where measured figures come from: the code and the machine, as the reports tell them."""

import datetime
import os
import re
import subprocess
from pathlib import Path


def processor():
    """Number of cores of this machine, and what they are.

    Returns
    -------
    str
    """
    info = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*: (.*)", info.read_text())[1] if info.exists() else "unknown processor"
    return f"{os.cpu_count()} cores, {model}"


def provenance():
    """Commit, day and machine.

    Returns
    -------
    str
    """
    git = ["git", "-C", Path(__file__).parent, "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    return f"commit {commit} on {datetime.date.today()}: {processor()}"
