"""What every answer can do: print, show as a table, be handed on, be saved and loaded.

An `Answer` is a `Value` with a verdict: it prints as one, shows as a small table in a
notebook, and goes to pandas, xarray, JSON and Parquet. A class says what is special to
it in a few class variables.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from gramian import _options as options
from gramian._core import __version__
from gramian._files import read_whole, write_whole
from gramian._text import number, plain
from gramian._values import Value, decode, encode, kind_of
from gramian.exceptions import GramianError, InputError, StorageError

__all__ = ["Answer", "Columns", "Tone", "columns_of_states", "load", "tone"]

#: How a verdict is coloured: it holds, it holds with a caution, it does not.
Tone = Literal["good", "weak", "bad"]

#: White on each of these is legible on a light page and on a dark one.
COLOURS: dict[str, str] = {"good": "#1a7f37", "weak": "#9a5b00", "bad": "#b3261e"}

_TONES: dict[str, Tone] = {
    "observable": "good",
    "determined": "good",
    "weak": "weak",
    "undecided": "weak",
    "ambiguous": "weak",
    "not_converged": "bad",
    "misfit": "bad",
    "unobservable": "bad",
}

#: The most rows a table has in a notebook.
_SHOWN = 24


def tone(status: str) -> Tone:
    """Return the colour of a status."""
    return _TONES.get(status, "good")


@dataclass(frozen=True)
class Columns:
    """A table of numbers with names and units.

    Attributes
    ----------
    index : str
        What a row is: "state", "time".
    labels : sequence
        One for each row.
    values : mapping of str to sequence
        The columns.
    units : mapping of str to str
        Of the index and the columns; those without one are left out.
    unit : sequence of str, optional
        The unit of each row, where rows differ in it.
    pairs : mapping of str to ndarray, shape (rows, rows)
        What belongs to two rows: covariances. For xarray only.
    """

    index: str
    labels: Any
    values: Mapping[str, Any]
    units: Mapping[str, str]
    unit: Sequence[str] | None = None
    pairs: Mapping[str, NDArray[Any]] = field(default_factory=dict)


class Answer(Value):
    """What is common to all answers.

    `str` is the verdict, `summary` the details; `to_dict`, `to_pandas`, `to_xarray` and
    `save` hand it on. Answers are compared by value.
    """

    #: Properties that belong to the answer, beside its fields.
    _more_in_dict: ClassVar[tuple[str, ...]] = ()
    #: Fields that are too large for `to_dict`, or are no answer.
    _not_in_dict: ClassVar[frozenset[str]] = frozenset()
    #: Units of the columns of its table, where not each row has its own.
    _column_units: ClassVar[Mapping[str, str]] = MappingProxyType({})

    @property
    def tone(self) -> Tone:
        """The colour of the verdict: "good", "weak" or "bad"."""
        status = getattr(self, "status", "")
        if isinstance(status, str):
            return tone(status)
        worst = {tone(str(word)) for word in np.unique(status)}
        return "bad" if "bad" in worst else "weak" if "weak" in worst else "good"

    def _verdict_line(self) -> str:
        """Return the verdict in a line; empty where there is none."""
        status = getattr(self, "status", None)
        if isinstance(status, str):
            reason = getattr(self, "reason", "")
            return f"{status}: {reason}" if reason else status
        summary = getattr(self, "summary", None)
        return "" if summary is None else str(summary()).splitlines()[0]

    def __str__(self) -> str:
        return self._verdict_line() or repr(self)

    def __repr__(self) -> str:
        line = self._verdict_line()
        return f"<{type(self).__name__} {line}>" if line else super().__repr__()

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists, numbers and strings, fit for JSON.

        JSON has no infinity and no NaN: they become the strings "inf", "-inf" and "nan".
        """
        names = [n for n in self._stored() if n[0] != "_" and n not in self._not_in_dict]
        first = [n for n in ("status", "reason") if n in self._more_in_dict]
        listed = dict.fromkeys((*first, *names, *self._more_in_dict))
        return {name: plain(getattr(self, name)) for name in listed}

    def _as_table(self) -> Columns:
        """Return the answer as a table.

        By default one row for each state with all that there is one number of for each.
        """
        names, units = getattr(self, "names", None), getattr(self, "units", None)
        if names is None:
            raise InputError(f"{type(self).__name__} is no table: it has to_dict()")
        n = len(names)
        values, pairs = {}, {}
        for name in (*self._stored(), *self._more_in_dict):
            if name[0] == "_" or name in {"names", "units"}:
                continue
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and value.dtype.kind in "biufU":
                if value.shape == (n,):
                    values[name] = value
                elif value.shape == (n, n) and name.endswith("covariance"):
                    pairs[name] = value
        if not values:
            raise InputError(f"{type(self).__name__} is no table of one number for each state")
        return Columns("state", names, values, self._column_units, units, pairs)

    def to_pandas(self) -> Any:
        """Return the answer as a pandas DataFrame.

        Units are a column where each row has its own, and else in ``attrs["units"]``.

        Raises
        ------
        InputError
            Where the answer is no table.
        GramianError
            Without pandas.
        """
        columns = self._as_table()
        try:
            import pandas as pd
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError("frames need pandas: pip install 'gramian[interop]'") from error
        data: dict[str, Any] = {} if columns.unit is None else {"unit": list(columns.unit)}
        data |= {name: np.asarray(values) for name, values in columns.values.items()}
        frame = pd.DataFrame(data, index=pd.Index(list(columns.labels), name=columns.index))
        frame.attrs["units"] = dict(columns.units)
        return frame

    def to_xarray(self) -> Any:
        """Return the answer as an xarray Dataset, covariances included.

        Units are a coordinate where each row has its own, and else the attribute
        ``units`` of each variable.

        Raises
        ------
        InputError
            Where the answer is no table.
        GramianError
            Without xarray.
        """
        columns = self._as_table()
        try:
            import xarray as xr
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError("datasets need xarray: pip install 'gramian[interop]'") from error
        index, other = columns.index, f"{columns.index}_2"

        def attributes(name: str) -> dict[str, str]:
            return {"units": columns.units[name]} if name in columns.units else {}

        data: dict[str, Any] = {
            name: (index, np.asarray(values), attributes(name))
            for name, values in columns.values.items()
        }
        data |= {name: ((index, other), values) for name, values in columns.pairs.items()}
        labels = np.asarray(columns.labels)
        coordinates: dict[str, Any] = {index: (index, labels, attributes(index))}
        if columns.unit is not None:
            coordinates["unit"] = (index, np.asarray(columns.unit))
        if columns.pairs:
            coordinates[other] = (other, labels)
        return xr.Dataset(data, coordinates, {"answer": str(self)})

    def _repr_html_(self) -> str:
        from html import escape

        line = self._verdict_line()
        head, _, rest = line.partition(": ")
        if not line:
            head, rest = type(self).__name__, ""
        badge = (
            f'<span style="background:{COLOURS[self.tone]};color:#fff;padding:1px 7px;'
            f'border-radius:4px;font-weight:600">{escape(head.replace("_", " "))}</span>'
        )
        return f"<div><p>{badge} {escape(rest)}</p>{self._html_table()}</div>"

    def _html_table(self) -> str:
        from html import escape

        try:
            columns = self._as_table()
        except InputError:
            return ""
        heads = [columns.index, *columns.values, *(["unit"] if columns.unit is not None else [])]
        heads = [
            f"{name.replace('_', ' ')} ({columns.units[name]})"
            if columns.units.get(name)
            else name.replace("_", " ")
            for name in heads
        ]
        lines = []
        for i, label in enumerate(columns.labels[:_SHOWN]):
            cells = [_cell(label), *(_cell(values[i]) for values in columns.values.values())]
            if columns.unit is not None:
                cells.append(str(columns.unit[i]))
            lines.append("".join(f"<td>{escape(cell)}</td>" for cell in cells))
        more = len(columns.labels) - _SHOWN
        note = f"<p>and {more} more rows</p>" if more > 0 else ""
        return (
            f"<table><thead><tr>{''.join(f'<th>{escape(head)}</th>' for head in heads)}</tr>"
            f"</thead><tbody>{''.join(f'<tr>{line}</tr>' for line in lines)}</tbody></table>{note}"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the answer to a JSON or a Parquet file, by the end of its name.

        `gramian.load` reads either back, equal by value. No pickle is involved: a file
        from elsewhere can do no harm. Functions are not saved: of a model of your own the
        answer stays and the function is gone.

        Parameters
        ----------
        path : path
            ``*.json``: what `to_dict` has, readable by anything, and the fields.
            ``*.parquet``: the table of `to_pandas`, for any reader of Parquet, and the
            fields in its metadata.

        Raises
        ------
        InputError
            Another end of the name; an answer that is no table, as Parquet.
        StorageError
            The file cannot be written.
        """
        file = Path(options.path(path))
        head = {"gramian": __version__, "kind": kind_of(type(self))}
        if file.suffix == ".json":
            content = head | {"answer": self.to_dict(), "fields": encode(self)["fields"]}
            text = json.dumps(content, indent=1, allow_nan=False) + "\n"
            data = text.encode()
        elif file.suffix == ".parquet":
            content = head | {"fields": encode(self)["fields"]}
            data = _parquet(self._as_table(), json.dumps(content, allow_nan=False))
        else:
            raise InputError(f"path = {str(path)!r}: must end in .json or .parquet")
        try:
            write_whole(file, data)
        except OSError as error:
            raise StorageError(f"cannot write {file}: {error}") from error

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return an answer of this class that `save` wrote.

        Raises
        ------
        InputError
            A file that is none, or of another class.
        """
        answer = load(path)
        if not isinstance(answer, cls):
            raise InputError(
                f"{path} holds a {type(answer).__name__}: must be a {cls.__name__}; "
                "gramian.load takes any"
            )
        return answer


def columns_of_states(
    names: Sequence[str],
    units: Sequence[str],
    values: Mapping[str, NDArray[Any]],
    others: Mapping[str, Any] | None = None,
    covariance: NDArray[Any] | None = None,
) -> Columns:
    """Return a row for each state of one estimate, or for each trial of many.

    Parameters
    ----------
    names, units : sequence of str, length n
    values : mapping of str to ndarray, shape (..., n)
        "" for what is called by the names of the states alone.
    others : mapping of str to ndarray, shape (...), optional
        What each trial has one of.
    covariance : ndarray, shape (..., n, n), optional
        For one estimate only.
    """
    first = next(iter(values.values()))
    if first.ndim == 1:
        pairs = {} if covariance is None else {"covariance": covariance}
        columns = {name or "value": value for name, value in values.items()}
        return Columns("state", names, columns, {}, units, pairs)
    table, table_units = {}, {}
    for what, array in values.items():
        flat = array.reshape(-1, len(names))
        for k, (name, unit) in enumerate(zip(names, units, strict=True)):
            column = f"{what}_{name}" if what else name
            table[column], table_units[column] = flat[:, k], unit
    table |= {name: np.ravel(value) for name, value in (others or {}).items()}
    return Columns("trial", range(first.size // len(names)), table, table_units)


def load(path: str | os.PathLike[str]) -> Answer:
    """Return an answer from a file that its `save` wrote, equal by value.

    Parameters
    ----------
    path : path
        A JSON or Parquet file.

    Returns
    -------
    Answer
        Of the class that was saved.

    Raises
    ------
    InputError
        A file that no answer was saved to.
    StorageError
        A file that cannot be read.

    Examples
    --------
    >>> import gramian as gm, tempfile, pathlib
    >>> answer = gm.analyze([[1.0, 2.0], [2.0, 4.0]], names=["x", "v"])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "answer.json")
    ...     answer.save(file)
    ...     gm.load(file) == answer
    True
    """
    file = Path(options.path(path))
    try:
        data = read_whole(file)
    except OSError as error:
        raise StorageError(f"cannot read {file}: {error}") from error
    none = f"{file} is no answer of gramian"
    try:
        if data[:4] == b"PAR1":
            import pyarrow as pa
            import pyarrow.parquet as pq

            metadata = pq.read_schema(pa.BufferReader(data)).metadata or {}
            data = zlib.decompress(metadata[b"gramian"])
        content = json.loads(data)
        kind, stored = content["kind"], content["fields"]
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError("Parquet needs pyarrow: pip install 'gramian[files]'") from error
    except (ValueError, KeyError, TypeError, zlib.error) as error:
        raise InputError(f"{none}: save() writes such a file") from error
    try:
        answer = decode({"$": "value", "kind": kind, "fields": stored})
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{none} that this version can read: {error}") from error
    if not isinstance(answer, Answer):
        raise InputError(f"{none}: it holds a {kind}")
    return answer


def _cell(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return "not observable" if np.isinf(value) else number(float(value))
    return str(value)


def _parquet(columns: Columns, content: str) -> bytes:
    """Return a Parquet file of the table, with an answer's fields in its metadata."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError("Parquet needs pyarrow: pip install 'gramian[files]'") from error
    data = {columns.index: pa.array(np.asarray(columns.labels).tolist())}
    if columns.unit is not None:
        data["unit"] = pa.array(list(columns.unit))
    data |= {name: pa.array(np.asarray(values)) for name, values in columns.values.items()}
    table = pa.table(data)
    described = [
        field.with_metadata({"unit": columns.units[field.name]})
        if columns.units.get(field.name)
        else field
        for field in table.schema
    ]
    metadata = {b"gramian": zlib.compress(content.encode(), 6)}
    table = table.cast(pa.schema(described)).replace_schema_metadata(metadata)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    written: bytes = sink.getvalue().to_pybytes()
    return written
