"""The signals that tell a program to end."""

import signal


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return Ctrl-C, a request to end, and a closed terminal unless `nohup` made that harmless."""
    asked = signal.SIGINT, signal.SIGTERM
    return asked if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (*asked, signal.SIGHUP)
