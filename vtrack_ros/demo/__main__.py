"""`python -m vtrack_ros.demo`: the demo, which Ctrl-C ends at any time."""

import signal
import sys

if __name__ == '__main__':
    try:
        # Whoever terminates it, or closes its terminal, ends its processes with it.
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler)
        # It takes a second to load, in which one may think better of it.
        from vtrack_ros.demo.demonstration import main
        code = main()
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)
