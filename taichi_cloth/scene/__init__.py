"""The description, as values: meshes, fabrics, solids, and the scene that puts them together. numpy only."""
