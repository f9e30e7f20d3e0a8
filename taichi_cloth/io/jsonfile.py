"""JSON, read so that whatever is wrong with it is one ValueError that says so."""

import json
import math
from typing import Any


def parse_json(data: bytes | str, finite: bool = True) -> Any:
    """What JSON holds; a byte order mark is skipped.

    Args:
        finite: whether NaN and infinity, which Python writes beyond the format, are refused.

    Raises:
        ValueError: it is no JSON, or no UTF-8: with the place; a number that no float can hold; nested too deeply.
    """
    try:
        text = data if isinstance(data, str) else data.decode("utf-8-sig")
        return json.loads(text, parse_constant=_refused if finite else float, parse_float=_float, parse_int=_int)
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start}, {error.object[error.start]:#04x}, is no text in UTF-8") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _refused(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _float(text: str) -> float:
    out = float(text)
    if not math.isfinite(out):
        raise ValueError(f"a number of {len(text)} characters, {text[:16]}, is too large")
    return out


def _int(text: str) -> int:
    _float(text)
    return int(text)
