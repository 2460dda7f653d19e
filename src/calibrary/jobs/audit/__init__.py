"""The fleet's upkeep: what flew lately, compared with the registry that should know it."""
