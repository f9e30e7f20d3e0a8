"""Cloth against solids: which vertices, edges and corners meet them on their way, and what is held, freed and pushed."""
