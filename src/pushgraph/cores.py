"""How many cores there are to share out work over."""

import os
import sys


def usable_cores() -> int:
    """Cores that this process may use: fewer than the machine has where a batch system or a container says so."""
    if sys.version_info >= (3, 13):
        return os.process_cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
