"""K from a flight's pixels: features and matches through COLMAP, focal lengths of image pairs, adjustment."""
