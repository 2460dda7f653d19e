"""Two calibrations of one camera, compared with each other: how far apart, whether that is noise, and what it is."""
