"""One module per pattern: how its points are found in a gray image, in px as OpenCV counts them."""
