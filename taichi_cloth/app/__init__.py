"""The command line, and runs from scene file to folder."""
