"""A wall clock that jumps for some processes only: libfaketime, told by a file while they run."""

from pathlib import Path

from edge_runtime.errors import ConfigError

PLACES = ("/usr/lib/*/faketime/libfaketimeMT.so.1", "/usr/lib*/faketime/libfaketimeMT.so.1")


def find_libfaketime() -> Path:
    """Return the library.

    Raises:
        ConfigError: if it is not installed.
    """
    for place in PLACES:
        found = sorted(Path("/").glob(place.lstrip("/")))
        if found:
            return found[0]
    raise ConfigError("the fault clock_jump needs libfaketime (Debian: apt-get install faketime)")


def faked_environment(offset_file: Path) -> dict[str, str]:
    """Return what makes a process take its wall clock's offset from a file, looked at every second."""
    set_offset(offset_file, 0.0)
    return {
        "LD_PRELOAD": str(find_libfaketime()),
        "FAKETIME_TIMESTAMP_FILE": str(offset_file),
        "FAKETIME_CACHE_DURATION": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        "DONT_FAKE_MONOTONIC": "1",
    }


def set_offset(offset_file: Path, seconds: float) -> None:
    """Let the wall clock jump."""
    offset_file.write_text(f"{seconds:+g}\n")
