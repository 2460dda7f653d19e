"""Writing a calibration into copies of images, as the tags that cameras write it with."""
