"""Faults by topic: each is run on a running node, and returns what it made of them."""
