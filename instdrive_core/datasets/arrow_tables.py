"""Columns of Arrow tables (feather and parquet) as numpy arrays, each checked; pyarrow is an extra and loaded late."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

_MOST_ROWS = 10_000_000
"""Rows of one table; a Waymo segment has some ten thousand boxes."""
_REMEDY = "Get the file again"


def read_feather(file: Path, names: tuple[str, ...]) -> pa.Table:
    """Read some columns of a feather file. Raises DataError where it is missing, damaged, or lacks one of them."""
    from pyarrow import ArrowException, feather

    try:
        content = require_plain_file(file).read_bytes()
    except FileNotFoundError as error:
        raise DataError(file, "is missing", _REMEDY) from error
    except OSError as error:
        raise DataError(file, f"cannot be read ({error})", _REMEDY) from error
    try:
        import pyarrow as pa

        table = feather.read_table(pa.BufferReader(content), memory_map=False)
        table.validate(full=True)
    except (ArrowException, OSError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise DataError(file, f"is no readable feather table ({str(error)[:200]})", _REMEDY) from error
    return require_columns(file, table, names)


def require_columns(file: Path, table: pa.Table, names: tuple[str, ...]) -> pa.Table:
    """Return a table with just the named columns. Raises DataError where one is missing or there twice."""
    wrong = [name for name in names if table.column_names.count(name) != 1]
    if wrong:
        found = ", ".join(table.column_names)[:300]
        raise DataError(file, f"the column '{wrong[0]}' is missing or there twice, found {found}", _REMEDY)
    return table.select(list(names))


def take_numbers(file: Path, table: pa.Table, names: tuple[str, ...]) -> Float64[ndarray, "n c"]:
    """Return columns as finite numbers. Raises DataError where one holds anything else."""
    columns = []
    for name in names:
        values = _to_numpy(file, table, name)
        if values.dtype.kind not in "fiu":
            raise DataError(file, f"the column '{name}' holds no numbers", _REMEDY)
        with np.errstate(invalid="ignore", over="ignore"):  # NaN of every kind is found below
            column = values.astype(np.float64)
        if not np.isfinite(column).all():
            raise DataError(file, f"the column '{name}' holds values that are not finite", _REMEDY)
        columns.append(column)
    return np.stack(columns, axis=1) if columns else np.zeros((table.num_rows, 0))


def take_integers(file: Path, table: pa.Table, name: str) -> Int64[ndarray, " n"]:
    """Return a column as whole numbers, e.g. nanoseconds, which a float would round."""
    values = _to_numpy(file, table, name)
    if values.dtype.kind not in "iu":
        raise DataError(file, f"the column '{name}' holds no whole numbers", _REMEDY)
    if len(values) and not -(2**62) < int(values.min()) <= int(values.max()) < 2**62:
        raise DataError(file, f"the column '{name}' holds numbers beyond any time", _REMEDY)
    return values.astype(np.int64)


def take_texts(file: Path, table: pa.Table, name: str) -> list[str]:
    """Return a column as texts. Raises DataError where one is missing or no text."""
    try:
        values: list[Any] = table.column(name).to_pylist()
    except (ValueError, UnicodeDecodeError) as error:
        raise DataError(file, f"the column '{name}' holds no text ({error})", _REMEDY) from error
    wrong = next((row for row, value in enumerate(values) if not isinstance(value, str)), None)
    if wrong is not None:
        raise DataError(file, f"the column '{name}' holds {str(values[wrong])[:40]!r} in row {wrong}, no text", _REMEDY)
    return values


def _to_numpy(file: Path, table: pa.Table, name: str) -> ndarray:
    column = table.column(name)
    if column.null_count:
        raise DataError(file, f"the column '{name}' has {column.null_count} empty rows", _REMEDY)
    try:
        return np.asarray(column.to_numpy())
    except (ValueError, NotImplementedError) as error:
        raise DataError(file, f"the column '{name}' cannot be used ({error})", _REMEDY) from error


def open_parquet(file: Path) -> pq.ParquetFile:
    """Open a parquet file. Raises DataError where it is missing or damaged."""
    import pyarrow.parquet as pq
    from pyarrow import ArrowException

    try:
        return pq.ParquetFile(require_plain_file(file), page_checksum_verification=False)
    except FileNotFoundError as error:
        raise DataError(file, "is missing", _REMEDY) from error
    except (ArrowException, OSError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise DataError(file, f"is no readable parquet table ({str(error)[:200]})", _REMEDY) from error


def read_parquet_group(file: Path, names: tuple[str, ...], group: int | None = None) -> pa.Table:
    """Read some columns of a parquet file: of one group of rows, or of all. Raises DataError where they are damaged."""
    from pyarrow import ArrowException

    opened = open_parquet(file)
    missing = [name for name in names if name.partition("[list]")[0] not in opened.schema_arrow.names]
    if missing:
        found = ", ".join(opened.schema_arrow.names)[:300]
        raise DataError(file, f"the column '{missing[0]}' is missing, found {found}", _REMEDY)
    try:
        table = opened.read(list(names)) if group is None else opened.read_row_group(group, list(names))
        table.validate(full=True)
    except (ArrowException, OSError, ValueError, TypeError, KeyError, IndexError, MemoryError) as error:
        raise DataError(file, f"is no readable parquet table ({str(error)[:200]})", _REMEDY) from error
    return require_columns(file, table, names)


def locate_rows(file: Path) -> list[tuple[int, int]]:
    """List the group of each row of a parquet file, and its place in that group."""
    opened = open_parquet(file)
    counts = [opened.metadata.row_group(group).num_rows for group in range(opened.num_row_groups)]
    if sum(counts) > _MOST_ROWS or min(counts, default=0) < 0:
        raise DataError(file, f"promises {sum(counts)} rows", _REMEDY)
    return [(group, row) for group, count in enumerate(counts) for row in range(count)]


def take_lists(file: Path, table: pa.Table, name: str, row: int) -> Float64[ndarray, " n"] | None:
    """Return the list of finite numbers in a row of a column; None where the row is empty."""
    cell = table.column(name)[row]
    if not cell.is_valid:
        return None
    try:
        values = np.asarray(cell.values.to_numpy(zero_copy_only=False))
    except (AttributeError, ValueError, NotImplementedError) as error:
        raise DataError(file, f"the column '{name}' holds no lists of numbers ({error})", _REMEDY) from error
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise DataError(file, f"the column '{name}' holds something that is no number in row {row}", _REMEDY)
    return values.astype(np.float64)
