"""The demonstration: a mixed fleet's flight, synthesised, with what the gate should make of every file."""

from calibrary.jobs.demo.flight import DemoImage, Expectation, write_flight

__all__ = ["DemoImage", "Expectation", "write_flight"]
