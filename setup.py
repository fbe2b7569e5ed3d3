"""Install the ROS 2 package vtrack_ros; name and version come from package.xml."""

from glob import glob
from os.path import isfile
from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse('package.xml').getroot()
name = manifest.findtext('name', '')
maintainer = manifest.find('maintainer')


def files(pattern: str) -> list[str]:
    """Return the files, not the folders, that match a pattern; none is fine."""
    return sorted(path for path in glob(pattern) if isfile(path))


setup(
    name=name,
    version=manifest.findtext('version'),
    description=' '.join(manifest.findtext('description', '').split()),
    license=manifest.findtext('license'),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get('email'),
    packages=find_packages(include=[name, f'{name}.*']),
    package_data={name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{name}']),
        (f'share/{name}', ['package.xml']),
        (f'share/{name}/config', files('config/*')),
        (f'share/{name}/launch', files('launch/*')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    python_requires='>=3.11',
    zip_safe=True,
    entry_points={
        'console_scripts': [
            f'tracker = {name}.ros.main:main',
            f'tracker_lifecycle = {name}.ros.main:lifecycle_main',
            f'vtrack = {name}.cli.main:main',
        ],
    },
)
