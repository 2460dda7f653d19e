"""Combination of several calibrations of one camera, with a verdict; contradictory calibrations are refused."""
