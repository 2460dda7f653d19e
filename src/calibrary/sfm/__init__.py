"""Self-calibration from the images of a flight: features and matches by COLMAP, two-view focal lengths, adjustment."""
