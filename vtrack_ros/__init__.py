"""Single-object visual tracking for ROS 2: trackers, filters, bags and a node."""


def __getattr__(name: str) -> str:
    """Return `__version__`, which is looked up when somebody asks: it takes a while to load."""
    if name != '__version__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib.metadata import PackageNotFoundError, version
    from pathlib import Path
    from xml.etree import ElementTree
    try:
        return version('vtrack_ros')
    except PackageNotFoundError:
        # The sources are used as they are, without being installed.
        manifest = Path(__file__).parents[1] / 'package.xml'
        return (ElementTree.parse(manifest).findtext('version') if manifest.exists() else None
                ) or 'unknown'
