"""`python -m vtrack_ros.evaluation` is `vtrack evaluate`, where the package isn't installed."""

import sys

from vtrack_ros.cli.main import main

if __name__ == '__main__':
    sys.exit(main(['evaluate', *sys.argv[1:]]))
