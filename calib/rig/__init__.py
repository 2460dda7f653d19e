"""Camera rigs: lenses and relative poses of rigidly mounted cameras in one adjustment."""
