"""Distortion models, one module each, every one apart from K."""

from calibrary.distortion.base import Distortion

__all__ = ["Distortion"]
