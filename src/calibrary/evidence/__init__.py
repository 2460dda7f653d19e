"""Estimates of K from the metadata of an image, and the choice of one K with its grade."""
