"""Faults by topic: each function applies one to a running node, and returns the figures."""
