"""The text of a file, without a mark of byte order before its first word."""

import codecs
from pathlib import Path


def text_of(data: bytes) -> str:
    """UTF-8, or UTF-16 where a mark says so; bytes that are neither become the sign for that."""
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return data.decode("utf-16" if wide else "utf-8-sig", errors="replace")


def unmarked(path: Path) -> bytes:
    """A file's bytes without the mark of UTF-8."""
    return path.read_bytes().removeprefix(codecs.BOM_UTF8)
