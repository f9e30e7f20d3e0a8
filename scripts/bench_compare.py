"""Tables of benchmarks side by side: JSON files that the others wrote, on whatever machine or backend.

    python scripts/bench_compare.py cpu.json cuda.json
"""

import argparse
import json
import pathlib

LABELS = ("mesh", "scene", "vertices", "precision")  # what makes two rows the same case


def flat(row: dict, prefix: str = "") -> dict[str, float]:
    """Numbers of a row by name, nested ones as a.b."""
    out: dict[str, float] = {}
    for key, value in row.items():
        if isinstance(value, dict):
            out |= flat(value, f"{prefix}{key}.")
        elif isinstance(value, (int, float)) and key not in LABELS:
            out[prefix + key] = float(value)
    return out


def label(row: dict, keys: tuple[str, ...]) -> tuple:
    """Which case a row is of."""
    return tuple((k, row[k]) for k in keys if k in row)


def main() -> None:
    """Prints one table a file-independent case: a line a figure, a column a file, ratios to the first."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", type=pathlib.Path)
    parser.add_argument("--figure", action="append", help="only figures whose name contains this")
    args = parser.parse_args()
    tables = []
    for file in args.files:
        data = json.loads(file.read_text())
        rows = {label(r, LABELS): flat(r) for r in data["rows"]}
        if len(rows) < len(data["rows"]):
            rows = {label(r, (*LABELS, "threads")): flat(r) for r in data["rows"]}
        tables.append(rows)
        print(f"{file.stem}: {data.get('machine', '?')}, Python {data.get('python', '?')}, "
              f"{', '.join(sorted({str(r.get('arch', '')) for r in data['rows']}))}")
    for case in tables[0]:
        print("\n" + ", ".join(f"{k} {v}" for k, v in case))
        for figure, first in tables[0][case].items():
            if args.figure and not any(f in figure for f in args.figure):
                continue
            values = [t.get(case, {}).get(figure) for t in tables]
            cells = [f"{v:12.4g}" if v is not None else f"{'-':>12}" for v in values]
            ratios = [f"{v / first:7.2f}x" if v is not None and first else f"{'':8}" for v in values[1:]]
            print(f"  {figure:28}" + cells[0] + "".join(a + b for a, b in zip(cells[1:], ratios)))


if __name__ == "__main__":
    main()
