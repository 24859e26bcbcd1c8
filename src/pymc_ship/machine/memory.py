"""Memory of this process on Linux and macOS; unknown on Windows."""

import sys
from contextlib import suppress


def peak_memory() -> int | None:
    """Largest resident memory of this process so far [bytes]; None on Windows."""
    with suppress(ImportError):
        import resource

        unit = 1 if sys.platform == "darwin" else 1024
        return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return None


def address_space() -> float:
    """Limit of the address space of this process [bytes]; infinite without a limit and on Windows."""
    with suppress(ImportError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        return float("inf") if limit == resource.RLIM_INFINITY else float(limit)
    return float("inf")
