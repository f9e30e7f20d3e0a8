"""JSON, read so that whatever is wrong with it is one ValueError that says so."""

import json
import math
from typing import Any


def parse_json(data: bytes | str) -> Any:
    """The content of a JSON text; a byte order mark is skipped.

    Numbers that no float can hold are infinite, and NaN and Infinity, which Python writes beyond the format, are read: the
    checks of the number's use refuse them by its name.

    Raises:
        ValueError: it is no JSON, or no UTF-8: with the place; nested too deeply.
    """
    try:
        return json.loads(data if isinstance(data, str) else data.decode("utf-8-sig"), parse_int=_int)
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start}, {error.object[error.start]:#04x}, is not text in UTF-8") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _int(text: str) -> int | float:
    value = float(text)
    return int(text) if math.isfinite(value) else value
