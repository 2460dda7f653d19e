"""Two calibrations of one camera, held against each other: how far apart, whether that is noise, and what it is."""
