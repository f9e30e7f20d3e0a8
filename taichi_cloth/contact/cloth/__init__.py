"""Cloth against cloth: pairs of vertex and face, edge and edge, kept apart by a barrier. Only with `ClothContact`."""
