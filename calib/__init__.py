"""calibrary.calib."""
