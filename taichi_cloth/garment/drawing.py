"""The visible shapes of an SVG drawing, with their names. numpy only.

Groups, nested drawings, `use` and `symbol` are followed; `viewBox`, `preserveAspectRatio` and `transform` are applied, and
`display` and `visibility` are heeded, also where a style sheet declares them.
"""

from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .pathdata import Subpath, linear_part, numbers
from .shapes import PIXEL, SHAPES, length, subpaths_of
from .styles import Styles
from .xmlfile import LINE

SVG, LABEL = "http://www.w3.org/2000/svg}", "http://www.inkscape.org/namespaces/inkscape}label"
HREF = ("href", "http://www.w3.org/1999/xlink}href")
GROUPS = ("svg", "g", "a", "switch")
MOST_USED, DEEPEST = 20_000, 100  # elements that are drawn through `use`; uses within uses


class Shape(NamedTuple):
    """A visible shape.

    Attributes:
        name: its label in Inkscape, title or id, else that of the nearest group; "" if none has any.
        own: whether the name is its own, and not a group's or an element's that is drawn several times.
        what: its name in messages.
        part: id of the nearest group with "-part-" in it.
        classes: of its class attribute.
        to_metres: (2, 2) from its coordinates to metres, y up.
    """

    name: str
    own: bool
    what: str
    part: str
    classes: tuple[str, ...]
    subpaths: list[Subpath]
    to_metres: np.ndarray


class Visit(NamedTuple):
    """An element in its surroundings.

    Attributes:
        to_metres: (2, 2) from its parent's coordinates.
        size: width and height of the viewport.
        group: name of the nearest group.
        called: name of the `use` that draws it.
        box: width and height that this `use` gives it.
        used: ids of the elements within which it is drawn by `use`.
    """

    node: Element
    to_metres: np.ndarray
    size: tuple[float, float]
    visible: bool = True
    group: str = ""
    part: str = ""
    called: str = ""
    box: tuple[str, str] = ("", "")
    used: tuple[str, ...] = ()


class Drawing:
    """The shapes of a drawing.

    Attributes:
        shapes: those that are visible, in the order of the file.
        hidden: how many elements are not.
        dangling: how many `use` elements refer to nothing in the file.
        scaled: whether a unit of length says how large it is; boxed: whether it has a viewBox, which that unit is for.

    Raises:
        SceneError: an element with an impossible attribute, or a `use` that draws itself.
    """

    def __init__(self, root: Element) -> None:
        self.shapes: list[Shape] = []
        self.hidden = self.dangling = self._drawn = 0
        self._root, self._ids = root, {node.get("id", ""): node for node in root.iter()}
        self._styles = Styles("\n".join("".join(node.itertext()) for node in root.iter(SVG + "style")))
        to, size, self.scaled = _page(root)
        self.boxed = bool(root.get("viewBox", "").strip())
        stack = [Visit(root, to, size)]
        with np.errstate(all="ignore"):
            while stack:
                stack.extend(reversed(self._next(stack.pop())))

    def _next(self, visit: Visit) -> list[Visit]:
        """The elements that a group or a `use` draws. A shape has none; it is added to the drawing's shapes."""
        node, tag = visit.node, visit.node.tag.removeprefix(SVG)
        group = tag in GROUPS or (tag == "symbol" and bool(visit.used))
        if not (group or tag == "use" or tag in SHAPES):
            return []
        called = visit.called
        own = called or _name(node)
        what = f"{tag} {own!r}" if own else f"the {tag} in line {node.get(LINE)}"
        style = self._styles.of(node, tag)
        if style.get("display") == "none":
            self.hidden += 1
            return []
        visit = visit._replace(to_metres=_transformed(what, visit.to_metres, node, style), part=_part(node) or visit.part,
                               visible=_visible(style.get("visibility", ""), visit.visible), called="")
        if tag == "use":
            return self._target(visit, what, own)
        if group:
            return self._children(visit, tag, what, own)
        if not visit.visible:
            self.hidden += 1
        elif subpaths := subpaths_of(node, tag, what, visit.size):
            self.shapes.append(Shape(own or visit.group, bool(called or (own and not visit.used)), what, visit.part,
                                     tuple(node.get("class", "").split()), subpaths, visit.to_metres))
        return []

    def _target(self, visit: Visit, what: str, own: str) -> list[Visit]:
        """The element that a `use` draws."""
        href = next((text.strip() for name in HREF if (text := visit.node.get(name))), "")
        if href and not href.startswith("#"):
            raise SceneError(f"{what} draws {shown(href)}: only elements of the drawing itself are read")
        target, id_ = self._ids.get(href[1:]), href[1:]
        if target is None or not id_:
            self.dangling += 1
            return []
        if id_ in visit.used or target is self._root:
            raise SceneError(f"{what} draws itself: {shown(id_)} is drawn within {shown(id_)}")
        self._count(what, 1, visit.used)
        box = (visit.node.get("width", ""), visit.node.get("height", ""))
        return [visit._replace(node=target, called=own, box=box, used=(*visit.used, id_))]

    def _children(self, visit: Visit, tag: str, what: str, own: str) -> list[Visit]:
        """The elements of a group."""
        node, to, size = visit.node, visit.to_metres, visit.size
        if visit.used:
            self._count(what, len(node), ())
        if tag in ("svg", "symbol") and node is not self._root and node.get("viewBox"):
            w, h = (length(f"{what}: {name}", box or node.get(name, "100%"), whole)
                    for name, box, whole in zip(("width", "height"), visit.box, size))
            scale, size = _viewport(what, node, w, h)
            to = to @ scale
        group = visit.group if node is self._root else own or visit.group
        return [visit._replace(node=child, to_metres=to, size=size, group=group, box=("", "")) for child in node]

    def _count(self, what: str, elements: int, used: tuple[str, ...]) -> None:
        self._drawn += elements
        if len(used) >= DEEPEST or self._drawn > MOST_USED:
            raise SceneError(f"{what}: more than {MOST_USED} elements are drawn by <use>, or {DEEPEST} within each other")


def _name(node: Element) -> str:
    title = next((child.text or "" for child in node if child.tag == SVG + "title"), "")
    return next((" ".join(text.split()) for text in (node.get(LABEL, ""), title, node.get("id", "")) if text.strip()), "")


def _part(node: Element) -> str:
    id_ = node.get("id", "")
    return id_ if "-part-" in id_ and node.tag == SVG + "g" else ""


def _visible(said: str, inherited: bool) -> bool:
    return inherited if said in ("", "inherit") else said == "visible"


def _transformed(what: str, to: np.ndarray, node: Element, style: dict[str, str]) -> np.ndarray:
    """(2, 2) from the coordinates within an element."""
    if style.get("transform", "none") != "none":
        raise SceneError(f"{what}: a transform in a style is not read: write it as the attribute transform")
    text = node.get("transform")
    if not text:
        return to
    out = to @ linear_part(what, text)
    if not np.isfinite(out).all():
        raise SceneError(f"{what}: its transforms are too large")
    return out


def _box(what: str, node: Element) -> list[float]:
    """x, y, width and height of a `viewBox`."""
    box = numbers(f"{what}: viewBox", node.get("viewBox", ""))
    if len(box) != 4 or min(box[2:]) <= 0:
        raise SceneError(f"{what}: viewBox = {shown(node.get('viewBox'))}: must be x, y, width and height, both positive")
    return box


def _viewport(what: str, node: Element, w: float, h: float) -> tuple[np.ndarray, tuple[float, float]]:
    """The scale (2, 2) of a `viewBox` that fills width w and height h, and its size."""
    box = _box(what, node)
    if min(w, h) <= 0:
        raise SceneError(f"{what}: its width and height must be positive")
    x, y = w / box[2], h / box[3]
    if not max(x, y) <= checks.LARGEST:
        raise SceneError(f"{what}: viewBox = {shown(node.get('viewBox'))}: is too small")
    fit = node.get("preserveAspectRatio", "").split()
    if "none" not in fit:
        x = y = max(x, y) if "slice" in fit else min(x, y)
    return np.diag([x, y]), (box[2], box[3])


def _page(root: Element) -> tuple[np.ndarray, tuple[float, float], bool]:
    """((2, 2) to metres with y up, size in user units, whether a unit of length gives it) of the whole drawing."""
    said = {name: root.get(name, "").strip() for name in ("width", "height")}
    sides = {name: length(f"the drawing's {name}", text) for name, text in said.items()
             if text not in ("", "auto") and not text.endswith("%")}
    scaled = any(said[name][-1].isalpha() and not said[name].endswith("px") for name in sides)
    to = np.diag([PIXEL, -PIXEL])
    if not root.get("viewBox", "").strip():
        return to, (sides.get("width", 0.0), sides.get("height", 0.0)), scaled
    if not sides:
        raise SceneError("it has no size: give the drawing a width in mm, cm or in")
    box = _box("the drawing", root)
    w, h = sides.get("width"), sides.get("height")
    w, h = (h or 0.0) * box[2] / box[3] if w is None else w, (w or 0.0) * box[3] / box[2] if h is None else h
    scale, size = _viewport("the drawing", root, w, h)
    return to @ scale, size, scaled
