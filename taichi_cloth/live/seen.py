"""Messages from a session to its page, in another process: an `Opening`, a `Seen` a picture, `Building`. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .parameters import Parameter


@dataclass(frozen=True)
class Opening:
    """The part of a page that stays, sent once.

    Attributes:
        parameters: that can be changed; again: whether it can begin again; airy: whether there is air, and so wind.
        eye, target, up: (3,) of the camera [m]; fov: its opening angle [degrees].
        middle: (3,) of the ground [m]; size: of the scene [m].
    """

    title: str
    parameters: tuple[Parameter, ...]
    again: bool
    airy: bool
    eye: tuple[float, ...]
    target: tuple[float, ...]
    up: tuple[float, ...]
    fov: float
    middle: tuple[float, ...]
    size: float


@dataclass(frozen=True)
class Piece:
    """Triangles of one colour.

    Attributes:
        cloth: whether they are cloth's, and no solid's.
        index: (k,) their vertices, those of cloth and then those of solids; faces: (m, 3) among these.
        color: sRGB, 0 to 255.
    """

    cloth: bool
    index: np.ndarray
    faces: np.ndarray
    color: tuple[int, int, int]


@dataclass(frozen=True)
class Scale:
    """The colours of a heat map: (h, w, 3) uint8, and the text below."""

    bar: np.ndarray
    text: str


@dataclass(frozen=True)
class Seen:
    """A picture.

    Attributes:
        number: of the scene; another one has other pieces.
        x: (n, 3) f32 vertices [m]; pieces: those drawn, by name; None if they are those of the picture before.
        state: one line; running: whether step follows step; preview: whether the simulation is being set up.
        changes: how many changes the session has dealt with; change: the last of them in words, and from when on it holds.
        heats: that there are; None before they are known. heat: that the cloth is coloured by, or None.
        hand: (2, 3) where the cloth is held, and the hand; None while it does not pull.
        last, costly: text on the last step and on the costliest ones; None if it is as before.
    """

    number: int
    x: np.ndarray
    pieces: dict[str, Piece] | None
    state: str
    running: bool
    preview: bool
    changes: int
    change: str
    heats: tuple[str, ...] | None
    heat: Scale | None
    hand: np.ndarray | None
    last: str | None
    costly: str | None


@dataclass(frozen=True)
class Building:
    """Kernels are loaded or compiled, from now until the next picture."""
