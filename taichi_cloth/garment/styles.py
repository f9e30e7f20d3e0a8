"""Declarations of SVG styles: attributes, `style`, and rules whose selector is a tag, a class, an id, or a tag with one.

Standard library only. Rules within others, such as `@media`, and longer selectors are passed over.
"""

from xml.etree.ElementTree import Element

READ = ("display", "visibility")


class Styles:
    """The rules of a drawing.

    Args:
        rules: text of its `style` elements.
    """

    def __init__(self, rules: str) -> None:
        self._rules: dict[str, dict[str, str]] = {}
        first, *rest = rules.split("/*")
        text, depth = first + " ".join(part.partition("*/")[2] for part in rest), 0
        for chunk in text.split("}"):
            head, _, body = chunk.rpartition("{")
            said = {name: value for name, value in declarations(body).items() if name in READ}
            if said and not depth and "{" not in head:
                for selector in head.rpartition(";")[2].split(","):
                    self._rules.setdefault(selector.strip(), {}).update(said)
            depth = max(0, depth + chunk.count("{") - 1)

    def of(self, node: Element, tag: str) -> dict[str, str]:
        """Style properties of an element: its attributes give way to rules, and these to its own `style`."""
        out = {name: value.strip() for name in READ if (value := node.get(name))}
        if self._rules:
            classes, id_ = node.get("class", "").split(), node.get("id", "")
            for key in ("*", tag, *(f".{c}" for c in classes), *(f"{tag}.{c}" for c in classes), f"#{id_}", f"{tag}#{id_}"):
                out.update(self._rules.get(key, {}))
        return {**out, **declarations(node.get("style", ""))}


def declarations(text: str) -> dict[str, str]:
    """Names and values, in small letters."""
    pairs = (part.partition(":") for part in text.split(";"))
    return {name.strip().lower(): value.lower().replace("!important", "").strip() for name, colon, value in pairs if colon}
