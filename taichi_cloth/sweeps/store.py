"""A sweep's folder: a file for each run that is done, and the table of all of them."""

import csv
import io
import json
import pathlib
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ..errors import OutputError
from ..io.jsonfile import parse_json
from ..output.folder import write_whole
from ..output.lock import Lock
from .plan import Run
from .task import Outcome

RUNS, TABLE, PARQUET = "runs", "sweep.csv", "sweep.parquet"


class Store:
    """A folder, held until `close`.

    Raises:
        OutputError: it cannot be written, or another sweep writes there.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.path = folder
        try:
            (folder / RUNS).mkdir(parents=True, exist_ok=True)
            self._lock = Lock(folder)
        except OutputError:
            raise
        except (OSError, ValueError) as error:
            raise OutputError(f"cannot write to {folder}: {getattr(error, 'strerror', None) or error}") from None
        self._files: dict[str, list[pathlib.Path]] = {}
        self.others = 0  # files of versions that knew runs otherwise
        for file in sorted((folder / RUNS).glob("*.json")):
            key, dash, _ = file.stem.partition("-")
            self._files.setdefault(key, []).append(file)
            self.others += not dash

    def close(self) -> None:
        """Lets others write there."""
        self._lock.release()

    def kept(self, run: Run) -> dict[str, Outcome]:
        """Its results before, by the digest of its scene then, where the file is whole and of the same manifest."""
        out = {}
        for file in self._files.get(run.key, ()):
            try:
                kept = parse_json(file.read_bytes())
                outcome = Outcome(**kept["outcome"])
                if kept["manifest"] == run.manifest:
                    out[outcome.scene] = outcome
            except (OSError, ValueError, KeyError, TypeError):  # damaged: it is run again
                continue
        return out

    def put(self, run: Run, outcome: Outcome) -> None:
        """Keeps the result of a run, but for one that cannot be known again: its worker was lost, or its scene is unknown."""
        if outcome.scene:
            text = json.dumps({"manifest": run.manifest, "outcome": asdict(outcome)}, indent=1)
            write_whole(self.path / RUNS / f"{name_of(run, outcome)}.json", (text + "\n").encode())

    def write(self, name: str, text: str) -> None:
        """A file of the folder."""
        write_whole(self.path / name, text.encode())

    def write_parquet(self, rows: Sequence[dict[str, Any]]) -> bool:
        """The table as Parquet, where pyarrow is installed."""
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError:
            return False
        names = columns(rows)
        table = pyarrow.table({name: _of_one_kind([row.get(name) for row in rows]) for name in names})
        buffer = io.BytesIO()
        pyarrow.parquet.write_table(table, buffer)
        write_whole(self.path / PARQUET, buffer.getvalue())
        return True


def name_of(run: Run, outcome: Outcome) -> str:
    """The key by which a row is found again: its settings, and the digest of its scene."""
    return f"{run.key}-{outcome.scene}" if outcome.scene else run.key


def columns(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Names of all rows, in the order of their first appearance."""
    return list(dict.fromkeys(name for row in rows for name in row))


def as_csv(rows: Sequence[dict[str, Any]]) -> str:
    """One line a row; values that a row does not have are empty. Numbers have all their digits."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns(rows), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _of_one_kind(values: list) -> list:
    """A column as Parquet can hold it: texts where kinds differ."""
    kinds = {float if isinstance(v, int) and not isinstance(v, bool) else type(v) for v in values if v is not None}
    if len(kinds) > 1:
        return [None if v is None else str(v) for v in values]
    return [float(v) if kinds == {float} and v is not None else v for v in values]
