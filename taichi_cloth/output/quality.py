"""Qualities of pictures by name: samples of a pixel along an axis, then rays of shadow and of ambient light from each."""

QUALITY = {"fast": (2, 0, 0), "standard": (2, 1, 2), "high": (3, 4, 8)}
EXPOSED = {"fast": (1, 0, 0), "standard": (1, 1, 1), "high": (1, 1, 2)}  # in one of many exposures
