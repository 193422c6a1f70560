"""Describe the machine and the versions that figures were measured with; without names of hosts or users."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

import hw_model as hw

PACKAGES = ("numba", "numpy", "scipy")
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")


def machine() -> dict[str, str]:
    """Return processor, caches, memory and versions, as text."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} cores",
        "caches": ", ".join(f"{name} {kib:,} KiB" for name, kib in cache_kib().items())
        or "unknown",
        "memory": _memory(),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "hw_model": getattr(hw, "__version__", version("locsnn-compile")),
    }


def cache_kib() -> dict[str, int]:
    """Return the caches that a core sees and their sizes in KiB, nearest first; empty where the system hides them."""
    kib_of_cache = {}
    for index in sorted(CACHES.glob("index*")):
        level, kind, size = (
            (index / name).read_text().strip() for name in ("level", "type", "size")
        )
        if kind != "Instruction":
            kib_of_cache[f"L{level}"] = int(size.removesuffix("K"))
    return kib_of_cache


def processor() -> str:
    """Return the name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _memory() -> str:
    return f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.0f} GiB"
