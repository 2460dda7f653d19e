"""Watching of a folder in which frames of a board arrive, with a report on what is still missing after each."""
