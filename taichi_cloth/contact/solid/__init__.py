"""Cloth against solids: which vertices, edges and corners meet them on their way, and are held, freed and pushed."""
