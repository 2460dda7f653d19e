"""Several cameras that are fixed to one another: their lenses and their relative poses in one adjustment."""
