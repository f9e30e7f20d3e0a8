"""Options that every scene has, in words: the fabric of all its cloths, and the wind. numpy only."""

EVERY = ("fabric", "wind")  # they change a scene after it was built


def known(name: str, value: object) -> object:
    """The value of such an option, refused before anything is built where it is no such word; "" is the scene's own.

    Raises:
        SceneError: an unknown word.
    """
    from .air import Air
    from .fabrics import as_fabric

    if name == "fabric" and value != "":
        as_fabric(name, value)
    elif value != "":
        Air(1.0, wind=value)  # type: ignore[arg-type]
    return value
