"""How Sphinx makes the documentation: `sphinx-build docs docs-output`, or rosdoc2."""

from datetime import date

project = 'vtrack_ros'
author = 'vtrack_ros maintainers'
copyright = f'{date.today().year}, {author}'  # noqa: A001
extensions = ['myst_parser', 'sphinx.ext.mathjax']
myst_enable_extensions = ['dollarmath']
# As many levels of headings as links point to.
myst_heading_anchors = 3
exclude_patterns = ['examples']
html_title = project
