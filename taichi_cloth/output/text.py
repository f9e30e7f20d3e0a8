"""Captions: small letters of 5 x 7 dots, drawn into images."""

import numpy as np
from numpy.typing import ArrayLike

HEIGHT, WIDTH = 7, 5
# seven rows of five dots each, as numbers of base 32, the leftmost dot the highest bit
_ROWS = {
    "0": "e.11.13.15.19.11.e", "1": "4.c.4.4.4.4.e", "2": "e.11.1.2.4.8.1f", "3": "1f.2.4.2.1.11.e",
    "4": "2.6.a.12.1f.2.2", "5": "1f.10.1e.1.1.11.e", "6": "6.8.10.1e.11.11.e", "7": "1f.1.2.4.8.8.8",
    "8": "e.11.11.e.11.11.e", "9": "e.11.11.f.1.2.c", "A": "e.11.11.1f.11.11.11", "B": "1e.11.11.1e.11.11.1e",
    "C": "e.11.10.10.10.11.e", "D": "1c.12.11.11.11.12.1c", "E": "1f.10.10.1e.10.10.1f", "F": "1f.10.10.1e.10.10.10",
    "G": "e.11.10.17.11.11.f", "H": "11.11.11.1f.11.11.11", "I": "e.4.4.4.4.4.e", "J": "7.2.2.2.2.12.c",
    "K": "11.12.14.18.14.12.11", "L": "10.10.10.10.10.10.1f", "M": "11.1b.15.15.11.11.11", "N": "11.11.19.15.13.11.11",
    "O": "e.11.11.11.11.11.e", "P": "1e.11.11.1e.10.10.10", "Q": "e.11.11.11.15.12.d", "R": "1e.11.11.1e.14.12.11",
    "S": "f.10.10.e.1.1.1e", "T": "1f.4.4.4.4.4.4", "U": "11.11.11.11.11.11.e", "V": "11.11.11.11.11.a.4",
    "W": "11.11.11.15.15.15.a", "X": "11.11.a.4.a.11.11", "Y": "11.11.11.a.4.4.4", "Z": "1f.1.2.4.8.10.1f",
    "a": "0.0.e.1.f.11.f", "b": "10.10.16.19.11.11.1e", "c": "0.0.e.10.10.11.e", "d": "1.1.d.13.11.11.f",
    "e": "0.0.e.11.1f.10.e", "f": "6.9.8.1c.8.8.8", "g": "0.f.11.11.f.1.e", "h": "10.10.16.19.11.11.11",
    "i": "4.0.c.4.4.4.e", "j": "2.0.6.2.2.12.c", "k": "10.10.12.14.18.14.12", "l": "c.4.4.4.4.4.e",
    "m": "0.0.1a.15.15.11.11", "n": "0.0.16.19.11.11.11", "o": "0.0.e.11.11.11.e", "p": "0.0.1e.11.1e.10.10",
    "q": "0.0.d.13.f.1.1", "r": "0.0.16.19.10.10.10", "s": "0.0.e.10.e.1.1e", "t": "8.8.1c.8.8.9.6",
    "u": "0.0.11.11.11.13.d", "v": "0.0.11.11.11.a.4", "w": "0.0.11.11.15.15.a", "x": "0.0.11.a.4.a.11",
    "y": "0.0.11.11.f.1.e", "z": "0.0.1f.2.4.8.1f", ".": "0.0.0.0.0.c.c", ",": "0.0.0.0.c.4.8", ":": "0.c.c.0.c.c.0",
    "-": "0.0.0.1f.0.0.0", "+": "0.4.4.1f.4.4.0", "/": "0.1.2.4.8.10.0", "%": "18.19.2.4.8.13.3",
    "=": "0.0.1f.0.1f.0.0", "(": "2.4.8.8.8.4.2", ")": "8.4.2.2.2.4.8", "_": "0.0.0.0.0.0.1f", "<": "2.4.8.10.8.4.2",
    ">": "8.4.2.1.2.4.8", "*": "0.4.15.e.15.4.0", "#": "a.a.1f.a.1f.a.a", "'": "c.4.8.0.0.0.0", "!": "4.4.4.4.4.0.4",
    "?": "e.11.1.2.4.0.4", "[": "e.8.8.8.8.8.e", "]": "e.2.2.2.2.2.e", " ": "0.0.0.0.0.0.0",
}
GLYPHS = {c: np.array([[(int(row, 16) >> (4 - k)) & 1 for k in range(5)] for row in rows.split(".")], dtype=bool)
          for c, rows in _ROWS.items()}


def text_width(text: str, scale: int = 2) -> int:
    """Pixels that a line of text takes across."""
    return (WIDTH + 1) * scale * len(text)


def draw_text(image: np.ndarray, text: str, column: int, row: int, scale: int = 2,
              color: tuple[int, int, int] = (25, 28, 33)) -> None:
    """Draws a line of text into an image (height, width, 3 or 4), its upper left corner at a pixel; cut at the borders.

    Characters that there are no dots for are drawn as "?".
    """
    for k, c in enumerate(text):
        dots = np.kron(GLYPHS.get(c, GLYPHS["?"]), np.ones((scale, scale), dtype=bool))
        left = column + k * (WIDTH + 1) * scale
        low, high = max(0, -left), min(dots.shape[1], image.shape[1] - left)
        top, bottom = max(0, -row), min(dots.shape[0], image.shape[0] - row)
        if low < high and top < bottom:
            image[row + top: row + bottom, left + low: left + high][dots[top:bottom, low:high]] = ink(color, image)


def ink(color: ArrayLike, image: np.ndarray) -> np.ndarray:
    """Colours (..., 3) in bytes as an image's numbers: of 8 or 16 bits, with full alpha where it has alpha."""
    color = np.asarray(color).astype(image.dtype)
    if image.shape[2] == 4:
        color = np.concatenate([color, np.full_like(color[..., :1], 255)], axis=-1)
    return color if image.dtype == np.uint8 else color * 257
