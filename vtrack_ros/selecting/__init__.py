"""A web page for selecting and watching a target, served by a node of its own."""
