"""Finished chunks on disk: what a run that was stopped need not do again.

A directory with a manifest and one Parquet file for each finished chunk. A file
is written under another name, forced to the disk and then renamed, so that at
any moment each chunk is there whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._files import read_whole, write_whole
from gramian.exceptions import GramianError, InputError, StorageError
from gramian.monte_carlo.chunks import MOST, Failure
from gramian.monte_carlo.statistics import LEAF

if TYPE_CHECKING:
    from filelock import FileLock

__all__ = ["Manifest", "Store", "arrow_table", "kept_chunk_size"]

Table = NDArray[np.void]

#: Bytes.
_MANIFEST_LIMIT = 1 << 20


@dataclass(frozen=True)
class Manifest:
    """What makes a run's numbers what they are, except how many trials there are."""

    scenario: str
    estimator: str
    quantities: str
    seed: int
    chunk: int
    version: str

    #: How each is called in a message.
    LABELS = {  # noqa: RUF012 - a constant, not a field
        "version": "version of gramian",
        "scenario": "scenario",
        "estimator": "estimator",
        "quantities": "set of quantities",
        "seed": "seed",
        "chunk": "chunk size",
    }


class Store:
    """The directory of a run.

    Raises
    ------
    InputError
        The path holds another run, or cannot be used.
    StorageError
        Writing failed: a full disk, for one.
    """

    def __init__(self, path: str | os.PathLike[str], manifest: Manifest) -> None:
        try:
            import pyarrow.parquet  # noqa: F401
            from filelock import FileLock, Timeout
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError(
                "resume needs pyarrow and filelock: pip install 'gramian[interop]'"
            ) from error
        self._filelock, self._timeout = FileLock, Timeout
        self._lock: FileLock | None = None
        if not (isinstance(path, (str, os.PathLike)) and str(path)) or "\0" in str(path):
            raise InputError(f"resume = {path!r}: must be the path of a directory")
        self.path = Path(path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._claim()
            self._check(manifest)
        except OSError as error:
            self.close()
            raise InputError(
                f"resume = {str(self.path)!r} cannot be used: {error.strerror or error}"
            ) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let another run use the directory."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def read(self, first: int, trials: int, dtype: np.dtype[np.void]) -> Any:
        """Return (table, failures) of a finished chunk; None if it must be run (again)."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            content = pq.read_table(self._file(first))
            notes = json.loads(content.schema.metadata[b"gramian"])
            table = np.zeros(content.num_rows, dtype=dtype)
            for name in dtype.names or ():
                table[name] = content.column(name).to_numpy()
            if notes["digest"] != _digest(table, notes["failures"]):
                return None
            failures = tuple(Failure(**entry) for entry in notes["failures"])
        except (OSError, pa.ArrowException, KeyError, TypeError, ValueError):
            # Missing, or damaged by something else than us: it is run again.
            return None
        whole = np.array_equal(table["trial"], np.arange(first, first + trials))
        return (table, failures) if whole else None

    def write(self, first: int, table: Table, failures: tuple[Failure, ...]) -> None:
        """Keep a finished chunk."""
        import pyarrow.parquet as pq

        entries = [asdict(failure) for failure in failures]
        notes = {"failures": entries, "digest": _digest(table, entries)}
        buffer = BytesIO()
        pq.write_table(arrow_table(table, {"gramian": json.dumps(notes)}), buffer)
        try:
            write_whole(self._file(first), buffer.getvalue())
        except OSError as error:
            if self._file(first).is_dir():
                raise InputError(
                    f"{self._file(first)} is a directory in the place of a chunk: remove it"
                ) from error
            done = len(list(self.path.glob("chunk-*.parquet")))
            raise StorageError(
                f"cannot write {self._file(first)}: {error.strerror or error}; the {done} chunks "
                f"finished before are whole: make room and run again with resume = "
                f"{str(self.path)!r}"
            ) from error

    def _file(self, first: int) -> Path:
        return self.path / f"chunk-{first:015d}.parquet"

    def _claim(self) -> None:
        # A lock of the open file: it holds between threads and between processes, and
        # falls with its holder, kill -9 included.
        lock = self._filelock(self.path / "lock", timeout=0)
        try:
            lock.acquire()
        except self._timeout:
            raise InputError(f"resume = {str(self.path)!r} is in use by another run") from None
        self._lock = lock

    def _check(self, manifest: Manifest) -> None:
        file = self.path / "manifest.json"
        wanted = asdict(manifest)
        try:
            found = json.loads(read_whole(file, _MANIFEST_LIMIT))
        except FileNotFoundError:
            strangers = [p for p in self.path.iterdir() if p.name != "lock" and p.suffix != ".part"]
            if strangers:
                raise InputError(
                    f"resume = {str(self.path)!r} holds {strangers[0].name!r} and no manifest of "
                    "a run: must be a new or empty directory, or that of a run"
                ) from None
            write_whole(file, json.dumps(wanted, indent=2).encode())
            return
        except (OSError, ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise InputError(f"resume = {str(self.path)!r}: its manifest.json cannot be read")
        for key, label in Manifest.LABELS.items():
            if found.get(key) != wanted[key]:
                shown = (
                    f" ({found.get(key)} there, {wanted[key]} here)"
                    if key in ("seed", "chunk", "version")
                    else ""
                )
                raise InputError(
                    f"resume = {str(self.path)!r} is of another {label}{shown}: "
                    "give that run's, or another path"
                )


def kept_chunk_size(path: str | os.PathLike[str] | None) -> int | None:
    """Return the chunk size of the run that a directory holds; None if it holds none."""
    if path is None:
        return None
    try:
        found = json.loads(read_whole(Path(path) / "manifest.json", _MANIFEST_LIMIT))["chunk"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    usable = type(found) is int and LEAF <= found <= MOST and found & (found - 1) == 0
    return found if usable else None


def _digest(table: Table, failures: list[dict[str, Any]]) -> str:
    """Return what tells a chunk that a disk has spoiled."""
    digest = hashlib.blake2b(table.tobytes(), digest_size=16)
    digest.update(json.dumps(failures).encode())
    return digest.hexdigest()


def arrow_table(table: Table, metadata: dict[str, str] | None = None) -> Any:
    """Return a structured array as a pyarrow Table."""
    import pyarrow as pa

    names = table.dtype.names or ()
    columns = [pa.array(np.ascontiguousarray(table[name])) for name in names]
    return pa.table(columns, names=list(names), metadata=metadata)
