"""
Install the ROS 2 package vtrack_ros.

Name, version, maintainers and addresses come from package.xml, dependencies from requirements/.
colcon and rosdep only use package.xml; pip uses this file.
"""

from glob import glob
from os.path import isfile
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

# colcon build --symlink-install runs a link to this file in a folder without the rest.
sources = Path(__file__).resolve().parent
manifest = ElementTree.parse(sources / 'package.xml').getroot()
name = manifest.findtext('name', '')
maintainer = manifest.find('maintainer')


def files(pattern: str) -> list[str]:
    """Return the files, not the folders, that match a pattern; none is fine."""
    return sorted(path for path in glob(pattern) if isfile(path))


def required(*lists: str) -> list[str]:
    """Return what some files of requirements/ list."""
    lines = [line for each in lists
             for line in (sources / 'requirements' / f'{each}.txt').read_text().splitlines()]
    return [line for line in lines if line and not line.startswith('#')]


setup(
    name=name,
    version=manifest.findtext('version'),
    description=' '.join(manifest.findtext('description', '').split()),
    long_description=(sources / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license=manifest.findtext('license'),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get('email'),
    project_urls={url.get('type', 'website').capitalize(): url.text
                  for url in manifest.iterfind('url')},
    keywords=['tracking', 'particle filter', 'correlation filter', 'computer vision', 'ROS'],
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Developers',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering :: Image Recognition',
        'Typing :: Typed',
    ],
    packages=find_packages(include=[name, f'{name}.*']),
    package_data={name: ['py.typed', 'evaluation/*.jinja', 'selecting/web/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{name}']),
        (f'share/{name}', ['package.xml']),
        (f'share/{name}/config', files('config/*')),
        (f'share/{name}/launch', files('launch/*')),
    ],
    install_requires=required('run'),
    extras_require={
        'tools': required('tools'),
        'ros': required('ros'),
        'select': required('ros', 'select'),
        'test': required('tools', 'ros', 'select', 'test'),
        'lint': required('lint'),
    },
    python_requires='>=3.11,<3.14',
    zip_safe=False,
    entry_points={
        'console_scripts': [
            f'tracker = {name}.ros.main:main',
            f'tracker_lifecycle = {name}.ros.main:lifecycle_main',
            f'vtrack = {name}.cli.command_line:main',
        ],
    },
)
