"""Writing of a calibration into the metadata of image copies, in the tags that cameras use."""
