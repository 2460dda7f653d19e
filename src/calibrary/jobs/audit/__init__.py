"""The fleet's upkeep: what flew lately, held against the registry that should know it."""
