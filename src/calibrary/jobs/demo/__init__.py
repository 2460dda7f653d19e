"""Demonstration: synthesised images of a flight with different cameras, and the expected result for each file."""

from calibrary.jobs.demo.flight import DemoImage, Expectation, write_flight

__all__ = ["DemoImage", "Expectation", "write_flight"]
