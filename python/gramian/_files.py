"""Files written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

__all__ = ["read_whole", "write_whole"]

#: A file that a command reads may have so many bytes.
SIZE_LIMIT = 1 << 29


def read_whole(path: Path, limit: int = SIZE_LIMIT) -> bytes:
    """Return what is in a regular file of at most `limit` bytes.

    A device has no end, and a pipe may have no beginning.

    Raises
    ------
    OSError
        It is not there, no regular file, too large, or cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise OSError("is not a regular file")
        size = path.stat().st_size
        if size > limit:
            raise OSError(
                f"has {size / 2**20:.0f} MiB, more than the limit of {limit / 2**20:.0f} MiB"
            )
        return path.read_bytes()
    except ValueError as error:  # a NUL in the name
        raise OSError(str(error)) from error


def write_whole(file: Path, content: bytes) -> None:
    """Write a file so that at any moment it is there whole, as before, or not at all.

    The content goes to another name beside it, unique so that two writers do not mix, is
    forced to the disk, and renamed.

    Raises
    ------
    OSError
        Writing failed; what was there before is as it was.
    """
    part: str | None = None
    try:
        handle, part = tempfile.mkstemp(prefix=f".{file.name}.", suffix=".part", dir=file.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(part, 0o666 & ~mask)
        os.replace(part, file)
    except BaseException:
        if part is not None:
            with suppress(OSError):
                os.unlink(part)
        raise
    if os.name == "posix":
        directory = os.open(file.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
