"""XML of bounded size and depth of reference, as a tree. Standard library only."""

import gzip
import zlib
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from ..errors import SceneError, near, shown

MOST_BYTES = 1 << 26  # of a file, unpacked
LONGEST_ENTITY = 200  # characters: files of Illustrator declare namespaces as entities
GZIP = b"\x1f\x8b"
LINE = ":line"  # an attribute of every element: where in the file it begins; no name in XML begins with a colon here


def parse(path: Path) -> Element:
    """The root of a file, which may be compressed by gzip.

    Names have the form "namespace}name", or "name" where there is no namespace.

    Raises:
        SceneError: a file that cannot be read, is too large, is no XML, or declares entities that could grow without bound.
    """
    data = bytes_of(path)
    builder, parser = TreeBuilder(), expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, {**attributes, LINE: str(parser.CurrentLineNumber)})

    def entity(name: str, parameter: int, value: str | None, *_: object) -> None:
        if parameter or value is None or "&" in value or len(value) > LONGEST_ENTITY:
            raise SceneError(f"{path}: declares the entity {shown(name)}, which refers to others or is too long: "
                             "write out its text")

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
    try:
        parser.Parse(data, True)
        return builder.close()
    except (expat.ExpatError, LookupError, ValueError) as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(f"{path}: is not XML: {error}") from None


def bytes_of(path: Path) -> bytes:
    """The content of a file, unpacked where it is compressed by gzip.

    Raises:
        SceneError: a file that cannot be read, or is too large.
    """
    try:
        with open(path, "rb") as file:
            packed = file.read(len(GZIP)) == GZIP
        with (gzip.open if packed else open)(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise SceneError(f"{path}: cannot be unpacked: {error}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}{near(path)}") from None
    if len(data) > MOST_BYTES:
        raise SceneError(f"{path}: is larger than {MOST_BYTES >> 20} MB: leave out images and the like")
    return bytes(data)
