"""Cameras and images as tables for spreadsheets and data frames."""
