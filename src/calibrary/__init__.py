"""The library of a fleet's camera calibrations."""
