"""Several calibrations of one camera in, one with its verdict out; files that contradict one another are refused."""
