"""Boxes, ellipses and affine frames: plain geometry without pixels."""

from vtrack_ros.geometry.box import Box

__all__ = ['Box']
