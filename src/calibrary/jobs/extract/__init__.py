"""The ingest gate: one proved K per camera from a directory of images."""
