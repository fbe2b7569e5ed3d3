"""Procedurally rendered videos with exact truth."""

from vtrack_ros.scenes.catalogue import render, scene_info, scene_names, SceneInfo
from vtrack_ros.scenes.stage import SceneFrame

__all__ = ['render', 'scene_info', 'scene_names', 'SceneFrame', 'SceneInfo']
