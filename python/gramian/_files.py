"""Files read up to a size, and written whole or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

__all__ = ["digest", "files_up_to", "read_text", "read_whole", "write_whole"]

#: A file may have so many bytes; `files_up_to` changes it.
_LIMIT: ContextVar[int] = ContextVar("size limit", default=1 << 29)
#: What a file has beyond its stated size is read in pieces of so many bytes.
_PIECE = 1 << 20


@contextmanager
def files_up_to(limit: int) -> Iterator[None]:
    """Read files of at most `limit` bytes within the block."""
    token = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(token)


def read_whole(path: Path, limit: int | None = None) -> bytes:
    """Return what is in a regular file of at most `limit` bytes.

    A device has no end, and a pipe may have no beginning.

    Raises
    ------
    OSError
        It is not there, no regular file, too large, or cannot be read.
    """
    try:
        limit = _LIMIT.get() if limit is None else limit
        if path.exists() and not path.is_file():
            raise OSError("is not a regular file")
        size = path.stat().st_size
        if size <= limit:
            with path.open("rb") as file:
                # What grows, or does not tell its size, is not read beyond the limit.
                content, piece = file.read(size), b"-"
                while piece and len(content) <= limit:
                    piece = file.read(min(limit + 1 - len(content), _PIECE))
                    content += piece
            size = len(content)
        if size > limit:
            raise OSError(
                f"has {_size(size)}, more than the limit of {_size(limit)}: raise it to read the "
                "file (size_limit, --size-limit)"
            )
        return content
    except ValueError as error:  # a NUL in the name
        raise OSError(str(error)) from error


def _size(count: int) -> str:
    return f"{count / 2**20:.0f} MiB" if count >= 1 << 20 else f"{count} bytes"


#: Control characters that no text has.
_CONTROL = re.compile(r"[\x01-\x08\x0e-\x1a\x1c-\x1f]")


def _unpacked(raw: bytes, limit: int) -> bytes:
    """Return what gzip has packed, of at most `limit` bytes."""
    import gzip  # not before it is needed: `import gramian` stays light
    import io
    import zlib

    try:
        content = gzip.GzipFile(fileobj=io.BytesIO(raw)).read(limit + 1)
    except (EOFError, OSError, zlib.error) as error:
        raise OSError(f"is packed by gzip, and damaged: {error}") from error
    if len(content) > limit:
        raise OSError(
            f"has more than {_size(limit)} once it is unpacked: raise the limit to read the file "
            "(size_limit, --size-limit)"
        )
    return content


def read_text(path: Path, limit: int | None = None) -> str:
    """Return the text of a file, packed by gzip or not: UTF-8, UTF-16 with its mark, or cp1252.

    Raises
    ------
    OSError
        As `read_whole`; and a file that is no text.
    """
    raw = read_whole(path, limit)
    if raw[:2] == b"\x1f\x8b":
        raw = _unpacked(raw, _LIMIT.get() if limit is None else limit)
    if raw[:4] == b"PK\x03\x04":
        raise OSError(
            "is a zip archive, as workbooks (.xlsx, .ods) and .kmz are: save the sheet as CSV, or "
            "unpack it"
        )
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-8-sig", "utf-16") if wide else ("utf-8-sig", "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
        # A logger that lost its power leaves a few: the lines they are in are no good, the rest
        # is. Programs and pictures have other control characters too.
        rest = text.replace("\0", "")
        if 2 * len(rest) > len(text) and not _CONTROL.search(rest):
            return text.replace("\0", "\ufffd")
        break
    raise OSError("is not a text file")


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal; empty where it cannot be read any more."""
    import hashlib  # not before it is needed: `import gramian` stays light

    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def write_whole(file: Path, content: bytes) -> None:
    """Write a file so that at any moment it is there whole, as before, or not at all.

    The content goes to another name beside it, unique so that two writers do not mix, is
    forced to the disk, and renamed.

    Raises
    ------
    OSError
        Writing failed; what was there before is as it was.
    """
    import tempfile  # not before it is needed: `import gramian` stays light

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
