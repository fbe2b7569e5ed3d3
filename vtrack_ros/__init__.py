"""Single-object visual tracking for ROS 2: trackers, filters, bags and a node."""


def __getattr__(name: str) -> str:
    """Return `__version__`, which is only looked up on access: loading it takes a while."""
    if name != '__version__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version('vtrack_ros')
    except PackageNotFoundError:
        # The package is used from its source tree, without being installed.
        from pathlib import Path
        from xml.etree import ElementTree
        manifest = Path(__file__).parents[1] / 'package.xml'
        if not manifest.exists():
            return 'unknown'
        return ElementTree.parse(manifest).findtext('version', 'unknown')
