"""The language of kernels: `ti` is Taichi, or the fork of it that was chosen, with this package's faster parts in it.

All of the package imports it from here, and so may code of a user's own: `from taichi_cloth import ti`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import taichi as ti
else:
    from .taichi_patches import ti

__all__ = ["ti"]
